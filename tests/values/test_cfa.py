"""Color filter arrays from names and tiles."""

from __future__ import annotations

import pytest
from raising import raises

from photosite.errors import InputError
from photosite.values.cfa import cfa_from


@pytest.mark.parametrize("tile", [None, 3, [], [None], [["R"], 3], [["R", "G"], ["B"]], [[""]], {"R": 1}, "x", "R/"])
def test_invalid_tiles(tile):
    with raises(InputError, "cfa", value=tile):
        cfa_from(tile)


def test_rows_may_be_text():
    assert cfa_from(["RG", "GB"]) == cfa_from("RG/GB") == cfa_from("rggb")
