"""Gray patches that hold part of their neighbors are named and left out; slopes of the light are divided out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import photosite as ps
from photosite.metrics.measure import ImageQuality, measure
from photosite.studies.measurements.noise import truth_of
from photosite.studies.virtual_charts import VirtualNoise
from photosite.studies.virtual_patches import color_checker, raw_patches


@pytest.fixture(scope="module")
def frame() -> ps.RawFrame:
    sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    scene = ps.charts.macbeth("D65", 100)
    return camera.capture(scene, exposure_s=camera.auto_exposure_s(camera.mean_electrons(scene, 1.0)), seed=3)


def quality(frame: ps.RawFrame) -> ImageQuality:
    return measure([frame], "macbeth", only=["noise", "oecf"])


def test_a_patch_with_a_spot_is_named(frame: ps.RawFrame) -> None:
    clean = quality(frame)
    assert "uneven-patches" not in {entry.id for entry in clean.diagnostics}
    (patch,) = (each for each in clean.chart.patches if each.name == "neutral 6.5")
    dn = frame.dn.copy()
    dn[patch.r0 : patch.r0 + 10, patch.c0 : patch.c0 + 10] += 300
    (found,) = (entry for entry in quality(replace(frame, dn=dn)).diagnostics if entry.id == "uneven-patches")
    assert found.text.endswith(": neutral 6.5")
    assert found.size == pytest.approx(0.027, rel=0.05)


def test_an_uneven_patch_is_left_out() -> None:
    """The spot triples the noise of its patch and raises its mean by 2 %. Intervals miss 1 in 1000 at 3.3."""
    noise = VirtualNoise(0.5, 3.0, 1.0, 0.005)
    frames, _ = raw_patches(noise, np.random.default_rng(21), 1)
    (patch,) = (each for each in color_checker().patches if each.name == "neutral 6.5")
    for frame in frames:
        frame.dn[patch.r0 : patch.r0 + 12, patch.c0 : patch.c0 + 12] += 300
    found = measure(frames, "macbeth", only=["noise", "oecf"], luminance_cd_m2=100.0)
    assert "uneven-patches" in {entry.id for entry in found.diagnostics}
    for name in ("snr_18_db", "snr_13_db", "signal_snr_10"):
        value = found["noise"][name]
        assert abs((value.value or 0) - truth_of(noise)[name]) < 3.3 * (value.standard_uncertainty or 0), name
    exponent = found["oecf"]["exponent"]
    assert abs((exponent.value or 0) - 1.0) < 3.3 * (exponent.standard_uncertainty or 0)
    assert (exponent.standard_uncertainty or 1) < 0.006


@pytest.mark.parametrize("light", [(0.0, 0.2), (0.15, -0.1)])
def test_light_with_a_slope_does_not_bend_the_tone(light: tuple[float, float]) -> None:
    """Gray patches lie in a row, from bright to dark: 20 % of light would change the exponent by 0.05."""
    frames, _ = raw_patches(VirtualNoise(0.5, 3.0, 1.0, 0.005), np.random.default_rng(22), 4, light=light)
    found = measure(frames, "macbeth", only=["oecf"], luminance_cd_m2=100.0)["oecf"]
    exponent = found["exponent"]
    assert abs((exponent.value or 0) - 1.0) < 3.3 * (exponent.standard_uncertainty or 0)
    assert (exponent.standard_uncertainty or 1) < 0.004
