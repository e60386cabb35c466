"""Result of a spectral calibration: quantum efficiencies with their covariance, and the resulting sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.sensor.model import Sensor
from photosite.sensor.sections import Channel
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BandReading(Shown):
    """One band of light: center, width, exposure time, and photons per m2 during the exposure."""

    name: str
    centre_nm: float
    fwhm_nm: float
    exposure_s: float
    photons_m2: float
    photons_uncertainty_m2: float


@dataclass(frozen=True, eq=False)
class ChannelEfficiency(Shown):
    """Quantum efficiency of one channel, electrons per photon on the photodetector.

    Parameters
    ----------
    wavelength_nm, quantum_efficiency
        (n,) wavelengths, and estimates. Noise may make values near 0 negative.
    covariance
        (n, n) covariance, including common uncertainties.
    band_mean
        (n,) mean over each band's photons, before the correction for the bandwidth; None for a chart.
    common_relative_uncertainty
        Relative uncertainty that scales all values of all channels together: gain, pixel, photodiode.
    method, left_out
        Method of estimation, and bands that this channel could not use, with the reason.
    shortest_95
        (n,) and (n,) lower and upper ends of the 95 % interval if it is not symmetric; else None.
    """

    wavelength_nm: Array
    quantum_efficiency: Array
    covariance: Array
    band_mean: Array | None
    common_relative_uncertainty: float
    method: str
    left_out: Mapping[str, str] = field(default_factory=dict)
    shortest_95: tuple[Array, Array] | None = None

    @property
    def interval_95(self) -> tuple[Array, Array]:
        """Lower and upper ends (n,) of the 95 % interval at each wavelength."""
        if self.shortest_95 is not None:
            return self.shortest_95
        half = COVERAGE_95 * self.standard_uncertainty
        return self.quantum_efficiency - half, self.quantum_efficiency + half

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainty (n,) of each value."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def as_channel(self, source: str) -> Channel:
        """Return the channel of a sensor file. Values outside 0 to 1 (within their uncertainty) become 0 or 1."""
        value = self.quantum_efficiency
        known = zip(self.wavelength_nm, value, strict=True)
        if outside := [f"{nm:g} nm ({q:.2g})" for nm, q in known if not 0.0 <= q <= 1.0]:
            source += f"; clipped to 0 to 1, within its uncertainty, at {', '.join(outside)}"
        return Channel(
            wavelength_nm=tuple(self.wavelength_nm.tolist()),
            quantum_efficiency=tuple(np.clip(value, 0.0, 1.0).tolist()),
            standard_uncertainty=tuple(self.standard_uncertainty.tolist()),
            source=source,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists of numbers."""
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
class SpectralCalibration(Diagnosed, Shown):
    """Result of `calibrate_spectral` and `calibrate_chart`.

    Parameters
    ----------
    channels
        Result per color channel.
    bands, light
        The bands of light, sorted by wavelength, or empty for a chart; description of the light.
    base
        The sensor that supplied gain and pixel.
    source, frame_count, frames_sha256
        Where the measurement was read from, number of frames, and one digest per frame.
    diagnostics
        Limitations of the result.
    """

    channels: Mapping[str, ChannelEfficiency]
    bands: tuple[BandReading, ...]
    light: str
    base: Sensor
    source: str
    frame_count: int
    frames_sha256: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]

    @property
    def sensor(self) -> Sensor:
        """The sensor with the measured quantum efficiencies; everything else is unchanged."""
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
        """Return the content of `photosite spectral --json`."""
        return {
            "channels": {name: channel.to_dict() for name, channel in self.channels.items()},
            "light": self.light,
            "bands": [vars(band) for band in self.bands],
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
            "frame_count": self.frame_count,
        }
