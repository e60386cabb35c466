"""Figures of rows, columns, readout channels, response curve, glow and drift show values and intervals."""

import numpy as np
import pytest

from photosite.calibration.effects.black_level_drift import measure_drift
from photosite.calibration.effects.glow import find_glow
from photosite.calibration.photon_transfer.response_curve import ResponseCurve
from photosite.report.effects.black_level_drift import drift_figure
from photosite.report.effects.glow import glow_figure
from photosite.report.effects.line_pattern import line_pattern_figure
from photosite.report.effects.readout_channels import readout_channels_figure
from photosite.report.effects.response_curve import response_curve_figure
from photosite.sensor.effects.glow import Glow
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Measured, Uncertain


def points(axes):
    """All points of the axes, by place."""
    return dict(sorted((x, y) for line in axes.lines for x, y in zip(*line.get_data(), strict=True)))


def test_channels_are_drawn_with_gains_in_percent_and_offsets():
    gains = ((Measured(1.02, 0.001), Measured(0.98, 0.001)),)
    figure = readout_channels_figure(ReadoutChannels(relative_gain=gains, offset_e=((3.0, -3.0),)))
    assert [axes.get_ylabel() for axes in figure.axes] == ["gain deviation (%)", "offset (e⁻)"]
    drawn = figure.axes[0].lines[0].get_data()[1]
    assert drawn == pytest.approx([2.0, -2.0])
    ends = figure.axes[0].collections[0].get_segments()[0][:, 1]
    assert np.ptp(ends) == pytest.approx(2 * 1.96 * 0.1, rel=1e-3)
    assert len(readout_channels_figure(ReadoutChannels(offset_e=((3.0, -3.0),))).axes) == 1


def test_lines_without_an_estimate_are_left_out_and_negative_ones_are_hollow_at_zero():
    noise = {
        "known": Estimate(2.0, 0.1),
        "below": Estimate(-0.5, 0.4, upper_limit_95=0.6),
        "missing": Estimate(reason="no dark frames"),
    }
    axes = line_pattern_figure(noise, {"missing": Estimate(reason="no flat fields")}).axes
    assert len(axes) == 1
    assert points(axes[0]) == {0.0: 1.0, 2.0: 0.0}
    hollow = [line for line in axes[0].lines if line.get_markerfacecolor() == "white"]
    assert [list(line.get_data()[1]) for line in hollow] == [[1.0]]


def test_the_response_curve_has_its_band():
    bend = tuple(Uncertain.of(0.01 * i, 0.001 * i) for i in (1, 3, 2))
    curve = ResponseCurve(Uncertain.of(0.5, 0.001), np.array([100.0, 300.0, 200.0]), bend, bend, None)
    axes = response_curve_figure({"M": curve}).axes[0]
    x, y = axes.lines[0].get_data()
    assert list(x) == [100.0, 200.0, 300.0]
    assert y == pytest.approx(100 * np.expm1([-0.01, -0.02, -0.03]))
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    low, high = curve.deviation_percent[1].interval_95
    assert (band.min(), band.max()) == (pytest.approx(low), pytest.approx(curve.deviation_percent[0].interval_95[1]))
    assert high > low


def test_the_map_of_the_dark_current_covers_the_chip_in_its_unit():
    glow = Glow(places=("left",), peak_e_per_s=20, decay_pixels=12)
    found = find_glow(np.random.default_rng(1).gamma(4.0, 1.0, (64, 80)) + glow.map(64, 80), Uncertain(1.0))
    axes, bar = glow_figure(found).axes
    assert axes.images[0].get_extent() == [-0.5, 79.5, 63.5, -0.5]
    assert bar.get_ylabel() == "dark current (DN/s)"


def test_series_of_dark_frames_are_drawn_less_their_means():
    found = measure_drift([[64.0, 65.0, 66.0, 67.0], [60.0, 62.0]], [0.01, 0.01], Uncertain(0.5))
    lines = drift_figure(found).axes[0].lines
    assert list(lines[0].get_data()[1]) == [-1.5, -0.5, 0.5, 1.5]
    assert list(lines[1].get_data()[1]) == [-1.0, 1.0]
