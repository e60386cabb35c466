"""The histogram of the noise: a density, beside the distributions it is compared with."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.result import Estimate
from photosite.calibration.tail import Tail
from photosite.calibration.temporal import TemporalNoise
from photosite.report.figures.noise_histogram import noise_histogram_figure


def noise(values, width=0.25):
    edges = (np.arange(1025) - 512) * width
    one = Estimate(1.0, 0.1)
    return TemporalNoise(
        frames=40,
        exposure_s=0.01,
        pixel_noise_dn=one,
        row_noise_dn=one,
        column_noise_dn=one,
        frame_noise_dn=one,
        tail=Tail(one, one, one, Estimate(0.14, 0.01)),
        bands={},
        residual_dn=(edges[1:] + edges[:-1]) / 2,
        residual_count=np.histogram(values, edges)[0],
    )


def test_points_and_curves_are_densities_of_the_same_noise() -> None:
    """Normal noise of 3 DN: points, normal curve and Tukey lambda of shape 0.14 agree where there are many readings."""
    (axes,) = noise_histogram_figure(noise(np.random.default_rng(1).normal(0, 3, 1_000_000))).axes
    points, normal, tukey = axes.get_lines()
    x, density = points.get_data()
    assert np.sum(density) * 0.5 == pytest.approx(1.0, abs=1e-6)  # two bins of 0.25 DN to a point
    core = np.abs(x) < 6
    for curve in (normal, tukey):
        assert np.interp(x, *curve.get_data())[core] == pytest.approx(density[core], rel=0.06)
    assert normal.get_label() == "normal, 2.99 DN by the quartiles"
    assert tukey.get_label() == "Tukey lambda, shape 0.140"
    assert axes.get_yscale() == "log"


def test_a_tail_leaves_the_normal_curve() -> None:
    rng = np.random.default_rng(2)
    values = np.concatenate([rng.normal(0, 3, 1_000_000), rng.normal(0, 15, 5000)])
    (axes,) = noise_histogram_figure(noise(values)).axes
    points, normal, _ = axes.get_lines()
    x, density = points.get_data()
    far = np.abs(np.abs(x) - 15) < 2
    assert (density[far] > 10 * np.interp(x, *normal.get_data())[far]).all()
