"""The radiance of a scene, sample by sample, as a cube: what cube files are written from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from photosite.errors import InputError
from photosite.scene.cube import Block, CubeHead
from photosite.scene.scene import Scene

_ROUNDING = 1e-6
"""Relative to the RMS radiance: the negative radiance that single-precision weights may leave."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneCube(CubeHead):
    """The photon radiance of a scene as a cube.

    Negative radiance, which the reduction to few basis spectra can leave, is written as 0: the original had none.

    Parameters
    ----------
    scene
        The scene.
    """

    scene: Scene

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `photosite.scene.cube.SpectralCube`.

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
                f"the scene '{self.name}' has negative radiance, of {np.sqrt(below / power):.1e} of its RMS",
                hint="Make weights and basis whose products are 0 or more",
            )


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
