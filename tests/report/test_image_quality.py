"""The first page of reports of image quality: verdicts or headline values, and figures, from the registry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photosite.metrics.camera_quality import CameraQuality
from photosite.metrics.limits import Limit, Limits
from photosite.metrics.measure import ImageQuality, measure
from photosite.metrics.measurement import Result
from photosite.metrics.registry import measurements
from photosite.report.image_quality import camera_quality_page, image_quality_page, judged_page
from photosite.report.page import Gallery, Page, Tile, Tiles
from photosite.report.write import render_page
from photosite.studies.virtual_charts import virtual_edge
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing


@pytest.fixture(scope="module")
def edge() -> ImageQuality:
    return measure(virtual_edge(np.random.default_rng(1)).electrons, "slanted-edge", options={"edge-sfr": {"order": 1}})


def tiles(page: Page) -> tuple[Tile, ...]:
    return next(block.tiles for block in page.overview if isinstance(block, Tiles))


def titles(page: Page) -> list[str]:
    return [card.image.title for block in page.overview if isinstance(block, Gallery) for card in block.cards]


def test_every_measurement_states_its_headline() -> None:
    for entry in measurements().values():
        assert entry.headline, entry.id
        assert set(entry.headline) <= set(entry.quantities), entry.id


def test_headline_values_and_figures_without_limits(edge: ImageQuality) -> None:
    page = image_quality_page(edge)
    labels = [tile.label for tile in tiles(page)]
    measured = [measurements()[id] for id in edge.results if id != "moving-edge"]
    assert len(labels) == sum(len(entry.headline) for entry in measured)
    value = edge["edge-sfr"]["mtf50"].value
    assert float(tiles(page)[0].text) == pytest.approx(value, abs=2e-3)
    assert tiles(page)[0].note.endswith("cycles/pixel")
    assert titles(page) == ["Chart", *(entry.title for entry in measured if entry.figure)]


def test_verdicts_of_limits(edge: ImageQuality) -> None:
    middle = edge["edge-sfr"]["mtf50"].value
    texts = ("edge-sfr.mtf50 >= 0.01", "edge-sfr.mtf50 >= 0.49", f"edge-sfr.mtf50 >= {middle}", "noise.snr_18_db >= 1")
    page = judged_page(Limits(tuple(map(Limit.parse, texts)), name="mine").judge(edge))
    assert [tile.state for tile in tiles(page)] == ["pass", "fail", "undecided", "missing"]
    assert [tile.text for tile in tiles(page)] == [tile.state for tile in tiles(page)]
    html = render_page(page)
    assert "mine: no pass (1 pass, 1 fail, 1 undecided, 1 missing)" in html
    assert "Options: order = 1." in html


def test_links_lead_to_sections(edge: ImageQuality, read_page) -> None:
    for page in (image_quality_page(edge), camera_quality_page(CameraQuality("two", {"edge": edge, "corner": edge}))):
        read = read_page(render_page(page))
        ids = read.values("id")
        assert len(ids) == len(set(ids))
        assert {link.removeprefix("#") for link in read.values("href")} <= {*ids}


def test_photographs_of_one_chart_are_named(edge: ImageQuality) -> None:
    page = camera_quality_page(CameraQuality("two", {"edge": edge, "corner": edge}))
    assert [tile.label for tile in tiles(page)][:4:2] == ["MTF50, M (edge)", "MTF50, M (corner)"]
    rows = Limits((Limit.parse("edge-sfr.mtf50 >= 0.01"),)).judge(CameraQuality("two", {"edge": edge, "corner": edge}))
    assert [row.chart for row in rows.rows] == ["edge", "corner"]


def test_one_of_several_charts_is_shown(edge: ImageQuality) -> None:
    charts = {}
    for place, name in enumerate(("gray-steps", "macbeth")):
        result = Result({("exponent", "M"): Estimate(1.0 + place, 0.01)}, measurement=measurements()["oecf"])
        charts[name] = replace(edge, chart=replace(edge.chart, name=name), results={"oecf": result})
    (tile,) = tiles(camera_quality_page(CameraQuality("gray", charts)))
    assert (tile.text, tile.label) == ("2.000", "exponent, M (macbeth)"), "the first chart of the measurement"


def test_a_photograph_without_a_value_is_named(edge: ImageQuality) -> None:
    without = replace(edge, results={**edge.results, "edge-sfr": Missing("saturated")})
    html = render_page(camera_quality_page(CameraQuality("two", {"edge": edge, "corner": without})))
    assert "Not measured, with the reasons below: moving-edge, edge-sfr (corner)." in html
