"""sRGB against colour-science."""

import numpy as np

from photosite.color.colour_science import colour_science
from photosite.color.srgb import SRGB_FROM_XYZ, XYZ_FROM_SRGB, encode_srgb


def test_encoding_agrees_with_colour_science():
    linear = np.concatenate([np.linspace(0, 1, 4001), [0.0031308, 0.0031307, 0.0031309]])
    expected = colour_science().cctf_encoding(linear, function="sRGB")
    np.testing.assert_allclose(encode_srgb(linear.astype(np.float32)), expected, atol=3e-7)


def test_encoding_clips_to_black_and_white():
    encoded = encode_srgb(np.array([-5.0, 0.0, 1.0, 7.0], np.float32))
    assert encoded.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert encoded.dtype == np.float32


def test_matrices_agree_with_the_four_decimals_of_the_standard():
    standard = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    np.testing.assert_allclose(XYZ_FROM_SRGB, standard, atol=5.1e-5)
    np.testing.assert_allclose(SRGB_FROM_XYZ @ XYZ_FROM_SRGB, np.eye(3), atol=1e-15)
