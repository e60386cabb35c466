"""The patterns of a channel: what was put into a frame is found where it was put."""

import json

import numpy as np
import pytest

from photosite.calibration.spatial.line_noise import TemporalParts
from photosite.calibration.spatial.spatial import pixel_gain
from photosite.calibration.spatial.spatial_analysis import FarThresholds, MeanPlanes, spatial_analysis
from photosite.values.uncertain import Missing, Uncertain

MONO = np.zeros((1, 1), np.int64)
BAYER = np.array([[0, 1], [1, 2]])
NOISE = TemporalParts(Uncertain(0.04), Uncertain(0.0), Uncertain(0.0))


def planes(mean, tile=MONO, channel=0, frames=25):
    return MeanPlanes.of(mean, tile, channel, frames, 0.01, NOISE)


def frames_of(rng, shape=(128, 192)):
    """Dark: pixels of 0.3 DN and a sine along rows, in steps of 1/25 DN. Light: pixels of 1 % and a slope of 8 %."""
    dark = 64.0 + rng.normal(0.0, 0.3, shape) + 0.5 * np.sin(2 * np.pi * 0.25 * np.arange(shape[1]))
    dark = np.round(25.0 * dark) / 25.0
    light = 1000.0 * (1.0 + 0.01 * rng.normal(size=shape)) * np.linspace(0.96, 1.04, shape[0])[:, None] + dark
    return dark, light


def test_what_was_put_in_is_found():
    dark, light = frames_of(np.random.default_rng(1))
    light[40, 60] += 120.0
    found = spatial_analysis(planes(dark), planes(light))
    peak = found.dark.horizontal.power.argmax()
    assert found.dark.horizontal.frequency[peak] == 0.25
    assert found.dark.horizontal.amplitude()[peak] == pytest.approx(0.5, rel=0.03)
    # A median of 96 powers, each known to 9 %: 1.1 % of the white part.
    assert found.dark.horizontal.white == pytest.approx(0.09, rel=0.05)
    assert (found.dark.unit, found.light.unit) == ("DN", "%")
    assert found.light.mean_dn == pytest.approx(1000.0, rel=1e-3)
    # The slope of the light is in the plain vertical spectrum alone.
    assert found.light.vertical.power[1] > 20.0 * found.light.vertical.white
    assert found.light.vertical_filtered.power[1:].max() < 2.0 * found.light.vertical_filtered.white
    assert found.light.vertical_filtered.white == pytest.approx(1.0, rel=0.05)
    assert found.light.histogram.sigma == pytest.approx(np.sqrt(pixel_gain()), rel=0.02)
    assert found.light.along_rows.mean[-1] / found.light.along_rows.mean[0] == pytest.approx(1.04 / 0.96, rel=3e-3)
    assert (found.light.far.row[0], found.light.far.col[0]) == (40, 60)
    # Of a pixel, the high-pass leaves 1 - h(0)^2 of what sets it apart: 1 - 0.0808^2.
    assert found.light.far.deviation[0] == pytest.approx(12.0, abs=3.0)


def test_temporal_noise_left_is_in_the_unit_of_the_spectrum():
    dark, light = frames_of(np.random.default_rng(2))
    found = spatial_analysis(planes(dark), planes(light))
    assert found.dark.horizontal.temporal == pytest.approx(0.04)
    assert found.light.vertical.temporal == pytest.approx((0.04 + 0.04) * 0.1**2, rel=2e-3)
    assert found.light.vertical_filtered.temporal == pytest.approx(0.08 * 0.1**2 * pixel_gain(), rel=2e-3)


def test_far_pixels_of_a_mosaic_have_their_places_on_the_sensor():
    dark, light = frames_of(np.random.default_rng(3), (160, 160))
    dark[21, 44] += 9.0  # a green of the second site of the tile
    dark[0::2, 1::2] += 3.0  # the two greens differ: no pixel is far for that
    found = spatial_analysis(planes(dark, BAYER, 1), planes(light, BAYER, 1), FarThresholds(dark_dn=4.0))
    assert (found.dark.far.row.tolist(), found.dark.far.col.tolist()) == ([21], [44])
    assert found.dark.far.threshold == 4.0
    said = found.to_dict()
    assert (said["dark"]["row"], said["dark"]["col"], said["dark"]["unit"]) == ([21], [44], "DN")
    assert json.loads(json.dumps(said)) == said
    assert found.dark.histogram.count.sum() == 2 * 80 * 80


def test_planes_of_an_odd_sensor_share_what_they_have():
    dark, light = frames_of(np.random.default_rng(4), (161, 163))
    found = spatial_analysis(planes(dark, BAYER, 1), planes(light, BAYER, 1))
    assert len(found.dark.along_columns.mean) == 81
    assert len(found.dark.along_rows.mean) == 80


def test_too_small_a_plane_is_said_so_and_darkness_needs_no_light():
    dark, _ = frames_of(np.random.default_rng(5), (30, 200))
    assert "high-pass needs 34" in spatial_analysis(planes(dark), Missing("no light")).reason
    dark, _ = frames_of(np.random.default_rng(5))
    alone = spatial_analysis(planes(dark), Missing("no light"))
    assert alone.light == Missing("no light")
    assert alone.to_dict()["light"] == {"reason": "no light"}
