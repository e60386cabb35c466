"""`photosite reproduce farrell2008` from the outside."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from short_protocol import short_d200_protocol

from photosite.studies.farrell2008 import table1


@pytest.fixture(autouse=True)
def small_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    for key, size in {"d200": (32, 48), "vendor": (96, 128)}.items():
        monkeypatch.setitem(table1.SIZES, key, size)
    monkeypatch.setitem(table1.PROTOCOLS, "d200", short_d200_protocol)


@pytest.mark.smoke("reproduce farrell2008")
def test_writes_page_numbers_and_figures(photosite: Any, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    shown = photosite("reproduce", "farrell2008", "-o", folder, "--only", "table1", "--seed", 3, "--json")
    assert shown.status == 0
    assert shown.json["seed"] == 3
    assert shown.json["chapters"]["table1"]["cameras"]["d200"]["parameters"]["read_noise_mv"]["paper"] == 0.52
    assert "Vendor 2.2 µm: shooting 28 frames" in shown.err
    assert {path.name for path in folder.iterdir()} == {"farrell2008.html", "results.json", "figures"}


def test_says_where_things_are(photosite: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = SimpleNamespace(seconds={"table1": 1.6, "figure4": 1.6}, to_dict=dict, write=lambda place: None)
    monkeypatch.setattr("photosite.studies.farrell2008.study.reproduce", lambda *arguments: study)
    shown = photosite("reproduce", "farrell2008", "-o", tmp_path / "out")
    assert shown.status == 0
    places = {"page": "farrell2008.html", "numbers": "results.json", "figures": "figures"}
    lines = [f"{what}: {tmp_path / 'out' / name}" for what, name in places.items()]
    assert shown.out.splitlines() == [*lines, "3 s"]


def test_a_folder_that_holds_something_is_left_alone(photosite: Any, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    wrong = photosite("reproduce", "farrell2008", "-o", tmp_path)
    assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)
    assert "not an empty folder" in wrong.err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_wrong_chapter_leaves_nothing(photosite: Any, tmp_path: Path) -> None:
    wrong = photosite("reproduce", "farrell2008", "-o", tmp_path / "out", "--only", "tabel1")
    assert (wrong.status, wrong.out) == (2, "")
    assert "Did you mean 'table1'?" in wrong.err
    assert not list(tmp_path.iterdir())
