"""The frames of a spectral measurement, and the light they were taken under."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.passband import Passband
from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSource
from photosite.sensor.model import Sensor
from photosite.values.cfa import Cfa
from photosite.values.exposure import check_exposure
from photosite.values.measured import Measured
from photosite.values.region import Region


@dataclass(frozen=True, eq=False)
class Photodiode:
    """A calibrated photodiode, for readings in amperes.

    Parameters
    ----------
    responsivity_a_per_w
        Over wavelength, linear between entries.
    standard_uncertainty_a_per_w
        (wavelengths,) of each entry, independent of the others; what they have in common belongs into
        `SpectralFrames.scale_uncertainty_percent`.
    area_mm2
        Its sensitive area.

    Raises
    ------
    InputError
        If a responsivity or the area is not above 0.
    """

    responsivity_a_per_w: Spectrum
    standard_uncertainty_a_per_w: NDArray[np.float64]
    area_mm2: Measured

    def __post_init__(self) -> None:
        if (self.responsivity_a_per_w.values <= 0).any():
            raise InputError("a photodiode's responsivity is above 0 A/W at every wavelength listed")
        if not self.area_mm2.value > 0:
            raise InputError(f"a photodiode's area is above 0 mm2, not {self.area_mm2.value:g}")


@dataclass(frozen=True, eq=False)
class Band:
    """Frames of one band of light.

    Parameters
    ----------
    name
        For messages and figures: "550 nm".
    passband
        The light's spectrum.
    exposure_s
        Exposure time.
    frames
        Where the frames are.
    reading
        What the photodiode read where the sensor is, in the light, its dark reading taken off: irradiance in W/m2, or
        current in A.
    photodiode
        The photodiode, for readings in amperes.
    in_amperes
        Whether the reading is a current.
    centre_uncertainty_nm
        Standard uncertainty of the band's wavelength, independent from band to band.

    Raises
    ------
    InputError
        If the reading is not above 0, there are no frames, or the photodiode is missing or does not know the band.
    """

    name: str
    passband: Passband
    exposure_s: float
    frames: tuple[FrameSource, ...]
    reading: Measured
    photodiode: Photodiode | None = None
    in_amperes: bool = False
    centre_uncertainty_nm: float = 0.0

    def __post_init__(self) -> None:
        check_exposure(self.exposure_s)
        if not self.reading.value > 0:
            raise InputError(f"{self.name}: a photodiode's reading in the light is above 0, not {self.reading.value:g}")
        if not self.frames:
            raise InputError(f"{self.name}: a band needs a frame or more")
        if self.in_amperes and self.photodiode is None:
            raise InputError(f"{self.name}: a reading in amperes needs the 'photodiode': its area and responsivity")
        if not (math.isfinite(self.centre_uncertainty_nm) and self.centre_uncertainty_nm >= 0):
            raise InputError(f"{self.name}: a wavelength's uncertainty is 0 nm or more")
        self.photons_m2()

    def photons_m2(self, moved_nm: float = 0.0) -> Measured:
        """Photons per m2 in the exposure, with the uncertainty of the reading.

        Parameters
        ----------
        moved_nm
            How much the band lies higher than it is said to.
        """
        band = self.passband.moved(moved_nm)
        watts = 1.0
        if self.in_amperes and self.photodiode is not None:
            diode = self.photodiode
            amperes_per_watt = band.mean_responsivity_a_per_w(diode.responsivity_a_per_w)
            watts = 1.0 / (amperes_per_watt * diode.area_mm2.value * 1e-6)
        scale = watts * band.photons_per_joule * self.exposure_s
        return Measured(self.reading.value * scale, self.reading.standard_uncertainty * scale)

    def diode_deviations(self) -> NDArray[np.float64]:
        """(entries,) relative standard uncertainty that each entry of the responsivity's table gives the photons.

        Bands that look at one entry share its error.
        """
        if self.photodiode is None or not self.in_amperes:
            return np.zeros(0)
        diode = self.photodiode
        known = diode.responsivity_a_per_w.wavelength_nm
        points, shares = self.passband.quadrature(known)
        # The band's mean responsivity is linear in the entries, through the hat function of each.
        weight = np.array([shares @ np.interp(points, known, unit) for unit in np.eye(known.size)])
        mean = self.passband.mean_responsivity_a_per_w(diode.responsivity_a_per_w)
        return np.asarray(weight * diode.standard_uncertainty_a_per_w / mean)


@dataclass(frozen=True, eq=False)
class SpectralFrames:
    """A spectral measurement: bands, darks, and what is common to them.

    Parameters
    ----------
    bands
        In the order of their wavelengths after construction.
    darks
        Exposure time to its dark frames. Every band's exposure needs some.
    rows, cols, bits, cfa
        Of every frame.
    sensor
        Where gain, pixel size and fill factor come from, or None.
    photodiode
        For readings in amperes.
    region
        What was lit evenly; None is the whole frame.
    scale_uncertainty_percent
        Relative standard uncertainty that all readings have in common.
    exposure_uncertainty_percent
        Relative standard uncertainty of each exposure setting, common to bands of one setting.
    source
        What was opened.

    Raises
    ------
    InputError
        If two bands have one centre, or a band's exposure has no dark frames.
    """

    bands: tuple[Band, ...]
    darks: Mapping[float, tuple[FrameSource, ...]]
    rows: int
    cols: int
    bits: int
    cfa: Cfa
    sensor: Sensor | None = None
    photodiode: Photodiode | None = None
    region: Region | None = None
    scale_uncertainty_percent: float = 0.0
    exposure_uncertainty_percent: float = 0.0
    source: str = "memory"

    def __post_init__(self) -> None:
        bands = tuple(sorted(self.bands, key=lambda band: band.passband.centre_nm))
        if not bands:
            raise InputError("a spectral measurement needs a band or more")
        for one, other in pairwise(bands):
            if one.passband.centre_nm == other.passband.centre_nm:
                raise InputError(f"two bands have the centre {one.name}; put their frames into one entry")
        for band in bands:
            if not self.darks.get(band.exposure_s):
                known = ", ".join(f"{exposure_s:g}" for exposure_s in sorted(self.darks))
                raise InputError(
                    f"{band.name}: no dark frames at its exposure of {band.exposure_s:g} s, but at {known or 'no'} s; "
                    f"take some with the light shut off"
                )
        object.__setattr__(self, "bands", bands)

    @property
    def frame_count(self) -> int:
        """Frames of all bands and darks together."""
        return sum(len(band.frames) for band in self.bands) + sum(map(len, self.darks.values()))
