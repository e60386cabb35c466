"""Frames that do not show their chart are named by every measurement, or have no values."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Measured, Result
from photosite.metrics.registry import charts_measured
from photosite.scene.scene_request import SceneRequest

Array = NDArray[np.float64]
SHAPE, WHITE = (264, 392), 24000.0
CHARTS = charts_measured()
pytestmark = pytest.mark.filterwarnings("ignore:.*response lies outside the scene's wavelengths")
NO_FRAMES = ("chart-light", "sensitivity-metamerism")
"""Measurements of the light and of the sensor."""
EVEN = ("shading", "defects", "noise-spectrum", "dust")
USABLE = {
    "clipped": {
        *((chart, name) for chart in ("color-checker-sg", "hdr-patches", "macbeth", "gray-steps")
          for name in ("oecf", "noise", "contrast-detection", "visual-noise")),
        ("point-grid", "distortion"),
        ("point-grid", "lateral-color"),
    },
    "blurred": {("gray-steps", "contrast-detection"), *(("uniform", name) for name in EVEN)},
    "uniform": {("uniform", name) for name in EVEN},
    "dark": {("uniform", "noise-spectrum")},
}  # fmt: skip
"""Noise of dark frames has a spectrum. Patches that are not clipped are measured, contrasts that saturation takes away
are, and borders of dots; an even field is even when it is blurred, and blur takes contrasts away."""


@cache
def mean_electrons(chart: str) -> Array:
    camera = ps.Camera(
        ps.DiffractionLimited(f_number=4, focal_length_mm=50),
        ps.load_sensor("sony-imx174").with_(rows=SHAPE[0], cols=SHAPE[1]),
    )
    scene = SceneRequest(chart, {"illuminant": "D65", "mean_luminance_cd_m2": 100}).scene()
    mean = np.asarray(camera.mean_electrons(scene, 1.0), np.float64)
    return 20000.0 / np.percentile(mean, 99.5) * mean


def bad(kind: str, chart: str) -> Array:
    if kind == "uniform":
        return np.full(SHAPE, 8000.0)
    if kind == "dark":
        return np.zeros(SHAPE)
    if kind == "clipped":
        return 3.0 * mean_electrons(chart)
    if kind == "blurred":
        return np.asarray(gaussian_filter(mean_electrons(chart), 25))
    edge = "siemens-star" if chart == "slanted-edge" else "slanted-edge"
    other = {"wrong edge": edge, "wrong patches": "dead-leaves" if chart == "macbeth" else "macbeth"}
    return mean_electrons(other[kind])


def raw(mean: Array, random: np.random.Generator) -> ChartImage:
    electrons = random.poisson(mean) + random.normal(300, 5, mean.shape)
    return ChartImage((np.clip(electrons, 0, WHITE),), "raw", black=300.0, white=WHITE)


def picture(mean: Array, random: np.random.Generator) -> ChartImage:
    electrons = random.poisson(np.repeat(mean[..., None], 3, axis=2)) + random.normal(0, 5, (*mean.shape, 3))
    return ChartImage((np.clip(electrons / WHITE, 0, 1),), "picture", white=1.0)


def named(found: Measured) -> bool:
    if not isinstance(found, Result) or all(value.value is None for value in found.values.values()):
        return True
    return any(entry.severity == "warning" for entry in found.diagnostics)


@pytest.mark.parametrize("kind", ["uniform", "dark", "wrong edge", "wrong patches", "clipped", "blurred"])
@pytest.mark.parametrize("make", [raw, picture])
def test_bad_frames_are_named(kind: str, make: type) -> None:
    random = np.random.default_rng(5)
    unnamed = []
    for chart in CHARTS:
        results = measure(make(bad(kind, chart), random), chart).results
        unnamed += [
            (chart, name)
            for name, found in results.items()
            if name not in NO_FRAMES and (chart, name) not in USABLE.get(kind, set()) and not named(found)
        ]
    assert not unnamed


def test_good_frames_are_measured() -> None:
    """The same frames without a fault have results; a measurement that needs more says which."""
    random = np.random.default_rng(6)
    for chart, name in (
        *(("macbeth", name) for name in ("oecf", "noise", "contrast-detection")),
        *(("slanted-edge", name) for name in ("edge-sfr", "acutance", "information-capacity")),
        *(("uniform", name) for name in ("shading", "defects")),
        *(("siemens-star", "star-sfr"), ("dead-leaves", "texture-sfr"), ("flare-traps", "flare")),
        *(("point-grid", "distortion"), ("hdr-patches", "noise"), ("color-checker-sg", "oecf")),
    ):
        found = measure(raw(mean_electrons(chart), random), chart, only=[name]).results[name]
        if (chart, name) == ("dead-leaves", "texture-sfr"):
            continue  # leaves that are finer than pixels take a larger chart
        assert isinstance(found, Result), found
        assert any(value.value is not None for value in found.values.values()), (chart, name)


@pytest.mark.parametrize(("sigma_px", "named"), [(5.0, False), (8.0, True), (20.0, True)])
def test_an_edge_that_is_wider_than_its_profile(sigma_px: float, named: bool) -> None:
    """The profile of 64 pixels does not hold the edge: without the check MTF50 was 2 to 50 % too high."""
    from scipy.special import ndtr

    y, x = np.mgrid[:300, :300] + 0.5
    across = np.cos(np.radians(5)) * (x - 150) + np.sin(np.radians(5)) * (y - 150)
    edge = np.random.default_rng(7).poisson(2000 + 8000 * ndtr(across / sigma_px)).astype(float)
    found = measure(edge, "slanted-edge", only=["edge-sfr"]).results["edge-sfr"]
    assert isinstance(found, Result) != named
    if isinstance(found, Result):
        truth = np.sqrt(np.log(2) / 2) / np.pi / sigma_px
        assert found["mtf50"].value == pytest.approx(truth, rel=0.005)
