"""Figures of EMVA 1288's spatial analysis and of its general model show the given numbers."""

from __future__ import annotations

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.calibration.spatial.line_noise import TemporalComponents
from photosite.calibration.spatial.spatial_analysis import MeanPlanes, OutlierThresholds, spatial_analysis, spectrogram
from photosite.report.figures.chip import histogram_figure, profiles_figure, spectrogram_figure, white_band
from photosite.report.figures.response import general_model_figure
from photosite.report.style import label_log_ticks, new_figure, styled, thinned
from photosite.values.uncertain import Missing, Uncertain

TILE = np.array([[0, 1], [1, 2]])


@pytest.fixture(scope="module")
def spatial():
    rng = np.random.default_rng(1)
    dark = np.round(20.0 * (64.0 + rng.normal(0.0, 0.4, (120, 144)))) / 20.0
    light = dark + 1000.0 * (1.0 + 0.01 * rng.normal(size=dark.shape))
    none = Uncertain(0.0)
    noise = TemporalComponents(Uncertain(0.05), none, none)
    planes = [[MeanPlanes.of(mean, TILE, k, 20, 0.01, noise) for mean in (dark, light)] for k in range(3)]
    return {
        name: spatial_analysis(*pair, OutlierThresholds(dark_dn=1.5)) for name, pair in zip("RGB", planes, strict=True)
    }


def lines_of(axes):
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 2]


def test_spectrograms_are_square_roots_of_power(spatial):
    pattern = spatial["G"].dark
    figure = spectrogram_figure({"M": pattern})
    for axes, plain, passed in zip(
        figure.axes,
        (pattern.horizontal, pattern.vertical),
        (pattern.horizontal_filtered, pattern.vertical_filtered),
        strict=True,
    ):
        drawn = lines_of(axes)
        np.testing.assert_allclose(drawn[0].get_ydata(), np.sqrt(plain.power[1:]))
        np.testing.assert_allclose(drawn[1].get_ydata(), np.sqrt(passed.power[1:]))
        level = [line.get_ydata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2]
        assert level == pytest.approx([np.sqrt(passed.white), np.sqrt(passed.temporal)])
        assert axes.get_ylabel() == "standard deviation (DN)"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["mean frame", "high-pass filtered", "white part, 95 %", "temporal noise"]


def test_several_channels_are_named(spatial):
    light = {channel: found.light for channel, found in spatial.items()}
    figure = spectrogram_figure(light)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["R", "G", "B", "mean frame", "high-pass filtered", "white part, 95 %"]
    assert len(lines_of(figure.axes[0])) == 6
    assert figure.axes[1].get_xlabel() == "frequency (cycles per pixel of the channel)"
    assert [text.get_text() for text in histogram_figure(light).legends[0].get_texts()][:3] == ["R", "G", "B"]


@pytest.mark.parametrize(
    ("value", "limits", "shown"),
    [
        *[(0.2, (0.1, 3.0), "0.2"), (0.3, (0.1, 3.0), ""), (1.4, (1, 1.9), "1.4"), (50000, (1000, 60000), "50000")],
        *[(20, (1, 1e6), ""), (1000, (1, 1e6), "1000"), (1e6, (1, 2e6), "$10^{6}$")],
    ],
)
def test_ticks_are_few_and_plain(value, limits, shown):
    _, axes = new_figure()
    axes.set(yscale="log", ylim=limits)
    label_log_ticks(axes.yaxis)
    assert axes.yaxis.get_minor_formatter()(value, 0) == shown


def test_a_figure_that_switches_on_interactive_mode_keeps_it():
    with styled():
        matplotlib.interactive(True)
    try:
        assert matplotlib.is_interactive()
    finally:
        matplotlib.interactive(False)


def test_profiles_are_drawn(spatial):
    found = spatial["B"]
    figure = profiles_figure(found)
    above, beside, below, _ = figure.axes
    by_label = {line.get_label(): line.get_ydata() for line in above.get_lines()}
    np.testing.assert_array_equal(by_label["maximum"], found.light.along_columns.highest)
    np.testing.assert_array_equal(by_label["middle line"], found.light.along_columns.middle)
    by_label = {line.get_label(): line.get_ydata() for line in beside.get_lines()}
    np.testing.assert_array_equal(by_label["mean"], found.light.along_rows.mean)
    assert [axes.get_title("left") for axes in (above, below)] == ["light − dark", "dark"]


def test_profiles_without_light():

    noise = TemporalComponents(Uncertain(0.05), Uncertain(0.0), Uncertain(0.0))
    dark = MeanPlanes.of(np.random.default_rng(1).normal(64.0, 0.4, (120, 144)), TILE, 0, 20, 0.01, noise)
    assert len(profiles_figure(spatial_analysis(dark, Missing("no light"))).axes) == 2


def test_histograms_with_the_normal_distribution(spatial):
    pattern = spatial["G"].dark
    left, right = histogram_figure({"M": pattern}).axes
    np.testing.assert_array_equal(left.patches[0].get_data().values, pattern.histogram.count)
    (normal,) = lines_of(left)
    np.testing.assert_allclose(normal.get_ydata(), pattern.histogram.normal())
    steps, beyond = lines_of(right)
    np.testing.assert_allclose(steps.get_ydata(), pattern.histogram.percent_beyond)
    np.testing.assert_allclose(beyond.get_ydata(), pattern.histogram.normal_beyond())
    thresholds = {line.get_xdata()[0] for line in left.get_lines() if len(line.get_xdata()) == 2}
    assert thresholds == {-1.5, 1.5}


def test_general_model_ratio_and_limits():
    x = np.array([1.0, 2.0, 4.0, 8.0])
    found = GeneralModel(
        "exposure_s", x, 10.0 * x, 0.0 * x, 10.0 + 0.0 * x, 0.0 * x, np.ones(4), np.array([10.0, 20.0, 40.0, np.nan]),
        0.1 * x, Uncertain(0.1), Uncertain(4.0), Missing("not asked"),
    )  # fmt: skip
    upper, lower = general_model_figure({"M": found}).axes
    points = lower.containers[0].lines[0]
    np.testing.assert_array_equal(points.get_ydata(), [10.0, 20.0, 40.0])
    verticals = [
        line.get_xdata()[0] for line in upper.get_lines() if len(set(line.get_xdata())) == 1 and line.get_ls() == ":"
    ]
    assert sorted(verticals) == [0.1, 4.0]
    assert lower.get_xlabel() == "exposure (s)"


def test_band_of_the_white_part_covers() -> None:
    """95 % of the frequencies of independent pixels; over 200 maps, 3 standard deviations of this share are 0.4 %."""
    rng = np.random.default_rng(4)
    inside = []
    for _ in range(200):
        found = spectrogram([rng.normal(0.0, 2.0, (40, 128))], axis=1)
        low, high = white_band(replace(found, white=4.0), lines=40)
        inside.append(np.mean((np.sqrt(found.power[1:-1]) > low) & (np.sqrt(found.power[1:-1]) < high)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.006)


def test_band_of_the_normal_distribution(spatial) -> None:
    found = spatial["G"].dark.histogram
    left, right = histogram_figure({"G": spatial["G"].dark}).axes
    count, share = found.normal(), found.normal_beyond()
    for axes, expected, deviation in (
        (left, count, np.sqrt(count)),
        (right, share, np.sqrt(share * (100 - share) / found.count.sum())),
    ):
        band = next(entry for entry in axes.collections if isinstance(entry, PolyCollection))
        top = band.get_paths()[0].vertices[:, 1].max()
        assert top == pytest.approx((expected + 1.959964 * deviation).max(), rel=1e-6)
        index = len(expected) // 2
        heights = set(np.round(band.get_paths()[0].vertices[:, 1], 9))
        assert round(float(expected[index] + 1.959963984540054 * deviation[index]), 9) in heights


def test_long_lines_are_thinned_without_losing_a_peak() -> None:
    y = np.zeros(100_000)
    y[54_321], y[777] = 7.0, -3.0
    x, thin = thinned(np.arange(100_000.0), y)
    assert len(x) == len(thin) <= 1600
    assert (thin.max(), thin.min()) == (7.0, -3.0)
    assert abs(x[thin.argmax()] - 54_321) < 100
