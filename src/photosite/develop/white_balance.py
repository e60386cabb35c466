"""White balance: gains that make neutral surfaces neutral."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame

_EXAMPLE = {"white_balance": [2.0, 1.0, 1.5]}


def gray_world_gains(rgb: ArrayLike, left_out: ArrayLike | None = None) -> NDArray[np.float64]:
    """Return the gains that scale the means of red and blue to that of green.

    Parameters
    ----------
    rgb
        (rows, cols, 3), linear, black at 0.
    left_out
        (rows, cols), true at pixels to exclude, such as saturated ones (`saturated_neighbourhood`). None includes all.

    Returns
    -------
    numpy.ndarray
        (3,), factors for red, green and blue; that of green is 1.

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
    if values.ndim != 3 or values.shape[2] != 3:
        raise InputError("rgb", value=values.shape, expected="of shape (rows, cols, 3)")
    if left_out is None:
        means = values.mean(axis=(0, 1), dtype=np.float64)
    else:
        counted = ~np.asarray(left_out, dtype=np.bool_)
        if counted.shape != values.shape[:2]:
            raise InputError("left_out", value=counted.shape, expected=f"of shape {values.shape[:2]}")
        if not counted.any():
            hint = "Pass {white_balance}, or expose for less"
            raise InputError("gray world finds no pixel that is not saturated", hint=hint, arguments=_EXAMPLE)
        means = np.array([values[..., k].mean(dtype=np.float64, where=counted) for k in range(3)])
    if not (means > 0).all():
        raise InputError(
            "mean above black of R, G, B",
            where="gray world",
            value=[round(float(m), 4) for m in means],
            expected="above 0",
            hint="Check the black level, or pass {white_balance}",
            arguments=_EXAMPLE,
        )
    return np.asarray(means[1] / means, dtype=np.float64)


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
