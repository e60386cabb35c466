"""Regular structure of mean frames: a mosaic not stated, its wrong phase, unequal readout channels, and taps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from photosite.engine.lazy_maps import Map, row_strips
from photosite.values.cfa import NAMED, channel_names
from photosite.values.diagnostic import DiagnosticKind, one_in
from photosite.values.uncertain import NORMAL_MAD

Array = NDArray[np.float64]

PERIODS = (1, 2, 4, 6)
"""Periods of color filter arrays: none; Bayer; 2 x 2 pixels of one color; X-Trans."""

CELL = 12
"""Rows and columns of the cell that all periods divide."""


class LeastDifference(NamedTuple):
    """Difference between places of a period, and step between taps, below which nothing is reported."""

    period: float
    step: float


LEAST_DIFFERENCE = MappingProxyType(
    {"flat": LeastDifference(period=0.002, step=0.002), "dark": LeastDifference(period=0.1, step=0.2)}
)
"""Relative to the signal in flat fields; in standard deviations of the pixels in dark frames."""

PERIOD_P_VALUE = 1e-4
"""Fraction of mean frames without a period in which one of the places may deviate beyond chance."""


UNSTATED_MOSAIC = DiagnosticKind(
    "unstated-mosaic",
    "warning",
    "The flat fields differ with the period of a color filter array that is not stated, or wrongly stated.",
    "Figures of the light that compare pixels are withheld or wrong, because pixels of several colors are one channel.",
    "State the color filter array (--cfa).",
    ("prnu*", "shading_percent", "column_gain_percent"),
    "difference between the places of the period as a fraction of the signal",
    f"below {one_in(PERIOD_P_VALUE)} sets",
)


MOSAIC_FRACTION = 0.02
"""Difference between places of a period, as a fraction of the signal, above which they do not belong to one channel.

The two greens of a Bayer mosaic and the readout channels of a chip differ by less.
"""
FILTER_FRACTION = 0.1
"""Difference above which rows or columns belong to a striped color filter array: readout channels differ by less."""
SAME_CHANNEL = 0.15
"""Largest difference within a channel of a tile that fits, as a fraction of the whole difference."""


@dataclass(frozen=True)
class PeriodicStructure:
    """Signal of a flat at the places of a period, relative to the mean of the channel; or level of a dark frame.

    Parameters
    ----------
    relative
        (period, period) signal over that of the channel's mean, 1 where the pixels respond alike. In dark frames, the
        level less the mean of all places, DN.
    chance
        Deviation of one place that chance explains.
    uncertainty
        Standard uncertainty of one row or column, where only these differ.
    dark
        Whether the frames are dark frames.
    separable
        Which of columns and rows can be distinguished: those in which every channel has as many pixels in each place
        of the period. In a Bayer mosaic neither: red lies in every second column and row only, and the two greens
        differ in both.
    """

    relative: NDArray[np.float64]
    chance: float
    uncertainty: float = 0.0
    dark: bool = False
    separable: tuple[str, ...] = ("columns", "rows")

    @property
    def period(self) -> int:
        """Period in rows and columns."""
        return int(self.relative.shape[0])

    @property
    def difference(self) -> float:
        """Difference between the highest and the lowest place, as a fraction of the signal or in DN."""
        return float(self.relative.max() - self.relative.min())

    @property
    def by_lines(self) -> str:
        """Return "rows" or "columns" where only these differ, as readout channels do; "" otherwise."""
        for name, axis in (("columns", 0), ("rows", 1)):
            if name not in self.separable:
                continue
            means = self.relative.mean(axis=axis, keepdims=True)
            if np.abs(self.relative - means).max() < max(0.1 * self.difference, self.chance):
                return name
        return ""

    def is_mosaic(self) -> bool:
        """Return whether the structure is that of a mosaic whose channels are not stated, or not as they are."""
        return self.difference > (FILTER_FRACTION if self.by_lines else MOSAIC_FRACTION)

    @property
    def channel_table(self) -> NDArray[np.float64]:
        """The values as a table of readout channels: one row where only columns differ, one column where only rows."""
        axis = {"columns": 0, "rows": 1}.get(self.by_lines)
        return self.relative if axis is None else self.relative.mean(axis=axis, keepdims=True)

    def __str__(self) -> str:
        if self.dark:
            return (
                f"the dark frames differ by {self.difference:.2g} DN with a period of {self.period} "
                f"{self.by_lines or 'pixels'}, as with readout channels of different offset; DSNU includes this "
                f"difference"
            )
        percent = f"{100.0 * self.difference:.2g} %"
        if not self.is_mosaic() and not self.separable:
            return (
                f"the pixels of one color differ by {percent} in the flat fields, with a period of {self.period} "
                f"pixels, as with readout channels of alternating rows or columns, or with light from neighbors of "
                f"other colors: this mosaic does not tell which; PRNU includes this difference"
            )
        if not self.is_mosaic():
            filters = " or a striped color filter array that is not stated" * (self.difference > MOSAIC_FRACTION)
            return (
                f"the flat fields differ by {percent} with a period of {self.period} {self.by_lines or 'pixels'}, "
                f"as with readout channels of different gain{filters}; PRNU includes this difference"
            )
        fitting = self.bayer_patterns() or self.tiles()
        likely = f"; {' or '.join(fitting)} fits" if fitting else ""
        return (
            f"the flat fields repeat every {self.period} {self.by_lines or 'rows and columns'}, by {percent} of the "
            f"signal, within what is stated as one channel, as with a color filter array that is not stated or has "
            f"another phase{likely}{'' if self.separable else '; or with readout channels of very different gain'}"
        )

    def tiles(self) -> tuple[str, ...]:
        """Return the names of the known tiles of this period that fit in some phase, those with the fewest channels.

        In a tile that fits, the places of a channel differ by little of the whole difference.

        Examples
        --------
        >>> signal = {"R": 0.5, "G": 1.0, "B": 0.6}
        >>> PeriodicStructure(np.array([[signal[name] for name in row] for row in NAMED["x-trans"]]), 0.01).tiles()
        ('x-trans',)
        """
        allowed = max(SAME_CHANNEL * self.difference, 2.0 * self.chance)
        fitting: dict[str, int] = {}
        for name, cfa in NAMED.items():
            names = channel_names(cfa)
            if len(cfa) != self.period or len(cfa[0]) != self.period or "P0" in names:
                continue
            tile = np.array([[names.index(channel) for channel in row] for row in cfa])
            for shift in np.ndindex(tile.shape):
                shifted = np.roll(tile, shift, axis=(0, 1))
                if all(np.ptp(self.relative[shifted == k]) < allowed for k in range(len(names))):
                    fitting[name] = len(names)
        return tuple(name for name, channels in fitting.items() if channels == min(fitting.values()))

    def bayer_patterns(self) -> tuple[str, ...]:
        """Return the Bayer patterns that fit: the greens lie on the diagonal whose two places are most alike."""
        if self.period != 2:
            return ()
        (a, b), (c, d) = self.relative.tolist()
        return ("GRBG", "GBRG") if abs(a - d) < abs(b - c) else ("RGGB", "BGGR")


def _fold(places: NDArray[np.float64], period: int) -> NDArray[np.float64]:
    """Return the means (..., period, period) of the places (..., cell, cell) of a period."""
    folds = CELL // period
    return np.asarray(places.reshape(-1, folds, period, folds, period).mean(axis=(1, 3)))


_MEDIAN_VARIANCE = math.pi / 2.0
"""Variance of a median over that of a mean, for normal noise."""


def _line_uncertainty(across: Array, along: Array, period: int, lines: str) -> float:
    """Return the standard uncertainty of the rows or columns of a period, relative to their mean.

    Parts of the frame `across` the lines, (blocks, cell, cell), contain different lines each, with their own patterns;
    those `along` them the same lines, of which only the pixels differ.
    """
    axis = -2 if lines == "columns" else -1
    variances = []
    for blocks in (across, along):
        line_means = _fold(blocks, period).mean(axis=axis)
        line_means = line_means - line_means.mean(axis=-1, keepdims=True)
        variances.append(float(line_means.var(axis=0, ddof=1).mean()) / len(blocks))
    whole, pixel_part = variances
    # The median over the cells is a mean of medians for the noise of pixels, and a median for the patterns of lines.
    return math.sqrt(pixel_part + _MEDIAN_VARIANCE * max(whole - pixel_part, 0.0))


def _chance(blocks: Sequence[NDArray[np.float64]], period: int) -> float:
    """Return how far a place of a period may deviate by chance, from (blocks, cell, cell) places of parts of a frame.

    The blocks are whole columns and whole rows of cells. They contain the patterns of columns and rows of a chip, which
    all cells of a block share.
    """
    variance = [_fold(places, period).var(axis=0, ddof=1).mean() / len(places) for places in blocks]
    freedom = period * (min(len(places) for places in blocks) - 1)
    uncertainty = math.sqrt(_MEDIAN_VARIANCE * sum(variance))
    return uncertainty * -float(stdtrit(freedom, PERIOD_P_VALUE / (2.0 * period**2)))


def periodic_structure(flat: Map, dark: Map, tile: NDArray[np.int64]) -> PeriodicStructure | None:
    """Return the periodic structure of the pixels of one channel, the most different one; None within chance.

    Parameters
    ----------
    flat, dark
        (rows, cols) mean frames, DN.
    tile
        The repeating tile of channel indices, as stated.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> flat = 1000.0 + rng.normal(0.0, 10.0, (96, 96))
    >>> mono = np.zeros((1, 1), np.int64)
    >>> periodic_structure(flat, 0.0 * flat, mono) is None
    True
    >>> flat[::2, ::2] *= 0.6
    >>> flat[1::2, 1::2] *= 0.7
    >>> found = periodic_structure(flat, 0.0 * flat, mono)
    >>> found.relative.round(1).tolist(), found.bayer_patterns()
    ([[0.7, 1.2], [1.2, 0.8]], ('RGGB', 'BGGR'))
    """
    return _periodic(flat, tile, dark)


def periodic_offsets(dark: Map) -> PeriodicStructure | None:
    """Return the periodic structure of a (rows, cols) mean dark frame, DN; None within chance.

    Examples
    --------
    >>> dark = np.random.default_rng(1).normal(64.0, 1.0, (96, 96))
    >>> periodic_offsets(dark) is None
    True
    >>> dark[:, ::2] += 2.0
    >>> periodic_offsets(dark).channel_table.round(1).tolist()
    [[1.0, -1.0]]
    """
    return _periodic(dark, np.zeros((1, 1), np.int64))


LEAST_CELLS = 16
"""Cells below which a frame is too small to show a period."""
MOST_CELLS = 64
"""Cells along each side of the frame that are compared, evenly spaced."""
LEAST_LIGHT = 0.1
"""Fraction of the usual signal below which a cell counts as not lit: covered pixels, corners that no light reaches."""


def _periodic(mean: Map, tile: NDArray[np.int64], subtracted: Map | None = None) -> PeriodicStructure | None:
    """Return the periodic structure of a mean frame: a flat field less the dark that is subtracted, or a dark frame."""
    dark = subtracted is None
    rows, cols = (length // CELL for length in mean.shape)
    if rows * cols < LEAST_CELLS or min(rows, cols) < 2 or CELL % tile.shape[0] or CELL % tile.shape[1]:
        return None
    # The median of the cells keeps defects and shading from standing out as a period.
    cells = _cells(mean)
    if subtracted is not None:
        cells = cells - _cells(subtracted)
    step_rows, step_cols = (-(-count // MOST_CELLS) for count in (rows, cols))
    cells = np.ascontiguousarray(cells)
    # Leave out rows and columns of cells with parts that no light reached.
    level = _medians(cells.reshape(*cells.shape[:2], -1))
    lit = dark | (level > LEAST_LIGHT * np.median(level))
    lit_cols = lit.mean(axis=0) > 0.5
    lit_rows = lit[:, lit_cols].all(axis=1)
    cells, level = cells[lit_rows][:, lit_cols], level[lit_rows][:, lit_cols]
    if lit_rows.sum() * lit_cols.sum() < LEAST_CELLS or min(cells.shape[:2]) < 2:
        return None
    labels = np.tile(tile, (CELL // tile.shape[0], CELL // tile.shape[1]))
    # Shading tilts all cells alike.
    unit = 1.0 if dark else level
    tilt = [np.gradient(level, axis=axis) / unit / (CELL * step) for axis, step in enumerate((step_rows, step_cols))]
    away = np.arange(CELL) - 0.5 * (CELL - 1)
    ramp = tilt[0][..., None, None] * away[:, None] + tilt[1][..., None, None] * away
    places = _places(cells, labels, ramp, np.zeros_like(labels), dark=dark)
    if places is None:
        return None
    relative, by_rows, by_cols = places
    chance = {period: _chance((by_rows, by_cols), period) for period in (*PERIODS[1:], CELL)}
    for period in PERIODS:
        folded = _fold(relative, period)[0]
        rest = relative - np.tile(folded, (CELL // period, CELL // period))
        found = PeriodicStructure(folded, chance.get(period, 0.0), dark=dark, separable=_separable(labels, period))
        limits = {longer: max(limit, 0.1 * found.difference) for longer, limit in chance.items()}
        if all(np.abs(_fold(rest, longer)).max() < limit for longer, limit in limits.items()):
            least = LEAST_DIFFERENCE["dark" if dark else "flat"].period
            if dark:
                least = least * NORMAL_MAD * float(np.median(np.abs(cells - level[..., None, None])))
            negligible = found.difference == 0.0 or found.difference <= least
            return None if negligible else _with_lines(found, cells, labels, ramp)
    return None


def _cells(mean: Map) -> Array:
    """Return (cell rows, cell cols, CELL, CELL) evenly spaced cells of a map."""
    rows, cols = (length // CELL for length in mean.shape)
    step = -(-cols // MOST_CELLS)
    chosen = range(0, rows, -(-rows // MOST_CELLS))
    found = np.empty((len(chosen), -(-cols // step), CELL, CELL))
    for cells, row in zip(found, chosen, strict=True):
        lines = mean[row * CELL : (row + 1) * CELL, : cols * CELL]
        cells[:] = lines.reshape(CELL, cols, CELL).swapaxes(0, 1)[::step]
    return found


def _medians(values: Array, axis: int = -1) -> Array:
    """Return the medians along an axis of few values, for which sorting takes a fourth of the time of `np.median`."""
    ordered = np.sort(np.moveaxis(values, axis, -1), axis=-1)
    middle = values.shape[axis] // 2
    return np.asarray(0.5 * (ordered[..., middle - 1 + values.shape[axis] % 2] + ordered[..., middle]))


def _separable(labels: NDArray[np.int64], period: int) -> tuple[str, ...]:
    """Return which of columns and rows have as many pixels of every channel in each place of the period."""
    found = []
    for axis, name in enumerate(("columns", "rows")):
        channels = [(labels == k).sum(axis=axis) for k in np.unique(labels)]
        if all(np.ptp(counts.reshape(-1, period).sum(axis=0)) == 0 for counts in channels):
            found.append(name)
    return tuple(found)


def _places(
    cells: Array, labels: NDArray[np.int64], ramp: Array, phase: NDArray[np.int64], *, dark: bool
) -> list[Array] | None:
    """Return the signal at the places of a cell over that of the channel, and those of rows and columns of cells.

    In dark frames it is the level less that of the cell.

    The signal of the channel in a cell is the mean of the medians of its places of each `phase`: a single median lies
    between phases of different signal and follows the values above and below, which makes them more alike.
    None where a channel has no light.
    """
    found = [np.empty((*size, CELL, CELL)) for size in ((), cells.shape[:1], cells.shape[1:2])]
    for channel in range(int(labels.max()) + 1):
        inside = labels == channel
        medians = [_medians(cells[:, :, inside & (phase == k)]) for k in np.unique(phase[inside])]
        usual = np.mean(medians, axis=0)[..., None]
        if not (dark or (usual > 0.0).all()):
            return None
        values = cells[:, :, inside]
        scaled = (values - usual if dark else values / usual) - ramp[:, :, inside]
        place = np.median(scaled, axis=(0, 1))
        found[0][inside] = place - place.mean() if dark else place / place.mean()
        found[1][:, inside], found[2][:, inside] = _medians(scaled, axis=1), _medians(scaled, axis=0)
    return found


def _with_lines(found: PeriodicStructure, cells: Array, labels: NDArray[np.int64], ramp: Array) -> PeriodicStructure:
    """Return the structure with the exact signal of rows or columns and its uncertainty, where only these differ."""
    if not (lines := found.by_lines):
        return found
    phase = np.broadcast_to(np.arange(CELL) % found.period, (CELL, CELL))
    places = _places(cells, labels, ramp, phase if lines == "columns" else phase.T, dark=found.dark)
    if places is None:
        return found
    relative, by_rows, by_cols = places
    parts = (by_cols, by_rows) if lines == "columns" else (by_rows, by_cols)
    uncertainty = _line_uncertainty(*parts, found.period, lines)
    return replace(found, relative=_fold(relative, found.period)[0], uncertainty=uncertainty)


_SIDES = ("top", "bottom"), ("left", "right")


@dataclass(frozen=True)
class Taps:
    """Levels of the taps: of the quadrants of a frame, less their mean.

    Parameters
    ----------
    level
        (2, 2) level of top left, top right, bottom left, bottom right: relative to the signal in flat fields, in DN in
        dark frames.
    uncertainty
        Standard uncertainty of a step between two of them.
    dark
        Whether the frames are dark frames.
    """

    level: Array
    uncertainty: float
    dark: bool

    @property
    def step(self) -> float:
        """Difference between the highest and the lowest tap."""
        return float(self.level.max() - self.level.min())

    @property
    def named(self) -> dict[str, float]:
        """Level of each tap by its place: two halves, where the quadrants of each are alike, or four quadrants."""
        for axis in (0, 1):
            across = self.level - self.level.mean(axis=1 - axis, keepdims=True)
            if np.abs(across).max() < max(0.1 * self.step, 2.0 * self.uncertainty):
                return dict(zip(_SIDES[axis], self.level.mean(axis=1 - axis).tolist(), strict=True))
        return {f"{r} {c}": float(self.level[i, j]) for i, r in enumerate(_SIDES[0]) for j, c in enumerate(_SIDES[1])}

    def __str__(self) -> str:
        scale, unit = (1.0, " DN") if self.dark else (100.0, " %")
        each = ", ".join(f"{name} {scale * level:+.2g}{unit}" for name, level in self.named.items())
        parts = "halves" if len(self.named) == 2 else "quadrants"
        frames, cause, result = ("dark frames", "offset", "DSNU") if self.dark else ("flat fields", "gain", "PRNU")
        return (
            f"the {frames} step by {scale * self.step:.2g}{unit} between {parts} of the sensor ({each}), as with taps "
            f"of different {cause}; {result} includes this step"
        )


NARROWEST, WIDEST = 8, 64
"""Lines at each side of a step that show it, at least and at most; an eighth of the frame between."""


def find_taps(mean: Map | None, *, dark: bool = False) -> Taps | None:
    """Return the levels of the taps; None where there is no step at half the width or height beyond chance.

    The step is that between two straight lines through the means of lines on both sides, extrapolated to the middle, in
    each half of the frame. It is compared with its uncertainty, from the scatter about these lines, and with the steps
    at other places.

    Parameters
    ----------
    mean
        (rows, cols) mean over the sites of the color filter array: of a mean flat field less the dark, each site over
        its mean; or of a mean `dark` frame. None where a site has no light.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> flat = 1.0 + 0.01 * rng.normal(size=(96, 128))
    >>> find_taps(flat) is None
    True
    >>> flat[:, 64:] += 0.02
    >>> {name: round(level, 2) for name, level in find_taps(flat).named.items()}
    {'left': -0.01, 'right': 0.01}
    """
    if mean is None:
        return None
    rows, cols = mean.shape
    if min(rows, cols) < 6 * NARROWEST:
        return None
    found = [_middle_step(profile) for profile in _half_profiles(mean)]
    steps, uncertainty = np.array([step for step, _, _ in found]), max(u for _, u, _ in found)
    if not any(beyond for _, _, beyond in found):
        return None
    # Right less left at top and bottom, bottom less top at left and right; the mean is 0.
    design = np.array([[-1, 1, 0, 0], [0, 0, -1, 1], [-1, 0, 1, 0], [0, -1, 0, 1], [1, 1, 1, 1]], dtype=np.float64)
    level = np.linalg.lstsq(design, np.append(steps, 0.0), rcond=None)[0].reshape(2, 2)
    taps = Taps(level, uncertainty, dark)
    least = LEAST_DIFFERENCE["dark"].step * _spread(mean) if dark else LEAST_DIFFERENCE["flat"].step
    return taps if taps.step > least else None


def _half_profiles(mean: Map) -> tuple[Array, ...]:
    """Return the profiles of the top, bottom, left and right half of a map: means over the lines of each."""
    rows, cols = mean.shape
    down, across = rows // 2, cols // 2
    sides = np.empty((2, rows))
    found = []
    for first, last in ((0, down), (down, rows)):
        total: Array | None = None
        for start, end in row_strips(mean, rows=slice(first, last)):
            lines = slice(start, end)
            part = mean[lines]
            total = (part if total is None else np.vstack([total[None], part])).sum(axis=0)
            sides[0, lines], sides[1, lines] = part[:, :across].T.mean(axis=0), part[:, across:].T.mean(axis=0)
        assert total is not None  # the halves have rows
        found.append(total / (last - first))
    return (*found, *sides)


def _spread(values: Map) -> float:
    """Return the standard deviation over the pixels of a map."""
    strips, pixels = list(row_strips(values)), values.shape[0] * values.shape[1]
    center = sum(float(values[first:last].sum()) for first, last in strips) / pixels
    return math.sqrt(sum(float(((values[first:last] - center) ** 2).sum()) for first, last in strips) / pixels)


TAPS_P_VALUE = 1e-4
"""Fraction of mean frames without a step in which one may be reported."""
STEP_RATIO = 2.0
"""Factor by which a step must exceed all steps elsewhere, which shading, dust or single lines make."""


def _middle_step(profile: Array) -> tuple[float, float, bool]:
    """Return the step in the middle of a profile, its standard uncertainty, and whether it is beyond chance."""
    n = min(max(len(profile) // 8, NARROWEST), WIDEST)
    design = np.stack([np.ones(n), np.arange(n) + 0.5], axis=1)
    estimator = np.linalg.pinv(design)
    lines = np.lib.stride_tricks.sliding_window_view(profile, n)
    after, before = lines[n:], lines[:-n, ::-1]  # of each place with n values on both sides
    ends, squares = [], 0.0
    for side in (after, before):
        line = side @ estimator.T
        ends.append(line[:, 0])
        squares = squares + np.sum((side - line @ design.T) ** 2, axis=1)
    freedom = 2 * (n - 2)
    steps = ends[0] - ends[1]
    uncertainty = np.sqrt(squares / freedom * 2.0 * (estimator[0] @ estimator[0]))
    here = len(profile) // 2 - n
    elsewhere = np.abs(steps[np.abs(np.arange(len(steps)) - here) >= n]).max(initial=0.0)
    t = -float(stdtrit(freedom, TAPS_P_VALUE / 8.0))  # four steps, both signs
    beyond = abs(steps[here]) > max(t * uncertainty[here], STEP_RATIO * elsewhere)
    return float(steps[here]), float(uncertainty[here]), bool(beyond)
