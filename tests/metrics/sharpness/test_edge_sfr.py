"""The response of edges: the standard's arithmetic, and frames that mislead it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from raising import raises

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.metrics.sharpness.iso_12233 import edge_sfr
from photosite.studies.virtual_charts import virtual_edge


def measured(image: object, **options: object) -> Result:
    return measure(image, "slanted-edge", options={"edge-sfr": options})["edge-sfr"]  # type: ignore[arg-type]


def test_uneven_light_is_named() -> None:
    edge = virtual_edge(np.random.default_rng(1))
    light = 1.0 + 0.2 * np.linspace(-1, 1, edge.electrons.shape[1])
    assert "uneven-light-on-edge" in {entry.id for entry in measured(edge.electrons * light).diagnostics}
    assert "uneven-light-on-edge" not in {entry.id for entry in measured(edge.electrons).diagnostics}


def test_sharpening_is_named() -> None:
    edge = virtual_edge(np.random.default_rng(3)).electrons
    lines = np.pad(edge, ((0, 0), (1, 1)), mode="edge")
    sharpened = edge + 1.0 * (edge - (lines[:, :-2] + edge + lines[:, 2:]) / 3.0)
    assert "sharpened-image" in {entry.id for entry in measured(sharpened).diagnostics}
    assert "sharpened-image" not in {entry.id for entry in measured(edge).diagnostics}
    assert (measured(sharpened)["overshoot_percent"].value or 0) > 2


def test_channels_of_a_picture_and_a_mosaic() -> None:
    edge = virtual_edge(np.random.default_rng(4)).electrons
    picture = np.stack([edge, edge, edge], axis=-1) / edge.max() / 1.1
    found = measured(picture)
    assert found["mtf50", "R"].value == pytest.approx(found["mtf50", "Y"].value)
    mosaic = measured(ChartImage((edge,), "electrons", (("R", "G"), ("G", "B"))))
    assert {part for _, part in mosaic.values} == {"R", "G", "B"}
    assert mosaic["mtf50", "G"].value == pytest.approx(found["mtf50", "G"].value, rel=0.15)


def test_saturated_and_empty_frames_are_refused() -> None:
    edge = virtual_edge(np.random.default_rng(5)).electrons
    with raises(InputError, what="edge-sfr"):
        measured(np.full((100, 100), 50.0))
    clipped = np.minimum(edge, np.median(edge))
    image = ChartImage((clipped,), "electrons", white=float(clipped.max()))
    with raises(InputError, what="edge-sfr"):
        measured(image)


PUBLISHED = {"h_edge.tif": (0.1983, 0.1967), "v_edge.tif": (0.1982, 0.1964)}
"""MTF50 of two public edges by sfrmat5: straight line, polynomial of order 5."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_edges(published_edges: Path, name: str) -> None:
    """Within 0.5 %: the edges of the public repository danieleceUL/nssfr_sfrmat5."""
    values = tifffile.imread(published_edges / name).astype(float)[..., :3] @ [0.213, 0.715, 0.072]
    for order, published in zip((1, 5), PUBLISHED[name], strict=True):
        frequency, response = edge_sfr(values, order)
        k = int(np.argmax(response < 0.5))
        crossing = np.interp(0.5, response[[k, k - 1]], frequency[[k, k - 1]])
        assert crossing == pytest.approx(published, rel=0.005)


def test_standard_arithmetic_on_a_known_edge() -> None:
    edge = virtual_edge(np.random.default_rng(7))
    found = measured(edge.electrons)
    truth = edge.crossing(0.5)
    assert truth is not None
    assert found["mtf50_standard"].value == pytest.approx(truth, rel=0.03)


def test_an_edge_in_a_large_frame_is_that_of_its_surroundings() -> None:
    """Lines and pixels far from the edge do not count: the response is that of the part around it."""
    edge = virtual_edge(np.random.default_rng(8)).electrons
    rows = len(edge)
    wide = np.pad(edge, ((0, 0), (400, 700)), mode="edge")
    random = np.random.default_rng(9)
    wide[:, :400] += random.normal(0.0, 5.0, (rows, 400))
    found, part = measured(wide, reach_px=20), measured(edge, reach_px=20)
    assert found["mtf50"].value == pytest.approx(part["mtf50"].value, rel=0.02)
    turned = measured(wide.T, reach_px=20)
    assert turned["mtf50"].value == pytest.approx(found["mtf50"].value, rel=1e-6)
