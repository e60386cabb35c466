"""Cubes reduced to scenes: weights over few spectra, in two passes over the file, some rows at a time.

The first pass sums the (bands, bands) Gram matrix of all spectra, in double precision; its eigenvectors are the right
singular vectors of the tall matrix of spectra. The second projects every sample on the fewest of them, and measures
what was lost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import photons_from_energy
from photosite.color.tristimulus import luminance_cd_m2
from photosite.errors import FileError, InputError
from photosite.scene.bands import band_order
from photosite.scene.cube import Array, SpectralCube
from photosite.scene.io.store import WeightStore, temporary_store
from photosite.scene.options import ReadOptions
from photosite.scene.reduction import principal_spectra
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.units import bright_count, check_reflectances

Progress = Callable[[int, int, str], object]
"""Told (done, total, what)."""

_BLOCK_BYTES = 32 << 20
"""Of the double precision values of the rows that are looked at together."""
_LARGEST_POWER = 1e200
"""Sum of squares, in SI: with more of them the same in photons would leave double precision."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """A cube as a scene, and what it took.

    Parameters
    ----------
    scene
        The scene; `scene.relative_error` is what the second pass measured.
    bands
        Of the cube.
    no_data_values, negative_values
        How many values were made 0 because the caller said so.
    reduced
        False where the file held no cube but a scene, which is kept as it is; a picture raised by "jakob-hanika" was
        reduced.
    """

    scene: Scene
    bands: int
    no_data_values: int = 0
    negative_values: int = 0
    reduced: bool = True

    @property
    def components(self) -> int:
        """Spectra that the scene is made of."""
        return len(self.scene.basis)


def reduce_cube(
    cube: SpectralCube,
    options: ReadOptions | None = None,
    *,
    store: Callable[[tuple[int, int, int]], WeightStore] = temporary_store,
    progress: Progress | None = None,
) -> Scene:
    """The scene of a cube: the fewest spectra that keep its radiance to the tolerance.

    Parameters
    ----------
    cube
        The cube.
    options
        As `read_scene` has them.
    store
        Makes the place for weights (K, rows, cols): memory, or a file where they are large.
    progress
        Told how far it is, in rows of both passes together.

    Raises
    ------
    FileError
        If the cube has no data somewhere, negative values, or bands out of order, and the options do not say what to
        do; if what is needed to bring it to radiance is missing.

    Examples
    --------
    >>> from photosite.scene.cube import ArrayCube
    >>> values = np.linspace(0, 1, 6)[:, None, None] * np.ones((6, 8, 31))
    >>> grid = np.arange(400.0, 701, 10)
    >>> cube = ArrayCube(name="ramp", shape=values.shape, wavelength_nm=grid, quantity="reflectance", values=values)
    >>> scene = reduce_cube(cube, ReadOptions(illuminant="D65", mean_luminance_cd_m2=100))
    >>> scene.weights.shape, round(scene.mean_luminance_cd_m2(), 4)
    ((1, 6, 8), 100.0)
    """
    return reduced(cube, options, store=store, progress=progress).scene


def reduced(
    cube: SpectralCube,
    options: ReadOptions | None = None,
    *,
    store: Callable[[tuple[int, int, int]], WeightStore] = temporary_store,
    progress: Progress | None = None,
) -> Reduction:
    """As `reduce_cube`, with what it took."""
    said = options or ReadOptions()
    order = band_order(cube.name, np.asarray(cube.wavelength_nm, np.float64), sort=said.sort_bands)
    grid = np.asarray(cube.wavelength_nm, np.float64)[order]
    values = _Values(cube, said, order, progress or (lambda done, total, what: None))
    to_space, to_photons, light = _meaning(cube, said, grid, order)  # what is not said is asked for before the work
    gram, total = values.sums()
    vectors = principal_spectra(gram * np.outer(to_space, to_space), said.tolerance, also=to_photons)
    if (wanted := said.mean_luminance_cd_m2) is not None and not _relit(cube, said):
        scale = _scale(cube, total / values.samples * to_space * to_photons, grid, wanted)
        to_photons, light = to_photons * scale, None if light is None else light * scale
    # Weights of RMS 1: radiances in photons are large numbers, and single precision is used best about 1.
    size = np.sqrt(((vectors * to_space) @ gram * (vectors * to_space)).sum(axis=1) / values.samples)
    size[size == 0] = 1.0  # a dark scene
    spectra = vectors * size[:, None]
    basis = spectra * to_photons
    power = float(np.diag(gram) @ (to_space * to_photons) ** 2)
    weights, lost = values.project(vectors * to_space / size[:, None], spectra / to_space, to_space * to_photons, store)
    scene = Scene(
        weights,
        basis,
        grid,
        said.distance_m or cube.distance_m or DEFAULT_DISTANCE_M,
        said.width_m or cube.width_m,
        name=cube.title or "scene",
        reflectance=_reflectance(cube, spectra, light),
        relative_error=float(np.sqrt(lost / power)) if power > 0 else 0.0,
    )
    if _relit(cube, said):
        assert said.illuminant is not None
        try:
            scene = scene.with_illuminant(said.illuminant, said.mean_luminance_cd_m2)
        except InputError as error:
            raise FileError(cube.name, str(error)) from None
    return Reduction(scene, cube.shape[2], values.no_data, values.negative)


def _relit(cube: SpectralCube, said: ReadOptions) -> bool:
    """Whether the light wanted is another than the one the file says."""
    return said.illuminant is not None and cube.light is not None


def _meaning(
    cube: SpectralCube, said: ReadOptions, grid: Array, order: NDArray[np.intp]
) -> tuple[Array, Array, Array | None]:
    """(bands,) factors from values to the space that is reduced, from there to photons, and the light.

    Radiance is reduced as photons; reflectance as itself, so that it stays exact under any light.
    """
    ones = np.ones(grid.size)
    light = None if cube.light is None else np.asarray(cube.light, np.float64)[order]
    if cube.quantity == "reflectance":
        if light is None:
            if said.illuminant is None:
                raise FileError(
                    cube.name,
                    "holds reflectances; say the light on them (illuminant='D65', mean_luminance_cd_m2=100)",
                )
            if said.mean_luminance_cd_m2 is None:
                raise FileError(cube.name, "holds reflectances; say how bright they are lit (mean_luminance_cd_m2=100)")
            try:
                light = photons_from_energy(relative_energy(said.illuminant, grid), grid)
            except InputError as error:
                raise FileError(cube.name, str(error)) from None
        return ones, light, light
    if said.illuminant is not None and light is None:
        raise FileError(
            cube.name,
            "holds radiance under a light that it does not say, so its light cannot be changed; leave the illuminant "
            "out, or say units='reflectance' if that is what it holds",
        )
    if cube.quantity == "relative" and said.mean_luminance_cd_m2 is None:
        raise FileError(
            cube.name,
            "holds relative values; say how bright the scene is (mean_luminance_cd_m2=100) or the units of its values",
        )
    return (ones if cube.quantity == "photon radiance" else photons_from_energy(ones, grid)), ones, light


def _reflectance(cube: SpectralCube, spectra: Array, light: Array | None) -> Array | None:
    if cube.quantity == "reflectance":
        return spectra
    if light is None or cube.quantity == "relative" or not (light > 0).all():
        return None
    return spectra / light


def _scale(cube: SpectralCube, mean: Array, grid: Array, wanted: float) -> float:
    now = float(luminance_cd_m2(mean, grid))
    if now <= 0:
        raise FileError(cube.name, "is dark, and cannot be given a luminance; leave mean_luminance_cd_m2 out")
    return wanted / now


class _Values:
    """The values of a cube, checked, and its two passes."""

    def __init__(self, cube: SpectralCube, said: ReadOptions, order: NDArray[np.intp], progress: Progress) -> None:
        self._cube, self._said, self._order, self._progress = cube, said, order, progress
        rows, cols, bands = cube.shape
        self._rows = max(1, min(rows, _BLOCK_BYTES // (8 * cols * bands)))
        self._done = 0
        self.samples = rows * cols
        self.no_data = self.negative = 0

    def sums(self) -> tuple[Array, Array]:
        """Gram matrix (bands, bands) of all samples, and their sum (bands,); bands in order of wavelength."""
        bands = self._cube.shape[2]
        gram, total = np.zeros((bands, bands)), np.zeros(bands)
        largest, bright = 0.0, 0
        for _, block in self._blocks(count=True):
            if self._cube.quantity == "reflectance":
                largest, bright = max(largest, float(block.max())), bright + bright_count(block)
            spectra = _by_band(block)
            with np.errstate(over="ignore"):
                gram += spectra @ spectra.T  # NumPy sees the transpose and computes one half
                total += spectra.sum(axis=1)
        check_reflectances(self._cube.name, largest, bright, self.samples * bands)
        if not np.trace(gram) < _LARGEST_POWER:
            raise FileError(self._cube.name, "has values far larger than any light's; are its units right?")
        return gram[np.ix_(self._order, self._order)], total[self._order]

    def project(
        self, vectors: Array, spectra: Array, photons: Array, store: Callable[[tuple[int, int, int]], WeightStore]
    ) -> tuple[NDArray[np.float32], float]:
        """Weights (K, rows, cols), and the sum of squares of what they lack of the radiance.

        `vectors` (K, bands) take values to weights, `spectra` weights to values, `photons` (bands,) values to radiance.
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
                lacking = spectra @ weights.astype(np.float64)
                lacking -= values
                lost += np.einsum("bs,bs->b", lacking, lacking)
            return place.finish(), float(lost @ photons[back] ** 2)

    def _blocks(self, *, count: bool = False) -> Iterator[tuple[int, Array]]:
        """The blocks, with what is missing or below 0 refused or made 0."""
        total = 2 * self._cube.shape[0]
        for first, block in self._read():
            if count or self.no_data or self.negative:  # the second pass over what is clean need not look again
                # A sum is NaN or infinite where a value is, and costs one look; it is too where it grows too large.
                with np.errstate(over="ignore", invalid="ignore"):
                    doubtful = not np.isfinite(block.sum())
                if doubtful:
                    block = self._without_gaps(first, block, count)
                if block.min() < 0:
                    block = self._not_negative(first, block, count)
            yield first, block
            self._done += block.shape[0]
            self._progress(self._done, total, "rows")

    def _read(self) -> Iterator[tuple[int, Array]]:
        try:
            yield from self._cube.blocks(self._rows)
        except OSError as error:
            raise FileError(self._cube.name, f"cannot be read: {error.strerror or error}") from None

    def _without_gaps(self, first: int, block: Array, count: bool) -> Array:
        endless, gaps = np.isinf(block), np.isnan(block)
        if endless.any():
            raise FileError(
                self._cube.name,
                f"has an infinite value {self._place(endless, first)}; mend the file: put the value there, or NaN for "
                "none",
            )
        if self._said.no_data == "refuse" and gaps.any():
            raise FileError(
                self._cube.name,
                f"has no data {self._place(gaps, first)} (NaN, or the file's mark); mend the file, or say that what is "
                "missing be taken as 0 (no_data='zero')",
            )
        self.no_data += int(gaps.sum()) if count else 0
        return np.where(gaps, 0.0, block)

    def _not_negative(self, first: int, block: Array, count: bool) -> Array:
        below = block < 0
        if self._said.negative == "refuse":
            worst = f"{block.min():g} beside at most {block.max():g}"
            raise FileError(
                self._cube.name,
                f"has negative values ({worst}), the first {self._place(below, first)}; mend the file, or say that "
                "they be taken as 0 (negative='zero')",
            )
        self.negative += int(below.sum()) if count else 0
        return np.where(below, 0.0, block)

    def _place(self, where: NDArray[np.bool_], first: int) -> str:
        row, col, band = np.argwhere(where)[0]
        return f"at row {first + row}, column {col}, band {band + 1} ({self._cube.wavelength_nm[band]:g} nm)"


def _by_band(block: Array) -> Array:
    """(bands, samples) of (n, cols, bands), without a copy where bands or samples lie together."""
    by_band = np.moveaxis(block, 2, 0)
    bands = by_band.shape[0]
    if by_band.flags.c_contiguous:
        return by_band.reshape(bands, -1)
    return np.asarray(block.reshape(-1, bands).T)
