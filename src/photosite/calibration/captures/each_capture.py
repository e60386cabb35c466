"""Calibration of a sensor with several captures, from the frames of each capture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.calibration.withheld import NO_RATIO
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet, FrameSource
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_mask
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Tabular, drawn
from photosite.values.uncertain import Uncertain, Value, derive, weighted_mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Array = NDArray[np.float64]

_SHOWN = ("system_gain_dn_per_e", "read_noise_e", "saturation_capacity_e")
_SIGNAL = "slopes of the signals of neighboring captures at the levels where both are linear"
# Fraction of the linear range that is used. Close to saturation, the brightest pixels clip and lower the mean.
_USED = 0.85


@dataclass(frozen=True)
class CaptureCalibration(Diagnosed, Reported, Tabular):
    """The result of `calibrate` for the frames of each capture.

    Parameters
    ----------
    captures
        The calibration of each capture by its name, with all parameters of one gain setting.
    signal_ratio
        Signal of each capture but the first over that of the first at the same light, in digital numbers.
    sensitivity_ratio
        The same in electrons: relative sensitivity times relative exposure.
    """

    captures: Mapping[str, Calibration]
    signal_ratio: Mapping[str, Estimate]
    sensitivity_ratio: Mapping[str, Estimate]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the signal-to-noise ratio of each capture against the light on Matplotlib axes, and return them."""
        return drawn(self, ax)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]
        """The diagnostics of the captures, each with the name of its capture."""
        return tuple(entry.within(name) for name, each in self.captures.items() for entry in each.diagnostics)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimates as columns, and the diagnostics."""
        found = [entry.to_dict() for entry in self.diagnostics]
        return {**self._table().to_dict(), "diagnostics": found, "warnings": list(self.warnings)}

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
    of electrons. Their uncertainty includes the differences between the photodiodes of a pixel (PRNU), of which the
    chip's pixels are a sample. Noise that captures share is no part of it: that of one charge read twice. Frames are
    paired by their order at each level.

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
    >>> from photosite.frames.frame_set import FrameSet
    >>> rng = np.random.default_rng(1)
    >>> def frame(electrons):
    ...     return np.uint16(64.5 + 0.5 * rng.poisson(electrons, (48, 48)) + rng.normal(0, 3, (48, 48)))
    >>> def taken(sensitivity):
    ...     levels = [("dark", t, 0) for t in (0.1, 0.2)] + [("light", t / 10, sensitivity * t) for t in range(1, 9)]
    ...     frames = [(kind, t, frame(mean)) for kind, t, mean in levels for _ in range(4)]
    ...     return FrameSet.from_arrays(frames, bits=16)
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
    found = {name: _Capture.of(each, calibrate_setting(each, sensor, **options)) for name, each in frames.items()}
    first = next(iter(found))
    chain: dict[str, Value] = dict.fromkeys(found[first].sites, Uncertain(1.0))
    signal: dict[str, Value] = {}
    sensitivity: dict[str, Value] = {}
    for before, name in pairwise(found):
        pair = _Pair(found[before], found[name])
        chain = {channel: derive(_product, value, pair.slope(channel)) for channel, value in chain.items()}
        signal[name] = _mean(
            [derive(_product, value, _unlike(found[first], found[name], channel)) for channel, value in chain.items()]
        )
        gains = pair if before == first else _Pair(found[first], found[name])
        sensitivity[name] = derive(_product, signal[name], gains.gain_ratio())
    return CaptureCalibration(
        {name: each.calibration for name, each in found.items()},
        {name: Estimate.of(value, _SIGNAL) for name, value in signal.items()},
        {name: Estimate.of(value, f"{_SIGNAL}, over the system gains") for name, value in sensitivity.items()},
    )


def _product(a: Uncertain, b: Uncertain) -> Uncertain:
    return a * b


def _mean(values: list[Value]) -> Value:
    """Return the mean over the channels, weighted by their uncertainty."""
    known = [each for each in values if isinstance(each, Uncertain)]
    if not known:
        return values[0] if values else NO_RATIO.missing("the captures have no channel in common")
    return weighted_mean(known, [(each.standard_uncertainty or 1e-12) ** -2 for each in known])


class _Capture(NamedTuple):
    """A capture: its calibration, its flat fields by the light on the axis of the curves, and its channels' pixels."""

    calibration: Calibration
    flats: Mapping[float, tuple[FrameSource | None, ...]]  # None for a frame that was left out
    sites: Mapping[str, NDArray[np.bool_]]

    @classmethod
    def of(cls, frames: FrameSet, calibration: Calibration) -> _Capture:
        used = {frame.name for frame in calibration.frames_used}
        axis = next((each.abscissa for each in calibration.linear_range.values()), "exposure_s")
        flats = {
            getattr(group, axis): tuple(frame if frame.name in used else None for frame in group.frames)
            for group in frames.of_kind("light")
        }
        shape = (frames.rows, frames.cols)
        sites = {channel: channel_mask(frames.cfa, channel, shape) for channel in calibration.curves}
        return cls(calibration, flats, sites)

    def responses(self, channel: str) -> tuple[_Array, _Array] | None:
        """Return the relative response of the pixels, twice, from frames of their own; None without two levels."""
        used = self.calibration.linear_range.get(channel)
        if used is None:
            return None
        inside = [x for x, frames in self.flats.items() if used.lowest <= x <= used.highest and _first_two([frames])]
        if len(inside) < 2:
            return None
        site, levels = self.sites[channel], []
        for x in (min(inside), max(inside)):
            place = _first_two([self.flats[x]])
            levels.append([_read(self.flats[x], k)[site] for k in place])
        first, second = (bright - dim for dim, bright in zip(*levels, strict=True))
        return first / first.mean(), second / second.mean()


def _first_two(sets: Sequence[tuple[FrameSource | None, ...]]) -> tuple[int, ...]:
    """Return the places of the first two frames that were used in all sets; empty where there are not as many."""
    places = [k for k, frames in enumerate(zip(*sets, strict=False)) if None not in frames]
    return tuple(places[:2]) if len(places) >= 2 else ()


def _read(frames: tuple[FrameSource | None, ...], place: int) -> _Array:
    frame = frames[place]
    assert frame is not None
    return frame.read().astype(np.float64)


def _unlike(first: _Capture, other: _Capture, channel: str) -> Uncertain:
    """Return 1 with the uncertainty of the mean ratio over the pixels, by which two photodiodes of a pixel differ.

    The covariance of two independent measurements of the difference of the relative responses has no temporal noise.
    It is 0 where the captures share the photodiode.
    """
    a, b = first.responses(channel), other.responses(channel)
    if a is None or b is None:
        return Uncertain(1.0)
    spread = float(np.cov(b[0] - a[0], b[1] - a[1])[0, 1])
    return Uncertain.of(1.0, math.sqrt(max(spread, 0.0) / a[0].size))


class _Pair:
    """Two captures, and the covariance of their temporal noise where they have the same light.

    Captures that share a charge share its shot noise.
    """

    def __init__(self, first: _Capture, other: _Capture) -> None:
        self.first, self.other = first, other
        self._noise: dict[float, dict[str, _Array] | None] = {}

    def noise(self, channel: str, x: float) -> _Array | None:
        """Return the (2, 2) covariance of the pixels' temporal noise at a level; None without two frames of both."""
        if x not in self._noise:
            flats = self.first.flats.get(x, ()), self.other.flats.get(x, ())
            self._noise[x] = None
            if places := _first_two(flats):
                a, b = (_read(frames, places[1]) - _read(frames, places[0]) for frames in flats)
                self._noise[x] = {name: np.cov(a[site], b[site]) / 2.0 for name, site in self.first.sites.items()}
        found = self._noise[x]
        return None if found is None else found[channel]

    def slope(self, channel: str) -> Value:
        """Return the slope of the signals of a channel of the second capture against those of the first."""
        captures = self.first.calibration, self.other.calibration
        curves = [each.curves.get(channel, {}).get("response") for each in captures]
        ranges = [each.linear_range.get(channel) for each in captures]
        a, b = curves
        if a is None or b is None or None in ranges:
            return NO_RATIO.missing("the response of a capture to light is not known")
        highest = _USED * min(each.highest for each in ranges if each is not None)
        x, (ya, ua), (yb, ub) = _common(a, b, highest)
        if len(x) < 3:
            lack = "1 level lies" if len(x) == 1 else f"{len(x)} levels lie"
            return NO_RATIO.missing(
                f"{lack} in the linear range of both captures; 3 are needed: add light levels between"
            )
        ratio = float((ya * yb).sum() / (ya * ya).sum())
        variance = ub**2 + (ratio * ua) ** 2
        for level, light in enumerate(x):
            noise = self.noise(channel, float(light))
            if noise is not None and (apart := noise[1, 1] + ratio**2 * noise[0, 0]) > 0.0:
                # That of the difference, over that of independent captures
                variance[level] *= max(1.0 - 2.0 * ratio * noise[0, 1] / apart, 1e-6)
        return fit_linear(np.stack([np.ones_like(ya), ya], axis=1), yb, np.diag(variance)).uncertain[1]

    def gain_ratio(self) -> Value:
        """Return the system gain of the first capture over that of the second.

        Both photon transfer lines have the same error as far as their levels have the same noise: sample variances of
        n frames and N pixels whose noise has the covariance c have the covariance 2 c^2 / (N (n - 1)).
        """
        gains = (each.calibration.system_gain_dn_per_e.uncertain for each in (self.first, self.other))
        return derive(self._quotient, *gains)

    def _quotient(self, gain: Uncertain, other: Uncertain) -> Uncertain:
        ratio = gain / other
        own = ratio.relative**2
        common = 0.0
        if own > 0.0 and not (self.first.calibration.response_curve or self.other.calibration.response_curve):
            a, b = _transfer_lines(self.first.calibration), _transfer_lines(self.other.calibration)
            for channel, x in a.keys() & b.keys():
                noise = self.noise(channel, x)
                if noise is not None:
                    frames = sum(
                        None not in both for both in zip(self.first.flats[x], self.other.flats[x], strict=False)
                    )
                    degrees = (frames - 1) * int(self.first.sites[channel].sum())
                    common += a[channel, x] * b[channel, x] * 2.0 * float(noise[0, 1]) ** 2 / degrees
            common /= gain.value * other.value
        left = math.sqrt(max(1.0 - 2.0 * common / own, 0.01)) if common > 0.0 else 1.0
        return Uncertain(ratio.value, {source: left * part for source, part in ratio.parts.items()})


def _transfer_lines(calibration: Calibration) -> dict[tuple[str, float], float]:
    """Return by channel and light the change of the system gain with the variance there."""
    points: dict[tuple[str, float], tuple[float, float]] = {}
    for channel, curves in calibration.curves.items():
        if "photon_transfer" not in curves or "response" not in curves:
            continue
        lights = dict(zip(curves["response"].y.tolist(), curves["response"].x.tolist(), strict=True))
        line = curves["photon_transfer"]
        for signal, uncertainty, used in zip(line.x, line.y_uncertainty, line.used, strict=True):
            if used and signal in lights and uncertainty > 0.0:
                points[channel, lights[signal]] = float(signal), float(uncertainty)
    total = sum((signal / uncertainty) ** 2 for signal, uncertainty in points.values())
    return {place: signal / uncertainty**2 / total for place, (signal, uncertainty) in points.items()}


def _common(
    a: Curve, b: Curve, highest: float
) -> tuple[NDArray[np.float64], tuple[NDArray[np.float64], ...], tuple[NDArray[np.float64], ...]]:
    """Return light, signals and their uncertainties at the levels of both curves up to the highest."""
    x, at_a, at_b = np.intersect1d(a.x, b.x, return_indices=True)
    used = x <= highest * (1.0 + 1e-9)
    at_a, at_b = at_a[used], at_b[used]
    return x[used], (a.y[at_a], a.y_uncertainty[at_a]), (b.y[at_b], b.y_uncertainty[at_b])
