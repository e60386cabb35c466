"""A scene in depth: planes one behind another, each with its opacity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.scene.polarization import Polarization
from photosite.scene.scene import Scene
from photosite.values.region import Region
from photosite.values.shown import Shown


@dataclass(frozen=True, eq=False)
class Plane(Shown):
    """A scene at its distance, with its opacity.

    Parameters
    ----------
    scene
        Its light, as if it were opaque; its `distance_m` is the plane's, its `width_m` the plane's width.
    alpha
        (rows, cols) of the scene's samples: 1 where it is opaque, 0 where it is transparent; between, the fraction of a
        sample that is covered. None: 1 everywhere.

    Examples
    --------
    >>> import photosite as ps
    >>> leaf = ps.charts.uniform("D65", 100, distance_m=1.0, width_m=0.1)
    >>> Plane(leaf, [[0.5]]).alpha.dtype, Plane(leaf).alpha is None
    (dtype('float32'), True)
    """

    scene: Scene
    alpha: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.alpha is None:
            return
        alpha = np.asarray(self.alpha, np.float32)
        if alpha.shape != self.scene.shape:
            raise InputError("alpha", value=alpha.shape, expected=f"of the scene's shape {self.scene.shape}")
        if not ((alpha >= 0) & (alpha <= 1)).all():
            ends = (float(alpha.min()), float(alpha.max()))
            raise InputError("alpha", value=ends, expected="from 0 to 1", hint="Divide 8-bit values by 255")
        object.__setattr__(self, "alpha", alpha)

    def mean_radiance(self) -> NDArray[np.float64]:
        """Return the mean photon radiance (wavelengths,) of all samples, times their opacity."""
        weights = self.scene.weights
        if self.alpha is None:
            means = weights.mean(axis=(1, 2), dtype=np.float64)
        else:
            means = np.einsum("krc,rc->k", weights, self.alpha, dtype=np.float64) / self.alpha.size
        radiance: NDArray[np.float64] = means @ self.scene.basis
        return radiance

    def light(self, ends: bool) -> Scene:
        """Return radiance times alpha as a scene. With `ends`, it is dark outside its border."""
        weights = self.scene.weights if self.alpha is None else self.scene.weights * self.alpha
        return _laid_out(self.scene, weights, ends)

    def cover(self, ends: bool, spectrum: NDArray[np.float64], wavelength_nm: NDArray[np.float64]) -> Scene:
        """Return alpha as a scene of one spectrum."""
        alpha = np.ones(self.scene.shape, np.float32) if self.alpha is None else self.alpha
        plain = Scene(alpha[None], spectrum[None], wavelength_nm, self.scene.distance_m, self.scene.width_m)
        return _laid_out(plain, plain.weights, ends)


def _laid_out(scene: Scene, weights: NDArray[np.float32], ends: bool) -> Scene:
    """The scene with other weights; if it ends at its border, with a border of dark samples, which repeats."""
    width_m, cols = scene.width_m, scene.shape[1]
    if not ends or width_m is None:
        return replace(scene, weights=weights, regions=())
    rim = np.pad(weights, ((0, 0), (1, 1), (1, 1)))
    seen = scene.polarization
    if seen is not None and seen.shape:
        seen = Polarization(np.pad(seen.degree, 1), np.pad(seen.angle_deg, 1))
    return replace(scene, weights=rim, width_m=width_m * (cols + 2) / cols, regions=(), polarization=seen)


@dataclass(frozen=True, eq=False)
class Planes(Shown):
    """A scene in depth.

    Parameters
    ----------
    planes
        Near to far; a `Scene` among them is an opaque plane. The farthest repeats its border samples outside it.
        A nearer one with a width ends there; one without a width fills the frame, and repeats its border samples.
    name
        Name of the scene.

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
            raise InputError("planes", expected="a sequence, near to far", hint="Write Planes((near, far))")
        planes = tuple(Plane(plane) if isinstance(plane, Scene) else plane for plane in self.planes)
        if not planes or not all(isinstance(plane, Plane) for plane in planes):
            raise InputError("planes", expected="one or more of Plane and Scene, near to far")
        distances = [plane.scene.distance_m for plane in planes]
        for near, far in pairwise(distances):
            if near > far:
                raise InputError("planes", value=(near, far), expected="in order of distance, near to far")
        object.__setattr__(self, "planes", planes)

    @property
    def regions(self) -> tuple[Region, ...]:
        """Named rectangles of all planes, near to far, each in the samples of its plane."""
        return tuple(region for plane in self.planes for region in plane.scene.regions)
