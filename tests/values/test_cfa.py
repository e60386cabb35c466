"""Color filter arrays from names and tiles."""

from __future__ import annotations

import pytest
from raising import raises

from photosite.errors import InputError
from photosite.values.cfa import NAMED, cfa_from, channel_names, tile_name, tile_text


@pytest.mark.parametrize("tile", [None, 3, [], [None], [["R"], 3], [["R", "G"], ["B"]], [[""]], {"R": 1}, "x", "R/"])
def test_invalid_tiles(tile):
    with raises(InputError, "cfa", value=tile):
        cfa_from(tile)


def test_rows_may_be_text():
    assert cfa_from(["RG", "GB"]) == cfa_from("RG/GB") == cfa_from("rggb")


@pytest.mark.parametrize("name", NAMED)
def test_text_and_name_of_a_tile_are_read_back(name):
    tile = NAMED[name]
    assert cfa_from(name) == cfa_from([list(row) for row in tile]) == cfa_from(tile_text(tile).split("/")) == tile
    assert name == "mono" or cfa_from(tile_text(tile)) == tile
    assert tile_name(tile) == name


def test_channels_of_more_than_one_letter():
    assert channel_names(cfa_from("ryycy")) == ("R", "Y", "Cy")
    assert channel_names(cfa_from("polarization")) == ("P90", "P45", "P135", "P0")
    odd = (("green", "B2x"), ("1", "two"))
    assert cfa_from(tile_text(odd)) == odd


def test_shares_of_the_channels_are_those_of_the_sensors():
    shares = {
        "quad-rggb": {"R": 4, "G": 8, "B": 4},
        "rgbw": {"W": 8, "R": 2, "G": 4, "B": 2},
        "rgb-ir": {"R": 2, "G": 8, "B": 2, "Ir": 4},
        "x-trans": {"R": 8, "G": 20, "B": 8},
    }
    for name, expected in shares.items():
        sites = [channel for row in NAMED[name] for channel in row]
        assert {channel: sites.count(channel) for channel in sites} == expected
