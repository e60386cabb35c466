"""A ColorChecker in frames of different shapes."""

from __future__ import annotations

import pytest

import photosite as ps
from photosite.camera.mean_image import placement
from photosite.scene.charts import macbeth, macbeth_regions
from photosite.scene.placement import place


def camera(rows: int, cols: int) -> ps.Camera:
    return ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200").with_(rows=rows, cols=cols))


@pytest.mark.parametrize("shape", [(300, 400), (270, 480), (400, 300), (300, 300)])
def test_all_patches_are_whole_in_a_frame_of_any_shape(shape: tuple[int, int]) -> None:
    regions = camera(*shape).image_regions(macbeth())
    heights, widths = [r.r1 - r.r0 for r in regions], [r.c1 - r.c0 for r in regions]
    assert max(heights) - min(heights) <= 1
    assert max(widths) - min(widths) <= 1
    assert regions == macbeth_regions(*shape)


@pytest.mark.parametrize("shape", [(2592, 3872), (200, 300), (132, 196), (1296, 1936)])
def test_a_chart_that_fits_covers_the_frame_as_before(shape: tuple[int, int]) -> None:
    assert placement(macbeth(), camera(*shape)) == place((132, 196), shape)
