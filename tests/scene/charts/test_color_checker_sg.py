"""The ColorChecker SG: its smooth reflectances have the published colors."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.color.colorimetry import colour_science, xyz
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, photons_from_energy
from photosite.scene import charts


@pytest.mark.parametrize(("edition", "table"), [("after 2014", "After"), ("before 2014", "Before")])
@pytest.mark.parametrize(("step", "bound"), [(5.0, 0.02), (10.0, 0.15)])
def test_every_patch_has_its_published_lab(edition: str, table: str, step: float, bound: float) -> None:
    """By colour-science, from spectra to L*a*b* and CIEDE2000."""
    colour = colour_science()
    published = colour.CCS_COLOURCHECKERS[f"ColorCheckerSG - {table} November 2014"]
    grid = np.arange(380.0, 781.0, step)
    reflectance = charts.color_checker_sg_reflectance(grid, edition)
    light = photons_from_energy(illuminant("D50", grid), grid)
    seen = xyz(reflectance * light, grid) / xyz(light, grid)[1]
    wanted = np.stack([colour.xyY_to_XYZ(published.data[name]) for name in charts.SG_NAMES])
    lab, wanted_lab = (colour.XYZ_to_Lab(values, published.illuminant) for values in (seen, wanted))
    assert colour.delta_E(lab, wanted_lab, method="CIE 2000").max() < bound


def test_the_chart_has_its_reflectances_and_their_source_in_its_name() -> None:
    chart = charts.color_checker_sg("D50", 55.0)
    assert "raised" in chart.name
    assert [r.name for r in chart.regions] == list(charts.SG_NAMES)
    light = photons_from_energy(illuminant("D50"), DEFAULT_WAVELENGTH_NM)
    seen = np.stack([chart.radiance(r.r0, r.c0) for r in chart.regions])
    reflectance = charts.color_checker_sg_reflectance()
    ratio = seen.sum() / (reflectance * light).sum()
    assert np.abs(seen / (ratio * light) - reflectance).max() < 1e-4
    assert 0 < chart.relative_error <= 1e-5
    assert chart.reflectance is not None
    assert len(chart.basis) < 30


def test_the_middle_of_the_chart_is_a_color_checker_classic() -> None:
    """The SG has the Classic's 24 colors at E2 to J5, smooth here and measured there.

    Neighbors differ by 20 and more, so a misplaced patch would be found.
    """
    colour = colour_science()
    light = photons_from_energy(illuminant("D50"), DEFAULT_WAVELENGTH_NM)
    names = [f"{letter}{number}" for number in range(2, 6) for letter in "EFGHIJ"]
    raised = charts.color_checker_sg_reflectance(edition="before 2014")[[charts.SG_NAMES.index(n) for n in names]]
    white = xyz(light, DEFAULT_WAVELENGTH_NM)
    lab = [
        colour.XYZ_to_Lab(xyz(r * light, DEFAULT_WAVELENGTH_NM) / white[1], [0.3457, 0.3585])
        for r in (raised, charts.macbeth_reflectance())
    ]
    assert colour.delta_E(*lab, method="CIE 2000").max() < 10.0
