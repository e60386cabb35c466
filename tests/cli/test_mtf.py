"""`photosite mtf`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import photosite as ps
from photosite.metrics.sharpness.slanted_edge import slanted_edge_mtf


@pytest.mark.smoke("mtf")
def test_is_what_the_library_gives(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "edge.tif"
    size = ("--rows", 120, "--cols", 180, "--black-level", 64)
    photosite("simulate", "--scene", "slanted-edge", *size, "--cells", 3, "--exposure", "auto", "-o", file)
    region = (10, 110, 50, 130)
    done = photosite("mtf", file, "--region", "10,110,50,130", "--pitch", 6.05, "--json")
    expected = slanted_edge_mtf(ps.read_raw(file), region, "G", pitch_um=6.05)
    assert (done.status, done.err) == (0, "")
    assert done.json["channel"] == "G"
    assert done.json["mtf50_cycles_per_pixel"] == expected.mtf50
    assert done.json["mtf50_cycles_per_mm"] == pytest.approx(expected.mtf50 * 1e3 / 6.05)
    assert done.json["mtf"] == expected.mtf.tolist()
    text = photosite("mtf", file, "--region", "10,110,50,130", "--channel", "R").out
    assert "channel R" in text
    assert "cycles/mm" not in text


@pytest.mark.parametrize("region", ["1,2,3", "a,b,c,d", "0,9999,0,10"])
def test_invalid_regions(photosite: Any, tmp_path: Path, region: str) -> None:
    file = tmp_path / "flat.tif"
    photosite("simulate", "--scene", "uniform", "--rows", 66, "--cols", 98, "-o", file)
    refused = photosite("mtf", file, "--region", region)
    assert (refused.status, refused.out, refused.err.count("\n")) == (2, "", 1)
    assert "region" in refused.err
