"""Chapters and the order in which they run, the page with its summary, and the files."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from photosite.errors import InputError
from photosite.report.page import Details, Heading, Listing, Table
from photosite.report.write import render_page
from photosite.studies.farrell2008 import study as module
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow
from photosite.studies.farrell2008.study import (
    CHAPTERS,
    FIGURES_NAME,
    PAGE_NAME,
    RESULTS_NAME,
    Chapter,
    Reproduction,
    reproduce,
)
from photosite.studies.progress import Progress


class Number:
    def __init__(self, value: int) -> None:
        self.value = value

    def to_dict(self) -> dict[str, int]:
        return {"value": self.value}

    def part(self) -> Part:
        return ()

    def summary(self) -> tuple[SummaryRow, ...]:
        return ()


def test_chapters_follow_those_they_need() -> None:
    keys = [chapter.key for chapter in CHAPTERS]
    assert len(set(keys)) == len(keys)
    for place, chapter in enumerate(CHAPTERS):
        assert set(chapter.needs) <= set(keys[:place]), chapter.key


def test_chapters_run_in_order_with_the_results_they_need(monkeypatch: pytest.MonkeyPatch) -> None:
    def second(seed: int, progress: Progress, results: Mapping[str, Any]) -> Number:
        return Number(results["first"].value + 1)

    chapters = (
        Chapter("first", "First", lambda seed, *_: Number(seed)),
        Chapter("other", "Other", lambda *_: Number(0)),
        Chapter("second", "Second", second, needs=("first",)),
    )
    monkeypatch.setattr(module, "CHAPTERS", chapters)
    found = reproduce(5, ["second"]).to_dict()
    assert found["chapters"] == {"first": {"value": 5}, "second": {"value": 6}}
    assert list(found["seconds"]) == ["first", "second"]
    assert set(reproduce(5).results) == {"first", "other", "second"}


def test_an_unknown_chapter_is_rejected() -> None:
    with pytest.raises(InputError) as caught:
        reproduce(5, ["tabel1"])
    assert caught.value.hint == "Did you mean 'table1'?"


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_same_seed_gives_the_same_bytes_except_for_times(
    table1_study: Reproduction, reproduce_table1: Callable[[int], Reproduction], tmp_path: Path
) -> None:
    written = []
    for name, one in (("a", table1_study), ("b", reproduce_table1(2008))):
        (tmp_path / name).mkdir()
        one.write(tmp_path / name)
        written.append(files(tmp_path / name))
    first, second = written
    assert set(first) == set(second)
    for name, content in first.items():
        if name != RESULTS_NAME:
            assert content == second[name], name
    numbers, others = (json.loads(each[RESULTS_NAME]) for each in written)
    assert numbers.pop("seconds") != others.pop("seconds")
    assert json.dumps(numbers) == json.dumps(others)
    assert PAGE_NAME in first
    assert first[f"{FIGURES_NAME}/table1-deviations.png"][:4] == b"\x89PNG"
    assert b"<svg" in first[f"{FIGURES_NAME}/table1-deviations.svg"]


def test_another_seed_gives_other_numbers(
    table1_study: Reproduction, reproduce_table1: Callable[[int], Reproduction]
) -> None:
    other = reproduce_table1(2009).to_dict()
    mine = table1_study.to_dict()
    for key in ("d200", "vendor"):
        assert mine["hidden_truth"][key] != other["hidden_truth"][key]
        mine_row, other_row = (
            entry["chapters"]["table1"]["cameras"][key]["parameters"]["read_noise_mv"] for entry in (mine, other)
        )
        assert mine_row["value"] != other_row["value"]
        assert mine_row["paper"] == other_row["paper"]


@pytest.mark.usefixtures("unrendered")
def test_the_page_contains_every_table_figure_and_line(table1_study: Reproduction) -> None:
    """The text of the parts and of results.json is in the text of the page."""
    parts = table1_study.parts()
    text = html.unescape(re.sub(r"<[^>]*>", " ", render_page(table1_study.page(parts))))
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
    for camera in table1_study.to_dict()["chapters"]["table1"]["cameras"].values():
        for row in camera["parameters"].values():
            assert row["difference"] in text


@pytest.mark.usefixtures("unrendered")
def test_the_page_is_self_contained_and_states_what_measured_means(table1_study: Reproduction) -> None:
    page = render_page(table1_study.page(table1_study.parts()))
    assert "come from a virtual camera" in page
    assert not re.search(r"<(link|iframe)\b|<script[^>]*\bsrc", page)
    assert all(address.startswith(("data:", "#")) for address in re.findall(r'(?:src|href)="([^"]*)"', page))


@pytest.mark.usefixtures("unrendered")
def test_figures_are_written_in_both_formats(table1_study: Reproduction, tmp_path: Path) -> None:
    table1_study.write(tmp_path)
    drawn = {entry.name for part in table1_study.parts().values() for entry in part if isinstance(entry, Drawing)}
    assert {path.name for path in (tmp_path / FIGURES_NAME).iterdir()} == {
        f"{name}.{ending}" for name in drawn for ending in ("svg", "png")
    }


def test_the_summary_contains_the_results_of_every_chapter(table1_study, charts, snr, sizes, face, hdr) -> None:
    results = (table1_study.results["table1"], *charts, snr, sizes, face, hdr)
    whole = Reproduction(2008, dict(zip([chapter.key for chapter in CHAPTERS], results, strict=True)), {})
    (summary,) = whole.page({}).sections[1].blocks
    assert isinstance(summary, Table)
    lines = {str(row[0]): row for row in summary.rows if isinstance(row, tuple)}
    assert len(lines) == 3 + 2 + 4 + 4
    numbers = json.loads(json.dumps(whole.to_dict(), allow_nan=False))["chapters"]
    d200 = numbers["table1"]["cameras"]["d200"]["parameters"]
    line = lines["Table 1, Nikon D200: read noise, DSNU, PRNU"]
    assert line[1] == "0.52 mV, 0.55 mV, 1.126 %"
    assert line[2].startswith(f"{d200['read_noise_mv']['value']:.4f}"[:6])
    covered = sum(entry["interval_95"][0] <= entry["true"] <= entry["interval_95"][1] for entry in d200.values())
    assert line[3].startswith(f"{covered} of 7 values")
    assert lines["Figure 6, SNR of the Nikon D200 at 1.08 V"][1:3] == ("38.10 dB in total", "38.10 dB in total")
    ranges = (entry["dynamic_range_db"] for entry in numbers["high_dynamic_range"]["cameras"].values())
    for decibel in ranges:
        assert f"{decibel:.0f} dB" in lines["Scene of high dynamic range"][2]
