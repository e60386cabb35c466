"""Profiles against NumPy's reductions."""

import numpy as np

from photosite.calibration.spatial.profiles import profiles


def test_profiles_of_one_plane():
    plane = np.random.default_rng(1).normal(100.0, 5.0, (31, 44))
    across, down = profiles([plane])
    np.testing.assert_allclose(across.mean, plane.mean(0), rtol=1e-14)
    np.testing.assert_array_equal(across.lowest, plane.min(0))
    np.testing.assert_array_equal(across.middle, plane[15])
    np.testing.assert_array_equal(down.highest, plane.max(1))
    np.testing.assert_array_equal(down.middle, plane[:, 22])


def test_two_planes_have_one_profile():
    planes = [np.full((4, 5), 2.0), np.full((4, 5), 6.0)]
    found, _ = profiles(planes)
    assert found.mean.tolist() == [4.0] * 5
    assert (found.lowest.max(), found.highest.min(), found.middle[0]) == (2.0, 6.0, 2.0)
