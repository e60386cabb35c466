"""Statistics of a gain series: scale of the settings, conversion-gain switch, and the two parts of read noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.fit import Fit, fit_linear

Array = NDArray[np.float64]


FEWEST_SETTINGS = 5
"""Smallest number of settings in which a switch can be distinguished from scatter."""

LEAST_STEP = math.log(1.2)
"""Smallest step in gain per setting (logarithm) that alone counts as a switch. Nominal settings are inexact."""


SettingScale = Literal["proportional", "tenths of a decibel", "decibels"]

_DECIBEL = math.log(10.0) / 20.0


def log_amplification(settings: Array, scale: SettingScale) -> Array:
    """Return the natural logarithm of the amplification of settings, up to a constant.

    ISO numbers and plain gains are proportional to the amplification. Some machine-vision and astronomy cameras use
    decibels or tenths of a decibel.

    Examples
    --------
    >>> np.exp(log_amplification(np.array([0.0, 200.0]), "tenths of a decibel")).round(12).tolist()
    [1.0, 10.0]
    """
    if scale == "proportional":
        return np.log(settings)
    return settings * (_DECIBEL if scale == "decibels" else 0.1 * _DECIBEL)


def find_setting_scale(settings: Array, gain: Array) -> SettingScale:
    """Return the scale that explains the measured gains best, with one free step for a conversion-gain switch.

    Examples
    --------
    >>> find_setting_scale(np.array([100.0, 200.0, 400.0]), np.array([0.1, 0.21, 0.4]))
    'proportional'
    >>> find_setting_scale(np.array([0.0, 60.0, 120.0]), np.array([0.1, 0.2, 0.4]))
    'tenths of a decibel'
    """
    scales: tuple[SettingScale, ...] = ("proportional", "tenths of a decibel", "decibels")
    allowed = scales if settings.min() > 0 else scales[1:]

    def left(scale: SettingScale) -> float:
        rest = np.log(gain) - log_amplification(settings, scale)
        if len(rest) < 4:
            return _scatter(rest)
        return min(_scatter(rest[:k]) + _scatter(rest[k:]) for k in range(1, len(rest)))

    return min(allowed, key=left)


def _scatter(values: Array) -> float:
    return float(np.sum((values - values.mean()) ** 2))


@dataclass(frozen=True)
class StepTest:
    """Test for a step between any two neighboring settings.

    Parameters
    ----------
    p_value
        Probability, without any step, of one as significant as the best, over all positions (Bonferroni).
    split
        Index of the first setting above the best step.
    step, step_uncertainty, deviance
        (n - 1,) size of a step before setting 1, 2, ..., and -2 log likelihood of each position.
    """

    p_value: float
    split: int
    step: Array
    step_uncertainty: Array
    deviance: Array


def step_in_gain(log_gain_per_setting: Array, variance: Array) -> StepTest:
    """Test whether the gain per unit of amplification steps up at some setting.

    The model has one level on each side, weighted by the sampling variance of the logarithms, ln K - ln amplification,
    and by the scatter of nominal settings (`fit_linear`). The step divided by its uncertainty follows Student's t with
    n - 2 degrees of freedom, one-sided.
    """
    y, n = log_gain_per_setting, len(log_gain_per_setting)
    step, uncertainty, deviance = [], [], []
    for k in range(1, n):
        design = np.column_stack([np.ones(n), np.arange(n) >= k]).astype(np.float64)
        fit = fit_linear(design, y, np.diag(variance))
        step.append(float(fit.parameters[1]))
        uncertainty.append(math.sqrt(fit.covariance[1, 1]))
        deviance.append(_deviance(design, y, variance, fit))
    return _tested(step, uncertainty, n - 2, deviance)


def step_in_read_noise(noise: ReadNoise) -> StepTest:
    """Test whether the pre-amplifier read noise, in electrons, steps down at some setting.

    The model is sigma_dn^2 = A K^2 + B with different A below and above the step. The drop in A divided by its
    uncertainty follows Student's t with n - 3 degrees of freedom, one-sided. The fit allows a relative scatter about
    the model.
    """
    n = len(noise.gain)
    drop, uncertainty, deviance = [], [], []
    for k in range(1, n):
        above = np.arange(n) >= k
        squares = noise.gain**2
        columns = np.column_stack([np.where(above, 0.0, squares), np.where(above, squares, 0.0), np.ones(n)])
        fit, design, variance = noise.fit(columns)
        drop.append(fit.parameters[0] - fit.parameters[1])
        cov = fit.covariance
        uncertainty.append(math.sqrt(cov[0, 0] + cov[1, 1] - 2 * cov[0, 1]))
        deviance.append(_deviance(design, np.ones(n), variance, fit))
    return _tested(drop, uncertainty, n - 3, deviance)


def _tested(steps: list[float], uncertainties: list[float], freedom: int, deviance: list[float]) -> StepTest:
    from scipy.stats import t as student

    step, uncertainty = np.array(steps), np.array(uncertainties)
    chances = student.sf(step / uncertainty, freedom)
    best = int(np.argmin(chances))
    p_value = min(1.0, len(step) * float(chances[best]))
    return StepTest(p_value, best + 1, step, uncertainty, np.array(deviance))


def _deviance(design: Array, y: Array, variance: Array, fit: Fit) -> float:
    total = variance + fit.extra_variance
    residual = y - design @ fit.parameters
    return float(np.sum(residual**2 / total + np.log(total)))


@dataclass(frozen=True)
class ReadNoise:
    """Read noise at the settings of a series.

    Parameters
    ----------
    gain, gain_uncertainty
        (n,) system gain, DN per electron.
    variance_dn2, variance_uncertainty
        (n,) squared read noise, above 0, without rounding.
    """

    gain: Array
    gain_uncertainty: Array
    variance_dn2: Array
    variance_uncertainty: Array

    def __getitem__(self, index: slice) -> ReadNoise:
        return ReadNoise(
            self.gain[index], self.gain_uncertainty[index], self.variance_dn2[index], self.variance_uncertainty[index]
        )

    def fit(self, columns: Array) -> tuple[Fit, Array, Array]:
        """Fit the relative variances by linear least squares; all columns but the last belong to A K^2 terms.

        The uncertainty of the gains enters as the effective variance (2 A K u(K))^2 of the previous fit. Also returns
        the design (n, p) and the sampling variances (n,), in relative units.
        """
        design = columns / self.variance_dn2[:, None]
        sampling = (self.variance_uncertainty / self.variance_dn2) ** 2
        variance = sampling
        for _ in range(3):
            fit = fit_linear(design, np.ones(len(sampling)), np.diag(variance))
            slope = columns[:, :-1] @ fit.parameters[:-1] / self.gain  # A K of each point
            variance = sampling + (2.0 * slope * self.gain_uncertainty / self.variance_dn2) ** 2
        return fit_linear(design, np.ones(len(sampling)), np.diag(variance)), design, variance

    def two_parts(self) -> Fit:
        """Fit A (electrons^2) and B (DN^2) in sigma_dn^2 = A K^2 + B."""
        fit, _, _ = self.fit(np.column_stack([self.gain**2, np.ones(len(self.gain))]))
        return fit


@dataclass(frozen=True)
class Switch:
    """A conversion-gain switch among settings.

    Parameters
    ----------
    split, first, last
        Index of the first setting above the switch; the same for the ends of the 95 % range of its position.
    p_value, seen_in
        Probability of such evidence without a switch; the evidence: "read noise", "gain per setting" or both.
    """

    split: int
    first: int
    last: int
    p_value: float
    seen_in: tuple[str, ...]


FALSE_ALARMS = 0.01
"""Fraction of series without a conversion-gain switch in which one may be found."""
_POSITION_95 = 3.841458820694124
"""Largest increase in deviance within the 95 % range of a position: chi-square, one degree of freedom."""


def find_switch(gain_step: StepTest, noise_step: StepTest | None) -> Switch | None:
    """Find a conversion-gain switch.

    A switch has two signs, and a camera may show either: the pre-amplifier noise in electrons falls, and the gain per
    unit of setting rises. If the manufacturer lowers the amplifier gain at the switch, so that settings stay
    proportional to the gain, only the noise shows it. Each sign is tested at half of `FALSE_ALARMS`. A step in gain
    alone must also exceed the inaccuracy of nominal settings (`LEAST_STEP`). `noise_step` is None if the read noise
    could not be measured.
    """
    seen: dict[str, StepTest] = {}
    if gain_step.p_value < FALSE_ALARMS / 2 and gain_step.step[gain_step.split - 1] > LEAST_STEP:
        seen["gain per setting"] = gain_step
    if noise_step is not None and noise_step.p_value < FALSE_ALARMS / 2:
        seen["read noise"] = noise_step
    if not seen:
        return None
    deviance = np.sum([test.deviance for test in seen.values()], axis=0)
    possible = np.flatnonzero(deviance <= deviance.min() + _POSITION_95)
    split, first, last = (int(index) + 1 for index in (np.argmin(deviance), possible[0], possible[-1]))
    p_value = min(1.0, 2.0 * min(test.p_value for test in seen.values()))
    return Switch(split, first, last, p_value, tuple(seen))
