"""Preview of a scene for the standard observer, without a camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import colour_science, xyz
from photosite.errors import InputError
from photosite.scene.scene import Scene

_STRIP = 256


def tristimulus(scene: Scene) -> NDArray[np.float32]:
    """Return the CIE 1931 tristimulus values (rows, cols, 3) of every sample, Y in cd/m2.

    Examples
    --------
    >>> from photosite.scene import charts
    >>> round(float(tristimulus(charts.uniform("A", 40))[0, 0, 1]), 4)
    40.0
    """
    of_basis = xyz(scene.basis, scene.wavelength_nm)  # (K, 3)
    rows, cols = scene.shape
    values = np.empty((rows, cols, 3), np.float32)
    for first in range(0, rows, _STRIP):
        strip = scene.weights[:, first : first + _STRIP].astype(np.float64)
        values[first : first + _STRIP] = np.tensordot(strip, of_basis, axes=(0, 0))
    return values


def preview(
    scene: Scene, white_cd_m2: float | None = None, *, white_xy: tuple[float, float] | None = None
) -> NDArray[np.float32]:
    """Return display sRGB (rows, cols, 3), 0 to 1, of a scene as an eye adapted to its light would see it.

    Parameters
    ----------
    scene
        The scene.
    white_cd_m2
        Luminance of display white; brighter samples are white too. None: that of the brightest 1 % of samples, or of
        the brightest one where these are dark.
    white_xy
        Chromaticity of display white, by von Kries adaptation in CAT02. None: that of the scene's light, or of its mean
        where the light is not known.

    Notes
    -----
    Colors outside sRGB and light above white are clipped.

    Examples
    --------
    >>> from photosite.scene import charts
    >>> gray = preview(charts.uniform("A", 40), white_cd_m2=80)
    >>> gray.shape, bool(np.ptp(gray) < 2e-3)
    ((1, 1, 3), True)
    """
    colour = colour_science()
    values = tristimulus(scene)
    luminance = values[..., 1]
    white = float(np.quantile(luminance, 0.99) or luminance.max()) if white_cd_m2 is None else white_cd_m2
    if not white > 0:
        raise InputError("white_cd_m2", value=white, expected="above 0; the scene is dark")
    adapted = _adapted_to(scene, values) if white_xy is None else colour.xy_to_XYZ(white_xy)
    d65 = colour.xy_to_XYZ(colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"])
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(adapted / adapted[1], d65, transform="CAT02")
    to_rgb = (colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ adapt / white).astype(np.float32)
    linear = np.clip(values @ to_rgb.T, 0.0, 1.0)
    return np.asarray(colour.models.eotf_inverse_sRGB(linear), np.float32)


def _adapted_to(scene: Scene, values: NDArray[np.float32]) -> NDArray[np.float64]:
    """(3,) tristimulus values of the scene's light, where it is known and visible; else of the mean sample."""
    if scene.reflectance is not None:
        light = xyz(scene.light(), scene.wavelength_nm)
        if light.min() > 0:
            return light
    mean: NDArray[np.float64] = values.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    return mean
