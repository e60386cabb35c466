"""Several lights on one scene, each with its own distribution over the field."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, Spectrum, photons_from_energy
from photosite.errors import InputError
from photosite.scene.scene import Scene
from photosite.scene.weights import principal_spectra

__all__ = ["gradient", "mixed", "spot"]
__dir__ = __all__.copy

Array = NDArray[np.float64]
Distribution = Callable[[Array, Array], Array]
"""Distribution of a light: a function of the relative height and width, 0 to 1, which broadcast."""

Light = tuple[str | float | Spectrum, float, ArrayLike | Distribution | None]
"""An illuminant; the luminance in cd/m2 of a perfect white where its distribution is 1; the distribution or None."""

_BLOCK_SAMPLES = 1 << 20


def gradient(start: float = 1.0, end: float = 0.0, direction_deg: float = 0.0) -> Distribution:
    """Return light that changes linearly across the field.

    Parameters
    ----------
    start, end
        Relative light at the two ends, 0 or more.
    direction_deg
        From start to end: 0 to the right, 90 down. The ends are the field's borders or corners in that direction.

    Examples
    --------
    >>> gradient(1.0, 0.0)(np.array([[0.5]]), np.array([[0.0, 0.25, 1.0]]))
    array([[1.  , 0.75, 0.  ]])
    """
    if not (0 <= start < math.inf and 0 <= end < math.inf and math.isfinite(direction_deg)):
        expected = "three finite numbers, start and end 0 or more"
        raise InputError("start, end, direction_deg", value=(start, end, direction_deg), expected=expected)
    turn = math.radians(direction_deg)
    along, down = math.cos(turn), math.sin(turn)
    reach = abs(along) + abs(down)

    def fraction(y: Array, x: Array) -> Array:
        along_gradient = 0.5 + (along * (x - 0.5) + down * (y - 0.5)) / reach
        return start + (end - start) * along_gradient

    return fraction


def spot(row: float = 0.5, col: float = 0.5, radius: float = 0.25) -> Distribution:
    """Return light that decreases like a Gaussian around a point.

    Parameters
    ----------
    row, col
        Of the brightest point, relative to the height and the width.
    radius
        Distance where it is one half, in the same units, above 0.

    Examples
    --------
    >>> float(spot(0.5, 0.5, 0.2)(np.array([0.7]), np.array([0.5]))[0].round(6))
    0.5
    """
    if not (math.isfinite(row) and math.isfinite(col) and 0 < radius < math.inf):
        raise InputError("row, col, radius", value=(row, col, radius), expected="finite, with a radius above 0")

    def fraction(y: Array, x: Array) -> Array:
        return np.exp2(-((y - row) ** 2 + (x - col) ** 2) / radius**2)

    return fraction


def mixed(scene: Scene, lights: Sequence[Light], *, tolerance: float = 1e-4, rule: Rule = "trapezoid") -> Scene:
    """Return a scene of known reflectances under several lights.

    Parameters
    ----------
    scene
        The scene; its own light is replaced.
    lights
        For each: an illuminant as for `photosite.color.illuminants.illuminant`; the luminance, in cd/m2, of a perfect
        white in this light alone where its distribution is 1; and its distribution over the field, 0 or more: an array
        (rows, cols), a function such as those of `gradient` and `spot`, or None for even light.
    tolerance
        Largest RMS error of the radiance relative to its RMS, where fewer spectra suffice.
    rule
        Integration rule of the luminance.

    Returns
    -------
    Scene
        Without reflectance, since several lights fall on it.

    Raises
    ------
    InputError
        If the scene's reflectance is not known, or there is no light or an invalid one.

    Notes
    -----
    The radiance is the sum over lights l and reflectances k of spread_l weights_k x (reflectance_k light_l): weights
    times basis again, and exact. It is reduced by singular value decomposition.

    Examples
    --------
    >>> from photosite.scene.charts import macbeth
    >>> scene = mixed(macbeth(), [("daylight 6500", 200.0, gradient(1, 0)), ("A", 60.0, gradient(0, 1))])
    >>> scene.shape, scene.reflectance is None
    ((132, 196), True)
    """
    reflectance = scene.known_reflectance()
    if not 0 < tolerance < 1:
        raise InputError("tolerance", value=tolerance, expected="between 0 and 1")
    if not lights:
        raise InputError("lights", value=lights, expected="one or more")
    for light in lights:
        if not isinstance(light, tuple | list) or len(light) != 3:
            expected = "(illuminant, luminance in cd/m2, distribution or None) for each light"
            raise InputError("lights", value=light, expected=expected)
    spectra = np.stack([_white(light, luminance, scene, rule) for light, luminance, _ in lights])
    distributions = np.stack([_distribution(light[2], scene.shape, k) for k, light in enumerate(lights, start=1)])
    # (lights x K, wavelengths), in the order of the weights of _parts.
    basis = (spectra[:, None, :] * reflectance[None]).reshape(-1, spectra.shape[1])
    gram = np.zeros((len(basis), len(basis)))
    for _, parts in _parts(scene, distributions):
        gram += parts @ parts.T
    seen = basis.T @ gram @ basis
    vectors = principal_spectra(seen, tolerance)
    total = float(np.trace(seen))
    if len(vectors) >= len(basis) or total <= 0:
        to_few, few, lost = np.eye(len(basis)), basis, 0.0
    else:
        to_few, few = vectors @ basis.T, vectors
        lost = max(0.0, 1.0 - float(np.einsum("ki,ij,kj->", vectors, seen, vectors)) / total)  # below 0 by rounding
        scale = np.abs(to_few).max(axis=1, keepdims=True)
        to_few, few = to_few / scale, few * scale
    weights = np.empty((len(few), *scene.shape), np.float32)
    for rows, parts in _parts(scene, distributions):
        weights[:, rows] = (to_few @ parts).reshape(len(few), -1, scene.shape[1])
    error, name = math.hypot(scene.relative_error, math.sqrt(lost)), f"{scene.name}, under {len(lights)} lights"
    return replace(scene, weights=weights, basis=few, reflectance=None, relative_error=error, name=name)


def _white(light: str | float | Spectrum, luminance: float, scene: Scene, rule: Rule) -> Array:
    """(wavelengths,) photons/s/sr/m2/nm from a perfect white of the given luminance."""
    if not 0 <= luminance < math.inf:
        raise InputError("luminance_cd_m2", value=luminance, expected="0 or more")
    photons = photons_from_energy(relative_energy(light, scene.wavelength_nm), scene.wavelength_nm)
    now = float(luminance_cd_m2(photons, scene.wavelength_nm, rule))
    if now <= 0:
        raise InputError("a light is invisible at the scene's wavelengths, so it cannot be scaled to a luminance")
    return photons * (luminance / now)


def _distribution(
    distribution: ArrayLike | Distribution | None, shape: tuple[int, int], number: int
) -> NDArray[np.float32]:
    (rows, cols), where = shape, f"light {number}"
    if distribution is None:
        return np.ones(shape, np.float32)
    if callable(distribution):
        fraction = distribution((np.arange(rows)[:, None] + 0.5) / rows, (np.arange(cols)[None, :] + 0.5) / cols)
    else:
        fraction = np.asarray(distribution, dtype=np.float64)
        if fraction.shape != shape:
            raise InputError(
                "distribution", where=where, value=fraction.shape, expected=f"of the scene's shape {shape}"
            )
    fraction = np.broadcast_to(np.asarray(fraction, dtype=np.float64), shape)
    if not ((fraction >= 0) & np.isfinite(fraction)).all():
        raise InputError("distribution", where=where, expected="0 or more everywhere")
    return fraction.astype(np.float32)


def _parts(scene: Scene, distributions: NDArray[np.float32]) -> Iterator[tuple[slice, Array]]:
    """Blocks of rows of the scene, and their weights (lights x K, samples)."""
    rows, cols = scene.shape
    step = max(1, _BLOCK_SAMPLES // (cols * len(distributions) * len(scene.basis)))
    for first in range(0, rows, step):
        here = slice(first, min(first + step, rows))
        weights = scene.weights[:, here].astype(np.float64)
        yield here, (distributions[:, None, here] * weights[None]).reshape(len(distributions) * len(weights), -1)
