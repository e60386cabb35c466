"""The ColorChecker: published colors, regions and luminance."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import colour_science, luminance_cd_m2, xyz
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, photons_from_energy
from photosite.errors import InputError
from photosite.scene import charts


def test_macbeth_patches_have_their_published_chromaticities() -> None:
    """ColorChecker "2005" xyY under D50/C of GretagMacbeth; Ohta's spectra agree within 0.01 in x, y."""
    light = photons_from_energy(relative_energy("C"), DEFAULT_WAVELENGTH_NM)
    values = xyz(charts.macbeth_reflectance() * light, DEFAULT_WAVELENGTH_NM)
    chromaticity = values[:, :2] / values.sum(axis=1, keepdims=True)
    published = colour_science().CCS_COLOURCHECKERS["ColorChecker 1976"].data  # McCamy 1976, illuminant C
    for name, ours, theirs in zip(charts.MACBETH_NAMES, chromaticity, published.values(), strict=True):
        assert ours == pytest.approx(np.asarray(theirs)[:2], abs=0.012), name


def test_macbeth_mean_luminance_is_that_of_its_patches() -> None:
    chart = charts.macbeth("D65", 123.0)
    patches = [luminance_cd_m2(chart.radiance(r.r0, r.c0), chart.wavelength_nm) for r in chart.regions]
    assert np.mean(patches) == pytest.approx(123.0, rel=1e-9)
    assert np.argmax(patches) == charts.MACBETH_NAMES.index("white")


def test_macbeth_regions_are_inside_their_patches_with_black_between() -> None:
    chart = charts.macbeth()
    for index, region in enumerate(chart.regions):
        weights = chart.weights[:, region.r0 - 4 : region.r1 + 4, region.c0 - 4 : region.c1 + 4]
        assert (weights[index] == 1).all()
        assert weights.sum() == weights[index].sum()
    assert not chart.weights[:, :4].any()
    assert not chart.weights[:, :, 30:36][:, :, 2:4].any()


def test_macbeth_regions_of_a_frame_that_the_chart_fills() -> None:
    regions = charts.macbeth_regions(132 * 3, 196 * 3)
    chart = charts.macbeth()
    assert [(r.r0, r.c1) for r in regions] == [(3 * r.r0, 3 * r.c1) for r in chart.regions]
    with raises(InputError, "region"):
        charts.macbeth_regions(4, 6)
