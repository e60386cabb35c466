"""Noise that neighboring pixels of even parts of a picture share, from periodograms."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.plane_fit import without_plane
from photosite.values.region import Patch, Region
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_LEAST_SIDE = 8
"""Samples along each axis below which a part has no spectrum at low frequencies."""


def inner_box(patch: Patch) -> Region:
    """Return the largest rectangle of a patch's proportions around its center that is inside of it."""
    inside = patch.inside()
    rows, cols = inside.shape
    for share in np.linspace(1.0, 0.3, 36):
        r, c = int(rows * (1 - share) / 2), int(cols * (1 - share) / 2)
        if inside[r : rows - r, c : cols - c].all():
            return Region(patch.name, patch.r0 + r, patch.r1 - r, patch.c0 + c, patch.c1 - c)
    raise InputError("shape", where=f"patch '{patch.name}'", expected="with a rectangle inside")


def low_lines(values: Array) -> NDArray[np.complex128]:
    """Return the (..., 8) Fourier coefficients of (..., rows, cols) values at the lowest frequencies off the axes.

    A plane through the values has its power on the axes, so that these are the same with and without it.
    """
    lines = np.fft.fft2(values)[..., [1, 2, -1, -2], :][..., 1:3]
    return np.asarray(lines.reshape(*lines.shape[:-2], -1))


@dataclass(frozen=True)
class SharedNoise(Shown):
    """How many pixels share their noise, on average; both are 1 for independent pixels.

    Parameters
    ----------
    of_mean
        Variance of the mean of many pixels, over that of independent ones: the sum of the correlations.
    of_variance
        The same of their variance, over that of independent pixels of normal noise.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=(50, 60, 60))
    >>> pairs = (noise[:, 1:] + noise[:, :-1]) / 2  # correlations of 0.5 with two neighbors
    >>> found = SharedNoise.of(pairs)
    >>> abs(found.of_mean - 2.0) < 0.3, abs(found.of_variance - 1.5) < 0.3
    (True, True)
    """

    of_mean: float = 1.0
    of_variance: float = 1.0

    @classmethod
    def of(cls, parts: Iterable[Array]) -> SharedNoise:
        """Return the mean over even parts of an image, each (rows, cols) values of its own mean, slope and noise.

        The variance of a mean is the power at the lowest frequencies over the number of pixels. That of the variance is
        so for the squares of the deviations; interpolated pixels have another noise than those that are kept.
        """
        found = []
        for part in parts:
            if min(part.shape) < _LEAST_SIDE:
                continue
            flat = without_plane(part.reshape(1, -1), *np.indices(part.shape).reshape(2, -1)).reshape(part.shape)
            if (variance := float((flat**2).mean())) <= _NOISELESS * float((part**2).mean()):
                continue
            low, of_squares = (
                float((np.abs(low_lines(each)) ** 2).mean()) / part.size for each in (flat, flat**2 - variance)
            )
            found.append((low / variance, of_squares / (2.0 * variance**2)))
        return cls(*np.mean(found, axis=0).tolist()) if found else cls()


_NOISELESS = 1e-20
