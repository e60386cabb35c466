"""Scenes on frames: centered, covering, to scale."""

from __future__ import annotations

from raising import raises

from photosite.errors import InputError
from photosite.scene.placement import place
from photosite.values.region import Region


def test_a_scene_covers_the_frame_and_is_centerd() -> None:
    where = place((100, 100), (20, 50))
    assert (where.row_step, where.col_step) == (2.0, 2.0)
    assert (where.row_start, where.col_start) == (30.0, 0.0)


def test_pixels_may_be_oblong() -> None:
    where = place((100, 100), (25, 50), pixel_aspect=2.0)
    assert (where.row_step, where.col_step) == (4.0, 2.0)


def test_to_scale() -> None:
    where = place((10, 10), (40, 40), cols_per_pixel=0.5)
    assert (where.row_start, where.col_step) == (-5.0, 0.5)
    assert where.regions([Region("all", 0, 10, 0, 10)]) == (Region("all", 10, 30, 10, 30),)


def test_regions_hold_whole_pixels_and_end_at_the_frame() -> None:
    where = place((10, 10), (4, 4))  # 2.5 samples a pixel
    assert where.regions([Region("a", 0, 6, 4, 10)]) == (Region("a", 0, 2, 2, 4),)
    with raises(InputError, "region"):
        where.regions([Region("thin", 3, 5, 0, 10)])
