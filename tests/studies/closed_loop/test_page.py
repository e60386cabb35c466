"""The page of a closed loop."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from photosite.report.page import Images
from photosite.report.pictures import WIDEST
from photosite.studies.closed_loop.page import parameter_blocks, write_demo_report


@pytest.fixture(scope="module")
def path(loop, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("demo") / "demo.html"
    write_demo_report(loop, path)
    assert path.stat().st_size < 3_000_000
    return path


@pytest.fixture(scope="module")
def page(path: Path, read_page):
    return read_page(path.read_text(encoding="utf-8"))


def test_page_needs_no_other_file(page) -> None:
    assert all(address.startswith("#") for address in page.values("href"))
    assert all(source.startswith("data:image/") for source in page.values("src"))
    assert not {tag for tag, _ in page.elements} & {"script", "link", "iframe"}


def test_page_states_that_the_camera_is_virtual(page) -> None:
    assert "All images on this page come from a virtual camera." in page.text


def test_every_parameter_is_listed_with_its_truth(loop, page) -> None:
    rows = {(row[0], row[1]): row for row in page.rows}
    for parameter in loop.parameters:
        row = rows[parameter.label, parameter.unit]
        if parameter.estimated is None:
            assert row[2] == parameter.reason
        elif parameter.deviation is not None:
            assert float(row[4].replace("−", "-")) == pytest.approx(parameter.deviation, abs=0.0051)
    assert any(parameter.estimated is None for parameter in loop.parameters), "photons are not known in this loop"


def test_estimates_inside_the_band_are_counted(loop) -> None:
    far = tuple(
        replace(p, estimated=p.true + 5 * p.standard_uncertainty) if p.name == "read_noise_mv" else p
        for p in loop.parameters
    )
    drawn = [p for p in far if p.deviation is not None]
    inside = sum(abs(p.deviation) <= 1.96 for p in drawn)
    assert inside < len(drawn)
    figure = parameter_blocks(far)[-1]
    assert isinstance(figure, Images)
    assert f"here {inside} of {len(drawn)}." in figure.caption


def test_pictures_fit_the_page(page) -> None:
    pictures = [np.asarray(Image.open(io.BytesIO(content))) for content in page.images("image/jpeg")]
    assert len(pictures) == 5, "two charts, two details, their difference"
    assert all(picture.shape[1] <= WIDEST for picture in pictures)
    chart, calibrated, *_, difference = pictures
    assert chart.shape == calibrated.shape == difference.shape
    # The two cameras agree to well within a just visible difference; the difference picture is gray on average.
    assert np.abs(chart.mean(axis=(0, 1)) - calibrated.mean(axis=(0, 1))).max() < 1.0
    assert np.abs(difference.mean(axis=(0, 1)) - 127.5).max() < 4.0
    assert chart.std() > 30


def test_same_loop_gives_the_same_bytes(loop, path: Path, tmp_path: Path) -> None:
    write_demo_report(loop, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == path.read_bytes()
