"""The views with a job: they call the functions of the commands, and their code gives the same numbers."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from copied_code import executed, json_of
from raising import raises

import photosite as ps
from photosite.app.calibrate_results import ReportRequest, write_report
from photosite.app.calibrate_view import (
    CalibrationRequest,
    FolderRequest,
    GroupEdit,
    calibration_code,
    edited,
    list_frames,
    run_calibration,
)
from photosite.app.lens_state import LensState
from photosite.app.places import Places
from photosite.app.quality_view import QualityRequest, quality_code, run_quality
from photosite.app.state import SensorState, changed_sensor
from photosite.app.views import (
    PlanRequest,
    Range,
    SweepRequest,
    plan,
    plan_code,
    run_sweep,
    sweep_code,
)
from photosite.errors import FileError, InputError
from photosite.frames.io.libcamera import read_libcamera
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.registry import measurements
from photosite.report.numbers import format_duration

NOWHERE = Places()

pytestmark = pytest.mark.usefixtures("unrendered")
CHANGED = SensorState(changes={"read_noise_e": 2.0})


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
    assert found["duration"] == format_duration(found["seconds"])
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
    assert start.startswith("cat > workbench.sweep.yaml")
    Path("workbench.sweep.yaml").write_text(file)
    json_of(rest.strip().splitlines()[-1], capsys)
    table = np.genfromtxt("workbench.csv", delimiter=",", names=True)
    assert table["snr_db"].tolist() == pytest.approx(found["columns"]["snr_db"], rel=1e-12)


def test_a_sweep_of_image_quality_and_its_code_agree(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Contrast is detected more often in more light; the values come from the registry."""
    name = "contrast-detection.probability.G, neutral 3.5 and neutral 5"
    (tmp_path / "served").mkdir()
    ps.load_sensor("nikon-d200").with_(rows=264, cols=392).save(tmp_path / "served" / "small.sensor.yaml")
    places = Places(folder=tmp_path / "served")
    light = Range(field="mean_luminance_cd_m2", first=20, last=200, count=2)
    request = SweepRequest(
        sensor=SensorState(source="file:small.sensor.yaml"),
        lens=LensState(f_number=8),
        ranges=(light,),
        measure="image_quality",
        values=(name,),
        frames=2,
        exposure_s=1 / 200,
    )
    reported: list[tuple[int, int, str]] = []
    found = run_sweep(request, places, lambda *part: reported.append(part))
    assert found["measured"] == [name]
    assert "CTA" in found["labels"][name]
    dim, bright = found["columns"][name]
    assert dim < 0.4 < 0.9 < bright
    assert found["columns"][f"low({name})"][1] < bright < found["columns"][f"high({name})"][1]
    assert reported[0][:2] == (0, 2)
    assert reported[-1][:2] == (2, 2)
    python, command = sweep_code(request, places)
    assert executed(python)["table"].to_dict() == found["columns"]
    monkeypatch.chdir(tmp_path)
    Path("workbench.sweep.yaml").write_text(command.split("\n", 1)[1].partition("\nEND\n")[0])
    rows = json_of(command.strip().splitlines()[-1], capsys)["rows"]
    assert [row[1] for row in rows] == found["columns"][name]


def test_values_of_image_quality_are_those_of_the_registry(client) -> None:
    found = {each["name"]: each for each in client.get("/api/values").json()}
    assert found["edge-sfr.mtf50"]["unit"] == "cycles/pixel"
    assert "exposure_stops" in measurements()["color-accuracy"].quantities
    assert "color-accuracy.exposure_stops" not in found
    for path, extra in (("sweep", {"measure": "image_quality"}), ("comparison", {})):
        refused = client.post(f"/api/{path}", json={"values": ["edge-sfr.mtf51"]} | extra)
        assert refused.status_code == 422
        assert "mtf50" in refused.json()["error"]


@pytest.mark.parametrize("wrong", [{"measure": "image_quality"}, {"exposure_s": None}])
def test_sweeps_without_values_or_exposure_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        run_sweep(SweepRequest.model_validate(wrong), NOWHERE)
    assert caught.value.what == ("values" if "measure" in wrong else "exposure_s")


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


def test_what_the_files_do_not_state_is_asked_for(tmp_path: Path) -> None:
    noise = np.random.default_rng(2)
    (tmp_path / "plain").mkdir()
    for time_ms, kind in [(1, "dark"), *((time_ms, "flat") for time_ms in (10, 20, 30))]:
        for number in range(2):
            electrons = 0 if kind == "dark" else noise.poisson(100 * time_ms, (64, 80))
            dn = np.uint16(64.5 + 0.5 * electrons + noise.normal(0, 2, (64, 80)))
            dn[:, :16] = 9  # covered
            dn.tofile(tmp_path / "plain" / f"{kind}_{time_ms}ms_{number}.raw")
    places = Places(folder=tmp_path, results=tmp_path / "results")
    asked = {"folder": "plain", "bits": 12, "layout": "80x64", "region": "0:64,16:80"}
    listing = list_frames(FolderRequest(**asked), places)
    assert (listing["rows"], listing["cols"], listing["bits"]) == (64, 64, 12)
    request = CalibrationRequest(**asked)
    (part,) = run_calibration(request, places)["parts"]
    gain = next(row for row in part["parameters"] if row["name"] == "system_gain_dn_per_e")
    assert gain["interval_95"][0] < 0.5 < gain["interval_95"][1]
    python, command = calibration_code(request, places)
    assert "bits=12, region='0:64,16:80', layout='80x64'" in python
    assert "--bits 12 --region 0:64,16:80 --layout 80x64" in command
    with raises(FileError, "the folder has no frames"):
        list_frames(FolderRequest(folder="plain"), places)


@pytest.fixture(scope="module")
def modes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A served folder with frames of two read modes, of 0.5 and 0.25 DN per electron."""
    served = tmp_path_factory.mktemp("modes")
    (served / "both").mkdir()
    for mode, gain in (("fast/HDR", 0.5), ("slow", 0.25)):
        for kind, time_ms in [("dark", 10), *(("flat", t) for t in (10, 20, 30))]:
            for number in range(3):
                dn = shot(100 * time_ms * (kind == "flat"), gain, number)
                frame = RawFrame(dn, 12, black_level_dn=40, metadata={"read_mode": mode})
                frame.save(served / "both" / f"{kind}_{time_ms}ms_{mode[:4]}_{number}.tif")
    return served


def test_several_settings_are_listed_and_compared(modes: Path, tmp_path: Path) -> None:
    places = Places(folder=modes, results=tmp_path)
    listing = list_frames(FolderRequest(folder="both"), places)
    names = ["read_mode=fast/HDR", "read_mode=slow"]
    assert [(each["name"], each["frames"]) for each in listing["settings"]] == [(name, 12) for name in names]
    assert listing["groups"] == []
    one = FolderRequest(folder="both", where=names[1])
    assert [len(list_frames(one, places)[name]) for name in ("settings", "groups")] == [1, 4]
    known = SensorState(source="vendor-2.2um", changes={"cfa": "mono", "bits": 12, **MONO})
    request = CalibrationRequest(folder="both", each_setting=True, sensor=known)
    found = run_calibration(request, places)
    assert found["method"] == "settings"
    assert [part["name"] for part in found["parts"]] == [f"setting {name}" for name in names]
    (compared,) = found["tables"]
    gains = [row for row in compared["rows"] if row["label"] == "System gain K"]
    assert [row["part"] for row in gains] == names
    for row, truth in zip(gains, (0.5, 0.25), strict=True):
        assert row["interval_95"][0] < truth < row["interval_95"][1] < 1.1 * truth
    assert [file["name"] for file in found["files"]] == ["read_mode=fast_HDR.sensor.yaml", "read_mode=slow.sensor.yaml"]
    assert write_report(ReportRequest(result=found["id"]), places)["name"] == "report.html"
    with raises(FileError, f"the frames have 2 settings: {names[0]} (12 frames); {names[1]} (12 frames)"):
        run_calibration(CalibrationRequest(folder="both"), places)
    edits = [GroupEdit(kind="dark", exposure_s=1.0)]
    with raises(InputError, "groups"):
        run_calibration(CalibrationRequest(folder="both", each_setting=True, groups=edits), places)
    python, command = calibration_code(CalibrationRequest(folder="both", each_setting=True), places)
    assert "frames = open_settings(" in python
    assert list(executed(python)["cal"].settings) == names
    assert command.endswith("both --report report.html")


def test_the_stated_black_level_is_that_of_the_request(modes: Path) -> None:
    places, asked = Places(folder=modes), {"folder": "both", "where": "read_mode=slow"}
    assert list_frames(FolderRequest(**asked), places)["black_level_dn"] == 40
    wrong = run_calibration(CalibrationRequest(**asked), places)
    right = CalibrationRequest(**asked, black_level_dn=64)
    assert list_frames(right, places)["black_level_dn"] == 64
    stated = [
        [text for text in each["warnings"] if "black level is stated" in text]
        for each in (wrong, run_calibration(right, places))
    ]
    assert [len(texts) for texts in stated] == [1, 0]
    python, command = calibration_code(right, places)
    assert "black_level_dn=64.0" in python
    assert "--black-level 64.0" in command


def test_the_gain_of_each_pixel_is_measured(tmp_path: Path) -> None:
    (tmp_path / "scmos").mkdir()
    for kind, time_ms in [("dark", 10), *(("flat", t) for t in (10, 20, 40))]:
        for number in range(40):
            dn = shot(100 * time_ms * (kind == "flat"), seed=number)
            RawFrame(dn, bits=12).save(tmp_path / "scmos" / f"{kind}_{time_ms}ms_{number}.png")
    request = CalibrationRequest(folder="scmos", maps=True, pixel_gain=True)
    (part,) = run_calibration(request, Places(folder=tmp_path))["parts"]
    assert [found["name"] for found in part["maps"]][-1] == "pixel_gain_dn_per_e"
    assert part["parameters"][-1]["label"] == "Gain of the pixels, spread"
    python, command = calibration_code(request, Places(folder=tmp_path))
    assert 'maps="gain"' in python
    assert "--pixel-gain" in command


MONO = {"channels": {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}}


def test_a_calibration_is_that_of_the_library(stack: Path, tmp_path: Path) -> None:
    places = Places(folder=stack, results=tmp_path)
    listing = list_frames(FolderRequest(folder="stack"), places)
    assert [(g["kind"], g["frames"]) for g in listing["groups"]] == [("dark", 3), *[("light", 3)] * 4]
    done: list[tuple[int, int, str]] = []
    found = run_calibration(CalibrationRequest(folder="stack"), places, lambda *part: done.append(part))
    own = ps.calibrate(ps.open_frames(stack / "stack"))
    (part,) = found["parts"]
    gain = next(row for row in part["parameters"] if row["name"] == "system_gain_dn_per_e")
    assert gain["value"] == own.system_gain_dn_per_e.value
    assert gain["interval_95"] == pytest.approx(list(own.system_gain_dn_per_e.interval_95))
    assert gain["interval_95"][0] < 0.5 < gain["interval_95"][1]
    missing = next(row for row in part["parameters"] if row["name"] == "quantum_efficiency_percent")
    assert missing["value"] is None
    assert missing["reason"]
    transfer = next(curve for curve in part["curves"] if curve["kind"] == "photon_transfer")
    assert len(transfer["channels"]["M"]["residual"]) == len(transfer["channels"]["M"]["x"]) > 3
    assert [file["name"] for file in found["files"]] == ["noise-profile.libcamera.json"]
    report = write_report(ReportRequest(result=found["id"]), places)
    assert report == {"name": "report.html", "address": f"/api/results/{found['id']}/report.html"}
    text = (tmp_path / found["id"] / "report.html").read_text()
    assert "System gain K" in text
    with pytest.raises(InputError):
        write_report(ReportRequest(result="0" * 16), places)
    known = CalibrationRequest(
        folder="stack", sensor=SensorState(source="vendor-2.2um", changes={"cfa": "mono", "bits": 12, **MONO})
    )
    with_sensor = run_calibration(known, places)
    assert not [text for text in with_sensor["warnings"] if str(tmp_path) in text]
    address = next(file["address"] for file in with_sensor["files"] if file["name"] == "mine.sensor.yaml")
    source = address.replace("/api/results/", "result:")
    measured = changed_sensor(SensorState(source=source, changes={"rows": 32}), places)
    assert measured.system_gain_dn_per_e == pytest.approx(gain["value"])
    profile = tmp_path / found["files"][0]["address"].split("/", 3)[-1]
    assert read_libcamera(profile).system_gain_dn_per_e.value / 16 == pytest.approx(gain["value"])  # on 16 bits
    assert done
    json.dumps(found, allow_nan=False)
    assert calibration_code(CalibrationRequest(folder="stack"), places)[1].startswith("photosite calibrate ")


def shot(electrons: float, gain: float = 0.5, seed: int = 1) -> np.ndarray:
    """Return a frame of 64 x 64 pixels with a black level of 64 DN and a read noise of 2 DN."""
    noise = np.random.default_rng([int(electrons), seed])
    dn = 64.5 + gain * noise.poisson(electrons, (64, 64)) + noise.normal(0, 2, (64, 64))
    return np.uint16(dn)


def test_frames_of_several_gain_settings_are_a_series(tmp_path: Path) -> None:
    folder = tmp_path / "gains"
    folder.mkdir()
    for iso in (100, 200):
        for kind, time_ms in [("dark", 10), *(("flat", t) for t in (10, 20, 30))]:
            for number in range(3):
                dn = shot(1e4 * time_ms / iso * (kind == "flat"), iso / 200, seed=number + iso)
                RawFrame(dn, bits=12).save(folder / f"{kind}_{time_ms}ms_iso{iso}_{number}.png")
    places = Places(folder=tmp_path, results=tmp_path)
    request = CalibrationRequest(folder="gains")
    found = run_calibration(request, places)
    assert found["method"] == "series"
    assert [part["name"] for part in found["parts"]] == ["gain setting 100", "gain setting 200"]
    own = ps.calibrate(ps.open_frames(folder))
    over = next(curve for curve in found["curves"] if curve["kind"] == "system_gain_dn_per_e")
    (points,) = over["channels"].values()
    assert points["x"] == [100, 200]
    assert points["y"] == [step.calibration.system_gain_dn_per_e.value for step in own.steps]
    unity = next(row for table in found["tables"] for row in table["rows"] if row["part"] == "all")
    assert unity["value"] == pytest.approx(own.unity_gain.value)
    assert {file["name"] for file in found["files"]} > {"noise-profiles.darktable.json"}
    json.dumps(found, allow_nan=False)
    python, _ = calibration_code(CalibrationRequest(folder="gains"), places)
    report = tmp_path / "own.html"
    cal = executed(python.replace("report.html", str(report)))["cal"]
    assert cal.settings == own.settings
    # the frames of one setting alone, and a setting that was read wrongly
    listing = list_frames(FolderRequest(folder="gains"), places)["groups"]
    kept = [GroupEdit(**{name: each[name] for name in ("kind", "exposure_s", "gain_setting")}) for each in listing]
    alone = [edit.model_copy(update={"kind": "omit"}) if edit.gain_setting == 200 else edit for edit in kept]
    assert run_calibration(CalibrationRequest(folder="gains", groups=tuple(alone)), places)["method"] == "setting"
    renamed = [edit.model_copy(update={"gain_setting": 2 * edit.gain_setting}) for edit in kept]
    assert edited(ps.open_frames(folder), tuple(renamed)).gain_settings == (200, 400)


def test_frames_of_captures_are_calibrated_with_their_ratio(tmp_path: Path) -> None:
    for name, sensitivity in (("large", 2000.0), ("small", 500.0)):
        (tmp_path / "hdr" / name).mkdir(parents=True)
        levels = [("dark", 1, 0.0), ("dark", 2, 0.0), *(("flat", t, sensitivity * t) for t in range(1, 9))]
        for kind, time_s, mean in levels:
            for number in range(3):
                RawFrame(shot(mean, seed=number + time_s), bits=16).save(
                    tmp_path / "hdr" / name / f"{kind}_{time_s}s_{number}.png"
                )
    places = Places(folder=tmp_path)
    assert list_frames(FolderRequest(folder="hdr/large"), places)["subfolders"] == []
    assert list_frames(FolderRequest(folder="hdr"), places)["subfolders"] == ["large", "small"]
    request = CalibrationRequest(folder="hdr", captures=("large", "small"))
    found = run_calibration(request, places)
    assert (found["method"], len(found["parts"])) == ("captures", 2)
    ratio = found["tables"][0]["rows"][-1]
    assert ratio["interval_95"][0] < 0.25 < ratio["interval_95"][1]
    assert calibration_code(request, places)[1].endswith("--captures large,small --report report.html")
    with_maps = request.model_copy(update={"maps": True})
    of_each = [{each["name"] for each in part["maps"]} for part in run_calibration(with_maps, places)["parts"]]
    assert of_each[0] == of_each[1] >= {"offset_dn", "prnu"}
    python, command = calibration_code(with_maps, places)
    assert command.endswith("--captures large,small --maps --report report.html")
    assert "names}\ncal = ps.calibrate(frames, maps=True)" in python
    with pytest.raises(InputError):
        run_calibration(CalibrationRequest(folder="hdr", captures=("large", "other")), places)


def test_maps_of_the_chip_show_its_pixels_and_defects(tmp_path: Path) -> None:
    chip = np.random.default_rng(5)
    offset, response = chip.normal(0, 4, (64, 64)), 1 + chip.normal(0, 0.01, (64, 64))
    offset[10, 20] = 120.0
    (tmp_path / "stack").mkdir()
    for kind, time_ms in [("dark", 10), ("dark", 20), *(("flat", t) for t in (10, 20, 30))]:
        for number in range(6):
            noise = np.random.default_rng([time_ms, number, kind == "dark"])
            electrons = noise.poisson(300 * time_ms * response * (kind == "flat"))
            dn = np.uint16(164.5 + offset + 0.5 * electrons + noise.normal(0, 2, (64, 64)))
            RawFrame(dn, bits=14).save(tmp_path / "stack" / f"{kind}_{time_ms}ms_{number}.png")
    found = run_calibration(CalibrationRequest(folder="stack", maps=True), Places(folder=tmp_path))
    (part,) = found["parts"]
    maps = {each["name"]: each for each in part["maps"]}
    assert {"offset_dn", "prnu", "read_noise_dn"} <= maps.keys()
    shown = maps["offset_dn"]
    values = np.frombuffer(base64.b64decode(shown["values"]), "<f4").reshape(shown["rows"], shown["cols"])
    assert np.corrcoef(values.ravel(), offset.ravel())[0, 1] > 0.9
    assert shown["range"][0] < shown["median"] < shown["range"][1]
    assert [10, 20] in [entry[:2] for entry in part["defects"]["listed"]]


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


def test_image_quality_and_its_code_agree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    request = QualityRequest(chart="macbeth", frames=2, sensor=SensorState(source="vendor-2.2um"))
    reported: list[tuple[int, int, str]] = []
    found = run_quality(request, NOWHERE, lambda *part: reported.append(part))
    assert reported[0][2] == "macbeth: simulating"
    section = next(each for each in found["sections"] if each["id"] == "noise")
    assert section["figures"]
    python, command = quality_code(request, NOWHERE)
    own = executed(python)["quality"].charts["macbeth"]["noise"]
    assert [list(row) for row in own.rows()] == section["rows"]
    start, file, end = (
        command.split("\n", 1)[0],
        command.split("<<'END'\n")[1].split("END\n")[0],
        command.splitlines()[-1],
    )
    assert start.startswith("cat > workbench.camera.yaml")
    Path("workbench.camera.yaml").write_text(file)
    values = json_of(end.strip(), capsys)["charts"]["macbeth"]["results"]["noise"]["values"]
    assert [each["value"] for each in values] == [each.value for each in own.values.values()]
    assert quality_code(QualityRequest(sensor=CHANGED), NOWHERE)[1] == ""


@pytest.mark.parametrize("name", ["file:shots", "upload:abc"])
def test_image_quality_of_frames_and_its_code_agree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    sensor = ps.load_sensor("vendor-2.2um").with_(rows=264, cols=392)
    sensor.save("own.sensor.yaml")
    camera = ps.Camera(ps.DiffractionLimited(f_number=2.8, focal_length_mm=4), sensor)
    scene = ps.charts.macbeth("D65", 200)
    Path("shots").mkdir()
    for frame in range(3):
        camera.capture(scene, exposure_s=0.01, frame=frame).save(f"shots/{frame}.dng")
    places = Places(folder=tmp_path, uploads={"abc": tmp_path / "shots"})
    own = SensorState(source="file:own.sensor.yaml")
    request = QualityRequest(
        chart="macbeth", measured=(name,), in_electrons=True, sensor=own, luminance_cd_m2=None, detect=True
    )
    found = run_quality(request, places)
    section = next(each for each in found["sections"] if each["id"] == "noise")
    if name.startswith("file:"):
        python, command = quality_code(request, places)
        measured = executed(python)["quality"]["noise"]
        assert [list(row) for row in measured.rows()] == section["rows"]
        values = json_of(command.strip(), capsys)["results"]["noise"]["values"]
        assert [each["value"] for each in values] == [each.value for each in measured.values.values()]
    for wrong in ("macbeth", "file:../shots", "upload:none"):
        with pytest.raises(InputError):
            run_quality(request.model_copy(update={"measured": (wrong,)}), places)
    with raises(InputError, "luminance_cd_m2"):
        run_quality(request.model_copy(update={"measured": ()}), places)
