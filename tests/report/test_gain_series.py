"""The report of a gain series: settings, the two parts of read noise, the switch, and the figure."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.calibration.gain_series.result import ConversionGainSwitch, GainMode, GainSeries, GainStep
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet
from photosite.frames.frame_settings import Kind
from photosite.report.figures.gain_series import gain_series_figure
from photosite.report.gain_series import gain_series_page, modes_table, settings_table
from photosite.report.write import render_page
from photosite.values.diagnostic import Diagnostic
from photosite.values.estimate import Estimate

SETTINGS = (100.0, 200.0, 400.0, 800.0)
GAIN = (0.1, 0.2, 1.2, 2.4)
PRE_E, POST_DN = (6.0, 6.0, 2.0, 2.0), 1.5


@functools.cache
def measured() -> Calibration:
    """A calibration of 12 small frames; the series below replaces its values."""
    rng = np.random.default_rng(1)

    def frame(kind: Kind, exposure_s: float) -> tuple[Kind, float, NDArray[np.uint16]]:
        electrons = rng.poisson(1e5 * exposure_s * (kind == "light"), (16, 16))
        return kind, exposure_s, np.uint16(64.5 + 0.5 * electrons + rng.normal(0, 2, (16, 16)))

    settings: list[tuple[Kind, float]] = [("dark", 0.01), ("light", 0.01), ("light", 0.02)]
    return ps.calibrate(FrameSet.from_arrays([frame(*entry) for entry in settings for _ in range(4)], bits=12))


def calibration(gain: float, pre_e: float) -> Calibration:
    read_dn = float(np.hypot(pre_e * gain, POST_DN))
    values = {"system_gain_dn_per_e": gain, "read_noise_dn": read_dn, "read_noise_e": read_dn / gain}
    values |= {"black_level_dn": 64.0, "saturation_capacity_e": 4000 / gain, "dynamic_range_db": 60.0}
    known: dict[str, Any] = {name: Estimate(value, 0.01 * value) for name, value in values.items()}
    return replace(measured(), **known)


@pytest.fixture(scope="module")
def series() -> GainSeries:
    steps = tuple(GainStep(s, calibration(k, pre)) for s, k, pre in zip(SETTINGS, GAIN, PRE_E, strict=True))
    modes = (
        GainMode(SETTINGS[:2], Estimate(6.0, 0.1), Estimate(POST_DN, 0.02), 1.3, 1, 0.4),
        GainMode(SETTINGS[2:], Estimate(2.0, 0.05), Estimate(-0.3, 0.6, upper_limit_95=1.0), 0.2, 0, 0.0),
    )
    switch = ConversionGainSwitch(
        (200, 400), (200, 400), Estimate(3.0, 0.1), Estimate(1 / 3, 0.01), 1e-4, ("read noise",)
    )
    return GainSeries(
        steps,
        "proportional",
        switch,
        modes,
        Estimate(reason="it jumps"),
        (Diagnostic("irregular-gain", "warning", "odd things happened"),),
        "made up",
    )


def test_page(series: GainSeries, tmp_path: Path) -> None:
    series.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in (
        "48 dark frames and flat fields at 4 gain settings, 100 to 800",
        "The conversion gain switches between the settings 200 and 400 (95 %: between 200 and 400)",
        "as read noise shows (p = 0.0001)",
        "3.00 ± 0.10",
        "The gain setting of 1 DN per electron is unknown: it jumps.",
        "Odd things happened",
    ):
        assert text in page
    quiet = replace(series, switch=None, modes=series.modes[:1], diagnostics=(), unity_gain=Estimate(870.0, 3.0))
    page = render_page(gain_series_page(quiet))
    assert "No conversion-gain switch was found" in page
    assert "blue band" not in page
    assert "at gain setting 870.0 ± 3.0" in page


def test_tables(series: GainSeries) -> None:
    rows = settings_table(series).rows
    assert [row[0] for row in rows if isinstance(row, tuple)] == ["100", "200", "400", "800"]
    assert rows[0][1] == "0.1000 ± 0.0010"  # type: ignore[index]
    low, high = modes_table(series).rows
    assert low == ("100 to 200", "6.00 ± 0.10", "1.500 ± 0.020", "1.30 / 1", "0.4")
    assert high[2] == "< 1.0"  # type: ignore[index]


def test_warnings_rejected_frames_and_digests_of_each_setting(series: GainSeries) -> None:
    """A setting's warning appears once, under its setting, and not among those of the series."""
    lamp = Diagnostic("unsteady-light", "warning", "the lamp wanders")
    found = lamp, Diagnostic("repeated-frame", "left out", "a.tif: is a copy of b.tif")
    first = replace(series.steps[0].calibration, raised=found)
    steps = (replace(series.steps[0], calibration=first), *series.steps[1:])
    own = Diagnostic("irregular-gain", "warning", "odd things happened")
    changed = replace(series, steps=steps, diagnostics=(lamp.within("gain setting 100"), own))
    html = render_page(gain_series_page(changed))
    assert html.count("lamp wanders") == 1
    assert html.count("Odd things happened.") == 1
    assert "a.tif: is a copy of b.tif" in html
    assert html.count("All 12 frames were used.") == 3
    digests = first.frame_digests
    assert len(digests) == 12
    assert all(html.count(digest) >= 4 for digest in digests)
    assert "SHA-256" in html


def test_digests_of_each_setting_are_beside_the_pdf(series: GainSeries, tmp_path: Path) -> None:
    series.report(tmp_path / "iso.pdf")
    tables = [f"iso.gain{setting:g}.frames.csv" for setting in SETTINGS]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["iso.pdf", *tables])


def test_figure_draws_the_model(series: GainSeries) -> None:
    """The line of the low conversion gain is sqrt(pre^2 + (post / K)^2) in electrons, at both ends."""
    noise, gain = gain_series_figure(series).axes
    lines = [line for line in noise.get_lines() if line.get_label() == "sum of both parts"]
    for line, part in zip(lines, (slice(0, 2), slice(2, 4)), strict=True):
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert (x[0], x[-1]) == pytest.approx(SETTINGS[part])
        mode = series.modes[part.start // 2]
        pre, post = mode.pre_amplifier_noise_e.value or 0.0, mode.post_amplifier_noise_dn.value or 0.0
        k = np.array(GAIN[part])
        np.testing.assert_allclose(y[[0, -1]], np.sqrt(pre**2 + np.sign(post) * (post / k) ** 2), rtol=1e-9)
    assert noise.get_xscale() == gain.get_yscale() == "log"
    for axes in (noise, gain):
        labels = [label.get_text() for label in axes.get_yticklabels(which="both")]
        assert {"0.2", "2"} & set(labels)
        assert not any("10^" in label or "×" in label for label in labels), "one notation"
    texts = [text.get_text() for text in gain.figure.legends[0].get_texts()]
    assert texts[:2] == ["low conversion gain", "high conversion gain"]


def test_figure_of_decibels_is_linear(series: GainSeries) -> None:
    decibels = replace(series, scale="tenths of a decibel", switch=None)
    noise, gain = gain_series_figure(decibels).axes
    assert noise.get_xscale() == "linear"
    assert gain.get_xlabel() == "gain setting (tenths of a decibel)"
