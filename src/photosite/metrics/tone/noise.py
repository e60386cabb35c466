"""Noise of gray patches: signal-to-noise ratios, and the dynamic range that noise and saturation leave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, GrayPatch, gray_patches
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Uncertain, Value, correlated

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
    "Temporal noise and fixed pattern cannot be told apart; ratios are those of total noise.",
    "Take eight frames or more.",
    ("snr_*",),
)
_CORRELATED, _SIGNIFICANT = 0.1, 4.0
"""Correlation that is named, and its least size in its standard deviation by chance."""
_MIDDLE = 0.18
"""Signal of middle gray over saturation."""


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        patches = gray_patches(image, chart, channel)
        clear = [patch for patch in patches if not patch.clipped]
        kinds = ("temporal", "fixed", "total") if len(image.frames) > 1 else ("total",)
        for kind in kinds:
            x, y, spread = _ratios(clear, kind)
            curves.append(Curve(f"{channel}, {kind}", "log signal (DN)", "signal-to-noise ratio (dB)", x, y, spread))
        values |= {(name, channel): Estimate.of(value, "") for name, value in _values(image, clear).items()}
        alike, chance = _neighbors(image, chart, channel)
        if alike > max(_CORRELATED, _SIGNIFICANT * chance):
            text = f"channel {channel}: neighboring pixels have a correlation of {alike:.2f}"
            diagnostics.append(NOISE_REDUCED(text, alike))
    if len(image.frames) == 1:
        diagnostics.append(ONE_FRAME("one frame: temporal noise and fixed pattern are not told apart"))
    return Result(values, tuple(curves), (), tuple(diagnostics))


def _ratios(patches: list[GrayPatch], kind: str) -> tuple[Array, Array, Array]:
    """Return signals, ratios in dB and their standard uncertainties, of patches with signal and noise."""
    found = []
    for patch in patches:
        variance = getattr(patch, kind)
        if patch.mean.value > 0 and variance is not None and variance.value > 0:
            ratio = (patch.mean / variance.sqrt()).decibel(20.0)
            found.append((patch.mean.value, ratio.value, ratio.standard_uncertainty))
    x, y, spread = np.array(found).reshape(-1, 3).T
    return x, y, spread


def _values(image: ChartImage, patches: list[GrayPatch]) -> dict[str, Value]:
    """Return ratios at 18 % of saturation, the signal at a ratio of 10, and the dynamic range."""
    several = len(image.frames) > 1
    found: dict[str, Value] = {}
    white = image.white - image.black
    floor, per_signal, *rest = _polynomial(patches, "temporal" if several else "total", 1 if several else 2)
    relative = _relative_pattern(patches) if several else rest[0]
    if math.isinf(white):
        missing = Missing("the image has no level of saturation")
        names = ("snr_18_temporal_db", "snr_18_db", "dynamic_range_db")
        found |= dict.fromkeys(names[0 if several else 1 :], missing)
    else:
        signal = _MIDDLE * white
        found["snr_18_db"] = _decibel(signal, floor + per_signal * signal + relative * signal**2)
        if several:
            found["snr_18_temporal_db"] = _decibel(signal, floor + per_signal * signal)
        darkest = _signal_at(1.0, floor, per_signal, Uncertain(0.0) if several else relative)
        found["dynamic_range_db"] = darkest if isinstance(darkest, Missing) else (white / darkest).decibel(20.0)
    found["signal_snr_10"] = _signal_at(10.0, floor, per_signal, relative)
    if several:
        found["fixed_pattern_percent"] = _root(relative)
    return found


def _polynomial(patches: list[GrayPatch], kind: str, order: int) -> tuple[Uncertain, ...]:
    """Return the coefficients of the variance over the signal, by weighted least squares over the patches."""
    pairs = [(patch.mean.value, getattr(patch, kind)) for patch in patches]
    if len(pairs) < order + 2:
        expected = f"{order + 2} or more"
        raise InputError("gray patches that are not clipped", value=len(pairs), expected=expected)
    x = np.array([mean for mean, _ in pairs])
    y = np.array([variance.value for _, variance in pairs])
    relative = np.array([variance.standard_uncertainty / max(variance.value, 1e-300) for _, variance in pairs])
    model = np.vander(x, order + 1, increasing=True)
    fitted = y
    for _ in range(10):  # weights from the polynomial, not from the noisy variances
        weight = 1.0 / np.maximum(relative * np.maximum(fitted, y.min() * 0.1), 1e-300) ** 2
        covariance = np.linalg.inv(model.T @ (weight[:, None] * model))
        found = covariance @ (model.T @ (weight * y))
        fitted = model @ found
    return correlated(found, covariance)


def _relative_pattern(patches: list[GrayPatch]) -> Uncertain:
    """Return the variance of the fixed pattern over the square of the signal, from the brightest patches."""
    brightest = [patch for patch in patches if patch.mean.value > 0.2 * patches[-1].mean.value]
    ratios = [patch.fixed / (patch.mean * patch.mean) for patch in brightest if patch.fixed is not None]
    weights = [1.0 / max(ratio.standard_uncertainty, 1e-300) ** 2 for ratio in ratios]
    total = sum(weights)
    return sum((ratio * (weight / total) for ratio, weight in zip(ratios, weights, strict=True)), Uncertain(0.0))


def _root(relative: Uncertain) -> Value:
    if relative.value <= 0.0:
        return Missing("the fixed pattern is below the noise")
    return relative.sqrt() * 100.0


def _decibel(signal: float, variance: Uncertain) -> Value:
    if variance.value <= 0.0:
        return Missing("the variance of the noise is not above 0")
    return (signal / variance.sqrt()).decibel(20.0)


def _signal_at(ratio: float, floor: Uncertain, slope: Uncertain, relative: Uncertain) -> Value:
    """Return the signal S at which S^2 = ratio^2 (floor + slope S + relative S^2)."""
    square = ratio**2
    rest = 1.0 - square * relative.value
    inside = (square * slope.value) ** 2 + 4.0 * rest * square * floor.value
    if rest <= 0.0 or inside < 0.0:
        return Missing(f"the fixed pattern keeps the ratio below {ratio:g}")
    signal = (square * slope.value + math.sqrt(inside)) / (2.0 * rest)
    if signal <= 0.0:
        return Missing("the variance of the noise is not above 0")
    # Implicit differentiation of F = S^2 (1 - r relative) - r slope S - r floor, r = ratio^2.
    steepness = 2.0 * signal * rest - square * slope.value
    change = (floor + slope * signal + relative * signal**2) * (square / steepness)
    return change - change.value + signal


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
    standard="ISO 15739:2023",
    charts=GRAY_CHARTS,
    measure=_measure,
    quantities={
        "snr_18_db": Quantity("SNR at 18 %", "dB", "Signal over total noise at 18 % of saturation."),
        "snr_18_temporal_db": Quantity(
            "temporal SNR at 18 %", "dB", "Signal over temporal noise at 18 % of saturation."
        ),
        "signal_snr_10": Quantity("signal at SNR 10", "as frames", "Signal at which total noise is a tenth of it."),
        "dynamic_range_db": Quantity(
            "dynamic range",
            "dB",
            "Saturation over the signal that equals its temporal noise (of one frame: total noise).",
        ),
        "fixed_pattern_percent": Quantity(
            "fixed pattern", "%", "Standard deviation of the fixed pattern over the signal, of bright patches."
        ),
    },
    oracle="noise budget of the sensor in closed form",
    left_out=(
        "Frames are taken as proportional to light: the incremental gain is constant. A plane is fitted to each patch "
        "in place of a high-pass filter. The standard's reference luminances are replaced by 18 % of saturation."
    ),
    order=20,
)
