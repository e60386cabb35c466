"""The histogram of the noise: a density, beside the distributions it is compared with."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.chip_maps.noise_shape import NoiseShape
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.report.figures.noise_histogram import noise_histogram_figure
from photosite.values.estimate import Estimate


def noise(values, width=0.25, shape=Estimate(-0.05, 0.01)):  # noqa: B008
    edges = (np.arange(1025) - 512) * width
    one = Estimate(1.0, 0.1)
    return TemporalNoise(
        frames=40,
        exposure_s=0.01,
        pixel_noise_dn=one,
        row_noise_dn=one,
        column_noise_dn=one,
        frame_noise_dn=one,
        shape=NoiseShape(one, one, one, shape),
        bands={},
        residual_dn=(edges[1:] + edges[:-1]) / 2,
        residual_count=np.histogram(values, edges)[0],
    )


def test_points_and_curves_are_densities_of_the_same_noise() -> None:
    """Noise of Tukey's distribution of shape 0.3, which is told from normal: its points lie on its curve."""
    p = np.random.default_rng(1).random(1_000_000)
    values = 5 * (p**0.3 - (1 - p) ** 0.3)
    (axes,) = noise_histogram_figure(noise(values, width=0.05, shape=Estimate(0.3, 0.01))).axes
    points, _, tukey = axes.get_lines()
    x, density = points.get_data()
    assert np.sum(density) * 0.1 == pytest.approx(1.0, abs=1e-6)  # two bins of 0.05 DN to a point
    core = np.abs(x) < 2.5
    assert np.interp(x, *tukey.get_data())[core] == pytest.approx(density[core], rel=0.06)
    assert tukey.get_label() == "Tukey lambda, shape 0.300"
    assert axes.get_yscale() == "log"


def test_normal_noise_has_the_normal_curve_alone() -> None:
    values = np.random.default_rng(1).normal(0, 3, 1_000_000)
    for shape in (Estimate(0.14, 0.01), Estimate(0.1357, 0.0003)):
        (axes,) = noise_histogram_figure(noise(values, shape=shape)).axes
        points, normal = axes.get_lines()
        x, density = points.get_data()
        core = np.abs(x) < 6
        assert np.interp(x, *normal.get_data())[core] == pytest.approx(density[core], rel=0.06)
        assert normal.get_label() == "normal, 2.99 DN by the quartiles"


def test_a_curve_that_ends_before_the_readings_says_so() -> None:
    """All readings stay; shape 0.1 ends at 5.66 standard deviations, here of 3.2 DN, and 20 lie at 30."""
    values = np.concatenate([np.random.default_rng(3).normal(0, 3, 100_000), np.full(20, 30.1)])
    (axes,) = noise_histogram_figure(noise(values, shape=Estimate(0.1, 0.002))).axes
    labels = [line.get_label() for line in axes.get_lines()]
    (label,) = [text for text in labels if text.startswith("Tukey")]
    assert label.startswith("Tukey lambda, shape 0.100: ends at ±")
    assert label.endswith("DN, 20 readings beyond")
    assert axes.get_lines()[0].get_data()[0].max() > 30.0


def test_a_tail_leaves_the_normal_curve() -> None:
    rng = np.random.default_rng(2)
    values = np.concatenate([rng.normal(0, 3, 1_000_000), rng.normal(0, 15, 5000)])
    (axes,) = noise_histogram_figure(noise(values)).axes
    points, normal, _ = axes.get_lines()
    x, density = points.get_data()
    far = np.abs(np.abs(x) - 15) < 2
    assert (density[far] > 10 * np.interp(x, *normal.get_data())[far]).all()
