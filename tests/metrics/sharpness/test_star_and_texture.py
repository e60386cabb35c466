"""Responses of stars and textures against a Gaussian blur on square pixels that plain NumPy applies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, median_filter
from scipy.optimize import brentq

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import placed_chart
from photosite.metrics.measurement import Result
from photosite.studies.virtual_charts import blurred, response

CELLS, SIDE, SIGMA = 3, 240, 0.5
BAYER = (("R", "G"), ("G", "B"))
"""Samples of a star are means over their area: with the points of a pixel they make a square pixel. Those of a texture
are the texture, as squares."""
TRUE_MTF50 = float(brentq(lambda f: float(response(np.array(f), SIGMA)) - 0.5, 0.05, 0.5))


def chart(name: str, *, squares: bool, **options: Any) -> tuple[NDArray[np.float64], dict[str, Any]]:
    options |= {"rows": CELLS * SIDE, "cols": CELLS * SIDE}
    scene = getattr(ps.charts, name)("D65", 100, **options)
    return blurred(scene.weights[0].astype(float), CELLS, SIGMA, squares=squares), options


@pytest.fixture(scope="module")
def star() -> tuple[NDArray[np.float64], dict[str, Any]]:
    return chart("siemens_star", squares=False, cycles=36)


@pytest.fixture(scope="module")
def leaves() -> tuple[NDArray[np.float64], dict[str, Any]]:
    return chart("dead_leaves", squares=True, smallest_radius=2.0, largest_radius=100.0, supersampling=4)


def star_sfr(values: Any, options: dict[str, Any]) -> Result:
    return ps.measure(values, "siemens-star", only=["star-sfr"], chart_options=options)["star-sfr"]


def texture_sfr(values: Any, options: dict[str, Any], **placing: Any) -> Result:
    return ps.measure(values, "dead-leaves", only=["texture-sfr"], chart_options=options, **placing)["texture-sfr"]


def noisy(random: np.random.Generator, image: NDArray[np.float64], level: float) -> NDArray[np.float64]:
    mean = level * np.maximum(image, 0.0)
    return random.poisson(mean) + random.normal(0.0, 5.0, mean.shape)


def test_star_is_the_blur(star: tuple[NDArray[np.float64], dict[str, Any]]) -> None:
    found = star_sfr(star[0] * 1000, star[1])
    curve = next(each for each in found.curves if each.part == "M")
    shown = curve.x < 0.4
    assert np.abs(curve.y - response(curve.x, SIGMA))[shown].max() < 0.006
    assert found["mtf50", "M"].value == pytest.approx(TRUE_MTF50, rel=0.01)


def test_star_of_a_mosaic(star: tuple[NDArray[np.float64], dict[str, Any]]) -> None:
    image = ChartImage((star[0] * 1000,), "electrons", BAYER)
    found = star_sfr(image, star[1])
    curve = next(each for each in found.curves if each.part == "R")
    assert np.abs(curve.y - response(curve.x, SIGMA)).max() < 0.02


@pytest.mark.parametrize("fall", [0.0, 0.1])
@pytest.mark.parametrize("off", [0.0, 0.7])
def test_texture_is_the_blur(leaves: tuple[NDArray[np.float64], dict[str, Any]], fall: float, off: float) -> None:
    """Without noise, in light that falls to one side, and for corners that are off; the aliases are below 0.001."""
    light = 1.0 + fall * np.linspace(-1.0, 1.0, SIDE)
    corners = ((off, 0.0), (0.0, SIDE - off), (SIDE - off, SIDE), (SIDE, off))
    found = texture_sfr(leaves[0] * 1000 * light, leaves[1], corners=corners)
    for curve in found.curves:
        shown = curve.x < 0.35
        assert np.abs(curve.y - response(curve.x, SIGMA))[shown].max() < 0.003, curve.part
    for kind in ("cross", "direct"):
        assert found[f"mtf50_{kind}", "M"].value == pytest.approx(TRUE_MTF50, rel=0.0025)


def test_texture_of_a_turned_chart(leaves: tuple[NDArray[np.float64], dict[str, Any]]) -> None:
    """A quarter turn clockwise: the chart's top left corner is at the top right of the frame."""
    end = float(SIDE)
    corners = (0.0, end), (end, end), (end, 0.0), (0.0, 0.0)
    found = texture_sfr(np.rot90(leaves[0], -1) * 1000, leaves[1], corners=corners)
    assert found["mtf50_cross", "M"].value == pytest.approx(TRUE_MTF50, rel=0.0025)


def test_texture_of_noisy_mosaic_and_wrong_corners(leaves: tuple[NDArray[np.float64], dict[str, Any]]) -> None:
    """Within 4 standard uncertainties, with the chart one pixel from where its corners are said to be."""
    random = np.random.default_rng(9)
    frames = tuple(noisy(random, leaves[0], 2000.0) for _ in range(2))
    corners = ((1.0, 0.6), (0.3, SIDE - 0.2), (SIDE - 0.5, SIDE - 1.0), (SIDE - 1.0, 0.9))
    found = texture_sfr(ChartImage(frames, "raw", BAYER, white=1e5), leaves[1], corners=corners)
    curve = next(each for each in found.curves if each.part == "G, cross")
    assert curve.standard_uncertainty is not None
    away = np.abs(curve.y - response(curve.x, SIGMA)) / (curve.standard_uncertainty + 0.005)
    assert away[curve.x < 0.35].max() < 4.0


def test_denoised_texture_is_named(leaves: tuple[NDArray[np.float64], dict[str, Any]]) -> None:
    random = np.random.default_rng(10)
    frames = [noisy(random, leaves[0], 300.0) for _ in range(2)]

    def ids(images: list[NDArray[np.float64]]) -> set[str]:
        image = ChartImage(tuple(images), "raw", white=1e5)
        return {entry.id for entry in texture_sfr(image, leaves[1]).diagnostics}

    assert "texture-and-artifacts" not in ids(frames)
    sharpened = [3.0 * median_filter(each, 5) - 2.0 * gaussian_filter(median_filter(each, 5), 2.0) for each in frames]
    assert "texture-and-artifacts" in ids(sharpened)


@pytest.mark.parametrize(("width", "pixel"), [(21, 8), (5, 4), (5, 8)])
def test_texture_of_coarse_samples(width: int, pixel: int) -> None:
    """Samples are squares of even brightness: the image of a perfect camera is their mean over each pixel.

    `width` and `pixel` are the sides of a sample and of a pixel. Aliases in the image scatter the bands by 1 %.
    """
    count = 400 * pixel // width
    options = {"smallest_radius": 1.0, "largest_radius": 60.0, "rows": count, "cols": count}
    scene = ps.charts.dead_leaves("D65", 100, **options).weights[0].astype(float)
    side, end = count * width // pixel, count * width / pixel
    fine = np.repeat(np.repeat(scene, width, 0), width, 1)[: side * pixel, : side * pixel]
    image = fine.reshape(side, pixel, side, pixel).mean(axis=(1, 3))
    corners = (0.0, 0.0), (0.0, end), (end, end), (end, 0.0)
    found = texture_sfr(image * 1000, options, corners=corners)
    curve = next(each for each in found.curves if each.part == "M, cross")
    ratio = curve.y / response(curve.x, 0.0)
    for low in (0.05, 0.15, 0.25, 0.35):
        band = (curve.x >= low) & (curve.x < low + 0.1)
        assert ratio[band].mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("width", "pixel"), [(2, 5), (4, 11), (3, 10)])
def test_texture_of_fine_samples(width: int, pixel: int) -> None:
    """Of 2.5, 2.75 and 3.33 samples in a pixel, each counts by its area; looked up once, they are 4 to 5 % off."""
    count = 240 * pixel // width
    options = {"smallest_radius": 1.0, "largest_radius": 60.0, "rows": count, "cols": count, "supersampling": 2}
    scene = ps.charts.dead_leaves("D65", 100, **options).weights[0].astype(float)
    side, end = count * width // pixel, count * width / pixel
    fine = np.repeat(np.repeat(scene, width, 0), width, 1)[: side * pixel, : side * pixel]
    image = fine.reshape(side, pixel, side, pixel).mean(axis=(1, 3))
    corners = (0.0, 0.0), (0.0, end), (end, end), (end, 0.0)
    curve = next(each for each in texture_sfr(image * 1000, options, corners=corners).curves if each.part == "M, cross")
    ratio = curve.y / response(curve.x, 0.0)
    for low in (0.05, 0.15, 0.25, 0.35):
        band = (curve.x >= low) & (curve.x < low + 0.1)
        assert ratio[band].mean() == pytest.approx(1.0, abs=0.015)


def test_mean_over_a_rectangle_counts_samples_by_area() -> None:
    """Against the plain mean of samples that are cut into tenths."""
    options = {"rows": 40, "cols": 40, "supersampling": 2, "seed": 3}
    image = ChartImage((np.ones((16, 16)),), "electrons")
    placed = placed_chart(image, "dead-leaves", options=options)
    tenths = np.repeat(np.repeat(placed.scene.weights[0].astype(float), 10, 0), 10, 1)
    for row, col in ((12.3, 20.7), (1.4, 38.5)):
        (r0, r1), (c0, c1) = ((round(10 * (at - 0.6)), round(10 * (at + 0.6))) for at in (row, col))
        found = placed.gray_over(np.array([[row, col]]), (1.2, 1.2))
        assert found[0] == pytest.approx(tenths[r0:r1, c0:c1].mean(), rel=1e-6)
