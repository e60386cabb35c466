"""Running lights whose steps have a known time: exposure time, and line time of a rolling shutter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.motion.time_stamps import STAMP_QUANTITIES, stamp_values
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Source, Uncertain, Value, derive

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]

_LEAST_LIT, _LEAST_DARK = 3, 3
"""Lamps that are lit more than half, and that are not, which the level of either takes."""
_LEAST_CONTRAST = 10.0
"""Lit lamps over the spread of dark ones."""
_LEAST_SAMPLES = 4
"""Lines of frames whose scatter gives the uncertainty."""
_CLIPPED_FRACTION = 1e-3


@dataclass(frozen=True)
class _Light(Shown):
    """First and last end of the light in lamps, and the standard uncertainty of their difference by unequal lamps."""

    first: float
    last: float
    spread: float
    freedom: int


def _measure(
    image: ChartImage, chart: PlacedChart, *, step_ms: Positive | None = None, stated_ms: Positive | None = None
) -> Result:
    if step_ms is None:
        raise InputError("step_ms", expected="given", hint="Set running-light.step_ms to the time of a lamp")
    lamps, lines = int(chart.options["lamps"]), int(chart.options["lines"])
    if len(chart.patches) != lamps * lines:
        raise InputError("lamps in the frame", value=len(chart.patches), expected=f"{lamps * lines}")
    signals = _signals(image, chart).reshape(-1, lines, lamps)
    found = [[_light(line) for line in frame] for frame in signals]
    lit = _mean([light for frame in found for light in frame])
    exposure = lit * step_ms
    stated = stated_ms if stated_ms is not None else 1e3 * image.exposure_s if image.exposure_s else None
    row = np.array([0.5 * (patch.r0 + patch.r1) for patch in chart.patches]).reshape(lines, lamps).mean(axis=1)
    middle = np.array([[0.5 * (light.first + light.last) for light in frame] for frame in found])
    slope = _slope(row, np.unwrap(middle, period=lamps, axis=1))
    error: Value = Missing("the exposure time is not stated")
    values: dict[str, Value] = {
        "exposure_ms": exposure,
        "exposure_error_percent": error if stated is None else (exposure / stated - 1.0) * 100.0,
        "lamps_lit": lit,
        "line_time_us": derive(lambda lamps_per_row: lamps_per_row * (1e3 * step_ms), slope),
    }
    number = np.arange(1.0, lamps + 1)
    curves = tuple(
        Curve(f"line {line + 1}", "lamp", f"signal of the first frame, channel {image.sharp_channel}", number, each)
        for line, each in enumerate(signals[0])
    )
    estimates = {name: Estimate.of(value, "") for name, value in values.items()} | stamp_values(image.stamps)
    return Result({(name, ""): estimate for name, estimate in estimates.items()}, curves)


def _signals(image: ChartImage, chart: PlacedChart) -> Array:
    """Return the (frames, lamps) mean signals."""
    channel = image.sharp_channel
    if max(image.saturated_fraction(patch, channel) for patch in chart.patches) > _CLIPPED_FRACTION:
        raise InputError("lamps", expected="below saturation", hint="Close the aperture, or dim the lamps")
    return np.stack([image.pixels(patch, channel).mean(axis=1) for patch in chart.patches], axis=1)


def _light(signal: Array) -> _Light:
    """Return where the light is in a line.

    Lamps that are lit for a whole step are alike, and those at either end are lit for a part of one.
    """
    lamps = signal.size
    lit = signal > 0.5 * (signal.min() + signal.max())
    starts = np.flatnonzero(lit & ~np.roll(lit, 1))
    count = int(lit.sum())
    if starts.size != 1:
        hint = "Check the chart, its corners, and that one light runs in each line"
        raise InputError("lit lamps of a line", value=count, expected="side by side", hint=hint)
    if count < _LEAST_LIT or count > lamps - _LEAST_DARK - 2:
        expected = f"{_LEAST_LIT} to {lamps - _LEAST_DARK - 2} of {lamps}"
        raise InputError("lit lamps of a line", value=count, expected=expected, hint="Change the time of a step")
    start = int(starts[0])
    ordered = np.roll(signal, 1 - start)  # a dark neighbor, the light, a dark neighbor, the others
    full, dark = ordered[2:count], ordered[count + 2 :]
    level, spread = float(full.mean() - dark.mean()), float(dark.std(ddof=1))
    if level < _LEAST_CONTRAST * spread:
        raise InputError("signal of lit lamps", expected=f"{_LEAST_CONTRAST:g} times the spread of dark ones")
    first, last = ((ordered[ends] - dark.mean()) / level for ends in ([0, 1], [count, count + 1]))
    # The lamps that are lit fully count as one each, whatever their light; those at the ends have their own.
    ends = np.concatenate([first, last])
    unequal = float(full.var(ddof=1)) / level**2 if full.size > 1 else math.nan
    own = unequal * (float(ends @ ends) + float(ends.sum()) ** 2 / full.size)
    variance = own + (spread / level) ** 2 * (ends.size + ends.size**2 / dark.size)
    return _Light(start + 1.0 - first.sum(), start + count - 1.0 + last.sum(), math.sqrt(variance), full.size - 1)


def _mean(lights: list[_Light]) -> Uncertain:
    """Return the mean number of lamps that are lit, from the scatter of lines and frames, or from unequal lamps."""
    lit = np.array([light.last - light.first for light in lights])
    if lit.size >= _LEAST_SAMPLES:
        return Uncertain.of(
            float(lit.mean()), float(lit.std(ddof=1)) / math.sqrt(lit.size), Source.student(lit.size - 1)
        )
    freedom = sum(light.freedom for light in lights)
    if not freedom:
        expected = f"{_LEAST_SAMPLES} or more where three lamps are lit"
        raise InputError("lines of frames", value=lit.size, expected=expected, hint="Take more frames")
    spread = math.sqrt(float(np.nanmean([light.spread**2 for light in lights])) / lit.size)
    return Uncertain.of(float(lit.mean()), spread, Source.student(freedom))


def _slope(row: Array, middle: Array) -> Value:
    """Return the lamps by which the light is ahead from a row of pixels to the next one."""
    if row.size < 3:
        return Missing("three lines of lamps or more show the shutter")
    away = row - row.mean()
    square = float(away @ away)
    slopes = middle @ away / square
    rest = middle - middle.mean(axis=1, keepdims=True) - slopes[:, None] * away
    freedom = len(slopes) * (row.size - 2)
    spread = math.sqrt(float((rest**2).sum()) / freedom / square / len(slopes))
    return Uncertain.of(float(slopes.mean()), spread, Source.student(freedom))


_QUANTITIES = {
    "exposure_ms": Quantity("exposure time", "ms", "Lamps lit, partly lit ones by their part, times a step."),
    "exposure_error_percent": Quantity(
        "exposure error", "%", "Exposure time over that of the frames, or `stated_ms`, less 1."
    ),
    "lamps_lit": Quantity("lamps lit", "", "In a line, partly lit ones by their part."),
    "line_time_us": Quantity(
        "line time",
        "us",
        "Time from a row to the next, from the light's place over the lines; it runs to the right.",
    ),
    **STAMP_QUANTITIES,
}
MEASUREMENT = Measurement(
    title="Running light: exposure time and rolling shutter",
    standard="no standard; a light that steps from lamp to lamp, each lit for the time of a step",
    charts=("led-bar",),
    measure=_measure,
    quantities=_QUANTITIES,
    oracle="overlap of exposures with the steps of a light, in closed form",
    left_out=(
        "Lamps have about the same light, are off outside of their step, and all lines run alike. Exposures are "
        "shorter than the light's round; lit lamps are at least three."
    ),
    order=455,
    headline=("exposure_ms", "line_time_us"),
    figure="curves",
    of_photograph=tuple(_QUANTITIES),
)
