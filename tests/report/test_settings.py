"""The report of several settings: the comparison, the report of each, and the files beside a PDF."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.settings_result import SettingsCalibration
from photosite.frames.frame_set import FrameSet
from photosite.report.pages import page
from photosite.report.tables import format_estimate, interval_text


@pytest.fixture(scope="module")
def result() -> SettingsCalibration:
    """Two filters, of which one has a series of two gain settings, and one that was refused."""
    rng = np.random.default_rng(1)

    def frames(gain: float, gain_settings: tuple[float | None, ...] = (None,)) -> FrameSet:
        shots = []
        for setting in gain_settings:
            own = gain * (setting or 1)
            for kind, electrons in (("dark", 0), *(("light", n) for n in (500, 1000, 2000, 3000))):
                for _ in range(3):
                    dn = 64.5 + own * (rng.poisson(electrons, (32, 32)) + 3 * rng.standard_normal((32, 32)))
                    shots.append((kind, (electrons or 500) / 1e4, dn.astype(np.uint16), None, setting))
        return FrameSet.from_arrays(shots, bits=12)

    one, series = ps.calibrate(frames(0.5)), ps.calibrate(frames(0.25, (1, 2)))
    return SettingsCalibration({"filter=R": one, "filter=G": series}, {"filter=B": "there are no flat fields"})


def test_the_comparison_has_a_row_per_setting_with_intervals(result: SettingsCalibration) -> None:
    settings, *rest = page(result).sections
    table = settings.blocks[0]
    assert [row[0] for row in table.rows] == ["filter=R", "filter=G,gain_setting=1", "filter=G,gain_setting=2"]
    gain = result.calibrations["filter=G,gain_setting=2"].system_gain_dn_per_e
    assert table.rows[2][1].replace("\u00a0", " ") == (
        f"{format_estimate(gain)} ({interval_text(gain)})".replace("\u00a0", " ")
    )
    assert [block.id for block in settings.blocks if block.kind == "notice"] == ["setting-not-calibrated"]
    assert [part.title for part in rest][:2] == ["Setting 1: filter=R", "Setting 2: filter=G"]


def test_the_page_has_each_explanation_once(result: SettingsCalibration, tmp_path: Path) -> None:
    result.report(tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    ids = re.findall(r'id="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"', html)) <= set(ids)
    assert html.count("<h2>How to read this report</h2>") == 1
    assert html.count("SHA-256 of a frame") == 2 * 3  # an accessible name and a caption each


def test_digests_of_each_setting_are_beside_the_pdf(result: SettingsCalibration, tmp_path: Path) -> None:
    result.report(tmp_path / "all.pdf")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "all.pdf",
        "all.setting1.frames.csv",
        "all.setting2.gain1.frames.csv",
        "all.setting2.gain2.frames.csv",
    ]
