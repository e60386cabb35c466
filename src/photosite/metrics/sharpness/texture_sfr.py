"""Spatial frequency response of a texture of dead leaves, by cross spectra and by power spectra."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.charts.reference_image import ReferenceImage
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.sharpness.crossing import crossing
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]

TEXTURE_LOST = DiagnosticKind(
    "texture-and-artifacts",
    "warning",
    "The power of the texture in the image is not that of its correlated part: details were lost or invented.",
    "Denoising, sharpening or compression treated details by their content; one response does not describe the camera.",
    "Compare with raw frames; use the cross response for details that are really those of the chart.",
    ("mtf50_*",),
    "Largest difference of the two responses.",
)
_DIFFERENT, _SIGNIFICANT = 0.05, 4.0
_UNALIASED = 0.3
"""Frequency in cycles/pixel from which aliases of the texture add to its power."""
_STEP = 0.01
_LOWEST = 0.015
"""Frequencies in cycles/pixel below which the window leaks, and the width of the bins."""
_LEAST_SIZE = 128


_CLIPPED_FRACTION = 1e-3


def _measure(
    image: ChartImage, chart: PlacedChart, *, size: Annotated[int, Field(ge=_LEAST_SIZE, le=4096)] = 1024
) -> Result:
    region = _middle(chart.region, size)
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    sharp = image.sharp_channel
    align_on, align_mask = image.plane(sharp, region)[0], image.mask(sharp, region)
    aligned = ReferenceImage(chart, region, align_on, align_mask)
    bins = np.rint(aligned.frequency / _STEP).astype(np.intp)
    bins[(aligned.frequency < _LOWEST) | (aligned.frequency > 0.5)] = -1
    frequency = np.arange(bins.max() + 1) * _STEP
    first = int(bins[bins >= 0].min())
    for channel in image.channels:
        mask = image.mask(channel, region)
        full = float((image.plane(channel, region)[0][mask] >= image.white - image.black).mean())
        if full > _CLIPPED_FRACTION:
            raise InputError(f"fraction of saturated {channel} pixels", value=full, expected="at most 0.001")
        light = aligned.light(image.plane(channel, region)[0], mask)
        spectra = [aligned.spectrum(plane / light, mask) for plane in image.planes(channel, region)]
        found: dict[str, Response | Missing] = {"cross": _cross(aligned.reference, spectra, bins, first)}
        if mask.all():
            found["direct"] = _direct(aligned.reference, spectra, bins, first, image)
        for kind, response in found.items():
            if isinstance(response, Missing):
                values[f"mtf50_{kind}", channel] = Estimate.of(response, "")
                continue
            level, spread = response
            part = f"{channel}, {kind}"
            curves.append(
                Curve(part, "spatial frequency (cycles/pixel)", "texture SFR", frequency[first:], level, spread)
            )
            values[f"mtf50_{kind}", channel] = Estimate.of(crossing(frequency[first:], level, spread, 0.5), "")
        cross, direct = found["cross"], found.get("direct")
        if not (isinstance(cross, Missing) or direct is None or isinstance(direct, Missing)):
            diagnostics += _compared(channel, frequency[first:], cross, direct)
    return Result(values, tuple(curves), (), tuple(diagnostics))


def _middle(region: Region, size: int) -> Region:
    """Return the square of at most `size` pixels in the middle of the chart, of even sides."""
    rows, cols = region.shape
    side = min(rows, cols, size) // 10 * 10
    if side < _LEAST_SIZE:
        raise InputError("size of the texture", value=min(rows, cols), expected=f"{_LEAST_SIZE} pixels or more")
    r0, c0 = region.r0 + (rows - side) // 2, region.c0 + (cols - side) // 2
    return Region(region.name, r0, r0 + side, c0, c0 + side)


Response = tuple[Array, Array]


def _cross(
    reference: NDArray[np.complex128], spectra: list[NDArray[np.complex128]], bins: NDArray[np.intp], first: int
) -> Response:
    """Return the response correlated with the chart and its uncertainty, which is that of the uncorrelated rest."""
    mean = np.mean(spectra, axis=0)
    used = bins >= 0
    where, power = bins[used], np.abs(reference[used]) ** 2
    total = np.bincount(where, power)
    level = np.bincount(where, (mean[used] * np.conj(reference[used])).real) / np.maximum(total, 1e-300)
    rest = np.abs(mean[used] - level[where] * reference[used]) ** 2
    # Frequencies come in conjugate pairs, and the window correlates neighbors: 3/2 on each axis (Hann).
    spread = np.sqrt(np.bincount(where, rest * power) * _CORRELATED) / np.maximum(total, 1e-300)
    return level[first:], spread[first:]


_CORRELATED = (35.0 / 18.0) ** 2
"""Sum over neighbors of the squared correlations of a Hann window's frequencies, on both axes."""


def _direct(
    reference: NDArray[np.complex128],
    spectra: list[NDArray[np.complex128]],
    bins: NDArray[np.intp],
    first: int,
    image: ChartImage,
) -> Response | Missing:
    """Return the response of the power that frames share, and its uncertainty."""
    used = bins >= 0
    where = bins[used]
    total = np.bincount(where, np.abs(reference[used]) ** 2)
    count = len(spectra)
    power = np.mean([np.abs(each[used]) ** 2 for each in spectra], axis=0)
    if count > 1:
        mean = np.abs(np.mean(spectra, axis=0)[used]) ** 2
        shared = (count * mean - power) / (count - 1)
    elif image.origin == "electrons":
        shared = power
    else:
        return Missing("the noise of one frame cannot be separated from texture; take two frames or more")
    noise = np.maximum(power - shared, 0.0)
    variance = 2.0 * np.maximum(shared, 0.0) * noise / count + noise**2 / max(count * (count - 1), 1)
    ratio = np.bincount(where, shared) / np.maximum(total, 1e-300)
    level = np.sqrt(np.maximum(ratio, 0.0))
    spread = np.sqrt(np.bincount(where, variance) * _CORRELATED * 2.0) / np.maximum(total, 1e-300)
    return level[first:], (spread / np.maximum(2.0 * level, np.sqrt(spread) + 1e-300))[first:]


def _compared(channel: str, frequency: Array, cross: Response, direct: Response) -> list[Diagnostic]:
    shown = frequency < _UNALIASED
    away = (direct[0] - cross[0])[shown]
    spread = np.hypot(cross[1], direct[1])[shown]
    place = int(np.argmax(np.abs(away) - _SIGNIFICANT * spread))
    if abs(away[place]) <= max(_DIFFERENT, _SIGNIFICANT * spread[place]):
        return []
    power, details = direct[0][place], cross[0][place]
    text = f"channel {channel}: the response of the power is {power:.2g}, that of the chart's details {details:.2g}"
    return [TEXTURE_LOST(text, float(away[place]))]


MEASUREMENT = Measurement(
    title="Spatial frequency response of texture (dead leaves)",
    standard="ISO/TS 19567-2:2019; cross spectra after Kirk et al., Proc. SPIE 9023 (2014)",
    charts=("dead-leaves",),
    measure=_measure,
    quantities={
        "mtf50_cross": Quantity(
            "MTF50, cross", "cycles/pixel", "Frequency at which the part that correlates with the chart is 0.5."
        ),
        "mtf50_direct": Quantity(
            "MTF50, direct",
            "cycles/pixel",
            "Frequency at which the root of the texture's power, without noise, is 0.5.",
        ),
    },
    oracle="lens times pixel transfer function; responses put in",
    left_out=(
        "The chart is the realization that was photographed, not its model. Fixed-pattern noise and aliases count as "
        "texture in the direct response, errors of alignment as lost details in the cross response."
    ),
    order=120,
    view="fine",
    headline=("mtf50_cross",),
    figure="curves",
)
