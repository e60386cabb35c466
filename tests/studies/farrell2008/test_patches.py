"""Figures 1 to 5: comparison of the virtual cameras with the fitted simulation, and as drawn."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.container import BarContainer

from photosite.color.colorimetry import delta_e_94
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.metrics.patches import patch_statistics
from photosite.scene.charts import MACBETH_NAMES, macbeth_regions
from photosite.studies.farrell2008.cameras import MeasuredCamera
from photosite.studies.farrell2008.drawing import Drawing
from photosite.studies.farrell2008.patches import (
    Patches,
    colors_figure,
    differences,
    patch_means_figure,
    patch_snr_figure,
    pictures_figure,
    sensitivity_figure,
)

SEED = 5


@pytest.fixture
def chapter(charts) -> Patches:
    return charts[1]


def test_measured_is_the_virtual_camera_and_simulated_has_the_fitted_fill_factor(chapter: Patches) -> None:
    for found in chapter.cameras.values():
        (raw,) = MeasuredCamera(found.case, SEED).shoot()
        np.testing.assert_array_equal(found.measured.dn, raw.dn)
        seen = patch_statistics(found.simulated, macbeth_regions(*raw.shape))
        brightest = found.comparisons[found.case.luminances_cd_m2[-1]]
        np.testing.assert_array_equal(brightest.simulated.mean_dn, seen.mean_dn)
        # With the fitted fill factor the ratio of means is 1.
        assert brightest.measured.mean_dn.sum() / seen.mean_dn.sum() == pytest.approx(1.0, abs=0.005)
        assert abs(found.fill_factor / found.case.paper_fill_factor - 1.0) > 0.005


def test_noise_agrees_and_means_show_the_lamp(chapter: Patches) -> None:
    # Four comparisons of noise: the smallest p is below 0.002 in less than 1 % of seeds.
    for found in chapter.cameras.values():
        for comparison in found.comparisons.values():
            assert comparison.noise.p_value > 0.002
        assert found.comparisons[40.0].means.p_value < 1e-6
        fraction = found.comparisons[40.0].relative_difference
        bright = found.comparisons[40.0].simulated.mean_dn > 100
        assert np.abs(fraction[bright]).max() < 0.025


def test_colours_against_a_direct_computation(chapter: Patches) -> None:
    truth = chart_xyz_d65("macbeth", MACBETH_NAMES)
    for found in chapter.cameras.values():
        statistics = found.comparisons[40.0].measured
        rgb = statistics.mean_dn[:, [statistics.channels.index(name) for name in "RGB"]]
        matrix = np.linalg.lstsq(rgb, truth, rcond=None)[0]
        np.testing.assert_allclose(found.colors.measured.matrix, matrix.T, rtol=1e-9)
        np.testing.assert_allclose(differences(found.colors.measured, "94"), delta_e_94(truth, rgb @ matrix), rtol=1e-9)
        one = np.delete(np.arange(24), 7)
        without = np.linalg.lstsq(rgb[one], truth[one], rcond=None)[0]
        left_out = delta_e_94(truth[7], rgb[7] @ without)
        assert differences(found.colors.measured, "94", left_out=True)[7] == pytest.approx(left_out, rel=1e-9)
        for formula in ("76", "94", "2000"):
            fitted, unseen = (differences(found.colors.simulated, formula, each) for each in (False, True))
            assert fitted.mean() < unseen.mean()


def test_measured_and_simulated_are_closer_to_each_other_than_to_the_chart(chapter: Patches) -> None:
    for found in chapter.cameras.values():
        assert found.colors.between.delta_e_2000.mean() < 0.4 * found.colors.measured.delta_e_2000.mean()


def test_to_dict(chapter: Patches) -> None:
    numbers = json.loads(json.dumps(chapter.to_dict(), allow_nan=False))
    assert list(numbers) == ["d200", "vendor"]
    assert list(numbers["vendor"]["by_luminance_cd_m2"]) == ["5", "15", "40"]
    assert len(numbers["d200"]["colors"]["measured"]["delta_e_94_left_out"]) == 24


def test_sensitivities(chapter: Patches) -> None:
    d200, vendor = sensitivity_figure(chapter).axes
    peaks = [max(line.get_ydata().max() for line in axes.lines) for axes in (d200, vendor)]
    assert peaks == pytest.approx([68.044, 38.6465])
    assert d200.get_ylabel() == "quantum efficiency (%)"


def test_pictures_have_the_same_brightness(chapter: Patches) -> None:
    axes = pictures_figure(chapter).axes
    measured, simulated, difference = (each.images[0].get_array().astype(float) for each in axes[:3])
    assert measured.shape == simulated.shape
    assert np.abs(measured - simulated).mean() < 3  # of 255
    assert abs(difference.mean() - 127.5) < 12  # gray: neither picture is brighter
    assert axes[0].get_title("left") == "measured (virtual camera)"


@pytest.mark.parametrize("kind", ["means", "snr"])
def test_every_patch_is_drawn_with_the_line_of_equality(chapter: Patches, kind: str) -> None:
    figure = {"means": patch_means_figure, "snr": patch_snr_figure}[kind](chapter)
    upper = figure.axes[0]
    comparison = chapter.cameras["d200"].comparisons[40.0]
    for k, channel in enumerate(comparison.measured.channels):
        line = next(line for line in upper.lines if line.get_label() == channel)
        sides = comparison.simulated, comparison.measured
        wanted = [side.mean_dn[:, k] if kind == "means" else side.spatial_snr_db[:, k] for side in sides]
        np.testing.assert_array_equal(line.get_xydata().T, wanted)
    identity = [line for line in upper.lines if np.array_equal(*line.get_xydata().T) and len(line.get_xdata()) == 2]
    assert len(identity) == 1
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["R", "G", "B", "40 cd/m²", "15 cd/m²", "5 cd/m²"]


def test_histograms_count_every_patch(chapter: Patches) -> None:
    figure = colors_figure(chapter)
    for axes in figure.axes:
        for bars in axes.containers:
            assert isinstance(bars, BarContainer)
            assert sum(bar.get_height() for bar in bars) == 24
    mean = differences(chapter.cameras["vendor"].colors.measured, "2000", left_out=True).mean()
    assert f"means {mean:.2f} and" in figure.axes[-1].get_xlabel()


def test_captions_state_what_measured_means(chapter: Patches, unrendered: None) -> None:
    drawn = [entry for entry in chapter.part() if isinstance(entry, Drawing)]
    assert [entry.name.split("-")[0] for entry in drawn] == ["figure1", "figure2", "figure3", "figure4", "figure5"]
    assert all("virtual camera" in entry.caption for entry in drawn[1:])
