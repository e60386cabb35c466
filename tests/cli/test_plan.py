"""`photosite plan` from the outside."""

from __future__ import annotations

import json
from typing import Any

import pytest


def test_frames_for_a_precision(photosite: Any) -> None:
    done = photosite("plan", "--rows", "200", "--cols", "200", "--want", "prnu_percent=2%", "--json")
    assert done.status == 0
    plan = json.loads(done.out)
    assert plan["wanted"]["prnu_percent"]["expected_over_wanted"] <= 1
    assert sum(step["frames"] for step in plan["steps"]) == plan["frames"]
    assert {step["kind"] for step in plan["steps"]} == {"dark", "light"}
    assert "black level raised" in plan["note"]


def test_frames_for_the_gain_of_a_pixel(photosite: Any) -> None:
    """Half the uncertainty takes four times the flat fields."""
    counts = []
    for want in ("8%", "4%"):
        done = photosite("plan", "--rows", "64", "--cols", "64", "--want", f"pixel_gain_dn_per_e={want}", "--json")
        assert done.json["wanted"]["pixel_gain_dn_per_e"]["expected_over_wanted"] == pytest.approx(1.0, abs=0.03)
        counts.append(max(step["frames"] for step in done.json["steps"] if step["kind"] == "light"))
    assert 3.6 < counts[1] / counts[0] < 4.4
    wrong = photosite("plan", "--want", "pixel_gain_dn_per_e=0.01%")
    assert "pixel_gain_dn_per_e to 0.01 % cannot be reached" in wrong.err


@pytest.mark.smoke("plan")
def test_precision_of_steps(photosite: Any) -> None:
    steps = ["dark:1/8000:50", "light:1/100:4", "light:1/50:4"]
    done = photosite("plan", "--rows", "200", "--cols", "200", *(a for step in steps for a in ("--step", step)))
    assert done.status == 0
    assert done.out.startswith("58 frames of Nikon D200, 200 x 200 pixels")
    assert "system_gain_dn_per_e" in done.out
    assert "dark_voltage_mv_per_s" not in done.out  # one dark exposure


def test_precision_of_a_named_protocol_is_that_of_its_file(photosite: Any, tmp_path: Any) -> None:
    named = photosite("plan", "--rows", "24", "--cols", "24", "--protocol", "paper-d200", "--json")
    photosite("shoot", "--rows", "24", "--cols", "24", "-o", str(tmp_path / "stack"))
    file = str(tmp_path / "stack" / "protocol.yaml")
    read = photosite("plan", "--rows", "24", "--cols", "24", "--protocol", file, "--json")
    assert json.loads(named.out)["frames"] == 405
    for name, entry in json.loads(named.out)["expected"].items():
        same = json.loads(read.out)["expected"][name]
        assert same == entry if "reason" in entry else same == pytest.approx(entry, rel=1e-9, abs=1e-12), name


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "--want"),
        (["--want", "prnu_percent=1%", "--protocol", "paper-d200"], "one of --want"),
        (["--want", "prnu_procent=1%"], "prnu_percent"),
        (["--want", "pixel_gain=2%"], "Did you mean 'pixel_gain_dn_per_e'?"),
        (["--want", "prnu=2%"], "got 'prnu=2%'. Did you mean 'prnu_percent'?"),
        (["--want", "prnu_percent=x"], "--want must be prnu_percent=NUMBER"),
        (["--want", "quantum_efficiency_percent=1%", "--rows", "20", "--cols", "20"], "photons"),
        (["--step", "light:1/50"], "light:EXPOSURE:FRAMES"),
        (["--step", "light:0:3"], "--step must be"),
        (["--step", "dark:1/50:0"], "--step must be"),
        (["--step", "light:1/50:5"], "two dark frames"),
        (["--protocol", "nowhere.yaml"], "no such file"),
    ],
)
def test_wrong_calls_are_one_line(photosite: Any, arguments: list[str], said: str) -> None:
    wrong = photosite("plan", *arguments)
    assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)
    assert said in wrong.err


@pytest.mark.smoke("plan measure")
def test_plan_of_a_measurement(photosite: Any, tmp_path: Any) -> None:
    file = tmp_path / "mine.camera.yaml"
    sensor = photosite("sensors", "export", "nikon-d200", "-o", str(tmp_path / "small.sensor.yaml"))
    assert sensor.status == 0
    text = (tmp_path / "small.sensor.yaml").read_text()
    text = text.replace("rows: 2592", "rows: 264").replace("cols: 3872", "cols: 392")
    (tmp_path / "small.sensor.yaml").write_text(text)
    file.write_text("photosite_camera: 1\nsensor: small.sensor.yaml\noptics: {f_number: 8, focal_length_mm: 50}\n")
    wants = ("--want", "noise.snr_18_db.G=0.4dB", "--want", "noise.snr_18_db.G=0.001")
    done = photosite("plan", "measure", "--camera", str(file), "--chart", "macbeth", *wants, "--json")
    reached, unreached = done.json["plans"]
    assert reached["best"]["half_width"] <= 0.4
    assert reached["best"]["chart"] == "macbeth"
    assert "macbeth" in reached["measured_on"]
    assert unreached["best"] is None
    assert "no number of frames reaches it" in unreached["advice"]
    shown = photosite("plan", "measure", "--camera", str(file), "--chart", "macbeth", *wants)
    assert f"take {reached['best']['frames']} frame" in shown.out
    assert unreached["advice"] in shown.out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["measure"], "--want"),
        (["measure", "--want", "mtf50.center=0.01"], "as in edge-sfr.mtf50"),
        (["measure", "--want", "noise.snr_18_db=0.2m"], "in dB"),
        (["measure", "--want", "noise.snr_18_db=0.2", "--chart", "slanted-edge"], "--chart must be one of macbeth"),
        (["measure", "--want", "edge-sfr.mtf50.G=1", "--camera", "x.yaml", "--f-number", "2"], "--f-number"),
        (["--rows", "20", "measure", "--want", "edge-sfr.mtf50.G=1"], "--rows before 'measure'"),
        (["shoot"], "no command 'plan shoot'"),
    ],
)
def test_wrong_calls_of_measurements_are_one_line(photosite: Any, arguments: list[str], said: str) -> None:
    wrong = photosite("plan", *arguments)
    assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)
    assert said in wrong.err
