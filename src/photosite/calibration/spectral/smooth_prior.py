"""A smooth, positive response from few measurements of it, with an interval that says what they cannot tell.

The response at the wavelengths is a Gaussian process, cut off at zero: before anything is measured, its values are
normal, of one spread, and correlated over some length, with a slope but no curvature (Matern, 3/2), because edges of
colour filters bend sharply. Spread and length, and how far the measurements' known light is off, are not known: every
combination on a grid counts with its marginal likelihood (C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes
for Machine Learning", 2006, 5.4), so that their uncertainty is in the result. Draws from that posterior, positive by
exact Hamiltonian Monte Carlo, give means, covariance and intervals.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.truncated_normal import positive_normal_draws
from photosite.errors import InputError

LENGTHS_NM = tuple(np.geomspace(15.0, 50.0, 6).tolist())
"""Correlation lengths tried. None is longer: the empty parts of a response are smooth, its edges are not, and a length
that suits the first makes intervals at the second too narrow."""

SPREADS = tuple(np.geomspace(0.25, 8.0, 6).tolist())
"""Spreads tried, in units of the response's mean over the light."""

MISFITS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
"""Relative errors of the known light tried: what reflectances and spectra may be off beyond what was said."""

_BURN_IN = 20
_PROBABILITY = 0.95
_JITTER = 1e-9
"""Of the prior's variance: independent from wavelength to wavelength, so that its factor exists in floating point."""


@dataclass(frozen=True, eq=False)
class SmoothEstimate:
    """A response as estimated.

    Parameters
    ----------
    wavelength_nm
        (n,).
    mean, covariance
        (n,) and (n, n) of the posterior.
    lower_95, upper_95
        (n,) the shortest interval with 95 % of the posterior, wavelength by wavelength; it begins near 0 where nothing
        speaks against 0.
    length_nm, spread, misfit
        Posterior means of the correlation length, the prior's spread, and the relative error of the known light.
    determined
        How many independent numbers about the response the measurements told (effective parameters); the rest is the
        prior's.
    """

    wavelength_nm: NDArray[np.float64]
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    lower_95: NDArray[np.float64]
    upper_95: NDArray[np.float64]
    length_nm: float
    spread: float
    misfit: float
    determined: float


@dataclass(frozen=True, eq=False)
class _Setting:
    """One combination of length, spread and misfit: its evidence, and the normal posterior under it."""

    length_nm: float
    spread: float
    misfit: float
    log_evidence: float
    axes: NDArray[np.float64]
    pulled: NDArray[np.float64]
    keep: NDArray[np.float64]

    @property
    def mean(self) -> NDArray[np.float64]:
        return np.asarray(self.spread**2 * (self.axes @ (self.keep * self.pulled)))

    @property
    def factor(self) -> NDArray[np.float64]:
        """Of the posterior's covariance: factor @ factor.T."""
        return np.asarray(self.spread * self.axes * np.sqrt(self.keep))

    @property
    def determined(self) -> float:
        return float(np.sum(1.0 - self.keep))


def smooth_positive_estimate(
    design: NDArray[np.float64],
    measured: NDArray[np.float64],
    covariance: NDArray[np.float64],
    wavelength_nm: NDArray[np.float64],
    *,
    relative: NDArray[np.float64] | None = None,
    groups: NDArray[np.int64] | None = None,
    seed: int = 0,
    draws: int = 4000,
) -> SmoothEstimate:
    """The response q >= 0 behind measured = design @ q + noise.

    Parameters
    ----------
    design
        (m, n): what a response of 1 at each wavelength alone would make each measurement read.
    measured, covariance
        (m,) and (m, m), positive definite.
    wavelength_nm
        (n,), increasing.
    relative
        (m, m) covariance of relative errors, of a light's level say, in addition. The part that is common to all
        measurements is a factor of the response and widens it as such; were it among the noise, the prior would trade
        it for a lower response, which needs less spread at every wavelength. The rest is scaled by what a first fit
        expects to be measured, not by what was: noise in both would pull the response down too (R. W. Peelle's puzzle;
        G. D'Agostini, Nucl. Instrum. Methods A 346 (1994) 306).
    groups
        (m,) integers: measurements of one group (one patch under several lights) share half of the variance that an
        error of the known light gives them. None: nothing is wrong with it, and no misfit is tried.
    seed
        Key of the draws; the same seed gives the same numbers.
    draws
        From the posterior.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, or the measurements have no sum above 0.

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
    # Systematic resampling: each setting gets its share of the draws, to within one.
    places = (np.arange(draws) + chance.uniform()) / draws
    chosen = np.searchsorted(np.cumsum(weights), places).clip(max=len(settings) - 1)
    counts = np.bincount(chosen, minlength=len(settings))
    chains = []
    for setting, count in zip(settings, counts, strict=True):
        if count:
            momenta = chance.standard_normal((_BURN_IN + count, wavelength_nm.size))
            chains.append(positive_normal_draws(setting.mean, setting.factor, momenta)[_BURN_IN:])
    sample = np.concatenate(chains)
    # A factor that is never negative: log-normal, of mean 1.
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


def _check(
    design: NDArray[np.float64],
    measured: NDArray[np.float64],
    covariance: NDArray[np.float64],
    wavelength_nm: NDArray[np.float64],
) -> None:
    m, n = design.shape
    if measured.shape != (m,) or covariance.shape != (m, m) or wavelength_nm.shape != (n,):
        raise InputError(
            f"{m} x {n} of a design want {m} measurements with covariance and {n} wavelengths, not {measured.shape}, "
            f"{covariance.shape} and {wavelength_nm.shape}"
        )
    if not all(np.isfinite(values).all() for values in (design, measured, covariance)):
        raise InputError("measurements, their covariance and the light must be finite numbers")
    if not (design.sum() > 0 and measured.sum() > 0):
        raise InputError("the measurements sum to nothing above 0: no light was seen, so no response can be told")


def _matern(wavelength_nm: NDArray[np.float64], length_nm: float) -> NDArray[np.float64]:
    """Correlation (1 + s) exp(-s), s = sqrt(3) distance / length."""
    scaled = np.sqrt(3.0) * np.abs(wavelength_nm[:, None] - wavelength_nm) / length_nm
    return np.asarray((1.0 + scaled) * np.exp(-scaled) + _JITTER * np.eye(wavelength_nm.size))


def _weights(settings: list[_Setting]) -> NDArray[np.float64]:
    """(settings,) marginal likelihoods, of sum 1."""
    evidence = np.array([setting.log_evidence for setting in settings])
    weights = np.exp(evidence - evidence.max())
    return np.asarray(weights / weights.sum())


def _common_part(relative: NDArray[np.float64]) -> float:
    """The largest variance that all have in common: what is left without it is still a covariance."""
    scale = float(np.trace(relative)) / len(relative)
    if scale == 0.0:
        return 0.0
    ones = np.ones(len(relative))
    # Lights' levels alone make a matrix of low rank; a billionth of its size on the diagonal lets it be solved.
    return 1.0 / float(ones @ np.linalg.solve(relative + 1e-9 * scale * np.eye(len(relative)), ones))


def _noises(
    covariance: NDArray[np.float64],
    expected: NDArray[np.float64],
    relative: NDArray[np.float64] | None,
    groups: NDArray[np.int64] | None,
) -> tuple[NDArray[np.float64], ...]:
    """Covariance of the measurements, one for each misfit tried."""
    products = np.outer(expected, expected)
    known = covariance if relative is None else covariance + relative * products
    if groups is None:
        return (known,)
    alike = 0.5 * np.eye(expected.size) + 0.5 * (groups[:, None] == groups[None, :])
    return tuple(known + misfit**2 * products * alike for misfit in MISFITS)


def _settings(
    design: NDArray[np.float64],
    measured: NDArray[np.float64],
    noises: tuple[NDArray[np.float64], ...],
    wavelength_nm: NDArray[np.float64],
) -> Iterator[_Setting]:
    """Every combination on the grid. Evidence and posterior are those of the normal model, before it is cut off."""
    unit = float(measured.sum() / design.sum())
    roots = {length: np.linalg.cholesky(_matern(wavelength_nm, length)) for length in LENGTHS_NM}
    for misfit, covariance in zip(MISFITS, noises, strict=False):
        noise = np.linalg.cholesky(covariance)
        light, seen = np.linalg.solve(noise, design), np.linalg.solve(noise, measured)
        constant = -0.5 * float(seen @ seen) - float(np.log(np.diag(noise)).sum())
        for length, root in roots.items():
            through = light @ root
            told, turn = np.linalg.eigh(through.T @ through)
            told = np.clip(told, 0.0, None)  # rounding alone makes one negative
            pulled, axes = turn.T @ (through.T @ seen), root @ turn
            for relative in SPREADS:
                spread = relative * unit
                keep = 1.0 / (1.0 + spread**2 * told)
                evidence = constant + 0.5 * float(np.sum(spread**2 * keep * pulled**2) + np.sum(np.log(keep)))
                yield _Setting(
                    length, spread, misfit, evidence,
                    axes, pulled, keep,
                )  # fmt: skip


def _shortest(sample: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Per column, the shortest interval that holds 95 % of it; from 0 where it would begin at the lowest draw."""
    ordered = np.sort(sample, axis=0)
    inside = int(np.ceil(_PROBABILITY * len(ordered)))
    width = ordered[inside - 1 :] - ordered[: len(ordered) - inside + 1]
    first = np.argmin(width, axis=0)
    columns = np.arange(ordered.shape[1])
    lower = np.where(first == 0, 0.0, ordered[first, columns])
    return lower, ordered[first + inside - 1, columns]
