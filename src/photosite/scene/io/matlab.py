"""MATLAB files: cubes under any name, and the scene files of ISETCam and ISET3d.

ISET's files (ISETCam's sceneToFile.m, ieSaveMultiSpectralImage.m and vcReadImage.m) hold photons/s/sr/m2/nm, as

    photons (rows, cols, bands) with wave;
    mcCOEF (rows, cols, K), basis.basis (bands, K), basis.wave and, where the mean was removed, imgMean (bands,);
    negative results are set to 0, as in vcReadImage.m;
    scene, ISET's own structure, with scene.data.photons and scene.spectrum.wave;

with illuminant (data.photons, or data in energy in old files), fov (degrees, horizontal), dist (m) and name. In any
other file the cube is the variable of three axes, with its wavelengths beside it.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photosite.color.spectrum import photons_from_energy
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.hdf5 import SIGNATURE, Hdf5File, create_hdf5, open_hdf5, read_numbers
from photosite.files.mat import ArrayFile, load_mat
from photosite.files.writing import TemporaryFolder, atomic_path
from photosite.scene.cube import Array, Block, RawCube, SpectralCube, wavelengths_in_nm
from photosite.scene.io.hdf5 import MATLAB_AXES, UNIT_NAMES, WAVELENGTH_NAMES, choose_variable, cube_of_dataset
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units, file_units, override_units

_PHOTONS = Units("photon radiance")
_LARGEST_BYTES = 1 << 30
"""Bytes of one variable of version 5, which ends at 2 GiB and is built in memory."""
_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True, eq=False, kw_only=True)
class BasisCube(SpectralCube):
    """ISET's basis form: coefficients (rows, cols, K) times basis (bands, K) plus mean (bands,), not below 0."""

    coefficients: SpectralCube
    basis: Array
    mean: Array

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first, block in self.coefficients.blocks(rows):
            yield first, np.maximum(block @ self.basis.T + self.mean, 0.0)


def open_cube(path: Path, options: ReadOptions) -> SpectralCube:
    """Open the cube of a MATLAB file."""
    with _variables_of(path) as content:
        for prefix in ("", "scene."):
            data = f"{prefix}data." if prefix else ""
            if options.variable is None and f"{prefix}mcCOEF" in content.shapes:
                return _basis_form(content, options, prefix)
            if options.variable is None and f"{data}photons" in content.shapes:
                return _photon_form(content, options, prefix, f"{data}photons")
        return _any_cube(content, options)


def _photon_form(content: _Variables, options: ReadOptions, prefix: str, name: str) -> SpectralCube:
    _three_axes(content, name)
    keys = (f"{prefix}{key}" for key in ("wave", "spectrum.wave", "wavelength"))
    place = next((key for key in keys if key in content.shapes), None)
    values = None if place is None else content.numbers(place).ravel()
    grid = wavelengths_in_nm(content.path, values, None if values is None else "nm", options.wavelength_nm)
    return content.cube(name, _iset_units(content.path, options), grid, **_iset_head(content, prefix, grid))


def _basis_form(content: _Variables, options: ReadOptions, prefix: str) -> SpectralCube:
    path = content.path
    for name in ("basis.basis", "basis.wave"):
        if name not in content.shapes:
            raise FileError(path, f"has coefficients (mcCOEF) without {name}")
    basis, wave = content.numbers("basis.basis"), content.numbers("basis.wave").ravel()
    rows, cols, count = _three_axes(content, "mcCOEF")
    if basis.ndim != 2 or basis.shape != (wave.size, count):
        raise FileError(path, "basis.basis", value=basis.shape, expected=f"({wave.size}, {count}): wavelengths, mcCOEF")
    mean = content.numbers("imgMean").ravel() if "imgMean" in content.shapes else np.zeros(0)
    if mean.size not in (0, wave.size):
        raise FileError(path, "imgMean", value=f"{mean.size} values", expected=f"{wave.size} values, one a wavelength")
    grid = wavelengths_in_nm(path, wave, "nm", options.wavelength_nm)
    units = _iset_units(path, options)
    return BasisCube(
        name=str(path),
        shape=(rows, cols, wave.size),
        wavelength_nm=grid,
        quantity=units.quantity,
        coefficients=content.cube("mcCOEF", _PHOTONS, np.arange(1.0, count + 1)),
        basis=basis * units.scale,
        mean=(mean if mean.size else np.zeros(wave.size)) * units.scale,
        **_iset_head(content, prefix, grid),
    )


def _iset_units(path: Path, options: ReadOptions) -> Units:
    return _PHOTONS if options.units is None else override_units(path, options.units, "photons", _PHOTONS)


def _three_axes(content: _Variables, name: str) -> tuple[int, int, int]:
    shape = content.shapes[name]
    if len(shape) != 3 or 0 in shape:  # MATLAB drops a last axis of one band
        raise FileError(content.path, name, value=shape, expected="(rows, columns, bands), two bands or more")
    return shape[0], shape[1], shape[2]


def _iset_head(content: _Variables, prefix: str, grid: Array) -> dict[str, Any]:
    distance = _positive(content, f"{prefix}{'distance' if prefix else 'dist'}")
    name = f"{prefix}{'wAngular' if prefix else 'fov'}"
    fov = _positive(content, name)
    width = None
    if fov is not None and distance is not None:
        if fov >= 180:
            raise FileError(content.path, name, value=fov, expected="below 180 degrees")
        width = 2 * distance * math.tan(math.radians(fov) / 2)
    return {
        "light": _iset_light(content, prefix, grid),
        "distance_m": distance,
        "width_m": width,
        "title": content.text(f"{prefix}name"),
    }


def _positive(content: _Variables, name: str) -> float | None:
    if name not in content.shapes or math.prod(content.shapes[name]) == 0:
        return None
    value = content.numbers(name).ravel()
    if value.size != 1 or not np.isfinite(value[0]) or value[0] <= 0:
        raise FileError(content.path, name, value=value, expected="one number above 0")
    return float(value[0])


def _iset_light(content: _Variables, prefix: str, grid: Array) -> Array | None:
    """Return the illuminant in photons at the scene's wavelengths; None where it is missing or unusable.

    ISET's illuminant is the light from a perfect white, on the scale of the scene's photons.
    """
    path, base = content.path, f"{prefix}illuminant."
    name = next((f"{base}{key}" for key in ("data.photons", "data") if f"{base}{key}" in content.shapes), None)
    if name is None:
        return None
    if len(content.shapes[name]) > 2:
        return _ignored_light(path, "differs over the scene")
    # Old files stored photons as integers between a minimum and a maximum, and energy under the name of photons.
    if name.endswith("photons"):
        if f"{base}data.min" in content.shapes:
            return _ignored_light(path, "is packed between a minimum and a maximum")
        if content.text(f"{base}type") is None:
            return _ignored_light(path, "has no type, so that its photons may be energy")
    keys = (f"{base}{key}" for key in ("spectrum.wave", "wavelength", "wave"))
    place = next((key for key in keys if key in content.shapes), None)
    values = content.numbers(name).ravel()
    wave = grid if place is None else content.numbers(place).ravel()
    if values.size != wave.size or not np.isfinite(values).all() or values.min() < 0:
        raise FileError(path, name, value=values, expected=f"{wave.size} values of 0 or more, one a wavelength")
    if (np.diff(wave) <= 0).any() or wave[0] > grid.min() or wave[-1] < grid.max():
        return _ignored_light(path, "does not cover the scene's wavelengths in increasing order")
    photons = values if name.endswith("photons") else photons_from_energy(values, wave)
    return np.interp(grid, wave, photons)


def _ignored_light(path: Path, why: str) -> Array | None:
    what = f"the illuminant {why}; it is ignored, and the scene's light cannot be changed"
    warnings.warn(PhotositeWarning(what, where=str(path)), stacklevel=2)
    return None


def _any_cube(content: _Variables, options: ReadOptions) -> SpectralCube:
    path = content.path
    name = choose_variable(path, content.shapes, options.variable)
    texts = {key: content.text(key) for key in (*UNIT_NAMES, "wavelength_units", "wavelength_unit")}
    units = file_units(path, options, next((texts[key] for key in UNIT_NAMES if texts[key] is not None), None))
    low = {key.rpartition(".")[2].lower(): key for key in content.shapes if key != name}
    values, unit = None, texts["wavelength_units"] or texts["wavelength_unit"]
    for wanted in WAVELENGTH_NAMES:
        if wanted in low and math.prod(content.shapes[low[wanted]]) == content.shapes[name][2]:
            values, unit = content.numbers(low[wanted]).ravel(), "nm" if wanted.endswith("_nm") else unit
            break
    return content.cube(name, units, wavelengths_in_nm(path, values, unit, options.wavelength_nm))


@contextmanager
def _variables_of(path: Path) -> Iterator[_Variables]:
    with path.open("rb") as file:
        head = file.read(10)
    if head == b"MATLAB 7.3" or head.startswith(SIGNATURE):
        with open_hdf5(path) as opened:
            yield _Version73(opened)
        return
    folder = TemporaryFolder()
    try:
        yield _Version5(path, load_mat(path, folder.path), folder)
    except BaseException:
        folder.close()
        raise


class _Version5:
    """The variables of versions 4 to 7.2, and the shapes of numeric ones; parts of structures have dotted names."""

    def __init__(self, path: Path, content: dict[str, Any], folder: TemporaryFolder) -> None:
        self.path, self._folder = path, folder
        self._values = dict(_flat("", content))
        self.shapes: dict[str, tuple[int, ...]] = {
            name: value.shape
            for name, value in self._values.items()
            if isinstance(value, ArrayFile) or (isinstance(value, np.ndarray) and value.dtype.kind in "fiu")
        }

    def numbers(self, name: str) -> Array:
        value = self._values[name]
        if not isinstance(value, np.ndarray):
            raise FileError(self.path, f"variable '{name}'", value=value.shape, expected="a list of numbers")
        return np.asarray(value, np.float64)

    def text(self, name: str) -> str | None:
        value = self._values.get(name)
        return value if isinstance(value, str) else None

    def cube(self, name: str, units: Units, wavelength_nm: Array, **head: Any) -> SpectralCube:
        value = self._values[name]
        return RawCube(
            name=str(self.path),
            shape=value.shape,
            wavelength_nm=wavelength_nm,
            quantity=units.quantity,
            path=value.path,
            dtype=value.dtype,
            scale=units.scale,
            keep=self._folder,
            **head,
        )


def _flat(prefix: str, content: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _flat(f"{prefix}{name}.", value)
        else:
            yield f"{prefix}{name}", value


class _Version73:
    """The variables of HDF5, in which MATLAB stores an array's first axis last."""

    def __init__(self, file: Hdf5File) -> None:
        self.path, self._file = file.path, file
        self._data = {name.replace("/", "."): data for name, data in file.datasets.items() if not name.startswith("#")}
        self.shapes: dict[str, tuple[int, ...]] = {
            name: data.shape[::-1]
            for name, data in self._data.items()
            if data.dtype.kind in "fiu" and not self._is_text(data)
        }

    def numbers(self, name: str) -> Array:
        return read_numbers(self.path, self._data[name]).T

    def text(self, name: str) -> str | None:
        data = self._data.get(name)
        if data is None or not self._is_text(data) or math.prod(data.shape) > 1000:
            return None
        return "".join(chr(int(code)) for code in read_numbers(self.path, data).T.ravel() if 0 < code < 0xD800)

    def cube(self, name: str, units: Units, wavelength_nm: Array, **head: Any) -> SpectralCube:
        head |= {"quantity": units.quantity, "scale": units.scale, "wavelength_nm": wavelength_nm}
        return cube_of_dataset(self.path, name.replace(".", "/"), self._data[name], MATLAB_AXES, **head)

    def _is_text(self, data: Any) -> bool:
        return bool(self._file.attributes(data).get("MATLAB_class") == "char")


_Variables = _Version5 | _Version73


def write(scene: Scene, path: Path, *, version: str = "5") -> None:
    """Write ISET's scene file: the basis form in MATLAB's version 5, photons of every sample in version 7.3."""
    writers = {"5": _write_basis_form, "7.3": _write_photon_form}
    if version not in writers:
        raise InputError("version", value=version, expected="'5' or '7.3' for MATLAB files")
    writers[version](scene, path)


def _write_basis_form(scene: Scene, path: Path) -> None:
    """Write mcCOEF and basis as ISETCam's ieSaveMultiSpectralImage.m does, without loss."""
    from scipy.io import savemat

    if scene.weights.nbytes > _LARGEST_BYTES:
        raise InputError(
            f"the scene's weights take {scene.weights.nbytes / 1e9:.1f} GB, too much for MATLAB's version 5",
            hint="Pass {version}, or write photosite's own .h5",
            arguments={"version": "7.3"},
        )
    content: dict[str, Any] = {
        "mcCOEF": np.moveaxis(scene.weights, 0, 2),
        "basis": {"basis": scene.basis.T, "wave": scene.wavelength_nm[:, None]},
        "comment": "written by photosite",
        **_about(scene),
    }
    if scene.reflectance is not None:
        spectrum = {"data": {"photons": scene.light()[:, None]}, "spectrum": {"wave": scene.wavelength_nm[:, None]}}
        content["illuminant"] = {"type": "illuminant", "name": scene.name, **spectrum}
    with atomic_path(path) as temporary:
        savemat(temporary, content, appendmat=False, do_compression=True)


def _about(scene: Scene) -> dict[str, Any]:
    about: dict[str, Any] = {"dist": scene.distance_m, "name": scene.name}
    if scene.width_m is not None:
        about["fov"] = math.degrees(2 * math.atan(scene.width_m / 2 / scene.distance_m))
    return about


def _write_photon_form(scene: Scene, path: Path) -> None:
    """Write photons and wave in single precision, block by block: HDF5 behind 512 bytes, first axes last."""
    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    step = max(1, min(rows, _CHUNK_BYTES // (4 * cols * bands)))
    with atomic_path(path) as temporary:
        with create_hdf5(temporary, userblock_size=512) as file:
            data = file.create_dataset("photons", (bands, cols, rows), "<f4", chunks=(bands, cols, step))
            data.attrs["MATLAB_class"] = np.bytes_(b"single")
            for first, block in cube.blocks(step):
                data[:, :, first : first + len(block)] = block.transpose(2, 1, 0).astype(np.float32)
            _put(file, "wave", scene.wavelength_nm[None, :])
            for name, value in _about(scene).items():
                _put(file, name, value)
            if cube.light is not None:
                _put(file, "illuminant/type", "illuminant")
                _put(file, "illuminant/data/photons", cube.light[None, :])
                _put(file, "illuminant/spectrum/wave", scene.wavelength_nm[None, :])
        with temporary.open("r+b") as raw:
            head = f"MATLAB 7.3 MAT-file, Platform: photosite, Created on: {time.asctime()} HDF5 schema 1.00 ."
            raw.write(head.encode().ljust(116) + bytes(8) + b"\x00\x02IM")


def _put(file: Any, name: str, value: Any) -> None:
    if isinstance(value, str):
        codes = np.array([[ord(letter) for letter in value]], np.uint16).T if value else np.zeros((1, 1), np.uint16)
        data, kind = file.create_dataset(name, data=codes), b"char"
        data.attrs["MATLAB_int_decode"] = np.int32(2)
    else:
        data, kind = file.create_dataset(name, data=np.atleast_2d(np.asarray(value, np.float64))), b"double"
    data.attrs["MATLAB_class"] = np.bytes_(kind)
