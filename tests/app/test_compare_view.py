"""The comparison of cameras and of measured frames: those of the library, and of the copied code and commands."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path

import pytest
from copied_code import executed, json_of
from PIL import Image

import photosite as ps
from photosite.app.compare_view import (
    CameraChoice,
    Comparison,
    ValidationRequest,
    compare,
    compare_code,
    run_validation,
    validation_code,
)
from photosite.app.lens_state import LensState
from photosite.app.places import Places
from photosite.app.state import CameraState, SensorState, prepared
from photosite.app.views import PlanRequest, SweepRequest, plan, run_sweep
from photosite.errors import InputError

NOWHERE = Places()


def test_a_comparison_its_python_and_its_command_agree(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cameras = (CameraChoice(), CameraChoice(sensor=SensorState(source="vendor-1.4um"), lens=LensState(f_number=4)))
    request = Comparison(cameras=cameras, exposure_s=1 / 30, illuminant="D65", seed=3)
    found = compare(request, NOWHERE)
    assert list(found["cameras"]) == ["nikon-d200, f/2.8, 50 mm", "vendor-1.4um, f/4, 50 mm"]
    python, command = compare_code(request, NOWHERE)
    assert executed(python)["found"].to_dict() == {name: found[name] for name in found if name != "notes"}
    monkeypatch.chdir(tmp_path)
    *files, line = command.split("\nEND\n")
    for text in files:
        name, content = text.split("\n", 1)
        Path(name.split()[2]).write_text(content)
    assert json_of(line, capsys) | {"notes": []} == json.loads(json.dumps(found))


def test_values_of_image_quality_are_columns_of_a_comparison(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = Places(folder=tmp_path)
    ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=64).save(tmp_path / "small.sensor.yaml")
    small = SensorState(source="file:small.sensor.yaml")
    cameras = tuple(CameraChoice(sensor=small, lens=LensState(f_number=n)) for n in (4, 200))
    request = Comparison(cameras=cameras, illuminant="D65", values=("edge-sfr.mtf50", "noise.snr_18_db.G"))
    reported: list[str] = []
    found = compare(request, places, lambda *part: reported.append(part[2]))
    sharp, blurred = found["quality"].values()
    assert list(sharp) == list(blurred) == [*(f"edge-sfr.mtf50.{each}" for each in "RGB"), "noise.snr_18_db.G"]
    low, high = sharp["edge-sfr.mtf50.G"]["interval_95"]
    assert low < sharp["edge-sfr.mtf50.G"]["value"] < high
    assert sharp["edge-sfr.mtf50.G"]["unit"] == "cycles/pixel"
    assert (blurred["edge-sfr.mtf50.G"]["value"], blurred["noise.snr_18_db.G"]["unit"]) == (None, "dB")
    assert blurred["edge-sfr.mtf50.G"]["reason"]
    assert {text.partition(":")[0] for text in reported} == set(found["quality"])
    python, command = compare_code(request, places)
    assert executed(python)["found"].to_dict()["quality"] == found["quality"]
    monkeypatch.chdir(tmp_path)
    *files, line = command.split("\nEND\n")
    for text in files:
        name, content = text.split("\n", 1)
        Path(name.split()[2]).write_text(content)
    assert json_of(line, capsys)["quality"] == json.loads(json.dumps(found["quality"]))


def test_cameras_are_named_by_what_they_differ_in() -> None:
    changed = SensorState(changes={"read_noise_e": 2.0})
    sensors = tuple(CameraChoice(sensor=one) for one in (SensorState(), changed, changed))
    python, command = compare_code(Comparison(cameras=sensors), NOWHERE)
    for label in ("nikon-d200", "nikon-d200, changed", "nikon-d200, changed (2)"):
        assert f"cameras[{label!r}] = " in python
    assert command == ""
    lenses = tuple(CameraChoice(lens=LensState(f_number=n)) for n in (4, 8))
    assert "cameras['f/8, 50 mm'] = " in compare_code(Comparison(cameras=lenses), NOWHERE)[0]


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Places:
    """A served folder with two frames of the chart taken by another chip of a small camera at f/4, and its sensor."""
    folder = tmp_path_factory.mktemp("shots")
    sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196, black_level_dn=64)
    sensor.save(folder / "small.sensor.yaml")
    camera = ps.Camera(ps.DiffractionLimited(4, 50), sensor.with_(serial="the measured one"))
    (folder / "shots").mkdir()
    for seed in (11, 12):
        camera.capture(ps.charts.macbeth("A", 40), 1 / 20, seed=seed).save(folder / "shots" / f"{seed}.dng")
    return Places(folder=folder)


CORNERS = ((4.0, 4.0), (4.0, 192.0), (128.0, 192.0), (128.0, 4.0))


def test_a_validation_its_python_and_its_command_agree(shots: Places, capsys: pytest.CaptureFixture[str]) -> None:
    right = {"measured": ("file:shots",), "sensor": SensorState(source="file:small.sensor.yaml"), "corners": CORNERS}
    request = ValidationRequest(**right, lens=LensState(f_number=4), luminance_cd_m2=40)
    found = run_validation(request, shots)
    assert found["agrees"]
    assert found["frames"] == [2, 2]
    for side in ("measured", "simulated"):
        picture = Image.open(io.BytesIO(base64.b64decode(found["pictures"][side])))
        assert abs(picture.height - 132) < 10
    json.dumps(found, allow_nan=False)
    python, command = validation_code(request, shots)
    own = executed(python)["found"].to_dict()
    assert own == {name: found[name] for name in own}
    assert json_of(command, capsys)["means"] == found["means"]

    wrong = request.model_copy(update={"lens": LensState(f_number=5)})
    differs = run_validation(wrong, shots)
    assert not differs["agrees"]
    fitted = run_validation(wrong.model_copy(update={"fit": "light"}), shots)
    assert fitted["agrees"]
    assert "cd/m2" in fitted["fit_summary"]


def test_the_chart_is_found_or_the_reason_is_given(shots: Places) -> None:
    request = ValidationRequest(measured=("file:shots/11.dng",), luminance_cd_m2=40)
    with pytest.raises(InputError):
        run_validation(request.model_copy(update={"corners": CORNERS[:2]}), shots)
    with pytest.raises(InputError):
        run_validation(request.model_copy(update={"measured": ("macbeth",)}), shots)
    with pytest.raises(InputError):
        run_validation(request.model_copy(update={"measured": ("file:../x.dng",)}), shots)
    behind = ValidationRequest(measured=("file:shots/11.dng",), lens=LensState(transmittance=0.9))
    assert validation_code(behind, shots)[1] == ""
    detected = request.model_copy(update={"sensor": SensorState(source="file:small.sensor.yaml")})
    assert "--detect" in validation_code(detected, shots)[1]


LAMP = "wavelength_nm,relative_energy\n380,1\n560,2\n780,6\n"


def test_a_light_from_a_file_changes_the_comparison(tmp_path: Path) -> None:
    (tmp_path / "lamp.csv").write_text(LAMP)
    places = Places(folder=tmp_path)
    request = Comparison(illuminant="file:lamp.csv", exposure_s=1 / 100)
    found = compare(request, places)
    camera = ps.Camera(ps.DiffractionLimited(2.8, 50), ps.load_sensor("nikon-d200"))
    light = str(tmp_path / "lamp.csv")
    own = ps.studies.compare_cameras({"nikon-d200": camera}, illuminant=light, exposure_s=1 / 100).to_dict()
    assert found["illuminant"] == "lamp.csv"
    assert found["cameras"] == own["cameras"]
    assert found["cameras"] != compare(Comparison(exposure_s=1 / 100), places)["cameras"]
    python, command = compare_code(request, places)
    assert light in python
    assert light in command


@pytest.mark.parametrize("name", ["{outside}", "file:../lamp.csv", "file:notes.txt", "upload:lamp", "no-such-light"])
def test_no_view_reads_a_light_from_outside_the_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "lamp.csv").write_text(LAMP)
    (tmp_path / "served").mkdir()
    (tmp_path / "served" / "notes.txt").write_text(LAMP)
    places, name = Places(folder=tmp_path / "served"), name.format(outside=tmp_path / "lamp.csv")
    with pytest.raises(InputError):
        compare(Comparison(illuminant=name), places)
    with pytest.raises(InputError):
        run_validation(ValidationRequest(measured=("file:notes.txt",), illuminant=name), places)
    with pytest.raises(InputError):
        plan(PlanRequest(illuminant=name), places)
    with pytest.raises(InputError):
        run_sweep(SweepRequest(illuminant=name), places)
    for scene in ({"illuminant": name}, {"options": {"illuminant": name}}):
        with pytest.raises(InputError):
            prepared(CameraState.model_validate({"scene": scene}), places)
