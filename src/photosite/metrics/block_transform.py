"""Whether a picture was compressed with loss before: coefficients of its blocks that are multiples of a step."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import srgb_from_light

Array = NDArray[np.float64]

_BLOCK, _SIDE = 8, 768
"""Pixels along a block of JPEG, and along the middle of the picture that is searched."""
_LUMA = np.array([0.299, 0.587, 0.114])
"""Of red, green and blue codes (JFIF, ITU-R BT.601)."""
_LOWEST, _STEPS = 4, range(2, 31)
"""Sum of the frequencies of a coefficient, at most, and the steps that are looked for, in codes."""
_LEAST_COUNT, _COEFFICIENTS = 50, 3
_SCORE, _RATIO = 8.0, 2.0
"""Score from which coefficients are multiples of a step, and its least ratio to that of blocks elsewhere: patterns of
a few levels have a score in any blocks."""
_ELSEWHERE = ((3, 5), (4, 2))


def quantization_step(picture: Array) -> float | None:
    """Return the step of the third most evident coefficient of a picture's blocks, in codes; None where none is.

    The picture is (rows, cols, 3) linear sRGB, and begins with a block. A coefficient of independent values has a
    random phase in a step, or a phase near half of one: the density of coefficients falls from 0 on, and those below
    half a step are left out. So its score is a normal variable with a mean of 0 or below.

    References
    ----------
    Z. Fan and R. L. de Queiroz, "Identification of bitmap compression history: JPEG detection and quantizer
    estimation", IEEE Trans. Image Process. 12 (2003) 230.

    Examples
    --------
    >>> noise = np.random.default_rng(0).uniform(0.2, 0.8, (64, 64, 3))
    >>> quantization_step(noise) is None
    True
    """
    score, step = _evident(picture, (0, 0))
    if score < _SCORE or score < _RATIO * max(_evident(picture, away)[0] for away in _ELSEWHERE):
        return None
    return step


def _evident(picture: Array, first: tuple[int, int]) -> tuple[float, float]:
    """Return score and step of the third most evident coefficient of the blocks from a pixel on."""
    found = sorted((_score(each) for each in _coefficients(picture, first)), reverse=True)
    return found[_COEFFICIENTS - 1]


def _coefficients(picture: Array, first: tuple[int, int]) -> list[Array]:
    """Return the coefficients of low frequency of the blocks that are not clipped."""
    from scipy.fft import dctn

    (r0, rows), (c0, cols) = (
        (start + max(size - start - _SIDE, 0) // 2 // _BLOCK * _BLOCK, min(size - start, _SIDE) // _BLOCK)
        for start, size in zip(first, picture.shape[:2], strict=True)
    )
    part = picture[r0 : r0 + rows * _BLOCK, c0 : c0 + cols * _BLOCK]
    codes = np.rint(srgb_from_light(np.clip(part, 0.0, 1.0)) * 255.0) @ _LUMA
    blocks = codes.reshape(rows, _BLOCK, cols, _BLOCK).transpose(0, 2, 1, 3).reshape(-1, _BLOCK, _BLOCK)
    inside = (blocks.min(axis=(1, 2)) > 1.0) & (blocks.max(axis=(1, 2)) < 254.0)
    found = dctn(blocks[inside], axes=(1, 2), norm="ortho")
    low = range(_LOWEST + 1)
    return [found[:, i, j] for i in low for j in low if 0 < i + j <= _LOWEST]


def _score(values: Array) -> tuple[float, float]:
    """Return the largest score of the steps, and its step."""
    best = 0.0, 0.0
    size = np.abs(values)
    for step in _STEPS:
        used = values[size > 0.5 * step]
        if used.size >= _LEAST_COUNT:
            score = float(np.cos(2.0 * math.pi / step * used).sum()) * math.sqrt(2.0 / used.size)
            best = max(best, (score, float(step)))
    return best
