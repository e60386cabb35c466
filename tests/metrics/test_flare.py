"""Flare in light traps: the veiling glare put into a lens, and a wrong black level."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.optics.illumination import VeilingGlare
from photosite.studies.measurements.flare import glare_percent, traps

RGGB = (("R", "G"), ("G", "B"))


def measured(image: NDArray[np.float64], black: float = 0.0) -> Result:
    return measure(ChartImage((image,), "electrons", RGGB, black), "flare-traps", only=["flare"])["flare"]


def test_glare_of_a_lens() -> None:
    """Uniform veiling glare put into a lens comes back within 1 % of itself, with the light that diffraction adds."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=512, cols=768)
    scene = ps.charts.flare_traps("D65", 100)
    found = {}
    for fraction in (0.0, 0.003, 0.05):
        lens = ps.Lens(ps.DiffractionLimited(4, 50), veiling_glare=VeilingGlare(fraction))
        image = ps.Camera(lens, sensor).mean_electrons(scene, exposure_s=1 / 60)
        whole = ChartImage((image,), "electrons", sensor.array.cfa)
        found[fraction] = measure(whole, "flare-traps", only=["flare"])["flare"]
    for channel in "RGB":
        diffracted = found[0.0]["flare_percent", channel].value or 0
        assert 0 < diffracted < 1
        for fraction in (0.003, 0.05):
            wanted = glare_percent(fraction, diffracted)
            assert found[fraction]["flare_percent", channel].value == pytest.approx(wanted, rel=0.01)
            assert found[fraction]["contrast_db", channel].value == pytest.approx(-20 * np.log10(wanted / 100), abs=0.1)


def test_black_level_that_is_too_high_is_named() -> None:
    image = np.random.default_rng(18).poisson(2000 * traps() + 20).astype(float)
    for black, named in ((20.0, False), (30.0, True)):
        found = measured(image, black=black)
        assert ("traps-below-black" in {entry.id for entry in found.diagnostics}) == named
    assert found["contrast_db", "G"].value is None
