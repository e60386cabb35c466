"""Color differences against published values."""

import numpy as np
import pytest

from photosite.color.colorimetry import (
    D65_WHITE_XYZ,
    SRGB_FROM_XYZ,
    XYZ_FROM_SRGB,
    colour_science,
    delta_e_76,
    delta_e_94,
    delta_e_2000,
    encode_srgb,
)

# G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 color-difference formula", Color Res. Appl. 30, 2005, Table 1:
# pairs 1, 4, 7, 8, 10, 14, 15, 16, 20, 25, 29, 33, 34: L*, a*, b* twice, and delta E.
SHARMA = [
    (50.0000, 2.6772, -79.7751, 50.0000, 0.0000, -82.7485, 2.0425),
    (50.0000, -1.3802, -84.2814, 50.0000, 0.0000, -82.7485, 1.0000),
    (50.0000, 0.0000, 0.0000, 50.0000, -1.0000, 2.0000, 2.3669),
    (50.0000, -1.0000, 2.0000, 50.0000, 0.0000, 0.0000, 2.3669),
    (50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0010, 7.1792),
    (50.0000, -0.0010, 2.4900, 50.0000, 0.0010, -2.4900, 4.8045),
    (50.0000, -0.0010, 2.4900, 50.0000, 0.0011, -2.4900, 4.7461),
    (50.0000, 2.5000, 0.0000, 50.0000, 0.0000, -2.5000, 4.3065),
    (50.0000, 2.5000, 0.0000, 58.0000, 24.0000, 15.0000, 19.4535),
    (60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644),
    (22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373),
    (6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377),
    (2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082),
]


def xyz_of(values):
    """Inverse of CIE L*a*b* (CIE 015:2018, 8.2.1), independent of the package."""
    lightness, a, b = np.moveaxis(np.asarray(values), -1, 0)
    fy = (lightness + 16) / 116
    f = np.stack([fy + a / 500, fy, fy - b / 200], axis=-1)
    ratio = np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29))
    return ratio * D65_WHITE_XYZ


@pytest.mark.parametrize("row", SHARMA)
def test_ciede2000_of_the_published_pairs(row):
    one, other, expected = np.array(row[0:3]), np.array(row[3:6]), row[6]
    # The table has four decimals. The round trip through XYZ costs about 1e-13, also near the hue discontinuity.
    assert delta_e_2000(xyz_of(one), xyz_of(other)) == pytest.approx(expected, abs=5.1e-5)
    assert delta_e_76(xyz_of(one), xyz_of(other)) == pytest.approx(np.linalg.norm(one - other), abs=1e-9)


def from_chroma_and_hue(lightness, chroma, hue_deg):
    hue = np.deg2rad(hue_deg)
    return np.array([lightness, chroma * np.cos(hue), chroma * np.sin(hue)])


@pytest.mark.parametrize("chroma", [0.0, 20.0, 60.0])
def test_cie_1994_by_its_definition(chroma):
    """One difference at a time; chroma and hue are weighted by the reference's chroma (CIE 116-1995)."""
    reference = from_chroma_and_hue(50.0, chroma, 40.0)
    one = xyz_of(reference)
    lighter = xyz_of(reference + np.array([7.0, 0.0, 0.0]))
    assert delta_e_94(one, lighter) == pytest.approx(7.0, abs=1e-9)
    stronger = xyz_of(from_chroma_and_hue(50.0, chroma + 5.0, 40.0))
    assert delta_e_94(one, stronger) == pytest.approx(5.0 / (1 + 0.045 * chroma), abs=1e-9)
    turned = xyz_of(from_chroma_and_hue(50.0, chroma, 55.0))
    arc = 2 * chroma * np.sin(np.deg2rad(7.5))
    assert delta_e_94(one, turned) == pytest.approx(arc / (1 + 0.015 * chroma), abs=1e-6)
    if chroma:  # not symmetric: the weights use the reference's chroma
        back = 5.0 / (1 + 0.045 * (chroma + 5.0))
        assert delta_e_94(stronger, one) == pytest.approx(back, abs=1e-9)


def test_cie_1994_where_all_three_differ():
    table = np.array(SHARMA)
    one, other = table[:, :3], table[:, 3:6]
    c1, c2 = np.hypot(one[:, 1], one[:, 2]), np.hypot(other[:, 1], other[:, 2])
    dl, dc = one[:, 0] - other[:, 0], c1 - c2
    dh2 = np.sum((one - other)[:, 1:] ** 2, axis=1) - dc**2
    expected = np.sqrt(dl**2 + (dc / (1 + 0.045 * c1)) ** 2 + np.maximum(dh2, 0) / (1 + 0.015 * c1) ** 2)
    np.testing.assert_allclose(delta_e_94(xyz_of(one), xyz_of(other)), expected, atol=1e-6)


def test_arrays_go_through_elementwise():
    table = np.array(SHARMA)
    one, other = xyz_of(table[:, :3]), xyz_of(table[:, 3:6])
    np.testing.assert_allclose(delta_e_2000(one, other), table[:, 6], atol=5.1e-5)
    assert delta_e_76(one.reshape(1, 13, 3), other.reshape(1, 13, 3)).shape == (1, 13)


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
