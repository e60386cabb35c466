"""Cameras side by side: what the figures, curves and patches are made of, checked against other ways to get them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.special import j1

import photosite as ps
from photosite.color.colorimetry import delta_e_2000
from photosite.errors import InputError, PhotositeWarning
from photosite.metrics.charts.color_checker import chart_regions, chart_xyz_d65
from photosite.studies.camera_comparison import CameraComparison

LIGHT = {"exposure_s": 1 / 30, "illuminant": "D65"}
LENS = ps.DiffractionLimited(2.8, 50)


@pytest.fixture(scope="module")
def found() -> CameraComparison:
    cameras = {
        "wide open": ps.Camera(LENS, ps.load_sensor("nikon-d200")),
        "stopped down": ps.Camera(ps.DiffractionLimited(11, 50), ps.load_sensor("nikon-d200")),
        "gray": ps.Camera(LENS, ps.load_sensor("sony-imx174")),
    }
    with pytest.warns(PhotositeWarning):  # the gray one responds to infrared light
        return ps.studies.compare_cameras(cameras, **LIGHT, distance_m=2.0)


def test_signal_and_noise_are_those_of_compare_sensors(found: CameraComparison) -> None:
    own = ps.studies.compare_sensors({"d200": ps.load_sensor("nikon-d200")}, f_number=2.8, **LIGHT).sensors["d200"]
    assert found.cameras["wide open"].light.to_dict() == own.to_dict()
    signals = [found.cameras[name].light.electrons_per_cd_m2 for name in ("wide open", "stopped down")]
    assert signals[0] / signals[1] == pytest.approx((1 + 4 * 11**2) / (1 + 4 * 2.8**2), rel=1e-4)


def test_the_mtf_is_that_of_an_airy_disk_and_a_square_pixel(found: CameraComparison) -> None:
    facts = found.cameras["stopped down"]
    frequency = np.array([20.0, 60.0])
    # The Hankel transform of the Airy pattern, done numerically in place of the closed form in the code.
    number = 11 * (1 + 0.05 / (2.0 - 0.05))
    radius_mm = np.linspace(1e-7, 3.0, 2_000_000)
    x = np.pi * radius_mm / (550e-6 * number)
    airy = (2 * j1(x) / x) ** 2
    from scipy.special import j0

    total = np.trapezoid(airy * radius_mm, radius_mm)
    lens = [np.trapezoid(airy * j0(2 * np.pi * f * radius_mm) * radius_mm, radius_mm) / total for f in frequency]
    sensor = ps.load_sensor("nikon-d200")
    side_mm = sensor.pixel.width_um.value * 1e-3 * math.sqrt(sensor.pixel.fill_factor.value)
    assert facts.mtf(frequency) == pytest.approx(np.array(lens) * np.sinc(frequency * side_mm), abs=2e-3)
    assert facts.mtf(np.array([facts.mtf50_per_mm]))[0] == pytest.approx(0.5, abs=1e-4)
    assert facts.nyquist_per_mm == pytest.approx(500 / sensor.pixel.width_um.value)


def test_color_errors_are_those_of_the_best_matrix(found: CameraComparison) -> None:
    facts = found.cameras["stopped down"]
    sensor = ps.load_sensor("nikon-d200").with_(rows=528, cols=792)
    chart = ps.charts.macbeth("D65", 40, distance_m=2.0)
    dn = ps.Camera(ps.DiffractionLimited(11, 50), sensor).capture(chart, 1 / 30).dn.astype(float)
    names = [region.name for region in chart_regions("macbeth", 528, 792)]
    rgb = []
    for region in chart_regions("macbeth", 528, 792):
        rows, cols = np.mgrid[region.r0 : region.r1, region.c0 : region.c1]
        part, tile = dn[rows, cols], np.array(sensor.array.cfa)[rows % 2, cols % 2]
        rgb.append([part[tile == name].mean() for name in facts.patches.channels])
    assert facts.used.all()
    matrix = np.linalg.pinv(np.array(rgb)) @ chart_xyz_d65("macbeth", names)
    own = delta_e_2000(np.array(rgb) @ matrix, chart_xyz_d65("macbeth", names))
    assert facts.delta_e_2000 == pytest.approx(own, abs=1e-6)


def test_saturated_patches_and_gray_sensors_have_no_color_errors(found: CameraComparison) -> None:
    assert found.cameras["gray"].colors is None
    assert found.cameras["gray"].reason
    assert found.cameras["gray"].patches is not None
    bright = ps.studies.compare_cameras({"a": ps.Camera(LENS, ps.load_sensor("nikon-d200"))}, exposure_s=1 / 10)
    facts = bright.cameras["a"]
    assert 0 < facts.used.sum() < 24
    assert (np.isnan(facts.delta_e_2000) == ~facts.used).all()
    blown = ps.studies.compare_cameras({"a": ps.Camera(LENS, ps.load_sensor("nikon-d200"))}, exposure_s=2.0).cameras[
        "a"
    ]
    assert blown.colors is None
    assert blown.reason


def test_results_are_plain_values_and_a_table(found: CameraComparison) -> None:
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert list(content["cameras"]) == list(found.cameras)
    assert len(content["chart"]["wide open"]["delta_e_2000"]) == 24
    assert "stopped down" in repr(found)
    with pytest.raises(InputError):
        ps.studies.compare_cameras({})
    tiny = ps.Camera(LENS, ps.load_sensor("nikon-d200").with_(rows=4, cols=4))
    assert ps.studies.compare_cameras({"tiny": tiny}).cameras["tiny"].patches is None


@pytest.mark.filterwarnings("ignore::photosite.errors.PhotositeWarning")
def test_patches_of_several_captures_are_those_of_the_combined_response() -> None:
    """From 40 to 4000 cd/m2 all signals grow by 100, beyond both switches; the color error stays (20 for 3 before)."""
    sensor = ps.load_sensor("split-pixel-automotive").with_(rows=480, cols=640)
    camera = {"a": ps.Camera(LENS, sensor)}
    dim, bright = (
        ps.studies.compare_cameras(camera, exposure_s=1 / 60, mean_luminance_cd_m2=level).cameras["a"]
        for level in (40, 4000)
    )
    assert dim.used.all()
    assert bright.used.all()
    assert bright.light.switches_cd_m2[-1] < 4000
    assert bright.patches.mean_dn == pytest.approx(100.0 * dim.patches.mean_dn, rel=0.02)
    assert bright.delta_e_2000.mean() == pytest.approx(dim.delta_e_2000.mean(), abs=0.2)
