"""Smooth, positive responses from few measurements, with intervals that include what the measurements cannot determine.

The prior of the response is a Gaussian process, truncated at zero. Its values have one standard deviation and are
correlated over some length, continuous in slope but not in curvature (Matern 3/2), because the edges of color filters
bend sharply. Standard deviation, length, and the relative error of the light are unknown. Every combination on a grid
is weighted by its marginal likelihood (C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine
Learning", 2006, 5.4), so that the result includes their uncertainty. Posterior draws, kept positive by exact
Hamiltonian Monte Carlo, give mean, covariance and intervals.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.truncated_normal import positive_normal_draws
from photosite.errors import InputError

Array = NDArray[np.float64]

LENGTHS_NM = tuple(np.geomspace(15.0, 50.0, 6).tolist())
"""Correlation lengths of the grid.

None is longer than 50 nm: a length that suits the smooth parts of a response makes the intervals at its edges too
narrow.
"""

SPREADS = tuple(np.geomspace(0.25, 8.0, 6).tolist())
"""Standard deviations of the prior on the grid, in units of the response's mean over the light."""

MISFITS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
"""Relative errors of the light on the grid: errors of reflectances and spectra beyond their stated uncertainty."""

_BURN_IN = 20
"""Draws of each chain that are left out, because they depend on its start."""
_PROBABILITY = 0.95  # of the intervals
_JITTER = 1e-9
"""Fraction of the prior's variance added to the diagonal, so that the Cholesky factor exists."""


@dataclass(frozen=True, eq=False)
class SmoothEstimate:
    """An estimated response.

    Parameters
    ----------
    wavelength_nm, mean, covariance
        (n,), (n,) and (n, n): wavelengths, and the posterior there.
    lower_95, upper_95
        (n,) shortest interval with 95 % of the posterior at each wavelength. It starts at 0 if 0 is plausible.
    length_nm, spread, misfit
        Posterior means of correlation length, prior standard deviation and relative error of the light.
    determined
        Number of independent parameters that the measurements determine; the prior determines the others.
    """

    wavelength_nm: Array
    mean: Array
    covariance: Array
    lower_95: Array
    upper_95: Array
    length_nm: float
    spread: float
    misfit: float
    determined: float


@dataclass(frozen=True, eq=False)
class _Setting:
    """One combination of length, spread and misfit: its evidence, and the normal posterior."""

    length_nm: float
    spread: float
    misfit: float
    log_evidence: float
    axes: Array
    pulled: Array
    keep: Array

    @property
    def mean(self) -> Array:
        return np.asarray(self.spread**2 * (self.axes @ (self.keep * self.pulled)))

    @property
    def factor(self) -> Array:
        """Factor of the posterior's covariance: factor @ factor.T."""
        return np.asarray(self.spread * self.axes * np.sqrt(self.keep))

    @property
    def determined(self) -> float:
        return float(np.sum(1.0 - self.keep))


def smooth_positive_estimate(
    design: Array,
    measured: Array,
    covariance: Array,
    wavelength_nm: Array,
    *,
    relative: Array | None = None,
    groups: NDArray[np.int64] | None = None,
    seed: int = 0,
    draws: int = 4000,
) -> SmoothEstimate:
    """Estimate the response q >= 0 in measured = design @ q + noise.

    Parameters
    ----------
    design
        (m, n) measurements that a response of 1 at each single wavelength would produce.
    measured, covariance
        (m,) and (m, m), positive definite.
    wavelength_nm
        (n,), increasing.
    relative
        (m, m) covariance of additional relative errors, such as those of a light's level. The part common to all
        measurements is a factor of the response and widens the result as such. As noise, it would pull the response
        down, because the prior prefers small values. The rest is scaled by the expected values of a first fit instead
        of the measured values, which would also bias the response down (R. W. Peelle's puzzle; G. D'Agostini, Nucl.
        Instrum. Methods A 346 (1994) 306).
    groups
        (m,) integers. Measurements of one group, such as a patch under several lights, share half of the variance due
        to errors of the light. None: the light is exact, and no misfit is estimated.
    seed, draws
        Seed and number of the posterior draws.

    Raises
    ------
    InputError
        If shapes do not match, a number is not finite, or the sum of the measurements is not above 0.

    Examples
    --------
    >>> nm = np.arange(400.0, 701.0, 10.0)
    >>> truth = np.exp(-0.5 * ((nm - 550.0) / 40.0) ** 2)
    >>> design = np.exp(-0.5 * ((nm - np.arange(400.0, 701.0, 30.0)[:, None]) / 20.0) ** 2)
    >>> found = smooth_positive_estimate(design, design @ truth, 1e-4 * np.eye(11), nm)
    >>> bool(abs(found.mean - truth).max() < 0.05), bool((found.lower_95 >= 0).all())
    (True, True)
    """
    _check(design, measured, covariance, wavelength_nm)
    settings = list(_settings(design, measured, (covariance,), wavelength_nm))
    common = 0.0
    if relative is not None:
        common = _common_part(relative)
        relative = relative - common
    if relative is not None or groups is not None:
        first = sum(w * setting.mean for w, setting in zip(_weights(settings), settings, strict=True))
        noises = _noises(covariance, design @ first, relative, groups)
        settings = list(_settings(design, measured, noises, wavelength_nm))
    weights = _weights(settings)
    chance = np.random.default_rng([seed, 41])
    # Systematic resampling: the number of draws of each setting is proportional to its weight, to within one.
    places = (np.arange(draws) + chance.uniform()) / draws
    chosen = np.searchsorted(np.cumsum(weights), places).clip(max=len(settings) - 1)
    counts = np.bincount(chosen, minlength=len(settings))
    chains = []
    for setting, count in zip(settings, counts, strict=True):
        if count:
            momenta = chance.standard_normal((_BURN_IN + count, wavelength_nm.size))
            chains.append(positive_normal_draws(setting.mean, setting.factor, momenta)[_BURN_IN:])
    sample = np.concatenate(chains)
    # Common relative error: a log-normal factor of mean 1, which is never negative.
    spread = np.log1p(common)
    sample *= np.exp(np.sqrt(spread) * chance.standard_normal((len(sample), 1)) - 0.5 * spread)
    lower, upper = _shortest(sample)

    def mean_of(name: str) -> float:
        return float(weights @ [getattr(setting, name) for setting in settings])

    return SmoothEstimate(
        wavelength_nm=wavelength_nm,
        mean=sample.mean(axis=0),
        covariance=np.cov(sample, rowvar=False).reshape(wavelength_nm.size, wavelength_nm.size),
        lower_95=lower,
        upper_95=upper,
        length_nm=mean_of("length_nm"),
        spread=mean_of("spread"),
        misfit=mean_of("misfit"),
        determined=mean_of("determined"),
    )


def _check(design: Array, measured: Array, covariance: Array, wavelength_nm: Array) -> None:
    m, n = design.shape
    if measured.shape != (m,) or covariance.shape != (m, m) or wavelength_nm.shape != (n,):
        raise InputError(
            "the shapes of measured, covariance and wavelength_nm",
            value=(measured.shape, covariance.shape, wavelength_nm.shape),
            expected=f"{((m,), (m, m), (n,))} for a design of shape {design.shape}",
        )
    if not all(np.isfinite(values).all() for values in (design, measured, covariance)):
        raise InputError("design, measured and covariance", expected="finite")
    if not (design.sum() > 0 and measured.sum() > 0):
        hint = "The measurements contain no light"
        raise InputError("the sums of design and measured", expected="above 0", hint=hint)


def _matern(wavelength_nm: Array, length_nm: float) -> Array:
    """Correlation (1 + s) exp(-s), s = sqrt(3) distance / length."""
    scaled = np.sqrt(3.0) * np.abs(wavelength_nm[:, None] - wavelength_nm) / length_nm
    return np.asarray((1.0 + scaled) * np.exp(-scaled) + _JITTER * np.eye(wavelength_nm.size))


def _weights(settings: list[_Setting]) -> Array:
    """Return the normalized marginal likelihoods (settings,)."""
    evidence = np.array([setting.log_evidence for setting in settings])
    weights = np.exp(evidence - evidence.max())
    return np.asarray(weights / weights.sum())


def _common_part(relative: Array) -> float:
    """Return the largest variance common to all; the rest is still a valid covariance."""
    scale = float(np.trace(relative)) / len(relative)
    if scale == 0.0:
        return 0.0
    ones = np.ones(len(relative))
    # With the levels of lights alone the matrix is singular. A billionth of its size on the diagonal regularizes it.
    return 1.0 / float(ones @ np.linalg.solve(relative + 1e-9 * scale * np.eye(len(relative)), ones))


def _noises(
    covariance: Array, expected: Array, relative: Array | None, groups: NDArray[np.int64] | None
) -> tuple[Array, ...]:
    """Return the covariance of the measurements, one for each misfit of the grid."""
    products = np.outer(expected, expected)
    known = covariance if relative is None else covariance + relative * products
    if groups is None:
        return (known,)
    alike = 0.5 * np.eye(expected.size) + 0.5 * (groups[:, None] == groups[None, :])
    return tuple(known + misfit**2 * products * alike for misfit in MISFITS)


def _settings(design: Array, measured: Array, noises: tuple[Array, ...], wavelength_nm: Array) -> Iterator[_Setting]:
    """Yield every combination of the grid, with evidence and posterior of the normal model before truncation."""
    unit = float(measured.sum() / design.sum())
    roots = {length: np.linalg.cholesky(_matern(wavelength_nm, length)) for length in LENGTHS_NM}
    for misfit, covariance in zip(MISFITS, noises, strict=False):
        noise = np.linalg.cholesky(covariance)
        light, seen = np.linalg.solve(noise, design), np.linalg.solve(noise, measured)
        constant = -0.5 * float(seen @ seen) - float(np.log(np.diag(noise)).sum())
        for length, root in roots.items():
            through = light @ root
            information, turn = np.linalg.eigh(through.T @ through)
            information = np.clip(information, 0.0, None)  # negative values are rounding errors
            pulled, axes = turn.T @ (through.T @ seen), root @ turn
            for relative in SPREADS:
                spread = relative * unit
                keep = 1.0 / (1.0 + spread**2 * information)
                evidence = constant + 0.5 * float(np.sum(spread**2 * keep * pulled**2) + np.sum(np.log(keep)))
                yield _Setting(length, spread, misfit, evidence, axes, pulled, keep)


def _shortest(sample: Array) -> tuple[Array, Array]:
    """Return, per column, the shortest interval with 95 % of the draws; from 0 if it would begin at the lowest draw."""
    ordered = np.sort(sample, axis=0)
    inside = int(np.ceil(_PROBABILITY * len(ordered)))
    width = ordered[inside - 1 :] - ordered[: len(ordered) - inside + 1]
    first = np.argmin(width, axis=0)
    columns = np.arange(ordered.shape[1])
    lower = np.where(first == 0, 0.0, ordered[first, columns])
    return lower, ordered[first + inside - 1, columns]
