"""Acutance: the response of an edge, weighted by the contrast sensitivity of the eye at a viewing condition."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.sharpness.edge_sfr import MEASUREMENT as EDGE_SFR
from photosite.metrics.visual.viewing import (
    DISTANCE_MM,
    PITCH_MM,
    barten_sensitivity,
    luminance_sensitivity,
    luminance_sensitivity_area,
    pixels_per_degree,
)
from photosite.values.diagnostic import Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]

_NYQUIST = 0.5
_EDGE_PX = 28.0
"""Effective length of the edge profile, from simulated edges: errors of the response are alike within its inverse."""
_LOWEST_CPD = 0.1
"""Frequency from which the square-root integral of an edge is taken; Barten's sensitivity is small below."""
_STEPS = 2001


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    pitch_mm: Positive = PITCH_MM,
    distance_mm: Positive = DISTANCE_MM,
    luminance_cd_m2: Positive = 100.0,
    width_deg: Positive = 40.0,
) -> Result:
    per_degree = pixels_per_degree(pitch_mm, distance_mm)
    edge = EDGE_SFR(image, chart)
    values: dict[tuple[str, str], Estimate] = {}
    curves = []
    for curve in edge.curves:
        if curve.y_label != "SFR" or curve.standard_uncertainty is None:
            continue
        shown = curve.x <= _NYQUIST + 1e-9
        cpd, response, spread = curve.x[shown] * per_degree, curve.y[shown], curve.standard_uncertainty[shown]
        covariance = _covariance(curve.x[shown], spread)
        values["acutance", curve.part] = _estimate(*acutance(cpd, response), covariance)
        jnd = square_root_integral(cpd, response, luminance_cd_m2, width_deg)
        values["sqri", curve.part] = _estimate(*jnd, covariance)
        curves.append(Curve(curve.part, "spatial frequency (cycles/degree)", "SFR", cpd, response, spread))
    curves.append(Curve("eye", *_AXES, cpd, luminance_sensitivity(cpd) / 3.0))
    kept: tuple[Diagnostic, ...] = edge.diagnostics
    return Result(values, tuple(curves), (), kept)


_AXES = ("spatial frequency (cycles/degree)", "SFR")


def acutance(cycles_per_degree: Array, response: Array, up_to: float = math.inf) -> tuple[float, Array]:
    """Return the mean of a response weighted by the eye's contrast sensitivity, and its derivative by the response.

    Parameters
    ----------
    cycles_per_degree, response
        (n,) each, increasing; the response is linear between them, and 0 above the last.
    up_to
        Frequency up to which the eye sees, in cycles/degree.
    """
    # Closer near 0, where the sensitivity is steep.
    first, last = cycles_per_degree[0], cycles_per_degree[-1]
    u = first + (last - first) * np.linspace(0.0, 1.0, _STEPS) ** 2
    slopes = _on_nodes(cycles_per_degree, u, _trapezoid(u) * luminance_sensitivity(u)) / luminance_sensitivity_area(
        up_to
    )
    return float(slopes @ response), slopes


def square_root_integral(
    cycles_per_degree: Array, response: Array, luminance_cd_m2: float, width_deg: float
) -> tuple[float, Array]:
    """Return Barten's square-root integral in just noticeable differences, and its derivative by the response.

    It is the integral of sqrt(response times contrast sensitivity) over the logarithm of the frequency, by log 2.

    Parameters
    ----------
    cycles_per_degree, response
        (n,) each, increasing; the response is linear between them.
    luminance_cd_m2, width_deg
        Of the display.
    """
    lowest = cycles_per_degree[0] or min(_LOWEST_CPD, cycles_per_degree[-1] / 10.0)
    u = np.geomspace(lowest, cycles_per_degree[-1], _STEPS)
    weights = _trapezoid(np.log2(u))
    seen = np.interp(u, cycles_per_degree, response)
    sensitivity = barten_sensitivity(u, luminance_cd_m2, width_deg)
    root = np.sqrt(np.maximum(seen, 0.0) * sensitivity)
    # The derivative of a root grows without limit where a response is 0; noise there is below 0.01.
    local = weights * 0.5 * np.sqrt(sensitivity / np.maximum(seen, _LEAST_RESPONSE))
    return float(weights @ root), _on_nodes(cycles_per_degree, u, local)


def _on_nodes(nodes: Array, at: Array, weights: Array) -> Array:
    """Return the weights of values at nodes that act as weights of their linear interpolation at places."""
    place = np.clip(np.searchsorted(nodes, at) - 1, 0, nodes.size - 2)
    part = (at - nodes[place]) / np.diff(nodes)[place]
    lower = np.bincount(place, weights * (1.0 - part), minlength=nodes.size)
    return np.asarray(lower + np.bincount(place + 1, weights * part, minlength=nodes.size))


_LEAST_RESPONSE = 0.01


def _trapezoid(x: Array) -> Array:
    """Return the weights of the trapezoidal rule."""
    steps = np.diff(x)
    return np.asarray(0.5 * (np.append(steps, 0.0) + np.append(0.0, steps)))


def _covariance(frequency: Array, spread: Array) -> Array:
    """Return the covariance of a response: that of a spectrum of white noise over the length of the profile."""
    alike = np.sinc((frequency[:, None] - frequency) * _EDGE_PX)
    return np.asarray(alike * spread[:, None] * spread)


def _estimate(value: float, slopes: Array, covariance: Array) -> Estimate:
    variance = float(slopes @ covariance @ slopes)
    return Estimate.of(Uncertain.of(value, math.sqrt(max(variance, 0.0))), "")  # negative only by rounding


MEASUREMENT = Measurement(
    title="Acutance and square-root integral",
    standard="IEEE 1858-2016 (CPIQ), edge acutance; Barten (1990), SQRI",
    charts=EDGE_SFR.charts,
    measure=_measure,
    quantities={
        "acutance": Quantity(
            "acutance", "", "Response up to the Nyquist frequency, weighted by the eye's sensitivity; 1: all is seen."
        ),
        "sqri": Quantity(
            "square-root integral", "JND", "Sharpness in just noticeable differences, of a display of a luminance."
        ),
    },
    oracle="integrals of Gaussian responses in closed form; acutance and SQRI of ISETCam",
    left_out=(
        "Response of the display and of printers; quality loss in JND, whose table was not at hand. Options give the "
        "size of an image pixel as it is viewed, the distance, and luminance and width of the display for SQRI."
    ),
    order=400,
    view="fine",
    headline=("acutance",),
)
