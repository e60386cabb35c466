"""Color charts of every mosaic come out right: simulated, demosaiced, and developed with the camera's own matrix."""

import numpy as np
import pytest

import photosite as ps
from photosite.camera.color_matrix import color_matrix
from photosite.color.colorimetry import XYZ_FROM_SRGB, delta_e_2000
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.scene.charts.color_checker import MACBETH_NAMES
from photosite.sensor.assumed_channels import assumed_channels
from photosite.values.cfa import cfa_from, channel_names

WHITE = MACBETH_NAMES.index("neutral 8")


def camera_of(tile, rows=88, cols=132):
    channels = assumed_channels(channel_names(cfa_from(tile)), 0.7)
    sensor = ps.load_sensor("sony-imx174").with_(
        rows=rows, cols=cols, cfa=tile, channels=channels, pitch_um=3, black_level_dn=64
    )
    return ps.Camera(ps.DiffractionLimited(f_number=4, focal_length_mm=12), sensor)


def shoot(camera, chart):
    rate = camera.mean_electrons(chart, 1.0)
    exposure_s = camera.auto_exposure_s(rate)
    return camera.expose(rate * np.float32(exposure_s), exposure_s, seed=1, scene=chart)


def color_errors(camera, chart, raw, white_balance="as-shot"):
    """CIEDE2000 of the patches of a developed ColorChecker, scaled to the luminance of neutral 8."""
    encoded = ps.develop(raw, white_balance, exposure=0.9)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    regions = {region.name: region for region in camera.image_regions(chart)}
    inside = [regions[name] for name in MACBETH_NAMES]
    means = [linear[r.r0 + 3 : r.r1 - 3, r.c0 + 3 : r.c1 - 3].mean(axis=(0, 1)) for r in inside]
    seen, true = np.array(means) @ XYZ_FROM_SRGB.T, chart_xyz_d65("macbeth", MACBETH_NAMES)
    return delta_e_2000(seen * true[WHITE, 1] / seen[WHITE, 1], true)


@pytest.mark.filterwarnings("ignore:.*lies outside the scene's wavelengths")
@pytest.mark.parametrize(
    ("tile", "daylight", "tungsten"),
    [
        ("rggb", 2.0, 4.2),
        ("quad-rggb", 2.0, 4.2),
        ("rgbw", 2.0, 4.2),
        ("rccb", 4.5, 6.2),
        ("ryycy", 3.0, 5.2),
        ("rgb-ir", 2.0, 4.5),
        ("x-trans", 2.0, 4.2),
        ("polarization-rggb", 2.0, 4.4),
    ],
)
def test_color_charts(tile, daylight, tungsten):
    camera = camera_of(tile)
    for illuminant, limit in (("D65", daylight), ("A", tungsten)):
        chart = ps.charts.macbeth(illuminant, 200)
        raw = shoot(camera, chart)
        assert color_errors(camera, chart, raw).mean() < limit
        assert illuminant == "A" or color_errors(camera, chart, raw, "none").mean() < limit


def test_infrared_light_has_no_color():
    """Light beyond 780 nm reaches R, G, B and Ir alike; the matrix makes it black."""
    sensor = camera_of("rgb-ir").sensor
    grid = np.arange(790.0, 1001.0)
    infrared = np.array([sensor.response_at(name, grid).sum() for name in sensor.channel_names])
    assert np.ptp(infrared) < 0.02 * infrared.max()
    to_xyz = np.linalg.pinv(color_matrix(sensor))
    no_infrared = infrared * np.array([name != "Ir" for name in sensor.channel_names])
    assert np.abs(to_xyz @ infrared).max() < 0.01 * np.abs(to_xyz @ no_infrared).max()


@pytest.mark.filterwarnings("ignore:.*lies outside the scene's wavelengths")
def test_monochrome_and_polarized_mosaics_are_gray():
    for tile in ("mono", "polarization"):
        camera = camera_of(tile, 24, 32)
        raw = camera.capture(ps.charts.uniform("D65", 50), 0.01, seed=3)
        picture = ps.develop(raw, exposure=0.5)
        assert np.ptp(picture, axis=-1).max() < 1e-6
        assert 0.1 < picture.mean() < 0.9
