"""Means of an even field over a grid of cells, with the uncertainty that the noise of pixels leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.plane_fit import without_plane
from photosite.values.cfa import channel_sites, shifted
from photosite.values.region import Region
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_PARTS = 4
"""Parts of a cell along each axis, whose scatter gives the uncertainty of its mean. Noise may be correlated in them."""
_LEAST_TILES, _LEAST_PIXELS, _BORDER = 2, 8, 2
"""Along each axis of a part: tiles of the color filter array, or pixels of a picture; and pixels at each side of such a
part that are left out, because interpolation makes them alike with those of the next part."""
_FREEDOM = _PARTS**2 - 3
_CLIPPED_FRACTION = 1e-3
_DEGREES = (4, 6, 8, 10)
_RAISED_BELOW_P_VALUE = 0.3
"""Of the fall of the misfit; a small one keeps polynomials that are off by less than noise, but more than intervals."""
_ACCEPTED_P_VALUE = 0.01
_LEAST_SIGNAL = 5.0
"""Mean of a cell in standard uncertainties from which there is light."""


@dataclass(frozen=True, eq=False)
class Cells(Shown):
    """Means over an odd number of cells along each axis, of a channel or of a function of several channels.

    Parameters
    ----------
    row, col
        Centers of the cells, in pixels of the frame.
    parts
        (n, m, 16) means of the parts of each cell.
    relative_variance
        (n, m), to which the variance of the noise is proportional; None: the mean, as for shot noise.
    """

    row: Array
    col: Array
    parts: Array
    relative_variance: Array | None = None

    @property
    def mean(self) -> Array:
        """(n, m) means."""
        return np.asarray(self.parts.mean(axis=-1))

    @cached_property
    def variance(self) -> Array:
        """(n, m) variance of the means, from the scatter of the parts about a plane.

        Its size is that of the median cell, which a few defective pixels do not move.
        """
        from scipy.special import chdtri

        y, x = np.indices((_PARTS, _PARTS)).reshape(2, -1) - (_PARTS - 1) / 2
        square = (without_plane(self.parts, y, x) ** 2).sum(axis=-1)
        relative = self.mean if self.relative_variance is None else self.relative_variance
        size = float(np.median(square / relative)) / float(chdtri(_FREEDOM, 0.5))
        rounding = 1e-24 * (self.mean**2).max() + 1e-300
        return np.asarray(size * relative / _PARTS**2 + rounding)

    @cached_property
    def smooth_halves(self) -> Array:
        """(2, cells) smoothed means of two halves of the pixels; their covariance is twice that of `smooth`."""
        even = np.indices((_PARTS, _PARTS)).sum(axis=0).ravel() % 2 == 0
        halves = np.stack([self.parts[..., half].mean(axis=-1).ravel() for half in (even, ~even)])
        return np.asarray(halves @ self.smoother.T)

    @property
    def shape(self) -> tuple[int, int]:
        """Cells down and across."""
        return self.row.size, self.col.size

    @property
    def center(self) -> int:
        """Index of the cell in the middle, along the rows."""
        return (self.row.size // 2) * self.col.size + self.col.size // 2

    @cached_property
    def smoother(self) -> Array:
        """(cells, cells) matrix that fits a polynomial to the means; the unit matrix where none agrees with them.

        The degree is raised while that lowers the misfit by more than noise does. Cells that differ from a polynomial
        by more than noise have means that are known well enough.
        """
        y, x = (2.0 * (np.arange(n) + 0.5) / n - 1.0 for n in self.shape)
        weight = 1.0 / self.variance.ravel()
        values = self.mean.ravel()
        found: tuple[Array, float, int] = (np.eye(values.size), math.inf, 0)
        for degree in _DEGREES:
            terms = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
            if degree >= min(self.shape) or 2 * len(terms) > values.size:
                break
            legendre = [np.polynomial.legendre.legvander(at, degree) for at in (y, x)]
            model = np.stack([np.outer(legendre[0][:, i], legendre[1][:, j]).ravel() for i, j in terms], axis=1)
            fit = model @ np.linalg.solve(model.T @ (weight[:, None] * model), model.T * weight)
            misfit = float(weight @ (values - fit @ values) ** 2)
            if _p_value(found[1] - misfit, len(terms) - found[2]) > _RAISED_BELOW_P_VALUE:
                break
            found = fit, misfit, len(terms)
        agrees = _p_value(found[1], values.size - found[2]) > _ACCEPTED_P_VALUE
        return np.asarray(found[0]) if agrees else np.eye(values.size)

    @cached_property
    def smooth(self) -> Array:
        """(cells,) means after smoothing."""
        return np.asarray(self.smoother @ self.mean.ravel())

    @cached_property
    def covariance(self) -> Array:
        """(cells, cells) covariance of `smooth`."""
        return np.asarray((self.smoother * self.variance.ravel()) @ self.smoother.T)


def _p_value(square: float, freedom: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(freedom, square))


def field_cells(image: ChartImage, region: Region, channel: str, across: int) -> Cells:
    """Return the means of a channel over a grid of cells.

    Parameters
    ----------
    image, region, channel
        The part of an even field that is measured, and the channel.
    across
        Cells along the longer side; fewer in a small region, and always an odd number.

    Raises
    ------
    InputError
        If the region is too small for three cells along each axis, dark, or saturated.
    """
    tile = ((channel,),) if image.origin == "picture" else shifted(image.cfa, region.r0, region.c0)
    height, width = len(tile), len(tile[0])
    tiles = region.shape[0] // height, region.shape[1] // width
    plane = image.plane(channel, region)[0]
    picture = image.origin == "picture"
    border = _BORDER if picture else 0
    counts = _cell_counts(tiles, across, _LEAST_PIXELS if picture else _LEAST_TILES)
    edges = [np.linspace(0, n, _PARTS * count + 1).astype(int) for n, count in zip(tiles, counts, strict=True)]
    ends = [np.stack([edge[:-1] + border, edge[1:] - border], axis=1) for edge in edges]
    parts: Array = np.zeros((edges[0].size - 1, edges[1].size - 1))
    clipped = empty = 0.0
    sites = channel_sites(tile, channel)
    for r, c in sites:
        site = plane[r : tiles[0] * height : height, c : tiles[1] * width : width]
        clipped += float((site >= image.white - image.black).mean()) / len(sites)
        empty += float((site <= -image.black).mean()) / len(sites)
        used = site[: ends[0][-1, 1], : ends[1][-1, 1]]
        down, along = (each.ravel()[:-1] for each in ends)
        sums = np.add.reduceat(np.add.reduceat(used, down, axis=0)[::2], along, axis=1)[:, ::2]
        parts += sums / np.outer(*(np.diff(each, axis=1) for each in ends)) / len(sites)
    if clipped > _CLIPPED_FRACTION:
        hint = "Use a shorter exposure"
        raise InputError(f"fraction of saturated {channel} pixels", value=clipped, expected="at most 0.001", hint=hint)
    if empty > _CLIPPED_FRACTION and image.origin != "electrons":
        hint = "Take frames of an even bright field"
        raise InputError(f"fraction of {channel} pixels at 0", value=empty, expected="at most 0.001", hint=hint)
    row, col = (
        first + period * (_part_centers(edge) - 0.5) + np.mean([at[k] for at in sites]) + 0.5
        for k, (first, period, edge) in enumerate(zip((region.r0, region.c0), (height, width), edges, strict=True))
    )
    by_cell = parts.reshape(counts[0], _PARTS, counts[1], _PARTS).swapaxes(1, 2).reshape(*counts, -1)
    cells = Cells(row, col, by_cell)
    if not (cells.mean > 0).all() or not (cells.mean > _LEAST_SIGNAL * np.sqrt(cells.variance)).all():
        hint = "Take frames of an even bright field"
        raise InputError(f"signal of channel {channel}", expected="above its noise everywhere", hint=hint)
    return cells


def _part_centers(edges: NDArray[np.int_]) -> Array:
    """Return the mean of the centers of the parts of each cell."""
    return np.asarray(((edges[:-1] + edges[1:]) / 2).reshape(-1, _PARTS).mean(axis=1))


def _cell_counts(tiles: tuple[int, int], across: int, least: int) -> tuple[int, int]:
    most = [n // (_PARTS * least) for n in tiles]
    longer = min(across, max(most))
    down, along = (min(round(longer * n / max(tiles)), limit) for n, limit in zip(tiles, most, strict=True))
    if min(down, along) < 3:
        expected = f"{3 * _PARTS * least} or more along each axis"
        raise InputError("tiles of the color filters, or pixels of a picture", value=tiles, expected=expected)
    return down - 1 + down % 2, along - 1 + along % 2
