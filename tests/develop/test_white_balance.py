"""Gray world, with and without saturated pixels."""

import numpy as np
from raising import raises

from photosite.develop.camera_color import gray_world_gains, saturated_neighbourhood
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame


def test_gains_bring_the_means_to_green():
    rgb = np.random.default_rng(1).uniform(0, 1, (30, 40, 3)).astype(np.float32) * np.float32([0.3, 0.8, 0.5])
    gains = gray_world_gains(rgb)
    means = (rgb.astype(np.float64) * gains).mean(axis=(0, 1))
    assert gains[1] == 1.0
    np.testing.assert_allclose(means, means[1], rtol=1e-12)


def test_excluded_pixels_do_not_count():
    rgb = np.full((10, 10, 3), [0.2, 0.4, 0.1])
    clipped = np.zeros((10, 10), dtype=bool)
    clipped[:3] = True
    rgb[clipped] = [0.6, 1.0, 0.4]
    np.testing.assert_allclose(gray_world_gains(rgb, clipped), [2.0, 1.0, 4.0], rtol=1e-12)
    assert abs(gray_world_gains(rgb)[0] - 2.0) > 0.05


def test_saturation_reaches_its_eight_neighbours_and_no_further():
    dn = np.zeros((7, 9), np.uint16)
    dn[3, 4], dn[6, 0] = 1000, 1020
    found = saturated_neighbourhood(RawFrame(dn, bits=10, white_level_dn=1000))
    wanted = np.zeros((7, 9), dtype=bool)
    wanted[2:5, 3:6] = True
    wanted[5:7, 0:2] = True
    assert (found == wanted).all()


def test_invalid_input():
    with raises(InputError, "gray world finds no pixel"):
        gray_world_gains(np.ones((2, 2, 3)), np.ones((2, 2), dtype=bool))
    with raises(InputError, "mean above black"):
        gray_world_gains(np.full((2, 2, 3), [0.1, 0.2, -0.01]))
    with raises(InputError, "left_out"):
        gray_world_gains(np.ones((2, 2, 3)), np.zeros((3, 2), dtype=bool))
    with raises(InputError, "rgb"):
        gray_world_gains(np.ones((2, 2)))
