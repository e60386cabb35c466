"""What is wrong with the image of a chart, whatever is measured on it: its tone curve, and lossy compression."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.block_transform import quantization_step
from photosite.metrics.chart_image import LUMA, ChartImage
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.region import Region

Array = NDArray[np.float64]

_TONE_FIGURES = (
    *("exponent", "signal_per_luminance", "snr_*", "signal_snr_10", "dynamic_range_*", "fixed_pattern_percent"),
    *("mtf*", "response_nyquist", "edge_rise", "overshoot_percent", "acutance*", "probability", "capacity"),
    *("neq_zero", "flare_percent", "contrast_db", "delta_e_*"),
)
ASSUMED_TONE_CURVE = DiagnosticKind(
    "assumed-tone-curve",
    "warning",
    "A picture states no color space (ICC profile, EXIF, or the sRGB or gAMA chunk of PNG).",
    "Its tone curve is taken as that of sRGB. With another one, contrasts, noise and responses are biased.",
    "State it: `--tone-curve srgb` or `linear`; `chart` for that of the chart's gray patches; or the file of an OECF.",
    _TONE_FIGURES,
)
CHART_TONE_CURVE = DiagnosticKind(
    "tone-curve-of-chart",
    "note",
    "The tone curve of the picture is that of gray patches.",
    "On the same chart the exponent is 1 by construction. Other figures have the errors of reflectances and of uneven "
    "light on the patches, which intervals leave out.",
    "Light the chart evenly; measure its reflectances.",
    _TONE_FIGURES,
)
LOSSY_COMPRESSION = DiagnosticKind(
    "lossy-compression",
    "warning",
    "The picture is a JPEG file, or has blocks as JPEG leaves them: steps at their borders, or coefficients that are "
    "multiples of a step.",
    "Compression removes noise and fine detail, and adds patterns: ratios to noise are too high, texture is lost.",
    "Save pictures without loss (PNG, TIFF), or measure raw frames.",
    ("snr_*", "dynamic_range_*", "mtf*", "acutance*", "capacity", "neq_zero", "probability", "visual_*"),
    "Largest quantization step of luma, or that of coefficients, in codes; of steps at borders, their size over that "
    "of other pixels less 1.",
    "None in 800 pictures. Blocks of quality 50 and below are seen, and of up to 95 where sRGB pictures were not "
    "cropped or scaled.",
)
_BLOCK = 8
_EXCESS, _SIGMAS = 0.05, 6.0
"""Excess of steps at borders that is named, and its least size in standard uncertainties, along each axis."""
_MOST_ROWS = 1024


def image_diagnostics(image: ChartImage) -> tuple[Diagnostic, ...]:
    """Return what is wrong with an image."""
    return tuple(_found(image))


def _found(image: ChartImage) -> Iterator[Diagnostic]:
    if image.tone == "assumed":
        yield ASSUMED_TONE_CURVE("the picture states no color space: its tone curve is taken as that of sRGB")
    if image.tone == "chart":
        yield CHART_TONE_CURVE("the tone curve of the picture was measured on gray patches")
    if image.quantization is not None:
        text = f"JPEG file, quantization steps of luma up to {image.quantization:g}"
        yield LOSSY_COMPRESSION(text, image.quantization)
    elif image.origin == "picture" and (step := quantization_step(image.frames[0])) is not None:
        text = f"coefficients of blocks of {_BLOCK} pixels are multiples of {step:g} codes"
        yield LOSSY_COMPRESSION(f"{text}: the picture was compressed with loss before", step)
    elif image.origin == "picture" and (excess := block_steps(image)) is not None:
        text = f"steps at the borders of blocks of {_BLOCK} pixels are {100 * excess:.2g} % larger than others"
        yield LOSSY_COMPRESSION(f"{text}: the picture was compressed with loss before", excess)


def block_steps(image: ChartImage) -> float | None:
    """Return the excess of steps at borders of blocks of 8 pixels over other steps; None where there is none.

    Absolute differences of neighbors at the eight positions in a block: without blocks the largest mean is not above
    the second largest by more than chance (after Wang, Sheikh and Bovik, ICIP 2002).
    """
    rows, cols = (min(size, _MOST_ROWS) // _BLOCK * _BLOCK for size in image.shape)
    if min(rows, cols) < 4 * _BLOCK:
        return None
    plane = image.planes(LUMA, Region("blocks", 0, rows, 0, cols))
    first = np.sqrt(np.maximum(next(iter(plane)), 0.0))
    found = [_excess(first), _excess(first.T)]
    if any(excess < _EXCESS or excess < _SIGMAS * spread for excess, spread in found):
        return None
    return min(excess for excess, _ in found)


def _excess(plane: Array) -> tuple[float, float]:
    """Return by how much the largest mean step is above the second largest, relative to it, and its uncertainty."""
    steps = np.abs(np.diff(plane, axis=1))[:, : plane.shape[1] - _BLOCK]
    blocks = steps.reshape(-1, _BLOCK, steps.shape[1] // _BLOCK, _BLOCK).mean(axis=1)
    bands = np.median(blocks, axis=1)  # edges of the chart are in few blocks
    mean = bands.mean(axis=0)
    second, first = np.argsort(mean)[-2:]
    if mean[second] <= 0:
        return (math.inf, 0.0) if mean[first] > 0 else (0.0, 0.0)
    difference = bands[:, first] - bands[:, second]
    spread = float(difference.std(ddof=1)) / math.sqrt(len(difference))
    return float((mean[first] - mean[second]) / mean[second]), spread / float(mean[second])
