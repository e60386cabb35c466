"""Calibration of a sensor with several captures, from the frames of each capture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.calibrate import calibrate
from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.result import Calibration
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import ResultTable, Tabular
from photosite.values.uncertain import Missing, Source, Uncertain, Value, derive

_SHOWN = ("system_gain_dn_per_e", "read_noise_e", "saturation_capacity_e")
_SIGNAL = "slopes of the signals of neighboring captures at the levels where both are linear"
# Share of the linear range that is used. Close to saturation, the brightest pixels clip and lower the mean.
_USED = 0.85


@dataclass(frozen=True)
class CaptureCalibration(Tabular):
    """The result of `calibrate_captures`.

    Parameters
    ----------
    captures
        The calibration of each capture by its name: system gain, read noise, saturation capacity and the others.
    signal_ratio
        Signal of each capture but the first over that of the first at the same light, in digital numbers.
    sensitivity_ratio
        The same in electrons: relative sensitivity times relative exposure.
    """

    captures: Mapping[str, Calibration]
    signal_ratio: Mapping[str, Estimate]
    sensitivity_ratio: Mapping[str, Estimate]

    def _table(self) -> ResultTable:
        rows = []
        for name, calibration in self.captures.items():
            found: dict[str, Estimate] = {parameter: getattr(calibration, parameter) for parameter in _SHOWN}
            for ratio in ("signal_ratio", "sensitivity_ratio"):
                if name in getattr(self, ratio):
                    found[ratio] = getattr(self, ratio)[name]
            for parameter, entry in found.items():
                ends = entry.interval_95 or (None, None)
                rows.append((name, parameter, entry.value, entry.standard_uncertainty, *ends, entry.reason))
        columns = ("capture", "parameter", "value", "standard_uncertainty", "lower_95", "upper_95", "reason")
        return ResultTable("Captures, ratios to the first", columns, rows)


def calibrate_captures(
    frames: Mapping[str, FrameSet], sensor: Sensor | None = None, **options: Any
) -> CaptureCalibration:
    """Calibrate each capture of a sensor, and the ratios of their sensitivities.

    The ratio of the signals of a capture and the one before does not depend on the stated light: it is the slope of
    the mean signals of one against those of the other, at the levels in the lower 85 % of the linear range of both.
    The products of these ratios refer to the first capture. Divided by the ratio of the system gains they are ratios
    of electrons.

    Parameters
    ----------
    frames
        Dark frames and flat fields of each capture by name, from the most to the least sensitive. The light and the
        exposure times are those of the frame that the captures belong to, the same for all.
    sensor, options
        As for `calibrate`.

    Returns
    -------
    CaptureCalibration
        Ratios that cannot be determined have a reason instead of a value.

    Raises
    ------
    InputError
        If there are fewer than two captures, or frames of different sizes.
    CalibrationError
        As for `calibrate`.

    Examples
    --------
    >>> from photosite.frames.frame_set import frame_set_from_arrays
    >>> rng = np.random.default_rng(1)
    >>> def frame(electrons):
    ...     return np.uint16(64.5 + 0.5 * rng.poisson(electrons, (48, 48)) + rng.normal(0, 3, (48, 48)))
    >>> def taken(sensitivity):
    ...     levels = [("dark", t, 0) for t in (0.1, 0.2)] + [("light", t / 10, sensitivity * t) for t in range(1, 9)]
    ...     frames = [(kind, t, frame(mean)) for kind, t, mean in levels for _ in range(4)]
    ...     return frame_set_from_arrays(frames, bits=16)
    >>> found = calibrate_captures({"large": taken(1e4), "small": taken(2500)})
    >>> low, high = found.sensitivity_ratio["small"].interval_95
    >>> low < 0.25 < high, high - low < 0.05
    (True, True)
    """
    if len(frames) < 2:
        raise InputError("frames", value=sorted(frames), expected="frames of two captures or more")
    sizes = {(each.rows, each.cols, each.cfa) for each in frames.values()}
    if len(sizes) > 1:
        raise InputError("frames", value=sorted(map(str, sizes)), expected="of one size and color filter array")
    found = {name: calibrate(each, sensor, **options) for name, each in frames.items()}
    first, *others = found
    signal: dict[str, Value] = {}
    total: Value = Uncertain(1.0)
    for before, name in pairwise(found):
        total = derive(lambda so_far, ratio: so_far * ratio, total, _signal_ratio(found[before], found[name]))
        signal[name] = total
    sensitivity = {
        name: derive(
            lambda ratio, gain, other: ratio * gain / other,
            signal[name],
            found[first].system_gain_dn_per_e.uncertain,
            found[name].system_gain_dn_per_e.uncertain,
        )
        for name in others
    }
    return CaptureCalibration(
        found,
        {name: Estimate.of(value, _SIGNAL) for name, value in signal.items()},
        {name: Estimate.of(value, f"{_SIGNAL}, over the system gains") for name, value in sensitivity.items()},
    )


def _signal_ratio(first: Calibration, other: Calibration) -> Value:
    """Return the ratio of the signals, the mean over the channels weighted by their uncertainty."""
    found = [_slope(first, other, channel) for channel in first.curves if channel in other.curves]
    values = [each for each in found if isinstance(each, Uncertain)]
    if not values:
        return found[0] if found else Missing("the captures have no channel in common")
    weights = np.array([each.standard_uncertainty or 1e-12 for each in values]) ** -2.0
    shares = weights / weights.sum()
    return sum((each * float(share) for each, share in zip(values, shares, strict=True)), Uncertain(0.0))


def _slope(first: Calibration, other: Calibration, channel: str) -> Value:
    """Return the slope of the signals of a channel of one capture against those of another."""
    curves = [each.curves[channel].get("response") for each in (first, other)]
    ranges = [each.linear_range.get(channel) for each in (first, other)]
    a, b = curves
    if a is None or b is None or None in ranges:
        return Missing("the response of a capture to light is not known")
    highest = _USED * min(each.highest for each in ranges if each is not None)
    x, (ya, ua), (yb, ub) = _common(a, b, highest)
    if len(x) < 3:
        return Missing(f"{len(x)} levels of light lie in the linear range of both captures; 3 are needed")
    ratio = float((ya * yb).sum() / (ya * ya).sum())
    weight = 1.0 / np.hypot(ub, ratio * ua)
    design = np.stack([np.ones_like(ya), ya], axis=1) * weight[:, None]
    solution, *_ = np.linalg.lstsq(design, yb * weight, rcond=None)
    residual = yb * weight - design @ solution
    freedom = len(x) - 2
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / freedom
    return Uncertain.of(float(solution[1]), float(np.sqrt(covariance[1, 1])), Source.student(freedom))


def _common(
    a: Curve, b: Curve, highest: float
) -> tuple[NDArray[np.float64], tuple[NDArray[np.float64], ...], tuple[NDArray[np.float64], ...]]:
    """Return light, signals and their uncertainties at the levels of both curves up to the highest."""
    x, at_a, at_b = np.intersect1d(a.x, b.x, return_indices=True)
    used = x <= highest * (1.0 + 1e-9)
    at_a, at_b = at_a[used], at_b[used]
    return x[used], (a.y[at_a], a.y_uncertainty[at_a]), (b.y[at_b], b.y_uncertainty[at_b])
