"""What a spectral calibration gives: quantum efficiencies with their covariance, and the sensor that has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.sensor.model import Channel, Sensor
from photosite.values.measured import COVERAGE_95


@dataclass(frozen=True)
class BandReading:
    """One band of light: its centre and width, the exposure, and the photons per m2 in it."""

    name: str
    centre_nm: float
    fwhm_nm: float
    exposure_s: float
    photons_m2: float
    photons_uncertainty_m2: float


@dataclass(frozen=True, eq=False)
class ChannelEfficiency:
    """Quantum efficiency of one channel, electrons per photon on the photodetector.

    Parameters
    ----------
    wavelength_nm
        (n,) where it was measured.
    quantum_efficiency
        (n,) as estimated; values that are 0 but for noise may come out below 0 and are left so here.
    covariance
        (n, n) of the values, all that is common to them included.
    band_mean
        (n,) the mean over each band's photons, before its width was taken off; None where there were no bands.
    common_relative_uncertainty
        The part of the relative uncertainty that scales all values of all channels alike: gain, pixel, photodiode.
    method
        How it was estimated.
    left_out
        Bands that this channel could not use, and why.
    shortest_95
        (n,) and (n,) lower and upper ends of the 95 % interval where it is not symmetric; else None.
    """

    wavelength_nm: NDArray[np.float64]
    quantum_efficiency: NDArray[np.float64]
    covariance: NDArray[np.float64]
    band_mean: NDArray[np.float64] | None
    common_relative_uncertainty: float
    method: str
    left_out: Mapping[str, str] = field(default_factory=dict)
    shortest_95: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    @property
    def interval_95(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) and (n,) lower and upper ends of the 95 % interval at each wavelength."""
        if self.shortest_95 is not None:
            return self.shortest_95
        half = COVERAGE_95 * self.standard_uncertainty
        return self.quantum_efficiency - half, self.quantum_efficiency + half

    @property
    def standard_uncertainty(self) -> NDArray[np.float64]:
        """(n,) of each value."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def as_channel(self, source: str) -> Channel:
        """As a sensor file keeps it. A value below 0 or above 1, within its uncertainty, enters as 0 or 1."""
        value = self.quantum_efficiency
        outside = [
            f"{nm:g} nm ({q:.2g})" for nm, q in zip(self.wavelength_nm, value, strict=True) if not 0.0 <= q <= 1.0
        ]
        if outside:
            source += f"; brought to the nearest possible value, within uncertainty, at {', '.join(outside)}"
        return Channel(
            wavelength_nm=tuple(self.wavelength_nm.tolist()),
            quantum_efficiency=tuple(np.clip(value, 0.0, 1.0).tolist()),
            standard_uncertainty=tuple(self.standard_uncertainty.tolist()),
            source=source,
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists of numbers."""
        return {
            "wavelength_nm": self.wavelength_nm.tolist(),
            "quantum_efficiency": self.quantum_efficiency.tolist(),
            "standard_uncertainty": self.standard_uncertainty.tolist(),
            "interval_95": [end.tolist() for end in self.interval_95],
            "band_mean": None if self.band_mean is None else self.band_mean.tolist(),
            "common_relative_uncertainty": self.common_relative_uncertainty,
            "method": self.method,
            "left_out": dict(self.left_out),
        }


@dataclass(frozen=True, eq=False)
class SpectralCalibration:
    """The outcome of `calibrate_spectral` and of `calibrate_chart`.

    Parameters
    ----------
    channels
        Per colour channel.
    bands
        The bands of light, in the order of wavelength; none for a chart.
    light
        What the frames were taken under, in words.
    base
        The sensor that gain and pixel were taken from.
    source
        What was opened.
    frame_count
        Frames read.
    frames_sha256
        One digest per frame.
    warnings
        What the reader should know.
    """

    channels: Mapping[str, ChannelEfficiency]
    bands: tuple[BandReading, ...]
    light: str
    base: Sensor
    source: str
    frame_count: int
    frames_sha256: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def sensor(self) -> Sensor:
        """The sensor with the quantum efficiencies as measured, all else as it was."""
        source = f"measured from {self.frame_count} frames under {self.light} ({self.source})"
        channels = {name: channel.as_channel(f"{source}; {channel.method}") for name, channel in self.channels.items()}
        known = self.base.provenance.source or self.base.name
        return self.base.with_(
            channels={name: channel.model_dump() for name, channel in channels.items()},
            source=f"quantum efficiency {source}; the rest as in: {known}",
            created=date.today().isoformat(),
            frames_sha256=tuple(sorted({*self.base.provenance.frames_sha256, *self.frames_sha256})),
        )

    def to_dict(self) -> dict[str, Any]:
        """What `photosite spectral --json` prints."""
        return {
            "channels": {name: channel.to_dict() for name, channel in self.channels.items()},
            "light": self.light,
            "bands": [vars(band) for band in self.bands],
            "warnings": list(self.warnings),
            "frame_count": self.frame_count,
        }
