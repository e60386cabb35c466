"""Edge-based spatial frequency response of a slanted edge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.sharpness.edge_region import check_blur, check_edge, edge_region
from photosite.metrics.sharpness.iso_12233 import edge_sfr as standard_sfr
from photosite.metrics.sharpness.slanted_edge import SlantedEdge, Window, slanted_edge_mtf
from photosite.values.cfa import MONOCHROME
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.uncertain import Missing, Uncertain

Array = NDArray[np.float64]

SHARPENED = DiagnosticKind(
    "sharpened-image",
    "warning",
    "The response of an edge rises above 1, or its profile overshoots, by more than noise does.",
    "The picture was sharpened: responses tell of the processing, not of lens and sensor.",
    "Switch sharpening off, or measure raw frames.",
    ("mtf50", "mtf10", "edge_rise", "acutance"),
    "Largest response above 1.",
)
UNDERSAMPLED = DiagnosticKind(
    "coarse-edge",
    "note",
    "The response at the Nyquist frequency of a channel is above 0.2.",
    "The image aliases; frequencies above Nyquist are measured only because the edge is slanted.",
    "None needed; compare resolutions with the limit of the pixels in mind.",
    ("mtf10",),
    "Response at the Nyquist frequency.",
)
UNEVEN_LIGHT = DiagnosticKind(
    "uneven-light-on-edge",
    "note",
    "The two sides of an edge become brighter in the same direction by the same fraction.",
    "Uneven light tilts the profile of the edge. The gradient is divided out before the edge is measured.",
    "Light the chart evenly, or take a smaller region.",
    ("mtf50", "mtf30", "edge_rise"),
    "Relative change of the light over the region.",
)
_SHARPENED_RESPONSE, _SIGNIFICANT = 0.02, 4.0
"""Rise above 1 that is named, and its least size in standard uncertainties."""
_ALIASED_RESPONSE = 0.2
_LEVEL_SIGMAS = 3.0
"""Level of a crossing over the uncertainty of the response there; noise that is larger crosses lower levels first."""
_SHOWN_TO = 1.0


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    order: Annotated[int, Field(ge=1, le=5)] = 5,
    window: Window = "tukey",
    oversampling: Annotated[int, Field(ge=1, le=16)] = 4,
    reach_px: Annotated[float, Field(ge=8)] = 32.0,
) -> Result:
    region = edge_region(image, chart.region, reach_px)
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        edge, change = measured_edge(image, region, channel, EdgeOptions(order, window, oversampling, reach_px))
        if change is not None:
            text = f"channel {channel}: the light changes by {100 * change:.2g} % over the region; it was divided out"
            diagnostics.append(UNEVEN_LIGHT(text, change))
        plane, tile = image.plane(channel, region)
        values |= {(name, channel): estimate for name, estimate in _values(edge).items()}
        if tile == MONOCHROME:
            values["mtf50_standard", channel] = _standard(plane, order)
        curves += _curves(edge, channel)
        diagnostics += _diagnostics(edge, channel)
    return Result(values, tuple(curves), (), tuple(diagnostics))


@dataclass(frozen=True)
class EdgeOptions:
    """Options of `slanted_edge_mtf`."""

    order: int = 5
    window: Window = "tukey"
    oversampling: int = 4
    reach_px: float = 32.0


def measured_edge(
    image: ChartImage, region: Region, channel: str, options: EdgeOptions
) -> tuple[SlantedEdge, float | None]:
    """Return the edge in a region, without the bias of noise, and the relative change of the light, if it has one.

    Raises
    ------
    InputError
        If pixels are saturated, or there is no slanted edge.
    """
    plane, tile = image.plane(channel, region)
    mask = image.mask(channel, region)
    check_edge(image, plane, mask, channel)
    own: dict[str, Any] = vars(options) | {"channel": channel if tile != MONOCHROME else None, "cfa": tile}
    edge = slanted_edge_mtf(plane, **own)
    change = None
    if (light := _gradient(plane, mask, edge)) is not None:
        edge = slanted_edge_mtf(plane / light, **own)
        change = float(np.ptp(light))
    check_blur(edge, options.reach_px)
    # Noise adds its variance to the square of the response, on average.
    unbiased = np.sqrt(np.maximum(edge.mtf**2 - edge.standard_uncertainty**2, 0.0))
    return replace(edge, mtf=unbiased), change


_CLEAR_OF_EDGE_PX = 12.0
_GRADIENT_SIGMAS, _AGREEMENT_SIGMAS = 4.0, 4.3
"""Significance of a gradient of the light, and agreement of the two sides, which noise exceeds in 1 of 10 000; the blur
of a lens makes them disagree."""


def _gradient(plane: Array, mask: NDArray[np.bool_], edge: SlantedEdge) -> Array | None:
    """Return the relative light over the region, a plane that both sides of the edge share; None without one."""
    row, col = np.nonzero(mask)
    across, line = (col, row) if edge.direction == "vertical" else (row, col)
    at = np.interp(line + 0.5, np.arange(edge.edge_position.size) + 0.5, edge.edge_position)
    distance = across + 0.5 - at
    x, y = (col + 0.5) / plane.shape[1] - 0.5, (row + 0.5) / plane.shape[0] - 0.5
    slopes, inverses = [], []
    for side in (distance < -_CLEAR_OF_EDGE_PX, distance > _CLEAR_OF_EDGE_PX):
        if side.sum() < _LEAST_PIXELS:
            return None
        model = np.column_stack([np.ones(int(side.sum())), x[side], y[side]])
        values = plane[row[side], col[side]]
        fit, rest = np.linalg.lstsq(model, values)[:2]
        variance = float(rest[0]) / (len(values) - 3) if rest.size else 0.0
        covariance = variance * np.linalg.inv(model.T @ model) / fit[0] ** 2
        slopes.append(fit[1:] / fit[0])
        inverses.append(np.linalg.inv(covariance[1:, 1:] + 1e-18 * np.eye(2)))
    both = np.linalg.inv(inverses[0] + inverses[1])
    mean = both @ (inverses[0] @ slopes[0] + inverses[1] @ slopes[1])
    apart = slopes[0] - slopes[1]
    spread = np.linalg.inv(inverses[0]) + np.linalg.inv(inverses[1])
    if mean @ np.linalg.solve(both, mean) < _GRADIENT_SIGMAS**2:
        return None
    if apart @ np.linalg.solve(spread, apart) > _AGREEMENT_SIGMAS**2:
        return None
    rows, cols = np.indices(plane.shape)
    x, y = (cols + 0.5) / plane.shape[1] - 0.5, (rows + 0.5) / plane.shape[0] - 0.5
    light: Array = 1.0 + mean[0] * x + mean[1] * y
    return light if light.min() > 0 else None


_LEAST_PIXELS = 100


def _values(edge: SlantedEdge) -> dict[str, Estimate]:
    peak = float(edge.mtf[: edge.mtf.size // 2 + 1].max())
    found = {
        "mtf50": _crossing(edge, 0.5),
        "mtf50p": _crossing(edge, 0.5 * peak),
        "mtf30": _crossing(edge, 0.3),
        "mtf10": _crossing(edge, 0.1),
    }
    nyquist = edge.frequency_cycles_per_pixel.size // 2
    response = Uncertain.of(float(edge.mtf[nyquist]), float(edge.standard_uncertainty[nyquist]))
    found["response_nyquist"] = Estimate.of(response, "")
    try:
        found["edge_rise"] = Estimate.of(edge.rise_distance(), "")
    except InputError as error:
        found["edge_rise"] = Estimate.of(Missing(str(error)), "")
    found["overshoot_percent"] = Estimate.of(edge.overshoot * 100.0, "")
    return found


def _crossing(edge: SlantedEdge, level: float) -> Estimate:
    found = edge.crossing(level)
    if found is None:
        return Estimate.of(Missing(f"the response stays above {level:.3g} up to 1 cycle/pixel"), "")
    spread = np.interp(found.value, edge.frequency_cycles_per_pixel, edge.standard_uncertainty)
    if level < _LEVEL_SIGMAS * spread:
        return Estimate.of(Missing(f"noise hides where the response falls to {level:.3g}"), "")
    return Estimate.of(found, "")


def _standard(plane: Array, order: int) -> Estimate:
    """Return the MTF50 of the standard's arithmetic; it has no uncertainty."""
    try:
        frequency, response = standard_sfr(plane, order)
    except InputError as error:
        return Estimate(reason=str(error))
    below = np.flatnonzero(response < 0.5)
    if not below.size or below[0] == 0:
        return Estimate(reason="the response stays above 0.5")
    k = int(below[0])
    part = (response[k - 1] - 0.5) / (response[k - 1] - response[k])
    return Estimate(float(frequency[k - 1] + part * (frequency[k] - frequency[k - 1])))


def _curves(edge: SlantedEdge, channel: str) -> list[Curve]:
    frequency = edge.frequency_cycles_per_pixel
    shown = frequency <= _SHOWN_TO
    return [
        Curve(
            *(channel, "spatial frequency (cycles/pixel)", "SFR"),
            *(frequency[shown], edge.mtf[shown], edge.standard_uncertainty[shown]),
        ),
        Curve(
            *(channel, "distance from the edge (pixels)", "edge profile"),
            *(edge.distance, edge.profile, edge.profile_standard_uncertainty),
        ),
    ]


def _diagnostics(edge: SlantedEdge, channel: str) -> list[Diagnostic]:
    found = []
    excess = edge.mtf[: edge.mtf.size // 2 + 1] - 1.0
    peak = int(np.argmax(excess))
    if excess[peak] > max(_SHARPENED_RESPONSE, _SIGNIFICANT * edge.standard_uncertainty[peak]):
        at = edge.frequency_cycles_per_pixel[peak]
        text = f"channel {channel}: the response reaches {1.0 + excess[peak]:.3g} at {at:.2g} cycles/pixel"
        found.append(SHARPENED(f"{text}, as sharpening does", float(excess[peak])))
    nyquist = float(edge.mtf[edge.mtf.size // 2])
    if nyquist > _ALIASED_RESPONSE:
        found.append(UNDERSAMPLED(f"channel {channel}: the response at 0.5 cycles/pixel is {nyquist:.2g}", nyquist))
    return found


_FREQUENCY = "cycles/pixel"
MEASUREMENT = Measurement(
    title="Spatial frequency response of an edge (e-SFR)",
    standard="ISO 12233:2023, edge-based response",
    charts=("slanted-edge",),
    measure=_measure,
    quantities={
        "mtf50": Quantity("MTF50", _FREQUENCY, "Lowest frequency at which the response is 0.5."),
        "mtf50p": Quantity("MTF50P", _FREQUENCY, "Lowest frequency at which the response is half its maximum."),
        "mtf30": Quantity("MTF30", _FREQUENCY, "Lowest frequency at which the response is 0.3."),
        "mtf10": Quantity("MTF10", _FREQUENCY, "Lowest frequency at which the response is 0.1: limiting resolution."),
        "response_nyquist": Quantity("SFR at Nyquist", "", "Response at 0.5 cycles/pixel."),
        "edge_rise": Quantity("10-90 % rise", "pixels", "Distance over which the edge rises from 10 to 90 %."),
        "overshoot_percent": Quantity("overshoot", "%", "Largest profile value above the bright side."),
        "mtf50_standard": Quantity("MTF50, standard", _FREQUENCY, "MTF50 by the standard's own arithmetic."),
    },
    oracle="lens times pixel transfer function of simulated edges; sfrmat5 on published edges",
    left_out=(
        "Linearization by an OECF of the same chart: frames are proportional to light, or sRGB. The standard's own "
        "MTF50 needs a value of the channel at each pixel."
    ),
    order=100,
    view="fine",
    headline=("mtf50", "overshoot_percent"),
    figure="curves",
)
