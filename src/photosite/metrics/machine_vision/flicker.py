"""Flicker of lamps in a sequence of frames: modulation, mitigation probability and detection index."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.tone.oecf import unit_of
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]

ONE_PHASE = DiagnosticKind(
    "flicker-in-step-with-frames",
    "warning",
    "Signals repeat after a few frames: the frame rate is a multiple or a simple fraction of the flicker's.",
    "Few phases of the flicker are seen: extremes and probabilities are those of these phases.",
    "Change the frequency of the lamp or the frame rate by a few percent.",
    ("modulation", "mitigation_probability", "detection_index"),
    "Number of frames after which signals repeat.",
    "Of steady light and of independent phases, fewer than 1 in 1000.",
)
_LEAST_FRAMES, _MOST_REPEATED = 20, 6
_PLATEAU_SIGMAS = 4.0
"""Distance from an extreme, in standard deviations of the noise, within which frames are averaged."""
_FLICKERS, _REPEATS = 25.0, 4.0
"""Variance of the signals over that of their noise from which they flicker; and variance of the differences of frames
after a repetition, over twice that of the noise."""
_CLIPPED_FRACTION = 1e-3


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.1,
    background: Annotated[float, Field(ge=0)] = 0.0,
    detected_above: Annotated[float, Field(gt=0, lt=1)] = 0.5,
    rows: Annotated[int, Field(ge=2)] = 16,
) -> Result:
    frames = len(image.frames)
    if frames < _LEAST_FRAMES:
        hint = "Record the lamp for a second or more"
        raise InputError("frames", value=frames, expected=f"{_LEAST_FRAMES} or more", hint=hint)
    region = _middle(chart.region, rows)
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        pixels = image.pixels(region, channel)
        full = float((pixels >= image.white - image.black).mean())
        if full > _CLIPPED_FRACTION:
            raise InputError(f"fraction of saturated {channel} pixels", value=full, expected="at most 0.001")
        signal = pixels.mean(axis=1)
        level = float(signal.mean())
        # Uneven light and fixed pattern are the same in all frames, in proportion to the signal.
        apart = pixels - np.outer(signal, pixels.mean(axis=0) / level)
        noises = apart.var(axis=1) / pixels.shape[1] * (frames / (frames - 1))
        noise = float(noises.mean())
        if level - background <= 5.0 * math.sqrt(noise):
            hint = "Light the field with the lamp"
            raise InputError(
                f"signal of channel {channel}", value=level, expected="above background and noise", hint=hint
            )
        high, low = (_extreme(signal, noises, sign) for sign in (1.0, -1.0))
        values["modulation", channel] = Estimate.of((high - low) / (high + low), "")
        within = np.abs(signal / level - 1.0) <= tolerance
        seen = signal - background >= detected_above * (level - background)
        values["mitigation_probability", channel] = _fraction(int(within.sum()), frames)
        values["detection_index", channel] = _fraction(int(seen.sum()), frames)
        label = f"signal ({unit_of(image)})"
        curves.append(Curve(channel, "frame", label, np.arange(1.0, frames + 1), signal, np.sqrt(noises)))
        if (repeated := _repetition(signal, noise)) is not None:
            text = f"channel {channel}: signals repeat after {repeated} frame{'s' if repeated > 1 else ''}"
            diagnostics.append(ONE_PHASE(text, repeated))
    return Result(values, tuple(curves), (), tuple(diagnostics))


def _middle(region: Region, rows: int) -> Region:
    """Return the rows in the middle of a region, which see nearly one phase under a rolling shutter."""
    height = region.r1 - region.r0
    first = region.r0 + max(height - rows, 0) // 2
    return Region(region.name, first, min(first + rows, region.r1), region.c0, region.c1)


def _extreme(signal: Array, noises: Array, sign: float) -> Uncertain:
    """Return the mean of the frames that are as bright, or as dark, as the extreme one within noise."""
    first = int(np.argmax(sign * signal))
    near = np.abs(signal - signal[first]) <= _PLATEAU_SIGMAS * math.sqrt(2.0 * noises[first])
    return Uncertain.of(float(signal[near].mean()), math.sqrt(float(noises[near].mean()) / near.sum()))


def _fraction(count: int, total: int) -> Estimate:
    """Return a fraction with the interval of Clopper and Pearson, Biometrika 26 (1934) 404."""
    from scipy.special import betaincinv

    low = float(betaincinv(count, total - count + 1, 0.025)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 0.975)) if count < total else 1.0
    value = count / total
    return Estimate(value, math.sqrt(value * (1.0 - value) / total), interval_95=(low, high))


def _repetition(signal: Array, noise: float) -> int | None:
    """Return after how many frames flickering signals repeat; None where they do not, or do not flicker."""
    if signal.var() < _FLICKERS * noise:
        return None
    for period in range(1, _MOST_REPEATED + 1):
        apart = signal[period:] - signal[:-period]
        if float(np.mean(apart**2)) < _REPEATS * 2.0 * noise:
            return period
    return None


MEASUREMENT = Measurement(
    title="Flicker of lamps",
    standard="IEEE P2020, as described by Deegan, Electronic Imaging (2018), and by later reviews",
    charts=("uniform",),
    measure=_measure,
    quantities={
        "modulation": Quantity("flicker modulation", "", "Highest less lowest signal over their sum, over all frames."),
        "mitigation_probability": Quantity(
            "modulation mitigation probability",
            "",
            "Part of the frames whose signal is within `tolerance` of the mean.",
        ),
        "detection_index": Quantity(
            "flicker detection index",
            "",
            "Part of the frames whose signal above `background` is `detected_above` of its mean or more.",
        ),
    },
    oracle="overlap of exposures with pulses in closed form",
    left_out=(
        "The text of the standard was not at hand: definitions follow its published descriptions, and the thresholds "
        "are options. Phases of the frames are taken as independent. The mean over frames stands for steady light. "
        "Extremes between the phases of the frames are not seen. The middle rows are measured, not the bands of a "
        "rolling shutter."
    ),
    order=430,
    view="field",
    headline=("modulation",),
    figure="curves",
    of_photograph=("modulation", "mitigation_probability", "detection_index"),
)
