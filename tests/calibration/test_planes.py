"""Operations on strips give the same result as on the whole map."""

import numpy as np
import pytest

from photosite.calibration.spatial import nonuniformity as module
from photosite.calibration.spatial.nonuniformity import (
    Difference,
    high_pass,
    high_passed,
    plane_mean,
    spread_sample,
    strips,
)


@pytest.fixture(autouse=True)
def small_strips(monkeypatch):
    monkeypatch.setattr(module, "STRIP_VALUES", 333)


@pytest.mark.parametrize("axis", [0, 1])
def test_strips_add_up_to_the_map(axis):
    plane = np.random.default_rng(1).normal(size=(41, 53))
    together = np.concatenate([lines for _, lines in strips(plane, axis)])
    np.testing.assert_array_equal(together, plane if axis == 1 else plane.T)
    assert len(list(strips(plane, axis))) > 4


def test_difference_equals_that_of_the_arrays():
    rng = np.random.default_rng(2)
    bright, dark = rng.normal(100.0, 5.0, (40, 60)), rng.normal(10.0, 1.0, (40, 60))
    difference = Difference(bright[::2, 1::2], dark[::2, 1::2])
    assert difference.shape == (20, 30)
    together = np.concatenate([lines for _, lines in strips(difference)])
    np.testing.assert_array_equal(together, (bright - dark)[::2, 1::2])
    assert plane_mean(difference) == pytest.approx((bright - dark)[::2, 1::2].mean(), rel=1e-13)


def test_the_high_pass_has_no_seams():
    plane = np.random.default_rng(3).normal(1000.0, 3.0, (60, 45))
    np.testing.assert_allclose(high_passed(plane, 0.1), 0.1 * high_pass(plane), atol=1e-6)


def test_samples_are_evenly_spaced_rows():
    plane = np.add.outer(np.arange(100.0), np.zeros(7))
    assert len(spread_sample(plane, most=700)) == 700
    assert np.unique(spread_sample(plane, most=100)).tolist() == list(range(0, 100, 7))
