"""Maps beside a sensor file: round trip, missing, changed and invalid files."""

from __future__ import annotations

import dataclasses
import os
import pickle
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from raising import raises

from photosite.camera.camera import Camera
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.writing import is_temporary
from photosite.optics.diffraction import DiffractionLimited
from photosite.sensor.chip import Blinking, DefectKind, Defects, MeasuredChip, no_blinking, no_defects
from photosite.sensor.io import sensor_file
from photosite.sensor.io.sensor_file import load_measured_chip, load_sensor, write_sensor
from photosite.sensor.sections import Maps

ROWS, COLS = 6, 8


def chip(**changes):
    rng = np.random.default_rng(1)

    def values():
        return rng.normal(0, 1, (ROWS, COLS)).astype(np.float32)

    where = np.array([1, 5]), np.array([7, 0])
    kind = np.array([DefectKind.HOT, DefectKind.BLINKING], np.uint8)
    defects = Defects(*where, kind, np.array([9.0, 8.0]), np.ones(2))
    arguments = {
        "offset_dn": values(),
        "offset_uncertainty_dn": abs(values()),
        "read_noise_dn": values(),
        "read_noise_freedom": 15,
        "prnu": values(),
        "prnu_uncertainty": abs(values()),
        "row_noise_dn": 0.5,
        "black_level_dn": 64.0,
        "system_gain_dn_per_e": 0.25,
        "reference_exposure_s": 0.01,
        "defects": defects,
        "blinking": Blinking(*where, np.array([20.0, 8.0]), np.array([0.5, 0.2]), np.array([2.0, 3.0])),
    }
    return MeasuredChip(**(arguments | changes))


def same(a, b):
    for entry in dataclasses.fields(a):
        x, y = getattr(a, entry.name), getattr(b, entry.name)
        if dataclasses.is_dataclass(x):
            same(x, y)
        else:
            np.testing.assert_array_equal(x, y, err_msg=entry.name)
            if isinstance(x, np.ndarray):
                assert x.dtype == y.dtype, entry.name


def test_round_trip(tmp_path) -> None:
    for number, wanted in enumerate((chip(), chip(system_gain_dn_per_e=None, prnu=None, defects=no_defects()))):
        path = tmp_path / f"{number}.maps.h5"
        maps = wanted.save(path)
        assert maps.sha256 == sensor_file.file_sha256(path)
        same(sensor_file.read_maps(maps.file), wanted)


def test_the_same_chip_gives_the_same_file(tmp_path) -> None:
    assert chip().save(tmp_path / "a.maps.h5").sha256 == chip().save(tmp_path / "b.maps.h5").sha256


def test_maps_are_copied_with_the_sensor_file(tmp_path) -> None:
    (tmp_path / "there").mkdir()
    sensor = load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS, maps=chip().save(tmp_path / "a.maps.h5"))
    sensor.save(tmp_path / "there" / "mine.sensor.yaml")
    assert "file: mine.maps.h5\n" in (tmp_path / "there" / "mine.sensor.yaml").read_text()
    (tmp_path / "a.maps.h5").unlink()
    (tmp_path / "there").rename(tmp_path / "elsewhere")
    again = load_sensor(tmp_path / "elsewhere" / "mine.sensor.yaml")
    same(load_measured_chip(again), chip())
    again.save(tmp_path / "elsewhere" / "other.sensor.yaml")  # beside its maps already: nothing is copied
    assert [f.name for f in (tmp_path / "elsewhere").glob("*.h5")] == ["mine.maps.h5"]
    with pytest.warns(PhotositeWarning, match="read_noise_mv, so that the change has no effect"):
        assert again.with_(read_noise_e=1).maps == again.maps
    other = again.with_(gain_setting=100, gain_settings=[{"setting": 200, "read_noise_e": 4}])
    with pytest.warns(PhotositeWarning, match="those of gain setting 100; at 200"):
        assert other.at_gain_setting(200).maps is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert again.with_(name="Mine", fill_factor=0.5).maps == other.at_gain_setting(100).maps == again.maps
        assert again.with_(read_noise_e=1, maps=None).maps is None
    assert again.with_(serial="2").maps is None
    assert load_measured_chip(again.with_(maps=None)) is None


class _StopError(Exception):
    """The process is killed here: what would be tidied up afterwards stays."""


def stop_at(monkeypatch: pytest.MonkeyPatch, call: int, function: str) -> None:
    """Stop at a call of `os.replace` or `os.fsync`, counted from 0, and let nothing happen to files after it."""
    made, real = 0, getattr(os, function)

    def stops(*arguments: Any) -> None:
        nonlocal made
        made += 1
        if made > call:
            for name in ("replace", "unlink", "remove"):
                monkeypatch.setattr(os, name, lambda *_: None)
            raise _StopError
        real(*arguments)

    monkeypatch.setattr(os, function, stops)


@pytest.mark.parametrize("function", ["replace", "fsync"])
def test_a_sensor_file_and_its_maps_are_one_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function: str
) -> None:
    """Ended at any rename or sync, over an older pair: the older pair, or the new one; the next run tidies up."""
    base = load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS)
    before, after = chip(), chip(row_noise_dn=0.6)
    path, found = tmp_path / "mine.sensor.yaml", []
    for call in range(20):
        write_sensor(base.with_(name="before"), path, before)
        with monkeypatch.context() as patched, suppress(_StopError):
            stop_at(patched, call, function)
            write_sensor(base.with_(name="after"), path, after)
            break
        sensor = load_sensor(path)
        found.append(sensor.name)
        same(load_measured_chip(sensor), {"before": before, "after": after}[sensor.name])
        sensor.save(tmp_path / "copy.sensor.yaml")  # whatever the file of its maps is called now
        (tmp_path / "copy.sensor.yaml").unlink()
    assert found == sorted(found, reverse=True)
    assert set(found) == {"before", "after"}
    monkeypatch.undo()
    write_sensor(base.with_(name="after"), path, after)
    left = {file.name for file in tmp_path.iterdir() if not is_temporary(file.name)}  # this process runs
    assert left == {"mine.sensor.yaml", "mine.maps.h5"}


def test_maps_of_another_sensor_file_are_not_replaced(tmp_path: Path) -> None:
    path, other = tmp_path / "mine.sensor.yaml", tmp_path / "other.sensor.yaml"
    write_sensor(load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS), path, chip())
    load_sensor(path).save(other)  # in the same folder: it has the same maps
    (tmp_path / "note.yaml").write_text("maps: [mine.maps.h5")
    before = path.read_text()
    with raises(FileError, "holds the maps of other.sensor.yaml", path=str(tmp_path / "mine.maps.h5")):
        write_sensor(load_sensor(path).with_(name="again"), path, chip(row_noise_dn=0.6))
    assert path.read_text() == before
    same(load_measured_chip(load_sensor(other)), chip())
    other.unlink()
    write_sensor(load_sensor(path).with_(name="again"), path, chip(row_noise_dn=0.6))
    same(load_measured_chip(load_sensor(path)), chip(row_noise_dn=0.6))


def test_a_capture_reads_no_file(tmp_path: Path) -> None:
    base = load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS)
    lens, dark = DiffractionLimited(8, 50), np.zeros((ROWS, COLS), np.float32)
    cameras = [
        Camera(lens, base.with_(maps=chip(row_noise_dn=noise).save(tmp_path / f"{noise}.maps.h5")))
        for noise in (0.1, 0.2, 0.3)  # more than the cache of chips holds
    ]
    wanted = cameras[0].expose(dark, 0.1, seed=1)
    copied = pickle.loads(pickle.dumps(cameras[0]))
    assert (copied.expose(dark, 0.1, seed=1).dn == wanted.dn).all()
    for camera in cameras:
        Path(camera.sensor.maps.file).unlink()
    assert (cameras[0].expose(dark, 0.1, seed=1).dn == wanted.dn).all()
    with raises(FileError, "there is no such file of maps"):
        Camera(lens, cameras[0].sensor.with_(maps=Maps(file="none.h5", sha256="0" * 64)))


def test_missing_and_changed_maps(tmp_path) -> None:
    sensor = load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS, maps=chip().save(tmp_path / "a.maps.h5"))
    chip(row_noise_dn=0.6).save(tmp_path / "a.maps.h5")
    with raises(FileError, "sha256", path=str(tmp_path / "a.maps.h5")):
        _ = load_measured_chip(sensor)
    with raises(FileError, "sha256"):
        sensor.save(tmp_path / "b.sensor.yaml")
    assert not (tmp_path / "b.sensor.yaml").exists()
    (tmp_path / "a.maps.h5").unlink()
    with raises(FileError, "there is no such file of maps"):
        _ = load_measured_chip(sensor)
    with raises(FileError, "there is no such file of maps"):
        load_measured_chip(sensor.with_(maps=Maps(file="a\0b", sha256="0" * 64)))


def changed(name, path, content):
    def change(file):
        if path in file.attrs:
            del file.attrs[path]
        elif path in file:
            del file[path]
        if content is not None:
            if name == "attribute":
                file.attrs[path] = content
            else:
                file[path] = content

    return change


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (changed("attribute", "photosite_maps", 2), "photosite_maps"),
        (changed("attribute", "photosite_maps", "x"), "photosite_maps"),
        (changed("attribute", "black_level_dn", None), "black_level_dn"),
        (changed("attribute", "black_level_dn", "64"), "black_level_dn"),
        (changed("attribute", "row_noise_dn", np.nan), "row_noise_dn"),
        (changed("attribute", "read_noise_freedom", 0), "read_noise_freedom"),
        (changed("attribute", "system_gain_dn_per_e", -1.0), "system_gain_dn_per_e"),
        (changed("map", "read_noise_dn", None), "the map read_noise_dn is missing"),
        (changed("map", "offset_dn", np.zeros((3, 3))), "offset_uncertainty_dn"),
        (changed("map", "prnu", np.zeros(9)), "prnu"),
        (changed("map", "prnu", np.full((ROWS, COLS), np.inf)), "prnu"),
        (changed("map", "defects/row", np.array([0, ROWS])), "row"),
        (changed("map", "blinking/col", np.array([1])), "the columns of blinking differ in length"),
        (changed("map", "defects/value", None), "defects/value"),
    ],
)
def test_invalid_maps(tmp_path, change, what) -> None:
    path = tmp_path / "a.maps.h5"
    chip().save(path)
    with h5py.File(path, "r+") as file:
        change(file)
    with raises(FileError, what, path=str(path)):
        sensor_file.read_maps(path)


@pytest.mark.parametrize("content", [b"", b"not HDF5", b"\x89HDF\r\n\x1a\n" + bytes(200)])
def test_files_that_are_not_hdf5(tmp_path, content) -> None:
    path = tmp_path / "a.maps.h5"
    path.write_bytes(content)
    with raises(FileError, "the file cannot be read as HDF5 maps"):
        sensor_file.read_maps(path)


def test_maps_that_are_too_large(tmp_path, monkeypatch) -> None:
    path = tmp_path / "a.maps.h5"
    chip().save(path)
    monkeypatch.setattr(sensor_file, "MOST_PIXELS", ROWS * COLS - 1)
    with raises(FileError, "offset_dn.shape", value=(ROWS, COLS)):
        sensor_file.read_maps(path)


def test_maps_of_another_size_or_with_nan() -> None:
    with raises(InputError, "prnu"):
        chip(prnu=np.zeros((ROWS, COLS + 1), np.float32))
    with raises(InputError, "offset_dn"):
        chip(offset_dn=np.full((ROWS, COLS), np.nan, np.float32))
    assert len(chip(blinking=no_blinking()).blinking) == 0
