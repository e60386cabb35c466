"""Whether two cameras' patches differ by more than their noise lets them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.patches import PatchStatistics

Selection = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class ChiSquare:
    """A sum of squared standardised differences.

    Parameters
    ----------
    statistic
        The sum.
    degrees_of_freedom
        How many differences went in, less the parameters fitted to them: what the sum is on average where the two
        cameras are alike.
    p_value
        How often a sum as large or larger comes about where they are.
    """

    statistic: float
    degrees_of_freedom: int
    p_value: float

    @property
    def p_text(self) -> str:
        """The p-value in words, for no sum is known to more.

        Examples
        --------
        >>> ChiSquare(80.0, 72, 0.2431).p_text, ChiSquare(9e4, 72, 0.0).p_text
        ('p = 0.24', 'p < 1e-12')
        """
        return f"p = {self.p_value:.2g}" if self.p_value >= 1e-12 else "p < 1e-12"


def chi_square_of_means(
    measured: PatchStatistics, simulated: PatchStatistics, used: Selection, tolerance: float = 0.0, fitted: int = 0
) -> ChiSquare:
    """Do the patch means differ by more than their standard errors?

    A difference is divided by the standard errors of both means. These are estimates, so the quotient is
    Student's t, of Welch's degrees of freedom nu; its square is multiplied by (nu - 2) / nu to have the mean
    of 1 that chi-square asks for.

    Parameters
    ----------
    measured, simulated
        Statistics of the same patches.
    used
        (patches, channels), true where they count.
    tolerance
        Relative difference that is let pass: only what exceeds it counts.
    fitted
        Parameters of the simulation that were fitted to these means: each takes a degree of freedom.

    Returns
    -------
    ChiSquare

    Raises
    ------
    InputError
        If a patch has too few pixels for nu to exceed 2.

    Notes
    -----
    B. L. Welch, Biometrika 34, 1947. Two frames of one chip share their fixed pattern; the standard errors
    take the patterns as different, so for one and the same chip the p-value is too large, never too small.
    """
    error_m, error_s = measured.standard_error_dn[used] ** 2, simulated.standard_error_dn[used] ** 2
    pixels_m, pixels_s = measured.pixels[used], simulated.pixels[used]
    freedom = (error_m + error_s) ** 2 / (error_m**2 / (pixels_m - 1) + error_s**2 / (pixels_s - 1))
    if (freedom <= 2).any():
        raise InputError("patches hold too few pixels to be compared; widen the regions to 4 pixels of each channel")
    difference = np.abs(measured.mean_dn[used] - simulated.mean_dn[used])
    beyond = np.maximum(difference - tolerance * np.abs(simulated.mean_dn[used]), 0.0)
    return _sum_of(beyond**2 / (error_m + error_s) * (freedom - 2) / freedom, fitted)


def chi_square_of_noise(
    measured: PatchStatistics, simulated: PatchStatistics, used: Selection, tolerance: float = 0.0
) -> ChiSquare:
    """Do the variances over the pixels of a frame differ by more than their standard errors?

    Parameters
    ----------
    measured, simulated, used
        As for `chi_square_of_means`.
    tolerance
        Relative difference of standard deviations that is let pass.

    Returns
    -------
    ChiSquare

    Raises
    ------
    InputError
        If patches have so few pixels that their noise differs without an error to measure it by.

    Notes
    -----
    The standard errors come from the scatter over pixels, so no distribution is assumed, nor how much of the noise is
    fixed pattern, which the frames of a stack share. As for the means, the two chips' patterns are taken as different:
    for one and the same chip the p-value is too large. A patch without noise in both counts as alike.
    """
    return _of_variances(
        (measured.spatial_noise_dn[used], measured.spatial_variance_error_dn2[used]),
        (simulated.spatial_noise_dn[used], simulated.spatial_variance_error_dn2[used]),
        tolerance,
    )


def chi_square_of_temporal_noise(
    measured: PatchStatistics, simulated: PatchStatistics, used: Selection, tolerance: float = 0.0
) -> ChiSquare | None:
    """Do the variances of pixels from frame to frame differ by more than their standard errors?

    Unlike the noise over pixels, this one does not see unevenness of the light.

    Parameters
    ----------
    measured, simulated, used, tolerance
        As for `chi_square_of_noise`.

    Returns
    -------
    ChiSquare or None
        None unless both have two frames or more.

    Raises
    ------
    InputError
        As `chi_square_of_noise`.

    Notes
    -----
    The standard errors come from the scatter of the pixels' variances, so no distribution is assumed.
    """
    sides = []
    for found in (measured, simulated):
        if found.temporal_noise_dn is None or found.temporal_variance_error_dn2 is None:
            return None
        sides.append((found.temporal_noise_dn[used], found.temporal_variance_error_dn2[used]))
    return _of_variances(sides[0], sides[1], tolerance)


_NoiseWithError = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Standard deviations, and standard errors of their squares."""


def _of_variances(measured: _NoiseWithError, simulated: _NoiseWithError, tolerance: float) -> ChiSquare:
    (noise_m, error_m), (noise_s, error_s) = measured, simulated
    error = np.hypot(error_m, error_s)
    allowed = ((1.0 + tolerance) ** 2 - 1.0) * noise_s**2
    beyond = np.maximum(np.abs(noise_m**2 - noise_s**2) - allowed, 0.0)
    if ((error == 0) & (beyond > 0)).any():
        raise InputError("patches hold too few pixels for their noise to be compared; widen the regions")
    squares = np.zeros_like(beyond)
    np.divide(beyond, error, out=squares, where=error > 0)
    return _sum_of(squares**2)


def _sum_of(squares: NDArray[np.float64], fitted: int = 0) -> ChiSquare:
    from scipy.stats import chi2

    total, freedom = float(squares.sum()), int(squares.size) - fitted
    if freedom < 1:
        raise InputError(f"{squares.size} patch means cannot test a simulation with {fitted} fitted parameters")
    return ChiSquare(total, freedom, float(chi2.sf(total, freedom)))
