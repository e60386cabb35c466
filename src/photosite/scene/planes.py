"""A scene in depth: a few planes one behind another, each with how much it hides of what stands behind it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.scene.scene import Scene
from photosite.values.region import Region


@dataclass(frozen=True, eq=False)
class Plane:
    """A scene at its distance, and where it is opaque.

    Parameters
    ----------
    scene
        Its light, as if it were opaque; its `distance_m` is the plane's, its `width_m` the plane's width.
    alpha
        (rows, cols) of the scene's samples: 1 where it hides what is behind it, 0 where it is not there; between, the
        share of a sample that it covers. None: 1 everywhere.

    Raises
    ------
    InputError
        If alpha's shape is not the scene's, or a value is not from 0 to 1.
    """

    scene: Scene
    alpha: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.alpha is None:
            return
        alpha = np.asarray(self.alpha, np.float32)
        if alpha.shape != self.scene.shape:
            raise InputError(
                f"a plane's alpha has the scene's shape {self.scene.shape}, one value a sample, not {alpha.shape}"
            )
        if not ((alpha >= 0) & (alpha <= 1)).all():
            raise InputError(
                f"a plane's alpha is from 0 (not there) to 1 (opaque), not from {alpha.min():g} to {alpha.max():g}; "
                "divide 8-bit values by 255"
            )
        object.__setattr__(self, "alpha", alpha)

    def mean_radiance(self) -> NDArray[np.float64]:
        """(wavelengths,) photon radiance, mean over all samples, as far as it is there."""
        weights = self.scene.weights
        if self.alpha is None:
            means = weights.mean(axis=(1, 2), dtype=np.float64)
        else:
            means = np.einsum("krc,rc->k", weights, self.alpha, dtype=np.float64) / self.alpha.size
        radiance: NDArray[np.float64] = means @ self.scene.basis
        return radiance

    def light(self, ends: bool) -> Scene:
        """The plane's own light: radiance times alpha. With `ends`, dark beyond its border."""
        weights = self.scene.weights if self.alpha is None else self.scene.weights * self.alpha
        return _laid_out(self.scene, weights, ends)

    def cover(self, ends: bool, spectrum: NDArray[np.float64], wavelength_nm: NDArray[np.float64]) -> Scene:
        """Alpha as a scene of one spectrum."""
        alpha = np.ones(self.scene.shape, np.float32) if self.alpha is None else self.alpha
        plain = Scene(alpha[None], spectrum[None], wavelength_nm, self.scene.distance_m, self.scene.width_m)
        return _laid_out(plain, plain.weights, ends)


def _laid_out(scene: Scene, weights: NDArray[np.float32], ends: bool) -> Scene:
    """The scene with other weights; if it ends at its border, with a rim of dark samples, which then repeats."""
    width_m, cols = scene.width_m, scene.shape[1]
    if not ends or width_m is None:
        return replace(scene, weights=weights, regions=())
    rim = np.pad(weights, ((0, 0), (1, 1), (1, 1)))
    return replace(scene, weights=rim, width_m=width_m * (cols + 2) / cols, regions=())


@dataclass(frozen=True, eq=False)
class Planes:
    """What stands in front of the camera, in depth.

    Parameters
    ----------
    planes
        Near to far; a `Scene` among them is an opaque plane. The farthest repeats its border samples beyond its border.
        A nearer one that has a width ends there; one without a width fills the frame, and repeats its border samples.
    name
        What to call it.

    Raises
    ------
    InputError
        If there is none, or they are not ordered from near to far.

    Examples
    --------
    >>> grid = np.arange(400, 701, 10)
    >>> wall = Scene.uniform(np.full(31, 1e14), grid, distance_m=3)
    >>> post = Scene(np.ones((1, 8, 2), np.float32), np.full((1, 31), 5e14), grid, distance_m=1, width_m=0.05)
    >>> [plane.scene.distance_m for plane in Planes((post, wall)).planes]
    [1, 3]
    """

    planes: tuple[Plane, ...]
    name: str = "planes"

    def __post_init__(self) -> None:
        if isinstance(self.planes, Plane | Scene) or not isinstance(self.planes, Iterable):
            raise InputError("planes are several, near to far: Planes((near, far))")
        planes = tuple(Plane(plane) if isinstance(plane, Scene) else plane for plane in self.planes)
        if not planes or not all(isinstance(plane, Plane) for plane in planes):
            raise InputError("planes are one or more of Plane and Scene, near to far")
        distances = [plane.scene.distance_m for plane in planes]
        for near, far in pairwise(distances):
            if near > far:
                raise InputError(
                    f"planes stand in order from near to far; one at {near:g} m stands before one at {far:g} m: "
                    "swap them"
                )
        object.__setattr__(self, "planes", planes)

    @property
    def regions(self) -> tuple[Region, ...]:
        """Named rectangles of all planes, near to far, each in its own plane's samples."""
        return tuple(region for plane in self.planes for region in plane.scene.regions)
