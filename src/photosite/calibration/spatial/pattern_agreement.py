"""Whether the pattern of the dark frames is in the flat fields: offsets with factor 1, dark current with the exposure.

The flat fields of each pixel lie on a line over the amount of light. Its value at no light is the pixel's dark signal
at the exposure time there, and its slope contains the dark current if the exposure time grows with the light. The
regression of both on the pattern of the dark frames has the coefficient 1 where all frames are of one chip in one
state. Shading and the patterns of whole rows and columns are removed before.

The pattern of the dark current over the pixels and that of the response tell warmer flat fields from light in the dark
frames: with response r, dark current d and light l in the dark frames, dark slopes are d + l r and flat fields a r + w
d. A function of the dark slopes that is orthogonal to them has no covariance with a normal response nor with normal
noise (Stein's lemma), but with the skewed dark current: the ratio of its covariances is w. The rest of the covariance
of both is l a var(r).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from photosite.calibration.dark.dark_result import DarkResult
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.reduction.turned_frames import LEFT_TO_RIGHT, MIRRORED, turns
from photosite.engine.jit import F64
from photosite.engine.lazy_maps import Map
from photosite.values.uncertain import Uncertain

P_VALUE = 1e-4
"""Fraction of sets of one chip in one state that are reported."""

LIMIT = -float(ndtri(0.5 * P_VALUE))
"""Standard uncertainties that belong to it."""

LEAST_DIFFERENCE = 0.3
"""Difference of the coefficient from 1 that matters: what is added or missing has 0 or 2, or a few degrees' 1.4."""

MOST_PIXELS = 1 << 18
"""Pixels of the rows in the middle that are compared: enough for any pattern that matters."""

MOST_NOISE = 3.0
"""Variance of the noise over that of the pattern from which they are not compared."""

OPEN_S = 0.01
"""Exposure time of dark frames of one time from which their unknown dark current may be a part of their pattern."""

LEAST_LEAK = 0.1
"""Fraction of the dark signal that matters if it is light."""

SAME_EXPOSURE = 1e-6
"""Relative difference of the exposure times of flat fields that are one."""

_BOX = 9
"""Side of the square whose mean is subtracted, in pixels of a channel: three times three."""

_SAMPLES = 1 << 13
"""Pixels from which the spread of a plane is computed, at least, where it has as many: it is known to 1 %."""

_FAR = 6.0
"""Pixels farther than this, in standard deviations, do not count: a few hot pixels must not decide."""


@dataclass(frozen=True)
class Agreement:
    """Regression coefficient of the flat fields on the pattern of the dark frames, and its standard uncertainty."""

    ratio: float
    uncertainty: float

    @property
    def refuted(self) -> bool:
        """Whether the coefficient differs from 1 beyond chance, and by enough to matter."""
        away = abs(self.ratio - 1.0)
        return away > max(LEAST_DIFFERENCE, LIMIT * self.uncertainty)


@dataclass(frozen=True)
class Leak:
    """Light in the dark frames: its fraction of their dark signal, and the dark current of the flat fields.

    `warmth` is the dark current of the flat fields over that of the dark frames, whatever light is in these; None where
    the flat fields do not show it.
    """

    fraction: Uncertain
    warmth: Uncertain | None

    @property
    def seen(self) -> bool:
        """Whether the fraction is above 0 beyond chance, and large enough to matter."""
        return self.fraction.value > LEAST_LEAK and self.fraction.beyond(LIMIT)

    @property
    def warmer(self) -> bool:
        """Whether the dark current of the flat fields is another beyond chance, light in the dark frames or not."""
        return self.warmth is not None and (self.warmth - 1.0).beyond(3.0)


@dataclass(frozen=True)
class Agreements:
    """The agreement of offsets and of dark currents, and the light in dark frames; None where frames do not show it.

    `turned` tells how the dark frames are mirrored or rotated relative to the flat fields, if they agree then.
    """

    offsets: Agreement | None = None
    rates: Agreement | None = None
    leak: Leak | None = None
    turned: str = ""


NOT_COMPARED = Agreements()


class PixelLines:
    """The line of each pixel over the light levels of its channel, for the rows in the middle of the frame."""

    def __init__(
        self,
        tile: NDArray[np.int64],
        shape: tuple[int, int],
        offsets: Sequence[Mapping[int, float]],
        slopes: Sequence[Mapping[int, float]],
    ) -> None:
        """Prepare for mean frames; `offsets` and `slopes` are the weights of the light groups, by channel."""
        height = tile.shape[0]
        rows = min(shape[0], max(MOST_PIXELS // shape[1], 2 * _BOX * height)) // height * height
        first = (shape[0] - rows) // 2 // height * height
        self._tile, self._weights = tile, (offsets, slopes)
        self._rows = slice(first, first + rows)
        self._sums = np.zeros((2, rows, shape[1]))

    def add(self, group: int, mean: Map) -> None:
        """Add the mean frame of a light group."""
        cols = self._sums.shape[2]
        lines = -1, self._tile.shape[0], cols
        values = mean[self._rows].reshape(lines)
        for total, weights in zip(self._sums, self._weights, strict=True):
            factors = np.array([of_channel.get(group, 0.0) for of_channel in weights])[self._tile]
            if factors.any():
                total.reshape(lines)[:] += np.tile(factors, -(-cols // factors.shape[1]))[:, :cols] * values

    def agreements(
        self, dark: DarkResult, channels: Sequence[Channel], lights: Sequence[GroupStatistics]
    ) -> Agreements:
        """Compare the lines with the dark frames."""
        if dark.mean is None or dark.clipped is not None or dark.noise_unknown or dark.rounding_shows:
            return NOT_COMPARED
        offsets: list[_Moments] = []
        rates: list[_RatePlane] = []
        times = [entry.group.exposure_s for entry in lights]
        varied = max(times) > (1.0 + SAME_EXPOSURE) * min(times)
        for channel, seconds in self._compared(channels, lights):
            known = dark.at(seconds[0], beyond=True)
            assert known is not None
            if dark.slope_map is None and abs(known.exposure_s - seconds[0]) > OPEN_S:
                continue
            pattern = known.mean[self._rows]
            for site in np.argwhere(self._tile == channel.index):
                flat, noise = self._plane(self._sums[0], site), known.noise[channel.index].pixel.value
                offsets.append(_Moments.of(flat, self._plane(pattern, site), 1.0, noise))
                if dark.slope_map is not None and seconds[1] != 0.0:
                    parts = dark.mean.noise[channel.index]
                    whole = dark.slope_map.noise(dark.slope_map.coefficients, channel.index).value
                    noise = whole * parts.pixel.value / parts.total.value if parts.total.value > 0.0 else whole
                    slopes = dark.slope_map.slopes.slopes[self._rows]
                    own = self._site(slopes, site).mean(), self._site(self._sums[1], site).mean()
                    maps = self._plane(slopes, site), self._plane(self._sums[1], site)
                    rates.append(_RatePlane.of(*maps, noise, seconds[1] if varied else 0.0, *map(float, own)))
        moments = [plane.moments() for plane in rates if plane.seconds != 0.0]
        found = Agreements(_agreement(offsets), _agreement(moments), _leak(rates))
        if found.offsets is not None and found.offsets.refuted:
            return replace(found, turned=self._how_turned(dark, channels, lights))
        return found

    def shared_variance(self, dark: DarkResult, channel: int) -> Uncertain | None:
        """Return the covariance over pixels of a channel's slopes with the dark frames; None where it is not known."""
        if dark.mean is None or dark.clipped is not None:
            return None
        pattern = dark.mean.mean[self._rows]
        maps = [
            (self._plane(self._sums[1], site), self._plane(pattern, site))
            for site in np.argwhere(self._tile == channel)
        ]
        product = np.concatenate([(slopes * offsets).ravel() for slopes, offsets in maps])
        return Uncertain.of(float(product.mean()), float(product.std()) / math.sqrt(product.size))

    def _compared(
        self, channels: Sequence[Channel], lights: Sequence[GroupStatistics]
    ) -> Iterator[tuple[Channel, list[float]]]:
        """Yield the channels with lines, and the exposure times of their values at no light and of their slopes."""
        times = [entry.group.exposure_s for entry in lights]
        for channel in channels:
            weights = [each[channel.index] for each in self._weights]
            if weights[1]:
                yield channel, [sum(weight * times[group] for group, weight in each.items()) for each in weights]

    def _how_turned(self, dark: DarkResult, channels: Sequence[Channel], lights: Sequence[GroupStatistics]) -> str:
        """Return how the dark frames must be mirrored or rotated to agree with the flat fields, "" if none helps."""
        assert dark.mean is not None
        shape = dark.mean.mean.shape
        first, last, _ = self._rows.indices(shape[0])
        for name, turn in turns(shape).items():
            if name not in MIRRORED and (first, last) != (0, shape[0]):
                continue
            moments = []
            for channel, seconds in self._compared(channels, lights):
                known = dark.at(seconds[0], beyond=True)
                assert known is not None
                rows = self._rows if name == LEFT_TO_RIGHT else slice(shape[0] - last, shape[0] - first)
                pattern = np.asarray(turn(known.mean[rows]), np.float64)
                for site in np.argwhere(self._tile == channel.index):
                    flat, noise = self._plane(self._sums[0], site), known.noise[channel.index].pixel.value
                    moments.append(_Moments.of(flat, self._plane(pattern, site), 1.0, noise))
            found = _agreement(moments)
            if found is not None and not found.refuted and found.ratio > 1.0 - LEAST_DIFFERENCE:
                return name
        return ""

    def _site(self, values: F64, site: NDArray[np.int64]) -> F64:
        return values[site[0] :: self._tile.shape[0], site[1] :: self._tile.shape[1]]

    def _plane(self, values: F64, site: NDArray[np.int64]) -> F64:
        """Return the pattern of a site of the tile, without shading and without that of whole rows and columns."""
        plane = self._site(values, site)
        plane = plane - _box_means(plane)
        plane -= plane.mean(axis=1, keepdims=True)
        return np.asarray(plane - plane.mean(axis=0))


def _box_means(plane: F64) -> F64:
    """Return the means of squares around all pixels; pixels beyond the sides are those at the sides."""
    found = np.pad(plane, _BOX // 2, mode="edge")
    for step in (1, 3):  # sums of three pixels, and then of three of these sums
        found = found[: -2 * step] + found[step:-step] + found[2 * step :]
        found = found[:, : -2 * step] + found[:, step:-step] + found[:, 2 * step :]
    found /= _BOX**2
    return found


def _spread(plane: F64) -> float:
    """Return the standard deviation by the median of the absolute values."""
    step = max(plane.size // _SAMPLES, 1) | 1  # odd: of all columns
    values = np.abs(plane.ravel()[::step])
    middle = [(values.size - 1) // 2, values.size // 2]
    return 1.4826 * float(np.partition(values, middle)[middle].mean())  # NumPy's median takes longer


@dataclass(frozen=True)
class _Moments:
    """Sums over pixels for the regression of flat fields on a noisy pattern: the coefficient is 1 + rest / true."""

    pixels: int
    true: float  # square of the pattern without its noise, times the factor
    noise: float  # square of the noise, times the factor
    rest: float  # product of what the pattern does not explain with the pattern
    square: float  # square of this product

    @classmethod
    def of(cls, flat: F64, pattern: F64, factor: float, noise: float) -> _Moments:
        spread = _spread(pattern)
        near = np.abs(pattern) <= _FAR * spread
        own = pattern[near]
        left = noise * (1.0 - 1.0 / _BOX**2) * own.size * factor
        product = (flat[near] - factor * own) * own
        rest, square = float(product.sum()) + left, float((product * product).sum())
        return cls(own.size, factor * float(own @ own) - left, left, rest, square)


def _agreement(moments: Sequence[_Moments]) -> Agreement | None:
    """Return the coefficient over all planes, or None where the pattern is far below its noise."""
    true, noise = (math.fsum(getattr(entry, name) for entry in moments) for name in ("true", "noise"))
    if sum(entry.pixels for entry in moments) < 1000 or MOST_NOISE * abs(true) < abs(noise) or true == 0.0:
        return None
    rest, square = (math.fsum(getattr(entry, name) for entry in moments) for name in ("rest", "square"))
    return Agreement(1.0 + rest / true, math.sqrt(square) / abs(true))


WARMTH = 1.0
"""Standard deviation of the dark current of flat fields over that of dark frames before the patterns are seen."""

_NEAR = 3.0
"""Dark slopes up to this many standard deviations count with their square, farther ones with that of the limit."""


@dataclass(frozen=True)
class _RatePlane:
    """Patterns of dark slopes and of the slopes of flat fields over the light, for the pixels of a site of the tile."""

    dark: F64
    flat: F64
    skew: F64  # function of the dark slopes that has no covariance with normal numbers in them
    noise: float  # variance of the noise of the dark slopes
    seconds: float  # exposure time for each unit of light; 0 where it is the same for all light
    rate: float  # mean dark slope
    light: float  # mean slope of the flat fields without the dark current

    @classmethod
    def of(cls, dark: F64, flat: F64, noise: float, seconds: float, rate: float, slope: float) -> _RatePlane:
        spread = _spread(dark)
        near = np.abs(dark) <= _FAR * spread
        dark, flat = (each[near] - each[near].mean() for each in (dark, flat))
        inside = np.abs(dark) < _NEAR * spread
        square = np.minimum(dark**2, (_NEAR * spread) ** 2)
        skew = square - square.mean() - float(np.where(inside, 2.0 * dark, 0.0).mean()) * dark
        left = noise * (1.0 - 1.0 / _BOX**2)
        return cls(dark, flat, skew / max(spread**2, 1e-300), left, seconds, rate, slope - seconds * rate)

    def moments(self) -> _Moments:
        """Return the sums for the regression of the flat fields on the dark slopes."""
        size, factor = self.dark.size, self.seconds
        left = self.noise * size * factor
        product = (self.flat - factor * self.dark) * self.dark
        rest, square = float(product.sum()) + left, float((product * product).sum())
        return _Moments(size, factor * float(self.dark @ self.dark) - left, left, rest, square)


def _leak(planes: Sequence[_RatePlane]) -> Leak | None:
    """Return the light in the dark frames, with the same ratio to that of the flat fields in all channels."""
    if sum(plane.dark.size for plane in planes) < 1000 or min(plane.light for plane in planes) <= 0.0:
        return None
    # In units of light in which all channels respond alike: flat fields (1 - w l) r + w d, dark slopes d + l r.
    scales = [(plane.seconds or 1.0) / plane.light for plane in planes]
    flats = [plane.flat / plane.light for plane in planes]
    darks = [plane.dark * scale for plane, scale in zip(planes, scales, strict=True)]
    weights = [1.0 / max(float(flat @ flat) / flat.size, 1e-300) for flat in flats]
    noise = sum(
        w * plane.noise * scale**2 * plane.dark.size for w, plane, scale in zip(weights, planes, scales, strict=True)
    )
    pattern = sum(w * float(dark @ dark) for w, dark in zip(weights, darks, strict=True)) - noise
    skews = [w * plane.skew for w, plane in zip(weights, planes, strict=True)]
    shared = sum(float(skew @ dark) for skew, dark in zip(skews, darks, strict=True))
    warmth, pull, unknown = 0.0, 0.0, 0.0  # flat fields of one exposure time have no dark current in their slopes
    seen = None
    if planes[0].seconds:
        if shared == 0.0:
            return None
        own = sum(float(skew @ flat) for skew, flat in zip(skews, flats, strict=True)) / shared
        of_skew = ((flat - own * dark) * skew for flat, dark, skew in zip(flats, darks, skews, strict=True))
        seen = Uncertain.of(own, math.sqrt(sum(float(one @ one) for one in of_skew)) / abs(shared))
        known = 1.0 / (1.0 + (seen.standard_uncertainty / WARMTH) ** 2)
        warmth, pull, unknown = 1.0 + known * (own - 1.0), known * pattern / shared, (1.0 - known) * WARMTH * pattern
    rests = [flat - warmth * dark for flat, dark in zip(flats, darks, strict=True)]
    common = sum(w * float(rest @ dark) for w, rest, dark in zip(weights, rests, darks, strict=True)) + warmth * noise
    own = sum(w * float(rest @ rest) for w, rest in zip(weights, rests, strict=True)) - warmth**2 * noise
    each = [rest * (w * dark - pull * skew) for w, rest, dark, skew in zip(weights, rests, darks, skews, strict=True)]
    if own <= 0.0:
        return None
    ratio, spread = common / own, math.sqrt(unknown**2 + sum(float(one @ one) for one in each)) / own
    change = 1.0 / (1.0 + warmth * ratio)
    over_rate = sum(1.0 / scale for scale in scales) / sum(plane.rate for plane in planes)
    return Leak(Uncertain.of(ratio * change * over_rate, spread * change**2 * abs(over_rate)), seen)
