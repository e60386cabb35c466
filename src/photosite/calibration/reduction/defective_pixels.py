"""Defective pixels, found before anything is estimated: hot, stuck, dead and noisy ones, columns and clusters.

A pixel is defective where its mean over a group of frames lies far from those of its color around it, or its temporal
variance in dark frames or flat fields far above that of the others. The limits follow the quantiles 10 to 90 % of each
color, so that a skewed distribution, as that of the dark current, has no defects. Every figure is then that of the
other pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.groups import GroupStatistics, reference_dark
from photosite.engine.frame_sums import FrameSums, LabelTotals, PixelVariances
from photosite.engine.outlying_pixels import Limits, Surface, distinct, fill_limits, outside, ranked
from photosite.engine.site_planes import plane_shape
from photosite.frames.frame_set import FrameSet
from photosite.frames.repaired_frames import PixelReplacement
from photosite.values.region import Region

MOST_DEFECTIVE = 0.03
"""Fraction of the pixels beyond which they are no few bad ones, but a part of the distribution: none is left out."""

MOST_WATCHED = 0.005
"""Fraction of the pixels whose numbers are kept while frames are read."""

FAR_SIGMA, REACH = 8.0, 1.5
"""Least distance in standard deviations by the quartiles, and in units of the distance that the farthest of all pixels
has where the distribution is normal or log-normal."""

LEVEL_RATIO = 2.5
"""Ratio of the levels of flat fields that are searched."""

NEAR, NEAR_NOISE = 0.75, 0.5
"""Distance and variance, relative to the limit, from which pixels show that the distribution goes on to the limit."""

LEAST_DN, LEAST_DN2 = 2.0, 2.0
"""Added to the limits: rounding alone makes the means, and the variances, of pixels differ by less."""

UNSATURATED = 0.7
"""Mean of flat fields over that of the largest variance, up to which full wells do not shape the distribution."""

DEAD_RESPONSE = 0.5
"""Relative response below which a pixel is dead."""

JUMPS = 4.0
"""Variance over that of read noise and shot noise from which numbers jump."""

NOISE_SPREAD = 2.0
"""Squared relative spread of the pixels' variances from which dark frames beside the reference are searched."""

FLAT_NOISE_SPREAD = 0.05
"""The same of flat fields, where it is more than that of uneven light: 1 of 2000 pixels with 10 times the variance."""

LEAST_SIDE = 4
"""Least rows and columns of a color."""

_BLOCK, _MOST_BLOCKS, _SAMPLES, _STEPS = 16, 16, 64, 4
_WINDOW, _NEIGHBORS, _CHUNK = 8, 96, 1 << 14
_NOISE_P_VALUE = 1e-4
_TENTH, _QUARTILES = 1.2815515655446004, 1.3489795003921634
_GROWTH_ERROR, _SPREAD_ERROR = 1.62, 1.37
"""Standard errors of the growth and of the spread by quantiles of n normal numbers of spread 1, times sqrt(n)."""

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


class BadPixel(IntEnum):
    """Kinds of defective pixels."""

    HOT = 0
    """Dark signal that grows with the exposure time, far beyond that of the others."""
    STUCK = 1
    """The same number in all frames."""
    OFFSET = 2
    """Dark level far from that of the others at all exposure times."""
    DEAD = 3
    """Less than half of the others' response to light."""
    RESPONSE = 4
    """Another response far from that of the others."""
    NOISY = 5
    """Noise far above that of the others, as of a pixel that blinks."""


@dataclass(frozen=True, eq=False)
class DefectivePixels:
    """Defective pixels, which are left out of all figures, with their own numbers.

    Parameters
    ----------
    index, kind
        (n,) number of the pixel in the order of the rows, and its `BadPixel`.
    shape
        Rows and columns of the frames.
    offset_dn, noise_dn2, offset_noise_dn2
        (n,) in the dark frames of the read noise: mean less that of the other pixels of the color, temporal variance,
        and the variance that it leaves in the mean. NaN where there are none.
    rate_dn_per_s
        (n,) growth of the dark signal with the exposure time, beyond that of the other pixels.
    response
        (n,) response to light, relative to that of the other pixels; NaN without flat fields.
    mean_dn
        (groups, n) mean in each group, of dark frames first.
    steady_dark
        (n,) whether a pixel is noisy in flat fields only.
    """

    index: _Ints
    kind: NDArray[np.uint8]
    shape: tuple[int, int]
    offset_dn: _Floats = field(repr=False)
    noise_dn2: _Floats = field(repr=False)
    offset_noise_dn2: _Floats = field(repr=False)
    rate_dn_per_s: _Floats = field(repr=False)
    response: _Floats = field(repr=False)
    mean_dn: _Floats = field(repr=False)
    steady_dark: NDArray[np.bool_] = field(repr=False)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def place(self) -> tuple[_Ints, _Ints]:
        """(n,) row and column."""
        row, col = np.divmod(self.index, self.shape[1])
        return row, col

    @property
    def fraction(self) -> float:
        """Fraction of the pixels."""
        return len(self) / (self.shape[0] * self.shape[1])

    def counts(self) -> Mapping[str, int]:
        """Return the number of pixels of each kind that occurs, by its name in lower case."""
        return {kind.name.lower(): n for kind in BadPixel if (n := int(np.count_nonzero(self.kind == kind)))}

    def of(self, kind: BadPixel) -> NDArray[np.bool_]:
        """Return (n,) whether a pixel is of a kind."""
        return np.asarray(self.kind == kind)


def classified(
    index: _Ints,
    shape: tuple[int, int],
    tile: _Ints,
    groups: Sequence[GroupStatistics],
    numbers: Sequence[NDArray[np.uint16]],
) -> DefectivePixels:
    """Return defective pixels with their kinds.

    Parameters
    ----------
    index, shape, tile
        Numbers of the pixels in the order of the rows; rows and columns of the frames; channels of the color filter
        array's tile.
    groups
        Statistics of the other pixels.
    numbers
        (frames, n) the numbers of these pixels in each group.
    """
    row, col = np.divmod(index, shape[1])
    channel = tile[row % tile.shape[0], col % tile.shape[1]]
    own = _OwnSeries(
        np.array([entry.group.exposure_s for entry in groups]),
        np.array([entry.frames for entry in groups]),
        np.array([entry.group.kind == "dark" for entry in groups]),
        np.array([values.mean(axis=0) for values in numbers]),
        np.array([_variance(values) for values in numbers]),
        *(
            np.array([[getattr(level, name) for level in entry.levels] for entry in groups])[:, channel]
            for name in ("mean", "variance", "spatial_variance")
        ),
    )
    offset, noise, reference = own.excess[own.reference], own.variance[own.reference], own.reference
    known = bool(own.dark[reference])
    return DefectivePixels(
        index,
        own.kinds(),
        shape,
        offset if known else np.full(len(index), np.nan),
        noise if known else np.full(len(index), np.nan),
        noise / own.frames[reference],
        own.rate,
        own.response,
        own.mean,
        own.lit_jumps & ~own.dark_jumps,
    )


@dataclass(frozen=True)
class _OwnSeries:
    """Means and variances of defective pixels in each group, and those of the other pixels: (groups, n) each."""

    time_s: _Floats
    frames: _Ints
    dark: NDArray[np.bool_]
    mean: _Floats
    variance: _Floats
    usual: _Floats
    usual_variance: _Floats
    spread: _Floats

    @cached_property
    def reference(self) -> int:
        """The dark group with the most frames, else the group of flat fields."""
        return max(range(len(self.frames)), key=lambda i: (self.dark[i], self.frames[i], -self.time_s[i]))

    @cached_property
    def darks(self) -> _Ints:
        """The dark groups by exposure time."""
        at = np.flatnonzero(self.dark)
        return at[np.argsort(self.time_s[at], kind="stable")]

    @cached_property
    def excess(self) -> _Floats:
        """Mean less that of the other pixels."""
        return self.mean - self.usual

    @cached_property
    def far(self) -> _Floats:
        """Excess that only defective pixels have."""
        return FAR_SIGMA * np.sqrt(self.spread) + LEAST_DN

    @cached_property
    def brightest(self) -> int | None:
        """The brightest flat fields well below saturation."""
        lit = np.flatnonzero(~self.dark)
        if not len(lit):
            return None
        known = np.where(np.isnan(self.usual_variance), -1.0, self.usual_variance).mean(axis=1)
        limit = UNSATURATED * self.usual[max(lit, key=lambda i: known[i])].mean()
        clear = [int(i) for i in lit if self.usual[i].mean() <= limit] or [int(min(lit, key=lambda i: self.time_s[i]))]
        return max(clear, key=lambda i: float(self.usual[i].mean()))

    @cached_property
    def response(self) -> _Floats:
        """Response relative to the other pixels."""
        if self.brightest is None:
            return np.full(self.mean.shape[1], np.nan)
        own, usual = (part[self.brightest] for part in (self.mean, self.usual))
        if len(self.darks):
            own, usual = own - self.mean[self.darks[0]], usual - self.usual[self.darks[0]]
        return np.asarray(own / np.maximum(usual, 1e-9))

    @cached_property
    def rate(self) -> _Floats:
        """Growth of the dark signal beyond that of the others: the largest, because pixels may saturate."""
        if len(self.darks) < 2:
            return np.full(self.mean.shape[1], np.nan)
        first, *longer = self.darks
        seconds = np.maximum(self.time_s[longer] - self.time_s[first], 1e-12)[:, None]
        rates = (self.excess[longer] - self.excess[first]) / seconds
        hot = np.where(self.excess[longer] > self.far[longer], rates, -np.inf).max(axis=0)
        return np.asarray(np.where(np.isfinite(hot), hot, rates[-1]))

    def kinds(self) -> NDArray[np.uint8]:
        """Return the kind of each pixel."""
        kind = np.full(self.mean.shape[1], BadPixel.NOISY, np.uint8)
        if self.brightest is not None:
            other = np.abs(self.excess[self.brightest]) > self.far[self.brightest]
            kind[other] = BadPixel.RESPONSE
            kind[other & (self.response < DEAD_RESPONSE)] = BadPixel.DEAD
        off, first = np.abs(self.excess[self.darks]), np.zeros(len(kind))
        beyond = (off > self.far[self.darks]).any(axis=0)
        if len(self.darks):
            kind[beyond] = BadPixel.OFFSET
            first = off[0]
            kind[beyond & (off.max(axis=0) > 2.0 * first + self.far[self.darks[0]])] = BadPixel.HOT
        kind[self.dark_jumps | self.lit_jumps] = BadPixel.NOISY
        still = np.ptp(self.mean, axis=0) <= LEAST_DN
        still &= ~(np.nan_to_num(self.variance).max(axis=0) > LEAST_DN2)
        kind[still & (beyond if len(self.darks) else True)] = BadPixel.STUCK
        return kind

    @cached_property
    def dark_jumps(self) -> NDArray[np.bool_]:
        """Whether dark numbers vary far more than by read noise, and by shot noise of the excess."""
        return self._jumps(self.reference, JUMPS)

    @cached_property
    def lit_jumps(self) -> NDArray[np.bool_]:
        """Whether numbers of flat fields vary far more than by their noise and by chance."""
        from scipy.special import chdtri

        found = np.zeros(self.mean.shape[1], np.bool_)
        if self.brightest is not None:
            for group in np.flatnonzero(~self.dark & (self.usual <= self.usual[self.brightest]).all(axis=1)):
                freedom = max(int(self.frames[group]) - 1, 1)
                found |= self._jumps(int(group), max(JUMPS, float(chdtri(freedom, _NOISE_P_VALUE)) / freedom))
        return found

    def _jumps(self, group: int, most: float) -> NDArray[np.bool_]:
        r = self.reference
        signal = np.maximum(self.usual - self.usual[r], 1.0)
        gain = max(float(np.nan_to_num((self.usual_variance - self.usual_variance[r]) / signal).max()), 0.0)
        explained = self.usual_variance[group] + gain * np.maximum(self.excess[group], 0.0)
        return np.asarray(self.variance[group] > most * explained + LEAST_DN2)


def _variance(values: NDArray[np.uint16]) -> _Floats:
    n = len(values)
    if n < 2:
        return np.full(values.shape[1], np.nan)
    return np.asarray(values.var(axis=0, ddof=1, dtype=np.float64))


class _Limits(NamedTuple):
    """Largest distances below and above the middle, and the distance of the quartiles."""

    below: float
    above: float
    quartiles: float


class GroupTotals(NamedTuple):
    """Exact totals of a group: of each channel, and (frames, channels) of each frame."""

    labels: tuple[LabelTotals, ...]
    frames: NDArray[np.uint64]


class PixelSurvey:
    """Search of the groups for defective pixels, while each is reduced.

    Searched are the dark frames of the read noise, the longest ones, and flat fields whose levels differ by a factor.
    """

    def __init__(self, frames: FrameSet, tile: _Ints) -> None:
        self.shape, self.tile = (frames.rows, frames.cols), tile
        self._parts = frames.amplifiers or (Region("all", 0, frames.rows, 0, frames.cols),)
        darks = frames.of_kind("dark")
        self._darks = {id(darks[reference_dark(darks)]), id(darks[-1])} if darks else set()
        self.clear()

    def clear(self) -> None:
        """Forget the groups."""
        self._suspects: list[tuple[GroupStatistics, _Ints]] = []
        self._all = np.zeros(0, np.int64)  # the suspects of all groups, in order
        self._noisy: list[_Ints] = []
        self._groups: list[GroupStatistics] = []
        self.totals: dict[int, GroupTotals] = {}
        self._black, self._last = math.inf, 0.0
        self._replaced: tuple[_Ints, PixelReplacement] | None = None

    def add(self, statistics: GroupStatistics, sums: FrameSums, totals: tuple[LabelTotals, ...]) -> bool:
        """Search the mean of a group, where it shows more than those before; return whether it has more `suspects`."""
        self._groups.append(statistics)
        self.totals[id(statistics.group)] = GroupTotals(totals, sums.label_frame_totals())
        level = statistics.levels[0].mean
        if statistics.group.kind == "dark":
            self._black = min(self._black, level)
            chosen = id(statistics.group) in self._darks
        else:
            signal = level - self._black if math.isfinite(self._black) else level
            chosen = not self._last / LEVEL_RATIO < signal < self._last * LEVEL_RATIO
            self._last = signal if chosen else self._last
        before = len(self.suspects())
        if chosen:
            total = sums.sum
            found = [*self._by_part(lambda part, tile: [_outliers(part, sums.count, tile)], total)]
            self._suspects.append((statistics, np.concatenate([np.zeros(0, np.int64), *found])))
            self._all = distinct(np.concatenate([self._all, self._suspects[-1][1]]))
        return len(self.suspects()) > before

    def _by_part(
        self, search: Callable[[NDArray[Any], _Ints], Iterable[_Ints]], values: NDArray[Any]
    ) -> Iterator[_Ints]:
        """Yield the numbers of the pixels that a search finds in the part of each amplifier, with its tile."""
        for part in self._parts:
            own = np.ascontiguousarray(values[part.r0 : part.r1, part.c0 : part.c1])
            for index in search(own, np.roll(self.tile, (-part.r0, -part.c0), (0, 1))):
                row, col = np.divmod(index, own.shape[1])
                yield (row + part.r0) * self.shape[1] + col + part.c0

    def suspects(self) -> _Ints:
        """Return the pixels found so far, if they are few: their numbers are then kept while frames are read."""
        return self._all[: len(self._all) if len(self._all) <= MOST_WATCHED * self.shape[0] * self.shape[1] else 0]

    def replacement(self, index: _Ints | None) -> PixelReplacement:
        """Return the replacement of pixels, given as numbers in order; the one before, if it is of the same pixels."""
        wanted = np.zeros(0, np.int64) if index is None else index
        if self._replaced is None or not np.array_equal(self._replaced[0], wanted):
            bad = np.zeros(self.shape, np.bool_)
            bad.flat[wanted] = True
            self._replaced = wanted, PixelReplacement.of(bad, self.tile.shape)
        return self._replaced[1]

    def add_noise(self, variances: PixelVariances, frames: int) -> bool:
        """Search the temporal variances of a group of so many frames, and return whether it has more."""
        before = np.concatenate([np.zeros(0, np.int64), *self._noisy])
        values, divisor = variances
        self._noisy += self._by_part(lambda part, tile: _noisy(PixelVariances(part, divisor), frames - 1, tile), values)
        return bool(np.setdiff1d(np.concatenate([before, *self._noisy]), before).size)

    @staticmethod
    def noise_differs(statistics: GroupStatistics, *, reference: bool) -> bool:
        """Return whether some pixels of dark frames may be far noisier than the others."""
        return _noise_spread(statistics) > (0.0 if reference else NOISE_SPREAD)

    def noisy_flats(self, lights: Sequence[GroupStatistics]) -> list[GroupStatistics]:
        """Return the flat fields in which some pixels are far noisier than the others, by how much."""
        noisy = [each for each in lights if _noise_spread(each) > FLAT_NOISE_SPREAD and self._clear(each)]
        return sorted(noisy, key=_noise_spread, reverse=True)

    def found(self) -> _Ints | None:
        """Return the defective pixels, as numbers in the order of the rows; None without any, or with too many."""
        chosen = [found for entry, found in self._suspects if entry.group.kind == "dark" or self._clear(entry)]
        index = distinct(np.concatenate([*chosen, *self._noisy, np.zeros(0, np.int64)]))
        return index if 0 < len(index) <= MOST_DEFECTIVE * self.shape[0] * self.shape[1] else None

    def _clear(self, entry: GroupStatistics) -> bool:
        """Return whether flat fields are well below saturation, in all channels."""
        lights = [other for other in self._groups if other.group.kind == "light"]
        for k, level in enumerate(entry.levels):
            others = [other.levels[k] for other in lights]
            noisiest = max(others, key=lambda each: -math.inf if math.isnan(each.variance) else each.variance)
            if level.mean > UNSATURATED * noisiest.mean:
                return False
        return True


def _noise_spread(statistics: GroupStatistics) -> float:
    """Return the squared relative spread of the pixels' variances beyond chance, of the channel where it is largest."""
    known = [level for level in statistics.levels if level.repeated and level.variance > 0.0]
    return max((each.variance_spread**2 * each.pixels / each.variance**2 for each in known), default=0.0)


def _sites(tile: _Ints) -> Iterator[tuple[int, int]]:
    return iter(np.ndindex(tile.shape[0], tile.shape[1]))


def _blocks(length: int) -> _Ints:
    """Return the limits of the blocks of a line."""
    count = min(max(length // _BLOCK, 1), _MOST_BLOCKS)
    return np.arange(count + 1) * length // count


def _block_samples(
    values: NDArray[np.generic], site: tuple[int, int], tile: _Ints, rows: _Ints, cols: _Ints
) -> NDArray[Any]:
    """Return (block rows, block columns, n) values of a site at random places of each block: more where these are few.

    Quantiles of 3000 values leave the limits of skewed distributions open by a tenth.
    """
    blocks = (len(rows) - 1) * (len(cols) - 1)
    count = min(_SAMPLES * _MOST_BLOCKS**2, int(rows[-1]) * int(cols[-1])) // blocks
    u, v = np.random.default_rng(1).random((2, max(count, _SAMPLES)))
    r = (rows[:-1, None] + np.floor(u * np.diff(rows)[:, None])).astype(np.int64)
    c = (cols[:-1, None] + np.floor(v * np.diff(cols)[:, None])).astype(np.int64)
    return np.asarray(values.reshape(-1)[_numbers(r[:, None], c[None], site, values.shape, tile)])


def _outliers(total: NDArray[np.unsignedinteger], count: int, tile: _Ints) -> _Ints:
    """Return the numbers of the pixels whose sum lies far from those around them; none if these are too many."""
    if min(length // period for length, period in zip(total.shape, tile.shape, strict=True)) < LEAST_SIDE:
        return np.zeros(0, np.int64)
    limits, parts = {}, []
    for site in _sites(tile):
        shape = plane_shape(total.shape, site, tile.shape)
        rows, cols = _blocks(shape[0]), _blocks(shape[1])
        samples = np.sort(
            _block_samples(total, site, tile, rows, cols), axis=2
        )  # integers: NumPy's median takes longer
        middle = _sorted_quantile(samples, 0.5)
        limits[site] = _limits((samples - middle[..., None]).ravel(), shape[0] * shape[1], LEAST_DN * count)
        centers = [np.asarray(0.5 * (ends[1:] + ends[:-1] - 1), np.float64) for ends in (rows, cols)]
        parts.append((site, middle, centers[0], centers[1]))
    row, col = outside(total, _pixel_limits(parts, limits, total, tile))
    if len(row) > MOST_DEFECTIVE * total.size:
        from scipy.ndimage import median_filter

        # A cluster that fills half of a block draws its middle away, and with it the surface of many other pixels
        without = [(site, median_filter(middle, 3, mode="nearest"), *centers) for site, middle, *centers in parts]
        row, col = outside(total, _pixel_limits(without, limits, total, tile))
    if len(row) > MOST_DEFECTIVE * total.size:
        return np.zeros(0, np.int64)
    found = [np.zeros(0, np.int64)]
    for site in _sites(tile):
        own = (row % tile.shape[0] == site[0]) & (col % tile.shape[1] == site[1])
        if own.any():
            suspects = row[own] // tile.shape[0], col[own] // tile.shape[1]
            found.append(_far_from_neighbors(total, site, tile, suspects, limits[site]))
    return np.concatenate(found)


def _pixel_limits(
    parts: Sequence[tuple[tuple[int, int], _Floats, _Floats, _Floats]],
    limits: Mapping[tuple[int, int], _Limits],
    total: NDArray[np.unsignedinteger],
    tile: _Ints,
) -> Limits:
    """Return the `NEAR` limits of each pixel, about the surface through the middles of the blocks of its site."""
    steps = _STEPS * len(parts[0][2])
    found = Limits(*np.empty((2, tile.shape[0], steps, total.shape[1]), total.dtype))
    for site, middle, of_rows, of_cols in parts:
        rows, _ = plane_shape(total.shape, site, tile.shape)
        at = np.interp((np.arange(steps) + 0.5) * rows / steps - 0.5, of_rows, np.arange(len(of_rows)))
        surface = Surface(middle, np.asarray(at, np.float64), of_cols)
        fill_limits(surface, NEAR * limits[site].below, NEAR * limits[site].above, site, tile.shape[1], found)
    return found


def _numbers(r: _Ints, c: _Ints, site: tuple[int, int], shape: tuple[int, ...], tile: _Ints) -> _Ints:
    """Return the numbers of pixels of a plane in the order of the rows of the frame."""
    return np.asarray((site[0] + tile.shape[0] * r) * shape[1] + site[1] + tile.shape[1] * c)


def _limits(residual: _Floats, pixels: int, least: float) -> _Limits:
    """Return the distances that only defective pixels reach."""
    from scipy.special import ndtri

    parts = 0.1, 0.25, 0.5, 0.75, 0.9
    places = np.floor(np.multiply(parts, len(residual) - 1)).astype(np.int64)
    ordered = np.partition(residual, sorted({*places.tolist(), *np.minimum(places + 1, len(residual) - 1).tolist()}))
    q10, q25, q50, q75, q90 = (float(_sorted_quantile(ordered, part)) for part in parts)
    last = float(-ndtri(0.1 / pixels))
    chance = _GROWTH_ERROR * math.sqrt(1.0 / len(residual) + 1.0 / pixels)

    def reach(side: float, other: float) -> float:
        skewed = 0.0
        # Growth of the logarithm per standard deviation: at most that of the quantiles and three standard errors
        if side > 0.0 and other > 0.0 and (growth := math.log(side / other) / _TENTH + 3.0 * chance) > 0.0:
            skewed = side * math.expm1(growth * last) / math.expm1(growth * _TENTH)
        return max(FAR_SIGMA * (q75 - q25) / _QUARTILES, REACH * max(side * last / _TENTH, skewed)) + least

    below, above = q50 - q10, q90 - q50
    return _Limits(reach(below, above) - q50, reach(above, below) + q50, q75 - q25)


def _window_ranks(
    values: NDArray[np.generic], site: tuple[int, int], tile: _Ints, r: _Ints, c: _Ints, ranks: Sequence[int]
) -> NDArray[Any]:
    """Return (ranks, n) values by rank of those at random places of the window about each pixel of a site.

    The window stays inside.
    """
    u, v = np.random.default_rng(2).random((2, _NEIGHBORS))
    places = []
    for at, fractions, length in zip((r, c), (u, v), plane_shape(values.shape, site, tile.shape), strict=True):
        size = min(2 * _WINDOW + 1, length)
        start = np.clip(at - size // 2, 0, length - size)
        places.append((start, np.floor(fractions * size).astype(np.int64)))
    (row, down), (col, right) = places
    first = _numbers(row, col, site, values.shape, tile)
    return ranked(values, first, _numbers(down, right, (0, 0), values.shape, tile), ranks)


def _far_from_neighbors(
    total: NDArray[np.unsignedinteger],
    site: tuple[int, int],
    tile: _Ints,
    suspects: tuple[_Ints, _Ints],
    limits: _Limits,
) -> _Ints:
    """Return the numbers of those of the pixels of a site that are far from the median of their neighbors.

    Where the neighbors differ more than elsewhere, as in a glow or the border of a shadow, the limits are wider.
    """
    distance = [np.zeros(0)]
    numbers = _numbers(*suspects, site, total.shape, tile)
    quartiles = [part * (_NEIGHBORS - 1) for part in (0.25, 0.5, 0.75)]
    ranks = [int(at) + k for at in quartiles for k in (0, 1)]
    for first in range(0, len(numbers), _CHUNK):
        part = slice(first, first + _CHUNK)
        around = _window_ranks(total, site, tile, suspects[0][part], suspects[1][part], ranks).astype(np.float64)
        q25, q50, q75 = (_between(around[2 * k], around[2 * k + 1], at % 1.0) for k, at in enumerate(quartiles))
        off = total.reshape(-1)[numbers[part]] - q50
        # The spread on the other side, which a cluster of defective pixels does not widen.
        spread = 2.0 * np.where(off > 0.0, q50 - q25, q75 - q50)
        wider = np.maximum(spread / limits.quartiles, 1.0) if limits.quartiles > 0.0 else 1.0
        distance.append(np.where(off > 0.0, off / limits.above, off / limits.below) / wider)
    found = np.concatenate(distance)
    return numbers[_apart(found, NEAR) | _apart(-found, NEAR)]


def _sorted_quantile(ordered: NDArray[Any], fraction: float) -> _Floats:
    """Return a quantile along the last axis, interpolated as by NumPy; sorting integers takes a tenth of its time."""
    last = ordered.shape[-1] - 1
    at = int(fraction * last)
    lower, upper = (ordered[..., min(i, last)].astype(np.float64) for i in (at, at + 1))
    return _between(lower, upper, fraction * last - at)


def _between(lower: _Floats, upper: _Floats, part: float) -> _Floats:
    return np.asarray(lower + part * (upper - lower) if part < 0.5 else upper - (1.0 - part) * (upper - lower))


def _apart(distance: _Floats, near: float) -> NDArray[np.bool_]:
    """Return which pixels are beyond the limit, at a distance of 1, and apart from those before it.

    Where the pixels between `near` times the limit and the limit outnumber those beyond, the distribution goes on
    beyond the limit, which is then moved outwards.
    """
    limit = 1.0
    while np.count_nonzero((distance > near * limit) & (distance <= limit)) > np.count_nonzero(distance > limit):
        limit /= near
    return np.asarray(distance > limit)


def _noisy(variances: PixelVariances, freedom: int, tile: _Ints) -> Iterator[_Ints]:
    """Yield the numbers of the pixels whose temporal variance is far above the others', by site."""
    from scipy.special import chdtri, ndtri

    values, divisor = variances
    limits, middle_ranks = {}, (_NEIGHBORS // 2 - 1, _NEIGHBORS // 2)
    for site in _sites(tile):
        shape = plane_shape(values.shape, site, tile.shape)
        if min(shape) < LEAST_SIDE:
            continue
        size = shape[0] * shape[1]
        samples = _block_samples(values, site, tile, _blocks(shape[0]), _blocks(shape[1])).ravel() / divisor
        q50, q90 = np.quantile(samples, [0.5, 0.9])
        # The quantiles of equal pixels, in units of the median: chi-square over the degrees of freedom
        middle, tenth, last = (float(chdtri(freedom, p)) for p in (0.5, 0.1, _NOISE_P_VALUE / size))
        spread = max(math.log(q90 / q50 * middle / tenth), 0.0) / _TENTH if q50 > 0.0 else 0.0
        chance = (
            _SPREAD_ERROR * math.hypot(spread, math.sqrt(2.0 / freedom)) * math.sqrt(1.0 / len(samples) + 1.0 / size)
        )
        spread += 3.0 * chance
        usual = float(samples[samples <= q90].mean())
        factor = REACH * last / middle * math.exp(spread * float(-ndtri(0.1 / size)))
        limits[site] = max(float(q50), usual) * factor + LEAST_DN2, float(q50), size
    if not limits:
        return
    lowest = NEAR_NOISE * min(limit for limit, _, _ in limits.values())
    # Whole numbers are compared as such; those at the limit are compared below
    least = values.dtype.type(max(lowest * divisor - 2.0, 0.0) if divisor > 1.0 else lowest)
    near = np.flatnonzero(values > least)
    row, col = np.divmod(near, values.shape[1])
    found = values.reshape(-1)[near] / divisor
    for site, (limit, q50, size) in limits.items():
        own = (row % tile.shape[0] == site[0]) & (col % tile.shape[1] == site[1]) & (found > NEAR_NOISE * limit)
        r, c = row[own] // tile.shape[0], col[own] // tile.shape[1]
        if len(r) > MOST_DEFECTIVE * size:
            continue
        parts = [slice(first, first + _CHUNK) for first in range(0, len(r), _CHUNK)]
        around = np.concatenate(
            [
                np.zeros(0),
                *((_window_ranks(values, site, tile, r[p], c[p], middle_ranks) / divisor).mean(axis=0) for p in parts),
            ]
        )
        wider = np.maximum(around / q50, 1.0) if q50 > 0.0 else 1.0
        yield near[own][_apart(found[own] / (wider * limit), NEAR_NOISE)]


def in_words(counts: Mapping[str, int]) -> str:
    """Return the numbers of each kind as text.

    Examples
    --------
    >>> in_words({"hot": 60, "dead": 1})
    '60 hot, 1 dead'
    """
    names = {"offset": "with another offset", "response": "with another response"}
    return ", ".join(f"{n} {names.get(kind, kind)}" for kind, n in counts.items())
