"""photosite's own scene file: HDF5 whose weights lie in one piece, so that they are mapped and never loaded.

Layout, version 1; text is of fixed length, in UTF-8:

    /                 attributes photosite_scene = 1, name, distance_m, width_m (where known), relative_error, units,
                      patches = 1 (a chart whose luminance is that of its regions)
    /weights          (K, rows, cols) float32, little endian, contiguous
    /basis            (K, wavelengths) photons/s/sr/m2/nm
    /wavelength_nm    (wavelengths,)
    /reflectance      (K, wavelengths), where known
    /regions          (n, 4) first row, last row + 1, first column, last column + 1; attribute names; where any
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.atomic import atomic_path
from photosite.scene.io.hdf5_file import numbers, plain
from photosite.scene.io.store import WeightStore
from photosite.scene.options import ReadOptions
from photosite.scene.reduce import Reduction, apply_options
from photosite.scene.scene import Scene
from photosite.scene.weights import MappedWeights, all_finite
from photosite.values.region import Region

VERSION_KEY = "photosite_scene"
UNITS = "photons/s/sr/m2/nm"
_BLOCK_BYTES = 32 << 20


def write_native(scene: Scene, path: Path) -> None:
    """Write a scene, whole or not at all, some rows at a time.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        count, rows, cols = scene.weights.shape
        step = max(1, _BLOCK_BYTES // (4 * count * cols))
        with _Store(file, temporary, scene.weights.shape) as store:
            for first in range(0, rows, step):
                store.put(first, scene.weights[:, first : first + step])
        _write_rest(file, scene)


def reduce_to_native(
    reduce: Callable[[Callable[[tuple[int, int, int]], WeightStore]], Reduction], path: Path
) -> Reduction:
    """Let a cube be reduced into a scene file; the weights go to the file as they come.

    Parameters
    ----------
    reduce
        Makes the reduction, given what makes its store.
    path
        The file wanted.

    Returns
    -------
    Reduction
        Its scene's weights are mapped from the file.
    """
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        reduction = reduce(lambda shape: _Store(file, temporary, shape))
        _write_rest(file, reduction.scene)
    return reduction


class _Store:
    """Weights straight into the file."""

    def __init__(self, file: Any, path: Path, shape: tuple[int, int, int]) -> None:
        self._file, self._path = file, path
        self._data = file.create_dataset("weights", shape, "<f4")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        self._data[:, first : first + weights.shape[1]] = weights

    def finish(self) -> NDArray[np.float32]:
        self._file.flush()
        return MappedWeights(self._path, "<f4", "r", self._data.id.get_offset(), self._data.shape)


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
    if scene.regions:
        places = [(region.r0, region.r1, region.c0, region.c1) for region in scene.regions]
        data = file.create_dataset("regions", data=np.array(places, "<i8"))
        data.attrs["names"] = np.char.encode(np.array([region.name for region in scene.regions]), "utf-8")


def read_native(path: Path, file: Any, datasets: dict[str, Any], said: ReadOptions) -> Scene:
    """The scene of an opened file; its weights are mapped.

    Raises
    ------
    FileError
        If something is missing or cannot be, or an option says what the file says itself.
    """
    version = plain(file.attrs[VERSION_KEY])
    if version != 1:
        raise FileError(path, f"is a scene file of version {version}; this photosite reads version 1")
    for name in ("units", "wavelength_nm", "variable"):
        if getattr(said, name) is not None:
            raise FileError(path, f"is a scene file, which says its {name} itself; leave that out")
    for name in ("weights", "basis", "wavelength_nm"):
        if name not in datasets:
            raise FileError(path, f"is a scene file without '{name}'; was it written whole?")
    attributes = {name: plain(value) for name, value in file.attrs.items()}
    if attributes.get("units") != UNITS:
        raise FileError(path, f"has units '{attributes.get('units')}'; a scene file's are {UNITS}")
    spectra = {
        name: numbers(path, datasets[name]) for name in ("basis", "wavelength_nm", "reflectance") if name in datasets
    }
    try:
        scene = Scene(
            _weights(path, datasets["weights"]),
            distance_m=_number(path, attributes, "distance_m"),
            width_m=_number(path, attributes, "width_m") if "width_m" in attributes else None,
            regions=_regions(path, datasets.get("regions")),
            name=str(attributes.get("name", "")),
            relative_error=_number(path, attributes, "relative_error"),
            patches="patches" in attributes,
            **spectra,
        )
        return apply_options(scene, said)
    except InputError as error:
        raise error.in_file(path) from None


def _weights(path: Path, data: Any) -> NDArray[np.float32]:
    if data.ndim != 3 or data.dtype != np.dtype("<f4") or 0 in data.shape:
        raise FileError(path, f"weights are {data.shape} of {data.dtype}, not (K, rows, cols) of 32-bit floats")
    offset = data.id.get_offset() if data.chunks is None else None
    if offset is None:
        raise FileError(path, "its weights are not in one piece; write the scene anew (Scene.save)")
    if offset + 4 * math.prod(data.shape) > path.stat().st_size:
        raise FileError(path, f"is truncated: it ends within its weights {data.shape}")
    weights = MappedWeights(path, "<f4", "r", offset, data.shape)
    if not all_finite(weights):
        raise FileError(path, "is damaged: some of its weights are no numbers")
    return weights


def _number(path: Path, attributes: dict[str, Any], name: str) -> float:
    value = attributes.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
        raise FileError(path, f"its {name} is {value!r:.40}, not a number of 0 or more")
    return float(value)


def _regions(path: Path, data: Any) -> tuple[Region, ...]:
    if data is None:
        return ()
    places = numbers(path, data)
    names = np.atleast_1d(np.asarray(data.attrs.get("names", ())))
    if places.ndim != 2 or places.shape[1] != 4 or names.shape != (len(places),) or (places % 1).any():
        raise FileError(path, f"its regions are {places.shape} with {names.size} names, not (n, 4) with n")
    return tuple(
        Region(str(plain(name)), *(int(place) for place in row)) for name, row in zip(names, places, strict=True)
    )
