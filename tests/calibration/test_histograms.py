"""Histograms against the distributions that the deviations were drawn from, and against counting."""

import numpy as np
import pytest

from photosite.calibration.spatial.histograms import MOST_BINS, far_pixels, histogram, normal_threshold


def test_a_normal_sample_is_where_the_normal_distribution_is():
    """Chi square over the bins that expect ten pixels or more: its expectation is the number of bins, five of its
    standard deviations sqrt(2 n) are allowed. Accumulated: Kolmogorov's distance of 10^6 pixels is below 2.2 / 1000 but
    for one seed in 8000."""
    found = histogram([np.random.default_rng(1).normal(0.0, 2.5, (1000, 1000))], [0.0])
    expected = found.normal()
    enough = expected >= 10.0
    chi_square = np.sum((found.count - expected)[enough] ** 2 / expected[enough])
    assert abs(chi_square - enough.sum()) < 5.0 * np.sqrt(2.0 * enough.sum())
    assert found.count.sum() == 1_000_000
    assert found.sigma == pytest.approx(2.5, rel=0.004)
    assert np.abs(found.percent_beyond - found.normal_beyond()).max() < 0.22


def test_mean_frames_fall_into_bins_of_whole_grains():
    """The mean of 50 frames comes in steps of 1/50. Bins of other widths would hold one or two of them by turns."""
    rng = np.random.default_rng(2)
    mean = np.round(rng.normal(700.0, 25.0, (500, 800))) / 50.0
    found = histogram([mean], [mean.mean()], grain=1 / 50)
    assert found.width == pytest.approx(np.round(found.width * 50) / 50)
    assert len(found.count) <= MOST_BINS
    expected = found.normal()
    enough = expected > 1000.0
    np.testing.assert_allclose(found.count[enough], expected[enough], rtol=6.0 / np.sqrt(1000.0))


@pytest.mark.parametrize("grain", [0.25, None])
def test_counts_are_those_of_the_slow_way(grain):
    rng = np.random.default_rng(3)
    values = np.round(rng.normal(0.0, 40.0, (30, 100))) / 4.0
    found = histogram([values], [values.mean()], grain)
    values -= values.mean()
    assert found.count.sum() == 3000
    for k in range(0, len(found.count), 7):
        low = found.lower[k] - 1e-9
        assert found.count[k] == np.sum((values >= low) & (values < low + found.width)) or grain is None
    for at, percent in list(zip(found.deviation, found.percent_beyond, strict=True))[::5]:
        assert percent == pytest.approx(100.0 * np.mean(np.abs(values) >= at - 1e-9), abs=0.04)
    assert found.percent_beyond[0] == 100.0


def test_a_map_without_spread_is_one_bin():
    found = histogram([np.full((10, 10), 3.0)], [3.0], grain=0.5)
    assert found.count.tolist() == [100]
    assert found.percent_beyond.tolist() == [100.0]
    assert found.normal().tolist() == [100.0]


def test_far_pixels_are_found_and_ordinary_ones_are_not():
    """A million normal pixels list a tenth of a pixel on average: more than two would be one seed in 6000."""
    rng = np.random.default_rng(4)
    plane = rng.normal(0.0, 2.0, (1000, 1000))
    assert normal_threshold(plane, plane.size) == pytest.approx(2.0 * 5.33, rel=0.01)  # Phi(-5.33) 2e6 = 0.1
    hot = rng.choice(1_000_000, 40, replace=False)
    plane.ravel()[hot] += rng.choice([-30.0, 30.0], 40)
    places = np.arange(1000)
    found = far_pixels([plane], [0.0], [(places, places)])
    assert set(hot) <= set(found.row * 1000 + found.col)
    assert len(found.row) <= 42
    assert (np.diff(np.abs(found.deviation)) <= 0.0).all()
    given = far_pixels([plane], [0.0], [(places, places)], threshold=5.0)
    assert len(given.row) == np.sum(np.abs(plane) > 5.0)
    assert given.rule == "as given"
