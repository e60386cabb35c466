"""Weights over a few basis spectra: by truncated singular value decomposition, and stored if larger than memory.

A cube is reduced in two passes over its rows. The first sums the (bands, bands) Gram matrix of all spectra in double
precision; its eigenvectors are the right singular vectors of the tall matrix of spectra. The second projects every
sample on the fewest eigenvectors that keep the tolerance, and measures what is lost.
"""

from __future__ import annotations

import mmap
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import IO, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError, InputError
from photosite.scene.cube import Array, SpectralCube
from photosite.scene.options import ReadOptions
from photosite.scene.units import bright_count, check_reflectances

_BLOCK_VALUES = 1 << 22
_LARGE_BYTES = 256 << 20


class MappedWeights(np.memmap):
    """Weights in a file, mapped read-only, that were all checked when the file was opened."""


def checked_weights(weights: ArrayLike) -> tuple[NDArray[np.float32], bool]:
    """Return weights as float32, not copied where they are already, and whether all are finite."""
    array: NDArray[np.float32] = np.asarray(weights, dtype=np.float32)
    owner: Any = array
    while isinstance(owner, np.ndarray):
        # An array computed from mapped weights has the class too, but is in memory.
        if isinstance(owner, MappedWeights) and getattr(owner, "_mmap", None) is not None:
            return array, True
        owner = owner.base
    return array, all_finite(array)


def all_finite(array: NDArray[np.float32]) -> bool:
    """Return whether every value is finite; of a mapped file at most a block stays in memory."""
    if not array.flags.c_contiguous:
        return bool(np.isfinite(array).all())
    return all(np.isfinite(block).all() for block in _blocks(array))


def component_means(weights: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the mean (K,) of each component over all samples; of a mapped file at most a block stays in memory."""
    if not weights.flags.c_contiguous:
        return np.asarray(weights.mean(axis=(1, 2), dtype=np.float64))
    totals = np.zeros(len(weights))
    for k, component in enumerate(weights):
        for block in _blocks(component):
            totals[k] += block.sum(dtype=np.float64)
    means: NDArray[np.float64] = totals / (weights.shape[1] * weights.shape[2])
    return means


def _blocks(array: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    """Yield all values in flat blocks; pages of a read-only mapped file are dropped after each block."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, memoryview):
        owner = owner.obj
    droppable = isinstance(owner, mmap.mmap) and not array.flags.writeable and hasattr(owner, "madvise")
    flat = array.reshape(-1)
    for first in range(0, flat.size, _BLOCK_VALUES):
        yield flat[first : first + _BLOCK_VALUES]
        if droppable:
            owner.madvise(mmap.MADV_DONTNEED)


class WeightStore:
    """Weights (K, rows, cols) while they are computed, in an array or a data set; open within a `with` block."""

    def __init__(self, weights: Any) -> None:
        self._weights = weights

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        """Store the weights (K, n, cols) of the rows from `first` on."""
        self._weights[:, first : first + weights.shape[1]] = weights

    def finish(self) -> NDArray[np.float32]:
        """Return all weights."""
        weights: NDArray[np.float32] = self._weights
        return weights


def temporary_store(shape: tuple[int, int, int]) -> WeightStore:
    """Return memory for weights (K, rows, cols) up to 256 MiB, else a temporary file that is deleted with them."""
    size = 4 * int(np.prod(shape, dtype=np.int64))
    return WeightStore(np.empty(shape, np.float32)) if size <= _LARGE_BYTES else _FileStore(shape, size)


class _FileStore(WeightStore):
    """A file without a name, which is deleted with its last mapping."""

    def __init__(self, shape: tuple[int, int, int], size: int) -> None:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        if size > free:
            raise InputError(
                f"the scene's weights need {size / 1e9:.1f} GB; {tempfile.gettempdir()} has {free / 1e9:.1f} GB free",
                hint="Set TMPDIR to a larger disk, or write the scene to a file (photosite convert)",
            )
        self._shape = shape
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="photosite-scene-")  # noqa: SIM115 - __exit__ closes it

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        _, rows, cols = self._shape
        try:
            for k, component in enumerate(weights):
                self._file.seek(4 * (k * rows + first) * cols)
                self._file.write(np.ascontiguousarray(component).data)
        except OSError as error:
            raise InputError(f"weights cannot be stored in {tempfile.gettempdir()}: {error.strerror}") from None

    def finish(self) -> NDArray[np.float32]:
        self._file.flush()
        return MappedWeights(self._file, np.float32, "r", shape=self._shape)


Progress = Callable[[int, int, str], object]
"""Called with (done, total, unit)."""

_BLOCK_BYTES = 32 << 20
"""Double-precision values of the rows that are processed together."""
_LARGEST_POWER = 1e200
"""Sum of squares in SI; squares in photons would overflow double precision above it."""


def few_spectra(spectra: NDArray[np.float64], tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return weights (n, K), at most 1 in size, and the smallest basis (K, wavelengths) of (n, wavelengths) spectra.

    The RMS error is at most `tolerance` of the spectra's RMS.

    Examples
    --------
    >>> weights, basis = few_spectra(np.outer([1.0, 2.0, 4.0], [0.5, 0.25]), 1e-6)
    >>> weights.shape, basis.shape, (weights @ basis).round(6).tolist()
    ((3, 1), (1, 2), [[0.5, 0.25], [1.0, 0.5], [2.0, 1.0]])
    """
    vectors = principal_spectra(spectra.T @ spectra, tolerance)
    weights = spectra @ vectors.T
    scale = np.abs(weights).max(axis=0)
    scale[scale == 0] = 1.0  # all spectra are 0: the weights stay 0
    return weights / scale, scale[:, None] * vectors


def principal_spectra(
    gram: NDArray[np.float64], tolerance: float, also: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the smallest orthonormal basis (K, wavelengths) of spectra, from their Gram matrix.

    The RMS error is at most `tolerance` of the spectra's RMS; also for the spectra multiplied by `also` (wavelengths,)
    where that is given. The basis are the right singular vectors of the tall matrix of spectra.
    """
    power, vectors = np.linalg.eigh(gram)
    power, vectors = np.maximum(power[::-1], 0.0), vectors[:, ::-1]  # a Gram matrix is below 0 by rounding only
    if power[0] == 0.0:
        return np.ascontiguousarray(vectors[:, :1].T)
    K = _kept(power, tolerance)
    if also is not None:
        K = max(K, _kept(power * ((also[:, None] * vectors) ** 2).sum(axis=0), tolerance))
    return np.ascontiguousarray(vectors[:, :K].T)


def _kept(power: NDArray[np.float64], tolerance: float) -> int:
    """Return how many of the first entries leave at most tolerance^2 of the sum to the others."""
    left_over = np.append(np.cumsum(power[::-1])[::-1][1:], 0.0)  # summed from the small end, against cancellation
    return int(np.argmax(left_over <= tolerance**2 * power.sum())) + 1


@dataclass(frozen=True, eq=False)
class Components:
    """A cube as weights over few spectra.

    Parameters
    ----------
    weights
        (K, rows, cols) float32.
    spectra
        (K, wavelengths) in the space of the reduction, in order of wavelength.
    to_photons, scale
        (wavelengths,) factors from that space to photon radiance, and the factor in them that brings the scene to the
        wanted luminance.
    relative_error
        RMS error of the photon radiance, relative to its RMS.
    no_data_values, negative_values
        Values that were replaced by 0.
    """

    weights: NDArray[np.float32]
    spectra: Array
    to_photons: Array
    scale: float
    relative_error: float
    no_data_values: int
    negative_values: int


def reduce_to_components(
    cube: SpectralCube,
    order: NDArray[np.intp],
    options: ReadOptions,
    to_space: Array,
    to_photons: Array,
    *,
    scale: Callable[[Array], float] = lambda mean: 1.0,
    store: Callable[[tuple[int, int, int]], WeightStore] = temporary_store,
    progress: Progress | None = None,
) -> Components:
    """Reduce a cube to the fewest spectra that keep the tolerance.

    Parameters
    ----------
    cube, store, progress
        As for `photosite.scene.scene_cube.reduce_cube`.
    order
        (bands,) indices that sort the cube's bands.
    options
        The tolerance, and what to do with missing and negative values.
    to_space, to_photons
        (bands,) factors, in order of wavelength: from values to the space that is reduced, and from it to photons.
    scale
        Returns a factor for the radiance, from the mean photon radiance (bands,).

    """
    passes = _Passes(cube, options, order, progress or (lambda done, total, unit: None))
    gram, total = passes.sums()
    vectors = principal_spectra(gram * np.outer(to_space, to_space), options.tolerance, also=to_photons)
    factor = scale(total / passes.samples * to_space * to_photons)
    to_photons = to_photons * factor
    # Weights of RMS 1: photon radiances are large numbers, and single precision is best near 1.
    size = np.sqrt(((vectors * to_space) @ gram * (vectors * to_space)).sum(axis=1) / passes.samples)
    size[size == 0] = 1.0  # a dark scene
    spectra = vectors * size[:, None]
    power = float(np.diag(gram) @ (to_space * to_photons) ** 2)
    weights, lost = passes.project(vectors * to_space / size[:, None], spectra / to_space, to_space * to_photons, store)
    error = float(np.sqrt(lost / power)) if power > 0 else 0.0
    return Components(weights, spectra, to_photons, factor, error, passes.no_data, passes.negative)


class _Passes:
    """The two passes over the checked values of a cube."""

    def __init__(self, cube: SpectralCube, options: ReadOptions, order: NDArray[np.intp], progress: Progress) -> None:
        self._cube, self._options, self._order, self._progress = cube, options, order, progress
        rows, cols, bands = cube.shape
        self._rows = max(1, min(rows, _BLOCK_BYTES // (8 * cols * bands)))
        self._done = 0
        self.samples = rows * cols
        self.no_data = self.negative = 0

    def sums(self) -> tuple[Array, Array]:
        """Return the Gram matrix (bands, bands) and the sum (bands,) of all samples, bands in order of wavelength."""
        bands = self._cube.shape[2]
        gram, total = np.zeros((bands, bands)), np.zeros(bands)
        largest, bright = 0.0, 0
        for _, block in self._blocks(count=True):
            if self._cube.quantity == "reflectance":
                largest, bright = max(largest, float(block.max())), bright + bright_count(block)
            spectra = _by_band(block)
            with np.errstate(over="ignore"):
                gram += spectra @ spectra.T  # NumPy detects the transpose and computes one half
                total += spectra.sum(axis=1)
        check_reflectances(self._cube.name, largest, bright, self.samples * bands)
        if not np.trace(gram) < _LARGEST_POWER:
            raise FileError(self._cube.name, "holds values far above any light", hint="Check the units")
        return gram[np.ix_(self._order, self._order)], total[self._order]

    def project(
        self, vectors: Array, spectra: Array, photons: Array, store: Callable[[tuple[int, int, int]], WeightStore]
    ) -> tuple[NDArray[np.float32], float]:
        """Return weights (K, rows, cols), and the sum of squares of the radiance that they lack.

        `vectors` (K, bands) convert values to weights, `spectra` weights to values, `photons` (bands,) values to
        radiance.
        """
        rows, cols, bands = self._cube.shape
        back = np.argsort(self._order)
        vectors, spectra = vectors[:, back], np.ascontiguousarray(spectra[:, back].T)
        lost = np.zeros(bands)
        with store((vectors.shape[0], rows, cols)) as place:
            for first, block in self._blocks():
                values = _by_band(block)
                weights = (vectors @ values).astype(np.float32)
                place.put(first, weights.reshape(len(weights), -1, cols))
                missing = spectra @ weights.astype(np.float64)
                missing -= values
                lost += np.einsum("bs,bs->b", missing, missing)
            return place.finish(), float(lost @ photons[back] ** 2)

    def _blocks(self, *, count: bool = False) -> Iterator[tuple[int, Array]]:
        """Yield the blocks, with missing and negative values refused or replaced by 0."""
        for first, block in self._read():
            if count or self.no_data or self.negative:  # the second pass over clean values need not check again
                # One sum finds NaN and infinity. It can also overflow: a first check.
                with np.errstate(over="ignore", invalid="ignore"):
                    doubtful = not np.isfinite(block.sum())
                if doubtful:
                    block = self._without_gaps(first, block, count)
                if block.min() < 0:
                    block = self._not_negative(first, block, count)
            yield first, block
            self._done += block.shape[0]
            self._progress(self._done, 2 * self._cube.shape[0], "rows")

    def _read(self) -> Iterator[tuple[int, Array]]:
        try:
            yield from self._cube.blocks(self._rows)
        except OSError as error:
            raise FileError(self._cube.name, f"cannot be read: {error.strerror or error}") from None

    def _without_gaps(self, first: int, block: Array, count: bool) -> Array:
        infinite, gaps = np.isinf(block), np.isnan(block)
        if infinite.any():
            hint = "Correct the file: write the value, or NaN where it is missing"
            raise FileError(self._cube.name, f"has an infinite value {self._place(infinite, first)}", hint=hint)
        if self._options.no_data == "refuse" and gaps.any():
            what = f"has no data {self._place(gaps, first)} (NaN, or the file's own mark)"
            hint = "Correct the file, or read missing values as 0: {no_data}"
            raise FileError(self._cube.name, what, hint=hint, arguments={"no_data": "zero"})
        self.no_data += int(gaps.sum()) if count else 0
        return np.where(gaps, 0.0, block)

    def _not_negative(self, first: int, block: Array, count: bool) -> Array:
        below = block < 0
        if self._options.negative == "refuse":
            worst = f"down to {block.min():g} beside a largest value of {block.max():g}"
            what = f"has negative values {worst}, the first {self._place(below, first)}"
            hint = "Correct the file, or read negative values as 0: {negative}"
            raise FileError(self._cube.name, what, hint=hint, arguments={"negative": "zero"})
        self.negative += int(below.sum()) if count else 0
        return np.where(below, 0.0, block)

    def _place(self, where: NDArray[np.bool_], first: int) -> str:
        row, col, band = np.argwhere(where)[0]
        return f"at row {first + row}, column {col}, band {band + 1} ({self._cube.wavelength_nm[band]:g} nm)"


def _by_band(block: Array) -> Array:
    """Return (bands, samples) of (n, cols, bands), without a copy where bands or samples are contiguous."""
    by_band = np.moveaxis(block, 2, 0)
    bands = by_band.shape[0]
    if by_band.flags.c_contiguous:
        return by_band.reshape(bands, -1)
    return np.asarray(block.reshape(-1, bands).T)
