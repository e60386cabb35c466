"""Linear regression of measured on simulated means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.values.shown import Shown


@dataclass(frozen=True, slots=True)
class Coefficient(Shown):
    """A fitted value with its standard error and its 95 % interval (Student's t)."""

    value: float
    standard_error: float
    lower_95: float
    upper_95: float


@dataclass(frozen=True, slots=True)
class Regression(Shown):
    """Regression of measured on simulated over a number of points.

    `slope_through_origin` is that of measured = slope * simulated, the ratio of the two signals; `slope` and
    `intercept` are those of measured = slope * simulated + intercept.
    """

    points: int
    slope_through_origin: Coefficient
    slope: Coefficient
    intercept: Coefficient


def regress(simulated: ArrayLike, measured: ArrayLike, variance: ArrayLike) -> Regression:
    """Fit measured against simulated by weighted least squares, through the origin and with an intercept.

    The weights are 1 / variance. The intervals come from the scatter of the points about the line, not from the
    variances, so they also hold where the cameras differ by more than noise.

    Parameters
    ----------
    simulated, measured
        (points,) values, three or more.
    variance
        (points,) variances of measured - simulated, above 0, up to a common factor.

    Raises
    ------
    InputError
        If there are fewer than three points, lengths differ, a variance is not above 0, or all simulated values are
        equal.

    Notes
    -----
    Errors of the simulated values enter the weights as if the slope were 1. They bias the slope towards 0 by their
    variance over that of the simulated values (W. A. Fuller, "Measurement Error Models", 1987, 1.1). For patch means
    that is about 1e-6 and not corrected.

    Examples
    --------
    >>> line = regress([1.0, 2.0, 4.0, 8.0], [2.1, 4.1, 8.1, 16.1], [1.0, 1.0, 1.0, 1.0])
    >>> round(line.slope.value, 9), round(line.intercept.value, 9)
    (2.0, 0.1)
    """
    x, y = np.asarray(simulated, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    spread = np.asarray(variance, dtype=np.float64)
    if x.ndim != 1 or not x.shape == y.shape == spread.shape:
        raise InputError(
            "simulated, measured and variance", value=(x.shape, y.shape, spread.shape), expected="lists of one length"
        )
    if x.size < 3:
        raise InputError("simulated", value=x.size, expected="three points or more")
    if not (np.isfinite(spread).all() and (spread > 0).all()):
        raise InputError("variance", expected="finite and above 0")
    if np.ptp(x) == 0:
        raise InputError("simulated", value=x[0], expected="different values", hint="Add other patches")
    (through_origin,) = _weighted_fit(x[:, None], y, 1 / spread)
    slope, intercept = _weighted_fit(np.column_stack([x, np.ones_like(x)]), y, 1 / spread)
    return Regression(x.size, through_origin, slope, intercept)


def regressions(
    simulated: NDArray[np.float64],
    measured: NDArray[np.float64],
    variance: NDArray[np.float64],
    used: NDArray[np.bool_],
    channels: Sequence[str],
    notes: list[str],
) -> tuple[Regression | None, dict[str, Regression | None]]:
    """Return the regression of all channels together, and that of each channel.

    Parameters
    ----------
    simulated, measured, variance, used
        (patches, channels) values, variances of their differences, and selection. Where a variance is 0, the selected
        values above 0 are weighted as for shot noise.
    channels
        Names of the channels.
    notes
        List that gets the reason for each missing regression.
    """

    def line(which: NDArray[np.bool_], what: str) -> Regression | None:
        weights, above = variance, ""
        if not (variance[which] > 0).all():
            weights, which, above = simulated, which & (simulated > 0), " above 0"
        x = simulated[which]
        if x.size < 3 or np.ptp(x) == 0:
            notes.append(f"no regression of {what}: it needs three different patches{above}")
            return None
        return regress(x, measured[which], weights[which])

    columns = {name: used & (np.arange(len(channels)) == k) for k, name in enumerate(channels)}
    return line(used, "all channels"), {name: line(which, f"channel {name}") for name, which in columns.items()}


def _weighted_fit(
    design: NDArray[np.float64], y: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[Coefficient, ...]:
    from scipy.stats import t

    root = np.sqrt(weight)
    solution, *_ = np.linalg.lstsq(design * root[:, None], y * root, rcond=None)
    freedom = y.size - design.shape[1]
    scatter = float(np.sum(weight * (y - design @ solution) ** 2)) / freedom
    # Columns are scaled before the normal matrix is formed, since levels are 1e4 times the column of ones.
    size = np.sqrt(weight @ design**2)
    normal = (design / size).T @ (design / size * weight[:, None])
    errors = np.sqrt(scatter * np.diag(np.linalg.inv(normal))) / size
    quantile = float(t.ppf(0.975, freedom))
    return tuple(
        Coefficient(float(v), float(e), float(v - quantile * e), float(v + quantile * e))
        for v, e in zip(solution, errors, strict=True)
    )
