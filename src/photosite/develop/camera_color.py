"""Color of a camera: white balance, and the matrix from camera RGB to XYZ under D65."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import delta_e_76, delta_e_94, delta_e_2000
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.values.shown import Shown

_EXAMPLE = {"white_balance": [2.0, 1.0, 1.5]}


def gray_world_gains(rgb: ArrayLike, left_out: ArrayLike | None = None, reference: int = 1) -> NDArray[np.float64]:
    """Return the gains that scale the means of all channels to that of one, by default green.

    Parameters
    ----------
    rgb
        (rows, cols, channels), linear, black at 0; R, G and B or others.
    left_out
        (rows, cols), true at pixels to exclude, such as saturated ones (`saturated_neighbourhood`). None includes all.
    reference
        Index of the channel whose gain is 1.

    Returns
    -------
    numpy.ndarray
        (channels,), factors; that of the reference is 1.

    Raises
    ------
    InputError
        If all pixels are excluded, or a channel's mean is not above black.

    References
    ----------
    G. Buchsbaum, "A spatial processor model for object color perception", J. Franklin Institute 310, 1980.

    Examples
    --------
    >>> gray_world_gains(np.full((4, 4, 3), [0.5, 0.25, 0.125]))
    array([0.5, 1. , 2. ])
    """
    values = np.asarray(rgb)
    if values.ndim != 3:
        raise InputError("rgb", value=values.shape, expected="of shape (rows, cols, channels)")
    if left_out is None:
        means = values.mean(axis=(0, 1), dtype=np.float64)
    else:
        counted = ~np.asarray(left_out, dtype=np.bool_)
        if counted.shape != values.shape[:2]:
            raise InputError("left_out", value=counted.shape, expected=f"of shape {values.shape[:2]}")
        if not counted.any():
            hint = "Pass {white_balance}, or expose for less"
            raise InputError("gray world finds no pixel that is not saturated", hint=hint, arguments=_EXAMPLE)
        means = np.array([values[..., k].mean(dtype=np.float64, where=counted) for k in range(values.shape[2])])
    if not (means > 0).all():
        raise InputError(
            "mean above black of the channels",
            where="gray world",
            value=[round(float(m), 4) for m in means],
            expected="above 0",
            hint="Check the black level, or pass {white_balance}",
            arguments=_EXAMPLE,
        )
    return np.asarray(means[reference] / means, dtype=np.float64)


def saturated_neighbourhood(raw: RawFrame) -> NDArray[np.bool_]:
    """Return the pixels with a saturated pixel, at or above `white_level_dn`, in their 3 x 3 neighborhood.

    Examples
    --------
    >>> dn = np.zeros((4, 4), np.uint16)
    >>> dn[0, 0] = 4095
    >>> int(saturated_neighbourhood(RawFrame(dn, bits=12)).sum())
    4
    """
    saturated = raw.dn >= raw.white_level_dn
    near = saturated.copy()
    near[1:] |= saturated[:-1]
    near[:-1] |= saturated[1:]
    tall = near.copy()
    near[:, 1:] |= tall[:, :-1]
    near[:, :-1] |= tall[:, 1:]
    return near


@dataclass(frozen=True, eq=False)
class ColorMatrix(Shown):
    """A fitted color matrix and its color errors.

    Parameters
    ----------
    matrix
        (3, channels): XYZ under D65 = matrix @ camera channels.
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
        """Return XYZ, (..., 3), of (..., channels) camera values in the unit of the fit.

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
        (patches, channels), linear camera red, green and blue, or three or more other channels, black at 0. Its unit is
        free (digital numbers, electrons, volts); the matrix includes it and the exposure.
    xyz
        (patches, 3), the patches under D65. Color differences need Y = 1 for the perfect white.

    Raises
    ------
    InputError
        If the shapes differ, there are fewer patches than channels and one, or the camera's colors, with or without one
        patch, lie in a plane.

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
    if camera.ndim != 2 or camera.shape[1] < 3 or target.shape != (len(camera), 3):
        expected = "of shapes (patches, 3 or more channels) and (patches, 3)"
        raise InputError("rgb, xyz", value=(camera.shape, target.shape), expected=expected)
    channels = camera.shape[1]
    if len(camera) <= channels:
        raise InputError("rgb", value=f"{len(camera)} patches", expected=f"{channels + 1} patches or more")
    if not (np.isfinite(camera).all() and np.isfinite(target).all()):
        raise InputError("rgb, xyz", expected="finite")
    solution, _, rank, _ = np.linalg.lstsq(camera, target, rcond=None)
    if rank < channels:
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
