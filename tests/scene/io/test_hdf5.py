"""Plain HDF5 cubes: any order of axes, chunked or in one piece, and refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import raises, warns
from scene_files import error_of, whole

from photosite.errors import InputError
from photosite.scene.cube import RawCube
from photosite.scene.io.formats import open_cube, read_scene, write_scene
from photosite.scene.io.hdf5 import ChunkedCube
from photosite.scene.scene import Scene

GRID = np.arange(400.0, 701, 50)
RNG = np.random.default_rng(6)
CUBE = RNG.integers(1, 1000, (12, 5, GRID.size)).astype(np.uint16)
ORDERS = {"bip": (0, 1, 2), "bsq": (2, 0, 1), "bil": (0, 2, 1)}


def saved(path: Path, array: Any = CUBE, attributes: dict[str, Any] | None = None, **how: Any) -> Path:
    with h5py.File(path, "w") as file:
        data = file.create_dataset("run/cube", data=array, **how)
        data.attrs.update({"wavelength_nm": GRID, "units": "W/sr/m2/nm"} if attributes is None else attributes)
    return path


@pytest.mark.parametrize("interleave", ORDERS)
@pytest.mark.parametrize("how", [{}, {"chunks": (2, 3, 4)}, {"chunks": True, "compression": "gzip"}])
def test_any_order_of_axes(tmp_path: Path, interleave: str, how: dict[str, Any]) -> None:
    stated = {"wavelength_nm": GRID, "units": "W/sr/m2/nm", "interleave": interleave, "scale": 0.5, "no_data": 7.0}
    array = CUBE.copy()
    array[3, 2, 1] = 7
    path = saved(tmp_path / "a.h5", array.transpose(ORDERS[interleave]), stated, **how)
    wanted = np.where(array == 7, np.nan, array * 0.5)
    assert_allclose(whole(path), wanted)
    assert isinstance(open_cube(path), ChunkedCube if how else RawCube)


@pytest.mark.parametrize("interleave", ["bsq", "bil"])
def test_bands_on_another_axis_must_be_stated(tmp_path: Path, interleave: str) -> None:
    path = saved(tmp_path / "a.h5", CUBE.transpose(ORDERS[interleave]))
    assert "interleave" in error_of(path).arguments
    assert_allclose(whole(path, interleave=interleave), CUBE)
    bare = saved(tmp_path / "b.h5", CUBE.transpose(ORDERS[interleave]), {"units": "W/sr/m2/nm"})
    assert "interleave" in error_of(bare, wavelength_nm=GRID).arguments
    assert_allclose(whole(bare, wavelength_nm=GRID, interleave=interleave), CUBE)


def test_a_cube_as_wide_as_it_has_bands_must_state_its_axes(tmp_path: Path) -> None:
    array = RNG.random((GRID.size, GRID.size, GRID.size))
    path = saved(tmp_path / "a.h5", array)
    assert "interleave" in error_of(path).arguments
    assert_allclose(whole(path, interleave="bip"), array)
    assert_allclose(whole(path, interleave="bsq"), array.transpose(1, 2, 0))
    scene = Scene.from_radiance(array, GRID, tolerance=1e-6)
    write_scene(scene, path, cube=True)  # states it
    assert_allclose(whole(path), array, atol=1e-5)


def test_a_list_of_wavelengths_that_does_not_fit(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.h5", attributes={"wavelength_nm": GRID[1:], "units": "W/sr/m2/nm"})
    assert error_of(path).what == "'wavelength_nm' has 6 entries for 7 bands"
    with warns("'wavelength_nm' has 6 entries for 7 bands"):
        assert open_cube(path, wavelength_nm=GRID).wavelength_nm.tolist() == GRID.tolist()
    named = {"wavelength_nm": GRID, "bands": "seven", "units": "W/sr/m2/nm"}
    assert_allclose(whole(saved(tmp_path / "b.h5", attributes=named)), CUBE)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("how", [{}, {"chunks": (2, 3, 4)}])
def test_values_beyond_double_precision_are_an_error(tmp_path: Path, how: dict[str, Any]) -> None:
    stated = {"wavelength_nm": GRID, "units": "kW/sr/m2/nm"}
    path = saved(tmp_path / "a.h5", np.full(CUBE.shape, 1e308), stated, **how)
    error_of(path)


def test_interleave_is_for_hdf5(tmp_path: Path) -> None:
    write_scene(Scene.from_radiance(CUBE.astype(float), GRID), tmp_path / "a.tif")
    assert "interleave" in str(error_of(tmp_path / "a.tif", interleave="bsq"))
    with raises(InputError, "interleave", value="abc"):
        read_scene(tmp_path / "a.tif", interleave="abc")


def test_attributes_of_groups_and_datasets_beside(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.h5", attributes={"no_data": -1.0})
    with h5py.File(path, "r+") as file:
        file["run/Wavelengths"] = GRID / 1000
        file["run/Wavelengths"].attrs["units"] = "micrometers"
        file.attrs["units"] = np.bytes_(b"reflectance")
        file["run"].attrs["distance_m"] = 3.0
        file.attrs["distance_m"] = 4.0
    cube = open_cube(path)
    assert cube.quantity == "reflectance"
    assert cube.distance_m == 3.0
    assert_allclose(cube.wavelength_nm, GRID)


def test_one_of_several(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file.create_dataset("other", data=2 * CUBE).attrs.update({"wavelength_nm": GRID, "units": "W/sr/m2/nm"})
    assert error_of(path).arguments == {"variable": "other"}
    assert_allclose(whole(path, variable="/other"), 2 * CUBE)


@pytest.mark.parametrize(
    ("attributes", "about"),
    [
        ({"wavelength_nm": GRID}, "units"),
        ({"units": "W/sr/m2/nm"}, "wavelength"),
        ({"wavelength": GRID * 10, "units": "W/sr/m2/nm"}, "wavelength"),
        ({"wavelength_nm": GRID / 1000, "units": "W/sr/m2/nm"}, "wavelength"),
        ({"wavelength_nm": GRID[[0, 2, 1, 3, 4, 5, 6]], "units": "photons"}, "wavelength"),
        ({"wavelength_nm": "blue", "units": "photons"}, "wavelength"),
        ({"wavelength_nm": GRID, "units": "counts"}, "units"),
        ({"wavelength_nm": GRID, "units": "photons", "interleave": "xyz"}, "interleave"),
        ({"wavelength_nm": GRID, "units": "photons", "scale": 0.0}, "scale"),
        ({"wavelength_nm": GRID, "units": "photons", "distance_m": "far"}, "distance_m"),
        ({"wavelength_nm": GRID, "units": "photons", "light": np.ones(3)}, "light"),
    ],
)
def test_invalid_attributes(tmp_path: Path, attributes: dict[str, Any], about: str) -> None:
    assert about in error_of(saved(tmp_path / "a.h5", attributes=attributes)).what


def test_files_without_a_cube(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["frame"] = CUBE[:, :, 0]
    assert "has no cube" in error_of(tmp_path / "a.h5", units="photons").what
    (tmp_path / "b.h5").write_bytes(b"no HDF5")
    assert "cannot be read as HDF5" in error_of(tmp_path / "b.h5").what


@pytest.mark.parametrize("how", [{}, {"chunks": (2, 3, 4), "compression": "gzip"}])
@pytest.mark.parametrize("fraction", [0.1, 0.6, 0.95])
def test_truncated_files(tmp_path: Path, how: dict[str, Any], fraction: float) -> None:
    path = saved(tmp_path / "a.h5", np.repeat(CUBE, 20, axis=0), **how)
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    error_of(path)
