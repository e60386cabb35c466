"""Several lights on one scene, each with its own spread over the field: a window on the left, a lamp on the right."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, Spectrum, photons_from_energy
from photosite.color.tristimulus import luminance_cd_m2
from photosite.errors import InputError
from photosite.scene.reduction import principal_spectra
from photosite.scene.scene import Scene

Array = NDArray[np.float64]
Spread = Callable[[Array, Array], Array]
"""How much of a light falls where: a function of the shares of the height and of the width, 0 to 1, that broadcast."""

Light = tuple[str | float | Spectrum, float, ArrayLike | Spread | None]
"""An illuminant; the luminance, in cd/m2, of a perfect white in it where its spread is 1; its spread, None for even."""

_BLOCK_SAMPLES = 1 << 20


def gradient(start: float = 1.0, end: float = 0.0, direction_deg: float = 0.0) -> Spread:
    """Light that changes evenly across the field.

    Parameters
    ----------
    start, end
        Shares of the light at the two ends, 0 or more.
    direction_deg
        From start to end: 0 to the right, 90 down. The ends are the field's borders or corners in that direction.

    Raises
    ------
    InputError
        If a share is negative or a value is not finite.

    Examples
    --------
    >>> gradient(1.0, 0.0)(np.array([[0.5]]), np.array([[0.0, 0.25, 1.0]]))
    array([[1.  , 0.75, 0.  ]])
    """
    if not (0 <= start < math.inf and 0 <= end < math.inf and math.isfinite(direction_deg)):
        raise InputError(f"a gradient runs between shares of 0 or more, not from {start} to {end}")
    turn = math.radians(direction_deg)
    along, down = math.cos(turn), math.sin(turn)
    reach = abs(along) + abs(down)

    def share(y: Array, x: Array) -> Array:
        way = 0.5 + (along * (x - 0.5) + down * (y - 0.5)) / reach
        return start + (end - start) * way

    return share


def spot(row: float = 0.5, col: float = 0.5, radius: float = 0.25) -> Spread:
    """Light that falls off like a Gaussian round a place.

    Parameters
    ----------
    row, col
        Of the brightest place, in shares of the height and of the width.
    radius
        Where it has fallen to one half, in the same shares, above 0.

    Raises
    ------
    InputError
        If the radius is not above 0 or a value is not finite.

    Examples
    --------
    >>> float(spot(0.5, 0.5, 0.2)(np.array([0.7]), np.array([0.5]))[0].round(6))
    0.5
    """
    if not (math.isfinite(row) and math.isfinite(col) and 0 < radius < math.inf):
        raise InputError(f"a spot has a place and a radius above 0, not {row}, {col} and {radius}")

    def share(y: Array, x: Array) -> Array:
        return np.exp2(-((y - row) ** 2 + (x - col) ** 2) / radius**2)

    return share


def mixed(scene: Scene, lights: Sequence[Light], *, tolerance: float = 1e-4, rule: Rule = "trapezoid") -> Scene:
    """A scene whose reflectances are known, under several lights at once.

    Parameters
    ----------
    scene
        Its own light is put out.
    lights
        For each: what `photosite.color.illuminants.illuminant` takes; the luminance, in cd/m2, of a perfect white in
        this light
        alone where its spread is 1; and its spread over the field, 0 or more: an array (rows, cols), a function such as
        `gradient` or `spot` give, or None for even light.
    tolerance
        Largest RMS error of the radiance relative to its RMS, where fewer spectra than reflectances times lights do.
    rule
        Integration rule of the luminance.

    Returns
    -------
    Scene
        Without reflectance, since no one light falls on it.

    Raises
    ------
    InputError
        If the scene's reflectance is not known, there is no light, or one of them cannot be.

    Notes
    -----
    The radiance is the sum over lights l and reflectances k of spread_l weights_k x (reflectance_k light_l): weights
    times basis again, and exact. What is kept of that is found by singular value decomposition.

    Examples
    --------
    >>> from photosite.scene.charts import macbeth
    >>> room = mixed(macbeth(), [("daylight 6500", 200.0, gradient(1, 0)), ("A", 60.0, gradient(0, 1))])
    >>> room.shape, room.reflectance is None
    ((132, 196), True)
    """
    if scene.reflectance is None:
        raise InputError(
            f"the reflectances in '{scene.name}' are not known, so it cannot be lit anew; "
            "use a scene made from reflectances, such as a chart or a picture under one light"
        )
    if not 0 < tolerance < 1:
        raise InputError(f"the tolerance is a fraction of the RMS radiance, between 0 and 1, not {tolerance}")
    if not lights:
        raise InputError("a scene is lit by one light or more; none is given")
    for light in lights:
        if not isinstance(light, tuple | list) or len(light) != 3:
            raise InputError(f"a light is (illuminant, luminance in cd/m2, spread or None), not {light!r:.60}")
    spectra = np.stack([_white(light, luminance, scene, rule) for light, luminance, _ in lights])
    spreads = np.stack([_spread(spread, scene.shape, number) for number, (*_, spread) in enumerate(lights, start=1)])
    # (lights x K, wavelengths), in the order in which _parts gives their weights.
    basis = (spectra[:, None, :] * scene.reflectance[None]).reshape(-1, spectra.shape[1])
    gram = np.zeros((len(basis), len(basis)))
    for _, parts in _parts(scene, spreads):
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
    for rows, parts in _parts(scene, spreads):
        weights[:, rows] = (to_few @ parts).reshape(len(few), -1, scene.shape[1])
    return replace(
        scene,
        weights=weights,
        basis=few,
        reflectance=None,
        relative_error=math.hypot(scene.relative_error, math.sqrt(lost)),
        name=f"{scene.name}, lit anew by {len(lights)} lights",
    )


def _white(light: str | float | Spectrum, luminance: float, scene: Scene, rule: Rule) -> Array:
    """(wavelengths,) photons/s/sr/m2/nm from a perfect white of the given luminance."""
    if not 0 <= luminance < math.inf:
        raise InputError(f"a light's luminance is 0 cd/m2 or more, not {luminance}")
    photons = photons_from_energy(relative_energy(light, scene.wavelength_nm), scene.wavelength_nm)
    now = float(luminance_cd_m2(photons, scene.wavelength_nm, rule))
    if now <= 0:
        raise InputError("a light that the eye does not see at the scene's wavelengths cannot be given a luminance")
    return photons * (luminance / now)


def _spread(spread: ArrayLike | Spread | None, shape: tuple[int, int], number: int) -> NDArray[np.float32]:
    rows, cols = shape
    if spread is None:
        return np.ones(shape, np.float32)
    if callable(spread):
        share = spread((np.arange(rows)[:, None] + 0.5) / rows, (np.arange(cols)[None, :] + 0.5) / cols)
    else:
        share = np.asarray(spread, dtype=np.float64)
        if share.shape != shape:
            raise InputError(f"the spread of light {number} is (rows, cols) = {shape} as the scene, not {share.shape}")
    share = np.broadcast_to(np.asarray(share, dtype=np.float64), shape)
    if not ((share >= 0) & np.isfinite(share)).all():
        raise InputError(f"the spread of light {number} is 0 or more everywhere; somewhere it is not")
    return share.astype(np.float32)


def _parts(scene: Scene, spreads: NDArray[np.float32]) -> Iterator[tuple[slice, Array]]:
    """Rows of the scene, some at a time, and (lights x K, samples) weights there."""
    rows, cols = scene.shape
    step = max(1, _BLOCK_SAMPLES // (cols * len(spreads) * len(scene.basis)))
    for first in range(0, rows, step):
        here = slice(first, min(first + step, rows))
        weights = scene.weights[:, here].astype(np.float64)
        yield here, (spreads[:, None, here] * weights[None]).reshape(len(spreads) * len(weights), -1)
