"""Spectral cubes: images of many bands that are looked at some rows at a time, wherever they lie.

What a cube's numbers mean stands in its head; a reader brings them to SI. What becomes of them is
`photosite.scene.reduce`'s business.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.temporary import TemporaryFolder
from photosite.scene.scene import Scene
from photosite.scene.units import Quantity

Array = NDArray[np.float64]
Block = tuple[int, Array]
"""First row, and (n, cols, bands) values."""

_ROUNDING = 1e-6
"""Of the RMS radiance: what weights in single precision may leave below 0."""
Interleave = Literal["bsq", "bil", "bip"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CubeHead:
    """What is known of a cube before any of its values is read.

    Parameters
    ----------
    name
        What to call it in messages: its file.
    shape
        (rows, cols, bands).
    wavelength_nm
        (bands,) in the order of the bands; whether they increase is checked when the cube is reduced.
    quantity
        What the values are: see `photosite.scene.units.Quantity`.
    light
        (bands,) photons/s/sr/m2/nm from a perfect white, where the file says so.
    distance_m, width_m
        Of the scene, where the file says so.
    title
        The scene's own name, where the file says so.
    """

    name: str
    shape: tuple[int, int, int]
    wavelength_nm: Array
    quantity: Quantity
    light: Array | None = None
    distance_m: float | None = None
    width_m: float | None = None
    title: str | None = None

    def __post_init__(self) -> None:
        if len(self.wavelength_nm) != self.shape[2]:
            raise FileError(
                self.name,
                f"has {self.shape[2]} bands and {len(self.wavelength_nm)} wavelengths; give one for each band "
                "(wavelength_nm=[...])",
            )
        if self.light is not None and self.light.shape != (self.shape[2],):
            raise FileError(self.name, f"has a light of {self.light.size} values for {self.shape[2]} bands")
        if 0 in self.shape:
            raise FileError(self.name, f"is empty: {self.shape} rows, columns and bands")


class SpectralCube(Protocol):
    """What the reduction asks of a cube; the first five are a `CubeHead`'s."""

    @property
    def name(self) -> str: ...
    @property
    def shape(self) -> tuple[int, int, int]: ...
    @property
    def wavelength_nm(self) -> Array: ...
    @property
    def quantity(self) -> Quantity: ...
    @property
    def light(self) -> Array | None: ...
    @property
    def distance_m(self) -> float | None: ...
    @property
    def width_m(self) -> float | None: ...
    @property
    def title(self) -> str | None: ...

    def blocks(self, rows: int) -> Iterator[Block]:
        """All rows in order, at most so many at a time, in SI; NaN where the file says that it has no data.

        A block may be overwritten by the next one.
        """
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayCube(CubeHead):
    """A cube whose values are in memory, or in something that is sliced like an array.

    Parameters
    ----------
    values
        (rows, cols, bands).
    scale
        Times a value gives SI; one number or one per band.
    """

    values: Any
    scale: float | Array = 1.0

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first in range(0, self.shape[0], rows):
            yield first, np.asarray(self.values[first : first + rows], dtype=np.float64) * self.scale


@dataclass(frozen=True, eq=False, kw_only=True)
class RawCube(CubeHead):
    """A cube of plain numbers in a file, read piece by piece: nothing of it is mapped, so that memory stays as it is.

    Parameters
    ----------
    path
        The file.
    dtype
        Of the numbers, byte order included.
    interleave
        "bsq" (band after band), "bil" (row after row, in it band after band), "bip" (spectrum after spectrum).
    offset
        Bytes before the first number.
    band_offsets
        Where bands lie apart ("bsq" only): the first byte of each, in place of `offset`.
    scale
        Times a number gives SI; one for all or one per band.
    no_data
        The number that stands for none.
    keep
        The temporary folder that the file is in, which lives as long as the cube.
    """

    path: Path
    dtype: np.dtype[Any]
    interleave: Interleave = "bsq"
    offset: int = 0
    band_offsets: tuple[int, ...] | None = None
    scale: float | Array = 1.0
    no_data: float | None = None
    keep: TemporaryFolder | None = None

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`.

        Raises
        ------
        FileError
            If the file ends before the cube does.
        """
        total, cols, bands = self.shape
        rows = min(rows, total)
        by_band = self.interleave != "bip"
        values = np.empty((bands, rows, cols) if by_band else (rows, cols, bands))
        room = np.empty((cols * rows * bands,), self.dtype)
        scale = np.broadcast_to(np.asarray(self.scale, np.float64), (bands,))
        with self.path.open("rb", buffering=0) as file:
            for first in range(0, total, rows):
                count = min(rows, total - first)
                raw = self._read(file, room, first, count)
                block = values[:, :count] if by_band else values[:count]
                with np.errstate(over="ignore"):  # what becomes infinite is refused where it is looked at
                    np.multiply(raw, scale[:, None, None] if by_band else scale, out=block)
                if self.no_data is not None:
                    block[raw == self.no_data] = np.nan
                yield first, (np.moveaxis(block, 0, 2) if by_band else block)

    def _read(self, file: Any, room: NDArray[Any], first: int, count: int) -> NDArray[Any]:
        """(bands, count, cols), or of "bip" (count, cols, bands), as stored."""
        total, cols, bands = self.shape
        size = self.dtype.itemsize
        if self.interleave == "bsq":
            raw = room[: bands * count * cols].reshape(bands, count, cols)
            for band in range(bands):
                begin = self.offset + band * total * cols * size
                if self.band_offsets is not None:
                    begin = self.band_offsets[band]
                self._fill(file, begin + first * cols * size, raw[band])
            return raw
        flat = room[: bands * count * cols]
        self._fill(file, self.offset + first * cols * bands * size, flat)
        if self.interleave == "bil":
            return flat.reshape(count, bands, cols).transpose(1, 0, 2)
        return flat.reshape(count, cols, bands)

    def _fill(self, file: Any, begin: int, part: NDArray[Any]) -> None:
        view = memoryview(part.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        file.seek(begin)
        got = 0
        while got < len(view):
            more = file.readinto(view[got:])
            if not more:
                raise FileError(
                    self.name, f"is truncated: it ends at byte {begin + got}, within a cube of {self.shape} values"
                )
            got += more


@dataclass(frozen=True, eq=False, kw_only=True)
class PickedBands(CubeHead):
    """Some bands of a cube.

    Parameters
    ----------
    whole
        The cube.
    bands
        (n,) indices of its bands, in their order.
    """

    whole: SpectralCube
    bands: NDArray[np.intp]

    @property
    def path(self) -> Path:
        """The file that the values are read from."""
        return Path(getattr(self.whole, "path", self.name))

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first, block in self.whole.blocks(rows):
            yield first, block[:, :, self.bands]


def picked(cube: SpectralCube, wanted: NDArray[np.bool_]) -> SpectralCube:
    """Some bands of a cube.

    Parameters
    ----------
    cube
        The cube.
    wanted
        (bands,) whether each is one of them.

    Returns
    -------
    SpectralCube
        The cube itself where all are wanted.

    Raises
    ------
    FileError
        If none is.

    Examples
    --------
    >>> whole = ArrayCube(name="pair", shape=(1, 1, 2), wavelength_nm=np.array([500.0, 900.0]),
    ...                   quantity="relative", values=np.array([[[1.0, 2.0]]]))
    >>> cube = picked(whole, whole.wavelength_nm < 800)
    >>> cube.wavelength_nm.tolist(), [block.tolist() for _, block in cube.blocks(8)]
    ([500.0], [[[[1.0]]]])
    """
    if wanted.all():
        return cube
    if not wanted.any():
        grid = cube.wavelength_nm
        raise FileError(cube.name, f"has no band left of those from {grid.min():g} to {grid.max():g} nm; choose others")
    rows, cols, _ = cube.shape
    return PickedBands(
        name=cube.name,
        shape=(rows, cols, int(wanted.sum())),
        wavelength_nm=np.asarray(cube.wavelength_nm, np.float64)[wanted],
        quantity=cube.quantity,
        light=None if cube.light is None else np.asarray(cube.light, np.float64)[wanted],
        distance_m=cube.distance_m,
        width_m=cube.width_m,
        title=cube.title,
        whole=cube,
        bands=np.flatnonzero(wanted),
    )


def release(cube: SpectralCube) -> None:
    """Remove what was laid out for a cube in temporary folders; it cannot be read any more."""
    for inner in ("whole", "coefficients"):
        if (within := getattr(cube, inner, None)) is not None:
            release(within)
    if (folder := getattr(cube, "keep", None)) is not None:
        folder.close()


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneCube(CubeHead):
    """The radiance of a scene, sample by sample: what cube files are written from.

    What a scene of few spectra has below 0 is 0 here, which is closer to what the scene was made from.

    Parameters
    ----------
    scene
        The scene.
    """

    scene: Scene

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`.

        Raises
        ------
        InputError
            After the last block: if more of the radiance is below 0 than the scene's own error explains.
        """
        below = power = 0.0
        for first in range(0, self.shape[0], rows):
            weights = self.scene.weights[:, first : first + rows].astype(np.float64)
            radiance = np.tensordot(self.scene.basis.T, weights, axes=1)
            power += float(np.vdot(radiance, radiance))
            negative = np.minimum(radiance, 0.0)
            below += float(np.vdot(negative, negative))
            yield first, np.moveaxis(np.maximum(radiance, 0.0, out=radiance), 0, 2)
        if below > (self.scene.relative_error + _ROUNDING) ** 2 * power:
            raise InputError(
                f"the scene '{self.name}' has a negative radiance somewhere, of {np.sqrt(below / power):.1e} of its "
                "RMS; its weights and basis must make radiances of 0 or more"
            )


def cube_of_scene(scene: Scene) -> SceneCube:
    """The scene's photon radiance as a cube.

    Examples
    --------
    >>> cube = cube_of_scene(Scene.uniform([1e14, 2e14], [500, 600]))
    >>> cube.shape, [block.tolist() for _, block in cube.blocks(8)]
    ((1, 1, 2), [[[[100000000000000.0, 200000000000000.0]]]])
    """
    return SceneCube(
        name=scene.name,
        shape=(*scene.shape, scene.wavelength_nm.size),
        wavelength_nm=scene.wavelength_nm,
        quantity="photon radiance",
        light=None if scene.reflectance is None else scene.light(),
        distance_m=scene.distance_m,
        width_m=scene.width_m,
        title=scene.name,
        scene=scene,
    )
