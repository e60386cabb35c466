"""`photosite demo`, on a small chip."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from short_protocol import short_d200_protocol

import photosite as ps
from photosite.errors import FileError

if TYPE_CHECKING:
    from photosite.studies.closed_loop import ClosedLoop

SMALL = ("--rows", 66, "--cols", 98)


@pytest.fixture
def measured_before(monkeypatch: pytest.MonkeyPatch, loop: ClosedLoop) -> None:
    """Replace the closed loop by the shared result of a smaller one."""

    def made(sensor: object, *, folder: Path, **options: object) -> ClosedLoop:
        folder.mkdir()
        return loop

    monkeypatch.setattr("photosite.studies.closed_loop.closed_loop", made)


@pytest.mark.smoke("demo")
@pytest.mark.usefixtures("measured_before")
def test_json_and_files(photosite: Any, tmp_path: Path) -> None:
    done = photosite("demo", "--rows", 132, "--cols", 196, "-o", tmp_path / "demo", "--json")
    assert done.status == 0
    report = Path(done.json["report"])
    assert report == tmp_path / "demo" / "report.html"
    assert "<html" in report.read_text(encoding="utf-8")
    assert {file.name for file in report.parent.iterdir()} == {"report.html", "calibrated.sensor.yaml"}
    gain = done.json["parameters"]["system_gain_dn_per_e"]
    for name, row in done.json["parameters"].items():
        assert {"true", "estimated", "standard_uncertainty"} <= set(row), name
    assert abs(gain["estimated"] - gain["true"]) < 5 * gain["standard_uncertainty"] < 0.05 * gain["true"]
    assert "black level raised" in done.err


def test_table_again_in_the_same_folder_with_frames_kept(
    photosite: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The whole loop, with fewer frames than the command's."""

    def written(result: object, path: Path) -> None:
        path.write_text("of this time", encoding="utf-8")

    monkeypatch.setattr("photosite.studies.closed_loop.ClosedLoop.report", written)
    monkeypatch.setattr("photosite.studies.closed_loop.paper_d200_protocol", short_d200_protocol)
    (tmp_path / "report.html").write_text("of last time", encoding="utf-8")
    done = photosite("demo", *SMALL, "-o", tmp_path, "--keep-frames")
    assert done.status == 0
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "of this time"
    assert ps.open_frames(tmp_path / "frames").frame_count == 121
    sensor = (tmp_path / "calibrated.sensor.yaml").read_text(encoding="utf-8")
    assert f"({tmp_path / 'frames' / 'protocol.yaml'})" in " ".join(sensor.split())
    heading = next(line for line in done.out.splitlines() if line.startswith("parameter"))
    assert heading.split() == ["parameter", "true", "estimated", "uncertainty", "unit"]
    assert done.out.splitlines()[-1] == f"report: {tmp_path / 'report.html'}"


@pytest.mark.usefixtures("measured_before")
def test_nothing_new_after_a_failure(photosite: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A report that cannot be written leaves no sensor file beside it, and no folder that was not there."""

    def full(result: object, path: Path) -> None:
        raise FileError(path, "cannot be written: No space left on device")

    monkeypatch.setattr("photosite.studies.closed_loop.ClosedLoop.report", full)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "report.html").write_text("of last time", encoding="utf-8")
    for name in ("new", "old"):
        failed = photosite("demo", *SMALL, "-o", tmp_path / name)
        assert failed.status == 2
        line = failed.err.splitlines()[-1]
        assert line == f"photosite: {tmp_path / name / 'report.html'}: cannot be written: No space left on device"
    assert [str(file.relative_to(tmp_path)) for file in sorted(tmp_path.rglob("*"))] == ["old", "old/report.html"]
    assert (tmp_path / "old" / "report.html").read_text(encoding="utf-8") == "of last time"


def test_kept_frames_are_not_overwritten(photosite: Any, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    refused = photosite("demo", *SMALL, "-o", tmp_path, "--keep-frames")
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert "the folder already exists" in refused.err


@pytest.mark.parametrize("size", [(8, 8), (22, 32)])
def test_too_small_a_chip_is_refused_before_a_frame_is_shot(
    photosite: Any, tmp_path: Path, size: tuple[int, int]
) -> None:
    refused = photosite("demo", "--rows", size[0], "--cols", size[1], "-o", tmp_path / "demo")
    assert refused.status == 2
    assert "'dark skin'" in refused.err
    assert "shooting" not in refused.err
    assert list(tmp_path.iterdir()) == []
