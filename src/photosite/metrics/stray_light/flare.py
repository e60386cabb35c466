"""Flare: light inside black traps on a bright field."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import FieldMap, Measurement, Quantity, Result
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.region import Patch
from photosite.values.uncertain import Missing, Uncertain, Value, combined

Array = NDArray[np.float64]

BELOW_BLACK = DiagnosticKind(
    "traps-below-black",
    "warning",
    "The signal of light traps is below the black level.",
    "The black level is too high; the flare is too small by the same amount.",
    "Measure the black level with dark frames.",
    ("flare_*",),
    "Mean signal of the traps over that of the field, in percent.",
)
_LEAST_PIXELS = 20
_CLIPPED_FRACTION = 1e-3
_SIGNIFICANT, _LEAST_SIGMAS = 4.0, 20.0
"""Signal below black that is named, and least signal of the field, in standard uncertainties."""
_MOST_PERCENT = 50.0
"""Signal of traps over that of the field; larger where the image shows no traps."""


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    patches = {patch.name: patch for patch in chart.patches}
    traps = [
        name.removeprefix("trap ")
        for name in patches
        if name.startswith("trap ")
        and all(f"white {name.removeprefix('trap ')} {side}" in patches for side in ("left", "right"))
    ]
    if not traps:
        raise InputError("light traps in the frame", value=0, expected="one or more")
    values: dict[tuple[str, str], Estimate] = {}
    maps: list[FieldMap] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        ratios = []
        for number in traps:
            left, right = (_mean(image, patches[f"white {number} {side}"], channel) for side in ("left", "right"))
            if not ((left + right) * 0.5).beyond(_LEAST_SIGMAS) or left.value + right.value <= 0:
                raise InputError("signal of the field", where=f"trap {number}", expected="above its noise")
            ratios.append(_mean(image, patches[f"trap {number}"], channel) / ((left + right) * 0.5) * 100.0)
        mean = combined(ratios, [1.0 / len(ratios)] * len(ratios))
        if mean.value > _MOST_PERCENT:
            hint = "Check the chart, its corners and the focus"
            expected = f"at most {_MOST_PERCENT:g} % of that of the field"
            raise InputError("signal of the light traps", value=mean.value, expected=expected, hint=hint)
        values["flare_percent", channel] = Estimate.of(mean, "")
        values["contrast_db", channel] = Estimate.of(_contrast(mean), "")
        ranges = [_range_db(image, patches, number, channel) for number in traps]
        values["dynamic_range_glare_db", channel] = Estimate.of(_mean_of(ranges), "")
        maps.append(_map(channel, [patches[f"trap {number}"] for number in traps], ratios))
        if mean.value < 0.0 and mean.beyond(_SIGNIFICANT):
            text = f"channel {channel}: the signal of the traps is {mean.value:.2g} % of that of the field"
            diagnostics.append(BELOW_BLACK(text, mean.value))
    return Result(values, (), tuple(maps), tuple(diagnostics))


def _mean(image: ChartImage, patch: Patch, channel: str) -> Uncertain:
    values = image.pixels(patch, channel).mean(axis=0)
    if values.size < _LEAST_PIXELS:
        where = f"patch '{patch.name}'"
        raise InputError(f"pixels of channel {channel}", where=where, value=values.size, expected="20 or more")
    if (clipped := image.saturated_fraction(patch, channel)) > _CLIPPED_FRACTION:
        where = f"patch '{patch.name}'"
        what = f"fraction of saturated {channel} pixels"
        raise InputError(what, where=where, value=clipped, expected="at most 0.001")
    return Uncertain.of(float(values.mean()), float(values.std(ddof=1)) / math.sqrt(values.size))


def _range_db(image: ChartImage, patches: dict[str, Patch], number: str, channel: str) -> Value:
    """Return the field over the noise of a pixel in a trap, in dB."""
    trap = image.pixels(patches[f"trap {number}"], channel)
    # Noise of one frame; the differences of frames leave the fixed pattern out, as elsewhere one frame does not.
    several = len(trap) > 1
    size = float(trap.var(axis=0, ddof=1).mean() if several else trap[0].var(ddof=1))
    freedom = (len(trap) - 1) * trap.shape[1] if several else trap.shape[1] - 1
    left, right = (_mean(image, patches[f"white {number} {side}"], channel) for side in ("left", "right"))
    if size <= 0.0:
        return Missing("the traps have no noise")
    noise = Uncertain.of_variance(size, size * math.sqrt(2.0 / freedom))
    return ((left + right) * 0.5 / noise.sqrt()).decibel(20.0)


def _mean_of(ranges: list[Value]) -> Value:
    missing = [each for each in ranges if isinstance(each, Missing)]
    if missing:
        return missing[0]
    known = [each for each in ranges if isinstance(each, Uncertain)]
    return combined(known, [1.0 / len(known)] * len(known))


def _contrast(flare_percent: Uncertain) -> Value:
    if not flare_percent.beyond(_SIGNIFICANT) or flare_percent.value <= 0.0:
        return Missing("the flare is not above noise")
    return (100.0 / flare_percent).decibel(20.0)


def _map(channel: str, traps: list[Patch], ratios: list[Uncertain]) -> FieldMap:
    places = np.array([((trap.r0 + trap.r1) / 2, (trap.c0 + trap.c1) / 2) for trap in traps]).round(3)
    row, down = np.unique(places[:, 0], return_inverse=True)
    col, along = np.unique(places[:, 1], return_inverse=True)
    found = np.full((row.size, col.size), np.nan)
    found[down, along] = [ratio.value for ratio in ratios]
    return FieldMap(channel, "veiling glare (%)", row, col, found)


MEASUREMENT = Measurement(
    title="Flare",
    standard="ISO 18844:2017, light traps on a bright field",
    charts=("flare-traps",),
    measure=_measure,
    quantities={
        "flare_percent": Quantity(
            "veiling glare index", "%", "Mean over the traps of the signal in a trap over that of the field beside it."
        ),
        "dynamic_range_glare_db": Quantity(
            "dynamic range with glare",
            "dB",
            "Field over the noise of a pixel in a trap, glare included: the smallest signal beside a bright field that "
            "equals its noise. Of one frame, with the fixed pattern.",
        ),
        "contrast_db": Quantity("contrast within a frame", "dB", "Field over the light in the traps: 20 log10."),
    },
    oracle="veiling glare put into the lens of a simulated camera, in closed form",
    left_out=(
        "The text of the standard was not at hand: definitions follow its published descriptions. Traps are taken as "
        "black; light that a printed chart reflects counts as flare, and so does diffraction. Noise of pixels is taken "
        "as independent. Ghosts and light sources outside the chart are not measured."
    ),
    order=340,
    view="field",
    headline=("flare_percent",),
    figure="map",
)
