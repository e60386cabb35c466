"""The page of the study and its files."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from photosite.report.page import Details, Heading, Listing, Table
from photosite.report.write import render_page
from photosite.studies.farrell2008 import table1
from photosite.studies.farrell2008.page.drawing import Drawing
from photosite.studies.farrell2008.page.page import (
    FIGURES_NAME,
    PAGE_NAME,
    PARTS,
    RESULTS_NAME,
    study_page,
    study_parts,
    write_study,
)
from photosite.studies.farrell2008.study import CHAPTERS, Reproduction, reproduce


@pytest.fixture(autouse=True, scope="module")
def small_frames() -> Iterator[None]:
    """Make the frames of the calibrations small."""
    with pytest.MonkeyPatch.context() as patch:
        for key, size in {"d200": (32, 48), "vendor": (96, 128)}.items():
            patch.setitem(table1.SIZES, key, size)
        yield


@pytest.fixture(scope="module")
def study(small_frames: None) -> Reproduction:
    return reproduce(2008, ["table1"])


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_every_chapter_is_drawn() -> None:
    assert list(PARTS) == [chapter.key for chapter in CHAPTERS]


def test_the_same_seed_gives_the_same_bytes_except_for_times(study: Reproduction, tmp_path: Path) -> None:
    written = []
    for name, one in (("a", study), ("b", reproduce(2008, ["table1"]))):
        (tmp_path / name).mkdir()
        write_study(one, tmp_path / name)
        written.append(files(tmp_path / name))
    first, second = written
    assert set(first) == set(second)
    for name, content in first.items():
        if name != RESULTS_NAME:
            assert content == second[name], name
    numbers, others = (json.loads(each[RESULTS_NAME]) for each in written)
    assert numbers.pop("seconds") != others.pop("seconds")
    assert json.dumps(numbers) == json.dumps(others)


def test_another_seed_gives_other_numbers(study: Reproduction) -> None:
    other = reproduce(2009, ["table1"]).to_dict()
    mine = study.to_dict()
    for key in ("d200", "vendor"):
        assert mine["hidden_truth"][key] != other["hidden_truth"][key]
        mine_row, other_row = (
            entry["chapters"]["table1"]["cameras"][key]["parameters"]["read_noise_mv"] for entry in (mine, other)
        )
        assert mine_row["value"] != other_row["value"]
        assert mine_row["paper"] == other_row["paper"]


def test_the_page_contains_every_table_figure_and_line(study: Reproduction) -> None:
    """The text of the parts and of results.json is in the text of the page."""
    parts = study_parts(study)
    text = html.unescape(re.sub(r"<[^>]*>", " ", render_page(study_page(study, parts))))
    text = " ".join(text.split())

    def assert_there(block: object) -> None:
        if isinstance(block, Table):
            assert " ".join(block.caption.split()) in text
            for row in block.rows:
                for cell in (row.text,) if isinstance(row, Heading) else row:
                    assert " ".join(cell.split()) in text, (block.caption, cell)
        elif isinstance(block, Listing):
            for line in block.lines:
                assert " ".join(line.split()) in text, line
        elif isinstance(block, Details):
            for inner in block.blocks:
                assert_there(inner)
        elif isinstance(block, Drawing):
            assert " ".join(block.caption.split()) in text

    tables = 0
    for part in parts.values():
        for block in part:
            tables += isinstance(block, Table)
            assert_there(block)
    assert tables == 3
    for camera in study.to_dict()["chapters"]["table1"]["cameras"].values():
        for row in camera["parameters"].values():
            assert row["difference"] in text


def test_the_page_is_self_contained_and_states_what_measured_means(study: Reproduction) -> None:
    page = render_page(study_page(study, study_parts(study)))
    assert "come from a virtual camera" in page
    assert not re.search(r"<(script|link|iframe)\b", page)
    assert all(address.startswith(("data:", "#")) for address in re.findall(r'(?:src|href)="([^"]*)"', page))


def test_figures_are_written_in_both_formats(study: Reproduction, tmp_path: Path) -> None:
    write_study(study, tmp_path)
    drawn = {entry.name for part in study_parts(study).values() for entry in part if isinstance(entry, Drawing)}
    assert {path.name for path in (tmp_path / FIGURES_NAME).iterdir()} == {
        f"{name}.{ending}" for name in drawn for ending in ("svg", "png")
    }
    assert (tmp_path / FIGURES_NAME / "table1-deviations.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / PAGE_NAME).is_file()
