"""From a mosaic to one plane per channel, by bilinear interpolation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.values.cfa import Cfa, channel_names

_NEIGHBOURS: tuple[tuple[int, int, float], ...] = tuple(
    (dr, dc, 2.0 if 0 in (dr, dc) else 1.0) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0)
)
"""(row step, column step, weight): the bilinear kernel without its centre."""


def plane_names(cfa: Cfa) -> tuple[str, ...]:
    """The order of a demosaiced picture's planes: R, G, B, or the tile's reading order for other channels.

    Examples
    --------
    >>> plane_names((("G", "B"), ("R", "G"))), plane_names((("M",),))
    (('R', 'G', 'B'), ('M',))
    """
    names = channel_names(cfa)
    return ("R", "G", "B") if set(names) == {"R", "G", "B"} else names


def demosaic_bilinear(mosaic: ArrayLike, cfa: Cfa) -> NDArray[np.float32]:
    """Interpolate every channel of a mosaic to every pixel.

    A pixel keeps its own channel as it is. Another channel there is the mean of that channel's pixels among
    the eight neighbours, weighted 2 beside and above or below and 1 along the diagonals. At the borders the
    mean is over the neighbours that exist: nothing is wrapped or mirrored. A channel that is constant comes
    out constant everywhere; one that is linear in row and column comes out linear except in the outermost
    rows and columns.

    Parameters
    ----------
    mosaic
        (rows, cols), any real numbers.
    cfa
        The colour filter array's tile.

    Returns
    -------
    numpy.ndarray
        (rows, cols, channels) float32, planes in the order of `plane_names(cfa)`; one plane for a monochrome
        chip.

    Raises
    ------
    InputError
        If the mosaic is not two-dimensional, or some pixel has no neighbour of some channel.

    Notes
    -----
    The bilinear kernel of a Bayer mosaic, written for any tile; see B. K. Gunturk et al., "Demosaicking:
    color filter array interpolation", IEEE Signal Processing Magazine 22(1), 2005. Its result is linear in
    the mosaic.

    Examples
    --------
    >>> planes = demosaic_bilinear([[1, 2, 1], [4, 8, 4], [1, 2, 1]], (("R", "G"), ("G", "B")))
    >>> planes[1, 1], planes[0, 1]
    (array([1., 3., 8.], dtype=float32), array([1., 2., 8.], dtype=float32))
    """
    values = np.asarray(mosaic, dtype=np.float32)
    if values.ndim != 2:
        raise InputError(f"a mosaic is (rows, cols), not an array of shape {values.shape}")
    names = plane_names(cfa)
    planes = np.empty((*values.shape, len(names)), dtype=np.float32)
    padded = np.pad(values, 1)
    height, width = len(cfa), len(cfa[0])
    for r in range(min(height, values.shape[0])):
        for c in range(min(width, values.shape[1])):
            for k, name in enumerate(names):
                if cfa[r][c] == name:
                    planes[r::height, c::width, k] = values[r::height, c::width]
                else:
                    planes[r::height, c::width, k] = _from_neighbours(padded, cfa, (r, c), name)
    return planes


def _from_neighbours(padded: NDArray[np.float32], cfa: Cfa, site: tuple[int, int], name: str) -> NDArray[np.float32]:
    """The channel's weighted mean over the neighbours of every pixel at one site of the tile."""
    rows, cols = padded.shape[0] - 2, padded.shape[1] - 2
    height, width = len(cfa), len(cfa[0])
    row, col = np.arange(site[0], rows, height), np.arange(site[1], cols, width)
    total = np.zeros((row.size, col.size), dtype=np.float32)
    weight = np.zeros_like(total)
    for dr, dc, w in _NEIGHBOURS:
        if cfa[(site[0] + dr) % height][(site[1] + dc) % width] == name:
            total += w * padded[site[0] + dr + 1 : rows + dr + 1 : height, site[1] + dc + 1 : cols + dc + 1 : width]
            # The padding is zeros, so only the weights need to know where the mosaic ends.
            exists_row = (row + dr >= 0) & (row + dr < rows)
            exists_col = (col + dc >= 0) & (col + dc < cols)
            weight += np.float32(w) * np.outer(exists_row, exists_col)
    if not weight.all():
        raise InputError(
            f"bilinear demosaic cannot find channel {name} next to every pixel of a {rows} x {cols} mosaic "
            f"with the tile {cfa}; it needs each channel within one pixel of every other, as a Bayer tile has"
        )
    return total / weight
