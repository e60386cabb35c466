"""Cubes in HDF5 files: plain datasets, and the variables of MATLAB 7.3."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.atomic import atomic_path
from photosite.scene.bands import wavelengths_in_nm
from photosite.scene.cube import Array, Block, CubeHead, Interleave, RawCube, SpectralCube
from photosite.scene.io.hdf5_file import check_written, numbers, opened, plain
from photosite.scene.io.spool import Piece, spooled
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units, parse_units

WAVELENGTH_NAMES = (
    *("wavelength_nm", "wavelengths_nm", "wave_nm", "wavelength", "wavelengths", "wave", "waves", "wvl", "wl"),
    *("lambda", "lambda_nm", "wavelen", "bands"),
)
"""Under which files keep the wavelengths of their bands, lower case."""
UNIT_NAMES = ("units", "unit", "radiance_units", "data_units")

_AXES: dict[Interleave, tuple[int, int, int]] = {"bip": (0, 1, 2), "bsq": (1, 2, 0), "bil": (0, 2, 1)}
"""Which axis of the dataset holds rows, columns and bands."""
MATLAB_AXES = (2, 1, 0)
_SLAB_BYTES = 64 << 20


@dataclass(frozen=True, eq=False, kw_only=True)
class ChunkedCube(CubeHead):
    """A cube in a chunked dataset, read in slabs of whole chunks of rows.

    Parameters
    ----------
    path, variable
        File and dataset.
    axes
        Which axes hold rows, columns and bands.
    slab_rows
        Rows that are read together.
    scale, no_data
        As for `RawCube`.
    """

    path: Path
    variable: str
    axes: tuple[int, int, int]
    slab_rows: int
    scale: float | Array = 1.0
    no_data: float | None = None

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        with opened(self.path) as (_, datasets):
            data = datasets[self.variable]
            for first in range(0, self.shape[0], self.slab_rows):
                raw = _slab(data, self.axes, slice(first, first + self.slab_rows), slice(None))
                with np.errstate(over="ignore"):  # what becomes infinite is refused where it is looked at
                    slab = np.multiply(raw, np.asarray(self.scale, np.float64), dtype=np.float64)
                if self.no_data is not None:
                    slab[raw == self.no_data] = np.nan
                for start in range(0, len(slab), rows):
                    yield first + start, slab[start : start + rows]


def _slab(data: Any, axes: tuple[int, int, int], rows: slice, bands: slice) -> NDArray[Any]:
    """(rows, cols, bands) of a dataset."""
    where: list[slice] = [slice(None)] * 3
    where[axes[0]], where[axes[2]] = rows, bands
    return np.asarray(data[tuple(where)]).transpose(axes)


def cube_in(path: Path, file: Any, datasets: dict[str, Any], said: ReadOptions) -> SpectralCube:
    """The cube of a plain HDF5 file; see `photosite.scene.io.hdf5` for what it may say.

    Raises
    ------
    FileError
        If there is none, or several and none is chosen, or what is said of it cannot be.
    """
    name = chosen(path, {key: item.shape for key, item in datasets.items() if item.dtype.kind in "fiu"}, said.variable)
    data = datasets[name]
    said_here = _attributes(data)
    beside = {key.rpartition("/")[2].lower(): item for key, item in datasets.items() if item.ndim <= 2}
    lists = _lists(path, said_here, beside)
    axes = _axes(path, data.shape, said.interleave or said_here.get("interleave"), lists, said)
    return cube_of_dataset(
        path,
        name,
        data,
        axes,
        units=stated_units(path, said, next((said_here[key] for key in UNIT_NAMES if key in said_here), None)),
        wavelength_nm=_wavelengths(path, said_here, beside, lists, said, data.shape[axes[2]]),
        said_here=said_here,
        light=_listed(path, "light", said_here, beside),
    )


def chosen(path: Path, shapes: dict[str, tuple[int, ...]], wanted: str | None) -> str:
    """The name of the variable that is the cube: the one wanted, or the only one of three axes.

    Raises
    ------
    FileError
        If there is none of that name, or not just one.
    """
    cubes = [name for name, shape in shapes.items() if len(shape) == 3 and min(shape) > 0]
    listed = ", ".join(f"{name} {shapes[name]}" for name in cubes[:8]) or "none"
    if wanted is not None:
        found = wanted.strip("/")
        if found not in cubes:
            raise FileError(path, f"has no cube '{wanted}' (rows, columns, bands); it has {listed}")
        return found
    if len(cubes) != 1:
        mend = "say which (variable='...')" if cubes else "a cube has three axes: rows, columns, bands"
        raise FileError(path, f"holds {len(cubes) or 'no'} cubes: {listed}; {mend}")
    return cubes[0]


def stated_units(path: Path, said: ReadOptions, stated: Any) -> Units:
    """The units of the values: what the caller says, else what the file does.

    Raises
    ------
    FileError
        If neither says them, or the file's are unknown.
    """
    if said.units is not None:
        return said_units(path, said.units, stated)
    if stated is None:
        raise FileError(
            path,
            "does not state the units of its values",
            hint="Pass {units}, 'photons/s/sr/m2/nm', 'reflectance' or 'relative'",
            arguments={"units": "W/sr/m2/nm"},
        )
    try:
        return parse_units(str(stated)[:80])
    except InputError as error:
        raise FileError(path, f"{error} (say units='...' to overrule the file)") from None


def said_units(path: Path, said: str, stated: Any, own: Units | None = None) -> Units:
    """The units that the caller says, with a warning where a file says others.

    Parameters
    ----------
    path
        The file.
    said
        By the caller.
    stated
        By the file, for the warning too; None where it says none.
    own
        What that means, where its text alone does not tell.

    Raises
    ------
    InputError
        If the caller's are not understood.
    """
    units = parse_units(said)
    if own is None:
        try:
            own = None if stated is None else parse_units(str(stated)[:80])
        except InputError:  # what is not understood cannot contradict
            own = None
    if own is not None and (own.quantity != units.quantity or not math.isclose(own.scale, units.scale, rel_tol=1e-9)):
        warnings.warn(
            PhotositeWarning(
                f"{path}: the file says '{stated!s:.40}', and units='{said}' was said; what was said is taken"
            ),
            stacklevel=2,
        )
    return units


def cube_of_dataset(
    path: Path,
    name: str,
    data: Any,
    axes: tuple[int, int, int],
    *,
    units: Units,
    wavelength_nm: Array,
    said_here: dict[str, Any],
    light: Array | None = None,
    title: str | None = None,
) -> SpectralCube:
    """A dataset as a cube: its numbers where they lie, in slabs of chunks, or laid out anew if rows are scattered."""
    check_written(path, data)
    rows, cols, bands = (data.shape[axis] for axis in axes)
    head: dict[str, Any] = {
        "name": str(path),
        "shape": (rows, cols, bands),
        "wavelength_nm": wavelength_nm,
        "quantity": units.quantity,
        "light": light,
        "title": title,
        "distance_m": _positive(path, said_here, "distance_m"),
        "width_m": _positive(path, said_here, "width_m"),
        "scale": units.scale * (_positive(path, said_here, "scale") or 1.0),
        "no_data": _number(path, said_here, "no_data"),
    }
    interleave = next((kind for kind, where in _AXES.items() if where == axes), None)
    if data.chunks is None and interleave is not None and data.id.get_offset() is not None:
        return RawCube(path=path, dtype=data.dtype, interleave=interleave, offset=data.id.get_offset(), **head)
    slab = _SLAB_BYTES // (8 * cols * bands)
    step = 1 if data.chunks is None else data.chunks[axes[0]]
    if data.chunks is not None and step <= slab:
        return ChunkedCube(path=path, variable=name, axes=axes, slab_rows=slab // step * step, **head)
    copy, folder = spooled(path, _pieces(data, axes), (rows, cols, bands), data.dtype.newbyteorder("="))
    return RawCube(path=copy, dtype=data.dtype.newbyteorder("="), interleave="bsq", keep=folder, **head)


def _pieces(data: Any, axes: tuple[int, int, int]) -> Iterator[Piece]:
    """The dataset by whole chunks of rows and bands; by bands where it lies in one piece."""
    rows, _, bands = (data.shape[axis] for axis in axes)
    high, deep = (rows, 1) if data.chunks is None else (data.chunks[axes[0]], data.chunks[axes[2]])
    for band in range(0, bands, deep):
        for row in range(0, rows, high):
            part = _slab(data, axes, slice(row, row + high), slice(band, band + deep))
            yield band, row, np.moveaxis(part, 2, 0)


def _attributes(item: Any) -> dict[str, Any]:
    """The attributes of a dataset, those of the groups above it filling the gaps; names in lower case."""
    found: dict[str, Any] = {}
    while True:
        for name, value in item.attrs.items():
            found.setdefault(name.lower(), plain(value))
        if item.name == "/":
            return found
        item = item.parent


def _listed(path: Path, name: str, said_here: dict[str, Any], beside: dict[str, Any]) -> Array | None:
    if name in said_here:
        try:
            return np.atleast_1d(np.asarray(said_here[name], np.float64)).ravel()
        except (TypeError, ValueError):
            raise FileError(path, f"its attribute '{name}' is no list of numbers") from None
    return numbers(path, beside[name]).ravel() if name in beside else None


def _lists(path: Path, said_here: dict[str, Any], beside: dict[str, Any]) -> dict[str, Array]:
    """What may be the wavelengths, by name; a lone number is a count of bands or the wavelength of a single one."""
    found: dict[str, Array] = {}
    for name in WAVELENGTH_NAMES:
        try:
            values = _listed(path, name, said_here, beside)
        except FileError:
            if not found:
                raise
            continue  # "bands" may name them
        if values is not None:
            found[name] = values
    return found


def _axes(
    path: Path, shape: tuple[int, ...], stated: object, lists: dict[str, Array], said: ReadOptions
) -> tuple[int, int, int]:
    """Which axes hold rows, columns and bands: as stated, else these three if the wavelengths do not speak against."""
    if stated is not None:
        axes = next((axes for kind, axes in _AXES.items() if kind == str(stated).lower()), None)
        if axes is None:
            raise FileError(path, f"says interleave '{stated!s:.20}'; known are bip, bsq, bil")
        return axes
    counts = {values.size for values in lists.values()} - {1}
    if said.wavelength_nm is not None:
        counts = {np.size(said.wavelength_nm)}
    fits = [axis for axis, size in enumerate(shape) if size in counts]
    if fits and fits != [2]:
        where = "more than one axis" if len(fits) > 1 else f"its {('first', 'second')[fits[0]]} axis"
        raise FileError(
            path,
            f"has a cube of {shape}, and {shape[fits[0]]} wavelengths fit {where}",
            hint="Pass {interleave} (rows, columns, bands), 'bsq' (bands first) or 'bil' (bands second)",
            arguments={"interleave": "bip"},
        )
    return _AXES["bip"]


def _wavelengths(
    path: Path,
    said_here: dict[str, Any],
    beside: dict[str, Any],
    lists: dict[str, Array],
    said: ReadOptions,
    bands: int,
) -> Array:
    unit = next((said_here[key] for key in ("wavelength_units", "wavelength_unit") if key in said_here), None)
    for name, values in lists.items():
        if values.size == bands:
            if unit is None and name in beside:
                own = {key.lower(): plain(value) for key, value in beside[name].attrs.items()}
                unit = own.get("units", own.get("unit"))
            known = "nm" if name.endswith("_nm") else None if unit is None else str(unit)
            return wavelengths_in_nm(path, values, known, said.wavelength_nm)
    for name, values in lists.items():
        if values.size > 1:
            misfit = f"its '{name}' has {values.size} entries for {bands} bands"
            if said.wavelength_nm is None:
                raise FileError(path, f"{misfit}; give the wavelengths in nm (wavelength_nm=[...])")
            warnings.warn(PhotositeWarning(f"{path}: {misfit}, and is left out"), stacklevel=2)
    return wavelengths_in_nm(path, None, None, said.wavelength_nm)


def _number(path: Path, said_here: dict[str, Any], name: str) -> float | None:
    value = said_here.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise FileError(path, f"its {name} is {value!r:.40}, not a number")
    return float(value)


def _positive(path: Path, said_here: dict[str, Any], name: str) -> float | None:
    value = _number(path, said_here, name)
    if value is not None and value <= 0:
        raise FileError(path, f"its {name} is {value:g}, not above 0")
    return value


def write_cube(scene: Scene, path: Path) -> None:
    """The scene's radiance at every sample as a plain HDF5 cube, in single precision and chunks of rows.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    import h5py

    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    step = max(1, min(rows, _SLAB_BYTES // (8 * cols * bands), (1 << 20) // (4 * cols * bands)))
    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        data = file.create_dataset("radiance", cube.shape, "<f4", chunks=(step, cols, bands))
        for first, block in cube.blocks(step):
            data[first : first + len(block)] = block.astype(np.float32)
        data.attrs["units"] = np.bytes_("photons/s/sr/m2/nm")
        data.attrs["interleave"] = np.bytes_("bip")
        data.attrs["wavelength_nm"] = cube.wavelength_nm
        data.attrs["distance_m"] = scene.distance_m
        if scene.width_m is not None:
            data.attrs["width_m"] = scene.width_m
        if cube.light is not None:
            data.attrs["light"] = cube.light
