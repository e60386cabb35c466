"""Published spectra and colors that photosite ships, in the folder `tables`; each file states its source."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from photosite.color.spectrum import Spectrum

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


@lru_cache(maxsize=8)
def spectra(table: str) -> Mapping[str, Spectrum]:
    """Return the spectra of a table by name, in the order of the file.

    Examples
    --------
    >>> spectra("cie_illuminants")["A"].at([560.0])
    array([100.])
    """
    found = {}
    for name, numbers in rows(table).items():
        first, step, values = numbers[0], numbers[1], numbers[2:]
        found[name] = Spectrum(first + step * np.arange(values.size), values)
    return MappingProxyType(found)


def rows(table: str) -> Mapping[str, NDArray[np.float64]]:
    """Return the numbers of each row of a table by the row's name, in the order of the file.

    Examples
    --------
    >>> rows("color_checker_sg_after_2014")["A1"].round(3)  # x, y and Y
    array([0.348, 0.362, 0.917])
    """
    text = files("photosite.color").joinpath("tables", f"{table}.csv").read_text(encoding="utf-8")
    lines = (line.split(",") for line in text.splitlines() if not line.startswith("#"))
    return {name: np.array(cells, dtype=np.float64) for name, *cells in lines}
