"""Covariances of temporal noise between neighboring pixels, and photon transfer by summed covariances.

Crosstalk, interpixel capacitance and charge diffusion share the charge of a pixel with its neighbors. The mean signal
stays, but the variance falls, because every pixel averages over its neighbors. What is lost appears in the covariances:
for weights w that sum to 1 and independent shot noise, the sum over j of cov(i, j) is sum_k w_ik K^2 N_k, which is K
times the mean signal of pixel i. So the summed covariance rises with the slope K where the variance rises with less
(Moore, Ning and Baney, Proc. SPIE 5167 (2004) 204; Astier et al., A&A 629 (2019) A36). This also holds between the
colors of a mosaic.

The read noise joins after the charge is shared, and stays independent. A filter in the camera acts on all noise. So
correlated noise of dark frames shows a filter. Its weights need not sum to 1, and it need not be linear: the noise is
then not the sensor's, and the system gain is withheld.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv, gammaincinv

from photosite.calibration.photon_transfer.photon_transfer import LightLevels, fit_gain, gain_value
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.values.uncertain import Missing, Uncertain, Value

REACH = 2
"""Rows and columns to the farthest neighbor whose covariance is summed: crosstalk to the next pixels reaches two."""

BY_CHANCE = 5e-4
"""Share of calibrations with independent pixels in which correlated noise may be reported."""

FILTER_SHARE = 0.3
"""Correlation of the dark noise, as a share of that of the shot noise, above which a filter may be the cause.

A filter gives 1, crosstalk 0.
"""

FAR_APART = 3.0
"""Standard uncertainties by which that share must be apart from the limit."""

FramePair = tuple[NDArray[np.unsignedinteger], NDArray[np.unsignedinteger]]
"""Two frames of one level."""

_LAGS = range(-REACH, REACH + 1)
_Planes = dict[tuple[int, int], NDArray[np.float64]]


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
    sum_uncertainty
        That of the sum over all neighbors, DN^2.
    row, row_uncertainty
        Variance that the pixels of a row share, DN^2, and its standard uncertainty for independent rows.
    row_period
        Period of this variance in rows; None where no frequency stands out.
    """

    covariance: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    sum_uncertainty: float
    row: float
    row_uncertainty: float
    row_period: float | None

    @property
    def variance(self) -> float:
        """Variance of a pixel, DN^2."""
        return float(self.covariance[REACH, REACH])

    @property
    def of_neighbors(self) -> NDArray[np.float64]:
        """(lags,) covariances with the neighbors, DN^2."""
        return _without_middle(self.covariance)

    def __sub__(self, other: NoiseCovariance) -> NoiseCovariance:
        """Return the covariances of the noise that another level does not have."""
        return NoiseCovariance(
            self.covariance - other.covariance,
            np.hypot(self.uncertainty, other.uncertainty),
            float(np.hypot(self.sum_uncertainty, other.sum_uncertainty)),
            self.row - other.row,
            float(np.hypot(self.row_uncertainty, other.row_uncertainty)),
            self.row_period,
        )

    def scores(self) -> NDArray[np.float64]:
        """Return the covariances and their sum in standard uncertainties: normal for independent pixels."""
        of_lags = self.of_neighbors / _without_middle(self.uncertainty)
        return np.append(of_lags, self.of_neighbors.sum() / self.sum_uncertainty)


def _without_middle(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.delete(values.ravel(), values.size // 2)


def noise_covariances(pairs: Iterable[FramePair], tile: NDArray[np.int64]) -> list[NoiseCovariance]:
    """Estimate each channel's noise covariances from pairs of frames of one level.

    The difference of two frames contains no fixed pattern. Its part in proportion to the mean of the two, a change of
    the light, is subtracted. The covariance that a row shares is that with the far pixels of a row, and likewise for
    columns and frames. Subtracted from the covariance of near pixels, they leave an unbiased estimate.

    Parameters
    ----------
    pairs
        Pairs of frames of one shape.
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
    for first, second in pairs:
        planes = _difference_planes(first, second, tile.shape)
        variance = {phase: plane.var() for phase, plane in planes.items()}
        for phase in planes:
            k = tile[phase]
            means[k].append(_RowMeans.of(planes[phase]))
            for dy, dx, covariance, count, other in _lagged(planes, phase, tile.shape):
                place = k, dy + REACH, dx + REACH
                weight = variance[phase] * variance[other] * count
                products[place] += covariance * count
                squares[place] += weight
                counts[place] += count
                again[place] += weight * (tile[other] == k)
    # A difference has twice the covariance of a frame. Within a channel, opposite lags have the same products.
    result = []
    for k in range(channels):
        uncertainty = 0.5 * np.sqrt(squares[k]) / counts[k]
        of_sum = np.sqrt(_without_middle((squares[k] + again[k]) / counts[k] ** 2).sum())
        covariance = 0.5 * products[k] / counts[k]
        # Crosstalk along a row adds to the variance of its mean.
        row, row_uncertainty = _row_noise(means[k], float(covariance[REACH].sum()))
        period = _row_period(means[k], tile.shape[0])
        result.append(NoiseCovariance(covariance, uncertainty, 0.5 * float(of_sum), row, row_uncertainty, period))
    return result


def _difference_planes(
    first: NDArray[np.unsignedinteger], second: NDArray[np.unsignedinteger], tile: tuple[int, ...]
) -> _Planes:
    """Return the difference of two frames at each place of the tile, without their mean pattern."""
    rows, cols = (length // step * step for length, step in zip(first.shape, tile, strict=True))
    planes = {}
    for r, c in np.ndindex(*tile):
        a, b = (frame[r : rows : tile[0], c : cols : tile[1]].astype(np.float64) for frame in (first, second))
        difference, mean = a - b, a + b
        difference -= difference.mean()
        mean -= mean.mean()
        if spread := float(np.vdot(mean, mean)):
            difference -= np.vdot(difference, mean) / spread * mean
        planes[r, c] = difference
    return planes


@dataclass(frozen=True)
class _RowMeans:
    """Row means of a difference of two frames at one place of the tile: their mean square and spectrum."""

    rows: int
    cols: int
    square: float
    spectrum: NDArray[np.float64]

    @classmethod
    def of(cls, plane: NDArray[np.float64]) -> _RowMeans:
        means = plane.mean(axis=1)
        spectrum: NDArray[np.float64] = np.abs(np.fft.rfft(means)[1:]) ** 2
        return cls(plane.shape[0], plane.shape[1], float(means @ means) / (len(means) - 1), spectrum)


def _row_noise(means: Sequence[_RowMeans], of_pixels: float) -> tuple[float, float]:
    """Return the variance that rows share and its uncertainty; `of_pixels` is the covariance summed along a row."""
    shared = [0.5 * entry.square - of_pixels / entry.cols for entry in means]
    square = 0.5 * float(np.mean([entry.square for entry in means]))
    return float(np.mean(shared)), square * math.sqrt(2.0 / sum(entry.rows for entry in means))


def _row_period(means: Sequence[_RowMeans], tile_rows: int) -> float | None:
    """Return the period of the row means in rows of the frame, if one frequency stands out of the others."""
    power = np.mean([entry.spectrum for entry in means], axis=0)
    n, at = len(power), int(np.argmax(power))
    # The power of one frequency of white noise is exponential, and the mean of m of them gamma-distributed.
    m = float(len(means))
    usual = float(np.median(power)) / (gammaincinv(m, 0.5) / m)
    if not 0 < at < n - 1 or power[at] < usual * gammainccinv(m, BY_CHANCE / n) / m:
        return None
    # The vertex of the parabola through the amplitudes around the maximum.
    before, top, after = np.sqrt(power[at - 1 : at + 2])
    shift = 0.5 * (before - after) / (before - 2.0 * top + after)
    return float(tile_rows * means[0].rows / (at + 1 + shift))


def _lagged(
    planes: _Planes, phase: tuple[int, int], tile: tuple[int, ...]
) -> Iterable[tuple[int, int, float, int, tuple[int, int]]]:
    """Yield (rows, columns, covariance, products, phase of the neighbor) for the neighbors of the pixels of a phase."""
    plane = planes[phase]
    rows, cols = plane.shape
    of_rows, of_columns, of_plane = _line_sums(plane)
    by_row = _by_phase(phase[0], tile[0])
    by_column = _by_phase(phase[1], tile[1])
    for r, lags_y in by_row.items():
        for c, lags_x in by_column.items():
            other = planes[r, c]
            other_rows, other_columns, of_other = _line_sums(other)
            shifts_y, shifts_x = [s for _, s in lags_y], [s for _, s in lags_x]
            near, pixels = np.empty((len(lags_y), len(lags_x))), np.empty((len(lags_y), len(lags_x)))
            for i, sy in enumerate(shifts_y):
                for j, sx in enumerate(shifts_x):
                    a = plane[max(-sy, 0) : rows - max(sy, 0), max(-sx, 0) : cols - max(sx, 0)]
                    b = other[max(sy, 0) : rows - max(-sy, 0), max(sx, 0) : cols - max(-sx, 0)]
                    near[i, j], pixels[i, j] = np.einsum("ij,ij", a, b), a.size
            of_row, in_row = _line_products(of_rows, other_rows, shifts_y, cols)
            of_column, in_column = _line_products(of_columns, other_columns, shifts_x, rows)
            far_row = (of_row - near.sum(1)) / (in_row - pixels.sum(1))
            far_column = (of_column - near.sum(0)) / (in_column - pixels.sum(0))
            of_frame = of_plane * of_other - of_row.sum() - of_column.sum() + near.sum()
            far = of_frame / (float(rows * cols) ** 2 - in_row.sum() - in_column.sum() + pixels.sum())
            covariance = near / pixels - far_row[:, None] - far_column + far
            for i, (dy, _) in enumerate(lags_y):
                for j, (dx, _) in enumerate(lags_x):
                    yield dy, dx, float(covariance[i, j]), int(pixels[i, j]), (r, c)


def _line_sums(plane: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    rows: NDArray[np.float64] = plane.sum(axis=1)
    columns: NDArray[np.float64] = plane.sum(axis=0)
    return rows, columns, float(rows.sum())


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


@dataclass(frozen=True)
class SharedNoise:
    """Correlated shot noise of the light frames.

    Parameters
    ----------
    correlation
        Correlation with the next pixel of the row and of the column, the mean over the channels.
    factors
        Per channel: summed covariance of the shot noise over its variance, by which photon transfer is corrected, or
        why it cannot be.
    """

    correlation: tuple[float, float]
    factors: tuple[Value, ...]

    @property
    def filtered(self) -> Missing | None:
        """Why the noise of the frames is not the sensor's; None where it is."""
        return next((factor for factor in self.factors if isinstance(factor, Missing)), None)

    def __str__(self) -> str:
        known = [factor.value for factor in self.factors if isinstance(factor, Uncertain)]
        if self.filtered is not None:
            return (
                f"{self.filtered.reason}; system gain, read noise, DSNU, PRNU and what follows from them are withheld"
            )
        return (
            f"the shot noise of neighboring pixels is correlated, {describe(self.correlation)}, and the dark noise is "
            f"not: pixels share charge (crosstalk, interpixel capacitance or diffusion). The system gain comes from "
            f"summed covariances, {100 * (float(np.mean(known)) - 1):.2g} % above that from variances; DSNU and PRNU "
            f"are those of the frames, after the sharing"
        )


def find_shared_noise(light: Sequence[NoiseCovariance], dark: Sequence[NoiseCovariance]) -> SharedNoise | None:
    """Return how the shot noise of neighboring pixels is correlated; None where it is independent within chance.

    Parameters
    ----------
    light, dark
        Noise covariances of the channels in flats and in dark frames.
    """
    shot = [a - b for a, b in zip(light, dark, strict=True)]
    if any(entry.variance <= 0.0 for entry in shot):
        return None
    scores = np.abs(np.concatenate([entry.scores() for entry in shot]))
    if scores.max() < NormalDist().inv_cdf(1.0 - 0.5 * BY_CHANCE / scores.size):
        return None
    middle = REACH
    correlation = tuple(
        float(np.mean([entry.covariance[place] / entry.variance for entry in shot]))
        for place in ((middle, middle + 1), (middle + 1, middle))
    )
    reason = _why_not_charge(shot, dark, correlation)
    factors: list[Value] = []
    for entry in shot:
        share = float(entry.of_neighbors.sum()) / entry.variance
        factors.append(reason or Uncertain.of(1.0 + share, entry.sum_uncertainty / entry.variance))
    return SharedNoise((correlation[0], correlation[1]), tuple(factors))


def describe(correlation: Sequence[float]) -> str:
    """Return the correlations with the next pixels in words."""
    return f"by {correlation[0]:.2g} in rows and {correlation[1]:.2g} in columns"


def _why_not_charge(
    shot: Sequence[NoiseCovariance], dark: Sequence[NoiseCovariance], correlation: Sequence[float]
) -> Missing | None:
    """Return why the correlation may come from a filter: the dark noise has it too, or may have it."""
    of_shot = np.concatenate([entry.of_neighbors / entry.variance for entry in shot])
    noise = [entry.variance - QUANTISATION_DN2 for entry in dark]
    seen = f"the noise of neighboring pixels is correlated, {describe(correlation)}"
    if min(noise) <= QUANTISATION_DN2:
        return Missing(f"{seen}, and rounding hides whether the dark noise is too, as after a filter in the camera")
    of_dark = np.concatenate([entry.of_neighbors / v for entry, v in zip(dark, noise, strict=True)])
    u_dark = np.concatenate([_without_middle(entry.uncertainty) / v for entry, v in zip(dark, noise, strict=True)])
    power = float(of_shot @ of_shot)
    share = float(of_shot @ of_dark) / power
    uncertainty = float(np.sqrt(2.0 * np.sum((of_shot * u_dark) ** 2))) / power
    if share + FAR_APART * uncertainty < FILTER_SHARE:
        return None
    if share - FAR_APART * uncertainty < FILTER_SHARE:
        return Missing(f"{seen}, and too few dark frames show whether a filter in the camera is the cause")
    return Missing(
        f"{seen}, in dark frames as in flat fields: the frames were filtered (noise reduction, sharpening, lossy "
        f"compression, demosaicing or rescaling) before they were saved, and their noise is not the sensor's"
    )


def gain_by_summed_covariance(
    channels: Sequence[LightLevels], used: Sequence[NDArray[np.bool_]], factors: Sequence[Value]
) -> Value:
    """Return K in DN/e- from the variances multiplied by the factors of `SharedNoise`, or why it is missing.

    The channels share pixel pairs, so the relative uncertainties of their factors count as one.
    """
    known = [factor for factor in factors if isinstance(factor, Uncertain)]
    if len(known) < len(factors):
        return next(factor for factor in factors if isinstance(factor, Missing))
    scaled = [levels.with_variances(factor.value) for levels, factor in zip(channels, known, strict=True)]
    gain = gain_value(fit_gain(scaled, used))
    if isinstance(gain, Missing):
        return gain
    return gain * Uncertain.of(1.0, float(np.mean([factor.relative for factor in known])))
