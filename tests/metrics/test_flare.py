"""Flare in light traps: the veiling glare put into a lens, coverage under noise, and a wrong black level."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.optics.illumination import VeilingGlare

RGGB = (("R", "G"), ("G", "B"))
WHITE = ps.charts.flare_traps.chart().weights[0].astype(float).repeat(2, axis=0).repeat(2, axis=1)


def measured(image: NDArray[np.float64], black: float = 0.0) -> Result:
    return measure(ChartImage((image,), "electrons", RGGB, black), "flare-traps", only=["flare"])["flare"]


def glare_percent(fraction: float, diffracted_percent: float = 0.0) -> float:
    """Return the light in a trap over that of the field, for glare that is uniform over the frame."""
    trap = (1 - fraction) * diffracted_percent / 100 + fraction * WHITE.mean()
    return float(100 * trap / (1 - fraction + fraction * WHITE.mean()))


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


def test_intervals_hold_the_truth() -> None:
    """Of 60 frames, 95 % intervals miss more than 8 in 1 of 200 runs; half as wide ones miss about 20."""
    random = np.random.default_rng(17)
    missed = dict.fromkeys("RGB", 0)
    for _ in range(60):
        fraction, bright = random.uniform(0, 0.02), 10 ** random.uniform(2.5, 4)
        gradient = 1 + random.uniform(-0.2, 0.2) * np.linspace(-1, 1, WHITE.shape[1])
        # Light and glare both follow the gradient, so that their ratio is that of the closed form.
        mean = bright * gradient * ((1 - fraction) * WHITE + fraction * WHITE.mean())
        found = measured(random.poisson(mean) + random.normal(0, 4, mean.shape))
        for channel in missed:
            low, high = found["flare_percent", channel].interval_95 or (np.nan, np.nan)
            missed[channel] += not low <= glare_percent(fraction) <= high
    assert max(missed.values()) <= 8, missed


def test_black_level_that_is_too_high_is_named() -> None:
    image = np.random.default_rng(18).poisson(2000 * WHITE + 20).astype(float)
    for black, named in ((20.0, False), (30.0, True)):
        found = measured(image, black=black)
        assert ("traps-below-black" in {entry.id for entry in found.diagnostics}) == named
    assert found["contrast_db", "G"].value is None


def test_dynamic_range_with_glare() -> None:
    """Field over the shot noise of the glare: of 40 frames, 95 % intervals miss more than 6 in 1 of 70 runs."""
    random = np.random.default_rng(19)
    missed = 0
    for _ in range(40):
        fraction, bright = random.uniform(0.002, 0.02), 10 ** random.uniform(3, 4)
        mean = bright * ((1 - fraction) * WHITE + fraction * WHITE.mean())
        found = measured(random.poisson(mean) + random.normal(0, 4, mean.shape))
        field = bright * (1 - fraction + fraction * WHITE.mean())
        truth = 20 * np.log10(field / np.sqrt(bright * fraction * WHITE.mean() + 16))
        low, high = found["dynamic_range_glare_db", "G"].interval_95 or (np.nan, np.nan)
        missed += not low <= truth <= high
    print(f"{100 * (1 - missed / 40):.0f} %")
    assert missed <= 6
