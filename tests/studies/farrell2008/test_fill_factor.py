"""Fitted fill factors against the hidden ones."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.metrics.patches import patch_statistics
from photosite.report.page import Listing, Table
from photosite.scene.charts import macbeth_regions
from photosite.studies.farrell2008.cameras import CASES, D200, VENDOR, Case, HiddenTruth, MeasuredCamera
from photosite.studies.farrell2008.drawing import Drawing
from photosite.studies.farrell2008.fill_factor import (
    CaseFit,
    FillFactors,
    fit_case,
    recovery_study,
    residuals_figure,
    simulate_chart,
)
from photosite.validation.fill_factor import fit_fill_factor


def small(case: Case, **changes: object) -> Case:
    return replace(case, chart_rows=264, chart_cols=392, **changes)


@pytest.fixture(scope="module")
def vendor() -> CaseFit:
    return fit_case(small(VENDOR), 2008)


@pytest.fixture(scope="module")
def chapter(vendor: CaseFit) -> FillFactors:
    return FillFactors({"d200": fit_case(small(D200), 2008), "vendor": vendor})


def test_hidden_fill_factors_are_recovered() -> None:
    # The RMS pull on frames of this size is 0.13 (D200) and 0.5 (vendor) over 20 seeds: a pull of 2 is four times
    # that, 1 false alarm in 4000 runs. The next test shows the power.
    for recovery in recovery_study(range(4), rows=264, cols=392):
        assert recovery.found == 1.0, recovery.pulls
        assert recovery.passes
        assert recovery.in_interval.all()
        assert np.ptp(recovery.true) > 0.01  # another camera for each seed
        assert json.loads(json.dumps(recovery.to_dict(), allow_nan=False))["seeds"] == 4
    with pytest.raises(InputError) as caught:
        recovery_study([])
    assert caught.value.what == "seeds"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.key)
def test_an_error_of_one_percent_in_the_light_is_detected(case: Case) -> None:
    """The fit has power: 1 % less light in the simulation gives a 1 % larger fill factor, over 5 standard errors."""
    level = case.luminances_cd_m2[-1]
    right = fit_case(small(case, luminances_cd_m2=(level,)), 3)
    (seen,) = MeasuredCamera(small(case), 3).shoot()
    made = simulate_chart(small(case, exposure_s=case.exposure_s / 1.01), case.paper_fill_factor, 3, level)
    regions = macbeth_regions(*seen.shape)
    fit = fit_fill_factor(patch_statistics(seen, regions), patch_statistics(made, regions), case.paper_fill_factor)
    assert fit.value / right.fit.value == pytest.approx(1.01, abs=0.0005)
    assert abs(fit.value - right.true) > 5 * fit.standard_error


def test_the_fill_factor_does_not_depend_on_the_light(vendor: CaseFit) -> None:
    # Lamp and chip are the same: noise remains, below a standard error of the dimmest fit in 19 of 20 seeds.
    values = [fit.value for fit in vendor.fits.values()]
    assert list(vendor.fits) == [5.0, 15.0, 40.0]
    assert np.ptp(values) < 2 * vendor.fits[5.0].standard_error
    assert vendor.fit is vendor.fits[40.0]


def test_residuals_show_the_lamp() -> None:
    """Residuals increase towards the lamp, whose direction the simulation does not know.

    The standard deviation of the angle is 1.7 degrees over 12 seeds; the bound is four times that.
    """
    fit = fit_case(small(D200), 2008).fit
    weight = 1 / fit.residual_noise**2
    patch = (weight * fit.residuals).sum(axis=1) / weight.sum(axis=1)
    row, col = np.divmod(np.arange(24), 6)
    design = np.column_stack([np.ones(24), col - 2.5, row - 1.5])
    _, right, down = np.linalg.lstsq(design, np.asarray(patch), rcond=None)[0]
    truth = HiddenTruth.drawn(D200, 2008)
    away = (np.rad2deg(np.arctan2(down, right)) - truth.lamp_angle_deg + 180) % 360 - 180
    assert abs(away) < 7
    assert fit.chi_square.p_value < 1e-9
    assert 0.004 < fit.patch_scatter < 0.012


def test_the_simulation_does_not_know_the_hidden_value(vendor: CaseFit) -> None:
    assert vendor.fit.simulated_with == VENDOR.paper_fill_factor
    assert vendor.true != VENDOR.paper_fill_factor
    # Simulations of two seeds differ in noise only.
    one, other = (simulate_chart(small(D200), 0.9, seed, 40.0).dn.astype(float) for seed in (1, 2))
    assert one.mean() == pytest.approx(other.mean(), rel=1e-4)
    assert not np.array_equal(one, other)


def test_to_dict(vendor: CaseFit) -> None:
    numbers = json.loads(json.dumps(vendor.to_dict(), allow_nan=False))
    assert numbers["paper"] == 0.5
    assert numbers["hidden"] == vendor.true
    assert set(numbers["by_luminance_cd_m2"]) == {"5", "15", "40"}
    assert len(numbers["by_luminance_cd_m2"]["40"]["residuals"]) == 24


def test_residuals_are_at_the_position_of_the_patch(chapter: FillFactors) -> None:
    figure = residuals_figure(chapter)
    shown = figure.axes[0].images[0].get_array()
    assert shown.shape == (4, 6)
    residual = 100 * chapter.cameras["d200"].fit.residuals
    # The channels of the D200 agree to about a tenth of a percent.
    np.testing.assert_allclose(shown.ravel(), residual.mean(axis=1), atol=0.35)
    assert figure.axes[0].texts[0].get_text().replace("−", "-") == f"{shown[0, 0]:+.2f}"


def test_the_part_lists_paper_hidden_and_fitted_values(chapter: FillFactors, unrendered: None) -> None:
    part = chapter.part()
    (table,) = (entry for entry in part if isinstance(entry, Table))
    assert [row[0] for row in table.rows] == ["Nikon D200", "Vendor 2.2 µm", "Vendor 2.2 µm", "Vendor 2.2 µm"]
    assert [row[2] for row in table.rows] == ["0.9", "0.5", "0.5", "0.5"]
    (words,) = (entry for entry in part if isinstance(entry, Listing))
    assert "standard errors from the hidden" in words.lines[0]
    (drawn,) = (entry for entry in part if isinstance(entry, Drawing))
    assert "virtual camera" in drawn.caption
