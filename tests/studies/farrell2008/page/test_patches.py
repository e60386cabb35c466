"""Section 3 and figures 1 to 5 as drawn."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.container import BarContainer

from photosite.report.page import Listing, Table
from photosite.studies.farrell2008.fill_factor import FillFactors
from photosite.studies.farrell2008.page.drawing import Drawing
from photosite.studies.farrell2008.page.fill_factor import fill_factor_part, residuals_figure
from photosite.studies.farrell2008.page.patches import (
    colors_figure,
    patch_means_figure,
    patch_snr_figure,
    patches_part,
    pictures_figure,
    sensitivity_figure,
)
from photosite.studies.farrell2008.patches import Patches, differences


@pytest.fixture
def chapters(charts) -> tuple[FillFactors, Patches]:
    return charts


def test_sensitivities(chapters: tuple[FillFactors, Patches]) -> None:
    d200, vendor = sensitivity_figure(chapters[1]).axes
    peaks = [max(line.get_ydata().max() for line in axes.lines) for axes in (d200, vendor)]
    assert peaks == pytest.approx([68.044, 38.6465])
    assert d200.get_ylabel() == "quantum efficiency (%)"


def test_pictures_have_the_same_brightness(chapters: tuple[FillFactors, Patches]) -> None:
    axes = pictures_figure(chapters[1]).axes
    measured, simulated, difference = (each.images[0].get_array().astype(float) for each in axes[:3])
    assert measured.shape == simulated.shape
    assert np.abs(measured - simulated).mean() < 3  # of 255
    assert abs(difference.mean() - 127.5) < 12  # gray: neither picture is brighter
    assert axes[0].get_title("left") == "measured (virtual camera)"


@pytest.mark.parametrize("kind", ["means", "snr"])
def test_every_patch_is_drawn_with_the_line_of_equality(chapters: tuple[FillFactors, Patches], kind: str) -> None:
    figure = {"means": patch_means_figure, "snr": patch_snr_figure}[kind](chapters[1])
    upper = figure.axes[0]
    comparison = chapters[1].cameras["d200"].comparisons[40.0]
    for k, channel in enumerate(comparison.measured.channels):
        line = next(line for line in upper.lines if line.get_label() == channel)
        sides = comparison.simulated, comparison.measured
        wanted = [side.mean_dn[:, k] if kind == "means" else side.spatial_snr_db[:, k] for side in sides]
        np.testing.assert_array_equal(line.get_xydata().T, wanted)
    identity = [line for line in upper.lines if np.array_equal(*line.get_xydata().T) and len(line.get_xdata()) == 2]
    assert len(identity) == 1
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["R", "G", "B", "40 cd/m²", "15 cd/m²", "5 cd/m²"]


def test_histograms_count_every_patch(chapters: tuple[FillFactors, Patches]) -> None:
    figure = colors_figure(chapters[1])
    for axes in figure.axes:
        for bars in axes.containers:
            assert isinstance(bars, BarContainer)
            assert sum(bar.get_height() for bar in bars) == 24
    mean = differences(chapters[1].cameras["vendor"].colors.measured, "2000", left_out=True).mean()
    assert f"means {mean:.2f} and" in figure.axes[-1].get_xlabel()


def test_residuals_are_at_the_position_of_the_patch(chapters: tuple[FillFactors, Patches]) -> None:
    figure = residuals_figure(chapters[0])
    shown = figure.axes[0].images[0].get_array()
    assert shown.shape == (4, 6)
    residual = 100 * chapters[0].cameras["d200"].fit.residuals
    # The channels of the D200 agree to about a tenth of a percent.
    np.testing.assert_allclose(shown.ravel(), residual.mean(axis=1), atol=0.35)
    assert figure.axes[0].texts[0].get_text().replace("−", "-") == f"{shown[0, 0]:+.2f}"


def test_the_part_lists_paper_hidden_and_fitted_values(chapters: tuple[FillFactors, Patches]) -> None:
    part = fill_factor_part(chapters[0])
    (table,) = (entry for entry in part if isinstance(entry, Table))
    assert [row[0] for row in table.rows] == ["Nikon D200", "Vendor 2.2 µm", "Vendor 2.2 µm", "Vendor 2.2 µm"]
    assert [row[2] for row in table.rows] == ["0.9", "0.5", "0.5", "0.5"]
    (words,) = (entry for entry in part if isinstance(entry, Listing))
    assert "standard errors from the hidden" in words.lines[0]
    figures = patches_part(chapters[1])
    names = [entry.name.split("-")[0] for entry in figures if isinstance(entry, Drawing)]
    assert names == ["figure1", "figure2", "figure3", "figure4", "figure5"]
    for entry in (*part, *figures):
        if isinstance(entry, Drawing) and "measured" in entry.caption.lower() and "figure1" not in entry.name:
            assert "virtual camera" in entry.caption
