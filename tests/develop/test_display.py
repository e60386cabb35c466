"""sRGB against colour-science."""

import numpy as np

from photosite.color.cie import colour_science
from photosite.develop.display import SRGB_FROM_XYZ, XYZ_FROM_SRGB, encode_srgb


def test_encoding_agrees_with_colour_science():
    linear = np.concatenate([np.linspace(0, 1, 4001), [0.0031308, 0.0031307, 0.0031309]])
    wanted = colour_science().cctf_encoding(linear, function="sRGB")
    np.testing.assert_allclose(encode_srgb(linear.astype(np.float32)), wanted, atol=3e-7)


def test_the_display_ends_at_black_and_white():
    shown = encode_srgb(np.array([-5.0, 0.0, 1.0, 7.0], np.float32))
    assert shown.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert shown.dtype == np.float32


def test_matrices_agree_with_the_standards_four_places():
    # The standard prints its matrices rounded, so this is as close as agreement with it can be.
    standard = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    np.testing.assert_allclose(XYZ_FROM_SRGB, standard, atol=5.1e-5)
    np.testing.assert_allclose(SRGB_FROM_XYZ @ XYZ_FROM_SRGB, np.eye(3), atol=1e-15)
