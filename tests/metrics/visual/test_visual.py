"""Visual measurements against closed forms, and against results of ISETCam where its files are present."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises
from scipy.integrate import quad
from scipy.io import loadmat

from photosite.color.colorimetry import D65_WHITE_XYZ, SRGB_FROM_XYZ, delta_e_2000
from photosite.errors import InputError
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.metrics.visual.acutance import acutance, square_root_integral
from photosite.metrics.visual.scielab import OPPONENT_FROM_XYZ, scielab_differences, scielab_kernels
from photosite.metrics.visual.viewing import (
    barten_sensitivity,
    chrominance_sensitivities,
    luminance_sensitivity,
    luminance_sensitivity_area,
    pixels_per_degree,
)
from photosite.studies.measurements.visual_noise import SHAPE, VIEWING, noisy_picture, visible_lightness
from photosite.studies.virtual_charts import virtual_edge

Array = NDArray[np.float64]

PER_DEGREE = pixels_per_degree(0.1, 300.0)


def eye(f: float) -> float:
    return float(luminance_sensitivity(np.array(f)))


def test_sensitivities() -> None:
    assert quad(eye, 0.0, np.inf)[0] == pytest.approx(luminance_sensitivity_area())
    assert quad(eye, 0.0, 20.0)[0] == pytest.approx(luminance_sensitivity_area(20.0))
    peak = max(eye(f) for f in np.arange(0.0, 20.0, 0.01))
    assert peak == pytest.approx(eye(4.0)) == pytest.approx(3.0, abs=0.01)
    red_green, blue_yellow = chrominance_sensitivities(np.array([0.0, 10.0]))
    assert (red_green[0], blue_yellow[0]) == (pytest.approx(1.0, abs=1e-6), pytest.approx(1.173, abs=1e-3))
    assert red_green[1] < 0.7 > blue_yellow[1]


def test_acutance_of_gaussians() -> None:
    """A response exp(-k f) moves the sensitivity's decay from 0.2 to 0.2 + k."""
    cpd = np.linspace(0.0, 80.0, 4001)
    for k in (0.05, 0.3):
        expected = (0.2 / (0.2 + k)) ** 1.8
        assert acutance(cpd, np.exp(-k * cpd))[0] == pytest.approx(expected, rel=1e-4)
    u = np.geomspace(0.03, 40.0, 4001)
    integral = quad(lambda x: math.sqrt(barten_sensitivity(np.array(math.exp(x)), 100.0, 40.0)), *np.log(u[[0, -1]]))[0]
    found = square_root_integral(u, np.full_like(u, 0.25), 100.0, 40.0)[0]
    assert found == pytest.approx(0.5 * integral / math.log(2.0), rel=1e-4)


def test_nearer_viewers_see_more_blur() -> None:
    edge = virtual_edge(np.random.default_rng(1)).electrons

    def at(distance_mm: float) -> Result:
        return measure(edge, "slanted-edge", only=["acutance"], options={"acutance": {"distance_mm": distance_mm}})[
            "acutance"
        ]

    assert (at(300.0)["acutance"].value or 1) < (at(600.0)["acutance"].value or 0)


def test_isetcam_acutance(isetcam_metrics: Path) -> None:
    """The file holds 129 points that were interpolated from 41. ISETCam adds up the 41, which is 0.7 % less."""
    saved = loadmat(isetcam_metrics / "metrics_acutance_small.mat", squeeze_me=True)
    place = np.linspace(0.0, 1.0, 41)
    response = np.interp(place, np.linspace(0.0, 1.0, 129), saved["lum_mtf_norm"])
    expected, top = float(saved["acutance"]), float(saved["cpd_stats"][1])
    sensitivity = luminance_sensitivity(place * top)
    assert (sensitivity @ response) / sensitivity.sum() == pytest.approx(expected, rel=2e-4)
    assert acutance(place * top, response, top)[0] == pytest.approx(expected, rel=0.008)


def test_isetcam_square_root_integrals(isetcam_metrics: Path) -> None:
    saved = loadmat(isetcam_metrics / "metrics_sqri_tutorial_small.mat", squeeze_me=True)
    u = saved["sf"]
    perfect = np.ones_like(u)
    for width, peak, expected in zip(
        saved["widths"], saved["csf_peak_by_width"], saved["max_sqri_by_width"], strict=True
    ):
        assert barten_sensitivity(u, 340.0 / math.pi, width).max() == pytest.approx(peak, rel=1e-9)
        assert square_root_integral(u, perfect, 340.0 / math.pi, width)[0] == pytest.approx(expected, rel=1e-3)
    for luminance, expected in zip(saved["luminance_levels"], saved["max_sqri_by_luminance"], strict=True):
        assert square_root_integral(u, perfect, luminance, 14.0)[0] == pytest.approx(expected, rel=1e-3)
    # A Gaussian spot exp(-(x / sigma)^2), whose response ISETCam has at 0, 1, 2... cycles/mm, and linear between.
    per_mm, sigma_mm = np.arange(4.0), 0.5 * 25.4 / saved["crt_dpi"]
    spot = np.interp(u, per_mm * saved["crt_mm_per_deg"], np.exp(-((math.pi * sigma_mm * per_mm) ** 2)))
    assert square_root_integral(u, spot, 100.0, 14.0)[0] == pytest.approx(float(saved["crt_sqri"]), rel=1e-3)


def test_isetcam_scielab_filters(isetcam_metrics: Path) -> None:
    saved = loadmat(isetcam_metrics / "metrics_scielab_filters_small.mat", squeeze_me=True)
    kernels = scielab_kernels(101.0, 101)
    for kernel, peak, row in zip(
        kernels, saved["initial_filter_peaks"], saved["initial_filter_center_rows_norm"], strict=True
    ):
        assert kernel.max() == pytest.approx(peak, rel=1e-9)
        line = kernel[50] / kernel[50].max()
        places = np.linspace(0.0, 1.0, 129), np.linspace(0.0, 1.0, 101)
        assert row == pytest.approx(np.interp(*places, line), abs=1e-9)


def test_scielab_of_even_fields_is_the_plain_difference() -> None:
    one = np.broadcast_to(0.3 * D65_WHITE_XYZ, (40, 50, 3))
    other = one * [1.02, 1.0, 0.9]
    expected = float(delta_e_2000(one[0, 0], other[0, 0]))
    assert scielab_differences(one, other, 30.0) == pytest.approx(expected, rel=1e-6)


def test_scielab_of_gratings() -> None:
    """A grating keeps the amplitudes that the filters have at its frequency; gray is no axis of the opponent colors."""
    per_degree, cycles = 61.0, 8
    x = np.arange(61 * 4) / per_degree
    grating = 0.3 + 0.01 * np.cos(2 * np.pi * cycles * x)
    image = np.tile(grating[None, :, None], (61, 1, 1)) * D65_WHITE_XYZ
    even = np.full_like(image, 0.3) * D65_WHITE_XYZ
    k = np.arange(61) - 30
    gains = [kernel.sum(axis=0) @ np.cos(2 * np.pi * cycles * k / per_degree) for kernel in scielab_kernels(per_degree)]
    kept = np.linalg.inv(OPPONENT_FROM_XYZ) @ (gains * (OPPONENT_FROM_XYZ @ (0.01 * D65_WHITE_XYZ)))
    expected = max(delta_e_2000(even[0, 0] + sign * kept, even[0, 0]) for sign in (-1.0, 1.0))
    seen = scielab_differences(image, even, per_degree)[:, 61:-61].max()
    assert seen == pytest.approx(float(expected), rel=0.01)


def visual_noise(picture: Array) -> Result:
    return measure(picture, "macbeth", only=["visual-noise"], options={"visual-noise": VIEWING})["visual-noise"]


def test_visual_noise_is_the_visible_lightness() -> None:
    random = np.random.default_rng(3)
    found = visual_noise(noisy_picture(random, np.full(3, 0.004)))
    expected = visible_lightness(0.004)
    assert found["sigma_lightness"].value == pytest.approx(expected, rel=0.03)
    assert found["visual_noise_2013"].value == pytest.approx(3.0 * expected, rel=0.05)
    assert found["visual_noise_cpiq"].value == pytest.approx(math.log10(1 + 23.0 * expected**2), rel=0.05)


def test_chrominance_noise_is_less_visible_than_its_size_in_lightness() -> None:
    random = np.random.default_rng(4)
    red_blue = random.normal(0.0, 0.01, (*SHAPE, 1)) * (SRGB_FROM_XYZ @ [1.0, 0.0, -1.0])
    found = visual_noise(0.2 + red_blue)
    assert (found["sigma_lightness"].value or 1) < 0.1 * (found["sigma_b"].value or 0)


def test_visible_snr_falls_with_noise() -> None:
    random = np.random.default_rng(5)
    little, much = (visual_noise(noisy_picture(random, np.array([size] * 3)))["vsnr"] for size in (0.002, 0.004))
    assert (little.value or 0) / (much.value or 1) == pytest.approx(2.0, rel=0.1)


def test_raw_frames_and_small_patches() -> None:
    with raises(InputError, what="visual-noise"):
        visual_noise(np.full(SHAPE, 100.0))
    picture = noisy_picture(np.random.default_rng(6), np.array([0.004] * 3))
    far = measure(picture, "macbeth", only=["visual-noise"], options={"visual-noise": {"distance_mm": 3000.0}})
    assert "patches-below-a-degree" in {entry.id for entry in far.diagnostics}
