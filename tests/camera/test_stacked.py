"""Stacked channels: every pixel has all of them, read side by side."""

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.patches import patch_statistics
from photosite.values.cfa import channel_names

LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=12)
SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=44, cols=3 * 66, cfa=[["B", "G", "R"]], stacked=True, pitch_um=4.0, black_level_dn=64
)


def shoot(camera, scene, **options):
    rate = camera.mean_electrons(scene, 1.0)
    exposure_s = camera.auto_exposure_s(rate)
    return camera.expose(rate * np.float32(exposure_s), exposure_s, scene=scene, **options)


def test_layers_see_the_same_place():
    chart = ps.charts.macbeth("D65", 100)
    found = ps.Camera(LENS, SENSOR).mean_electrons(chart, 0.01)
    assert found.shape == (44, 198)
    for k, name in enumerate("BGR"):
        mono = SENSOR.with_(cols=66, stacked=False, cfa="mono", channels={"M": SENSOR.channels[name].model_dump()})
        np.testing.assert_allclose(found[:, k::3], ps.Camera(LENS, mono).mean_electrons(chart, 0.01), rtol=1e-6)
    panned = ps.scenes.DynamicScene(chart, motion=ps.scenes.Motion(cols_per_s=200))
    moving = ps.Camera(LENS, SENSOR).mean_electrons(panned, 0.02)
    green = ps.Camera(LENS, SENSOR.layer("G")).mean_electrons(panned, 0.02)
    np.testing.assert_array_equal(moving[:, 1::3], green)


def test_noise_of_the_layers_is_independent():
    camera = ps.Camera(LENS, SENSOR.with_(prnu_percent=0, dsnu_e=0))
    level = np.full((44, 198), 400, np.float32)
    frames = [camera.expose(level, 0.01, seed=2, frame=k).layers() for k in range(8)]
    planes = np.array([[frame[name].dn.ravel() for name in "BGR"] for frame in frames], np.float64)
    correlation = np.corrcoef(planes.transpose(1, 0, 2).reshape(3, -1))
    assert np.abs(correlation - np.eye(3)).max() < 4 / np.sqrt(planes.size / 3)
    expected = (400 + camera.sensor.electrons(camera.sensor.noise.read_noise_mv.value) ** 2) / 7.98**2 + 1 / 12
    assert planes.var() == pytest.approx(expected, rel=0.03)


def test_pictures_have_a_column_for_each_pixel_and_the_right_colors(tmp_path):
    camera, chart = ps.Camera(LENS, SENSOR), ps.charts.macbeth("D65", 100)
    raw = shoot(camera, chart, seed=3)
    picture = ps.develop(raw)
    assert picture.shape == (44, 66, 3)
    mosaic = ps.Camera(LENS, SENSOR.with_(cols=66, stacked=False, cfa="rggb"))
    other = ps.develop(shoot(mosaic, chart, seed=3))
    for region in camera.image_regions(chart):
        inside = np.s_[region.r0 + 2 : region.r1 - 2, region.c0 + 2 : region.c1 - 2]
        means = picture[inside].mean(axis=(0, 1)), other[inside].mean(axis=(0, 1))
        np.testing.assert_allclose(*means, atol=0.06)
    for name in ("a.tif", "a.h5"):
        raw.save(tmp_path / name)
        kept = ps.read_raw(tmp_path / name)
        assert kept.is_stacked
        np.testing.assert_array_equal(kept.layers()["R"].dn, raw.dn[:, 2::3])
    part = camera.expose(camera.mean_electrons(chart, 0.01), 0.01, seed=3, region=(4, 30, 9, 60))
    assert channel_names(part.cfa) == ("B", "G", "R")
    assert part.layers()["B"].shape == (26, 17)


def test_what_stacked_channels_cannot_be(tmp_path):
    with raises(InputError, "cols", value=100):
        SENSOR.with_(cols=100)
    with raises(InputError, "cfa", value="RG/GB"):
        ps.load_sensor("nikon-d200").with_(stacked=True)
    raw = ps.Camera(LENS, SENSOR).expose(np.full((44, 198), 400, np.float32), 0.01)
    with raises(InputError, "region", value=(0, 10, 1, 31)):
        ps.Camera(LENS, SENSOR).expose(np.full((44, 198), 400, np.float32), 0.01, region=(0, 10, 1, 31))
    with raises(InputError, "the channels of the frame are stacked"):
        patch_statistics(raw, [ps.Camera(LENS, SENSOR).image_regions(ps.charts.macbeth())[0]])
    with raises(InputError, "cfa"):
        raw.save(tmp_path / "a.dng")
    with raises(InputError, "cfa", where="layers"):
        shot = ps.Camera(LENS, SENSOR.with_(cols=66, stacked=False, cfa="rggb"))
        shot.expose(np.full((44, 66), 9, np.float32), 1).layers()
    with raises(InputError, "cfa", value="BGR"):
        SENSOR.binned(2)
