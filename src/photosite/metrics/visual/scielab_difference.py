"""S-CIELAB differences between a picture of a chart and the chart itself, at a viewing condition."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.color.colorimetry import XYZ_FROM_SRGB, adaptation_to_d65, delta_e_2000, xyz
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.color.color_accuracy import clipped_gray, matched_exposure
from photosite.metrics.color.patch_colors import patch_colors
from photosite.metrics.measurement import Curve, FieldMap, Measurement, Quantity, Result
from photosite.metrics.shared_noise import inner_box, low_lines
from photosite.metrics.visual.scielab import OPPONENT_FROM_XYZ, kernel_size, scielab_kernels, seen_xyz
from photosite.metrics.visual.viewing import DISTANCE_MM, PITCH_MM, pixels_per_degree
from photosite.values.estimate import Estimate
from photosite.values.region import Patch, Region
from photosite.values.uncertain import Uncertain, combined

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]

_LEAST_SIDE, _MOST_SIDE = 16, 256
"""Pixels along a side of the part of a patch that is judged."""
_BLOCKS, _SAMPLES = 4, 12
"""Blocks along a side of a patch, and pixels along that of a block, of which percentiles are taken."""
_DRAWS, _SEED = 200, 1996
_STEP = 1e-6
"""Change of an opponent color, white having about 1, for derivatives."""
_MAP_SIDE = 200
"""Most pixels along a side of the map of differences."""


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    pitch_mm: Positive = PITCH_MM,
    distance_mm: Positive = DISTANCE_MM,
    match_exposure: bool = True,
) -> Result:
    if image.origin != "picture":
        raise InputError("frames", value=image.origin, expected="a developed picture: differences are as they are seen")
    colors = patch_colors(image, chart)
    seen = colors.mean @ XYZ_FROM_SRGB.T
    exposure = float(matched_exposure(seen[None], colors)[0]) if match_exposure else 1.0
    view = _View(image, chart, exposure, pixels_per_degree(pitch_mm, distance_mm))
    boxes = [_judged(patch) for patch in chart.patches]
    pairs = [view.seen(box) for box in boxes]
    noises = [view.noise(box) for box in boxes]
    shown, chart_xyz = (np.concatenate([each.reshape(-1, 3) for each in one]) for one in zip(*pairs, strict=True))
    ends = np.cumsum([box.shape[0] * box.shape[1] for box in boxes])[:-1]

    def by_patch(values: Array) -> list[Array]:
        return [part.reshape(*box.shape, -1) for part, box in zip(np.split(values, ends), boxes, strict=True)]

    difference = delta_e_2000(shown, chart_xyz)
    maps = [each[..., 0] for each in by_patch(difference)]
    slopes = by_patch(_slopes(shown, chart_xyz, difference))
    means = [
        Uncertain.of(float(each.mean()), view.uncertainty(slope, noise))
        for each, slope, noise in zip(maps, slopes, noises, strict=True)
    ]
    values = {
        "mean": combined(means, [1.0 / len(means)] * len(means)),
        "percentile_95": _percentile(maps, 95.0),
    }
    number = np.arange(1.0, len(means) + 1)
    size = np.array([each.value for each in means])
    spread = np.array([each.standard_uncertainty for each in means])
    curve = Curve("", "patch, in the order of the chart", "S-CIELAB difference", number, size, spread)
    picture = _picture(chart.region, boxes, maps)
    diagnostics = clipped_gray(image, chart, colors)
    return Result(
        {(name, ""): Estimate.of(value, "") for name, value in values.items()}, (curve,), (picture,), diagnostics
    )


@dataclass(frozen=True, eq=False)
class _View:
    image: ChartImage
    chart: PlacedChart
    exposure: float
    per_degree: float

    def noise(self, box: Region) -> Array:
        """Return the (3, 3) covariance of the mean over a box, times its pixels, of opponent colors before the blur.

        It is the cross spectrum at low frequencies, where noise that pixels share with near neighbors has an even one.
        That of the seen image falls there, because the blur of the eye is about as wide as a patch.
        """
        part = self.image.frames[0][box.r0 : box.r1, box.c0 : box.c1] @ XYZ_FROM_SRGB.T / self.exposure
        low = low_lines(np.moveaxis(part @ OPPONENT_FROM_XYZ.T, -1, 0))
        return np.asarray(np.real(low @ np.conj(low).T) / (low.shape[1] * box.shape[0] * box.shape[1]))

    def uncertainty(self, slope: Array, noise: Array) -> float:
        """Return the standard uncertainty of a mean of differences, of which `slope` holds (rows, cols, 3) derivatives.

        A pixel changes the mean by the derivatives of all pixels into which the eye blurs it. For normal noise the
        variance of the sum of these changes is that of the mean if differences are linear in the noise, and at least
        that otherwise (L. H. Y. Chen, J. Multivar. Anal. 12 (1982) 306).
        """
        from scipy.signal import fftconvolve

        kernels = scielab_kernels(self.per_degree)
        changes = np.array([fftconvolve(slope[..., k], kernel).ravel() for k, kernel in enumerate(kernels)])
        return math.sqrt(float(np.sum(noise * (changes @ changes.T)))) / slope[..., 0].size

    def seen(self, box: Region) -> tuple[Array, Array]:
        """Return the (rows, cols, 3) XYZ of image and chart in a box as the eye blurs them with what surrounds it."""
        reach = kernel_size(self.per_degree) // 2
        rows, cols = self.image.shape
        r0, c0, r1, c1 = (
            *(max(box.r0 - reach, 0), max(box.c0 - reach, 0)),
            *(min(box.r1 + reach, rows), min(box.c1 + reach, cols)),
        )
        shown = self.image.frames[0][r0:r1, c0:c1] @ XYZ_FROM_SRGB.T / self.exposure
        y, x = self.chart.to_scene_grid(*(np.arange(a, b, dtype=np.float64) + 0.5 for a, b in ((r0, r1), (c0, c1))))
        scene = self.chart.scene
        at = tuple(
            np.clip(np.floor(each), 0, size - 1).astype(np.intp) for each, size in zip((y, x), scene.shape, strict=True)
        )
        basis = xyz(scene.basis, scene.wavelength_nm) @ adaptation_to_d65(self.chart.white_xyz).T
        reference = np.moveaxis(scene.weights[:, at[0], at[1]], 0, -1) @ basis
        inside = slice(box.r0 - r0, box.r1 - r0), slice(box.c0 - c0, box.c1 - c0)
        one, other = (seen_xyz(each, self.per_degree)[inside] for each in (shown, reference))
        return one, other


def _slopes(shown: Array, chart_xyz: Array, difference: Array) -> Array:
    """Return the (pixels, 3) derivatives of differences by the opponent colors of what is shown."""
    steps = _STEP * np.linalg.inv(OPPONENT_FROM_XYZ).T
    return np.stack([(delta_e_2000(shown + step, chart_xyz) - difference) / _STEP for step in steps], axis=-1)


def _judged(patch: Patch) -> Region:
    """Return the middle of a patch, of at most 256 pixels along a side."""
    box = inner_box(patch)
    if min(box.shape) < _LEAST_SIDE:
        expected = f"{_LEAST_SIDE} x {_LEAST_SIDE} or more"
        raise InputError("pixels", where=f"patch '{patch.name}'", value=box.shape, expected=expected)
    (r, rows), (c, cols) = (
        (start + max(size - _MOST_SIDE, 0) // 2, min(size, _MOST_SIDE))
        for start, size in zip((box.r0, box.c0), box.shape, strict=True)
    )
    return Region(box.name, r, r + rows, c, c + cols)


def _percentile(maps: list[Array], percent: float) -> Uncertain:
    """Return a percentile over all patches; its uncertainty is from resampling the blocks of each patch."""
    blocks = np.stack([_blocks(each) for each in maps])
    random = np.random.default_rng(_SEED)
    patch = np.arange(len(maps))[:, None]
    draws = [
        np.percentile(blocks[patch, random.integers(0, _BLOCKS**2, blocks.shape[:2])], percent) for _ in range(_DRAWS)
    ]
    return Uncertain.of(float(np.percentile(blocks, percent)), float(np.std(draws)))


def _blocks(values: Array) -> Array:
    """Return (blocks, pixels) of a map, as many for each patch."""
    row, col = (np.linspace(0, size - 1, _BLOCKS * _SAMPLES).astype(np.intp) for size in values.shape)
    parts = values[np.ix_(row, col)].reshape(_BLOCKS, _SAMPLES, _BLOCKS, _SAMPLES)
    return np.asarray(parts.transpose(0, 2, 1, 3).reshape(_BLOCKS**2, _SAMPLES**2))


def _picture(region: Region, boxes: list[Region], maps: list[Array]) -> FieldMap:
    """Return the map of the differences over the chart, a value for each few pixels."""
    step = -(-max(region.shape) // _MAP_SIDE)
    row, col = (np.arange(start, end, step) for start, end in ((region.r0, region.r1), (region.c0, region.c1)))
    values = np.full((row.size, col.size), np.nan)
    for box, each in zip(boxes, maps, strict=True):
        inside = (row >= box.r0) & (row < box.r1), (col >= box.c0) & (col < box.c1)
        values[np.ix_(*inside)] = each[np.ix_(row[inside[0]] - box.r0, col[inside[1]] - box.c0)]
    down, along = (np.asarray(each + 0.5, np.float64) for each in (row, col))
    return FieldMap("", "S-CIELAB difference", down, along, values)


MEASUREMENT = Measurement(
    title="S-CIELAB differences from the chart",
    standard="X. Zhang and B. A. Wandell, SID Digest 27 (1996) 731; CIEDE2000 (ISO/CIE 11664-6:2022)",
    charts=("macbeth", "color-checker-sg"),
    measure=_measure,
    quantities={
        "mean": Quantity("mean S-CIELAB difference", "", "Mean of the differences inside of patches, over patches."),
        "percentile_95": Quantity(
            "95th percentile", "", "Difference that 5 % of the pixels inside of patches exceed, each patch the same."
        ),
    },
    oracle="CIEDE2000 of even patches; S-CIELAB kernels of ISETCam; means of other pictures of the same camera",
    left_out=(
        "Borders of patches, whose differences would be those of the chart's place. The first frame is judged, its "
        "noise is seen. Exposure is matched by gray patches, unless the option match_exposure is off. Uncertainty of "
        "the chart's colors."
    ),
    order=415,
    of_photograph=("mean", "percentile_95"),
    headline=("mean",),
    figure="map",
)
