"""Distribution of the dark current over the pixels: fraction and size of hot pixels, and the body without them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding, SensorChanges
from photosite.calibration.withheld import EFFECT_NOT_MEASURED, NO_MAPS
from photosite.engine.large_statistics import mean, mean_and_deviation, median, pieces, quantiles
from photosite.sensor.effects.hot_pixels import HotPixels
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95, Measured, Missing, Uncertain, Value

_METHOD = "log-normal tail of the pixels' dark currents above {:.3g} DN/s, where no other pixel lies"


_NOT_KNOWN = EFFECT_NOT_MEASURED.missing("not known")
_NO_CURRENT = Estimate(reason=_NOT_KNOWN.reason)
_Floats = NDArray[np.float64]


DARK_DISTRIBUTION = {
    "fraction": ("Fraction of hot pixels", "1"),
    "median_dn_per_s": ("Median of their additional dark current", "DN/s"),
    "log_spread": ("Spread of it, standard deviation of its logarithm", "1"),
    "mean_dn_per_s": ("Mean dark current of the other pixels", "DN/s"),
    "dcnu_percent": ("Nonuniformity of the other pixels", "%"),
}
"""Label and unit of the estimates of `DarkDistribution`."""


@dataclass(frozen=True)
class DarkDistribution(Finding, Shown):
    """Distribution of the dark current over the pixels.

    Parameters
    ----------
    fraction, median_dn_per_s, log_spread
        Fraction of hot pixels; median of their additional dark current; standard deviation of its natural logarithm.
    mean_dn_per_s, dcnu_percent
        Mean of the other pixels, and its standard deviation over them relative to it.
    limit_dn_per_s, above, pixels
        Dark current above which only hot pixels lie, the number of pixels above it, and of all pixels.
    center_dn_per_s, uncertainty_dn_per_s
        Median over all pixels, to which the hot ones add; standard uncertainty of a pixel.
    edges_dn_per_s, count
        (bins + 1,) and (bins,): histogram of the dark current above the median, on a logarithmic axis.
    gain, current_dn_per_s
        System gain in DN/e-, and mean dark current of all pixels, for a sensor file.
    """

    fraction: Estimate
    median_dn_per_s: Estimate
    log_spread: Estimate
    mean_dn_per_s: Estimate
    dcnu_percent: Estimate
    limit_dn_per_s: float
    above: int
    pixels: int
    center_dn_per_s: float
    uncertainty_dn_per_s: float
    edges_dn_per_s: _Floats
    count: NDArray[np.int64]
    gain: Value = _NOT_KNOWN
    current_dn_per_s: Estimate = _NO_CURRENT

    @property
    def present(self) -> bool:
        """Whether there are enough hot pixels for a distribution."""
        return self.median_dn_per_s.value is not None

    @property
    def estimates(self) -> Mapping[str, Estimate]:
        """The estimates by name."""
        names = "fraction", "median_dn_per_s", "log_spread", "mean_dn_per_s", "dcnu_percent"
        return {name: getattr(self, name) for name in names}

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the hot pixels for a sensor file; those of the base where the distribution is not known."""
        found, gain, mean = self.median_dn_per_s, self.gain, self.mean_dn_per_s.value
        if found.value is None or found.standard_uncertainty is None or isinstance(gain, Missing):
            return {}
        if self.current_dn_per_s.value is None or mean is None or mean <= 0.0:
            return {}
        median = Uncertain.of(found.value, found.standard_uncertainty) / gain
        return {
            "hot_pixels": HotPixels(
                fraction=self.fraction.measured(source),
                median_e_per_s=Measured(median.value, median.standard_uncertainty, source),
                log_spread=self.log_spread.measured(source),
            )
        }

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return mean and nonuniformity of the dark current without hot pixels, and without glow."""
        dark, mean, current = changes.measured("dark_voltage_mv_per_s"), self.mean_dn_per_s, self.current_dn_per_s
        if "hot_pixels" not in changes.fields or dark is None or mean.value is None or current.value is None:
            return {}
        note = f"{changes.source}, without hot pixels and glow"
        ratio = mean.value / current.value
        spread = math.hypot(
            ratio * dark.standard_uncertainty, dark.value * (mean.standard_uncertainty or 0.0) / current.value
        )
        found = {"dark_voltage_mv_per_s": Measured(ratio * dark.value, spread, note)}
        if (dcnu := self.dcnu_percent).value is not None:
            found["dcnu_percent"] = Measured(max(dcnu.value, 0.0), dcnu.standard_uncertainty or 0.0, note)
        return found

    def expected(self) -> _Floats | None:
        """Return (bins,) expected number of hot pixels in each bin of the histogram; None without a distribution."""
        if self.fraction.value is None or self.median_dn_per_s.value is None or self.log_spread.value is None:
            return None
        from scipy.special import ndtr

        place = np.log(self.edges_dn_per_s / self.median_dn_per_s.value) / self.log_spread.value
        return np.asarray(self.pixels * self.fraction.value * np.diff(ndtr(place)))

    def to_dict(self) -> dict[str, Any]:
        """Return the estimates, the limit and the number of pixels above it, for JSON."""
        return {**super().to_dict(), "limit_dn_per_s": self.limit_dn_per_s, "above": self.above, "pixels": self.pixels}


NEARLY_SATURATED = 0.95
"""Fraction of the range up to saturation beyond which the longest dark frames do not tell the dark current of a pixel.
"""


def _measure(evidence: Evidence) -> DarkDistribution | Missing:
    chip, rate, parameters = evidence.chip, evidence.dark_rate_dn_per_s, evidence.parameters
    if chip is None:
        return NO_MAPS.missing(evidence.no_maps)
    if rate is None or chip.dark_rate_uncertainty_dn_per_s is None:
        return EFFECT_NOT_MEASURED.missing("the dark current has no map")
    frames = evidence.reduction.frames
    top = (1 << frames.bits) - 1.0
    if parameters.saturation_dn.value is not None:
        top = min(top, parameters.saturation_dn.value)
    longest_s = max(group.exposure_s for group in frames.of_kind("dark"))
    highest = NEARLY_SATURATED * (top - chip.black_level_dn) / longest_s
    return replace(
        dark_distribution(rate, chip.dark_rate_uncertainty_dn_per_s, highest),
        gain=parameters.system_gain_dn_per_e.uncertain,
        current_dn_per_s=parameters.dark_current_dn_per_s,
    )


EFFECT = Effect(20, _measure, key="dark_distribution", missing="absent", labels=DARK_DISTRIBUTION)


LEAST_PIXELS = 20
"""Smallest number of hot pixels from which their distribution is estimated."""
_CELLS, _NODES, _BINS = 240, 25, 100
"""Cells of the tail in its likelihood, quantiles of the other pixels that are added to it, bins of the histogram."""
_MOSTLY_SEEN = 0.3
"""Smallest fraction of the hot pixels above the limit, for which the distribution below it is known."""
_MISFIT_P_VALUE = 0.01
"""Probability of the tail's shape below which it is not log-normal."""
_WIDEST = 0.5
"""Largest relative uncertainty of the fraction."""


def dark_distribution(
    rate: NDArray[np.floating], uncertainty: NDArray[np.floating], highest: float = math.inf
) -> DarkDistribution:
    """Estimate the distribution of the dark current over the pixels.

    Parameters
    ----------
    rate, uncertainty
        Dark current of each pixel, DN/s, and its standard uncertainty.
    highest
        Dark current, DN/s, from which pixels are saturated; they count as at least this.

    Notes
    -----
    Above the limit, the number of pixels and their dark currents follow a log-normal distribution that is added to the
    dark current of an ordinary pixel; both are fitted by maximum likelihood. The limit lies 1.5 times as far from the
    median as the log-normal distribution with the quantiles 10, 50 and 90 % of all pixels reaches, and the noise,
    of which the lowest pixel is the measure.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> rate = 5 * rng.lognormal(0, 0.2, 40_000) + rng.normal(0, 0.5, 40_000)
    >>> rate[:400] += 100 * rng.lognormal(0, 1.0, 400)
    >>> found = dark_distribution(rate, np.full(40_000, 0.5))
    >>> [round(entry.value, 2) for entry in (found.fraction, found.log_spread)], round(found.dcnu_percent.value)
    ([0.01, 1.06], 20)
    """
    # Maps stay in single precision: of 100 megapixels, each copy in doubles would take 800 MB.
    values, noise = (np.asarray(one).ravel() for one in (rate, uncertainty))
    center, usual_noise = median(values), median(noise)
    limit = center + _reach(values, usual_noise)
    above = values > np.float64(limit)
    excess = values[above].astype(np.float64) - center
    count = int(above.sum())
    method = _METHOD.format(limit)
    top = float(values.max()) - center
    edges = np.geomspace(0.05 * (limit - center), max(1.01 * top, limit - center), _BINS + 1)
    counts = (np.histogram(values[piece].astype(np.float64) - center, edges)[0] for piece in pieces(values.size))
    histogram = np.sum(list(counts), axis=0)
    noise_square = _mean_square(noise[~above])
    body = values[~above]

    def result(
        fraction: Estimate, median_rate: Estimate, spread: Estimate, below: tuple[Uncertain, Uncertain]
    ) -> DarkDistribution:
        mean_rate, dcnu = _body(body, noise_square, *below)
        details = limit, count, values.size, center, usual_noise, edges, histogram
        return DarkDistribution(fraction, median_rate, spread, mean_rate, dcnu, *details)

    def without(reason: str) -> DarkDistribution:
        missing = Estimate(
            reason=f"{count} of {values.size} pixels lie above {limit:.3g} DN/s; {reason}", method=method
        )
        return result(missing, missing, missing, (Uncertain(0.0), Uncertain(0.0)))

    if count < LEAST_PIXELS:
        return without(f"the distribution of hot pixels needs {LEAST_PIXELS}")
    nodes = quantiles(body, (np.arange(_NODES) + 0.5) / _NODES) - center
    fit = _Tail(excess, limit - center, highest - center, values.size, nodes)
    best, covariance = fit.solve()
    if covariance is None or fit.seen(best) < _MOSTLY_SEEN or covariance[0, 0] > _WIDEST**2:
        return without("most hot pixels lie below, so that their distribution is not known")
    if fit.misfit(best) < _MISFIT_P_VALUE:
        return without("their dark current is not log-normal")
    found = [_logarithmic(float(x), math.sqrt(u2), method) for x, u2 in zip(best, np.diag(covariance), strict=True)]
    return result(found[0], found[1], found[2], fit.below(best, covariance))


def _logarithmic(x: float, u: float, method: str) -> Estimate:
    """Return the estimate of a value from that of its logarithm."""
    value = math.exp(x)
    ends = value * math.exp(-COVERAGE_95 * u), value * math.exp(COVERAGE_95 * u)
    return Estimate(value, value * u, method=method, interval_95=ends)


_LIMIT_RATIO = 1.5
"""Distance of the limit of hot pixels from the median, in units of the distance that no other pixel reaches."""


def _reach(values: NDArray[np.floating], usual_noise: float) -> float:
    """Return the distance above the median that only hot pixels reach."""
    from scipy.special import ndtri

    low, middle, high = quantiles(values, [0.1, 0.5, 0.9])
    below, over = middle - low, high - middle
    tenth, last = float(-ndtri(0.1)), float(-ndtri(0.1 / values.size))
    normal = over * last / tenth
    skewed = normal
    if over > below > 0.0:
        growth = math.log(over / below) / tenth  # of the logarithm, per standard deviation
        skewed = over * math.expm1(growth * last) / math.expm1(tenth * growth)
    return _LIMIT_RATIO * float(max(normal, skewed, float(middle - values.min()), 5.0 * usual_noise))


def _mean_square(values: NDArray[np.floating]) -> float:
    return mean(lambda piece: values[piece].astype(np.float64) ** 2, values.size)


def _body(
    body: NDArray[np.floating], noise_square: float, hot_mean: Uncertain, hot_variance: Uncertain
) -> tuple[Estimate, Estimate]:
    """Return mean and relative spread of the pixels below the limit, less what the hot ones among them add."""
    n = body.size
    center, spread = mean_and_deviation(lambda piece: body[piece], n)
    mean_rate = Uncertain.of(center, spread / math.sqrt(n)) - hot_mean
    of_squares = mean_and_deviation(lambda piece: (body[piece].astype(np.float64) - center) ** 2, n)
    sampling = Uncertain.of_variance(of_squares[0], of_squares[1] / math.sqrt(n))
    variance = sampling - noise_square - hot_variance
    mean_estimate = Estimate.of(mean_rate, "mean of the pixels without hot ones")
    what = "spread of the pixels' dark currents without hot ones, less their noise, over the mean"
    if mean_rate.value < 3.0 * mean_rate.standard_uncertainty:
        return mean_estimate, Estimate(reason="the dark current is not distinguishable from zero", method=what)
    return mean_estimate, Estimate.of_variance(variance * (100.0 / mean_rate.value) ** 2, what)


class _Tail:
    """Likelihood of the excess dark currents above a limit, in cells of a logarithmic axis.

    Parameters are the logarithms of fraction, median and spread. The others' dark currents, `nodes`, are added.
    """

    def __init__(self, excess: _Floats, limit: float, highest: float, pixels: int, nodes: _Floats) -> None:
        top = min(highest, 1.001 * float(excess.max()))
        edges = np.geomspace(limit, max(top, 1.001 * limit), _CELLS)
        self.edges = np.append(edges, np.inf)
        self.count = np.histogram(excess, np.append(edges, max(2.0 * float(excess.max()), 2.0 * edges[-1])))[0]
        self.pixels, self.nodes = pixels, nodes
        self.limit, self.excess = limit, excess

    def _below(self, median: float, spread: float) -> _Floats:
        """Return the fraction of hot pixels with an excess below each edge."""
        from scipy.special import ndtr

        hot = np.maximum(self.edges[:, None] - self.nodes, 1e-300)
        return np.asarray(ndtr((np.log(hot) - median) / spread).mean(axis=1))

    def seen(self, x: _Floats) -> float:
        """Return the fraction of hot pixels above the limit."""
        return 1.0 - float(self._below(x[1], math.exp(x[2]))[0])

    def negative(self, x: _Floats) -> float:
        """Return the negative logarithm of the likelihood."""
        fraction = np.diff(self._below(x[1], math.exp(x[2]))) * math.exp(min(x[0], 0.0))
        rest = 1.0 - fraction.sum()
        filled = self.count > 0
        if (fraction[filled] <= 0.0).any() or rest <= 0.0:
            return 1e12
        left = self.pixels - int(self.count.sum())
        return -float(self.count[filled] @ np.log(fraction[filled])) - left * math.log(rest)

    def solve(self) -> tuple[_Floats, _Floats | None]:
        """Return the best parameters and their covariance; None where the likelihood has no maximum."""
        from scipy.optimize import minimize

        logs = np.log(self.excess)
        spread = max(float(logs.std()), 0.1)
        start = np.array([math.log(self.excess.size / self.pixels), float(np.median(logs)), math.log(spread)])
        simplex = start + np.vstack([np.zeros(3), np.diag([0.3, 0.5 * spread, 0.3])])
        found = minimize(
            self.negative,
            start,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-5, "fatol": 1e-6},
        )
        best = np.asarray(found.x, np.float64)
        hessian, step = np.empty((3, 3)), 1e-3
        for i, j in np.ndindex(3, 3):
            a, b = np.eye(3)[i] * step, np.eye(3)[j] * step
            corners = (self.negative(best + s * a + t * b) * s * t for s in (-1, 1) for t in (-1, 1))
            hessian[i, j] = sum(corners) / (4.0 * step**2)
        if best[0] >= 0.0 or not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian)[0] <= 0.0:
            return best, None
        return best, np.asarray(np.linalg.inv(hessian), np.float64)

    def misfit(self, x: _Floats) -> float:
        """Return the probability of a distance from the fitted distribution as large as that of these excesses."""
        from scipy.special import kolmogorov

        below = self._below(x[1], math.exp(x[2]))
        fitted = (below[1:] - below[0]) / (1.0 - below[0])
        found = np.cumsum(self.count) / self.count.sum()
        return float(kolmogorov(np.abs(found - fitted).max() * math.sqrt(self.count.sum())))

    def below(self, x: _Floats, covariance: _Floats) -> tuple[Uncertain, Uncertain]:
        """Return what hot pixels below the limit add to the mean and to the variance of all pixels below it."""
        step = np.sqrt(np.diag(covariance))
        center = self._moments(x)
        slopes = [(self._moments(x + part) - self._moments(x - part)) / 2.0 for part in np.diag(step)]
        correlation = covariance / np.outer(step, step)
        mean_estimate, of_variance = (
            Uncertain.of(float(value), math.sqrt(float(slope @ correlation @ slope)))
            for value, slope in zip(center, np.array(slopes).T, strict=True)
        )
        return mean_estimate, of_variance

    def _moments(self, x: _Floats) -> _Floats:
        from scipy.special import ndtr

        fraction, median, spread = np.exp(x)
        place = (math.log(self.limit) - x[1]) / spread
        first, second = (
            fraction * median**k * math.exp(0.5 * (k * spread) ** 2) * float(ndtr(place - k * spread)) for k in (1, 2)
        )
        return np.array([first, second - first**2])
