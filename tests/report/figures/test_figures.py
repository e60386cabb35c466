"""Figures have units and readable, separate texts, and show the given numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

import photosite as ps
from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.metrics.snr import noise_budget
from photosite.report.figures.response import curve_figure, snr_figure
from photosite.report.figures.sensor import noise_budget_figure, spectral_sensitivity_figure
from photosite.report.figures.validation import (
    _snr_error_db,
    color_difference_figure,
    deviations_figure,
    patch_means_figure,
    patch_snr_figure,
)
from photosite.report.style import styled
from photosite.sensor.sections import Channel
from photosite.values.region import Region
from photosite.values.uncertain import Uncertain


@pytest.fixture(scope="module")
def figures(loop) -> dict[str, Figure]:
    """One figure of each kind."""
    curves = loop.calibration.curves
    figures = {
        kind: curve_figure({channel: found[kind] for channel, found in curves.items()}, residuals)
        for kind, residuals in (("photon_transfer", "standard"), ("response", "percent"), ("dark_variance", "standard"))
    }
    figures["noise budget"] = noise_budget_figure(loop.true_sensor, loop.calibration.sensor)
    figures["noise budget of a small pixel"] = noise_budget_figure(ps.load_sensor("vendor-2.2um"))
    figures["sensitivity"] = spectral_sensitivity_figure(loop.true_sensor)
    figures["signal-to-noise"] = snr_figure(loop.calibration.snr)
    figures["means"] = patch_means_figure(loop.validation, "true sensor", "calibrated sensor")
    figures["snr"] = patch_snr_figure(loop.validation)
    figures["colours"] = color_difference_figure(loop.validation.color)
    rows = [row for row in loop.parameters if row.deviation is not None]
    figures["deviations"] = deviations_figure([f"{r.label} ({r.unit})" for r in rows], [r.deviation for r in rows])
    return figures


def texts(figure: Figure) -> list[Text]:
    """Return the visible texts; tick labels outside the range of their axis are not drawn."""
    found = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip()]
    seen = []
    children = [child for parent in figure.axes for child in parent.child_axes]
    for axes in (*figure.axes, *children):
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            drawn = set()
            for ticks in (axis.get_major_ticks(), axis.get_minor_ticks()):
                drawn |= {id(tick.label1) for tick in ticks if low <= tick.get_loc() <= high}
            labels = {id(t.label1) for t in (*axis.majorTicks, *axis.minorTicks)}
            labels |= {id(t.label2) for t in (*axis.majorTicks, *axis.minorTicks)}
            seen += [t for t in found if id(t) in labels and id(t) in drawn]
            found = [t for t in found if id(t) not in labels]
    return seen + found


def test_axes_have_labels_with_units_and_content(figures: dict[str, Figure]) -> None:
    bracketed = "DN|DN²|e⁻|s|V|dB|nm|%|std\\. unc\\.|ΔE units|standard uncertainties"
    units = rf"^signal-to-noise ratio$|photons per pixel$|\(({bracketed})\)$"
    for name, figure in figures.items():
        for axes in figure.axes:
            assert axes.lines or axes.collections, f"{name}: empty axes"
            named_below = axes.get_shared_x_axes().get_siblings(axes)
            labels = [a.get_xlabel() for a in named_below if a.get_xlabel()]
            assert len(labels) == 1, name
            assert re.search(units, labels[0]), f"{name}: {labels[0]}"
            if not [label for label in axes.get_yticklabels() if re.search("[a-z]{3}", label.get_text())]:
                assert re.search(units, axes.get_ylabel()), f"{name}: {axes.get_ylabel()}"


def test_texts_are_readable_and_do_not_overlap(figures: dict[str, Figure]) -> None:
    for name, figure in figures.items():
        canvas = FigureCanvasAgg(figure)
        with styled():
            canvas.draw()
        renderer = canvas.get_renderer()
        boxes = []
        for text in texts(figure):
            assert text.get_fontsize() >= 9.0, f"{name}: {text.get_text()}"
            boxes.append((text.get_text(), text.get_window_extent(renderer)))
        assert len(boxes) > 5, name
        frame = Bbox.from_bounds(-0.5, -0.5, figure.bbox.width + 1, figure.bbox.height + 1)
        for text, box in boxes:
            assert frame.contains(box.x0, box.y0), f"{name}: '{text}' leaves the figure"
            assert frame.contains(box.x1, box.y1), f"{name}: '{text}' leaves the figure"
        for (one, box), (other, other_box) in combinations(boxes, 2):
            overlap = Bbox.intersection(box, other_box)
            assert overlap is None or min(overlap.width, overlap.height) < 1.0, f"{name}: '{one}' over '{other}'"


# What the figures show.


def curve(**changes: object) -> Curve:
    x = np.array([1.0, 10.0, 100.0, 1000.0, 1200.0])
    entries = {
        "title": "t",
        "x_label": "signal (DN)",
        "y_label": "variance (DN²)",
        "x": x,
        "y": np.array([0.6, 5.0, 51.0, 500.0, -3.0]),
        "y_uncertainty": np.array([0.1, 0.2, 1.0, 9.0, 1.0]),
        "used": np.array([True, True, True, True, False]),
        "intercept": 0.0,
        "slope": 0.5,
        "extra_variance": 0.75,
    }
    return Curve(**(entries | changes))


def test_curve_shows_used_and_unused_points_and_the_line() -> None:
    upper, lower = curve_figure({"M": curve()}).axes
    filled, hollow, line = upper.lines
    bars = [bar.get_segments() for bar in upper.collections[:2]]
    assert [len(segments) for segments in bars] == [4, 1]
    np.testing.assert_allclose(bars[0][2], [[100, 51 - 1.959964], [100, 51 + 1.959964]], rtol=1e-6)
    np.testing.assert_array_equal(filled.get_xdata(), [1, 10, 100, 1000])
    assert filled.get_markerfacecolor() == filled.get_color()
    np.testing.assert_array_equal(hollow.get_xdata(), [1200])
    assert hollow.get_markerfacecolor() == "white"
    assert (upper.get_xscale(), upper.get_yscale()) == ("linear", "linear")
    np.testing.assert_allclose(line.get_ydata(), 0.5 * line.get_xdata())
    np.testing.assert_allclose(line.get_xdata()[[0, -1]], [1, 1000])
    expected = (np.array([0.6, 5.0, 51.0, 500.0]) - [0.5, 5, 50, 500]) / np.sqrt([0.76, 0.79, 1.75, 81.75])
    np.testing.assert_allclose(lower.lines[0].get_ydata(), expected)


def band_of(axes: Axes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return abscissae, lower and upper edge of the last band."""
    vertices = axes.collections[-1].get_paths()[0].vertices
    x = np.unique(vertices[:, 0])
    edges = np.array([[vertices[vertices[:, 0] == at, 1].min(), vertices[vertices[:, 0] == at, 1].max()] for at in x])
    return x, edges[:, 0], edges[:, 1]


def test_band_of_a_line_is_that_of_its_covariance() -> None:
    """u^2(a + b x) = u^2(a) + 2 x u(a, b) + x^2 u^2(b), here smallest at x = 50."""
    covariance = np.array([[4.0, -0.05], [-0.05, 0.001]])
    line = curve(intercept=2.0, line_covariance=covariance)
    upper, lower = curve_figure({"M": line}).axes
    x, low, high = band_of(upper)
    u = np.sqrt(4.0 - 0.1 * x + 0.001 * x**2)
    np.testing.assert_allclose(high, 2.0 + 0.5 * x + 1.959964 * u, rtol=1e-6)
    np.testing.assert_allclose(low, 2.0 + 0.5 * x - 1.959964 * u, rtol=1e-6, atol=1e-9)
    x, low, high = band_of(lower)
    np.testing.assert_array_equal(x, [1, 10, 100, 1000])
    u = np.sqrt(4.0 - 0.1 * x + 0.001 * x**2)
    np.testing.assert_allclose(high, 1.959964 * u / np.sqrt([0.76, 0.79, 1.75, 81.75]), rtol=1e-6)
    np.testing.assert_allclose(low, -high)


def snr(photons: bool = True) -> SnrCurve:
    x = np.array([10.0, 100.0, 1000.0])
    used = np.array([True, True, False])
    response, gain, dark = Uncertain.of(0.25, 0.01), Uncertain.of(0.5, 0.02), Uncertain.of(2.0, 0.1)
    return SnrCurve(x, np.sqrt(x) / 2, np.sqrt(x) / 20, used, photons, response, gain, dark)


def test_snr_shows_points_model_band_and_the_ideal_sensor() -> None:
    figure = snr_figure({"M": snr()}, {"M": (1.0, 0.01)})
    axes = figure.axes[0]
    filled, hollow, model, total, ideal = axes.lines
    np.testing.assert_array_equal(filled.get_xdata(), [10, 100])
    np.testing.assert_array_equal(hollow.get_xdata(), [1000])
    x = ideal.get_xdata()
    np.testing.assert_allclose(ideal.get_ydata(), np.sqrt(x))
    np.testing.assert_allclose(model.get_ydata(), 0.25 * x / np.sqrt(2.0 + 0.125 * x))
    pattern = 1.0 + (0.01 * 0.25 * x) ** 2
    np.testing.assert_allclose(total.get_ydata(), 0.25 * x / np.sqrt(2.0 + 0.125 * x + pattern))
    at, low, high = band_of(axes)
    value, uncertainty = snr().model(at)
    np.testing.assert_allclose(high - low, 2 * 1.959964 * uncertainty, rtol=1e-6)
    np.testing.assert_allclose(high + low, 2 * value, rtol=1e-6)


def test_snr_without_photons_is_against_electrons() -> None:
    assert snr_figure({"M": snr(photons=False)}).axes[0].get_xlabel() == "signal (e⁻)"


def test_residuals_in_percent_of_the_line() -> None:
    _, lower = curve_figure({"M": curve()}, "percent").axes
    np.testing.assert_allclose(lower.lines[0].get_ydata(), [20.0, 0.0, 2.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("y", [[0.6, 5, 51, -500, 1], [-0.6, 5, 51, 500, 1]])
def test_axes_are_linear_where_fitted_points_are_not_above_zero(y: list[float]) -> None:
    upper, _ = curve_figure({"M": curve(y=np.array(y, float))}).axes
    assert (upper.get_xscale(), upper.get_yscale()) == ("linear", "linear")


def test_non_finite_points_are_omitted() -> None:
    upper, _ = curve_figure({"M": curve(y=np.array([0.6, np.nan, 51.0, 500.0, 1.0]))}).axes
    np.testing.assert_array_equal(upper.lines[0].get_xdata(), [1, 100, 1000])


def test_curve_without_a_fit_has_no_line() -> None:
    upper, lower = curve_figure({"M": curve(intercept=None, slope=None)}).axes
    assert not [line for line in upper.lines if line.get_linestyle() != "None"]
    assert len(lower.lines) == 3, "zero and the two limits"


def test_channels_differ_without_colour(loop) -> None:
    curves = {channel: found["response"] for channel, found in loop.calibration.curves.items()}
    figure = curve_figure(curves)
    handles = figure.legends[0].get_lines()[:3]
    assert len({(h.get_marker(), h.get_linestyle()) for h in handles}) == 3


def test_noise_budget_is_that_of_the_sensor(loop) -> None:
    sensor = loop.true_sensor
    axes = noise_budget_figure(sensor, loop.calibration.sensor).axes[0]
    total = axes.lines[0]
    expected = noise_budget(sensor, total.get_xdata())
    np.testing.assert_array_equal(total.get_ydata(), expected.total_db)
    rings = next(line for line in axes.lines if line.get_label() == "as calibrated")
    calibrated = noise_budget(loop.calibration.sensor, rings.get_xdata())
    np.testing.assert_array_equal(rings.get_ydata(), calibrated.total_db)


def test_absent_noise_has_no_line() -> None:
    axes = noise_budget_figure(ps.load_sensor("nikon-d200").with_(prnu_percent=0, dsnu_mv=0)).axes[0]
    labels = {line.get_label() for line in axes.lines}
    assert {"total", "shot noise", "read noise"} <= labels
    assert not labels & {"PRNU", "DSNU"}


def test_sensitivity_has_a_95_percent_band_where_an_uncertainty_is_known() -> None:
    sensor = ps.load_sensor("nikon-d200")
    known = Channel(wavelength_nm=(500, 600), quantum_efficiency=(0.2, 0.4), standard_uncertainty=(0.01, 0.02))
    axes = spectral_sensitivity_figure(sensor.with_(channels={**sensor.channels, "G": known})).axes[0]
    (band,) = axes.collections
    corners = {(round(x), round(y, 2)) for x, y in band.get_paths()[0].vertices}
    assert corners == {(500, 18.04), (500, 21.96), (600, 36.08), (600, 43.92)}


def test_patch_means_are_those_of_the_comparison(loop) -> None:
    upper, lower = patch_means_figure(loop.validation).axes
    seen, made, used = loop.validation.measured, loop.validation.simulated, loop.validation.used
    for k, channel in enumerate(seen.channels):
        line = next(line for line in upper.lines if line.get_label() == channel)
        np.testing.assert_array_equal(line.get_xdata(), made.mean_dn[used[:, k], k])
        np.testing.assert_array_equal(line.get_ydata(), seen.mean_dn[used[:, k], k])
    assert lower.get_ylabel() == "difference (%)"


def test_saturated_patches_are_left_out(loop) -> None:
    used = loop.validation.used.copy()
    used[3:] = False
    upper, _ = patch_snr_figure(replace(loop.validation, used=used)).axes
    assert sum(line.get_xdata().size for line in upper.lines if line.get_label() in ("R", "G", "B")) == 9


def test_error_of_the_snr_is_its_scatter() -> None:
    """Scatter over 3000 patches of Gaussian noise, dim enough that mean and noise count alike.

    The scatter's own relative error is 1.3 %, so 6 % is 4.6 standard errors: false alarms are below 1 in 10^5 (and the
    seed is fixed).
    """
    rng = np.random.default_rng(11)
    dn = np.rint(rng.normal(30_000.0, 5_000.0, (30_000, 20))).astype(np.uint16)
    frame = RawFrame(dn, bits=16, black_level_dn=24_000)
    found = patch_statistics(frame, [Region(str(n), 10 * n, 10 * n + 10, 0, 20) for n in range(3000)])
    said = _snr_error_db(found, np.ones(3000, dtype=bool), 0)
    assert np.sqrt(np.mean(said**2)) == pytest.approx(found.spatial_snr_db[:, 0].std(), rel=0.06)


def test_deviations_are_drawn_at_their_values() -> None:
    axes = deviations_figure(["a (DN)", "b (e⁻)"], [0.5, -7.0]).axes[0]
    points = axes.lines[-1]
    np.testing.assert_array_equal(points.get_xdata(), [0.5, -7.0])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a (DN)", "b (e⁻)"]
    low, high = axes.get_xlim()
    assert low < -7.0
    assert high > 1.96
