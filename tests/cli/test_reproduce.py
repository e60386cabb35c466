"""`photosite reproduce` from the outside."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from photosite.studies import imperfect_stacks, random_sensors
from photosite.studies.conditions import CONDITIONS
from photosite.studies.defective_pixels import DefectCoverage
from photosite.studies.drawn_sensors import draw_sensor
from photosite.studies.farrell2008 import fill_factor
from photosite.studies.outcome import Outcome
from photosite.studies.random_sensors import SensorResult


@pytest.mark.smoke("reproduce coverage")
def test_coverage(photosite: Any, tmp_path: Path) -> None:
    arguments = ("reproduce", "coverage", "--sensors", "4", "--condition", "few-mono-12", "--processes", "1")
    shown = photosite(*arguments, "--table", str(tmp_path / "tables.md"))
    assert shown.status == 0
    tables = (tmp_path / "tables.md").read_text(encoding="utf-8").splitlines()
    cells = next(line.split(" | ")[1].strip(" |*") for line in tables if line.startswith("| `system_gain_dn_per_e`"))
    assert "few-mono-12: two frames per setting" in shown.out
    assert "system_gain_dn_per_e" in shown.out
    found = json.loads(photosite(*arguments, "--json").out)
    assert found["sensors_per_condition"] == 4
    row = found["conditions"]["few-mono-12"]["parameters"]["system_gain_dn_per_e"]
    assert row["estimated"] == 4
    assert 0 <= row["covered"] <= 1
    assert cells == f"{100 * row['covered']:.1f} {row['bias']:+.2f}".replace("-", "\N{MINUS SIGN}")
    assert row["remarks"] == []
    assert found["false_alarm_probability"] == 1e-3
    assert "lines are flagged" in shown.out


def test_help_lists_the_conditions(photosite: Any) -> None:
    shown = photosite("reproduce", "coverage", "--help").out
    assert all(name in "".join(shown.split()) for name in CONDITIONS)


def test_wrong_calls_are_one_line(photosite: Any) -> None:
    for arguments, said in (
        (("reproduce", "coverag"), "Did you mean 'coverage'?"),
        (("reproduce", "coverage", "--condition", "few-mono"), "few-mono-12"),
        (("reproduce", "coverage", "--sensors", "0"), "--sensors"),
        (("reproduce", "coverage", "--quick", "--sensors", "40"), "one of --quick"),
    ):
        wrong = photosite(*arguments)
        assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)
        assert said in wrong.err


@pytest.mark.smoke("reproduce fill-factor")
def test_fill_factor(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = tuple(fill_factor.recovery_study(range(1)))
    monkeypatch.setattr(fill_factor, "recovery_study", lambda seeds, progress: found)
    shown = photosite("reproduce", "fill-factor", "--seeds", "1")
    assert shown.status == 0
    assert "Nikon D200" in shown.out
    assert "100 %" in shown.out
    content = json.loads(photosite("reproduce", "fill-factor", "--seeds", "1", "--json").out)
    assert set(content) == {"d200", "vendor"}
    assert content["d200"]["passes"]


@pytest.mark.smoke("reproduce noise-profiles")
def test_noise_profiles(photosite: Any) -> None:
    done = photosite("reproduce", "noise-profiles", "--cameras", 2, "--rows", 128, "--cols", 192, "--json")
    assert done.status == 0
    assert done.json["groups"][0]["cameras"] == 2


@pytest.mark.smoke("reproduce imperfect-stacks")
def test_imperfect_stacks(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    (clean,) = imperfect_stacks.imperfect_stacks([0], imperfect_stacks.KINDS[:1])
    monkeypatch.setattr(imperfect_stacks, "imperfect_stacks", lambda seeds: [clean])
    done = photosite("reproduce", "imperfect-stacks")
    assert done.status == 0
    assert "clean  monochrome  1 of 1" in done.out


@pytest.mark.smoke("reproduce defective-pixels")
def test_defective_pixels(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    row = DefectCoverage("hot", 1e-3, 10, 0, 1, 79, 76, 2.75, 120, 3, 2)
    monkeypatch.setattr("photosite.studies.defective_pixels.defect_coverage", lambda *arguments, **named: [row])
    done = photosite("reproduce", "defective-pixels", "--sensors", 10)
    assert done.status == 0
    assert "96.2 %" in done.out
    assert "3 of 120" in done.out


@pytest.mark.smoke("reproduce image-quality")
def test_image_quality(photosite: Any, tmp_path: Path) -> None:
    arguments = ("reproduce", "image-quality", "--draws", 2, "--measurement", "flicker", "--processes", 1)
    done = photosite(*arguments, "--table", tmp_path / "table.md")
    assert done.status == 0
    assert "mitigation_probability" in done.out
    assert "| `flicker` | IEEE P2020" in (tmp_path / "table.md").read_text()
    (row, *_) = photosite(*arguments, "--json").json["measurements"]["flicker"]["quantities"]
    assert (row["quantity"], row["charts"]) == ("modulation", 2)
    assert photosite("reproduce", "image-quality", "--measurement", "chart-light").status == 2


@pytest.mark.smoke("reproduce random-sensors")
def test_random_sensors(photosite: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    outcome = Outcome(3.0, 1.0, 1.0, False)
    result = SensorResult(draw_sensor(7), {"prnu_percent": outcome, "dsnu_e": "none"}, frozenset({"jpeg-frames"}))
    monkeypatch.setattr(random_sensors, "_measure", lambda number: result)
    done = photosite("reproduce", "random-sensors", "--sensor", 7, "--figure", tmp_path / "errors.png")
    assert done.status == 0
    assert "0.0 % of all intervals" in done.out
    assert "jpeg-frames" in done.out
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")
    assert photosite("reproduce", "random-sensors", "--sensor", 7, "--json").json["false_alarms"] == {
        "jpeg-frames": [7]
    }
    assert photosite("reproduce", "random-sensors", "--sensor", 7, "--sensors", 8).status == 2


@pytest.mark.smoke("reproduce detection")
def test_detection(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"kind": "gamma", "size": "1 / 2.2", "found": 20, "stacks": 20, "varied": False}
    result = {"clean_stacks": 10, "alarms": {"no-flat-fields": 1}, "smallest": {"tone-curve": [found]}}
    monkeypatch.setattr("photosite.studies.detection.detection_study", lambda *arguments, **named: result)
    done = photosite("reproduce", "detection")
    assert done.status == 0
    assert "20 of 20" in done.out
    assert "no-flat-fields 1" in done.out
    assert photosite("reproduce", "detection", "--json").json == result
