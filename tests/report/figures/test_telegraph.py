"""Traces of blinking pixels: the readings, the levels, a row for each pixel."""

from __future__ import annotations

import numpy as np

from photosite.calibration.chip_maps.temporal_noise import Trace
from photosite.report.figures.telegraph import telegraph_figure


def test_each_pixel_has_its_readings_and_levels() -> None:
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
