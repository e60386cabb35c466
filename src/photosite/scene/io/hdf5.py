"""HDF5: photosite's own scene files, and cubes in datasets.

photosite's own file, version 1. The weights are contiguous, so that they are mapped and never loaded. Text has fixed
length, in UTF-8:

    /                 attributes photosite_scene = 1, name, distance_m, width_m (where known), relative_error, units,
                      patches = 1 (a chart whose luminance is that of its regions)
    /weights          (K, rows, cols) float32, little endian, contiguous
    /basis            (K, wavelengths) photons/s/sr/m2/nm
    /wavelength_nm    (wavelengths,)
    /reflectance      (K, wavelengths), where known
    /polarization     (2,) or (2, rows, cols) degree and angle in degrees, where the light is polarized
    /regions          (n, 4) first row, last row + 1, first column, last column + 1; attribute names; where any

A cube is a dataset of three axes. Attributes of the dataset, of a group above it or of the file (in this order), or
datasets beside it, describe it:

    wavelength_nm       (bands,), or wavelength / wavelengths / wave / bands with wavelength_units
    units               of the values; see `photosite.scene.units`
    interleave          "bip" (rows, cols, bands), "bsq" (bands, rows, cols), "bil" (rows, bands, cols). Default "bip";
                        required where the number of wavelengths fits another axis
    scale               factor from values to these units
    no_data             value of missing data
    distance_m, width_m of the scene
    light               (bands,) photons/s/sr/m2/nm from a perfect white
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.hdf5 import Hdf5File, check_stored, create_hdf5, open_hdf5, plain, read_numbers
from photosite.files.writing import Piece, atomic_path, write_bands
from photosite.scene.cube import Array, Block, Interleave, RawCube, SpectralCube, Stated, wavelengths_in_nm
from photosite.scene.options import ReadOptions
from photosite.scene.polarization import Polarization
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import Reduction, apply_options, cube_of_scene
from photosite.scene.units import file_units
from photosite.scene.weights import MappedWeights, WeightStore, all_finite
from photosite.values.region import Region

VERSION_KEY = "photosite_scene"
UNITS = "photons/s/sr/m2/nm"

WAVELENGTH_NAMES = (
    *("wavelength_nm", "wavelengths_nm", "wave_nm", "wavelength", "wavelengths", "wave", "waves", "wvl", "wl"),
    *("lambda", "lambda_nm", "wavelen", "bands"),
)
"""Names of the list of wavelengths in files, lower case."""
UNIT_NAMES = ("units", "unit", "radiance_units", "data_units")
MATLAB_AXES = (2, 1, 0)

_AXES: dict[Interleave, tuple[int, int, int]] = {"bip": (0, 1, 2), "bsq": (1, 2, 0), "bil": (0, 2, 1)}
"""Which axes of the dataset hold rows, columns and bands."""
_BLOCK_BYTES = 32 << 20
_SLAB_BYTES = 64 << 20


def open_cube(path: Path, options: ReadOptions) -> SpectralCube | Scene:
    """Open the cube of an HDF5 file, or read the scene of photosite's own.

    Raises
    ------
    FileError
        If the file holds neither, or its content is invalid.
    """
    with open_hdf5(path) as file:
        return _read_own(file, options) if VERSION_KEY in file.file.attrs else _cube_in(file, options)


def write(scene: Scene, path: Path, *, cube: bool = False) -> None:
    """Write photosite's own file, or a plain cube of photon radiance."""
    if cube:
        _write_cube(scene, path)
        return
    with atomic_path(path) as temporary, create_hdf5(temporary) as file:
        count, rows, cols = scene.weights.shape
        step = max(1, _BLOCK_BYTES // (4 * count * cols))
        data = file.create_dataset("weights", scene.weights.shape, "<f4")
        for first in range(0, rows, step):
            data[:, first : first + step] = scene.weights[:, first : first + step]
        _write_rest(file, scene)


@dataclass(frozen=True, eq=False, kw_only=True)
class ChunkedCube(SpectralCube):
    """A cube in a chunked dataset, whose `axes` hold rows, columns and bands, read in slabs of whole chunks of rows."""

    path: Path
    variable: str
    axes: tuple[int, int, int]
    slab_rows: int
    scale: float | Array = 1.0
    no_data: float | None = None

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        with open_hdf5(self.path) as file:
            data = file.datasets[self.variable]
            for first in range(0, self.shape[0], self.slab_rows):
                raw = _slab(data, self.axes, slice(first, first + self.slab_rows), slice(None))
                with np.errstate(over="ignore"):  # infinite values are refused where the block is used
                    slab = np.multiply(raw, np.asarray(self.scale, np.float64), dtype=np.float64)
                if self.no_data is not None:
                    slab[raw == self.no_data] = np.nan
                for start in range(0, len(slab), rows):
                    yield first + start, slab[start : start + rows]


def _slab(data: Any, axes: tuple[int, int, int], rows: slice, bands: slice) -> NDArray[Any]:
    """Read a part of a dataset as (rows, cols, bands)."""
    where: list[slice] = [slice(None)] * 3
    where[axes[0]], where[axes[2]] = rows, bands
    return np.asarray(data[tuple(where)]).transpose(axes)


def _cube_in(file: Hdf5File, options: ReadOptions) -> SpectralCube:
    path, datasets = file.path, file.datasets
    numeric = {key: item.shape for key, item in datasets.items() if item.dtype.kind in "fiu"}
    name = choose_variable(path, numeric, options.variable)
    data = datasets[name]
    attributes = {key.lower(): value for key, value in file.attributes(data, inherited=True).items()}
    beside = {key.rpartition("/")[2].lower(): item for key, item in datasets.items() if item.ndim <= 2}
    lists = _lists(path, attributes, beside)
    axes = _axes(path, data.shape, options.interleave or attributes.get("interleave"), lists, options)
    bands = data.shape[axes[2]]
    units = file_units(path, options, next((attributes[key] for key in UNIT_NAMES if key in attributes), None))
    if "light" in beside:
        attributes.setdefault("light", read_numbers(path, beside["light"]))
    stated = Stated(path, attributes)
    return cube_of_dataset(
        path,
        name,
        data,
        axes,
        quantity=units.quantity,
        scale=units.scale * (stated.number("scale", above_0=True) or 1.0),
        wavelength_nm=_wavelengths(file, attributes, beside, lists, options, bands),
        **stated.head(bands),
    )


def choose_variable(path: Path, shapes: dict[str, tuple[int, ...]], wanted: str | None) -> str:
    """Return the name of the cube: the variable wanted, or the only one of three axes."""
    cubes = [name for name, shape in shapes.items() if len(shape) == 3 and min(shape) > 0]
    listed = ", ".join(f"{name} {shapes[name]}" for name in cubes[:8]) or "none"
    if wanted is not None:
        found = wanted.strip("/")
        if found not in cubes:
            raise FileError(path, f"has no cube '{wanted}' (rows, columns, bands); it has {listed}")
        return found
    if not cubes:
        raise FileError(path, "has no cube, a variable of three axes (rows, columns, bands)")
    if len(cubes) > 1:
        hint, arguments = "Pass one of them, such as {variable}", {"variable": cubes[0]}
        raise FileError(path, f"has {len(cubes)} cubes: {listed}", hint=hint, arguments=arguments)
    return cubes[0]


def cube_of_dataset(path: Path, name: str, data: Any, axes: tuple[int, int, int], **head: Any) -> SpectralCube:
    """Return a dataset as a cube: in place, in slabs of chunks, or copied if its rows are scattered.

    `head` are the cube's other fields, `scale` and `no_data` among them.
    """
    check_stored(path, data)
    rows, cols, bands = (data.shape[axis] for axis in axes)
    head |= {"name": str(path), "shape": (rows, cols, bands)}
    interleave = next((kind for kind, where in _AXES.items() if where == axes), None)
    if data.chunks is None and interleave is not None and data.id.get_offset() is not None:
        return RawCube(path=path, dtype=data.dtype, interleave=interleave, offset=data.id.get_offset(), **head)
    slab = _SLAB_BYTES // (8 * cols * bands)
    step = 1 if data.chunks is None else data.chunks[axes[0]]
    if data.chunks is not None and step <= slab:
        return ChunkedCube(path=path, variable=name, axes=axes, slab_rows=slab // step * step, **head)
    dtype = data.dtype.newbyteorder("=")
    copy, folder = write_bands(path, _pieces(data, axes), (rows, cols, bands), dtype)
    return RawCube(path=copy, dtype=dtype, interleave="bsq", keep=folder, **head)


def _pieces(data: Any, axes: tuple[int, int, int]) -> Iterator[Piece]:
    """Yield the dataset by whole chunks of rows and bands; a contiguous one by bands."""
    rows, _, bands = (data.shape[axis] for axis in axes)
    high, deep = (rows, 1) if data.chunks is None else (data.chunks[axes[0]], data.chunks[axes[2]])
    for band in range(0, bands, deep):
        for row in range(0, rows, high):
            part = _slab(data, axes, slice(row, row + high), slice(band, band + deep))
            yield band, row, np.moveaxis(part, 2, 0)


def _lists(path: Path, attributes: dict[str, Any], beside: dict[str, Any]) -> dict[str, Array]:
    """Return lists of wavelengths by name. A single number may be a count of bands."""
    found: dict[str, Array] = {}
    for name in WAVELENGTH_NAMES:
        try:
            values = Stated(path, attributes).numbers(name)
            if values is None and name in beside:
                values = read_numbers(path, beside[name]).ravel()
        except FileError:
            if not found:
                raise
            continue  # "bands" may be names
        if values is not None:
            found[name] = values
    return found


def _axes(
    path: Path, shape: tuple[int, ...], stated: object, lists: dict[str, Array], options: ReadOptions
) -> tuple[int, int, int]:
    """Return the axes of rows, columns and bands: as stated, else "bip" unless the wavelengths fit another axis."""
    if stated is not None:
        axes = next((axes for kind, axes in _AXES.items() if kind == str(stated).lower()), None)
        if axes is None:
            raise FileError(path, "interleave", value=str(stated), expected="'bip', 'bsq' or 'bil'")
        return axes
    counts = {values.size for values in lists.values()} - {1}
    if options.wavelength_nm is not None:
        counts = {np.size(options.wavelength_nm)}
    fits = [axis for axis, size in enumerate(shape) if size in counts]
    if fits and fits != [2]:
        where = "more than one axis" if len(fits) > 1 else f"its {('first', 'second')[fits[0]]} axis"
        raise FileError(
            path,
            f"has a cube of {shape}, and {shape[fits[0]]} wavelengths fit {where}",
            hint="Pass {interleave} (rows, columns, bands), 'bsq' (bands, rows, columns) or 'bil'",
            arguments={"interleave": "bip"},
        )
    return _AXES["bip"]


def _wavelengths(
    file: Hdf5File,
    attributes: dict[str, Any],
    beside: dict[str, Any],
    lists: dict[str, Array],
    options: ReadOptions,
    bands: int,
) -> Array:
    path = file.path
    unit = next((attributes[key] for key in ("wavelength_units", "wavelength_unit") if key in attributes), None)
    for name, values in lists.items():
        if values.size == bands:
            if unit is None and name in beside:
                own = {key.lower(): value for key, value in file.attributes(beside[name]).items()}
                unit = own.get("units", own.get("unit"))
            known = "nm" if name.endswith("_nm") else None if unit is None else str(unit)
            return wavelengths_in_nm(path, values, known, options.wavelength_nm)
    for name, values in lists.items():
        if values.size > 1:
            misfit = f"'{name}' has {values.size} entries for {bands} bands"
            if options.wavelength_nm is None:
                raise FileError(path, misfit, hint="Pass the wavelengths in nm (wavelength_nm)")
            warnings.warn(PhotositeWarning(f"{misfit}; it is ignored", where=str(path)), stacklevel=2)
    return wavelengths_in_nm(path, None, None, options.wavelength_nm)


def _write_cube(scene: Scene, path: Path) -> None:
    """Write the scene's radiance at every sample, in single precision and chunks of rows."""
    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    step = max(1, min(rows, _SLAB_BYTES // (8 * cols * bands), (1 << 20) // (4 * cols * bands)))
    with atomic_path(path) as temporary, create_hdf5(temporary) as file:
        data = file.create_dataset("radiance", cube.shape, "<f4", chunks=(step, cols, bands))
        for first, block in cube.blocks(step):
            data[first : first + len(block)] = block.astype(np.float32)
        data.attrs["units"] = np.bytes_(UNITS)
        data.attrs["interleave"] = np.bytes_("bip")
        data.attrs["wavelength_nm"] = cube.wavelength_nm
        data.attrs["distance_m"] = scene.distance_m
        if scene.width_m is not None:
            data.attrs["width_m"] = scene.width_m
        if cube.light is not None:
            data.attrs["light"] = cube.light


def reduce_to_own(
    reduce: Callable[[Callable[[tuple[int, int, int]], WeightStore]], Reduction], path: Path
) -> Reduction:
    """Reduce a cube into photosite's own file; the weights are written as they are computed, and mapped from it.

    `reduce` returns the reduction, given a function that makes its weight store.
    """
    with atomic_path(path) as temporary, create_hdf5(temporary) as file:
        reduction = reduce(lambda shape: _DatasetStore(file, temporary, shape))
        _write_rest(file, reduction.scene)
    return reduction


class _DatasetStore(WeightStore):
    """Weights written straight into the file."""

    def __init__(self, file: Any, path: Path, shape: tuple[int, int, int]) -> None:
        super().__init__(file.create_dataset("weights", shape, "<f4"))
        self._file, self._path = file, path

    def finish(self) -> NDArray[np.float32]:
        self._file.flush()
        return MappedWeights(self._path, "<f4", "r", self._weights.id.get_offset(), self._weights.shape)


def _write_rest(file: Any, scene: Scene) -> None:
    file.attrs[VERSION_KEY] = 1
    file.attrs["units"] = np.bytes_(UNITS)
    file.attrs["distance_m"] = scene.distance_m
    file.attrs["relative_error"] = scene.relative_error
    if scene.patches:
        file.attrs["patches"] = 1
    if scene.name:
        file.attrs["name"] = np.bytes_(scene.name.encode("utf-8"))
    if scene.width_m is not None:
        file.attrs["width_m"] = scene.width_m
    for name in ("basis", "wavelength_nm", "reflectance"):
        if (values := getattr(scene, name)) is not None:
            file.create_dataset(name, data=np.asarray(values, "<f8"))
    if (polarization := scene.polarization) is not None:
        file.create_dataset("polarization", data=np.stack([polarization.degree, polarization.angle_deg]))
    if scene.regions:
        places = [(region.r0, region.r1, region.c0, region.c1) for region in scene.regions]
        data = file.create_dataset("regions", data=np.array(places, "<i8"))
        data.attrs["names"] = np.char.encode(np.array([region.name for region in scene.regions]), "utf-8")


def _read_own(file: Hdf5File, options: ReadOptions) -> Scene:
    path, datasets, attributes = file.path, file.datasets, file.attributes(file.file)
    if attributes[VERSION_KEY] != 1:
        raise FileError(path, "version of the scene file", value=attributes[VERSION_KEY], expected="1")
    for name in ("weights", "basis", "wavelength_nm"):
        if name not in datasets:
            raise FileError(path, f"is a scene file without '{name}'", hint="Check that the file is complete")
    if attributes.get("units") != UNITS:
        raise FileError(path, "units", value=attributes.get("units"), expected=f"'{UNITS}' in a scene file")
    names = ("basis", "wavelength_nm", "reflectance")
    spectra = {name: read_numbers(path, datasets[name]) for name in names if name in datasets}
    stated = Stated(path, attributes)
    lost = stated.number("relative_error")
    if lost is None or lost < 0:
        raise FileError(path, "relative_error", value=lost, expected="0 or more")
    try:
        scene = Scene(
            _weights(path, datasets["weights"]),
            distance_m=stated.number("distance_m") or 0.0,  # 0 is refused
            width_m=stated.number("width_m"),
            regions=_regions(file),
            name=str(attributes.get("name", "")),
            relative_error=lost,
            patches="patches" in attributes,
            polarization=_polarization(file),
            **spectra,
        )
        return apply_options(scene, options)
    except InputError as error:
        raise error.in_file(path) from None


def _weights(path: Path, data: Any) -> NDArray[np.float32]:
    if data.ndim != 3 or data.dtype != np.dtype("<f4") or 0 in data.shape:
        raise FileError(path, "weights", value=f"{data.shape} of {data.dtype}", expected="(K, rows, cols) of float32")
    offset = data.id.get_offset() if data.chunks is None else None
    if offset is None:
        raise FileError(path, "the weights are not contiguous", hint="Write the scene again with Scene.save")
    if offset + 4 * math.prod(data.shape) > path.stat().st_size:
        raise FileError(path, f"is truncated: it ends within its weights {data.shape}")
    weights = MappedWeights(path, "<f4", "r", offset, data.shape)
    if not all_finite(weights):
        raise FileError(path, "is damaged: some weights are not finite")
    return weights


def _polarization(file: Hdf5File) -> Polarization | None:
    data = file.datasets.get("polarization")
    if data is None:
        return None
    values = read_numbers(file.path, data)
    if values.shape[:1] != (2,):
        raise FileError(file.path, "polarization", value=values.shape, expected="(2,) or (2, rows, cols)")
    return Polarization(*values)


def _regions(file: Hdf5File) -> tuple[Region, ...]:
    data = file.datasets.get("regions")
    if data is None:
        return ()
    places = read_numbers(file.path, data)
    names = np.atleast_1d(np.asarray(file.attributes(data).get("names", ())))
    if places.ndim != 2 or places.shape[1] != 4 or names.shape != (len(places),) or (places % 1).any():
        given = f"{places.shape} with {names.size} names"
        raise FileError(file.path, "regions", value=given, expected="(n, 4) with n names")
    return tuple(Region(str(plain(name)), *map(int, row)) for name, row in zip(names, places, strict=True))
