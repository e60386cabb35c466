"""The 3 x 3 matrix from camera RGB to tristimulus values under D65, fitted to patches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.difference import delta_e_76, delta_e_94, delta_e_2000
from photosite.errors import InputError


@dataclass(frozen=True, eq=False)
class ColorMatrix:
    """A fitted colour matrix, and how well it does.

    Parameters
    ----------
    matrix
        (3, 3): XYZ under D65 = matrix @ camera RGB.
    delta_e_76, delta_e_94, delta_e_2000
        (patches,), between what the matrix makes of each patch and its true colour, which is CIE 1994's reference.
    delta_e_76_left_out, delta_e_94_left_out, delta_e_2000_left_out
        (patches,), the same for a matrix fitted without that patch: what to expect of colours that were not
        fitted.
    """

    matrix: NDArray[np.float64]
    delta_e_76: NDArray[np.float64]
    delta_e_94: NDArray[np.float64]
    delta_e_2000: NDArray[np.float64]
    delta_e_76_left_out: NDArray[np.float64]
    delta_e_94_left_out: NDArray[np.float64]
    delta_e_2000_left_out: NDArray[np.float64]

    def apply(self, rgb: ArrayLike) -> NDArray[np.float64]:
        """Tristimulus values, (..., 3), of (..., 3) camera RGB in the unit of the fit.

        Examples
        --------
        >>> fit_color_matrix(np.eye(4, 3) + 1, 2 * (np.eye(4, 3) + 1)).apply([1.0, 0.0, 0.0]).round(9) + 0.0
        array([2., 0., 0.])
        """
        return np.asarray(rgb, dtype=np.float64) @ self.matrix.T


def fit_color_matrix(rgb: ArrayLike, xyz: ArrayLike) -> ColorMatrix:
    """The matrix with the least summed squared difference in XYZ over the patches.

    Every patch weighs the same, and no constant is fitted: black stays black. The scale of `rgb` is free
    (digital numbers, electrons, volts) and goes into the matrix, with the exposure. The scale of `xyz` is
    not: colour differences need Y = 1 for the perfect white.

    Parameters
    ----------
    rgb
        (patches, 3), linear camera red, green and blue, black at 0.
    xyz
        (patches, 3), the patches under D65, Y = 1 for the perfect white under D65.

    Returns
    -------
    ColorMatrix

    Raises
    ------
    InputError
        If the shapes differ, fewer than four patches are given, the camera's colours lie in a plane, or one
        patch alone holds a direction of them, so that leaving it out leaves nothing to fit.

    Notes
    -----
    Ordinary least squares, as in Farrell, Okincha and Parmar (2008), section 3. Leaving a patch out needs no
    second fit: its residual is the fit's divided by 1 - h, h its diagonal entry of the hat matrix (D. M.
    Allen, Technometrics 16, 1974).

    Examples
    --------
    >>> camera = np.random.default_rng(1).uniform(0.1, 0.9, (24, 3))
    >>> truth = np.array([[0.4, 0.4, 0.2], [0.2, 0.7, 0.1], [0.0, 0.1, 1.0]])
    >>> fit = fit_color_matrix(camera, camera @ truth.T)
    >>> bool(np.allclose(fit.matrix, truth)), float(fit.delta_e_2000_left_out.max().round(6))
    (True, 0.0)
    """
    camera, wanted = np.asarray(rgb, dtype=np.float64), np.asarray(xyz, dtype=np.float64)
    if camera.ndim != 2 or camera.shape[1] != 3 or camera.shape != wanted.shape:
        raise InputError(
            f"a colour matrix is fitted to (patches, 3) RGB and as many XYZ, not {camera.shape} and {wanted.shape}"
        )
    if len(camera) < 4:
        raise InputError(f"a colour matrix needs four patches or more, not {len(camera)}")
    if not (np.isfinite(camera).all() and np.isfinite(wanted).all()):
        raise InputError("a colour matrix is fitted to finite RGB and XYZ")
    solution, _, rank, _ = np.linalg.lstsq(camera, wanted, rcond=None)
    if rank < 3:
        raise InputError("the patches' camera RGB lie in a plane, so no 3 x 3 matrix is the best; add other colours")
    basis, _ = np.linalg.qr(camera)
    leverage = np.sum(basis**2, axis=1)
    lonely = int(np.argmax(leverage))
    if 1.0 - leverage[lonely] < 1e-9:
        raise InputError(
            f"without patch {lonely} the others' camera RGB lie in a plane, so the fit cannot be checked "
            "by leaving it out; add other colours"
        )
    fitted = camera @ solution
    left_out = wanted - (wanted - fitted) / (1.0 - leverage[:, None])
    return ColorMatrix(
        matrix=np.asarray(solution.T, dtype=np.float64),
        delta_e_76=delta_e_76(fitted, wanted),
        delta_e_94=delta_e_94(wanted, fitted),
        delta_e_2000=delta_e_2000(fitted, wanted),
        delta_e_76_left_out=delta_e_76(left_out, wanted),
        delta_e_94_left_out=delta_e_94(wanted, left_out),
        delta_e_2000_left_out=delta_e_2000(left_out, wanted),
    )
