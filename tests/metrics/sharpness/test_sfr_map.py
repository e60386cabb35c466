"""Responses over the field against blurs that differ from square to square, and a lens whose point spread changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from raising import raises
from scipy.optimize import brentq

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import ImageQuality
from photosite.studies.measurements.sfr_map import DIRECTIONS, PARTS, SIZE, mean_mtf50
from photosite.studies.virtual_charts import VirtualEdge, virtual_squares


def measured(image: Any, **placing: Any) -> ImageQuality:
    return ps.measure(image, "slanted-squares", chart_options={"down": 3, "across": 4}, **placing)


def test_the_map_is_that_of_the_blurs() -> None:
    squares = virtual_squares(np.random.default_rng(2), SIZE)
    result = measured(squares.electrons)["sfr-map"]
    maps = {found.part: found.values for found in result.maps}
    for part, vertical in (("vertical edges", True), ("horizontal edges", False)):
        wanted = [[squares.mtf50((r, c), vertical) for c in range(4)] for r in range(3)]
        assert np.abs(maps[part] / wanted - 1.0).max() < 0.04  # four standard deviations of 1 %
    assert np.allclose(maps["all edges"], 0.5 * (maps["vertical edges"] + maps["horizontal edges"]), rtol=1e-9)


def test_astigmatism_and_direction_are_those_put_in() -> None:
    """The logarithms of MTF50 differ by 0.3 (x^2 - y^2) + 0.1 between vertical and horizontal edges."""
    blurs = {}
    for r, c in PARTS["field"]:
        x, y = (120 * (c + 0.5) - 240) / 300, (120 * (r + 0.5) - 180) / 300
        half = 0.5 * (0.3 * (x * x - y * y) + 0.1)
        blurs[r, c] = sigma_of(0.2 * math.exp(half)), sigma_of(0.2 * math.exp(-half))
    result = measured(virtual_squares(np.random.default_rng(3), SIZE, blurs=blurs).electrons)["sfr-map"]
    for name, wanted in (("astigmatism_percent", 30.0), ("direction_percent", 10.0)):
        found = result[name]
        assert found.value == pytest.approx(wanted, abs=3.0 * (found.standard_uncertainty or 0.0))
        assert (found.standard_uncertainty or 0.0) < 0.1 * 30.0


def sigma_of(mtf50: float) -> float:
    edge = (VirtualEdge(np.zeros(0), sigma, math.radians(5.0)) for sigma in (0.1, 3.0))
    low, high = (each.sigma_px for each in edge)
    response = lambda sigma: VirtualEdge(np.zeros(0), sigma, math.radians(5.0)).response(mtf50) - 0.5  # noqa: E731
    return float(brentq(response, low, high))


@pytest.mark.parametrize("turned", [False, True])
def test_the_chart_is_found(turned: bool) -> None:
    squares = virtual_squares(np.random.default_rng(4), SIZE)
    image = np.pad(squares.electrons, ((40, 60), (90, 20)), mode="edge")
    wanted = [(40, 90), (40, 570), (400, 570), (400, 90)]
    if turned:
        image = np.rot90(image)
        wanted = [(590 - col, row) for row, col in wanted]
    quality = measured(image, detect=True)
    assert quality.chart.found == "detected"
    # Squares look the same after half a turn.
    assert np.abs(np.sort(quality.chart.corners, axis=0) - np.sort(wanted, axis=0)).max() < 1.0
    names = list(DIRECTIONS)[:: -1 if turned else 1]
    for name, other in zip(DIRECTIONS, names, strict=True):
        assert quality["sfr-map"][name, "field"].value == pytest.approx(mean_mtf50(squares, other, "field"), rel=0.01)


def test_squares_that_distortion_displaces_are_measured() -> None:
    squares = virtual_squares(np.random.default_rng(5), SIZE, move=15.0)
    found = measured(squares.electrons)["sfr-map"]["mtf50_vertical", "field"]
    assert found.value == pytest.approx(mean_mtf50(squares, "mtf50_vertical", "field"), rel=0.01)


def test_frames_without_squares_are_refused() -> None:
    random = np.random.default_rng(6)
    even = random.poisson(1000.0, (360, 480)).astype(float)
    with raises(InputError, what="sfr-map"):
        measured(even)["sfr-map"]
    with raises(InputError, what="squares found"):
        measured(even, detect=True)
    with raises(InputError, what="sfr-map"):  # squares of 24 pixels
        measured(virtual_squares(random, SIZE).electrons[::3, ::3])["sfr-map"]


def test_edges_that_are_not_measured_are_named() -> None:
    image = virtual_squares(np.random.default_rng(7), SIZE).electrons
    image[:120, :120] = np.minimum(image[:120, :120] * 1.25, 9500.0)
    result = measured(ChartImage((image,), "electrons", white=9500.0))["sfr-map"]
    (entry,) = (entry for entry in result.diagnostics if entry.id == "edges-left-out")
    assert entry.size == 4
    assert np.isnan(result.maps[0].values[0, 0])
    assert np.isfinite(result.maps[0].values).sum() == 11
    assert len(result.outlines) == 44


def test_outlines_have_an_edge_each() -> None:
    image = virtual_squares(np.random.default_rng(8), SIZE).electrons
    outlines = measured(image)["sfr-map"].outlines
    assert len(outlines) == 48
    for outline in outlines:
        (top, left), (bottom, right) = outline.min(axis=0).astype(int), outline.max(axis=0).astype(int)
        inside = image[top:bottom, left:right]
        low, high = np.percentile(inside, [10, 90])
        assert 0.25 < np.mean(inside > 0.5 * (low + high)) < 0.75
        assert high > 2.0 * low


def test_a_lens_whose_blur_grows_over_the_field() -> None:
    """Gaussian point spreads of 0.5 to 1.0 pixel times the pixel: at the edges' heights within 1.2 %.

    The cells of the simulated frame, a ninth of a pixel, lower MTF50 by 0.6 to 0.9 %.
    """
    chip = ps.load_sensor("vendor-1.4um")
    sensor = chip.with_(rows=280, cols=400, cfa=(("G",),), channels={"G": chip.channels["G"]}, fill_factor=1.0)
    pixel_um, spacing_um = sensor.pixel.width_um.value, sensor.pixel.width_um.value / 5
    heights = np.linspace(0, 1, 9)
    place = (np.arange(61) - 30) * spacing_um / pixel_um
    square = place[:, None] ** 2 + place**2
    spread = np.stack([np.exp(-0.5 * square / (0.5 + 0.5 * height**2) ** 2) for height in heights])[:, None]
    spread /= spread.sum(axis=(-2, -1), keepdims=True)
    edge_mm = math.hypot(280, 400) / 2 * pixel_um * 1e-3
    design = ps.optics.LensDesign(
        np.array([550.0]), spread, spacing_um, 0 * heights, heights * edge_mm, detail_um=pixel_um, nodes=17
    )
    lens = ps.Lens(ps.DiffractionLimited(f_number=2.8, focal_length_mm=50), blur=design)
    camera = ps.Camera(lens, sensor, cells_per_pixel=9)
    scene = ps.charts.slanted_squares("D65", 100, rows=9 * 280, cols=9 * 400, down=2, across=3)
    options = {"down": 2, "across": 3}
    result = ps.measure(camera.mean_electrons(scene, 1 / 100), "slanted-squares", chart_options=options)["sfr-map"]
    for curve in (each for each in result.curves if each.y_label.startswith("MTF50")):
        edges = (VirtualEdge(np.zeros(0), 0.5 + 0.5 * height**2, math.radians(5.0), 1000) for height in curve.x)
        wanted = np.array([edge.crossing(0.5) for edge in edges])
        print(curve.part, curve.x.round(2), (curve.y / wanted - 1.0).round(4))
        assert np.abs(curve.y / wanted - 1.0).max() < 0.012
