"""Figures 2 to 5: comparison of the virtual cameras with the fitted simulation."""

from __future__ import annotations

import json

import numpy as np
import pytest

from photosite.color.difference import delta_e_94
from photosite.metrics.patches import patch_statistics
from photosite.scene.charts import MACBETH_NAMES, macbeth_regions
from photosite.studies.farrell2008.cameras import MeasuredCamera
from photosite.studies.farrell2008.patches import Patches, differences
from photosite.validation.charts import chart_xyz_d65

SEED = 5


@pytest.fixture
def chapter(charts) -> Patches:
    return charts[1]


def test_measured_is_the_virtual_camera_and_simulated_has_the_fitted_fill_factor(chapter: Patches) -> None:
    for found in chapter.cameras.values():
        (raw,) = MeasuredCamera.drawn(found.case, SEED).shoot()
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
        share = found.comparisons[40.0].relative_difference
        bright = found.comparisons[40.0].simulated.mean_dn > 100
        assert np.abs(share[bright]).max() < 0.025


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
