"""Color differences between the patches of a chart in an image and the chart itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.color.colorimetry import (
    SRGB_FROM_XYZ,
    XYZ_FROM_SRGB,
    colour_science,
    delta_e_76,
    delta_e_94,
    delta_e_2000,
    encode_srgb,
    lab,
)
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.color.color_matrices import best_strength, fitted_xyz, white_balance_matrix
from photosite.metrics.color.patch_colors import PatchColors, patch_colors
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]

SATURATED_PATCHES = DiagnosticKind(
    "saturated-patches",
    "note",
    "Patches of a chart are saturated in a raw frame.",
    "The colors of saturated patches are not known; they are left out, and figures are those of the others.",
    "Expose less.",
    ("delta_e_*", "white_balance_error"),
    "Number of patches.",
)
CLIPPED_GRAY = DiagnosticKind(
    "clipped-gray-patches",
    "warning",
    "Gray patches of a picture are at the largest value.",
    "Their exposure and color are not known: differences, and the matched exposure, are those of clipped values.",
    "Expose less.",
    ("delta_e_*", "white_balance_error", "exposure_stops", "mean", "percentile_95"),
    "Number of patches.",
)
OFF_EXPOSURE = DiagnosticKind(
    "off-exposure",
    "note",
    "The gray patches of a picture are brighter or darker than those of the chart.",
    "Color differences are given for the matched exposure, unless the option match_exposure is off.",
    "None needed; expose the chart so that white is at its reflectance for figures as they are shown.",
    ("exposure_stops",),
    "Exposure in stops.",
)
_EXPOSURE_MATTERS = 0.15
_CLIPPED_FRACTION = 1e-3
_DRAWS, _SEED = 200, 17321
_OWN, _LEFT_OUT, _REGULARIZED = "matrix", "matrix, patch left out", "regularized, patch left out"


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    match_exposure: bool = True,
    white_luminance_cd_m2: Annotated[float, Field(gt=0)] = 100.0,
) -> Result:
    colors = patch_colors(image, chart)
    draws = np.concatenate([colors.mean[None], colors.draws(_DRAWS, _SEED)])  # the first is the measured one
    diagnostics: list[Diagnostic] = []
    values: dict[tuple[str, str], Estimate] = {}
    if image.origin == "picture":
        shown = draws @ XYZ_FROM_SRGB.T
        exposure = matched_exposure(shown, colors)
        values["exposure_stops", ""] = _signed(np.log2(exposure))
        if abs(stops := float(np.log2(exposure[0]))) > _EXPOSURE_MATTERS:
            diagnostics.append(OFF_EXPOSURE(f"gray patches are {stops:+.2f} stops from those of the chart", stops))
        diagnostics += clipped_gray(image, chart, colors)
        found = {"": shown / exposure[:, None, None] if match_exposure else shown}
    else:
        found = _by_matrices(colors, draws)
    if colors.saturated:
        text = f"saturated and left out: {', '.join(colors.saturated)}"
        diagnostics.append(SATURATED_PATCHES(text, len(colors.saturated)))
    for part, xyz in found.items():
        values |= {(name, part): value for name, value in _values(colors, xyz, white_luminance_cd_m2).items()}
    shown_part = _LEFT_OUT if _LEFT_OUT in found else ""
    return Result(values, _curves(colors, found, shown_part), (), tuple(diagnostics))


def clipped_gray(image: ChartImage, chart: PlacedChart, colors: PatchColors) -> tuple[Diagnostic, ...]:
    """Return the diagnostic of gray patches of a picture that are clipped, if any is."""
    clipped = [
        patch.name
        for patch, gray in zip(chart.patches, chart.gray, strict=True)
        if gray and max(image.saturated_fraction(patch, name) for name in colors.channels) > _CLIPPED_FRACTION
    ]
    return (CLIPPED_GRAY(f"clipped: {', '.join(clipped)}", len(clipped)),) if clipped else ()


def matched_exposure(xyz: Array, colors: PatchColors) -> Array:
    """Return the (draws,) luminances of the gray patches over those of the chart, by least squares."""
    gray = colors.gray if colors.gray.any() else np.ones_like(colors.gray)
    reference = colors.reference_xyz[gray, 1]
    return np.asarray(xyz[:, gray, 1] @ reference / (reference @ reference))


def _by_matrices(colors: PatchColors, draws: Array) -> dict[str, Array]:
    """Return XYZ of camera colors by the best matrix, by those without the patch, and by regularized ones."""
    reference = colors.reference_xyz
    own, left_out = fitted_xyz(draws, reference)
    found = {_OWN: own, _LEFT_OUT: left_out}
    prior = white_balance_matrix(colors.channels, colors.mean[colors.gray], reference[colors.gray])
    if prior is not None:
        strength = best_strength(draws, reference, prior)
        found[_REGULARIZED] = fitted_xyz(draws, reference, strength, prior)[1]
    return found


def _values(colors: PatchColors, xyz: Array, white_luminance_cd_m2: float) -> dict[str, Estimate]:
    reference = np.broadcast_to(colors.reference_xyz, xyz.shape)
    found: dict[str, Estimate] = {}
    differences: dict[str, Callable[[], Array]] = {
        "76": lambda: delta_e_76(reference, xyz),
        "94": lambda: delta_e_94(reference, xyz),
        "2000": lambda: delta_e_2000(reference, xyz),
        "itp": lambda: _delta_e_itp(reference, xyz, white_luminance_cd_m2),
    }
    for name, difference in differences.items():
        values = difference()
        found[f"delta_e_{name}_mean"] = _size(values.mean(axis=1))
        found[f"delta_e_{name}_max"] = _size(values.max(axis=1))
    true, seen = lab(colors.reference_xyz), lab(xyz)
    lightness, chroma, hue = splits(true, seen)
    for name, values in (("lightness", lightness), ("chroma", chroma), ("hue", hue)):
        found[f"{name}_error_rms"] = _size(np.sqrt(np.mean(values**2, axis=1)))
    if colors.gray.any():
        neutral = np.hypot(*np.moveaxis((seen - true)[:, colors.gray, 1:], -1, 0))
        found["white_balance_error"] = _size(neutral.mean(axis=1))
    mean_chroma = np.hypot(true[:, 1], true[:, 2]).mean()
    found["saturation_percent"] = _signed(100.0 * np.hypot(seen[..., 1], seen[..., 2]).mean(axis=1) / mean_chroma)
    return found


def splits(reference: Array, other: Array) -> tuple[Array, Array, Array]:
    """Return the differences of lightness, chroma and hue of (..., 3) Lab; their squares add up to that of CIE 1976.

    Examples
    --------
    >>> [round(float(part), 6) for part in splits(np.array([50.0, 3.0, 4.0]), np.array([52.0, 6.0, 8.0]))]
    [2.0, 5.0, 0.0]
    """
    lightness = other[..., 0] - reference[..., 0]
    chroma = np.hypot(other[..., 1], other[..., 2]) - np.hypot(reference[..., 1], reference[..., 2])
    squares = np.sum((other - reference)[..., 1:] ** 2, axis=-1) - chroma**2
    cross = reference[..., 1] * other[..., 2] - reference[..., 2] * other[..., 1]
    return lightness, chroma, np.sign(cross) * np.sqrt(np.clip(squares, 0.0, None))  # negative only by rounding


def _delta_e_itp(reference: Array, xyz: Array, white_luminance_cd_m2: float) -> Array:
    colour = colour_science()
    one, other = (colour.XYZ_to_ICtCp(white_luminance_cd_m2 * each) for each in (reference, xyz))
    return np.asarray(colour.delta_E(one, other, method="ITP"))


def _size(values: Array) -> Estimate:
    """Return the estimate of a size, which is 0 or above, from the measured value and draws with noise added to it.

    Noise adds its variance to the square: the draws exceed the measured square as that exceeds the true one.
    """
    square, spread = values[0] ** 2, values[1:] ** 2
    return Estimate.of_variance(Uncertain.of(float(2.0 * square - spread.mean()), float(spread.std())), "")


def _signed(values: Array) -> Estimate:
    return Estimate.of(Uncertain.of(float(2.0 * values[0] - values[1:].mean()), float(values[1:].std())), "")


def _curves(colors: PatchColors, found: dict[str, Array], shown: str) -> tuple[Curve, ...]:
    number = np.arange(1.0, len(colors.names) + 1.0)
    curves = []
    true, seen = lab(colors.reference_xyz), lab(found[shown][0])
    shades = np.rint(255.0 * encode_srgb((colors.reference_xyz @ SRGB_FROM_XYZ.T).astype(np.float32))).astype(int)
    for i, name in enumerate(colors.names):
        a, b = np.column_stack([true[i, 1:], seen[i, 1:]])
        color = "#" + "".join(f"{code:02x}" for code in shades[i])
        curves.append(Curve(name, "a*", "b*", a, b, ends=("chart", "image"), color=color))
    for part, xyz in found.items():
        difference = delta_e_2000(np.broadcast_to(colors.reference_xyz, xyz.shape), xyz)
        spread = difference[1:].std(axis=0)
        curves.append(Curve(part, "patch, in the order of the chart", "CIEDE2000", number, difference[0], spread))
    return tuple(curves)


_DIFFERENCES = {
    "76": "CIE 1976",
    "94": "CIE 1994",
    "2000": "CIEDE2000",
    "itp": "delta E ITP",
}
MEASUREMENT = Measurement(
    title="Color accuracy",
    standard="ISO/CIE 11664-4:2019, 11664-6:2022, CIE 116-1995, ITU-R BT.2124-0",
    charts=("macbeth", "color-checker-sg"),
    measure=_measure,
    quantities={
        **{
            f"delta_e_{key}_{kind}": Quantity(f"{kind} {text}", "", f"{text} of the patches, {kind}.")
            for key, text in _DIFFERENCES.items()
            for kind in ("mean", "max")
        },
        "lightness_error_rms": Quantity("lightness error", "", "RMS difference of L* over patches."),
        "chroma_error_rms": Quantity("chroma error", "", "RMS difference of C*ab over patches."),
        "hue_error_rms": Quantity("hue error", "", "RMS hue difference, delta H*ab, over patches."),
        "white_balance_error": Quantity("white-balance error", "", "Mean distance of gray patches in a*, b*."),
        "saturation_percent": Quantity("mean chroma", "%", "Mean C*ab of the image over that of the chart."),
        "exposure_stops": Quantity(
            "exposure", "stops", "Luminance of the gray patches in a picture, white at 1, over that of the chart."
        ),
    },
    oracle="colour-science; pictures with known errors; a camera with filters that are color-matching functions",
    left_out=(
        "Uncertainty of the chart's colors and unevenness of its light. Raw frames are judged by the 3 x 3 matrix that "
        "fits best in XYZ; no white balance or matrix of a developer is applied."
    ),
    order=300,
    headline=("delta_e_2000_mean", "delta_e_2000_max", "white_balance_error"),
    figure="curves",
    of_photograph=("exposure_stops",),
)
