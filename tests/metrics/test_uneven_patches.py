"""Gray patches that hold part of their neighbors are named: their noise would be too large."""

from __future__ import annotations

from dataclasses import replace

import pytest

import photosite as ps
from photosite.metrics.measure import ImageQuality, measure


@pytest.fixture(scope="module")
def frame() -> ps.RawFrame:
    sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    scene = ps.charts.macbeth("D65", 100)
    return camera.capture(scene, exposure_s=camera.auto_exposure_s(camera.mean_electrons(scene, 1.0)), seed=3)


def quality(frame: ps.RawFrame) -> ImageQuality:
    return measure([frame], "macbeth", only=["noise"])


def test_a_patch_with_a_spot_is_named(frame: ps.RawFrame) -> None:
    clean = quality(frame)
    assert "uneven-patches" not in {entry.id for entry in clean.diagnostics}
    (patch,) = (each for each in clean.chart.patches if each.name == "neutral 6.5")
    dn = frame.dn.copy()
    dn[patch.r0 : patch.r0 + 10, patch.c0 : patch.c0 + 10] += 300
    (found,) = (entry for entry in quality(replace(frame, dn=dn)).diagnostics if entry.id == "uneven-patches")
    assert found.text.endswith(": neutral 6.5")
    assert found.size == pytest.approx(0.027, rel=0.05)
