"""The chart's colors against colour-science's own integration."""

import numpy as np
import pytest

from photosite.color.colour_science import colour_science
from photosite.errors import InputError
from photosite.scene.charts import MACBETH_NAMES
from photosite.validation.charts import chart_regions, chart_xyz_d65


def test_colours_agree_with_colour_science():
    colour = colour_science()
    shape = colour.SpectralShape(380, 780, 5)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    spectra = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    wanted = [colour.sd_to_XYZ(sd, observer, light, method="Integration") / 100 for sd in spectra]
    # Its sum and our trapezoids differ by half an interval at both ends, where the observer sees nearly nothing.
    np.testing.assert_allclose(chart_xyz_d65("macbeth", MACBETH_NAMES), wanted, atol=2e-5)


def test_patches_come_in_the_order_asked_for():
    whole = chart_xyz_d65("macbeth", MACBETH_NAMES)
    np.testing.assert_allclose(chart_xyz_d65("macbeth", ["white", "red"]), whole[[18, 14]], rtol=1e-12)


def test_unknown_names_get_a_hint():
    with pytest.raises(InputError) as caught:
        chart_regions("mcbeth", 100, 150)
    assert (caught.value.what, caught.value.value) == ("chart", "mcbeth")
    assert "macbeth" in (caught.value.hint or "")
    with pytest.raises(InputError) as caught:
        chart_xyz_d65("macbeth", ["folliage"])
    assert "foliage" in (caught.value.hint or "")
