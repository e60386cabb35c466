"""The chart's colors against colour-science's own integration."""

from dataclasses import replace

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.color.colorimetry import colour_science
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.charts.color_checker import chart_regions, chart_xyz_d65, find_chart
from photosite.scene.charts import MACBETH_NAMES, macbeth
from photosite.scene.placement import in_perspective

SHAPE = (300, 440)
LENS = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
VIEWS = {
    "facing": ((20, 25), (20, 415), (280, 415), (280, 25)),
    "from the side": ((60, 80), (20, 400), (290, 380), (230, 70)),
    "turned by 180 degrees": ((270, 390), (280, 60), (40, 80), (50, 400)),
    "upright, on its side": ((20, 300), (290, 290), (280, 130), (30, 110)),
    "small and slanted": ((90, 150), (110, 320), (230, 300), (200, 130)),
}


def test_colors_agree_with_colour_science():
    colour = colour_science()
    shape = colour.SpectralShape(380, 780, 5)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    spectra = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    wanted = [colour.sd_to_XYZ(sd, observer, light, method="Integration") / 100 for sd in spectra]
    # Its sum and our trapezoids differ by half an interval at both ends, where the observer sees nearly nothing.
    np.testing.assert_allclose(chart_xyz_d65("macbeth", MACBETH_NAMES), wanted, atol=2e-5)


def test_patches_come_in_the_order_asked_for():
    whole = chart_xyz_d65("macbeth", MACBETH_NAMES)
    np.testing.assert_allclose(chart_xyz_d65("macbeth", ["white", "red"]), whole[[18, 14]], rtol=1e-12)


def test_unknown_names_get_a_hint():
    with raises(InputError, "chart", value="mcbeth") as caught:
        chart_regions("mcbeth", 100, 150)
    assert "macbeth" in (caught.value.hint or "")
    with pytest.raises(InputError) as caught:
        chart_xyz_d65("macbeth", ["folliage"])
    assert "foliage" in (caught.value.hint or "")


def shoot(corners, seed=1, *, preset="nikon-d200", illuminant="A", luminance=40.0, surround=0.0, cfa=None):
    sensor = ps.load_sensor(preset).with_(rows=SHAPE[0], cols=SHAPE[1], black_level_dn=64)
    camera = ps.Camera(LENS, sensor if cfa is None else sensor.with_(cfa=cfa))
    scene = in_perspective(macbeth(illuminant, luminance), corners, SHAPE)
    if surround:  # the gray of a wall, patches' gaps stay black within the chart
        weights = scene.weights.copy()
        rows, cols = np.nonzero(weights.any(axis=0))
        wall = np.ones(scene.shape, bool)
        wall[max(rows.min() - 6, 0) : rows.max() + 7, max(cols.min() - 6, 0) : cols.max() + 7] = False
        weights[20] += np.float32(surround) * wall
        scene = replace(scene, weights=weights)
    return camera.capture(scene, 1 / 3, seed=seed)


@pytest.mark.parametrize("view", VIEWS)
def test_a_chart_is_found_where_it_is(view):
    surround = 0.0 if view == "facing" else 0.8
    found = np.array(find_chart(shoot(VIEWS[view], surround=surround)))
    assert np.abs(found - np.array(VIEWS[view])).max() < 3.0


@pytest.mark.parametrize(
    "camera", [{"illuminant": "FL2", "cfa": "gbrg", "luminance": 4.0}, {"preset": "vendor-2.2um", "luminance": 400.0}]
)
def test_whatever_the_light_and_the_sensor(camera):
    view = VIEWS["from the side"]
    assert np.abs(np.array(find_chart(shoot(view, **camera))) - np.array(view)).max() < 3.0


def test_frames_without_a_chart_are_rejected():
    rng = np.random.default_rng(4)
    noise = RawFrame(rng.poisson(400.0, SHAPE).astype(np.uint16), 12)
    boxes = np.full(SHAPE, 100.0)
    for r in range(4):  # a grid of patches, but of one gray
        for c in range(6):
            boxes[30 + 65 * r : 80 + 65 * r, 20 + 70 * c : 75 + 70 * c] = 2000.0
    gray = RawFrame(rng.poisson(boxes).astype(np.uint16), 12)
    few = boxes.copy()
    few[150:] = 100.0
    two_rows = RawFrame(rng.poisson(few).astype(np.uint16), 12)
    with raises(InputError, "no ColorChecker found"):
        find_chart(noise)
    with raises(InputError, "the brightness of the"):
        find_chart(gray)
    with raises(InputError, "no ColorChecker found"):
        find_chart(two_rows)
