"""Cameras found by name in several files, their noise at an ISO speed, and what the files do not contain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_files import darktable_content, rawtoaces_content, write_json
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.frames.io.darktable import read_darktable_cameras
from photosite.frames.io.darktable_scale import slope_and_offset
from photosite.library.sources import find_cameras


@pytest.fixture
def profiles(tmp_path: Path) -> Path:
    return write_json(tmp_path / "noiseprofiles.json", darktable_content())


def test_all_cameras_of_a_file(profiles: Path) -> None:
    found = find_cameras(profiles)
    assert [source.name for source in found] == ["Canon EOS-1Ds", "Nikon D3", "Nikon D300", "Nikon D850"]
    d850 = found[-1]
    assert (d850.kind, d850.isos, d850.provenance) == ("noise profile", (64, 400, 6400), "d850 contributed by a user")
    assert "not stated" in d850.license


@pytest.mark.parametrize("name", ["Nikon D850", "nikon d850", "NIKON CORPORATION NIKON D850", "D850", "NikonD850"])
def test_names_match_in_any_spelling(profiles: Path, name: str) -> None:
    camera = ps.load_camera_profile(name, iso=6400, profiles=profiles)
    assert (camera.name, camera.iso) == ("Nikon D850", 6400)


def test_a_name_that_is_a_part_of_another_is_exact(profiles: Path) -> None:
    assert ps.load_camera_profile("d3", profiles=profiles).name == "Nikon D3"
    assert ps.load_camera_profile("eos 1ds", iso=100, profiles=profiles).name == "Canon EOS-1Ds"


def test_several_and_no_matches(profiles: Path) -> None:
    with raises(InputError, "name", value="nikon", hint="It matches Nikon D3, Nikon D300, Nikon D850"):
        ps.load_camera_profile("nikon", profiles=profiles)
    with raises(InputError, "name", value="Nikon D855") as caught:
        ps.load_camera_profile("Nikon D855", profiles=profiles)
    assert "Nikon D850" in (caught.value.hint or "")
    with raises(InputError, "name", value=""):
        ps.load_camera_profile("", profiles=profiles)


def test_iso_missing_outside_and_between(profiles: Path) -> None:
    """Linear in ISO: these profiles are proportional to the ISO, and so is what lies between."""
    with raises(InputError, "iso"):
        ps.load_camera_profile("D850", profiles=profiles)
    for iso in (63.0, 12800.0):
        with raises(InputError, "iso", value=iso, where="Nikon D850"):
            ps.load_camera_profile("D850", iso=iso, profiles=profiles)
    camera = ps.load_camera_profile("D850", iso=1600, profiles=profiles)
    assert camera.noise is not None
    assert camera.noise.slope[1] == slope_and_offset(2e-8 * 1600, 1e-10 * 1600)[0]
    assert any("between 400 and 6400" in note for note in camera.notes)
    assert not any("between" in note for note in ps.load_camera_profile("D850", iso=400, profiles=profiles).notes)


def test_several_profiles_of_one_iso_are_averaged(tmp_path: Path) -> None:
    content = darktable_content()
    entries = content["noiseprofiles"][0]["models"][1]["profiles"]
    entries.append({**entries[0], "a": [6e-6] * 3, "b": [0] * 3})
    entries.append({**entries[0], "a": [9] * 3, "skip": True})
    (_, d3, *_) = read_darktable_cameras(write_json(tmp_path / "a.json", content))
    assert (d3.isos, d3.a, d3.b) == ((200,), (pytest.approx(5e-6),), (pytest.approx(1e-8),))


def test_noise_and_spectra_of_two_files_make_a_sensor(profiles: Path, tmp_path: Path) -> None:
    table = write_json(tmp_path / "nikon_d850_380_780_5.json", rawtoaces_content())
    camera = ps.load_camera_profile("Nikon D850", iso=6400, profiles=tmp_path)
    assert {source.path for source in camera.sources} == {profiles, table}
    assert {source.license for source in camera.sources if source.path == table} == {"Apache-2.0"}
    assert {"pixel size", "well capacity", "bit depth and black level"} <= camera.missing.keys()
    low, high = camera.electrons_at_white_95
    assert low < 1 / (16 * 2e-8 * 6400) < high
    base = ps.load_sensor("nikon-d200")
    sensor = camera.sensor(base)
    assert sensor.name == "Nikon D850"
    assert low < (base.white_level_dn - base.readout.black_level_dn.value) / sensor.system_gain_dn_per_e < high
    assert sensor.pixel.conversion_gain_uv_per_e.standard_uncertainty > 0
    assert sensor.channels["R"].wavelength_nm[int(np.argmax(sensor.channels["R"].quantum_efficiency))] == 600
    assert camera.sensor("nikon-d200") == sensor


def test_files_with_different_data_on_a_camera(profiles: Path, tmp_path: Path) -> None:
    """Another spectral sensitivity, and another noise profile: each is named, and one of each kind can be passed."""
    table = write_json(tmp_path / "d850 {1}.json", rawtoaces_content())
    other = tmp_path / "Nikon_D850.csv"
    other.write_text("nm,R,G,B\n400,0,0.1,0.9\n500,0.1,1,0.2\n")
    with raises(InputError, "profiles", where="Nikon D850", arguments={"profiles": str(other)}) as caught:
        ps.load_camera_profile("d850", iso=400, profiles=[profiles, table, other])
    assert all(str(path) in str(caught.value) for path in (table, other))
    assert str(profiles) not in str(caught.value)
    for chosen in (table, other):
        camera = ps.load_camera_profile("d850", iso=400, profiles=[profiles, chosen])
        assert [source.path for source in camera.sources] == [profiles, chosen]
    content = darktable_content()
    content["noiseprofiles"][0]["models"][0]["profiles"][0]["a"] = [1e-6] * 3
    changed = write_json(tmp_path / "changed.json", content)
    with raises(InputError, "profiles", where="Nikon D850", arguments={"profiles": str(changed)}):
        ps.load_camera_profile("d850", iso=400, profiles=[profiles, changed])
    assert ps.load_camera_profile("d300", profiles=[profiles, changed]).sources[0].path == changed


def test_two_cameras_of_one_name_in_a_file(tmp_path: Path) -> None:
    content = darktable_content()
    again = darktable_content()["noiseprofiles"][0]
    again["maker"] = "NIKON CORPORATION"
    again["models"][1]["profiles"][0]["a"] = [1e-6] * 3
    content["noiseprofiles"].append(again)
    path = write_json(tmp_path / "a.json", content)
    with raises(InputError, "profiles", arguments={}) as caught:
        ps.load_camera_profile("d3", profiles=path)
    assert str(path) in str(caught.value)
    assert ps.load_camera_profile("d300", profiles=path).iso == 200


def test_a_folder_without_cameras(tmp_path: Path) -> None:
    with raises(InputError, f"no cameras in {tmp_path}: ", arguments={"profiles": "noiseprofiles.json"}):
        ps.load_camera_profile("d850", profiles=tmp_path)


def test_levels_give_the_gain_in_dn(profiles: Path) -> None:
    camera = ps.load_camera_profile("D850", iso=400, profiles=profiles, black_level_dn=400, white_level_dn=15_892)
    assert camera.noise is not None
    assert camera.noise.system_gain_dn_per_e.value == pytest.approx(camera.noise.slope[0].value * 15_492)
    assert "bit depth and black level" not in camera.missing
    with raises(InputError, "white_level_dn"):
        ps.load_camera_profile("D850", iso=400, profiles=profiles, black_level_dn=400)
    with raises(InputError, "black_level_dn"):
        ps.load_camera_profile("D850", iso=400, profiles=profiles, white_level_dn=400)
    with raises(InputError, "white_level_dn", value=400):
        ps.load_camera_profile("D850", iso=400, profiles=profiles, black_level_dn=400, white_level_dn=400)


def test_spectra_alone_have_no_iso(tmp_path: Path) -> None:
    table = write_json(tmp_path / "a.json", rawtoaces_content())
    camera = ps.load_camera_profile("d850", profiles=[table])
    assert camera.noise is None
    assert "noise" in camera.missing
    with raises(InputError, "iso", value=100):
        ps.load_camera_profile("d850", iso=100, profiles=[table])
    with raises(InputError, "the camera has no noise profile"):
        _ = camera.electrons_at_white_95


def test_places_of_the_environment(profiles: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("photosite.library.sources._DARKTABLE_FOLDERS", ())
    monkeypatch.setattr("photosite.library.sources._RAWTOACES_FOLDERS", ())
    with raises(InputError, "no files with cameras were found"):
        ps.load_camera_profile("d850")
    monkeypatch.setenv("PHOTOSITE_PROFILES", str(profiles))
    (tmp_path / "data" / "camera").mkdir(parents=True)
    write_json(tmp_path / "data" / "camera" / "a.json", rawtoaces_content())
    monkeypatch.setenv("RAWTOACES_DATA_PATH", str(tmp_path / "data"))
    assert len(find_cameras()) == 5
    monkeypatch.setenv("PHOTOSITE_PROFILES", str(tmp_path / "none"))
    with raises(FileError, "there is no such file or folder"):
        find_cameras()


def test_an_invalid_file_of_a_folder_is_skipped(profiles: Path) -> None:
    (profiles.parent / "other.json").write_text('{"a": 1}')
    assert len(find_cameras(profiles.parent)) == 4
    (profiles.parent / "cut.json").write_text("{")
    (profiles.parent / "table.csv").write_text("a,b")
    with pytest.warns(PhotositeWarning) as caught:
        assert len(find_cameras(profiles.parent)) == 4
    assert len(caught) == 2


def test_x_trans_is_not_covered(tmp_path: Path) -> None:
    content = darktable_content()
    content["noiseprofiles"][1]["maker"] = "Fujifilm"
    camera = ps.load_camera_profile("1ds", iso=100, profiles=write_json(tmp_path / "a.json", content))
    assert any("X-Trans" in note for note in camera.notes)


def test_a_slope_of_no_sensor(tmp_path: Path) -> None:
    content = darktable_content()
    low, negative = content["noiseprofiles"][1]["models"][0]["profiles"]
    low["a"], negative["a"] = [1e-12] * 3, [-1e-5] * 3
    path = write_json(tmp_path / "a.json", content)
    for iso, a in ((100, 1e-12), (200, -1e-5)):
        with raises(InputError, "a", value=a):
            ps.load_camera_profile("1ds", iso=iso, profiles=path)
    assert ps.load_camera_profile("d3", profiles=path).iso == 200


@pytest.mark.parametrize(
    ("name", "given"),
    [("iso", {"iso": "100"}), ("iso", {"iso": -1}), ("white_level_dn", {"iso": 200, "black_level_dn": 64})],
)
def test_invalid_arguments(profiles: Path, name: str, given: dict[str, Any]) -> None:
    with raises(InputError, name):
        ps.load_camera_profile("d3", profiles=profiles, **given)


@pytest.mark.parametrize("given", [{"mono": True}, {"black_level_dn": 64, "white_level_dn": 4095}])
def test_levels_apply_to_noise_profiles_only(tmp_path: Path, given: dict[str, Any]) -> None:
    write_json(tmp_path / "a.json", rawtoaces_content())
    with raises(InputError, next(iter(given)), value=next(iter(given.values()))):
        ps.load_camera_profile("D850", profiles=tmp_path, **given)


@pytest.mark.parametrize("a", [[1e-6], "abc", [1e-6, None, 1e-6]])
def test_coefficients_that_are_not_three_numbers(tmp_path: Path, a: Any) -> None:
    content = darktable_content()
    content["noiseprofiles"][0]["models"][0]["profiles"][0]["a"] = a
    with raises(FileError, "the file is not"):
        find_cameras(write_json(tmp_path / "a.json", content))


def test_an_invalid_coefficient_names_camera_and_iso(tmp_path: Path) -> None:
    content = darktable_content()
    profile = content["noiseprofiles"][0]["models"][0]["profiles"][1]
    for changed in ({"a": [1e-6, "b", 1e-6]}, {"b": None}):
        profile.update(changed)
        with raises(FileError, "the file is not a valid darktable noise profile: Nikon D850, ISO 400: ") as caught:
            find_cameras(write_json(tmp_path / "a.json", content))
        assert "'a'" in caught.value.what
    del profile["iso"]
    with raises(FileError, "the file is not a valid darktable noise profile: Nikon D850: 'iso' is missing"):
        find_cameras(write_json(tmp_path / "a.json", content))
