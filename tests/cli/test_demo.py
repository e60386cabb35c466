"""`photosite demo`, on a small chip."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import photosite as ps

SMALL = ("--rows", 132, "--cols", 196)


def test_json_and_files(photosite: Any, tmp_path: Path) -> None:
    done = photosite("demo", *SMALL, "-o", tmp_path / "demo", "--json")
    assert done.status == 0
    report = Path(done.json["report"])
    assert report == tmp_path / "demo" / "report.html"
    assert "<html" in report.read_text(encoding="utf-8")
    assert {file.name for file in report.parent.iterdir()} == {"report.html", "calibrated.sensor.yaml"}
    gain = done.json["parameters"]["system_gain_dn_per_e"]
    assert set(gain) == {"true", "estimated", "standard_uncertainty"}
    assert abs(gain["estimated"] - gain["true"]) < 5 * gain["standard_uncertainty"] < 0.05 * gain["true"]
    assert "black level raised" in done.err


def test_table_again_in_the_same_folder_with_frames_kept(photosite: Any, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("of last time", encoding="utf-8")
    done = photosite("demo", *SMALL, "-o", tmp_path, "--keep-frames")
    assert done.status == 0
    assert ps.open_frames(tmp_path / "frames").frame_count == 405
    heading = next(line for line in done.out.splitlines() if line.startswith("parameter"))
    assert heading.split() == ["parameter", "true", "estimated", "uncertainty", "unit"]
    assert done.out.splitlines()[-1] == f"report: {tmp_path / 'report.html'}"
