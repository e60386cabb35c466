"""Bilinear demosaicing: from a mosaic to one plane per channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.values.cfa import Cfa, channel_names, tile_text

_NEIGHBOURS: tuple[tuple[int, int, float], ...] = tuple(
    (dr, dc, 2.0 if 0 in (dr, dc) else 1.0) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0)
)
"""(row step, column step, weight) of the bilinear kernel without its center."""


def plane_names(cfa: Cfa) -> tuple[str, ...]:
    """Return the order of a demosaiced picture's planes: R, G, B, or the tile's reading order for other channels.

    Examples
    --------
    >>> plane_names((("G", "B"), ("R", "G"))), plane_names((("M",),))
    (('R', 'G', 'B'), ('M',))
    """
    names = channel_names(cfa)
    return ("R", "G", "B") if set(names) == {"R", "G", "B"} else names


def demosaic_bilinear(mosaic: ArrayLike, cfa: Cfa) -> NDArray[np.float32]:
    """Interpolate every channel of a mosaic to every pixel.

    A pixel keeps its channel's value. For another channel it gets the mean of that channel's pixels among the
    eight neighbors, with weight 2 for direct neighbors and 1 for diagonal ones. At the borders the mean is over the
    neighbors that exist. A constant channel stays constant; one that is linear in row and column stays linear except
    in the outermost rows and columns.

    Parameters
    ----------
    mosaic
        (rows, cols), any real numbers.
    cfa
        Tile of the color filter array.

    Returns
    -------
    numpy.ndarray
        (rows, cols, channels) float32, planes in the order of `plane_names(cfa)`.

    Raises
    ------
    InputError
        If the mosaic is not two-dimensional, or a pixel has no neighbor of some channel.

    References
    ----------
    B. K. Gunturk et al., "Demosaicking: color filter array interpolation", IEEE Signal Processing Magazine 22(1), 2005;
    the bilinear kernel of a Bayer mosaic, generalised to any tile.

    Examples
    --------
    >>> planes = demosaic_bilinear([[1, 2, 1], [4, 8, 4], [1, 2, 1]], (("R", "G"), ("G", "B")))
    >>> planes[1, 1], planes[0, 1]
    (array([1., 3., 8.], dtype=float32), array([1., 2., 8.], dtype=float32))
    """
    values = np.asarray(mosaic, dtype=np.float32)
    if values.ndim != 2:
        raise InputError("mosaic", value=values.shape, expected="of shape (rows, cols)")
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
    """Return the channel's weighted mean over the neighbors of all pixels at one site of the tile."""
    rows, cols = padded.shape[0] - 2, padded.shape[1] - 2
    height, width = len(cfa), len(cfa[0])
    row, col = np.arange(site[0], rows, height), np.arange(site[1], cols, width)
    total = np.zeros((row.size, col.size), dtype=np.float32)
    weight = np.zeros_like(total)
    for dr, dc, w in _NEIGHBOURS:
        if cfa[(site[0] + dr) % height][(site[1] + dc) % width] == name:
            total += w * padded[site[0] + dr + 1 : rows + dr + 1 : height, site[1] + dc + 1 : cols + dc + 1 : width]
            # The padding is 0, so only the weights depend on the border.
            exists_row = (row + dr >= 0) & (row + dr < rows)
            exists_col = (col + dc >= 0) & (col + dc < cols)
            weight += np.float32(w) * np.outer(exists_row, exists_col)
    if not weight.all():
        expected = f"one with channel {name} next to every pixel of a {rows} x {cols} mosaic, as in a Bayer tile"
        raise InputError("cfa", where="bilinear demosaic", value=tile_text(cfa), expected=expected)
    return total / weight
