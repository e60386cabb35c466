"""The views with a job: they call the functions of the commands, and their code gives the same numbers."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.app.calibrate_view import (
    CalibrationRequest,
    FolderRequest,
    GroupEdit,
    calibration_code,
    edited,
    list_frames,
    run_calibration,
)
from photosite.app.state import LensState, Places, SensorState
from photosite.app.views import (
    PlanRequest,
    Range,
    SweepRequest,
    plan,
    plan_code,
    run_sweep,
    sweep_code,
)
from photosite.cli.main import run
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame

NOWHERE = Places()
CHANGED = SensorState(changes={"read_noise_e": 2.0})


def executed(code: str) -> dict:
    """Run code without what it prints and draws."""
    names: dict = {}
    kept = [
        line for line in code.splitlines() if not line.startswith(("print(", "found.plot", "table.plot", "cal.report"))
    ]
    exec("\n".join(kept), names)
    return names


def json_of(command: str, capsys: pytest.CaptureFixture[str]) -> dict:
    words = shlex.split(command)
    assert words[0] == "photosite"
    assert run([*words[1:], "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_changed_sensors_have_no_command() -> None:
    assert plan_code(PlanRequest(sensor=CHANGED), NOWHERE)[1] == ""
    assert sweep_code(SweepRequest(sensor=CHANGED), NOWHERE)[1] == ""


def test_a_plan_and_its_code_agree(capsys: pytest.CaptureFixture[str]) -> None:
    request = PlanRequest(wants={"system_gain_dn_per_e": "0.05%"}, seconds_per_frame=2)
    found = plan(request, NOWHERE)
    python, command = plan_code(request, NOWHERE)
    own = executed(python)["plan"].to_dict()
    assert own == {name: found[name] for name in own}
    assert json_of(command, capsys)["steps"] == found["steps"]
    assert found["seconds"] == pytest.approx(sum(step["frames"] * (step["exposure_s"] + 2) for step in found["steps"]))


def test_a_sweep_and_its_code_agree(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ranges = (
        Range(field="pixel_width_um", first=2, last=8, count=3, logarithmic=True),
        Range(field="bits", first=8, last=12, count=2),
    )
    request = SweepRequest(lens=LensState(f_number=4), ranges=ranges, exposure_s=1 / 30)
    reported: list[tuple[int, int, str]] = []
    found = run_sweep(request, NOWHERE, lambda *part: reported.append(part))
    assert found["columns"]["pixel_width_um"] == [2.0, 2.0, 4.0, 4.0, 8.0, 8.0]
    assert found["columns"]["bits"] == [8, 12] * 3
    assert reported[-1][:2] == (6, 6)
    python, command = sweep_code(request, NOWHERE)
    assert executed(python)["table"].to_dict() == found["columns"]
    monkeypatch.chdir(tmp_path)
    start, file, rest = command.partition("\nEND\n")[0], command.split("\n", 1)[1].partition("\nEND\n")[0], command
    assert start.startswith("cat > bench.sweep.yaml")
    Path("bench.sweep.yaml").write_text(file)
    json_of(rest.strip().splitlines()[-1], capsys)
    table = np.genfromtxt("bench.csv", delimiter=",", names=True)
    assert table["snr_db"].tolist() == pytest.approx(found["columns"]["snr_db"], rel=1e-12)


@pytest.mark.parametrize(
    "ranges",
    [
        (Range(field="f_number", first=1, last=2, count=200), Range(field="bits", first=1, last=16, count=16)),
        (Range(field="f_number", first=1, last=2), Range(field="f_number", first=2, last=3)),
        (Range(field="f_number", first=-1, last=2, logarithmic=True),),
        (Range(field="nothing", first=1, last=2),),
    ],
)
def test_sweeps_that_are_too_long_or_wrong_are_refused(ranges: tuple[Range, ...]) -> None:
    with pytest.raises(InputError):
        run_sweep(SweepRequest(ranges=ranges), NOWHERE)


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A served folder with the frames of a small monochrome sensor, whose gain is 0.5 DN per electron."""
    served = tmp_path_factory.mktemp("frames")
    folder = served / "stack"
    folder.mkdir()
    noise = np.random.default_rng(3)
    for kind, time_ms in [("dark", 10), *(("flat", t) for t in (10, 20, 30, 40))]:
        for number in range(3):
            electrons = 0 if kind == "dark" else noise.poisson(100 * time_ms, (64, 64))
            dn = np.uint16(64.5 + 0.5 * electrons + noise.normal(0, 2, (64, 64)))
            RawFrame(dn, bits=12).save(folder / f"{kind}_{time_ms}ms_{number}.png")
    return served


def test_a_calibration_is_that_of_the_library(stack: Path) -> None:
    places = Places(folder=stack)
    listing = list_frames(FolderRequest(folder="stack"), places)
    assert [(g["kind"], g["frames"]) for g in listing["groups"]] == [("dark", 3), *[("light", 3)] * 4]
    done: list[tuple[int, int, str]] = []
    found = run_calibration(CalibrationRequest(folder="stack"), places, lambda *part: done.append(part))
    own = ps.calibrate(ps.open_frames(stack / "stack"))
    gain = next(row for row in found["parameters"] if row["name"] == "system_gain_dn_per_e")
    assert gain["value"] == own.system_gain_dn_per_e.value
    assert gain["interval_95"] == pytest.approx(list(own.system_gain_dn_per_e.interval_95))
    assert gain["interval_95"][0] < 0.5 < gain["interval_95"][1]
    missing = next(row for row in found["parameters"] if row["name"] == "quantum_efficiency_percent")
    assert missing["value"] is None
    assert missing["reason"]
    transfer = next(curve for curve in found["curves"] if curve["kind"] == "photon_transfer")
    assert len(transfer["channels"]["M"]["residual"]) == len(transfer["channels"]["M"]["x"]) > 3
    assert list(found["files"]) == ["report.html"]
    assert done
    json.dumps(found, allow_nan=False)
    assert calibration_code(CalibrationRequest(folder="stack"), places)[1].startswith("photosite calibrate ")


def test_groups_can_be_changed_before_a_calibration(stack: Path) -> None:
    places, frames = Places(folder=stack), ps.open_frames(stack / "stack")
    edits = [GroupEdit(kind=group.kind, exposure_s=group.exposure_s) for group in frames.groups]
    edits[4] = GroupEdit(kind="omit", exposure_s=1)
    edits[1] = GroupEdit(kind="light", exposure_s=0.025)
    changed = edited(frames, tuple(edits))
    assert [(group.kind, group.exposure_s) for group in changed.groups] == [
        *(("dark", 0.01), ("light", 0.02), ("light", 0.025), ("light", 0.03))
    ]
    python, command = calibration_code(CalibrationRequest(folder="stack", groups=tuple(edits)), places)
    assert command == ""
    assert executed(python.replace("cal = ", "cal = 0 and "))["frames"].to_dict() == changed.to_dict()
    with pytest.raises(InputError):
        edited(frames, tuple(edits[:2]))
    with pytest.raises(InputError):
        edited(frames, (*edits[:2], GroupEdit(kind="light", exposure_s=0.03), *edits[3:]))


@pytest.mark.parametrize("folder", ["..", "/etc", "stack/..", "nothing", "stack/dark_10ms_0.png"])
def test_no_folder_outside_is_calibrated(stack: Path, folder: str) -> None:
    with pytest.raises(InputError):
        list_frames(FolderRequest(folder=folder), Places(folder=stack))
    with pytest.raises(InputError):
        list_frames(FolderRequest(), Places())
