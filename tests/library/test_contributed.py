"""Contributed cameras: what is written and removed, loading, and entries that are refused."""

from __future__ import annotations

import dataclasses
import json
import pickle
import shutil
from pathlib import Path
from typing import Any

import pytest
from camera_files import darktable_content, write_json
from object_instances import series
from raising import raises

import photosite as ps
from photosite.errors import CalibrationError, FileError, InputError, PhotositeError
from photosite.files.yaml import dump_yaml
from photosite.library.contribute import contribute, validate_cameras
from photosite.library.entry import (
    ENTRY_NAME,
    INDEX_NAME,
    LICENSES,
    SCHEMAS,
    SENSOR_NAME,
    TABLE_NAME,
    LoadedEntry,
    check_no_personal_data,
    sha256_of,
)
from photosite.sensor.io.sensor_file import preset_names


@pytest.fixture(scope="module")
def entry(loop: Any, tmp_path_factory: pytest.TempPathFactory) -> LoadedEntry:
    folder = tmp_path_factory.mktemp("library") / "cameras"
    return contribute(loop.calibration, folder, license_id="CC0-1.0", camera="Acme X-1")


@pytest.fixture
def library(entry: LoadedEntry, tmp_path: Path) -> Path:
    shutil.copytree(entry.folder.parent, tmp_path / "cameras")
    return tmp_path / "cameras"


def folder_of(library: Path) -> Path:
    return next(path for path in library.iterdir() if path.is_dir())


def seal(folder: Path) -> None:
    """Renew the digests of a changed entry and of its index, as a careful forger would."""
    stated = {name: sha256_of((folder / name).read_bytes()) for name in (SENSOR_NAME, TABLE_NAME)}
    before = (folder / ENTRY_NAME).read_text().partition("sha256:")[0]
    (folder / ENTRY_NAME).write_text(before + dump_yaml({"sha256": stated}))
    digests = {**stated, ENTRY_NAME: sha256_of((folder / ENTRY_NAME).read_bytes())}
    line = {"folder": folder.name, "camera": "Acme X-1", "license": "CC0-1.0", "created": created(folder)}
    content = {"photosite_camera_index": 1, "cameras": [{**line, "gain_settings": [], "sha256": digests}]}
    (folder.parent / INDEX_NAME).write_text(dump_yaml(content, width=1 << 20))


def created(folder: Path) -> str:
    text = (folder / ENTRY_NAME).read_text()
    return text.partition("created: ")[2].partition("\n")[0]


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_an_entry_is_the_measured_sensor(entry: LoadedEntry, loop: Any) -> None:
    measured, sensor = loop.calibration.sensor, entry.sensor
    assert (sensor.name, sensor.array, sensor.readout) == ("Acme X-1", measured.array, measured.readout)
    assert sensor.pixel == measured.pixel
    assert sensor.covariance == measured.covariance
    assert sensor.provenance.license == "CC0-1.0"
    assert entry.entry.frames == loop.calibration.frame_count
    (table,) = entry.table.settings
    assert table.figures["K"].value == loop.calibration.emva1288["K"].value
    assert set(sensor.provenance.frames_sha256) == set(loop.calibration.frames_sha256)


def test_another_lab_loads_it_by_name(library: Path) -> None:
    assert validate_cameras(library)[0].sensor == validate_cameras(folder_of(library))[0].sensor
    for place in (library, library / INDEX_NAME, folder_of(library)):
        camera = ps.load_camera_profile("acme x-1", profiles=place)
        assert camera.measured is not None
        assert camera.sensor("nikon-d200") is camera.measured
        assert camera.noise is not None
        assert camera.sources[0].license == "CC0-1.0"
    assert ps.load_sensor(folder_of(library) / SENSOR_NAME) == camera.measured
    assert pickle.loads(pickle.dumps(camera)).name == "Acme X-1"


def test_what_tells_a_person_a_place_or_a_chip_is_removed(loop: Any, tmp_path: Path) -> None:
    base = loop.calibration.base
    private = ps.Measured(0.55, 0.01, "by J. Doe in /home/doe/lab, 2026-01-31, serial 12345")
    base = base.with_(name="lab 7", dsnu_mv=private, dcnu_percent=private, notes="of J. Doe", serial="12345")
    pixel = base.with_(width_um=ps.Measured(6.05, 0.0, "J. Doe's microscope"))
    calibration = dataclasses.replace(loop.calibration, base=pixel, source="/home/doe/stack")
    found = contribute(calibration, tmp_path / "out", license_id="CC-BY-4.0", camera="Acme X-1", attribution="A lab")
    text = "".join(path.read_text() for path in found.folder.iterdir())
    for word in ("doe", "/home", "12345", "lab 7", "2026-01-31"):
        assert word not in text.lower(), word
    assert found.sensor.serial == "0"
    assert found.entry.attribution == "A lab"
    assert found.sensor.provenance.created == found.entry.created
    assert len(found.entry.created) == 7


def test_personal_data_in_the_name_is_refused_before_writing(loop: Any, tmp_path: Path) -> None:
    with raises(InputError, "camera", value="doe@lab.org"):
        contribute(loop.calibration, tmp_path / "a", license_id="MIT", camera="X-1 of doe@lab.org")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    "text",
    [
        "see /home/doe/x",
        r"C:\Users\doe",
        "~/frames",
        "a@b.org",
        "on 2026-01-31",
        "10.0.0.17",
        "serial no. 4711",
        "../a/b",
    ],
)
def test_personal_data(text: str) -> None:
    with raises(InputError, "a.source"):
        check_no_personal_data({"a": [{"source": text}]})
    with raises(InputError, "a key of a"):
        check_no_personal_data({"a": {text: 1}})


def test_names_of_the_machine_are_personal_data() -> None:
    check_no_personal_data({"source": "hosts"}, {"host": "the name of this machine"})
    with raises(InputError, "source", value="HOST"):
        check_no_personal_data({"source": "on HOST."}, {"host": "the name of this machine"})


@pytest.mark.parametrize("name", preset_names())
def test_the_sources_of_presets_are_no_personal_data(name: str) -> None:
    content = ps.load_sensor(name).model_dump(mode="json", exclude_none=True)
    check_no_personal_data({key: value for key, value in content.items() if key != "provenance"})


def test_license_and_base_are_required(loop: Any, tmp_path: Path) -> None:
    with raises(InputError, "license_id"):
        contribute(loop.calibration, tmp_path / "a", license_id=None)
    for unknown in ("CC-BY-NC-4.0", "GPL"):
        with raises(InputError, "license_id", value=unknown) as caught:
            contribute(loop.calibration, tmp_path / "a", license_id=unknown)
        assert all(str(caught.value).count(known) <= 1 for known in LICENSES)
    with pytest.raises(CalibrationError):
        contribute(dataclasses.replace(loop.calibration, base=None), tmp_path / "a", license_id="MIT")


def test_a_second_entry_is_added_and_the_same_one_is_listed_once(loop: Any, tmp_path: Path) -> None:
    first = contribute(loop.calibration, tmp_path / "a", license_id="MIT", camera="X-1")
    again = contribute(loop.calibration, tmp_path / "a", license_id="MIT", camera="X-1")
    contribute(loop.calibration, tmp_path / "a", license_id="MIT", camera="X-2")
    assert first.folder == again.folder
    assert [one.entry.camera for one in validate_cameras(tmp_path / "a")] == ["X-1", "X-2"]
    assert not list((tmp_path / "a").glob(".*"))


def test_two_entries_of_a_camera(loop: Any, tmp_path: Path) -> None:
    """Their folders are named; each can be passed, and copies of one entry count as one."""
    made = [contribute(loop.calibration, tmp_path / "a", license_id=each, camera="X-1") for each in ("MIT", "CC0-1.0")]
    folders = sorted(entry.folder for entry in made)
    with raises(InputError, "profiles", where="X-1", arguments={"profiles": str(folders[0])}) as caught:
        ps.load_camera_profile("x-1", profiles=tmp_path / "a")
    assert all(str(folder) in str(caught.value) for folder in folders)
    for entry in made:
        for place in (entry.folder, entry.folder / ENTRY_NAME):
            camera = ps.load_camera_profile("x-1", profiles=place)
            assert (camera.sources[0].path, camera.sources[0].license) == (entry.folder, entry.entry.license)
    shutil.copytree(folders[0], tmp_path / "b" / "copy")
    copies = [tmp_path / "b" / "copy", folders[0]]
    assert ps.load_camera_profile("x-1", profiles=copies).sources[0].path == folders[0]
    with raises(InputError, f"no cameras in {tmp_path / 'b'}: ", arguments={"profiles": str(copies[0])}):
        ps.load_camera_profile("x-1", profiles=tmp_path / "b")
    with raises(FileError, "holds neither") as refused:
        validate_cameras(tmp_path / "b")
    assert str(copies[0]) in (refused.value.hint or "")


def test_an_entry_is_preferred_to_a_noise_profile(library: Path, tmp_path: Path) -> None:
    content = darktable_content()
    content["noiseprofiles"][1]["maker"] = "Acme"
    content["noiseprofiles"][1]["models"][0]["model"] = "X-1"
    camera = ps.load_camera_profile("x-1", profiles=[write_json(tmp_path / "a.json", content), library])
    assert [source.path for source in camera.sources] == [folder_of(library)]
    assert str(tmp_path / "a.json") in camera.notes[0]


def test_a_series_has_all_its_gain_settings(tmp_path: Path) -> None:
    contribute(series(), tmp_path / "a", license_id="MIT", camera="Acme Z 9")
    (found,) = validate_cameras(tmp_path / "a")
    assert found.entry.gain_settings == found.sensor.all_gain_settings == (100, 200)
    camera = ps.load_camera_profile("acme z9", iso=200, profiles=tmp_path / "a")
    assert (camera.iso, camera.missing.keys()) == (200, {"the chip's own pattern"})
    with raises(InputError, "iso", value=400):
        ps.load_camera_profile("acme z9", iso=400, profiles=tmp_path / "a")


def test_nothing_is_left_of_an_entry_that_cannot_be_written(
    loop: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise FileError("x", "full")

    monkeypatch.setattr("photosite.library.contribute.check_entry", fail)
    with raises(FileError, "full"):
        contribute(loop.calibration, tmp_path / "a", license_id="MIT", camera="X-1")
    assert not list((tmp_path / "a").iterdir())


@pytest.mark.parametrize("name", [ENTRY_NAME, SENSOR_NAME, TABLE_NAME])
def test_a_tampered_entry_is_refused(library: Path, name: str) -> None:
    """Also where the digests of the entry are renewed and those of the index are not."""
    path = folder_of(library) / name
    path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    for read in (validate_cameras, lambda place: ps.load_camera_profile("x-1", profiles=place)):
        with raises(FileError, "sha256", path=str(path)):
            read(library)


@pytest.mark.parametrize(
    ("name", "old", "new", "what"),
    [
        (SENSOR_NAME, "license: CC0-1.0", "license: MIT", "license"),
        (SENSOR_NAME, "name: Acme X-1", "name: Acme X-2", "name"),
        (SENSOR_NAME, "serial: '0'", "serial: '4711'", "serial"),
        (SENSOR_NAME, "bits: 12", "bits: 99", "bits"),
        (SENSOR_NAME, "value: 6.05", "value: 6050", "width_um"),
        (SENSOR_NAME, "Table 1; square pixels", "by me, /home/doe/x.txt", "pixel.height_um.source"),
        (SENSOR_NAME, "serial: '0'", f"serial: '0'\nmaps: {{file: /etc/passwd, sha256: {'a' * 64}}}", "names maps"),
        (SENSOR_NAME, "photosite_sensor: 1", "photosite_sensor: 2", "photosite_sensor"),
        (TABLE_NAME, '"value": 0.12', '"value": 12.12', "K"),
        (TABLE_NAME, '"value"', '"valuee"', "unknown field"),
        (TABLE_NAME, "{", "[", "the file is not JSON"),
        (ENTRY_NAME, "license: CC0-1.0", "license: proprietary", "license"),
        (ENTRY_NAME, "created: 20", "created: 2026-01-31 # 20", "created"),
        (ENTRY_NAME, "photosite_entry: 1", "photosite_entry: 2", "photosite_entry"),
        (ENTRY_NAME, "software: photosite", "software: on 192.168.1.7 #", "software"),
    ],
)
def test_entries_with_renewed_digests_are_checked_all_the_same(
    library: Path, name: str, old: str, new: str, what: str
) -> None:
    folder = folder_of(library)
    change(folder / name, old, new)
    seal(folder)
    with pytest.raises(PhotositeError) as caught:
        validate_cameras(library)
    assert caught.value.what.startswith(what), caught.value
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("folder", ["../cameras", "/etc", "a/b", "..", "a b", ".hidden"])
def test_an_index_cannot_name_other_folders(library: Path, folder: str) -> None:
    change(library / INDEX_NAME, folder_of(library).name, f"'{folder}'")
    with raises(FileError, "folder") as caught:
        validate_cameras(library)
    assert caught.value.line is not None


def test_an_index_that_differs_from_its_entry(library: Path) -> None:
    change(library / INDEX_NAME, "license: CC0-1.0", "license: MIT")
    with raises(FileError, "license", value="MIT"):
        validate_cameras(library)


def test_links_and_missing_files(library: Path) -> None:
    folder = folder_of(library)
    (folder / TABLE_NAME).rename(library / "elsewhere.json")
    with raises(FileError, "there is no such file"):
        validate_cameras(library)
    (folder / TABLE_NAME).symlink_to(library / "elsewhere.json")
    with raises(FileError, "is a link"):
        validate_cameras(library)
    with raises(FileError, "holds neither"):
        validate_cameras(library.parent)


def test_every_field_of_the_schemas_has_a_description_and_a_unit() -> None:
    for model in SCHEMAS.values():
        schema = model.model_json_schema()
        for part in (schema, *schema.get("$defs", {}).values()):
            for name, field in part["properties"].items():
                assert field["description"], name
                assert field["unit"], name
        json.dumps(schema)
