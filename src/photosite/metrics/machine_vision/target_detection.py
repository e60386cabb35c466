"""How well targets are detected: ideal-observer SNR of discs and Gaussian spots, and ranges by Johnson's criteria."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.machine_vision.information_capacity import alike_frequencies, sides_of_edge
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.noise_power import NoisePower, noise_power
from photosite.metrics.sharpness.edge_region import check_blur, check_edge, edge_region
from photosite.metrics.sharpness.slanted_edge import SlantedEdge, slanted_edge_mtf
from photosite.values.cfa import MONOCHROME
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Uncertain, Value

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]

COLORED_NOISE = DiagnosticKind(
    "colored-noise-beside-edge",
    "note",
    "The noise beside an edge is not white: it has another power at high frequencies than at low ones.",
    "Signal-to-noise ratios use its spectrum. A picture whose noise was reduced has no more information than before.",
    "Measure raw frames.",
    ("snr_disc", "snr_gaussian", "resolved"),
    "Power of the noise in the upper half of frequencies over that in the lower half.",
)
_ORDER, _REACH_PX = 5, 32.0
"""As for the response of edges."""
_BLOCK, _CLEAR_PX = 32, 12.0
_FIRST_RINGS, _STEPS, _SLOPE_POINTS = 4, 2001, 5
_COLORED, _SIGNIFICANT = 0.2, 4.0
_JOHNSON = {"detection": 1.0, "recognition": 4.0, "identification": 8.0}
"""Cycles over the target for a probability of 50 % (Johnson, Image Intensifier Symposium (1958), rounded)."""
_BAR_ASPECT, _BAR_SNR = 7.0, 2.8
"""Length over width of a bar, and the ratio at which half of the observers see it (Rosell and Willson, in Biberman,
Perception of Displayed Information (1973), chapter 5)."""


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.1,
    diameter_px: Positive = 4.0,
    target_m: Positive = 2.3,
    focal_length_mm: Positive | None = None,
    pitch_um: Positive | None = None,
) -> Result:
    region = edge_region(image, chart.region, _REACH_PX)
    if pitch_um is None and image.sensor is not None:
        pitch_um = image.sensor.pixel.width_um.value
    focal_length_mm = focal_length_mm or image.focal_length_mm
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    diagnostics: list[Diagnostic] = []
    for channel in image.channels:
        plane, tile = image.plane(channel, region)
        mask = image.mask(channel, region)
        check_edge(image, plane, mask, channel)
        name = channel if tile != MONOCHROME else None
        edge = slanted_edge_mtf(plane, channel=name, cfa=tile, order=_ORDER, reach_px=_REACH_PX)
        check_blur(edge, _REACH_PX)
        (dark, dark_noise), (bright, bright_noise) = sides_of_edge(plane, mask, edge)
        frames = len(image.frames)
        density = (dark_noise + bright_noise) * (0.5 * frames / image.density(channel))
        if density.value <= 0.0:
            raise InputError("noise beside the edge", value=density.value, expected="above 0")
        shape = _spectrum_shape(plane, edge) if mask.all() else None
        if shape is not None and (found := _colored(shape)) is not None:
            text = f"channel {channel}: high frequencies have {found:.2g} times the noise power of low ones"
            diagnostics.append(COLORED_NOISE(text, found))
        quanta = _Quanta.of(edge, (dark + bright) * 0.5, density, shape)
        for shape_name, spot in (("disc", _disc), ("gaussian", _gaussian)):
            ratio = quanta.snr(partial(spot, diameter_px=diameter_px), contrast)
            values[f"snr_{shape_name}", channel] = Estimate.of(ratio, "")
        resolved = quanta.resolved(contrast)
        values["resolved", channel] = Estimate.of(resolved, "")
        for task, cycles in _JOHNSON.items():
            found_range = _range(resolved, cycles, target_m, focal_length_mm, pitch_um)
            values[f"{task}_range", channel] = Estimate.of(found_range, "")
        curves.append(quanta.curve(channel))
    return Result(values, tuple(curves), (), tuple(diagnostics))


def _spectrum_shape(plane: Array, edge: SlantedEdge) -> NoisePower | None:
    """Return the spectrum of the noise on both sides of an edge; None where there is no room."""
    turned = plane if edge.direction == "vertical" else plane.T
    at = edge.edge_position
    blocks = []
    for top in range(0, turned.shape[0] - _BLOCK + 1, _BLOCK):
        low, high = at[top : top + _BLOCK].min() - _CLEAR_PX, at[top : top + _BLOCK].max() + _CLEAR_PX
        starts = [
            *range(0, int(low) - _BLOCK + 1, _BLOCK),
            *range(math.ceil(high), turned.shape[1] - _BLOCK + 1, _BLOCK),
        ]
        blocks += [turned[top : top + _BLOCK, left : left + _BLOCK] for left in starts]
    return noise_power(blocks, 1, _BLOCK) if blocks else None


def _colored(spectrum: NoisePower) -> float | None:
    """Return the power of high over that of low frequencies, if it differs from 1 by more than chance."""
    ratio = spectrum.mean(0.5, 1.0) / spectrum.mean(0.0, 0.5)
    away = abs(ratio.value - 1.0)
    return ratio.value if away > max(_COLORED, _SIGNIFICANT * ratio.standard_uncertainty) else None


@dataclass(frozen=True, eq=False)
class _Quanta:
    """Noise-equivalent quanta over radial frequencies, signal^2 mtf^2 / noise power, over those at zero frequency.

    `square` has the standard uncertainty `error` of the edge; `zero` are the quanta at zero frequency, `relative` is
    the uncertainty of the noise power in rings, and `bins` the ring of each frequency.
    """

    frequency: Array
    square: Array
    error: Array
    zero: Uncertain
    relative: Array
    bins: NDArray[np.intp]

    @classmethod
    def of(cls, edge: SlantedEdge, level: Uncertain, density: Uncertain, shape: NoisePower | None) -> _Quanta:
        frequency = edge.frequency_cycles_per_pixel
        shown = frequency <= 0.5
        f, mtf, spread = frequency[shown], edge.mtf[shown], edge.standard_uncertainty[shown]
        noise, relative, bins = np.ones_like(f), np.zeros_like(f), np.zeros(f.size, np.intp)
        if shape is not None and _colored(shape) is not None:
            at, power, scatter = shape.radial()
            # Below the first ring the logarithm is continued as a parabola.
            curvature, top = np.polyfit(at[:_FIRST_RINGS] ** 2, np.log(power[:_FIRST_RINGS]), 1)
            low = np.exp(top + curvature * (0.5 * at[0]) ** 2)
            mean = float(np.where(np.isnan(shape.power), low, shape.power).mean())
            noise = np.where(f < at[0], np.exp(top + curvature * f**2), np.interp(f, at, power)) / mean
            bins = np.argmin(np.abs(f[:, None] - at), axis=1)
            relative = (scatter / power)[bins]
        # Noise adds its variance to the square of the response, in phase and out of phase.
        square = (mtf**2 - 2.0 * spread**2) / noise
        return cls(f, square, 2.0 * mtf * spread / noise, level * level / density, relative, bins)

    def snr(self, spot: Callable[[Array], Array], contrast: float) -> Value:
        """Return contrast times the root of the integral of spot^2 neq over all directions.

        The quanta are linear between frequencies.
        """
        fine = np.linspace(0.0, float(self.frequency[-1]), _STEPS)
        density = 2.0 * math.pi * fine * spot(fine) ** 2 * (fine[1] - fine[0])
        place = np.interp(fine, self.frequency, np.arange(self.frequency.size))
        low = np.minimum(place.astype(np.intp), self.frequency.size - 2)
        weight = np.bincount(low, density * (low + 1 - place), self.frequency.size)
        weight += np.bincount(low + 1, density * (place - low), self.frequency.size)
        parts = weight * self.square
        total = float(parts.sum())
        if total <= 0.0:
            return Missing("the response is not above noise")
        edge = alike_frequencies(self.frequency) * float(((weight * self.error) ** 2).sum())
        noise = sum(float((parts * self.relative)[self.bins == k].sum()) ** 2 for k in np.unique(self.bins))
        integral = Uncertain.of(total, math.sqrt(edge + noise))
        return (integral * self.zero).sqrt() * contrast

    def resolved(self, contrast: float) -> Value:
        """Return the highest frequency whose bars are seen, of width 1 / (2 f) and seven times that length."""
        area = _BAR_ASPECT / (2.0 * np.maximum(self.frequency, 1e-6)) ** 2
        ratio = contrast * np.sqrt(np.maximum(self.square, 0.0) * self.zero.value * area)
        below = np.flatnonzero(ratio < _BAR_SNR)
        if not below.size:
            return Missing("bars are seen up to 0.5 cycles/pixel")
        if below[0] == 0:
            return Missing("bars are seen at no frequency")
        k = int(below[0])
        step = (ratio[k] - ratio[k - 1]) / (self.frequency[k] - self.frequency[k - 1])
        found = float(self.frequency[k - 1] + (_BAR_SNR - ratio[k - 1]) / step)
        # Noise changes the slope between neighbors by its own amount.
        near = slice(max(k - _SLOPE_POINTS, k // 2), k + _SLOPE_POINTS)
        slope = float(np.polyfit(self.frequency[near], ratio[near], 1)[0])
        own = 0.5 * ratio[k] * math.hypot(self.error[k] / max(self.square[k], 1e-12), float(self.relative[k]))
        at_limit = Uncertain.of(_BAR_SNR, own) + (self.zero / self.zero.value - 1.0) * (0.5 * _BAR_SNR)
        limit: Uncertain = (at_limit - _BAR_SNR) * float(-1.0 / slope) + found
        return limit

    def curve(self, channel: str) -> Curve:
        """Return the noise-equivalent quanta."""
        neq = self.zero.value * self.square
        relative = np.hypot(self.error / np.maximum(self.square, 1e-9), np.hypot(self.relative, self.zero.relative))
        label = "noise-equivalent quanta (per pixel)"
        return Curve(channel, "spatial frequency (cycles/pixel)", label, self.frequency, neq, np.abs(neq) * relative)


def _disc(frequency: Array, diameter_px: float) -> Array:
    """Return the transform of a disc of height 1."""
    from scipy.special import j1

    x = math.pi * diameter_px * np.maximum(frequency, 1e-9)
    return np.asarray(0.5 * math.pi * diameter_px**2 * j1(x) / x)


def _gaussian(frequency: Array, diameter_px: float) -> Array:
    """Return the transform of a Gaussian spot of height 1 whose standard deviation is half the diameter."""
    sigma = 0.5 * diameter_px
    return np.asarray(2.0 * math.pi * sigma**2 * np.exp(-2.0 * (math.pi * sigma * frequency) ** 2))


def _range(resolved: Value, cycles: float, target_m: float, focal_mm: float | None, pitch_um: float | None) -> Value:
    if focal_mm is None or pitch_um is None:
        return Missing("focal_length_mm, and pitch_um or a sensor, are needed")
    if isinstance(resolved, Missing):
        return resolved
    return resolved * (target_m * focal_mm * 1e-3 / (pitch_um * 1e-6 * cycles))


MEASUREMENT = Measurement(
    title="Detection of targets",
    standard="ICRU Report 54 (1996), ideal observer; Johnson (1958) and Rosell and Willson (1973), ranges",
    charts=("slanted-edge",),
    measure=_measure,
    quantities={
        "snr_disc": Quantity(
            "ideal-observer SNR, disc",
            "",
            "Of a disc of `diameter_px` and relative `contrast` on the mean of the sides.",
        ),
        "snr_gaussian": Quantity(
            "ideal-observer SNR, Gaussian", "", "Of a Gaussian spot of that contrast and a sigma of `diameter_px` / 2."
        ),
        "resolved": Quantity(
            "resolved bars", "cycles/pixel", "Highest frequency of bars of `contrast` and 7:1 whose SNR is 2.8."
        ),
        "detection_range": Quantity("detection range", "m", "1 cycle over `target_m`, with `focal_length_mm`."),
        "recognition_range": Quantity("recognition range", "m", "4 cycles over `target_m`."),
        "identification_range": Quantity("identification range", "m", "8 cycles over `target_m`."),
    },
    oracle="closed forms of a Gaussian blur and white noise",
    left_out=(
        "Targets are seen up to 0.5 cycles/pixel; frequencies that alias are left out. The response across the edge "
        "stands for all directions. Noise is white where its spectrum does not differ from that by more than chance, "
        "and in mosaics. Johnson's 6.4 cycles for identification are rounded to 8. Air and display are left out."
    ),
    order=420,
    view="fine",
    headline=("snr_disc",),
    figure="curves",
)
