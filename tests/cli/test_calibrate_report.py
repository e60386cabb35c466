"""`photosite calibrate --report`: a page or a PDF, by the ending."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from photosite.cli.main import run


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shot") / "stack"
    assert run(["shoot", "--rows", "66", "--cols", "98", "--seed", "5", "-o", str(folder)]) == 0
    return folder


@pytest.mark.parametrize(("name", "start"), [("report.html", b"<!DOCTYPE html>"), ("report.pdf", b"%PDF-")])
def test_ending_decides(photosite: Any, stack: Path, tmp_path: Path, name: str, start: bytes) -> None:
    report = tmp_path / name
    done = photosite("calibrate", stack, "--report", report, "--json")
    assert done.status == 0
    assert done.json["report"] == str(report)
    assert report.read_bytes().lstrip()[: len(start)] == start


def test_another_ending_is_refused_before_anything_is_read(photosite: Any, tmp_path: Path) -> None:
    done = photosite("calibrate", tmp_path / "nothing", "--report", tmp_path / "report.docx")
    assert done.status == 2
    assert "its name must end in .html or .pdf" in done.err
