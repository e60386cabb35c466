"""Opto-electronic conversion function: signal against luminance, from the gray patches of a chart."""

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
from photosite.values.uncertain import Uncertain, combined, correlated

Array = NDArray[np.float64]

CURVED_TONE = DiagnosticKind(
    "curved-tone",
    "warning",
    "The signal of gray patches is not proportional to their luminance.",
    "Uneven light, flare, a tone curve or a wrong black level: figures that assume proportional signals are biased.",
    "Light the chart evenly, check the black level, or use raw frames.",
    ("exponent", "signal_per_luminance"),
    "Deviation of the exponent from 1.",
)
_EXPONENT_MATTERS, _SIGNIFICANT = 0.02, 4.0
_RANGE = 0.01
"""Luminance over that of the brightest patch from which patches count; dark signal and flare bend the rest."""
_LOG_LUMINANCE = "log luminance (cd/m2)", "log luminance relative to a perfect diffuser"


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        patches = [patch for patch in gray_patches(image, chart, channel) if patch.sound]
        shown = [patch for patch in patches if patch.luminance > 0]
        exponent, slope = power_law(shown)
        values["signal_per_luminance", channel] = Estimate.of(slope, "")
        values["exponent", channel] = Estimate.of(exponent, "")
        luminance = np.array([patch.luminance for patch in shown])
        signal = np.array([patch.mean.value for patch in shown])
        spread = np.array([patch.mean.standard_uncertainty for patch in shown])
        label = _LOG_LUMINANCE[not chart.known_light]
        curves.append(Curve(channel, label, f"log signal ({unit_of(image)})", luminance, signal, spread))
        away = exponent.value - 1.0
        if abs(away) > max(_EXPONENT_MATTERS, _SIGNIFICANT * exponent.standard_uncertainty):
            text = f"channel {channel}: the signal follows the luminance to the power {exponent.value:.3f}"
            diagnostics.append(CURVED_TONE(text, away))
    return Result(values, tuple(curves), (), tuple(diagnostics))


def unit_of(image: ChartImage) -> str:
    """Return the unit of an image's signal."""
    return {"raw": "DN", "picture": "of display white", "electrons": "e-"}[image.origin]


def power_law(patches: list[GrayPatch]) -> tuple[Uncertain, Uncertain]:
    """Return exponent and factor of signal = factor luminance^exponent, by weighted least squares of the logarithms.

    Signals are those in the light at the middle of the patches. The uncertainty of reflectances, which patches scatter
    by beyond noise, is in the result.
    """
    brightest = max((patch.luminance for patch in patches), default=0.0)
    used = [
        patch
        for patch in patches
        if patch.luminance > _RANGE * brightest and patch.mean.beyond(3.0) and patch.mean.value > 0
    ]
    if len(used) < 2:
        raise InputError("gray patches above noise", value=len(used), expected="two or more")
    x = np.log([patch.luminance for patch in used])
    even = [patch.mean / patch.light for patch in used]
    logs = [signal.apply(math.log, lambda size: 1.0 / size) for signal in even]
    y = np.array([each.value for each in logs])
    spread = np.array([patch.mean.relative for patch in used])
    floor = 0.0
    for _ in range(20):  # add the scatter of the patches until they agree with the line
        weight = 1.0 / (spread**2 + floor**2)
        middle = float(weight @ x / weight.sum())
        model = np.column_stack([x - middle, np.ones_like(x)])
        solver = np.linalg.inv(model.T @ (weight[:, None] * model)) @ (model.T * weight)
        residual = y - model @ (solver @ y)
        freedom = len(x) - 2
        if freedom < 1 or float(weight @ residual**2) <= freedom:
            break
        floor = math.sqrt(max(floor**2 + float(np.mean(residual**2)) * 0.5, 1e-12))
    scatter = correlated(np.zeros(2), floor**2 * solver @ solver.T)
    exponent, level = (combined(logs, row) + rest for row, rest in zip(solver, scatter, strict=True))
    # The factor of a proportional response, from the mean of the logarithms at the middle of the patches.
    slope = (level - middle).apply(math.exp, math.exp)
    return exponent, slope


MEASUREMENT = Measurement(
    title="Opto-electronic conversion function (OECF)",
    standard="ISO 14524:2009, focal-plane and camera OECF",
    charts=GRAY_CHARTS,
    measure=_measure,
    quantities={
        "signal_per_luminance": Quantity(
            "signal per luminance",
            "per cd/m2, or per relative luminance",
            "Signal over luminance at the geometric middle of the patches.",
        ),
        "exponent": Quantity(
            "exponent", "", "Slope of log signal over log luminance: 1 where signals are proportional to light."
        ),
    },
    oracle="signal of simulated patches; exponents put in",
    left_out="Flare between patches is not removed; patches alternate in brightness least on hdr-patches.",
    order=10,
    headline=("exponent",),
    figure="curves",
)
