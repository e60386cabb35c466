"""Maps beside a sensor file: the same chip comes back, and nothing else passes for it."""

from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest

from photosite.errors import FileError, InputError
from photosite.sensor.io import maps_file
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.measured_chip import Blinking, DefectKind, Defects, MeasuredChip, no_blinking, no_defects
from photosite.sensor.model import Maps

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


def test_a_chip_comes_back(tmp_path) -> None:
    for number, wanted in enumerate((chip(), chip(system_gain_dn_per_e=None, prnu=None, defects=no_defects()))):
        path = tmp_path / f"{number}.maps.h5"
        maps = wanted.save(path)
        assert maps.sha256 == maps_file.file_sha256(path)
        same(maps_file.load_maps(maps), wanted)


def test_the_same_chip_gives_the_same_file(tmp_path) -> None:
    assert chip().save(tmp_path / "a.maps.h5").sha256 == chip().save(tmp_path / "b.maps.h5").sha256


def test_a_sensor_file_takes_its_maps_along(tmp_path) -> None:
    (tmp_path / "there").mkdir()
    sensor = load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS, maps=chip().save(tmp_path / "a.maps.h5"))
    sensor.save(tmp_path / "there" / "mine.sensor.yaml")
    assert "file: mine.maps.h5\n" in (tmp_path / "there" / "mine.sensor.yaml").read_text()
    (tmp_path / "a.maps.h5").unlink()
    (tmp_path / "there").rename(tmp_path / "elsewhere")
    again = load_sensor(tmp_path / "elsewhere" / "mine.sensor.yaml")
    same(again.measured_chip, chip())
    again.save(tmp_path / "elsewhere" / "other.sensor.yaml")  # beside its maps already: nothing is copied
    assert [f.name for f in (tmp_path / "elsewhere").glob("*.h5")] == ["mine.maps.h5"]
    assert again.with_(read_noise_mv=1).maps == again.maps
    assert again.with_(serial="2").maps is None
    assert again.with_(maps=None).measured_chip is None


def test_maps_that_are_missing_or_changed_are_refused(tmp_path) -> None:
    sensor = load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS, maps=chip().save(tmp_path / "a.maps.h5"))
    chip(row_noise_dn=0.6).save(tmp_path / "a.maps.h5")
    with pytest.raises(FileError, match=r"a\.maps\.h5: is not the file of maps that the sensor file means"):
        _ = sensor.measured_chip
    with pytest.raises(FileError, match="is not the file"):
        sensor.save(tmp_path / "b.sensor.yaml")
    assert not (tmp_path / "b.sensor.yaml").exists()
    (tmp_path / "a.maps.h5").unlink()
    with pytest.raises(FileError, match="no such file of maps"):
        _ = sensor.measured_chip
    with pytest.raises(FileError, match="cannot be read"):
        maps_file.load_maps(Maps(file="a\0b", sha256="0" * 64))


def spoiled(name, path, content):
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
    ("change", "message"),
    [
        (spoiled("attribute", "photosite_maps", 2), "expected the attribute photosite_maps = 1"),
        (spoiled("attribute", "photosite_maps", "x"), "expected the attribute photosite_maps = 1"),
        (spoiled("attribute", "black_level_dn", None), "black_level_dn is a number"),
        (spoiled("attribute", "black_level_dn", "64"), "black_level_dn is a number"),
        (spoiled("attribute", "row_noise_dn", np.nan), "row_noise_dn is finite"),
        (spoiled("attribute", "read_noise_freedom", 0), "read_noise_freedom is 1 or more"),
        (spoiled("attribute", "system_gain_dn_per_e", -1.0), "system_gain_dn_per_e is above 0"),
        (spoiled("map", "read_noise_dn", None), "lacks the map read_noise_dn"),
        (spoiled("map", "offset_dn", np.zeros((3, 3))), "the maps of a chip are"),
        (spoiled("map", "prnu", np.zeros(9)), "prnu is a dataset of numbers with 2"),
        (spoiled("map", "prnu", np.full((ROWS, COLS), np.inf)), "not finite"),
        (spoiled("map", "defects/row", np.array([0, ROWS])), "a row is from 0 to 5, not 0 to 6"),
        (spoiled("map", "blinking/col", np.array([1])), "the columns of blinking differ in length"),
        (spoiled("map", "defects/value", None), "defects/value is a dataset"),
    ],
)
def test_files_that_hold_something_else_are_refused_in_a_line(tmp_path, change, message) -> None:
    path = tmp_path / "a.maps.h5"
    chip().save(path)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FileError, match=message) as caught:
        maps_file.read_maps(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"not HDF5", b"\x89HDF\r\n\x1a\n" + bytes(200)])
def test_what_is_not_hdf5_is_refused(tmp_path, content) -> None:
    path = tmp_path / "a.maps.h5"
    path.write_bytes(content)
    with pytest.raises(FileError, match="cannot be read as HDF5 maps"):
        maps_file.read_maps(path)


def test_a_map_too_large_is_not_read(tmp_path, monkeypatch) -> None:
    path = tmp_path / "a.maps.h5"
    chip().save(path)
    monkeypatch.setattr(maps_file, "MOST_PIXELS", ROWS * COLS - 1)
    with pytest.raises(FileError, match="more than 47 numbers are not read"):
        maps_file.read_maps(path)


def test_maps_of_another_size_or_place_are_refused() -> None:
    with pytest.raises(InputError, match="prnu is"):
        chip(prnu=np.zeros((ROWS, COLS + 1), np.float32))
    with pytest.raises(InputError, match="not finite"):
        chip(offset_dn=np.full((ROWS, COLS), np.nan, np.float32))
    assert len(chip(blinking=no_blinking()).blinking) == 0
