"""Light far from its source: tails of diffraction over six decades, and veiling glare beside a bright window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import photosite as ps
from photosite.values.region import Region

D200 = ps.load_sensor("nikon-d200")
ROWS, COLS, MARGIN = 96, 152, 30  # pixels of the chart, and of the dark border that collects scattered light


def center_mean(mean_e: np.ndarray, region: Region) -> float:
    """Mean electrons of the green pixels in a patch, without its border."""
    part = mean_e[region.r0 + 3 : region.r1 - 3, region.c0 + 3 : region.c1 - 3]
    odd = (np.indices(part.shape).sum(axis=0) + region.r0 + region.c0) % 2 == 1
    return float(part[odd].mean())


def gray_levels(f_number: float) -> np.ndarray:
    """Mean electrons of 36 gray patches over six decades, relative to the brightest."""
    lens = ps.DiffractionLimited(f_number=f_number, focal_length_mm=50)
    camera = ps.Camera(lens, D200.with_(rows=ROWS + 2 * MARGIN, cols=COLS + 2 * MARGIN))
    scene = ps.charts.hdr_patches("D65", 3000.0)
    width_m = COLS * D200.pixel.width_um.value * 1e-6 / lens.magnification(scene.distance_m)
    scene = replace(scene, width_m=width_m)
    mean_e = camera.mean_electrons(scene, 1e-3)
    levels = np.array([center_mean(mean_e, region) for region in camera.image_regions(scene)])
    return levels / levels[0]


def test_diffraction_limits_what_is_seen_of_six_decades() -> None:
    """Patches follow their luminance while they are bright. The far tails of the brightest fill the darkest, the more
    so the larger the f-number."""
    own = 10.0 ** -np.linspace(0, 6, 36)
    at_f4, at_f8 = gray_levels(4.0), gray_levels(8.0)
    bright = own > 5e-3
    assert at_f4[bright] == pytest.approx(own[bright], rel=0.25)
    assert at_f4[-1] > 5 * own[-1]
    assert at_f8[-1] > 1.4 * at_f4[-1]


def test_glare_reduces_contrast_by_its_fraction_of_the_mean_light() -> None:
    """A ColorChecker beside a window 100 times as bright as its white patch."""
    chart = ps.charts.macbeth("D65", 40)
    white = next(region for region in chart.regions if region.name == "white")
    beside = np.zeros((len(chart.weights), chart.shape[0], 92), np.float32)
    beside[:, 12:-12, 32:84] = 100 * chart.weights[:, white.r0, white.c0, None, None]
    scene = replace(chart, weights=np.concatenate([chart.weights, beside], axis=2))
    sensor = D200.with_(rows=140, cols=306)

    def contrast(glare: ps.optics.VeilingGlare | None) -> tuple[float, float]:
        lens = ps.Lens(ps.DiffractionLimited(f_number=4, focal_length_mm=50), veiling_glare=glare)
        camera = ps.Camera(lens, sensor)
        mean_e = camera.mean_electrons(scene, 1e-2)
        green = {region.name: center_mean(mean_e, region) for region in camera.image_regions(scene)}
        odd = np.indices(mean_e.shape).sum(axis=0) % 2 == 1
        return green["white"] / green["black"], float(mean_e[odd].mean()) / green["white"]

    sharp, mean = contrast(None)
    veil = 0.01 * mean / 0.99
    assert veil > 0.1
    assert contrast(ps.optics.VeilingGlare(0.01))[0] == pytest.approx((1 + veil) / (1 / sharp + veil), rel=1e-3)
