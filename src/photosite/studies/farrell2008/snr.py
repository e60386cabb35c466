"""Figure 6: signal-to-noise ratio against the signal in volts, in total and by noise source, for both sensors of Table
1.

The curves follow from Table 1. Uniform fields of the measured cameras verify the formula.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.metrics.snr import NoiseBudget, noise_budget
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import CASES, Case, MeasuredCamera, frame_key
from photosite.values.region import Region

PARTS = MappingProxyType({"shot": "shot noise", "read": "read noise", "dsnu": "DSNU", "prnu": "PRNU"})
"""Noise sources: name of the curve in `NoiseBudget`, and label."""

PAPER_D200_AT_SWING_DB = MappingProxyType({"total": 38.10, "shot": 45.56, "read": 66.35, "dsnu": 65.86, "prnu": 38.97})
"""Curves of the D200 at its full swing of 1.08 V, as in the paper."""

FIELD_PIXELS = 256
"""Rows and columns of the uniform fields: 32768 green pixels give a standard deviation to 0.4 %, 0.034 dB."""

FIELDS = 9
_LOWEST_SHARE, _LOWEST_FIELD_SHARE, _HIGHEST_FIELD_SHARE = 5e-4, 2e-3, 0.8
"""Relative to the voltage swing: start of the curves, and range of the fields, which stay below saturation."""
_CURVE_POINTS = 300
_FIELD_CHANNEL = "G"


@dataclass(frozen=True)
class NoiseRange:
    """A range of signals in which one noise source is the largest.

    Parameters
    ----------
    noise
        A key of `PARTS`.
    from_volts, to_volts
        Ends of the range, within 0 and the voltage swing.
    """

    noise: str
    from_volts: float
    to_volts: float


@dataclass(frozen=True, eq=False)
class UniformFields:
    """Uniform fields of a measured camera, one frame per level. Arrays are (levels,).

    Parameters
    ----------
    volts
        Mean signal at the pixel, as read.
    snr_db
        20 log10 of the mean over the standard deviation over pixels, without the 1/12 DN^2 of rounding.
    standard_error_db
        Of `snr_db`. All levels share one fixed pattern, so that their errors are correlated.
    expected_db
        From the noise budget at these volts.
    """

    volts: NDArray[np.float64]
    snr_db: NDArray[np.float64]
    standard_error_db: NDArray[np.float64]
    expected_db: NDArray[np.float64]

    @property
    def largest_deviation(self) -> float:
        """Largest difference from the formula, in standard errors."""
        return float(np.abs((self.snr_db - self.expected_db) / self.standard_error_db).max())


@dataclass(frozen=True, eq=False)
class SensorSnr:
    """Figure 6 for one sensor.

    Parameters
    ----------
    case
        Camera.
    swing_v
        Voltage swing, the end of the curves.
    curves
        Noise budget from 0.05 % of the swing to the swing.
    at_swing
        Noise budget at the swing.
    dominant
        Largest single noise source by range of signals.
    fields
        Uniform fields of a virtual chip.
    """

    case: Case
    swing_v: float
    curves: NoiseBudget
    at_swing: NoiseBudget
    dominant: tuple[NoiseRange, ...]
    fields: UniformFields

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`, with every tenth point of the curves."""
        names = ("total", *PARTS)
        thin = slice(None, None, 10)
        return {
            "voltage_swing_v": self.swing_v,
            "at_swing_db": {name: float(getattr(self.at_swing, f"{name}_db")) for name in names},
            "read_noise_and_dsnu_dominate_below_volts": self.curves.dark_limited_below_volts,
            "prnu_dominates_above_volts": self.curves.prnu_limited_above_volts,
            "largest_noise": [
                {"noise": i.noise, "from_volts": i.from_volts, "to_volts": i.to_volts} for i in self.dominant
            ],
            "curves": {
                "volts": self.curves.volts[thin].tolist(),
                **{f"{name}_db": getattr(self.curves, f"{name}_db")[thin].tolist() for name in names},
            },
            "uniform_fields_of_the_virtual_camera": {
                "volts": self.fields.volts.tolist(),
                "snr_db": self.fields.snr_db.tolist(),
                "standard_error_db": self.fields.standard_error_db.tolist(),
                "expected_db": self.fields.expected_db.tolist(),
                "largest_deviation_in_standard_errors": self.fields.largest_deviation,
            },
        }


@dataclass(frozen=True, eq=False)
class SnrChapter:
    """Figure 6 for both sensors.

    Parameters
    ----------
    sensors
        By key of the case.
    """

    sensors: MappingProxyType[str, SensorSnr]

    @property
    def from_paper_db(self) -> dict[str, float]:
        """Curves of the D200 at full swing minus those of the paper."""
        at_swing = self.sensors["d200"].at_swing
        return {name: float(getattr(at_swing, f"{name}_db")) - paper for name, paper in PAPER_D200_AT_SWING_DB.items()}

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            **{key: sensor.to_dict() for key, sensor in self.sensors.items()},
            "d200_at_swing_less_paper_db": self.from_paper_db,
        }


def snr_against_volts(seed: int) -> SnrChapter:
    """Compute Figure 6 for both sensors, and measure uniform fields.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 6; the formula is in `photosite.metrics.snr`. The uniform fields have 256
    x 256 pixels.

    Examples
    --------
    >>> d200 = snr_against_volts(2008).sensors["d200"]
    >>> d200.at_swing.total_db.round(2), [part.noise for part in d200.dominant]
    (np.float64(38.1), ['dsnu', 'shot', 'prnu'])
    """
    return SnrChapter(MappingProxyType({case.key: _sensor_snr(case, seed) for case in CASES}))


def _sensor_snr(case: Case, seed: int) -> SensorSnr:
    sensor = case.sensor()
    swing = sensor.pixel.voltage_swing_v.value
    return SensorSnr(
        case,
        swing,
        curves=noise_budget(sensor, np.geomspace(_LOWEST_SHARE * swing, swing, _CURVE_POINTS)),
        at_swing=noise_budget(sensor, swing),
        dominant=dominant_noises(sensor),
        fields=_uniform_fields(case, sensor, seed),
    )


def dominant_noises(sensor: Sensor) -> tuple[NoiseRange, ...]:
    """Return the largest single noise source by range of signals, up to the voltage swing.

    Read noise and DSNU are constant, shot noise grows with the square root of the signal S, and PRNU with S: in
    electrons c, sqrt(S) and p S. The larger constant is exceeded by shot noise at S = c^2, and shot noise by PRNU at 1
    / p^2. If c p > 1, PRNU exceeds the constant at c / p and shot noise is never the largest.

    Examples
    --------
    >>> import photosite as ps
    >>> [(part.noise, round(part.to_volts, 3)) for part in dominant_noises(ps.load_sensor("vendor-2.2um"))]
    [('dsnu', 0.353), ('prnu', 1.0)]
    """
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    swing = sensor.pixel.voltage_swing_v.value
    read, dsnu = (sensor.electrons(value.value) for value in (sensor.noise.read_noise_mv, sensor.noise.dsnu_mv))
    constant, prnu = max(read, dsnu), sensor.noise.prnu_percent.value / 100.0
    prnu_from = math.inf if prnu == 0 else (1 / prnu**2 if constant * prnu <= 1 else constant / prnu)
    shot_from = min(constant**2, prnu_from)
    # A range that does not exist starts where the next one does.
    begins = ("read" if read > dsnu else "dsnu", 0.0), ("shot", v_per_e * shot_from), ("prnu", v_per_e * prnu_from)
    ends = (*(start for _, start in begins[1:]), swing)
    dominant = (
        NoiseRange(noise, start, min(end, swing))
        for (noise, start), end in zip(begins, ends, strict=True)
        if start < swing
    )
    return tuple(part for part in dominant if part.to_volts > part.from_volts)


def _uniform_fields(case: Case, nominal: Sensor, seed: int) -> UniformFields:
    """Expose uniform fields with the chip of the measured camera, without lens and lamp."""
    measured = MeasuredCamera.drawn(case, seed)
    sensor = measured.sensor(FIELD_PIXELS, FIELD_PIXELS)
    camera = Camera(case.lens, sensor)
    swing, v_per_dn = sensor.pixel.voltage_swing_v.value, sensor.mv_per_dn * 1e-3
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    everywhere = [Region("field", 0, FIELD_PIXELS, 0, FIELD_PIXELS)]
    rows = []
    for number, level in enumerate(np.geomspace(_LOWEST_FIELD_SHARE * swing, _HIGHEST_FIELD_SHARE * swing, FIELDS)):
        mean_e = np.full((FIELD_PIXELS, FIELD_PIXELS), level / v_per_e, np.float32)
        raw = camera.expose(mean_e, case.exposure_s, seed=frame_key(seed, f"even fields of {case.key}"), frame=number)
        mean_dn, snr_db, error_db = uniform_snr(patch_statistics(raw, everywhere), 0, _FIELD_CHANNEL)
        rows.append((mean_dn * v_per_dn, snr_db, error_db))
    volts, snrs_db, errors_db = np.array(rows).T
    return UniformFields(volts, snrs_db, errors_db, noise_budget(nominal, volts).total_db)


def uniform_snr(statistics: PatchStatistics, patch: int, channel: str) -> tuple[float, float, float]:
    """Return the signal-to-noise ratio of a uniform patch in one frame, as the noise budget defines it.

    Parameters
    ----------
    statistics
        Of one frame or more.
    patch, channel
        Patch number and channel; the mean must be above black.

    Returns
    -------
    tuple of float
        Mean above black in DN; 20 log10 of the mean over the standard deviation over pixels, without the 1/12 DN^2 of
        rounding; its standard error in dB, to first order.
    """
    at = patch, statistics.channels.index(channel)
    mean = float(statistics.mean_dn[at])
    variance = float(statistics.spatial_noise_dn[at]) ** 2 - 1.0 / 12.0
    relative = math.hypot(
        float(statistics.standard_error_dn[at]) / mean,
        0.5 * float(statistics.spatial_variance_error_dn2[at]) / variance,
    )
    return mean, 10 * math.log10(mean**2 / variance), 20 / math.log(10) * relative
