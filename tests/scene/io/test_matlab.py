"""MATLAB files: cubes of versions 5 and 7.3, ISET's scenes as its own readers interpret them, and invalid files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import raises, warns
from scene_files import whole
from scipy.io import loadmat, savemat

from photosite.color.spectrum import energy_from_photons, photons_from_energy
from photosite.errors import FileError, InputError
from photosite.scene.io import hdf5, matlab
from photosite.scene.io.formats import open_cube, read_scene, write_scene
from photosite.scene.scene import Scene

GRID = np.arange(400.0, 701, 50)
RNG = np.random.default_rng(6)
CUBE = RNG.uniform(1, 2, (6, 5, GRID.size))
UNITS = {"units": "W/sr/m2/nm"}


def save73(path: Path, content: dict[str, Any], **how: Any) -> Path:
    """As MATLAB writes version 7.3: a header of 512 bytes, arrays with their axes reversed, structures as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            if isinstance(value, str):
                data = file.create_dataset(name, data=np.array([[ord(c)] for c in value], np.uint16))
                data.attrs["MATLAB_class"] = np.bytes_(b"char")
            else:
                array = np.atleast_2d(value)
                data = file.create_dataset(name, data=array.T, **(how if array.ndim == 3 else {}))
                data.attrs["MATLAB_class"] = np.bytes_(b"double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: today HDF5 schema 1.00 .".ljust(128))
    return path


@pytest.mark.parametrize("how", [{}, {"chunks": (1, 5, 6)}, {"chunks": (3, 2, 4), "compression": "gzip"}])
def test_a_cube_of_version_7_3(tmp_path: Path, how: dict[str, Any]) -> None:
    """ICVL's names: rad and bands."""
    path = save73(tmp_path / "a.mat", {"rad": CUBE, "bands": GRID, "rgb": CUBE[:, :, 0]}, **how)
    assert_allclose(whole(path, **UNITS), CUBE)
    assert read_scene(path, **UNITS).wavelength_nm.tolist() == GRID.tolist()


def test_a_cube_stored_by_bands_is_copied_where_a_slab_of_rows_is_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from photosite.scene.cube import RawCube

    path = save73(tmp_path / "a.mat", {"rad": CUBE, "bands": GRID}, chunks=(3, 2, 4), compression="gzip")
    monkeypatch.setattr(hdf5, "_SLAB_BYTES", 8 * 5 * GRID.size * 3)
    cube = open_cube(path, **UNITS)
    assert isinstance(cube, RawCube)
    assert_allclose(whole(path, **UNITS), CUBE)
    spooled = cube.path
    assert spooled.exists()
    del cube
    assert not spooled.exists()


@pytest.mark.parametrize(("dtype", "compressed"), [(np.uint8, False), (np.uint16, True), (np.float64, False)])
def test_a_cube_of_version_5(tmp_path: Path, dtype: type, compressed: bool) -> None:
    array = (CUBE * 100).astype(dtype)
    savemat(tmp_path / "a.mat", {"ref": array, "wavelength_nm": GRID}, do_compression=compressed)
    assert_allclose(whole(tmp_path / "a.mat", units="percent"), array / 100)


def test_units_and_their_wavelengths_in_the_file(tmp_path: Path) -> None:
    content = {"cube": CUBE, "lambda": GRID / 1000, "wavelength_units": "um", "units": "W/sr/m2/nm"}
    savemat(tmp_path / "a.mat", content)
    assert read_scene(tmp_path / "a.mat").wavelength_nm == pytest.approx(GRID)
    save73(tmp_path / "b.mat", content)
    assert read_scene(tmp_path / "b.mat").wavelength_nm == pytest.approx(GRID)


def iset_basis_form() -> tuple[dict[str, Any], np.ndarray]:
    """A file's content, and its photons as vcReadImage.m computes them: coefficients x basis + mean, not below 0."""
    coefficients = RNG.normal(0, 1, (6, 5, 3))
    basis = np.linalg.qr(RNG.normal(0, 1, (GRID.size, 3)))[0]
    mean = RNG.uniform(0.1, 1, GRID.size)
    light = RNG.uniform(1, 2, GRID.size) * 1e16
    content = {
        "mcCOEF": coefficients * 1e15,
        "basis": {"basis": basis, "wave": GRID[:, None]},
        "imgMean": mean[None, :] * 1e15,
        "comment": "made for this test",
        "illuminant": {
            "type": "illuminant",
            "name": "lamp",
            "data": {"photons": light},
            "spectrum": {"wave": GRID[:, None]},
        },
        "fov": 20.0,
        "dist": 1.5,
        "name": "three lights",
    }
    return content, np.maximum(1e15 * (coefficients @ basis.T + mean), 0)


def flat(content: dict[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in content.items():
        found |= flat(value, f"{before}{name}/") if isinstance(value, dict) else {before + name: value}
    return found


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_isets_basis_form(tmp_path: Path, version: str) -> None:
    content, photons = iset_basis_form()
    assert (photons == 0).any()
    path = tmp_path / "iset.mat"
    if version == "5":
        savemat(path, content)
    else:
        save73(path, flat(content))
    cube = open_cube(path)
    assert_allclose(whole(path), photons, rtol=1e-12)
    assert_allclose(cube.light, content["illuminant"]["data"]["photons"])
    assert cube.distance_m == 1.5
    assert cube.width_m == pytest.approx(2 * 1.5 * math.tan(math.radians(10)))
    assert cube.title == "three lights"
    scene = read_scene(path, tolerance=1e-6)
    assert_allclose(scene.radiance(2, 3), photons[2, 3], atol=1e-4 * photons.max())
    assert_allclose(scene.light(), cube.light, rtol=1e-6)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_isets_photons_and_its_own_structure(tmp_path: Path, version: str) -> None:
    photons = CUBE * 1e15
    plain = {"photons": photons, "wave": GRID, "fov": 10.0, "dist": 2.0, "comment": "x"}
    own = {"scene": {"data": {"photons": photons}, "spectrum": {"wave": GRID}, "wAngular": 10.0, "distance": 2.0}}
    for content in (plain, own):
        path = tmp_path / "iset.mat"
        path.unlink(missing_ok=True)
        if version == "5":
            savemat(path, content)
        else:
            save73(path, flat(content))
        cube = open_cube(path)
        assert cube.quantity == "photon radiance"
        assert_allclose(whole(path), photons)
        assert cube.wavelength_nm.tolist() == GRID.tolist()
        assert cube.width_m == pytest.approx(4 * math.tan(math.radians(5)))


def test_isets_old_illuminants(tmp_path: Path) -> None:
    """data is energy; photons packed between a minimum and a maximum are ignored."""
    energy = RNG.uniform(1, 2, GRID.size)
    base = {"photons": CUBE * 1e15, "wave": GRID}
    savemat(tmp_path / "a.mat", base | {"illuminant": {"data": energy, "wavelength": GRID}})
    assert_allclose(open_cube(tmp_path / "a.mat").light, photons_from_energy(energy, GRID))
    assert_allclose(energy_from_photons(open_cube(tmp_path / "a.mat").light, GRID), energy)
    old = {"data": {"photons": energy, "min": 0.0, "max": 2.0}, "spectrum": {"wave": GRID}, "type": "illuminant"}
    untyped = {"data": {"photons": energy * 1e15}, "spectrum": {"wave": GRID}}
    short = {"data": {"photons": energy[1:] * 1e15}, "spectrum": {"wave": GRID[1:]}, "type": "illuminant"}
    uneven = {"data": {"photons": CUBE * 1e15}, "spectrum": {"wave": GRID}, "type": "illuminant"}
    for left_out, why in (
        (old, "is packed"),
        (untyped, "has no type"),
        (short, "does not cover the scene's wavelengths"),
        (uneven, "differs over the scene"),
    ):
        savemat(tmp_path / "a.mat", base | {"illuminant": left_out})
        with warns(f"the illuminant {why}", where=str(tmp_path / "a.mat")):
            assert open_cube(tmp_path / "a.mat").light is None


def test_what_is_written_is_what_iset_reads(tmp_path: Path) -> None:
    """SciPy reads the variables; the formula is vcReadImage.m's."""
    scene = Scene.from_radiance(CUBE * 1e15, GRID, tolerance=1e-6, distance_m=2.0, width_m=1.0, name="a scene")
    write_scene(scene, tmp_path / "a.mat")
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)
    photons = content["mcCOEF"] @ content["basis"]["basis"].T
    assert_allclose(photons, CUBE * 1e15, rtol=1e-5)
    assert_allclose(content["basis"]["wave"], GRID)
    assert content["dist"] == 2.0
    assert 2 * content["dist"] * math.tan(math.radians(content["fov"] / 2)) == pytest.approx(1.0)
    write_scene(scene, tmp_path / "b.mat", version="7.3")
    with h5py.File(tmp_path / "b.mat") as file:
        assert_allclose(file["photons"][()].transpose(2, 1, 0), CUBE * 1e15, rtol=1e-5)
        assert file["photons"].attrs["MATLAB_class"] == b"single"
    assert (tmp_path / "b.mat").read_bytes()[:10] == b"MATLAB 7.3"
    assert (tmp_path / "b.mat").read_bytes()[124:128] == b"\x00\x02IM"


def test_scenes_too_large_for_version_5(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matlab, "_LARGEST_BYTES", 100)
    scene = Scene.from_radiance(CUBE * 1e15, GRID)
    with pytest.raises(InputError) as caught:
        write_scene(scene, tmp_path / "a.mat")
    assert caught.value.arguments == {"version": "7.3"}
    with raises(InputError, "version", value="6"):
        write_scene(scene, tmp_path / "a.mat", version="6")


INVALID: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"rad": CUBE, "bands": GRID}, {}, "units"),
    ({"rad": CUBE}, UNITS, "wavelength"),
    ({"rad": CUBE, "bands": GRID[1:]}, UNITS, "wavelength"),
    ({"rad": CUBE, "bands": GRID[::-1]}, UNITS, "wavelength"),
    ({"rad": CUBE, "lambda": GRID * 10}, UNITS, "wavelength"),
    ({"rad": CUBE, "wavelength_nm": GRID / 1000}, UNITS, "wavelength"),
    ({"a": CUBE, "b": CUBE, "wave": GRID}, UNITS, "has 2 cubes: a (6, 5, 7), b"),
    ({"a": CUBE, "wave": GRID}, {"variable": "c"}, "has no cube 'c'"),
    ({"a": CUBE[:, :, 0], "wave": GRID}, UNITS, "has no cube"),
    ({"photons": CUBE[:, :, 0], "wave": GRID}, {}, "photons"),
    ({"photons": CUBE, "wave": GRID[1:]}, {}, "wavelength"),
    ({"photons": CUBE}, {}, "wavelength"),
    ({"photons": CUBE, "wave": GRID, "fov": 200.0, "dist": 1.0}, {}, "fov"),
    ({"photons": CUBE, "wave": GRID, "dist": -1.0}, {}, "dist"),
    ({"photons": -CUBE, "wave": GRID}, {}, "negative"),
    ({"photons": CUBE * np.nan, "wave": GRID}, {}, ""),
    ({"mcCOEF": CUBE}, {}, "without basis.basis"),
    ({"mcCOEF": CUBE, "basis/basis": np.ones((9, 3)), "basis/wave": GRID}, {}, "basis.basis"),
]


@pytest.mark.parametrize(
    ("version", "content", "options", "about"),
    [("7.3", *case) for case in INVALID] + [("5", *case) for case in INVALID[::4]],
)
def test_invalid_files(
    tmp_path: Path, version: str, content: dict[str, Any], options: dict[str, Any], about: str
) -> None:
    path = tmp_path / "a.mat"
    if version == "5":
        nested: dict[str, Any] = {}
        for name, value in content.items():
            place = nested
            *groups, last = name.split("/")
            for group in groups:
                place = place.setdefault(group, {})
            place[last] = value
        savemat(path, nested)
    else:
        save73(path, content)
    with pytest.raises(FileError) as caught:
        read_scene(path, **options)
    assert "\n" not in str(caught.value)
    assert caught.value.path == str(path)
    assert about in caught.value.what


@pytest.mark.parametrize("version", ["5", "7.3"])
@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.95])
def test_truncated_files(tmp_path: Path, version: str, fraction: float) -> None:
    path = tmp_path / "a.mat"
    content = {"wave": GRID, "photons": RNG.uniform(1, 2, (40, 30, 7))}
    if version == "5":
        savemat(path, content)
    else:
        save73(path, content, chunks=(7, 5, 6), compression="gzip")
    data = path.read_bytes()
    path.write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(FileError) as caught:
        read_scene(path)
    assert caught.value.path == str(path)
    assert "\n" not in str(caught.value)
