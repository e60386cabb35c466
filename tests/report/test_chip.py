"""Defects and temporal noise of a mapped chip in the report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet
from photosite.report.chip import defect_lists, outlier_pixel_blocks, temporal_blocks
from photosite.report.effect import effect_figures
from photosite.report.page import Details, Images, Page, Paragraph, Section, Table
from photosite.report.write import render_page
from photosite.sensor.chip import no_defects

HOT, DEAD = (7, 11), (20, 3)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    """Dark frames at two and flat fields at four exposure times, with one hot and one dead pixel."""
    rng = np.random.default_rng(8)
    shape = (40, 48)
    rate, response = np.zeros(shape), np.ones(shape)
    rate[HOT], response[DEAD] = 4000.0, 0.1
    offset = 64.0 + rng.normal(0.0, 0.5, shape)

    def frame(exposure_s: float, electrons: float) -> np.ndarray:
        signal = rng.poisson(electrons * response + rate * exposure_s)
        return np.rint(offset + 0.5 * signal + rng.normal(0.0, 2.0, shape)).astype(np.uint16)

    frames = [("dark", t, frame(t, 0.0)) for t in (0.01, 0.5) for _ in range(16)]
    frames += [("light", t, frame(t, 1e5 * t)) for t in (0.01, 0.02, 0.03, 0.04) for _ in range(4)]
    return calibrate(FrameSet.from_arrays(frames, bits=12), maps=True)


def test_planted_defects_are_counted_and_listed_where_they_are(calibration: Calibration, read_page) -> None:
    blocks = (*effect_figures()["pixel_defects"].blocks(calibration), *defect_lists(calibration))
    left_out, by_kind, *_ = blocks
    assert left_out.caption == "Figures without and with 2 defective pixels: 1 hot, 1 dead"
    counts = {row[0].split(":")[0]: int(row[1]) for row in by_kind.rows}
    assert counts["Hot"] == 1
    assert counts["Dead"] == 1
    lists = {block.summary.split(":")[0]: block.blocks[0] for block in blocks if isinstance(block, Details)}
    assert lists["Hot"].rows[0][:3] == ("pixel", f"row {HOT[0]}, column {HOT[1]}", "1")
    assert lists["Dead"].rows[0][:3] == ("pixel", f"row {DEAD[0]}, column {DEAD[1]}", "1")
    assert sum(isinstance(block, Images) for block in blocks) == 1
    page = read_page(render_page(Page("Chip", "", (Section("Defects", blocks),))))
    assert "Dead: response below half of the channel's" in page.text


def test_outlier_pixels_of_the_mean_frames_are_listed_with_their_rule(calibration: Calibration) -> None:
    blocks = outlier_pixel_blocks(calibration)
    table = next(block for block in blocks if isinstance(block, Table))
    assert next(row[0] for row in table.rows) == "dark"
    assert all("0.1 pixels" in row[5] for row in table.rows)


def test_parts_of_the_noise_have_intervals(calibration: Calibration) -> None:
    table, picture, *_ = temporal_blocks(calibration)
    assert isinstance(table, Table)
    assert isinstance(picture, Images)
    by_name = {row[0]: row for row in table.rows}
    value = float(by_name["Pixel noise"][1].split(" ")[0])
    assert 1.9 < value < 2.1, "planted: 2 DN; with 40 x 48 pixels of 16 frames known to 0.4 %"
    assert all(row[1] == "not estimated" or row[3] for row in table.rows)


def test_chip_without_defects_or_maps(calibration: Calibration) -> None:
    perfect = replace(calibration, chip=replace(calibration.chip, defects=no_defects()))
    blocks = effect_figures()["pixel_defects"].blocks
    assert blocks(perfect)[-1] == Paragraph("No pixel is defective.")
    assert defect_lists(perfect) == ()
    unmeasured = replace(calibration, chip=None, temporal=None)
    assert [block.caption for block in blocks(unmeasured)] == [blocks(calibration)[0].caption]  # found without maps
    assert defect_lists(unmeasured) == ()
    (reason,) = temporal_blocks(unmeasured)
    assert "calibrate with maps" in reason.text
