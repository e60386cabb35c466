"""Figures of a mapped chip: noise histogram, defect map and blinking pixels."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.chip_maps.noise_shape import NoiseShape
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise, Trace
from photosite.report.effects import pixel_defects
from photosite.report.effects.pixel_defects import defect_map_figure
from photosite.report.effects.telegraph_noise import telegraph_figure
from photosite.report.figures.chip import noise_histogram_figure
from photosite.report.style import svg_bytes
from photosite.sensor.chip import DefectKind, Defects, no_defects
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
    """Noise with a Tukey lambda distribution of shape 0.3: the points lie on its curve."""
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


def test_normal_noise_has_only_the_normal_curve() -> None:
    values = np.random.default_rng(1).normal(0, 3, 1_000_000)
    for shape in (Estimate(0.14, 0.01), Estimate(0.1357, 0.0003)):
        (axes,) = noise_histogram_figure(noise(values, shape=shape)).axes
        points, normal = axes.get_lines()
        x, density = points.get_data()
        core = np.abs(x) < 6
        assert np.interp(x, *normal.get_data())[core] == pytest.approx(density[core], rel=0.06)
        assert normal.get_label() == "normal, 2.99 DN from quartiles"


def test_values_beyond_the_end_of_the_curve_are_counted() -> None:
    """Shape 0.1 ends at 5.66 standard deviations, here of 3.2 DN; 20 values lie at 30 DN."""
    values = np.concatenate([np.random.default_rng(3).normal(0, 3, 100_000), np.full(20, 30.1)])
    (axes,) = noise_histogram_figure(noise(values, shape=Estimate(0.1, 0.002))).axes
    labels = [line.get_label() for line in axes.get_lines()]
    (label,) = [text for text in labels if text.startswith("Tukey")]
    assert label.startswith("Tukey lambda, shape 0.100: ends at ±")
    assert label.endswith("DN, 20 values beyond")
    assert axes.get_lines()[0].get_data()[0].max() > 30.0


def test_heavy_tail_lies_above_the_normal_curve() -> None:
    rng = np.random.default_rng(2)
    values = np.concatenate([rng.normal(0, 3, 1_000_000), rng.normal(0, 15, 5000)])
    (axes,) = noise_histogram_figure(noise(values)).axes
    points, normal, _ = axes.get_lines()
    x, density = points.get_data()
    far = np.abs(np.abs(x) - 15) < 2
    assert (density[far] > 10 * np.interp(x, *normal.get_data())[far]).all()


def defects(count=50):
    rng = np.random.default_rng(1)
    kind = rng.choice([DefectKind.HOT, DefectKind.DEAD, DefectKind.NOISY], count).astype(np.uint8)
    return Defects(rng.integers(0, 300, count), rng.integers(0, 400, count), kind, rng.random(count), rng.random(count))


def test_every_defect_is_drawn_at_its_position() -> None:
    given = defects()
    (axes,) = defect_map_figure(given, (300, 400)).axes
    drawn = {line.get_label(): np.column_stack(line.get_data()) for line in axes.get_lines()}
    for name, kind in (("hot", DefectKind.HOT), ("dead", DefectKind.DEAD), ("noisy", DefectKind.NOISY)):
        chosen = given.of(kind)
        points = drawn.pop(f"{name}: {len(chosen)}")
        assert sorted(map(tuple, points)) == sorted(zip(chosen.col, chosen.row, strict=True))
    assert not drawn
    assert axes.get_ylim() == (299.5, -0.5)
    assert axes.get_xlim() == (-0.5, 399.5)


def test_only_the_largest_deviations_of_many_defects_are_drawn(monkeypatch) -> None:
    monkeypatch.setattr(pixel_defects, "_MOST", 5)
    given = defects()
    (axes,) = defect_map_figure(given, (300, 400)).axes
    hot = given.of(DefectKind.HOT)
    line = next(line for line in axes.get_lines() if line.get_label() == f"hot: {len(hot)}, 5 drawn")
    farthest = np.argsort(-hot.deviation)[:5]
    assert sorted(line.get_xdata()) == sorted(hot.col[farthest])


def test_chip_without_defects_and_reproducible_drawing() -> None:
    (axes,) = defect_map_figure(no_defects(), (30, 40)).axes
    assert [text.get_text() for text in axes.texts] == ["no defective pixels"]
    assert svg_bytes(defect_map_figure(defects(), (30, 40))) == svg_bytes(defect_map_figure(defects(), (30, 40)))


def test_traces_have_values_and_levels() -> None:
    rng = np.random.default_rng(1)
    traces = [
        Trace(
            r, 2 * r, (60 + 20 * (rng.random(30) < 0.5) + rng.normal(0, 2, 30)).round().astype(np.float32), 60.0, 80.0
        )
        for r in (3, 7)
    ]
    axes = telegraph_figure(traces).axes
    assert len(axes) == 4
    for over_frames, histogram, trace in zip(axes[::2], axes[1::2], traces, strict=True):
        readings = [line for line in over_frames.get_lines() if len(line.get_xdata()) == 30]
        assert all((line.get_ydata() == trace.dn).all() for line in readings)
        assert sum(patch.get_width() for patch in histogram.patches) == 30
        levels = [line.get_ydata()[0] for line in over_frames.get_lines() if len(line.get_xdata()) == 2]
        assert levels == [60.0, 80.0]
        assert over_frames.get_title(loc="left") == f"row {trace.row}, column {trace.col}"
