"""White balance: gains that make a neutral surface come out neutral."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError

if TYPE_CHECKING:
    from photosite.frames.raw_frame import RawFrame


def gray_world_gains(rgb: ArrayLike, left_out: ArrayLike | None = None) -> NDArray[np.float64]:
    """Gains that bring the means of red and blue to that of green.

    Parameters
    ----------
    rgb
        (rows, cols, 3), linear, black at 0.
    left_out
        (rows, cols), true at pixels that shall not count: a saturated channel has stopped following the
        light, so its share of the mean would be wrong. `saturated_neighbourhood` finds them. None counts all.

    Returns
    -------
    numpy.ndarray
        (3,), to multiply red, green and blue; green's is 1.

    Raises
    ------
    InputError
        If no pixel is left, or a channel's mean is not above black.

    Notes
    -----
    G. Buchsbaum, "A spatial processor model for object colour perception", J. Franklin Institute 310, 1980.

    Examples
    --------
    >>> gray_world_gains(np.full((4, 4, 3), [0.5, 0.25, 0.125]))
    array([0.5, 1. , 2. ])
    """
    values = np.asarray(rgb)
    if values.ndim != 3 or values.shape[2] != 3:
        raise InputError(f"gray world needs (rows, cols, 3), not an array of shape {values.shape}")
    if left_out is None:
        means = values.mean(axis=(0, 1), dtype=np.float64)
    else:
        counted = ~np.asarray(left_out, dtype=np.bool_)
        if counted.shape != values.shape[:2]:
            raise InputError(f"left_out must be {values.shape[:2]}, one per pixel, not {counted.shape}")
        if not counted.any():
            raise InputError(
                "gray world: every pixel is saturated or left out, so nothing says what gray is; "
                "give white_balance as three gains, or expose for less"
            )
        means = np.array([values[..., k].mean(dtype=np.float64, where=counted) for k in range(3)])
    if not (means > 0).all():
        raise InputError(
            "gray world: the mean above black must be positive in red, green and blue, not "
            f"{', '.join(f'{m:.4g}' for m in means)}; check the black level, or give three gains"
        )
    return np.asarray(means[1] / means, dtype=np.float64)


def saturated_neighbourhood(raw: RawFrame) -> NDArray[np.bool_]:
    """Pixels whose bilinear neighbourhood (3 x 3) holds a saturated pixel.

    Parameters
    ----------
    raw
        The frame; a pixel at or above `white_level_dn` is saturated.

    Returns
    -------
    numpy.ndarray
        (rows, cols).

    Examples
    --------
    >>> from photosite.frames.raw_frame import RawFrame
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
