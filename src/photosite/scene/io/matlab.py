"""MATLAB files: cubes under any name, and the scene files of ISETCam and ISET3d.

ISET's files (ISETCam's sceneToFile.m, ieSaveMultiSpectralImage.m and vcReadImage.m) hold photons/s/sr/m2/nm, as

    photons (rows, cols, bands) with wave;
    mcCOEF (rows, cols, K), basis.basis (bands, K), basis.wave and, where the mean was taken off, imgMean (bands,); what
    these make below 0 is 0, as vcReadImage.m has it;
    scene, ISET's own structure, with scene.data.photons and scene.spectrum.wave;

with illuminant (data.photons, or data in energy in old files), fov (degrees, horizontal), dist (m) and name. In any
other file the cube is the variable of three axes, and its wavelengths stand beside it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photosite.color.spectrum import photons_from_energy
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.scene.bands import wavelengths_in_nm
from photosite.scene.cube import Array, Block, CubeHead, SpectralCube
from photosite.scene.io.hdf5_cube import UNIT_NAMES, WAVELENGTH_NAMES, chosen, said_units, stated_units
from photosite.scene.io.iset_write import write_basis_form, write_photons_form
from photosite.scene.io.matlab_file import Variables, variables_of
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.units import Units

_PHOTONS = Units("photon radiance")


@dataclass(frozen=True, eq=False, kw_only=True)
class BasisCube(CubeHead):
    """ISET's basis form: coefficients (rows, cols, K) of spectra, with a mean spectrum; nothing below 0.

    Parameters
    ----------
    coefficients
        Their cube.
    basis
        (bands, K).
    mean
        (bands,).
    """

    coefficients: SpectralCube
    basis: Array
    mean: Array

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first, block in self.coefficients.blocks(rows):
            yield first, np.maximum(block @ self.basis.T + self.mean, 0.0)


def open_cube(path: Path, said: ReadOptions) -> SpectralCube:
    """The cube of a MATLAB file.

    Raises
    ------
    FileError
        If it has none, or does not say what is needed.
    """
    with variables_of(path) as content:
        shapes = content.shapes()
        for before in ("", "scene."):
            data = f"{before}data." if before else ""
            if said.variable is None and f"{before}mcCOEF" in shapes:
                return _basis_form(path, content, shapes, said, before)
            if said.variable is None and f"{data}photons" in shapes:
                return _photon_form(path, content, shapes, said, before, f"{data}photons")
        return _any_cube(path, content, shapes, said)


def _photon_form(
    path: Path, content: Variables, shapes: dict[str, tuple[int, ...]], said: ReadOptions, before: str, name: str
) -> SpectralCube:
    shape = _three(path, name, shapes[name])
    place = next(
        (f"{before}{key}" for key in ("wave", "spectrum.wave", "wavelength") if f"{before}{key}" in shapes), None
    )
    values = None if place is None else content.numbers(place).ravel()
    grid = wavelengths_in_nm(path, values, None if values is None else "nm", said.wavelength_nm)
    units = _iset_units(path, said)
    return content.cube(name, units, grid, **_iset_head(path, content, shapes, before, grid, shape))


def _basis_form(
    path: Path, content: Variables, shapes: dict[str, tuple[int, ...]], said: ReadOptions, before: str
) -> SpectralCube:
    for name in ("basis.basis", "basis.wave"):
        if name not in shapes:
            raise FileError(path, f"has coefficients (mcCOEF) without {name}; it cannot be understood without")
    basis, wave = content.numbers("basis.basis"), content.numbers("basis.wave").ravel()
    rows, cols, count = _three(path, "mcCOEF", shapes["mcCOEF"])
    if basis.ndim != 2 or basis.shape != (wave.size, count):
        raise FileError(
            path, f"has {count} coefficients and a basis {basis.shape} for {wave.size} wavelengths: they do not fit"
        )
    mean = content.numbers("imgMean").ravel() if "imgMean" in shapes else np.zeros(0)
    if mean.size not in (0, wave.size):
        raise FileError(path, f"has a mean (imgMean) of {mean.size} values for {wave.size} wavelengths")
    grid = wavelengths_in_nm(path, wave, "nm", said.wavelength_nm)
    units = _iset_units(path, said)
    return BasisCube(
        name=str(path),
        shape=(rows, cols, wave.size),
        wavelength_nm=grid,
        quantity=units.quantity,
        coefficients=content.cube("mcCOEF", _PHOTONS, np.arange(1.0, count + 1)),
        basis=basis * units.scale,
        mean=(mean if mean.size else np.zeros(wave.size)) * units.scale,
        **_iset_head(path, content, shapes, before, grid, (rows, cols, wave.size)),
    )


def _iset_units(path: Path, said: ReadOptions) -> Units:
    """ISET's are photons; a caller who knows better may say so."""
    return _PHOTONS if said.units is None else said_units(path, said.units, "photons", _PHOTONS)


def _three(path: Path, name: str, shape: tuple[int, ...]) -> tuple[int, int, int]:
    if len(shape) == 2:  # MATLAB drops a last axis of one
        raise FileError(path, f"its {name} {shape} has one band only; a spectral image has several")
    if len(shape) != 3 or 0 in shape:
        raise FileError(path, f"its {name} is {shape}, not (rows, columns, bands)")
    return shape[0], shape[1], shape[2]


def _iset_head(
    path: Path,
    content: Variables,
    shapes: dict[str, tuple[int, ...]],
    before: str,
    grid: Array,
    shape: tuple[int, int, int],
) -> dict[str, Any]:
    distance = _one(path, content, shapes, f"{before}{'distance' if before else 'dist'}")
    fov = _one(path, content, shapes, f"{before}{'wAngular' if before else 'fov'}")
    width = None
    if fov is not None and distance is not None:
        if fov >= 180:
            raise FileError(path, f"has a field of view of {fov:g} degrees; it is below 180")
        width = 2 * distance * math.tan(math.radians(fov) / 2)
    return {
        "light": _iset_light(path, content, shapes, before, grid),
        "distance_m": distance,
        "width_m": width,
        "title": content.text(f"{before}name"),
    }


def _one(path: Path, content: Variables, shapes: dict[str, tuple[int, ...]], name: str) -> float | None:
    if name not in shapes or math.prod(shapes[name]) == 0:
        return None
    value = content.numbers(name).ravel()
    if value.size != 1 or not np.isfinite(value[0]) or value[0] <= 0:
        raise FileError(path, f"its {name} is not one number above 0")
    return float(value[0])


def _iset_light(
    path: Path, content: Variables, shapes: dict[str, tuple[int, ...]], before: str, grid: Array
) -> Array | None:
    """The illuminant in photons on the scene's wavelengths; None where there is none, or, with a warning, it is no use.

    ISET's illuminant is the light that a perfect white sends out, on the scale of its photons.
    """
    base = f"{before}illuminant."
    name = next((f"{base}{key}" for key in ("data.photons", "data") if f"{base}{key}" in shapes), None)
    if name is None:
        return None
    if len(shapes[name]) > 2:
        return _left_out(path, "differs over the scene")
    # Old files kept photons as integers between a minimum and a maximum, and energy under the name of photons.
    if name.endswith("photons"):
        if f"{base}data.min" in shapes:
            return _left_out(path, "is packed between a minimum and a maximum")
        if content.text(f"{base}type") is None:
            return _left_out(path, "has no type, and such files kept energy under the name of photons too")
    place = next((f"{base}{key}" for key in ("spectrum.wave", "wavelength", "wave") if f"{base}{key}" in shapes), None)
    values = content.numbers(name).ravel()
    wave = grid if place is None else content.numbers(place).ravel()
    if values.size != wave.size or not np.isfinite(values).all() or values.min() < 0:
        raise FileError(path, f"its illuminant has {values.size} values for {wave.size} wavelengths, or negative ones")
    if (np.diff(wave) <= 0).any() or wave[0] > grid.min() or wave[-1] < grid.max():
        return _left_out(path, "does not have all of the scene's wavelengths, in order")
    photons = values if name.endswith("photons") else photons_from_energy(values, wave)
    return np.interp(grid, wave, photons)


def _left_out(path: Path, why: str) -> Array | None:
    """No light, although the file has one; and that is said."""
    warnings.warn(
        PhotositeWarning(f"{path}: its illuminant {why}; it is left out, and the scene's light cannot be changed"),
        stacklevel=2,
    )
    return None


def _any_cube(path: Path, content: Variables, shapes: dict[str, tuple[int, ...]], said: ReadOptions) -> SpectralCube:
    name = chosen(path, shapes, said.variable)
    texts = {key: content.text(key) for key in (*UNIT_NAMES, "wavelength_units", "wavelength_unit")}
    units = stated_units(path, said, next((texts[key] for key in UNIT_NAMES if texts[key] is not None), None))
    low = {key.rpartition(".")[2].lower(): key for key in shapes if key != name}
    values, unit = None, texts["wavelength_units"] or texts["wavelength_unit"]
    for wanted in WAVELENGTH_NAMES:
        if wanted in low and math.prod(shapes[low[wanted]]) == shapes[name][2]:
            values, unit = content.numbers(low[wanted]).ravel(), "nm" if wanted.endswith("_nm") else unit
            break
    grid = wavelengths_in_nm(path, values, unit, said.wavelength_nm)
    return content.cube(name, units, grid)


def write(scene: Scene, path: Path, *, version: str = "5") -> None:
    """ISET's scene file: the basis form in MATLAB's version 5, photons of every sample in version 7.3.

    Raises
    ------
    FileError
        If it cannot be written.
    InputError
        If there is no such version, or the scene's weights are larger than version 5 holds.
    """
    writers = {"5": write_basis_form, "7.3": write_photons_form}
    if version not in writers:
        raise InputError(f"MATLAB files are written in version '5' or '7.3', not '{version}'")
    writers[version](scene, path)
