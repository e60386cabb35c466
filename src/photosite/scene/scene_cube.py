"""Scenes from cubes, as the options of reading ask for, and cubes of scenes, which cube files are written from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import photons_from_energy
from photosite.errors import FileError, InputError
from photosite.scene.cube import Array, Block, SpectralCube, band_order, within_range
from photosite.scene.options import ReadOptions
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.weights import Progress, WeightStore, reduce_to_components, temporary_store

_BLOCK_SAMPLES = 1 << 22
_ROUNDING = 1e-6
"""Relative to the RMS radiance: the negative radiance that single-precision weights may leave."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """A cube as a scene, and how it was reduced.

    Parameters
    ----------
    scene
        The scene; `scene.relative_error` is the error that the second pass measured.
    bands
        Of the cube.
    no_data_values, negative_values
        Values that were replaced by 0, as the options allowed.
    reduced
        False where the file held a scene, which is kept.
    """

    scene: Scene
    bands: int
    no_data_values: int = 0
    negative_values: int = 0
    reduced: bool = True

    @property
    def components(self) -> int:
        """Number of basis spectra of the scene."""
        return len(self.scene.basis)


def reduce_cube(
    cube: SpectralCube,
    options: ReadOptions | None = None,
    *,
    store: Callable[[tuple[int, int, int]], WeightStore] = temporary_store,
    progress: Progress | None = None,
) -> Reduction:
    """Reduce a cube to a scene of the fewest basis spectra that keep its radiance to the tolerance.

    Parameters
    ----------
    cube, options
        The cube, and how to read it.
    store
        Makes the store of the weights (K, rows, cols): in memory, or in a file where they are large.
    progress
        Called with the rows done, in both passes together.

    Raises
    ------
    FileError
        If values are missing or negative, or bands are not sorted, and the options do not allow it; or if the light or
        the luminance that turns values into radiance is missing.

    Examples
    --------
    >>> from photosite.scene.cube import ArrayCube
    >>> values = np.linspace(0, 1, 6)[:, None, None] * np.ones((6, 8, 31))
    >>> grid = np.arange(400.0, 701, 10)
    >>> cube = ArrayCube(name="ramp", shape=values.shape, wavelength_nm=grid, quantity="reflectance", values=values)
    >>> scene = reduce_cube(cube, ReadOptions(illuminant="D65", mean_luminance_cd_m2=100)).scene
    >>> scene.weights.shape, round(scene.mean_luminance_cd_m2(), 4)
    ((1, 6, 8), 100.0)
    """
    options = options or ReadOptions()
    order = band_order(cube.name, cube.wavelength_nm, sort=options.sort_bands)
    grid = np.asarray(cube.wavelength_nm, np.float64)[order]
    to_space, to_photons, light = _factors(cube, options, grid, order)
    relit = options.illuminant is not None and cube.light is not None
    wanted = None if relit else options.mean_luminance_cd_m2
    parts = reduce_to_components(
        cube,
        order,
        options,
        to_space,
        to_photons,
        scale=lambda mean: 1.0 if wanted is None else _scale(cube, mean, grid, wanted),
        store=store,
        progress=progress,
    )
    scene = Scene(
        parts.weights,
        parts.spectra * parts.to_photons,
        grid,
        options.distance_m or cube.distance_m or DEFAULT_DISTANCE_M,
        options.width_m or cube.width_m,
        name=cube.title or "scene",
        reflectance=_reflectance(cube, parts.spectra, None if light is None else light * parts.scale),
        relative_error=parts.relative_error,
    )
    if options.illuminant is not None and cube.light is not None:
        try:
            scene = scene.with_illuminant(options.illuminant, options.mean_luminance_cd_m2)
        except InputError as error:
            raise error.in_file(cube.name) from None
    return Reduction(scene, cube.shape[2], parts.no_data_values, parts.negative_values)


def _factors(
    cube: SpectralCube, options: ReadOptions, grid: Array, order: NDArray[np.intp]
) -> tuple[Array, Array, Array | None]:
    """(bands,) factors from values to the space that is reduced, from there to photons, and the light.

    Radiance is reduced as photons; reflectance as itself, so that it stays exact under any light.
    """
    ones = np.ones(grid.size)
    light = None if cube.light is None else np.asarray(cube.light, np.float64)[order]
    if cube.quantity == "reflectance":
        if light is None:
            options.require(cube.name, "holds reflectances", illuminant="D65", mean_luminance_cd_m2=100)
            assert options.illuminant is not None
            try:
                light = photons_from_energy(relative_energy(options.illuminant, grid), grid)
            except InputError as error:
                raise error.in_file(cube.name) from None
        return ones, light, light
    if options.illuminant is not None and light is None:
        what = "holds radiance under an unknown light, so its light cannot be changed"
        hint = "Omit {illuminant}, or pass {units} if the values are reflectances"
        arguments = {"illuminant": options.illuminant, "units": "reflectance"}
        raise FileError(cube.name, what, hint=hint, arguments=arguments)
    if cube.quantity == "relative":
        options.require(cube.name, "holds relative values", ", or the units of the values", mean_luminance_cd_m2=100)
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
        what, hint = "is dark, so it cannot be scaled to a luminance", "Omit {mean_luminance_cd_m2}"
        raise FileError(cube.name, what, hint=hint, arguments={"mean_luminance_cd_m2": wanted})
    return wanted / now


def apply_options(scene: Scene, options: ReadOptions) -> Scene:
    """Return a scene with the bands, distance, light and luminance that the options ask for."""
    scene = _within_bands(scene, options)
    if options.distance_m is not None or options.width_m is not None:
        distance_m, width_m = options.distance_m or scene.distance_m, options.width_m or scene.width_m
        scene = replace(scene, distance_m=distance_m, width_m=width_m)
    if options.illuminant is not None:
        scene = scene.with_illuminant(options.illuminant)
    wanted = options.mean_luminance_cd_m2
    return scene if wanted is None else scene.with_mean_luminance(wanted)


def _within_bands(scene: Scene, options: ReadOptions) -> Scene:
    """The scene at the wanted wavelengths; its error is the largest possible there."""
    wanted = within_range(scene.wavelength_nm, options.band_range_nm)
    if wanted.all():
        return scene
    if not wanted.any():
        first, last = scene.wavelength_nm[[0, -1]]
        expected = f"a range with bands, within {first:g} to {last:g} nm"
        raise InputError("band_range_nm", value=options.band_range_nm, expected=expected)
    basis, reflectance, error = scene.basis[:, wanted], scene.reflectance, scene.relative_error
    if error > 0:
        rows, cols = scene.shape
        step = max(1, _BLOCK_SAMPLES // (cols * len(basis)))
        gram = np.zeros((len(basis), len(basis)))
        for first in range(0, rows, step):
            part = scene.weights[:, first : first + step].astype(np.float64).reshape(len(basis), -1)
            gram += part @ part.T
        whole, left = (float(np.einsum("kl,kw,lw->", gram, spectra, spectra)) for spectra in (scene.basis, basis))
        error = error * math.sqrt(whole / left) if left > 0 else 0.0
    reflectance = None if reflectance is None else reflectance[:, wanted]
    grid = scene.wavelength_nm[wanted]
    return replace(scene, basis=basis, wavelength_nm=grid, reflectance=reflectance, relative_error=error)


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneCube(SpectralCube):
    """The photon radiance of a scene as a cube.

    Negative radiance, which the reduction to few basis spectra can leave, is written as 0: the original had none.
    """

    scene: Scene

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`; `InputError` at the end if more radiance is below 0 than the scene's error explains."""
        below = power = 0.0
        for first in range(0, self.shape[0], rows):
            weights = self.scene.weights[:, first : first + rows].astype(np.float64)
            radiance = np.tensordot(self.scene.basis.T, weights, axes=1)
            power += float(np.vdot(radiance, radiance))
            negative = np.minimum(radiance, 0.0)
            below += float(np.vdot(negative, negative))
            yield first, np.moveaxis(np.maximum(radiance, 0.0, out=radiance), 0, 2)
        if below > (self.scene.relative_error + _ROUNDING) ** 2 * power:
            what = f"the scene '{self.name}' has negative radiance, of {np.sqrt(below / power):.1e} of its RMS"
            raise InputError(what, hint="Make weights and basis whose products are 0 or more")


def cube_of_scene(scene: Scene) -> SceneCube:
    """Return the scene's photon radiance as a cube.

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
