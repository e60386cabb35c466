"""Colors of a ColorChecker with known errors, judged by colour-science."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import D65_XY, SRGB_FROM_XYZ, colour_science
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_patches import color_checker

Array = NDArray[np.float64]


@cache
def reference() -> Array:
    """Return the (24, 3) XYZ of the chart under D65, relative to white, by colour-science."""
    colour, chart = colour_science(), color_checker()
    xyz, white = (each / chart.white_xyz[1] for each in (chart.patch_xyz, chart.white_xyz))
    adapted: Array = colour.chromatic_adaptation(xyz, white, colour.xy_to_XYZ(D65_XY), transform="Bradford")
    return adapted


def picture(xyz: Array) -> Array:
    """Return linear sRGB of patches on a dark ground."""
    chart = color_checker()
    image = np.full((*chart.shape, 3), 0.05)
    for patch, color in zip(chart.patches, xyz @ SRGB_FROM_XYZ.T, strict=True):
        image[patch.r0 - 4 : patch.r1 + 4, patch.c0 - 4 : patch.c1 + 4] = color
    return image


def color_errors(xyz: Array) -> dict[str, float]:
    """Return figures of colors, by colour-science alone."""
    colour = colour_science()
    ours, true = (colour.XYZ_to_Lab(each, np.array(D65_XY)) for each in (xyz, reference()))
    found: dict[str, float] = {}
    for name, method in (("76", "CIE 1976"), ("94", "CIE 1994"), ("2000", "CIE 2000")):
        values = colour.delta_E(true, ours, method=method)
        found |= {f"delta_e_{name}_mean": values.mean(), f"delta_e_{name}_max": values.max()}
    values = colour.delta_E(*(colour.XYZ_to_ICtCp(100.0 * each) for each in (reference(), xyz)), method="ITP")
    found |= {"delta_e_itp_mean": values.mean(), "delta_e_itp_max": values.max()}
    chroma, true_chroma = (colour.models.Jab_to_JCh(each)[..., 1] for each in (ours, true))
    found["lightness_error_rms"] = np.sqrt(np.mean((ours - true)[:, 0] ** 2))
    found["chroma_error_rms"] = np.sqrt(np.mean((chroma - true_chroma) ** 2))
    found["saturation_percent"] = 100.0 * chroma.mean() / true_chroma.mean()
    found["white_balance_error"] = np.linalg.norm((ours - true)[18:, 1:], axis=1).mean()
    return {name: float(value) for name, value in found.items()}


def with_errors(random: np.random.Generator) -> Array:
    """Return the chart's colors with random errors of a matrix and of each patch."""
    return reference() @ (np.eye(3) + random.normal(0.0, 0.02, (3, 3))) * (1.0 + random.normal(0.0, 0.02, (24, 3)))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    xyz, noise = with_errors(random), 10 ** random.uniform(-2.7, -1.5)
    clean = picture(xyz)
    drawn = random.normal(0.0, noise, (clean.shape[0] + 1, clean.shape[1] + 1, 3))
    alike = (drawn[1:, 1:] + drawn[:-1, 1:] + drawn[1:, :-1] + drawn[:-1, :-1]) / 2.0
    truth = {(name, ""): value for name, value in color_errors(xyz).items()}
    return HiddenChart(clean + alike, "macbeth", truth, {"match_exposure": False})


STUDY = MeasurementStudy(_draw, "pictures with errors of 2 %, noise of 0.2 to 3 % of white that is alike in neighbors")
