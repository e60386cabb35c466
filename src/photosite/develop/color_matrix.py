"""The 3 x 3 matrix from camera RGB to XYZ under D65, fitted to patches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import delta_e_76, delta_e_94, delta_e_2000
from photosite.errors import InputError


@dataclass(frozen=True, eq=False)
class ColorMatrix:
    """A fitted color matrix and its color errors.

    Parameters
    ----------
    matrix
        (3, 3): XYZ under D65 = matrix @ camera RGB.
    delta_e_76, delta_e_94, delta_e_2000
        (patches,), difference between fitted and true color; the true color is the reference of CIE 1994.
    delta_e_76_left_out, delta_e_94_left_out, delta_e_2000_left_out
        (patches,), the same for a matrix fitted without that patch: the error to expect for other colors.
    """

    matrix: NDArray[np.float64]
    delta_e_76: NDArray[np.float64]
    delta_e_94: NDArray[np.float64]
    delta_e_2000: NDArray[np.float64]
    delta_e_76_left_out: NDArray[np.float64]
    delta_e_94_left_out: NDArray[np.float64]
    delta_e_2000_left_out: NDArray[np.float64]

    def apply(self, rgb: ArrayLike) -> NDArray[np.float64]:
        """Return XYZ, (..., 3), of (..., 3) camera RGB in the unit of the fit.

        Examples
        --------
        >>> fit_color_matrix(np.eye(4, 3) + 1, 2 * (np.eye(4, 3) + 1)).apply([1.0, 0.0, 0.0]).round(9) + 0.0
        array([2., 0., 0.])
        """
        return np.asarray(rgb, dtype=np.float64) @ self.matrix.T


def fit_color_matrix(rgb: ArrayLike, xyz: ArrayLike) -> ColorMatrix:
    """Fit the matrix with the least sum of squared differences in XYZ over the patches.

    All patches have the same weight, and no constant is fitted: black stays black.

    Parameters
    ----------
    rgb
        (patches, 3), linear camera red, green and blue, black at 0. Its unit is free (digital numbers, electrons,
        volts); the matrix includes it and the exposure.
    xyz
        (patches, 3), the patches under D65. Color differences need Y = 1 for the perfect white.

    Raises
    ------
    InputError
        If the shapes differ, there are fewer than four patches, or the camera's colors, with or without one patch, lie
        in a plane.

    Notes
    -----
    Ordinary least squares, as in Farrell, Okincha and Parmar (2008), section 3. The residual of a patch that is left
    out is that of the fit divided by 1 - h, with h its diagonal entry of the hat matrix (D. M. Allen, Technometrics
    16, 1974).

    Examples
    --------
    >>> camera = np.random.default_rng(1).uniform(0.1, 0.9, (24, 3))
    >>> truth = np.array([[0.4, 0.4, 0.2], [0.2, 0.7, 0.1], [0.0, 0.1, 1.0]])
    >>> fit = fit_color_matrix(camera, camera @ truth.T)
    >>> bool(np.allclose(fit.matrix, truth)), float(fit.delta_e_2000_left_out.max().round(6))
    (True, 0.0)
    """
    camera, target = np.asarray(rgb, dtype=np.float64), np.asarray(xyz, dtype=np.float64)
    if camera.ndim != 2 or camera.shape[1] != 3 or camera.shape != target.shape:
        raise InputError("rgb, xyz", value=(camera.shape, target.shape), expected="two arrays of shape (patches, 3)")
    if len(camera) < 4:
        raise InputError("rgb", value=f"{len(camera)} patches", expected="four patches or more")
    if not (np.isfinite(camera).all() and np.isfinite(target).all()):
        raise InputError("rgb, xyz", expected="finite")
    solution, _, rank, _ = np.linalg.lstsq(camera, target, rcond=None)
    if rank < 3:
        raise InputError("the camera RGB of the patches lie in a plane", hint="Add patches of other colors")
    basis, _ = np.linalg.qr(camera)
    leverage = np.sum(basis**2, axis=1)
    highest = int(np.argmax(leverage))
    if 1.0 - leverage[highest] < 1e-9:
        problem = f"without patch {highest} the camera RGB of the patches lie in a plane"
        raise InputError(problem, hint="Add patches of other colors")
    fitted = camera @ solution
    left_out = target - (target - fitted) / (1.0 - leverage[:, None])
    return ColorMatrix(
        matrix=np.asarray(solution.T, dtype=np.float64),
        delta_e_76=delta_e_76(fitted, target),
        delta_e_94=delta_e_94(target, fitted),
        delta_e_2000=delta_e_2000(fitted, target),
        delta_e_76_left_out=delta_e_76(left_out, target),
        delta_e_94_left_out=delta_e_94(target, left_out),
        delta_e_2000_left_out=delta_e_2000(left_out, target),
    )
