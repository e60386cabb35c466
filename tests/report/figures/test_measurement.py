"""Figures of measurements, and the rows of their tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photosite.metrics.measurement import Curve, Result
from photosite.metrics.registry import measurement
from photosite.report.figures.measurement import small_figure
from photosite.values.estimate import Estimate


def test_bands_and_lines_of_small_figures_end_at_the_axes() -> None:
    """Writers of PDF do not clip: a band of a noisy curve was drawn over the page."""
    x = np.linspace(0.0, 1.0, 9)
    sure = Curve("G", "frequency", "power", x, 1.0 + x, np.full(9, 0.01))
    noisy = Curve("B", "frequency", "power", x[:4], np.full(4, 5.0), np.full(4, 4.0))
    result = replace(Result({}, curves=(sure, noisy)), measurement=measurement("noise-spectrum"))
    figure = small_figure(result, "G")
    assert figure is not None
    (axes,) = figure.axes
    low, high = axes.get_ylim()
    assert high < 5.0
    bands = np.concatenate([path.vertices[:, 1] for band in axes.collections for path in band.get_paths()])
    lines = np.concatenate([np.asarray(line.get_ydata()) for line in axes.get_lines()])
    assert low <= bands.min() < bands.max() <= high
    assert low <= np.nanmin(lines) < np.nanmax(lines) <= high
    assert np.isfinite(lines[:9]).all()


def test_missing_values_leave_the_columns_of_numbers_numeric() -> None:
    result = Result({("mtf50", "G"): Estimate(0.25, 0.01), ("mtf10", "G"): Estimate(reason="noise hides it")})
    value, missing = result.rows()
    assert value[2:] == (0.25, *Estimate(0.25, 0.01).interval_95, "", None)
    assert missing[2:] == (None, None, None, "", "noise hides it")
