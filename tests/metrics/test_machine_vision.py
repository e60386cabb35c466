"""Contrast detection and information capacity against Gaussian closed forms."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from virtual_charts import VirtualEdge, virtual_edge

from photosite.metrics.chart_image import ChartImage, chart_image
from photosite.metrics.charts.placed_chart import placed_chart
from photosite.metrics.measure import measure

SHAPE = (264, 392)
CHART = placed_chart(chart_image(np.ones(SHAPE)), "macbeth")
LUMINANCE = dict(zip(CHART.patches, CHART.patch_xyz[:, 1] / CHART.patch_xyz[:, 1].max(), strict=True))


def test_contrast_detection_is_the_gaussian_probability() -> None:
    """Of 48 probabilities, 95 % intervals miss more than 7 in 1 of 300 runs."""
    random = np.random.default_rng(11)
    missed = count = 0
    for _ in range(12):
        brightest, floor = 10 ** random.uniform(2.3, 3.5), random.uniform(2.0, 10.0)
        clean = np.full(SHAPE, 1.0)
        for patch, luminance in LUMINANCE.items():
            clean[patch.r0 : patch.r1, patch.c0 : patch.c1] = brightest * luminance
        sigma = np.sqrt(clean + floor**2)
        image = ChartImage((clean + sigma * random.normal(size=SHAPE) + 1e4,), "raw", black=1e4, white=1e6)
        found = measure(image, "macbeth", only=["contrast-detection"])["contrast-detection"]
        gray = {patch.name: brightest * value for patch, value in LUMINANCE.items()}
        for (quantity, part), estimate in found.values.items():
            if quantity != "probability":
                continue
            dark, bright = (gray[name] for name in part.removeprefix("M, ").split(" and "))
            contrast = bright / dark - 1.0
            one, other = (1.0 + contrast * factor for factor in (0.5, 1.5))
            # bright - a dark is Gaussian; a negative dark signal counts as no contrast.
            spread = [math.sqrt(bright + floor**2 + a**2 * (dark + floor**2)) for a in (one, other)]
            truth = ndtr((bright - one * dark) / spread[0]) - ndtr((bright - other * dark) / spread[1])
            if dark < 4.0 * math.sqrt(dark + floor**2):
                continue  # negative signals matter
            low, high = estimate.interval_95 or (1.0, 0.0)
            missed += not low - 1e-9 <= truth <= high + 1e-9
            count += 1
    print(f"{100 * (1 - missed / count):.1f} % of {count}")
    assert count >= 40
    assert missed <= 0.15 * count


def capacity(edge: VirtualEdge, dark: float, bright: float) -> float:
    frequency = np.linspace(0.0, 0.5, 2001)
    response = np.array([edge.response(f) for f in frequency])
    noise = (dark + bright) / 2 + 25.0
    power = (bright - dark) ** 2 / 12.0
    integrand = np.log2(1.0 + power * response**2 / noise) * 2 * np.pi * frequency
    return float(np.trapezoid(integrand, frequency))


def sides(electrons: NDArray[np.float64]) -> tuple[float, float]:
    left, right = float(electrons[:, :8].mean()), float(electrons[:, -8:].mean())
    return min(left, right), max(left, right)


def test_capacity_is_the_closed_form() -> None:
    """Of 60 edges, 95 % intervals miss more than 8 in 1 of 200 runs."""
    random = np.random.default_rng(12)
    missed = 0
    for _ in range(60):
        edge = virtual_edge(random)
        found = measure(edge.electrons, "slanted-edge", only=["information-capacity"])["information-capacity"]
        truth = capacity(edge, *sides(edge.electrons))
        estimate = found["capacity"]
        low, high = estimate.interval_95 or (1.0, 0.0)
        missed += not low <= truth <= high
    print(f"{100 * (1 - missed / 60):.1f} %")
    assert missed <= 8
