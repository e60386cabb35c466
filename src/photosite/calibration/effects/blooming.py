"""Blooming: the charge that saturated hot pixels of dark frames leave in the columns beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.withheld import EFFECT_NOT_MEASURED, EFFECT_NOT_SEEN, NO_MAPS
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.engine.lazy_maps import LazyMap, Map, row_strips
from photosite.frames.frame_set import FrameGroup
from photosite.sensor.effects.blooming import Blooming
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Missing, Source, Uncertain

LEAST_PIXELS = 5
"""Smallest number of overflowing pixels from which blooming is estimated."""

_UNSATURATED = 0.8
"""Fraction of the saturation signal up to which a shorter exposure shows the dark current of a pixel."""
_OVERFLOWING = 1.2
"""Dark signal over the saturation signal from which a pixel's overflow is used."""
_REACH, _ORDINARY = 12, 2000
"""Pixels of a column to each side that may take the overflow; pixels without it that show the noise of the sums."""
_SEEN_P_VALUE = 0.005
"""Probability of so much charge beside hot pixels without blooming, below which it is taken for seen."""
_METHOD = (
    "charge in the columns beside {} hot pixels that overflow in dark frames of {:.3g} s, against the charge that they "
    "cannot hold"
)

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BloomingResult(Finding, Shown):
    """Fraction of the overflow that reaches other pixels of the column.

    Parameters
    ----------
    kept
        The fraction; an anti-blooming drain removes the remainder.
    overflow_dn, column_dn
        (pixels,) dark signal of each overflowing pixel above saturation, and the charge beside it in its column.
    uncertainty_dn
        Standard uncertainty of the charge in a column.
    seen
        Whether the fraction is above zero beyond chance.
    """

    kept: Estimate
    overflow_dn: _Floats
    column_dn: _Floats
    uncertainty_dn: float
    seen: bool

    @property
    def present(self) -> bool:
        """Whether the fraction is above zero beyond chance."""
        return self.seen

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the blooming for a sensor file; that of the base where it is not seen."""
        if not self.seen:
            return {}
        kept = self.kept.measured(source)
        drained = Measured(min(max(1.0 - kept.value, 0.0), 1.0), kept.standard_uncertainty, source)
        return {"blooming": Blooming(drained=drained)}

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate and the number of pixels, for JSON."""
        return {**super().to_dict(), "pixels": len(self.overflow_dn), "seen": self.seen}


def measure_blooming(evidence: Evidence) -> BloomingResult | Missing:
    """Estimate the fraction of the charge above the full well that flows into other pixels of the column.

    The dark frames are read again.

    Returns
    -------
    BloomingResult or Missing
        Missing where no pixel overflows by its dark current. The estimate has a reason instead of a value where the
        frames do not tell the overflow.

    Notes
    -----
    In the longest dark frames, a pixel of the dark signal x holds the saturation signal W, and x - W flows over. A
    shorter exposure time at which the pixel is not saturated shows x. The excess charge of the column beside the pixel
    is the kept fraction of x - W.
    """
    if evidence.chip is None:
        return NO_MAPS.missing(evidence.no_maps)
    (frames, taken), parameters = evidence.reduction.as_taken, evidence.parameters
    top, black = parameters.saturation_dn.value, parameters.black_level_dn.value
    darks = sorted(frames.of_kind("dark"), key=lambda group: group.exposure_s)
    if top is None or black is None or len(darks) < 2:
        return EFFECT_NOT_MEASURED.missing(
            "blooming needs black level, saturation and dark frames at two exposure times"
        )
    used = {id(entry.source) for entry in taken}
    well, longest = top - black, darks[-1]
    first = _mean(darks[0], used, frames.bits)
    added = _Added(_mean(longest, used, frames.bits), first)
    row, col = _places_above(added, _UNSATURATED * well)
    if not len(row):
        return EFFECT_NOT_SEEN.missing("no pixel overflows by its dark current")
    if top > (1 << frames.bits) - 1.5:
        return _without("the converter saturates before the well, so that the frames do not show a full well")
    signal = np.full(len(row), np.nan)
    for group in darks[1:-1]:
        shown = _values_at(_mean(group, used, frames.bits), row, col) - _values_at(first, row, col)
        longer = longest.exposure_s / (group.exposure_s - darks[0].exposure_s)
        signal = np.where(shown < _UNSATURATED * well, shown * longer, signal)
    near = np.array([_hot_pixels_near(int(r), int(c), row, col) for r, c in zip(row, col, strict=True)])
    chosen = (signal > _OVERFLOWING * well) & (near == 1)
    if not np.isfinite(signal).any():
        return _without("no shorter dark exposure shows the dark current of the saturated pixels; take one in between")
    if chosen.sum() < LEAST_PIXELS:
        return _without(f"{chosen.sum()} hot pixels overflow; {LEAST_PIXELS} are needed")
    added = replace(added, usual=float(np.median(added[:], overwrite_input=True)))
    column = np.array([_column_charge(added, r, c) for r, c in zip(row[chosen], col[chosen], strict=True)])
    ordinary = _ordinary(added, row, col)
    column -= float(np.mean(ordinary))
    return _fraction_kept((signal - well)[chosen], column, ordinary, longest.exposure_s)


def _without(reason: str) -> BloomingResult:
    return BloomingResult(Estimate(reason=reason), np.zeros(0), np.zeros(0), 0.0, seen=False)


def _fraction_kept(overflow: _Floats, column: _Floats, ordinary: _Floats, exposure_s: float) -> BloomingResult:
    """Fit the charge in the columns against the overflow; `ordinary` is that of columns without overflow."""
    from scipy.special import stdtr

    slope = float(overflow @ column / (overflow @ overflow))
    left = column - slope * overflow
    freedom = len(column) - 1
    # Residuals weighted as in the slope: the noise may grow with the overflow.
    robust = float((overflow * left) @ (overflow * left)) / float(overflow @ overflow) ** 2 * len(column) / freedom
    known = float(ordinary.var()) / float(overflow @ overflow)
    u = math.sqrt(max(robust, known))
    kept = Uncertain.of(slope, u, Source.student(freedom))
    method = _METHOD.format(len(column), exposure_s)
    low, high = kept.interval_95
    limit = high if low < 0.0 < high else None
    seen = bool(stdtr(freedom, -slope / u) < _SEEN_P_VALUE)
    return BloomingResult(Estimate.of(kept, method, limit), overflow, column, float(ordinary.std()), seen)


@dataclass(frozen=True, eq=False)
class _Added(LazyMap):
    """What a longer exposure time adds to the mean dark frame, less the usual value."""

    longer: MeanFrame
    shorter: MeanFrame
    usual: float = 0.0

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of rows and columns."""
        return self.longer.shape

    def __getitem__(self, part: Any, /) -> _Floats:
        found: _Floats = self.longer[part] - self.shorter[part]
        found -= self.usual
        return found


def _mean(group: FrameGroup, used: set[int], bits: int) -> MeanFrame:
    sources = [source for source in group.frames if id(source) in used]
    stored = [rows for source in sources if (rows := source.open_rows()) is not None]
    if len(stored) == len(sources):
        return FrameSums(stored[0].shape, white=(1 << bits) - 1).add_last(stored).mean_frame()
    dtype = np.uint16 if len(sources) << bits <= 1 << 16 else np.uint32
    total: NDArray[np.unsignedinteger] = sources[0].read().astype(dtype)
    for source in sources[1:]:
        np.add(total, source.read(), out=total)
    return MeanFrame(total, len(sources), np.zeros((1, 1), np.int64))


def _places_above(values: Map, limit: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    found = [np.argwhere(values[r:end] > limit) + np.array([r, 0]) for r, end in row_strips(values)]
    row, col = np.concatenate(found).T
    return row, col


def _values_at(mean: MeanFrame, row: NDArray[np.int64], col: NDArray[np.int64]) -> _Floats:
    return np.asarray(mean.sum[row, col] / mean.count, np.float64)


def _hot_pixels_near(r: int, c: int, row: NDArray[np.int64], col: NDArray[np.int64]) -> int:
    return int(((col == c) & (np.abs(row - r) <= 2 * _REACH)).sum())


def _column_charge(added: Map, r: int, c: int) -> float:
    above, below = slice(max(r - _REACH, 0), r), slice(r + 1, r + 1 + _REACH)
    return float(sum(added[part, c : c + 1].sum() for part in (above, below)))


def _ordinary(added: Map, row: NDArray[np.int64], col: NDArray[np.int64]) -> _Floats:
    """Return the same sums beside pixels whose columns have no hot pixel within reach."""
    rng = np.random.default_rng(0)
    rows, cols = added.shape
    places = zip(rng.integers(0, rows, 2 * _ORDINARY), rng.integers(0, cols, 2 * _ORDINARY), strict=True)
    free = [(r, c) for r, c in places if not _hot_pixels_near(r, c, row, col)]
    return np.array([_column_charge(added, r, c) for r, c in free[:_ORDINARY]])


EFFECT = Effect(30, measure_blooming, missing="absent", labels={"kept": ("Share of the overflow that blooms", "1")})
