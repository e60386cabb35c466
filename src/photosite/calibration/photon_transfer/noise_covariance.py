"""Covariances of temporal noise between pixels and between frames, and photon transfer by summed covariances.

Crosstalk, interpixel capacitance and charge diffusion share the charge of a pixel with its neighbors. The mean signal
stays, but the variance falls, because every pixel averages over its neighbors. What is lost appears in the covariances:
for weights w that sum to 1 and independent shot noise, the sum over j of cov(i, j) is sum_k w_ik K^2 N_k, which is K
times the mean signal of pixel i. So the summed covariance rises with the slope K where the variance rises with less
(Moore, Ning and Baney, Proc. SPIE 5167 (2004) 204; Astier et al., A&A 629 (2019) A36). This also holds between the
colors of a mosaic.

The same holds in time. Image lag leaves a part of the charge for the next frames, and the covariances with these frames
contain the variance that is lost.

The read noise joins after the charge is shared, and stays independent. A filter in the camera acts on all noise. So
correlated noise of dark frames shows a filter. Its weights need not sum to 1, and it need not be linear: the noise is
then not the sensor's, and the system gain is withheld.

Noise of the readout can be correlated by itself, as by interference: then the dark noise is correlated far more than
the shot noise, or in another pattern. An amplifier that is slow for the pixel clock acts as a filter along the rows,
as a CCD's does.

Where the dark frames do not tell the causes apart, summed covariances still give the system gain if a filter is linear
and keeps the mean. A small correction is therefore made, and half of it counts as its uncertainty, because a filter may
be another one. A large one is withheld.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv, gammaincinv

from photosite.calibration.photon_transfer.photon_transfer import LightLevels
from photosite.engine.noise_products import DifferenceProducts, difference_products, frame_products
from photosite.engine.threads import thread_count
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.diagnostic import DiagnosticKind, one_in
from photosite.values.uncertain import COVERAGE_95, Missing, Source, Uncertain, Value

FRAME_REACH = 2
"""Frames to the farthest frame whose covariance is estimated."""

LEAST_RUN = 4
"""Successive frames that the estimate needs."""

PIXELS_AT_ONCE = 1 << 18
"""Pixels of a frame that are compared at once."""

Run = Sequence[NDArray[np.unsignedinteger]]
"""Two or more successive frames of one level."""

BLOCK = 8
"""Rows and columns of the blocks whose means are subtracted, because shading that drifts is smooth."""


@dataclass(frozen=True)
class FrameCovariance:
    """Covariance of the temporal noise of a pixel with itself in later frames.

    Noise that rows, columns, blocks of pixels or frames share is not contained.

    Parameters
    ----------
    values, covariance
        (FRAME_REACH,) covariances with the next frames, DN^2, and their covariance matrix for independent frames; both
        empty where they are not known.
    """

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def uncertainty(self) -> NDArray[np.float64]:
        """Standard uncertainty of each covariance for independent frames, DN^2."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def sum_uncertainty(self) -> float:
        """That of the sum, DN^2."""
        return float(np.sqrt(self.covariance.sum()))

    def __sub__(self, other: FrameCovariance) -> FrameCovariance:
        """Return the covariances of the noise that another level does not have."""
        if not (len(self.values) and len(other.values)):
            return UNKNOWN
        return FrameCovariance(self.values - other.values, self.covariance + other.covariance)


UNKNOWN = FrameCovariance(np.empty(0), np.empty((0, 0)))
"""Fewer than `LEAST_RUN` successive frames."""


def mean_of_frames(levels: Sequence[FrameCovariance], weights: NDArray[np.float64]) -> FrameCovariance:
    """Return the weighted mean of several levels; the weights sum to 1."""
    known = [(w, level) for w, level in zip(weights, levels, strict=True) if w > 0.0]
    if not all(len(level.values) for _, level in known):
        return UNKNOWN
    values, covariance = np.zeros(FRAME_REACH), np.zeros((FRAME_REACH, FRAME_REACH))
    for w, level in known:
        values += w * level.values
        covariance += w**2 * level.covariance
    return FrameCovariance(values, covariance)


class FrameProducts:
    """Products of the noise of successive frames of one channel, from which `FrameCovariance` is estimated.

    The mean over a run of frames is the fixed pattern. A frame's part in proportion to it, a change of the light, is
    subtracted. The products of the residuals of m frames have the expectation P T P, where T is the matrix of the
    covariances by their distance in frames, and P subtracts the mean of m values. T is fitted to the products by least
    squares.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> charge = rng.poisson(1000.0, (9, 256, 256))
    >>> products = FrameProducts()
    >>> products.add(np.uint16(0.9 * charge[1:] + 0.1 * charge[:-1] + 0.5))
    >>> found = products.covariance()
    >>> found.values.round(-1) + 0.0, found.uncertainty.round()
    (array([90.,  0.]), array([1., 2.]))
    """

    def __init__(self) -> None:
        self._fitted = np.zeros(FRAME_REACH + 1)
        self._normal = np.zeros((FRAME_REACH + 1, FRAME_REACH + 1))
        self._square, self._freedom = 0.0, 0.0

    def add(
        self, run: Run | NDArray[np.uint16], site: tuple[int, ...] = (0, 0), tile: tuple[int, ...] = (1, 1)
    ) -> None:
        """Add the pixels of a site of the tile in a run of (rows, cols) frames; fewer than `LEAST_RUN` are ignored."""
        m = len(run)
        if m < LEAST_RUN:
            return
        center = np.eye(m) - 1.0 / m
        lags = np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
        basis = [center @ (lags == lag) @ center for lag in range(FRAME_REACH + 1)]
        for whole, pixels in frame_products(np.asarray(run, np.uint16), site, tile, BLOCK, PIXELS_AT_ONCE):
            frame_means, pattern = whole.mean(axis=0), float(whole.mean())
            products = whole - frame_means - frame_means[:, None] + pattern
            if pattern:
                products -= np.outer(frame_means - pattern, frame_means - pattern) / pattern
            self._fitted += [float(np.vdot(each, products)) for each in basis]
            self._normal += [[pixels * float(np.vdot(a, b)) for b in basis] for a in basis]
            self._square += float(np.trace(products))
            self._freedom += pixels * (m - 1)

    def merge(self, other: FrameProducts) -> None:
        """Add the products of other pixels of the channel."""
        self._fitted += other._fitted
        self._normal += other._normal
        self._square += other._square
        self._freedom += other._freedom

    def covariance(self) -> FrameCovariance:
        """Return the estimate; `UNKNOWN` without a run."""
        if not self._freedom:
            return UNKNOWN
        inverse = np.linalg.inv(self._normal).astype(np.float64)
        variance = self._square / self._freedom
        covariance: NDArray[np.float64] = 2.0 * variance**2 * inverse[1:, 1:]
        return FrameCovariance((inverse @ self._fitted)[1:], covariance)


REACH = 2
"""Rows and columns to the farthest neighbor whose covariance is summed: crosstalk to the next pixels reaches two."""


_LAGS = range(-REACH, REACH + 1)
_NEXT = (REACH - 1, REACH, REACH, REACH + 1), (REACH, REACH - 1, REACH + 1, REACH)
"""Places of the next pixels of the column and of the row."""


@dataclass(frozen=True)
class NoiseCovariance:
    """Covariance of the temporal noise of a channel's pixels with their neighbors.

    Noise that whole rows, columns or frames share is not contained.

    Parameters
    ----------
    covariance
        (2 REACH + 1, 2 REACH + 1) mean covariance with the pixel so many rows and columns away, DN^2; the variance is
        in the middle.
    uncertainty
        Standard uncertainty of each for independent pixels, DN^2.
    sum_uncertainty, next_uncertainty
        That of the sum over all neighbors, and over the next pixels of the row and of the column, DN^2.
    row, row_uncertainty, row_freedom
        Variance that the pixels of a row share, DN^2, its standard uncertainty for independent rows, and its degrees of
        freedom.
    row_period
        Period of this variance in rows; None where no frequency stands out.
    frames
        Covariance with the same pixel in the next frames.
    """

    covariance: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    sum_uncertainty: float
    next_uncertainty: float
    row: float
    row_uncertainty: float
    row_freedom: float
    row_period: float | None
    frames: FrameCovariance

    @property
    def variance(self) -> float:
        """Variance of a pixel, DN^2."""
        # The middle comes from differences of successive frames.
        return float(self.covariance[REACH, REACH] + self.frames.values[:1].sum())

    @property
    def neighbor_values(self) -> NDArray[np.float64]:
        """(lags,) covariances with the neighbors, DN^2."""
        return _without_middle(self.covariance)

    def __sub__(self, other: NoiseCovariance) -> NoiseCovariance:
        """Return the covariances of the noise that another level does not have."""
        return NoiseCovariance(
            self.covariance - other.covariance,
            np.hypot(self.uncertainty, other.uncertainty),
            math.hypot(self.sum_uncertainty, other.sum_uncertainty),
            math.hypot(self.next_uncertainty, other.next_uncertainty),
            self.row - other.row,
            math.hypot(self.row_uncertainty, other.row_uncertainty),
            self.row_freedom,
            self.row_period,
            self.frames - other.frames,
        )

    def scores(self) -> NDArray[np.float64]:
        """Return covariances in standard uncertainties, normal within chance.

        They are the sum over the neighbors, the sum over the next pixels, every neighbor, and every frame.
        """
        neighbor_sum = self.neighbor_values.sum() / self.sum_uncertainty
        next_pixels = self.covariance[_NEXT].sum() / self.next_uncertainty
        each_lag = self.neighbor_values / _without_middle(self.uncertainty)
        return np.concatenate([[neighbor_sum, next_pixels], each_lag, self.frames.values / self.frames.uncertainty])


def mean_covariance(levels: Sequence[NoiseCovariance], weights: NDArray[np.float64]) -> NoiseCovariance:
    """Return the weighted mean of the noise covariances of several levels; the weights sum to 1.

    The period of the rows is that of the level whose rows vary most, in standard uncertainties.
    """

    def mean(field: str) -> Any:
        return sum(w * getattr(level, field) for w, level in zip(weights, levels, strict=True))

    def root(field: str) -> Any:
        return np.sqrt(sum((w * getattr(level, field)) ** 2 for w, level in zip(weights, levels, strict=True)))

    rows = max(levels, key=lambda level: level.row / level.row_uncertainty)
    spread = root("row_uncertainty")
    # Welch and Satterthwaite.
    parts = (w * level.row_uncertainty for w, level in zip(weights, levels, strict=True))
    freedom = spread**4 / sum(part**4 / level.row_freedom for part, level in zip(parts, levels, strict=True))
    return NoiseCovariance(
        mean("covariance"),
        root("uncertainty"),
        float(root("sum_uncertainty")),
        float(root("next_uncertainty")),
        mean("row"),
        float(spread),
        float(freedom),
        rows.row_period,
        mean_of_frames([level.frames for level in levels], weights),
    )


def _without_middle(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.delete(values.ravel(), values.size // 2)


def noise_covariances(runs: Iterable[Run], tile: NDArray[np.int64]) -> list[NoiseCovariance]:
    """Estimate each channel's noise covariances from runs of successive frames of one level.

    The difference of two frames contains no fixed pattern. Its part in proportion to the mean of the two, a change of
    the light, is subtracted. The covariance that a row shares is that with the far pixels of a row, and likewise for
    columns and frames. Subtracted from the covariance of near pixels, they leave an unbiased estimate.

    Parameters
    ----------
    runs
        Runs of two or more frames of one shape; the frames of a run are taken in pairs, and together.
    tile
        The repeating tile of channel indices.

    Returns
    -------
    list of NoiseCovariance
        One per channel.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> def frame():
    ...     charge = rng.poisson(1000.0, (256, 256)).astype(float)
    ...     return np.uint16(0.9 * charge + 0.1 * np.roll(charge, 1, axis=1) + 0.5)
    >>> (found,) = noise_covariances([(frame(), frame()) for _ in range(8)], np.zeros((1, 1), np.int64))
    >>> found.covariance[2].round(-1) + 0.0
    array([  0.,  90., 820.,  90.,   0.])
    """
    span, channels = len(_LAGS), int(tile.max()) + 1
    products, squares, counts = np.zeros((3, channels, span, span))
    again = np.zeros((channels, span, span))
    means: list[list[_RowMeans]] = [[] for _ in range(channels)]
    between = [FrameProducts() for _ in range(channels)]
    for run in runs:
        stack = np.asarray(run, np.uint16)
        del run  # free the frames
        for number, site_products in zip(tile.flat, _products_by_site(stack, tile.shape), strict=True):
            between[number].merge(site_products)
        for found in _products_of_pairs(stack, tile.shape):
            variance = {phase: _variance(found, phase, tile.shape) for phase in np.ndindex(*tile.shape)}
            for phase in variance:
                channel = int(tile[phase])
                means[channel].append(_RowMeans.of(found, phase, tile.shape))
                for dy, dx, lag_covariance, count, other in _lagged(found, phase, tile.shape):
                    place = channel, dy + REACH, dx + REACH
                    weight = variance[phase] * variance[other] * count
                    products[place] += lag_covariance * count
                    squares[place] += weight
                    counts[place] += count
                    again[place] += weight * (tile[other] == channel)
    # A difference has twice the covariance of a frame. Within a channel, opposite lags have the same products.
    result = []
    for k in range(channels):
        uncertainty = 0.5 * np.sqrt(squares[k]) / counts[k]
        sum_variances = (squares[k] + again[k]) / counts[k] ** 2
        sum_uncertainty, next_uncertainty = (
            0.5 * math.sqrt(each.sum()) for each in (_without_middle(sum_variances), sum_variances[_NEXT])
        )
        covariance = 0.5 * products[k] / counts[k]
        # Crosstalk along a row adds to the variance of its mean.
        row = _row_noise(means[k], float(covariance[REACH].sum()))
        period = _row_period(means[k], tile.shape[0])
        result.append(
            NoiseCovariance(
                covariance, uncertainty, sum_uncertainty, next_uncertainty, *row, period, between[k].covariance()
            )
        )
    return result


def _products_by_site(stack: NDArray[np.uint16], tile: tuple[int, ...]) -> list[FrameProducts]:
    """Return the products of the frames of a run at each site of the tile, computed in threads."""

    def products(site: tuple[int, ...]) -> FrameProducts:
        found = FrameProducts()
        found.add(stack, site, tile)
        return found

    sites = list(np.ndindex(*tile))
    with ThreadPoolExecutor(min(len(sites), thread_count())) as threads:
        return list(threads.map(products, sites))


def _products_of_pairs(stack: NDArray[np.uint16], tile: tuple[int, ...]) -> list[DifferenceProducts]:
    """Return the products in the differences of pairs of successive frames, computed in threads."""
    pairs = len(stack) // 2
    with ThreadPoolExecutor(min(max(pairs, 1), thread_count())) as threads:
        return list(
            threads.map(lambda k: difference_products(stack[2 * k], stack[2 * k + 1], tile, REACH), range(pairs))
        )


def _plane_lines(
    found: DifferenceProducts, phase: tuple[int, ...], tile: tuple[int, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return found.rows[phase[0] :: tile[0], phase[1]], found.columns[phase[0], phase[1] :: tile[1]]


def _variance(found: DifferenceProducts, phase: tuple[int, ...], tile: tuple[int, ...]) -> float:
    rows, columns = _plane_lines(found, phase, tile)
    pixels = len(rows) * len(columns)
    return float(found.near[phase][REACH, REACH]) / pixels - (float(rows.sum()) / pixels) ** 2


@dataclass(frozen=True)
class _RowMeans:
    """Row means of a difference of two frames at one place of the tile: their mean square and spectrum."""

    rows: int
    cols: int
    square: float
    spectrum: NDArray[np.float64]

    @classmethod
    def of(cls, found: DifferenceProducts, phase: tuple[int, ...], tile: tuple[int, ...]) -> _RowMeans:
        rows, columns = _plane_lines(found, phase, tile)
        means = rows / len(columns)
        spectrum: NDArray[np.float64] = np.abs(np.fft.rfft(means)[1:]) ** 2
        return cls(len(rows), len(columns), float(means @ means) / (len(means) - 1), spectrum)


def _row_noise(means: Sequence[_RowMeans], row_covariance: float) -> tuple[float, float, float]:
    """Return the variance that rows share, its uncertainty and its degrees of freedom.

    `row_covariance` is the covariance summed along a row. It comes from the same pixels: its own noise, and what far
    pixels of the row have in common, widen the uncertainty on frames of few columns.
    """
    shared = [0.5 * entry.square - row_covariance / entry.cols for entry in means]
    square = 0.5 * float(np.mean([entry.square for entry in means]))
    freedom = float(sum(entry.rows - 1 for entry in means))
    fraction = len(_LAGS) / means[0].cols
    return float(np.mean(shared)), square * math.sqrt(2.0 / freedom) * (1.0 + fraction) ** 1.5, freedom


CORRELATION_P_VALUE = 5e-4
"""Fraction of calibrations with independent pixels in which correlated noise may be reported."""


def _row_period(means: Sequence[_RowMeans], tile_rows: int) -> float | None:
    """Return the period of the row means in rows of the frame, if one frequency stands out of the others."""
    power = np.mean([entry.spectrum for entry in means], axis=0)
    n, at = len(power), int(np.argmax(power))
    # The power of one frequency of white noise is exponential, and the mean of m of them gamma-distributed.
    m = float(len(means))
    usual = float(np.median(power)) / (gammaincinv(m, 0.5) / m)
    if not 0 < at < n - 1 or power[at] < usual * gammainccinv(m, CORRELATION_P_VALUE / n) / m:
        return None
    # The vertex of the parabola through the amplitudes around the maximum.
    before, top, after = np.sqrt(power[at - 1 : at + 2])
    shift = 0.5 * (before - after) / (before - 2.0 * top + after)
    return float(tile_rows * means[0].rows / (at + 1 + shift))


def _lagged(
    found: DifferenceProducts, phase: tuple[int, ...], tile: tuple[int, ...]
) -> Iterable[tuple[int, int, float, int, tuple[int, int]]]:
    """Yield (rows, columns, covariance, products, phase of the neighbor) for the neighbors of the pixels of a phase."""
    row_sums, column_sums = _plane_lines(found, phase, tile)
    rows, cols, plane_sum = len(row_sums), len(column_sums), float(row_sums.sum())
    by_row = _by_phase(phase[0], tile[0])
    by_column = _by_phase(phase[1], tile[1])
    for r, lags_y in by_row.items():
        for c, lags_x in by_column.items():
            other_rows, other_columns = _plane_lines(found, (r, c), tile)
            other_sum = float(other_rows.sum())
            shifts_y, shifts_x = [s for _, s in lags_y], [s for _, s in lags_x]
            places = np.ix_([REACH + dy for dy, _ in lags_y], [REACH + dx for dx, _ in lags_x])
            near = found.near[phase][places]
            pixels = np.outer([rows - abs(s) for s in shifts_y], [cols - abs(s) for s in shifts_x])
            row_products, in_row = _line_products(row_sums, other_rows, shifts_y, cols)
            column_products, in_column = _line_products(column_sums, other_columns, shifts_x, rows)
            far_row = (row_products - near.sum(1)) / (in_row - pixels.sum(1))
            far_column = (column_products - near.sum(0)) / (in_column - pixels.sum(0))
            far_products = plane_sum * other_sum - row_products.sum() - column_products.sum() + near.sum()
            far = far_products / (float(rows * cols) ** 2 - in_row.sum() - in_column.sum() + pixels.sum())
            covariance = near / pixels - far_row[:, None] - far_column + far
            for i, (dy, _) in enumerate(lags_y):
                for j, (dx, _) in enumerate(lags_x):
                    yield dy, dx, float(covariance[i, j]), int(pixels[i, j]), (r, c)


def _by_phase(start: int, period: int) -> dict[int, list[tuple[int, int]]]:
    """Return the lags from a place of the tile, each with its shift in planes, by the place where they end."""
    lags: dict[int, list[tuple[int, int]]] = {}
    for lag in _LAGS:
        shift, end = divmod(start + lag, period)
        lags.setdefault(end, []).append((lag, shift))
    return lags


def _line_products(
    first: NDArray[np.float64], second: NDArray[np.float64], shifts: Sequence[int], across: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return, per shift, the products of all pixels of one line with all of another, summed, and their number."""
    n = len(first)
    sums = [np.vdot(first[max(-s, 0) : n - max(s, 0)], second[max(s, 0) : n - max(-s, 0)]) for s in shifts]
    return np.array(sums), np.array([float((n - abs(s)) * across * across) for s in shifts])


CAUSE_UNCERTAINTY = 0.5
"""Standard uncertainty that an uncertain cause adds, as a fraction of the correction: the interval then reaches
from none to twice the correction."""


@dataclass(frozen=True)
class SharedCharge:
    """What photon transfer of a channel lacks because charge is shared.

    Parameters
    ----------
    factor
        Summed covariance of the shot noise over its variance.
    between_frames
        (FRAME_REACH,) correlation of the shot noise with that of the next frames; empty if the frames are independent.
    """

    factor: Uncertain
    between_frames: NDArray[np.float64]

    @property
    def cause_uncertainty(self) -> float:
        """Standard uncertainty of the factor where a filter in the camera may be the cause."""
        return CAUSE_UNCERTAINTY * abs(self.factor.value - 1.0)

    def with_uncertain_cause(self) -> SharedCharge:
        """Return the correction with the uncertainty of its cause."""
        return replace(self, factor=self.factor + Uncertain.of(0.0, self.cause_uncertainty))

    def factors(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (levels,) summed covariance over the variance that so many successive frames of a level show.

        Frames that are alike scatter less about their own mean.
        """
        return np.asarray(self.factor.value / (1.0 - self._in_pairs(frames) / np.maximum(frames - 1.0, 1.0)))

    def mean_factors(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (levels,) variance of the mean of so many frames over that of independent frames, which they show."""
        pairs = self._in_pairs(frames)
        return np.asarray((1.0 + pairs) / (1.0 - pairs / np.maximum(frames - 1.0, 1.0)))

    def _in_pairs(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (levels,) sum of the correlations of a frame with the others of its level, the mean over frames."""
        total = np.zeros(len(frames))
        for lag, correlation in enumerate(self.between_frames, 1):
            total += 2.0 * correlation * np.maximum(frames - lag, 0.0) / frames
        return total


@dataclass(frozen=True)
class SharedNoise:
    """Correlated shot noise of the light frames.

    Parameters
    ----------
    neighbors
        Correlation with the next pixel of the row and of the column, the mean over the channels; None within chance.
    frames
        Correlation with the same pixel of the next frame; None within chance.
    charge
        By channel, what corrects photon transfer; or why the noise of the frames is not the sensor's.
    unclear_cause
        Why a filter in the camera may be the cause, and what would tell; empty where shared charge is.
    suspected
        Correlation with the four next pixels, summed, that is suspected and not corrected.
    """

    neighbors: tuple[float, float] | None
    frames: float | None
    charge: tuple[SharedCharge, ...] | Missing
    unclear_cause: str = ""
    suspected: float = 0.0

    @property
    def seen(self) -> bool:
        """Whether a correlation is seen beyond chance; else it is suspected, and widens the uncertainty of the gain."""
        return self.neighbors is not None or self.frames is not None or isinstance(self.charge, Missing)

    def summed_covariances(
        self, channels: Sequence[LightLevels], indices: Sequence[int]
    ) -> tuple[list[LightLevels], Value]:
        """Return the levels of some channels with summed covariances in place of the variances, and 1 +- their error.

        The second is missing where the covariances are not the sensor's. The channels share pixel pairs, so the error
        of their factors counts as one, the weighted mean. The covariances of the levels contain the errors as if they
        were independent, which weights the channels; 1 +- the error has the remainder.
        """
        if isinstance(self.charge, Missing):
            return list(channels), self.charge
        charge = [self.charge[index] for index in indices]
        relative = np.array([entry.factor.relative for entry in charge])
        several = len(charge) > 1 and bool(relative.all())
        # What is suspected makes the gain of the variances too low, or too high where it is negative: never both.
        side = Source(*(COVERAGE_95 * (self.suspected * sign <= 0.0) for sign in (1.0, -1.0)))
        scaled = [
            levels.with_variances(entry.factors(levels.frames), entry.factor.relative if several else 0.0)
            for levels, entry in zip(channels, charge, strict=True)
        ]
        if not several:
            return scaled, Uncertain.of(1.0, float(relative.mean()), side)
        independent = 1.0 / float(np.sum(relative**-2.0))
        sum_error = independent * float(np.sum(1.0 / relative))
        return scaled, Uncertain.of(1.0, math.sqrt(sum_error**2 - independent), side)

    def means(self, levels: LightLevels, index: int) -> LightLevels:
        """Return the levels of a channel with the noise of their means, which contain all covariances."""
        if isinstance(self.charge, Missing):
            return levels
        return levels.with_noise_of_means(np.maximum(self.charge[index].factors(levels.frames), 1.0))

    def __str__(self) -> str:
        if isinstance(self.charge, Missing):
            return f"{self.charge.reason}; system gain, read noise, DSNU, PRNU and what follows from them are withheld"
        causes = []
        if self.neighbors is not None:
            causes.append("pixels share charge (crosstalk, interpixel capacitance or diffusion)")
        if self.frames is not None:
            causes.append("charge stays for the next frame (image lag)")
        above = 100.0 * (float(np.mean([entry.factor.value for entry in self.charge])) - 1.0)
        after = "; DSNU and PRNU are those of the frames, after the sharing" if self.neighbors is not None else ""
        seen = seen_correlations(self.neighbors, self.frames)
        cause = f"and the dark noise is not: {' and '.join(causes)}"
        if self.unclear_cause:
            cause = f"{self.unclear_cause}; or {' and '.join(causes)}"
            after = f"; the uncertainties of gain, read noise and DSNU include half of this{after}"
        return (
            f"{seen}, {cause}. The system gain comes from summed covariances, {above:.2g} % above that from "
            f"variances{after}"
        )


SHARED_NOISE = DiagnosticKind(
    "correlated-noise",
    "warning",
    "The noise of neighboring pixels or of successive frames is correlated.",
    "Pixels share charge, or charge stays for the next frame (image lag): the system gain comes from summed "
    "covariances. A filter in the camera is a cause as well: where the dark noise is correlated alike, the figures of "
    "noise are withheld.",
    "Switch noise reduction, sharpening, compression and demosaicing off; leave a pause between levels.",
    ("system_gain_dn_per_e", "*_e", "read_noise_*", "dsnu*", "prnu*"),
    "correlation coefficient",
    f"below {one_in(CORRELATION_P_VALUE)} sets",
)


SUSPICION_SIGMA = 2.0
"""Standard uncertainties of the mean correlation with the next pixels above which it widens the gain's uncertainty."""
LARGEST_UNCLEAR_CORRECTION = 0.1
"""Largest correction of photon transfer that is made when its cause is uncertain."""


def find_shared_noise(light: Sequence[NoiseCovariance], dark: Sequence[NoiseCovariance]) -> SharedNoise | None:
    """Return how shot noise is correlated between pixels and between frames; None where it is not, within chance.

    A correlation with the next pixels that is not seen, but suspected, is the relative uncertainty of a correction that
    is not made: photon transfer would be wrong by so much if it were real.

    Parameters
    ----------
    light, dark
        Noise covariances of the channels in flat fields and in dark frames.
    """
    shot = [a - b for a, b in zip(light, dark, strict=True)]
    if any(entry.variance <= 0.0 for entry in shot):
        return None
    scores = np.abs([entry.scores() for entry in shot])
    limit = NormalDist().inv_cdf(1.0 - 0.5 * CORRELATION_P_VALUE / (scores.size + 1))
    next_pixels = _correlation_with_next(shot)
    next_score = abs(next_pixels.value) / next_pixels.standard_uncertainty
    if max(scores.max(), next_score) < limit:
        if next_score < SUSPICION_SIGMA:
            return None
        suspected = SharedCharge(Uncertain.of(1.0, abs(next_pixels.value)), np.empty(0))
        return SharedNoise(None, None, (suspected,) * len(shot), suspected=next_pixels.value)
    neighbor_values, frame_values = np.split(scores, [2 + len(shot[0].neighbor_values)], axis=1)
    neighbors = frames = None
    if max(neighbor_values.max(), next_score) >= limit:
        across, down = (
            float(np.mean([entry.covariance[place] / entry.variance for entry in shot]))
            for place in ((REACH, REACH + 1), (REACH + 1, REACH))
        )
        neighbors = across, down
    if frame_values.max(initial=0.0) >= limit:
        frames = float(np.mean([entry.frames.values[0] / entry.variance for entry in shot]))
    unclear_cause = _unclear_cause(shot, dark, neighbors, frames)
    if isinstance(unclear_cause, Missing):
        return SharedNoise(neighbors, frames, unclear_cause)
    charge = tuple(_shared_charge(entry, neighbors is not None, frames is not None) for entry in shot)
    if not unclear_cause:
        return SharedNoise(neighbors, frames, charge)
    largest = max(abs(entry.factor.value - 1.0) for entry in charge)
    if largest > LARGEST_UNCLEAR_CORRECTION:
        seen = f"{seen_correlations(neighbors, frames)}, {unclear_cause}"
        why = f"{seen}, which would change the gain by {100.0 * largest:.2g} %"
        return SharedNoise(neighbors, frames, SHARED_NOISE.missing(why))
    return SharedNoise(neighbors, frames, tuple(entry.with_uncertain_cause() for entry in charge), unclear_cause)


def _correlation_with_next(shot: Sequence[NoiseCovariance]) -> Uncertain:
    """Return the correlation with the four next pixels, summed; the weighted mean over the channels."""
    values = np.array([entry.covariance[_NEXT].sum() / entry.variance for entry in shot])
    spread = np.array([entry.next_uncertainty / entry.variance for entry in shot])
    weights = spread**-2 / np.sum(spread**-2)
    # Pixels of two channels that are neighbors count in both.
    twice = 2.0 if len(shot) > 1 else 1.0
    return Uncertain.of(float(weights @ values), math.sqrt(twice * float(np.sum((weights * spread) ** 2))))


def _shared_charge(shot: NoiseCovariance, neighbors: bool, frames: bool) -> SharedCharge:
    """Return the correction by the covariances with the neighbors, the next frames, or both."""
    total = Uncertain(1.0)
    if neighbors:
        # The sum with the variance is the spectral density at frequency 0, whose relative uncertainty does not change
        # with the correlation; that of the sum holds for independent pixels.
        summed = float(shot.neighbor_values.sum())
        grown = max(1.0 + summed / shot.variance, 1.0)
        total += Uncertain.of(summed, grown * shot.sum_uncertainty) / shot.variance
    if not frames:
        return SharedCharge(total, np.empty(0))
    total += Uncertain.of(2.0 * float(shot.frames.values.sum()), 2.0 * shot.frames.sum_uncertainty) / shot.variance
    return SharedCharge(total, shot.frames.values / shot.variance)


def seen_correlations(neighbors: tuple[float, float] | None, frames: float | None) -> str:
    """Return the correlations in words."""
    seen = []
    if neighbors is not None:
        seen.append(f"neighboring pixels by {neighbors[0]:.2g} in rows and {neighbors[1]:.2g} in columns")
    if frames is not None:
        seen.append(f"successive frames by {frames:.2g}")
    return f"the noise is correlated between {' and between '.join(seen)}"


FILTER_FRACTION = 0.3
"""Correlation of the dark noise, as a fraction of that of the shot noise, above which a filter may be the cause.

A filter gives 1, crosstalk 0. Where the noise of a filter's dark frames has other causes of correlation as well, the
correlation of the shot noise is at least this fraction of it.
"""
FILTER_SIGMA = 3.0
"""Standard uncertainties by which that fraction must be apart from the limit."""


def _unclear_cause(
    shot: Sequence[NoiseCovariance],
    dark: Sequence[NoiseCovariance],
    neighbors: tuple[float, float] | None,
    frames: float | None,
) -> str | Missing:
    """Return why a filter may be the cause, and what would tell; empty where it is not, missing where it is."""
    seen = seen_correlations(neighbors, frames)
    if frames is not None and frames < 0.0:
        return SHARED_NOISE.missing(f"{seen}, which image lag does not explain: the noise is not the sensor's")
    noise = [entry.variance - QUANTIZATION_DN2 for entry in dark]
    if min(noise) <= QUANTIZATION_DN2:
        return "and rounding hides whether the dark noise is too, as after a filter in the camera (take a higher gain)"

    def chosen(neighbor_values: NDArray[np.float64], frame_values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.append(neighbor_values if neighbors is not None else [], frame_values if frames is not None else [])

    def correlations(
        levels: Sequence[NoiseCovariance], variances: Sequence[float]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        # Opposite lags of a channel have the same products, which doubles the variance of their sum.
        found = [(chosen(e.neighbor_values, e.frames.values), chosen(_both(e), e.frames.uncertainty)) for e in levels]
        values, spread = (
            np.concatenate([x / variance for x, variance in zip(each, variances, strict=True)])
            for each in zip(*found, strict=True)
        )
        return values, spread

    shot_correlation, u_shot = correlations(shot, [entry.variance for entry in shot])
    dark_correlation, u_dark = correlations(dark, noise)
    fraction, uncertainty = _projection(dark_correlation, u_dark, shot_correlation)
    if fraction + FILTER_SIGMA * uncertainty < FILTER_FRACTION:
        return ""
    shot_fraction, shot_uncertainty = _projection(shot_correlation, u_shot, dark_correlation)
    if frames is None and shot_fraction + FILTER_SIGMA * shot_uncertainty < FILTER_FRACTION:
        return "and the dark noise far more, as by interference or by low-frequency noise of the amplifier"
    if fraction - FILTER_SIGMA * uncertainty < FILTER_FRACTION:
        times = max((FILTER_SIGMA * uncertainty / FILTER_FRACTION) ** 2, 1.0)
        return (
            f"and the dark frames are too few to show whether a filter in the camera is the cause (take "
            f"{2 * math.ceil(times)} times as many at the shortest exposure time)"
        )
    if frames is None and all(map(_is_along_rows, shot)):
        return "along the rows only, in dark frames too, as by a slow amplifier or a filter in the camera"
    causes = []
    if neighbors is not None:
        causes.append("noise reduction, sharpening, lossy compression, demosaicing or rescaling")
    if frames is not None:
        causes.append("noise reduction over time, or copies of frames with small changes")
    return SHARED_NOISE.missing(
        f"{seen}, in dark frames as in flat fields: the frames were processed before they were saved "
        f"({'; '.join(causes)}), and their noise is not the sensor's"
    )


def _both(level: NoiseCovariance) -> NDArray[np.float64]:
    return math.sqrt(2.0) * _without_middle(level.uncertainty)


def _projection(
    values: NDArray[np.float64], spread: NDArray[np.float64], onto: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the multiple of `onto` that fits the values best, and its standard uncertainty."""
    power = float(onto @ onto)
    return float(onto @ values) / power, float(np.sqrt(np.sum((onto * spread) ** 2))) / power


def _is_along_rows(shot: NoiseCovariance) -> bool:
    """Return whether pixels are correlated with those of their row only."""
    scores = np.delete(np.abs(shot.covariance / shot.uncertainty), REACH, axis=0)
    return float(scores.max()) < NormalDist().inv_cdf(1.0 - 0.5 * CORRELATION_P_VALUE / scores.size)
