"""`photosite cameras` and `photosite calibrate --contribute`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_files import darktable_content, rawtoaces_content, write_json

import photosite as ps
from photosite.frames.frame_set import FrameSet


@pytest.fixture
def profiles(tmp_path: Path) -> Path:
    return write_json(tmp_path / "noiseprofiles.json", darktable_content())


@pytest.mark.smoke("cameras list")
def test_list_and_search(photosite: Any, profiles: Path) -> None:
    assert photosite("cameras", "list", "--profiles", profiles).out.count("noise profile") == 4
    found = photosite("cameras", "list", "nik", "d3", "--profiles", profiles, "--json").json["cameras"]
    assert [camera["name"] for camera in found] == ["Nikon D3", "Nikon D300"]
    missing = photosite("cameras", "list", "nikon d855", "--profiles", profiles)
    assert missing.status == 2
    assert "Nikon D850" in missing.err
    assert "no camera has 'pentax' in its name" in photosite("cameras", "list", "pentax", "--profiles", profiles).err
    (profiles.parent / "empty").mkdir()
    shown = photosite("cameras", "list", "--profiles", profiles.parent / "empty")
    assert (shown.status, f"no cameras in {profiles.parent / 'empty'}" in shown.out) == (0, True)


def test_without_files(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photosite.library.sources.usual_places", lambda: ())
    shown = photosite("cameras")
    assert shown.status == 0
    assert "PHOTOSITE_PROFILES" in shown.out


@pytest.mark.smoke("cameras show")
def test_show_and_write_a_sensor_file(photosite: Any, profiles: Path, tmp_path: Path) -> None:
    asked = ("cameras", "show", "NIKON CORPORATION NIKON D850", "--profiles", profiles)
    assert "well capacity" in photosite(*asked, "--iso", 6400).out
    assert "--iso" in photosite(*asked).err
    assert "--iso must be a number above 0" in photosite(*asked, "--iso", "nan").err
    other = photosite("cameras", "show", "d3", "--profiles", profiles, "--iso", 400)
    assert "--iso must be 200, the only one of the profiles, got 400" in other.err
    shown = photosite("cameras", "show", "d850", "--profiles", profiles, "--iso", 64).out.splitlines()
    assert [line for line in shown if line.startswith("electrons at white") and "e+" not in line]
    output = tmp_path / "d850.sensor.yaml"
    assert "--sensor" in photosite(*asked, "--iso", 6400, "-o", output).err
    done = photosite(*asked, "--iso", 6400, "--sensor", "nikon-d200", "-o", output, "--json")
    low, high = done.json["electrons_at_white_95"]
    assert low < 4095 / ps.load_sensor(output).system_gain_dn_per_e < high


def test_a_negative_offset_and_the_names_of_import(photosite: Any, profiles: Path, tmp_path: Path) -> None:
    """`import` takes the names that `cameras show` takes, and both write the same sensor."""
    content = darktable_content()
    content["noiseprofiles"][0]["models"][0]["profiles"][2]["b"] = [-1e-6] * 3
    write_json(profiles, content)
    files = [tmp_path / "shown.sensor.yaml", tmp_path / "imported.sensor.yaml"]
    name, base = "NIKON CORPORATION NIKON D850", ("--sensor", "nikon-d200", "-o")
    commands = [
        ("cameras", "show", name, "--profiles", profiles, "--iso", 6400),
        ("import", profiles, "--model", name, "--gain-setting", 6400),
    ]
    for command, file in zip(commands, files, strict=True):
        done = photosite(*command, *base, file)
        assert done.status == 0
        assert "negative-dark-noise" in done.err
    shown, imported = map(ps.load_sensor, files)
    assert shown.noise.read_noise_mv == imported.noise.read_noise_mv
    assert shown.noise.read_noise_mv.assumed
    assert shown.pixel == imported.pixel
    assert (
        "--model must be the name of one camera, got 'nikon'" in photosite("import", profiles, "--model", "nikon").err
    )


@pytest.mark.smoke("cameras schema")
def test_schema_and_refused_entries(photosite: Any, tmp_path: Path) -> None:
    for form in ("entry", "index", "table"):
        assert "properties" in photosite("cameras", "schema", form).out
    refused = photosite("cameras", "validate", tmp_path)
    assert refused.status == 2
    assert refused.err.count("\n") == 1


@pytest.mark.smoke("cameras validate")
def test_calibrate_contributes(photosite: Any, loop: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photosite.calibration.calibrate.calibrate", lambda *_, **__: loop.calibration)
    dn = np.zeros((2, 2), np.uint16)
    frames = FrameSet.from_arrays([("dark", 1.0, dn), ("dark", 1.0, dn)], bits=12)
    monkeypatch.setattr("photosite.frames.open.open_settings", lambda *_, **__: [frames])
    library = tmp_path / "library"
    call = ("calibrate", tmp_path, "--sensor", "nikon-d200", "--contribute", library)
    assert "--license" in photosite(*call).err
    assert "--contribute" in photosite("calibrate", tmp_path, "--license", "MIT").err
    done = photosite(*call, "--license", "CC0-1.0", "--camera", "Acme X-1", "--json")
    assert done.status == 0
    assert Path(done.json["entry"]).parent == library
    checked = photosite("cameras", "validate", library, "--json").json
    assert [entry["camera"] for entry in checked["entries"]] == ["Acme X-1"]
    assert "Acme X-1" in photosite("cameras", "list", "--profiles", library).out
    show = ("cameras", "show", "Acme X-1", "--profiles", library)
    assert "--mono must be omitted: a contributed camera states it" in photosite(*show, "--mono").err
    made = photosite(*show, "-o", tmp_path / "x1.sensor.yaml", "--sensor", "vendor-2.2um")
    assert made.status == 0
    assert "--sensor does not apply to a contributed camera" in made.err
    assert ps.load_sensor(tmp_path / "x1.sensor.yaml").name == "Acme X-1"


def test_the_file_to_use_can_be_passed(photosite: Any, profiles: Path, tmp_path: Path) -> None:
    table = write_json(tmp_path / "nikon_d850.json", rawtoaces_content())
    other = tmp_path / "Nikon_D850.csv"
    other.write_text("nm,R,G,B\n400,0,0.1,0.9\n500,0.1,1,0.2\n")
    show = ("cameras", "show", "d850", "--json", "--iso", 400, "--profiles", profiles, "--profiles", table)
    refused = photosite(*show, "--profiles", other)
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert all(text in refused.err for text in (str(table), f"--profiles {other}"))
    assert [source["file"] for source in photosite(*show).json["sources"]] == [str(profiles), str(table)]
    spectra = photosite("cameras", "show", "d850", "--iso", 400, "--profiles", table)
    assert (spectra.status, "--iso must be omitted" in spectra.err) == (2, True)
    (tmp_path / "folder" / "entry").mkdir(parents=True)
    (tmp_path / "folder" / "entry" / "entry.yaml").touch()
    for call in (("list", "--profiles"), ("show", "d850", "--profiles"), ("validate",)):
        shown = photosite("cameras", *call, tmp_path / "folder")
        assert str(tmp_path / "folder" / "entry") in shown.out + shown.err


@pytest.mark.smoke("cameras compare")
def test_compare(photosite: Any, tmp_path: Path) -> None:
    for name in ("first", "second"):
        text = f"photosite_camera: 1\nname: {name}\nsensor: nikon-d200\noptics: {{f_number: 4, focal_length_mm: 50}}\n"
        (tmp_path / f"{name}.camera.yaml").write_text(text)
    files = sorted(tmp_path.iterdir())
    assert set(photosite("cameras", "compare", *files, "--json").json["cameras"]) == {"first", "second"}
    assert photosite("cameras", "compare", files[0], files[0]).status == 2
