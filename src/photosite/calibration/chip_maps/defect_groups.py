"""Defective pixels as columns, rows, clusters and single pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Shape = Literal["column", "row", "cluster", "pixel"]
SHAPES: tuple[Shape, ...] = ("column", "row", "cluster", "pixel")

_LINE_P_VALUE = 1e-3
"""Probability that chance puts as many of scattered defects into any line of the chip."""
_LEAST_IN_LINE = 4


@dataclass(frozen=True, eq=False)
class DefectGroup:
    """Defective pixels that belong together.

    Parameters
    ----------
    shape
        "column" or "row": more pixels in one line than chance puts there. "cluster": neighbors. "pixel": a single one.
    index
        (n,) their indices in the list of defects.
    first, last
        Smallest and largest (row, col).
    """

    shape: Shape
    index: NDArray[np.intp]
    first: tuple[int, int]
    last: tuple[int, int]

    def __len__(self) -> int:
        return len(self.index)

    @property
    def place(self) -> str:
        """Where the group is, in words."""
        (r0, c0), (r1, c1) = self.first, self.last
        match self.shape:
            case "column":
                return f"column {c0}, rows {r0} to {r1}"
            case "row":
                return f"row {r0}, columns {c0} to {c1}"
            case "cluster":
                return f"rows {r0} to {r1}, columns {c0} to {c1}"
        return f"row {r0}, column {c0}"


def group_defects(row: ArrayLike, col: ArrayLike, size: tuple[int, int], reach: int = 1) -> tuple[DefectGroup, ...]:
    """Group defective pixels: columns first, then rows, clusters and single pixels, each by size.

    Parameters
    ----------
    row, col
        (n,) positions. Repeated positions count once.
    size
        (rows, cols) of the chip.
    reach
        Distance in rows and columns up to which pixels are neighbors: 1, or 2 for the pixels of one channel of a Bayer
        mosaic.

    Notes
    -----
    Scattered defects fall into the lines as a Poisson distribution. A line is defective if it has at least four
    defects, and so many that the expected number of such lines is below 0.001.

    Examples
    --------
    >>> groups = group_defects([0, 2, 5, 7, 9, 4, 4], [3, 3, 3, 3, 3, 7, 8], (10, 12))
    >>> [(group.place, len(group)) for group in groups]
    [('column 3, rows 0 to 9', 5), ('rows 4 to 4, columns 7 to 8', 2)]
    """
    places = np.column_stack([np.asarray(row, np.intp), np.asarray(col, np.intp)])
    if not len(places):
        return ()
    _, index = np.unique(places, axis=0, return_index=True)
    groups: list[DefectGroup] = []
    lines: tuple[tuple[Shape, int], ...] = (("column", 1), ("row", 0))
    for shape, axis in lines:
        found = _lines(places[index, axis], size[axis])
        groups += [_group(shape, places, index[places[index, axis] == line]) for line in found]
        index = index[~np.isin(places[index, axis], found)]
    if len(index):
        labels = _clusters(places[index], reach)
        parts = [index[labels == label] for label in range(labels.max() + 1)]
        groups += [_group("cluster" if len(part) > 1 else "pixel", places, part) for part in parts]
    return tuple(sorted(groups, key=lambda group: (SHAPES.index(group.shape), -len(group), group.first)))


def shapes_text(groups: Sequence[DefectGroup]) -> str:
    """Return the number of groups of each shape in words.

    Examples
    --------
    >>> shapes_text(group_defects([0, 2, 5, 7, 9, 4], [3, 3, 3, 3, 3, 7], (10, 12)))
    '1 column, 1 pixel'
    """
    counts = [(shape, sum(group.shape == shape for group in groups)) for shape in SHAPES]
    return ", ".join(f"{count} {shape}{'s' * (count > 1)}" for shape, count in counts if count) or "none"


def _group(shape: Shape, places: NDArray[np.intp], index: NDArray[np.intp]) -> DefectGroup:
    low, high = places[index].min(axis=0), places[index].max(axis=0)
    return DefectGroup(shape, index, (int(low[0]), int(low[1])), (int(high[0]), int(high[1])))


def _lines(position: NDArray[np.intp], lines: int) -> NDArray[np.intp]:
    """Return the lines with too many defects for chance, given the rate in the others, the fullest first."""
    from scipy.stats import poisson

    counts = np.bincount(position, minlength=lines)
    found: list[int] = []
    while len(found) < lines:
        rest = np.delete(counts, found)
        fullest = int(rest.max())
        rate = (rest.sum() - fullest) / max(rest.size - 1, 1)
        if fullest < _LEAST_IN_LINE or poisson.sf(fullest - 1, rate) * lines >= _LINE_P_VALUE:
            break
        found.append(int(np.argmax(np.where(np.isin(np.arange(lines), found), -1, counts))))
    return np.array(sorted(found), np.intp)


def _clusters(places: NDArray[np.intp], reach: int) -> NDArray[np.intp]:
    """Return (n,) labels of connected pixels."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(places).query_pairs(reach + 0.5, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return np.asarray(connected_components(links, directed=False)[1], np.intp)
