"""Noise of gray patches: signal-to-noise ratios, and the dynamic range that noise and saturation leave."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, GrayPatch, gray_patches
from photosite.metrics.tone.noise_model import NoiseModel, bright_pattern
from photosite.metrics.tone.oecf import unit_of
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Uncertain, Value, derive

Array = NDArray[np.float64]

NOISE_REDUCED = DiagnosticKind(
    "noise-reduction",
    "warning",
    "Neighboring pixels of even patches are alike.",
    "Noise reduction or interpolation averaged them: noise is smaller than that of the sensor, and details may be too.",
    "Switch noise reduction off, or measure raw frames.",
    ("snr_*", "dynamic_range*"),
    "Correlation of neighboring pixels.",
)
ONE_FRAME = DiagnosticKind(
    "one-frame-noise",
    "note",
    "There is one frame.",
    "Temporal noise and fixed pattern cannot be separated; ratios are those of total noise.",
    "Take eight frames or more.",
    ("snr_*",),
)
NOISE_STEPS = DiagnosticKind(
    "noise-steps",
    "note",
    "The noise of gray patches is not a floor with shot noise and fixed pattern.",
    "Frames combine several captures, or were processed: the dynamic range is that of the dark patches' noise, and "
    "ratios are interpolated between patches.",
    "None needed for frames of several captures.",
    ("snr_*", "dynamic_range*"),
    "Signal from which the noise has steps.",
)
_CORRELATED, _SIGNIFICANT = 0.1, 4.0
"""Correlation that is named, and its least size in its standard deviation by chance."""
_VAGUE_DB = 2.0
"""Standard uncertainty from which a ratio is not drawn."""
_MIDDLE, _REFERENCE = 0.18, 0.13
"""Signal of middle gray over saturation; and that of ISO 15739, half a stop below."""
Edition = Literal[2003, 2013]


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    edition: Edition = 2013,
    dark_signal: Annotated[float, Field(ge=0)] | None = None,
) -> Result:
    dark = image.dark_signal if dark_signal is None else dark_signal
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        patches = [replace(each, mean=each.mean - dark) for each in gray_patches(image, chart, channel)]
        clear = [patch for patch in patches if patch.sound]
        kinds = ("temporal", "fixed", "total") if len(image.frames) > 1 else ("total",)
        for kind in kinds:
            x, y, spread = _ratios(clear, kind)
            curves.append(
                Curve(
                    f"{channel}, {kind}", f"log signal ({unit_of(image)})", "signal-to-noise ratio (dB)", x, y, spread
                )
            )
        model = NoiseModel.of(clear, several=len(image.frames) > 1)
        if model.limit < math.inf:
            limit = max(model.limit, 0.0)
            diagnostics.append(NOISE_STEPS(f"channel {channel}: noise has steps above a signal of {limit:.4g}", limit))
        found = _values(image, clear, model, edition, dark)
        values |= {(name, channel): Estimate.of(value, "") for name, value in found.items()}
        alike, chance = _neighbors(image, chart, channel)
        if alike > max(_CORRELATED, _SIGNIFICANT * chance):
            text = f"channel {channel}: neighboring pixels have a correlation of {alike:.2f}"
            diagnostics.append(NOISE_REDUCED(text, alike))
    if len(image.frames) == 1:
        diagnostics.append(ONE_FRAME("one frame: temporal noise and fixed pattern are not separated"))
    return Result(values, tuple(curves), (), tuple(diagnostics))


def _ratios(patches: list[GrayPatch], kind: str) -> tuple[Array, Array, Array]:
    """Return signals, ratios in dB and their standard uncertainties, of patches with signal and noise."""
    found = []
    for patch in patches:
        variance = getattr(patch, kind)
        if patch.mean.value > 0 and variance is not None and variance.value > 0:
            ratio = (patch.mean / variance.sqrt()).decibel(20.0)
            if ratio.standard_uncertainty < _VAGUE_DB:
                found.append((patch.mean.value, ratio.value, ratio.standard_uncertainty))
    x, y, spread = np.array(found).reshape(-1, 3).T
    return x, y, spread


def _values(
    image: ChartImage, patches: list[GrayPatch], model: NoiseModel, edition: Edition, dark: float
) -> dict[str, Value]:
    """Return ratios at 18 and 13 % of saturation, the signal at a ratio of 10, and the dynamic range.

    Charge of the dark current is noise, no signal: it takes part of the range, and its shot noise is in the floor.
    """
    several = len(image.frames) > 1
    found: dict[str, Value] = {}
    white = image.white - image.black - dark
    models = {"": model} | ({"_temporal": model.temporal, "_fixed": model.fixed} if several else {})
    for percent, part in ((18, _MIDDLE), (13, _REFERENCE)):
        for kind, each in models.items():
            if percent == 13 or kind != "_fixed":
                found[f"snr_{percent}{kind}_db"] = _ratio(patches, each, kind, part * white)
    darkest = _darkest(patches, model, edition)
    if math.isinf(white):
        darkest = Missing("the image has no level of saturation")
    found["dynamic_range_db"] = derive(lambda signal: (white / signal).decibel(20.0), darkest)
    found["signal_snr_10"] = model.signal_at(10.0)
    if several:
        found["fixed_pattern_percent"] = _root(bright_pattern(patches))
    return found


def _ratio(patches: list[GrayPatch], model: NoiseModel, kind: str, signal: float) -> Value:
    """Return the ratio at a signal in dB, from the model, or between the two patches where the noise has steps."""
    if math.isinf(signal):
        return Missing("the image has no level of saturation")
    if signal <= model.limit:
        return model.ratio_db(signal)
    above = next((number for number, patch in enumerate(patches) if patch.mean.value >= signal), 0)
    if above == 0:
        return Missing(f"no patch has a signal of {signal:.4g}")
    pair = patches[above - 1 : above + 1]
    variances = [_variance(patch, kind) for patch in pair]
    if min(each.value for each in variances) <= 0.0:
        return Missing("the variance of the noise is not above 0")
    dark, bright = ((patch.mean / size.sqrt()).decibel(20.0) for patch, size in zip(pair, variances, strict=True))
    part = math.log(signal / pair[0].mean.value) / math.log(pair[1].mean.value / pair[0].mean.value)
    return dark * (1.0 - part) + bright * part


def _variance(patch: GrayPatch, kind: str) -> Uncertain:
    if patch.temporal is None or patch.fixed is None:
        return patch.total
    return {"": patch.temporal + patch.fixed, "_temporal": patch.temporal, "_fixed": patch.fixed}[kind]


def _darkest(patches: list[GrayPatch], model: NoiseModel, edition: Edition) -> Value:
    """Return the signal that equals its temporal noise, or that of the darkest patch; of one frame, the total noise."""
    if edition == 2013:
        return model.temporal.signal_at(1.0) if patches[0].temporal is not None else model.signal_at(1.0)
    variance = patches[0].temporal or patches[0].total
    return variance.sqrt() if variance.value > 0.0 else Missing("the darkest patch has no noise")


def _root(relative: Uncertain) -> Value:
    if relative.value <= 0.0:
        return Missing("the fixed pattern is below the noise")
    return relative.sqrt() * 100.0


def _neighbors(image: ChartImage, chart: PlacedChart, channel: str) -> tuple[float, float]:
    """Return the correlation of neighbors along the rows in the largest patch, and its spread by chance."""
    rectangles = sorted(chart.patches, key=lambda patch: (patch.r1 - patch.r0) * (patch.c1 - patch.c0))
    if not rectangles or image.origin == "electrons":
        return 0.0, 1.0
    patch = rectangles[-1]
    row, col = image.places(patch, channel)
    values = image.pixels(patch, channel)
    rest = values[0] - values.mean(axis=0) if len(values) > 1 else values[0] - values[0].mean()
    order = np.lexsort((col, row))
    row, col, rest = row[order], col[order], rest[order]
    step = np.diff(col)
    near = (np.diff(row) == 0) & (step == np.min(step[step > 0]))
    if near.sum() < 100 or not rest.any():
        return 0.0, 1.0
    return float(np.corrcoef(rest[:-1][near], rest[1:][near])[0, 1]), 1.0 / math.sqrt(near.sum())


MEASUREMENT = Measurement(
    title="Noise, signal-to-noise ratio and dynamic range",
    standard="ISO 15739:2023; edition 2013 has its definitions, and those of 2017",
    charts=GRAY_CHARTS,
    measure=_measure,
    quantities={
        "snr_18_db": Quantity("SNR at 18 %", "dB", "Signal over total noise at 18 % of saturation."),
        "snr_18_temporal_db": Quantity(
            "temporal SNR at 18 %", "dB", "Signal over temporal noise at 18 % of saturation."
        ),
        "snr_13_db": Quantity("total SNR of ISO 15739", "dB", "Signal over total noise at 13 % of saturation."),
        "snr_13_temporal_db": Quantity(
            "temporal SNR of ISO 15739", "dB", "Signal over temporal noise at 13 % of saturation."
        ),
        "snr_13_fixed_db": Quantity("fixed-pattern SNR of ISO 15739", "dB", "Signal over fixed pattern at 13 %."),
        "signal_snr_10": Quantity("signal at SNR 10", "as frames", "Signal at which total noise is a tenth of it."),
        "dynamic_range_db": Quantity(
            "dynamic range",
            "dB",
            "Saturation over the signal that equals its temporal noise (of one frame: total noise); with edition 2003, "
            "over the noise of the darkest patch. The mean dark signal (`dark_signal`, in the unit of the frames; by "
            "default that of the sensor's dark current) is subtracted from both.",
        ),
        "fixed_pattern_percent": Quantity(
            "fixed pattern", "%", "Standard deviation of the fixed pattern over the signal, of bright patches."
        ),
    },
    oracle="noise budget of the sensor in closed form",
    left_out=(
        "Frames are taken as proportional to light: the incremental gain is constant. Without a sensor, the charge of "
        "the dark current counts as signal unless `dark_signal` is given. A plane is fitted to each patch "
        "in place of a high-pass filter. The texts were not at hand: 13 % of saturation, half a stop below 18 %, and "
        "the black patch of 2003 are those of published descriptions (Imatest; D. A. Kerr, 2008), which name no other "
        "difference of the editions."
    ),
    order=20,
    headline=("snr_18_db", "dynamic_range_db"),
    figure="curves",
)
