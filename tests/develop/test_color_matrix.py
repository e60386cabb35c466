"""The fitted color matrix and its cross-validation."""

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import delta_e_76, delta_e_94, delta_e_2000
from photosite.develop.camera_color import fit_color_matrix
from photosite.errors import InputError

TRUTH = np.array([[0.41, 0.36, 0.18], [0.21, 0.72, 0.07], [0.02, 0.12, 0.95]])


@pytest.fixture
def patches():
    """Camera RGB and colors that no matrix maps onto each other exactly."""
    rng = np.random.default_rng(24)
    rgb = rng.uniform(0.05, 0.9, (24, 3))
    return rgb, rgb @ TRUTH.T + rng.normal(0, 0.01, (24, 3))


def test_an_exact_relation_is_found_whatever_the_cameras_scale():
    rgb = np.random.default_rng(2).uniform(0, 1, (24, 3))
    fit = fit_color_matrix(4095 * rgb, rgb @ TRUTH.T)
    np.testing.assert_allclose(4095 * fit.matrix, TRUTH, rtol=1e-10)
    assert fit.delta_e_76_left_out.max() < 1e-9


def test_four_channels_find_an_exact_relation():
    """A fourth channel that sees the others' infrared light: the matrix takes it away."""
    random = np.random.default_rng(3)
    rgb, infrared = random.uniform(0, 1, (24, 3)), random.uniform(0, 1, (24, 1))
    fit = fit_color_matrix(np.hstack([rgb + 0.3 * infrared, 0.8 * infrared]), rgb @ TRUTH.T)
    np.testing.assert_allclose(fit.matrix, np.hstack([TRUTH, -0.375 * TRUTH.sum(axis=1, keepdims=True)]), rtol=1e-9)


def test_residuals_are_orthogonal_to_the_camera(patches):
    rgb, xyz = patches
    fit = fit_color_matrix(rgb, xyz)
    # The normal equations: what makes it the least-squares matrix.
    np.testing.assert_allclose(rgb.T @ (fit.apply(rgb) - xyz), 0, atol=1e-12)


def test_left_out_is_what_refitting_without_the_patch_gives(patches):
    rgb, xyz = patches
    fit = fit_color_matrix(rgb, xyz)
    for i in range(24):
        kept = np.arange(24) != i
        refitted = np.linalg.solve(rgb[kept].T @ rgb[kept], rgb[kept].T @ xyz[kept])
        np.testing.assert_allclose(fit.delta_e_76_left_out[i], delta_e_76(rgb[i] @ refitted, xyz[i]), rtol=1e-9)
        np.testing.assert_allclose(fit.delta_e_94_left_out[i], delta_e_94(xyz[i], rgb[i] @ refitted), rtol=1e-9)
        np.testing.assert_allclose(fit.delta_e_2000_left_out[i], delta_e_2000(rgb[i] @ refitted, xyz[i]), rtol=1e-9)


def test_errors_of_fitted_patches_are_smaller(patches):
    fit = fit_color_matrix(*patches)
    assert np.mean(fit.delta_e_76) < np.mean(fit.delta_e_76_left_out)


def test_invalid_patches(patches):
    rgb, xyz = patches
    with raises(InputError, "rgb", value="3 patches"):
        fit_color_matrix(rgb[:3], xyz[:3])
    with raises(InputError, "rgb, xyz", value=((24, 2), (24, 3))):
        fit_color_matrix(rgb[:, :2], xyz)
    with raises(InputError, "the camera RGB of the patches lie in a plane"):
        fit_color_matrix(np.outer(rgb[:, 0], [1.0, 2.0, 3.0]), xyz)
    with raises(InputError, "rgb, xyz", value=((24, 3), (23, 3))):
        fit_color_matrix(rgb, xyz[:23])
    with raises(InputError, "rgb", value="4 patches"):
        fit_color_matrix(np.ones((4, 4)), xyz[:4])
    with raises(InputError, "rgb, xyz", expected="finite"):
        fit_color_matrix(rgb, np.where(np.arange(24)[:, None] == 3, np.inf, xyz))
    lonely = rgb.copy()
    lonely[:, 2] = 0
    lonely[7, 2] = 0.5
    with raises(InputError, "without patch 7"):
        fit_color_matrix(lonely, xyz)
