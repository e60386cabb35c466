"""Visible noise of gray patches, weighted by the eye at a viewing condition, and the visible signal-to-noise ratio."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import uniform_filter

from photosite.color.colorimetry import D65_WHITE_XYZ, XYZ_FROM_SRGB, adaptation_to_d65, colour_science, lab
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.plane_fit import without_plane
from photosite.metrics.shared_noise import inner_box
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, check_structure
from photosite.metrics.visual.scielab import scielab_differences
from photosite.metrics.visual.viewing import (
    DISTANCE_MM,
    PITCH_MM,
    chrominance_sensitivities,
    luminance_sensitivity,
    pixels_per_degree,
)
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.uncertain import Missing, Uncertain, Value, correlated

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]

SMALL_PATCHES = DiagnosticKind(
    "patches-below-a-degree",
    "warning",
    "Gray patches cover less than a degree of the visual field at the viewing condition.",
    "Noise of low spatial frequency does not fit into the patches, and visible noise is too small.",
    "Take a picture of the chart in which patches are larger, or state a longer viewing distance.",
    ("visual_noise*", "sigma_*", "vsnr"),
    "Side of the smallest patch in degrees.",
)
UNCONFIRMED_WEIGHTS = DiagnosticKind(
    "unconfirmed-weights",
    "warning",
    "Weights and color sensitivities of visual noise were not checked with the texts of the standards.",
    "The two combined figures may differ from those of other programs by a factor.",
    "Compare cameras by figures of this program only, or use sigma L*, a*, b* and the visible SNR.",
    ("visual_noise_2013", "visual_noise_cpiq"),
)
_LEAST_DEGREES, _LEAST_SIDE = 0.5, 16

_OPPONENT_FROM_XYZ = np.array([[0.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.4, -0.4]])
"""XYZ under equal energy to luminance, red-green and blue-yellow."""
_FROM_D65 = np.linalg.inv(adaptation_to_d65(np.ones(3)))
_PEAK = 3.0
"""Largest value of `luminance_sensitivity`."""


def _measure(
    image: ChartImage, chart: PlacedChart, *, pitch_mm: Positive = PITCH_MM, distance_mm: Positive = DISTANCE_MM
) -> Result:
    if image.origin != "picture":
        raise InputError("frames", value=image.origin, expected="a developed picture: noise is judged as it is seen")
    per_degree = pixels_per_degree(pitch_mm, distance_mm)
    found = []
    for index in np.flatnonzero(chart.gray):
        patch = chart.patches[index]
        box = inner_box(patch)
        if min(box.shape) < _LEAST_SIDE:
            where = f"patch '{patch.name}'"
            raise InputError("pixels", where=where, value=box.shape, expected=f"{_LEAST_SIDE} x {_LEAST_SIDE} or more")
        found.append((patch.name, min(box.shape) / per_degree, _patch_noise(_pixels(image, box), per_degree)))
    if not found:
        raise InputError("gray patches of the chart", value=0, expected="one or more")
    check_structure(image, chart)
    diagnostics = [UNCONFIRMED_WEIGHTS("weights of the combined figures are not confirmed by the standards' texts")]
    if (smallest := min(size for _, size, _ in found)) < _LEAST_DEGREES:
        text = f"the smallest patch covers {smallest:.2g} degrees"
        diagnostics.append(SMALL_PATCHES(text, smallest))
    noises = [noise for _, _, noise in found]
    means: dict[str, Any] = {name: _mean([noise[name] for noise in noises]) for name in noises[0]}
    means["vsnr"] = _inverse(means.pop("difference"))
    means["visual_noise_cpiq"] = _logarithm(1.0 + means.pop("weighted"))
    brightness = np.array([noise["lightness"].value for noise in noises])
    del means["lightness"]
    values = {(name, ""): Estimate.of(value, "") for name, value in means.items()}
    curves = []
    for name, label in _CURVES.items():
        y = np.array([noise[name].value for noise in noises])
        spread = np.array([noise[name].standard_uncertainty for noise in noises])
        order = np.argsort(brightness)
        curves.append(Curve(label, "L* of the patch", "visible noise", brightness[order], y[order], spread[order]))
    return Result(values, tuple(curves), (), tuple(diagnostics))


_CURVES = {"visual_noise_2013": "ISO 15739:2013", "sigma_lightness": "L*", "sigma_a": "a*", "sigma_b": "b*"}


def _pixels(image: ChartImage, box: Region) -> Array:
    """Return the (rows, cols, 3) XYZ of a patch in the first frame, less a plane."""
    part = image.frames[0][box.r0 : box.r1, box.c0 : box.c1].astype(np.float64)
    row, col = np.indices(box.shape).reshape(2, -1)
    flat = part.reshape(-1, 3)
    rest = without_plane(flat.T, row, col).T + flat.mean(axis=0)
    return np.asarray(rest.reshape(part.shape) @ XYZ_FROM_SRGB.T)


def _patch_noise(xyz: Array, per_degree: float) -> dict[str, Uncertain]:
    luv_noise, _ = _moments(_luv(_seen(xyz, per_degree, 1.0)))
    maps = lab(_seen(xyz, per_degree, _PEAK))
    lab_noise, covariance = _moments(maps)
    lightness, a, b = (_root(square) for square in lab_noise)
    l_star, u, v = (_root(square) for square in luv_noise)
    weighted = 23.0 * lab_noise[0] + 4.24 * lab_noise[1] - 5.47 * lab_noise[2] + 4.77 * covariance
    mean = np.broadcast_to(xyz.mean(axis=(0, 1)), xyz.shape)
    difference = scielab_differences(xyz, mean, per_degree)
    return {
        "visual_noise_2013": l_star + 0.852 * u + 0.323 * v,
        "weighted": weighted,
        "sigma_lightness": lightness,
        "sigma_a": a,
        "sigma_b": b,
        "difference": mean_of_map(difference),
        "lightness": Uncertain(float(maps[..., 0].mean())),
    }


def _seen(xyz: Array, per_degree: float, scale: float) -> Array:
    """Return XYZ with the noise weighted by the sensitivities of the eye; the mean is kept.

    `scale` divides the sensitivity to luminance, whose peak is 3.
    """
    rows, cols = xyz.shape[:2]
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(rows), np.fft.rfftfreq(cols), indexing="ij")) * per_degree
    weights = np.stack([luminance_sensitivity(f) / scale, *chrominance_sensitivities(f)], axis=-1)
    weights[0, 0] = 1.0
    forward = _OPPONENT_FROM_XYZ @ _FROM_D65
    spectrum = np.fft.rfft2(xyz @ forward.T, axes=(0, 1)) * weights
    return np.asarray(np.fft.irfft2(spectrum, s=(rows, cols), axes=(0, 1)) @ np.linalg.inv(forward).T)


def _luv(xyz: Array) -> Array:
    return np.asarray(colour_science().XYZ_to_Luv(np.maximum(xyz, 0.0), D65_WHITE_XYZ[:2] / D65_WHITE_XYZ.sum()))


def _moments(maps: Array) -> tuple[tuple[Uncertain, ...], Uncertain]:
    """Return the variances of three maps, and the covariance of the first two, with their joint uncertainty.

    A variance is the sum of a periodogram, whose lines are independent and, for normal noise, have a covariance of
    C_ik C_jl + C_il C_jk, with C the cross spectra of the maps.
    """
    rows, cols, _ = maps.shape
    lines = np.fft.fft2(maps - maps.mean(axis=(0, 1)), axes=(0, 1)) / (rows * cols)
    cross = np.real(lines[..., :, None] * np.conj(lines[..., None, :])) * (rows * cols / (rows * cols - _FITTED))
    sums = cross.sum(axis=(0, 1))
    smooth = uniform_filter(cross, (_SMOOTH, _SMOOTH, 0, 0), mode="wrap")
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1)]
    joint = np.array(
        [
            [np.sum(smooth[..., i, k] * smooth[..., j, m] + smooth[..., i, m] * smooth[..., j, k]) for k, m in pairs]
            for i, j in pairs
        ]
    )
    found = correlated(np.array([sums[pair] for pair in pairs]), joint)
    return found[:3], found[3]


_FITTED = 3.0
"""Parameters that were fitted to a patch: its mean and a plane."""
_SMOOTH = 5
"""Lines along a side over which cross spectra are averaged."""


def _root(square: Uncertain) -> Uncertain:
    return square.sqrt() if square.value > 0 else Uncertain(0.0)


def mean_of_map(difference: Array) -> Uncertain:
    """Return the mean of a map of noise; its uncertainty is from the lowest lines of the periodogram."""
    rows, cols = difference.shape
    power = np.abs(np.fft.fft2(difference - difference.mean())) ** 2 / (rows * cols)
    low = np.r_[power[0, 1:4], power[1:4, 0], power[1:3, 1:3].ravel()].mean()
    return Uncertain.of(float(difference.mean()), math.sqrt(low / (rows * cols)))


def _mean(values: list[Uncertain]) -> Uncertain:
    return sum(values, Uncertain(0.0)) / len(values)


def _inverse(difference: Uncertain) -> Value:
    return 1.0 / difference if difference.value > _NOISELESS else Missing("the picture has no visible noise")


def _logarithm(weighted: Uncertain) -> Value:
    if weighted.value <= 0.0:
        return Missing("the weights of the metric make the noise in b* outweigh all else")
    return weighted.decibel(1.0)


_NOISELESS = 1e-9


_VIEWED = "mean over gray patches"
MEASUREMENT = Measurement(
    title="Visual noise",
    standard="ISO 15739:2013, annex B; IEEE 1858-2016 (CPIQ); Farrell et al. (2010), visible SNR",
    charts=GRAY_CHARTS,
    measure=_measure,
    quantities={
        "visual_noise_2013": Quantity(
            "visual noise, ISO 15739:2013", "", f"sigma L* + 0.852 sigma u* + 0.323 sigma v*, {_VIEWED}."
        ),
        "visual_noise_cpiq": Quantity(
            "visual noise, CPIQ",
            "",
            "log10 of 1 + 23 var L* + 4.24 var a* - 5.47 var b* + 4.77 cov L*a*, each the mean over gray patches.",
        ),
        "sigma_lightness": Quantity("sigma L*", "", f"Visible noise in L*, sensitivity 1 at its peak, {_VIEWED}."),
        "sigma_a": Quantity("sigma a*", "", f"Visible noise in a*, {_VIEWED}."),
        "sigma_b": Quantity("sigma b*", "", f"Visible noise in b*, {_VIEWED}."),
        "vsnr": Quantity("visible SNR", "", "1 over the mean S-CIELAB difference of gray patches from their means."),
    },
    oracle="integrals of white noise over the sensitivities in closed form; S-CIELAB filters of ISETCam",
    left_out=(
        "The texts of the standards were not at hand: weights and color sensitivities are not checked with them. ISO "
        "15739:2023 is not included: by published descriptions it has CIELAB, as sigma L*, a* and b* here, and other "
        "weights, which were not found. The response of the display is not included. Options give the size of an image "
        "pixel as it is viewed, and the distance."
    ),
    order=410,
    headline=("visual_noise_2013",),
    of_photograph=("visual_noise_2013", "visual_noise_cpiq", "sigma_lightness", "sigma_a", "sigma_b", "vsnr"),
    figure="curves",
)
