"""Colour filter arrays: what is one."""

from __future__ import annotations

import pytest

from photosite.errors import InputError
from photosite.values.cfa import cfa_from


@pytest.mark.parametrize("tile", [None, 3, [], [None], [["R"], 3], [["R", "G"], ["B"]], [[""]], {"R": 1}, "rgb"])
def test_what_is_no_tile_is_refused(tile):
    with pytest.raises(InputError, match="colour filter array"):
        cfa_from(tile)


def test_rows_may_be_text():
    assert cfa_from(["RG", "GB"]) == cfa_from("rggb")
