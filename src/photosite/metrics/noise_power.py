"""The power spectrum of noise: mean periodogram of blocks of even parts of a frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.values.shown import Shown
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]

LOWEST_BIN = 3
"""Bins from zero frequency that polynomials and window leave as they are."""
_AXIS_BINS = 2
"""Bins beside an axis from which the window keeps the power of the axis away."""
_ALIKE = 35.0 / 18.0
"""Variance of a mean over bins along an axis, over that of independent ones: n sum w^4 / (sum w^2)^2 of the window."""
_COHERENT = 2.0 / 3.0
"""(sum w)^2 / (n sum w^2) of the window."""


@dataclass(frozen=True, eq=False)
class NoisePower(Shown):
    """The power spectrum of noise.

    Parameters
    ----------
    power
        (n, n) variance per unit area of frequencies in cycles/pixel, zero frequency in the middle; its integral over
        the frequencies is the variance. NaN where trends were removed.
    period
        Pixels from one sample to the next.
    periodograms
        Number of independent ones that the mean is of.
    blocks
        Down and across a plane.
    scatter
        (n, n) standard deviation of one periodogram; None: the power.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(0, 2, (512, 512))
    >>> found = noise_power([noise], 1, 64)
    >>> round(found.mean().value, 1)
    4.0
    """

    power: Array
    period: int
    periodograms: float
    blocks: tuple[int, int]
    scatter: Array | None = None

    @cached_property
    def frequency(self) -> Array:
        """(n,) frequencies of rows and columns, in cycles/pixel."""
        size = len(self.power)
        return np.fft.fftshift(np.fft.fftfreq(size, self.period))

    @cached_property
    def radius(self) -> Array:
        """(n, n) radial frequencies over the Nyquist frequency of the samples."""
        across = 2.0 * self.period * self.frequency
        return np.asarray(np.hypot(across[:, None], across))

    @cached_property
    def _plain(self) -> NDArray[np.bool_]:
        """(n, n) where the spectrum is measured: no trends, and no axes, which lines with noise of their own raise."""
        near = np.abs(np.arange(len(self.power)) - len(self.power) // 2) < _AXIS_BINS
        return np.isfinite(self.power) & ~(near[:, None] | near)

    def mean(self, low: float = 0.0, high: float = np.inf) -> Uncertain:
        """Return the mean over radial frequencies, given over the Nyquist frequency; axes are left out."""
        inside = self._plain & (self.radius > low) & (self.radius <= high)
        values = self.power[inside]
        if not values.size:
            raise InputError("frequencies", value=(low, high), expected="of the spectrum")
        # A value of one periodogram has its own mean as its standard deviation; half of the values are conjugates.
        scatter = values if self.scatter is None else self.scatter[inside]
        spread = np.sqrt(2.0 * _ALIKE**2 / self.periodograms * float(scatter @ scatter)) / values.size
        return Uncertain.of(float(values.mean()), spread)

    def radial(self) -> tuple[Array, Array, Array]:
        """Return frequencies in cycles/pixel, means over rings, and their standard uncertainties."""
        size = len(self.power)
        edges = np.arange(LOWEST_BIN, size // 2 + 1, max(size // 64, 1)) * (2.0 / size)
        means = [self.mean(*pair) for pair in pairwise(edges)]
        centers = 0.25 * (edges[1:] + edges[:-1]) / self.period
        return centers, np.array([m.value for m in means]), np.array([m.standard_uncertainty for m in means])

    def line_variance(self, axis: int) -> Uncertain:
        """Return the variance of what all samples of a row (0) or column (1) share, beyond the noise around it."""
        size = len(self.power)
        middle = size // 2
        power, scatter = (
            each if axis == 0 else each.T for each in (self.power, self.power if self.scatter is None else self.scatter)
        )
        shown = np.abs(np.arange(size) - middle) >= LOWEST_BIN
        on, beside = ([middle + step for step in steps] for steps in ((0,), (-3, -2, 2, 3)))
        excess = float(power[shown][:, on].mean() - power[shown][:, beside].mean())
        # Blocks side by side share their lines.
        squares = [float((scatter[shown][:, at] ** 2).mean()) / (shown.sum() * len(at)) for at in (on, beside)]
        square = squares[0] * _ALIKE * self.blocks[1 - axis] + squares[1] * _ALIKE**2
        area = size * self.period**2 * _COHERENT
        return Uncertain.of(excess / area, np.sqrt(2.0 * square / self.periodograms) / area)


def noise_power(planes: Iterable[Array], period: int, size: int, freedom: float = 1.0) -> NoisePower:
    """Return the mean periodogram of blocks of planes, after a polynomial of degree 2 is removed from each.

    Parameters
    ----------
    planes
        Of (rows, cols) samples.
    period
        Pixels from one sample to the next.
    size
        Samples of a block along each axis.
    freedom
        Independent planes over planes: less than 1 for the deviations of a few frames from their mean.

    Raises
    ------
    InputError
        If a plane is smaller than a block.

    References
    ----------
    IEC 62220-1:2003, 6.3.2, with a Hann window on each block: without one, noise at low frequencies leaks to high ones.
    """
    line = np.linspace(-1.0, 1.0, size)
    y, x = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    trend = np.linalg.qr(np.column_stack([np.ones_like(x), x, y, x * y, x**2, y**2]))[0]
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(size) + 0.5) / size)
    window = np.outer(hann, hann) / np.sqrt(np.mean(hann**2)) ** 2
    total: Array = np.zeros((size, size))
    count = rows = cols = 0
    for plane in planes:
        rows, cols = (n // size for n in plane.shape)
        if min(rows, cols) < 1:
            raise InputError("samples", value=plane.shape, expected=f"{size} or more along each axis")
        blocks = plane[: rows * size, : cols * size].reshape(rows, size, cols, size).swapaxes(1, 2)
        flat = blocks.reshape(-1, size * size)
        flat = flat - (flat @ trend) @ trend.T
        total += (np.abs(np.fft.fft2(flat.reshape(-1, size, size) * window)) ** 2).sum(axis=0)
        count += rows * cols
    power = np.fft.fftshift(total) / (count * freedom) * (period / size) ** 2
    near = np.abs(np.arange(size) - size // 2) < LOWEST_BIN
    power[np.ix_(near, near)] = np.nan
    return NoisePower(power, period, count * freedom, (rows, cols))
