"""Profiles, spectrograms, histograms and outlier pixels of planes with known patterns."""

import gc
import json
import pickle
import weakref

import numpy as np
import pytest

from photosite.calibration.spatial.line_noise import TemporalComponents
from photosite.calibration.spatial.nonuniformity import pixel_gain
from photosite.calibration.spatial.spatial_analysis import (
    MOST_BINS,
    MeanPlanes,
    OutlierThresholds,
    histogram,
    normal_threshold,
    outlier_pixels,
    profiles,
    spatial_analysis,
    spectrogram,
)
from photosite.values.uncertain import Missing, Uncertain

MONO = np.zeros((1, 1), np.int64)
BAYER = np.array([[0, 1], [1, 2]])
NOISE = TemporalComponents(Uncertain(0.04), Uncertain(0.0), Uncertain(0.0))


def planes(mean, tile=MONO, channel=0, frames=25):
    return MeanPlanes.of(mean, tile, channel, frames, 0.01, NOISE)


def frames_of(rng, shape=(128, 192)):
    """Dark: noise of 0.3 DN and a sine along rows, in steps of 1/25 DN. Light: noise of 1 % and a gradient of 8 %."""
    dark = 64.0 + rng.normal(0.0, 0.3, shape) + 0.5 * np.sin(2 * np.pi * 0.25 * np.arange(shape[1]))
    dark = np.round(25.0 * dark) / 25.0
    light = 1000.0 * (1.0 + 0.01 * rng.normal(size=shape)) * np.linspace(0.96, 1.04, shape[0])[:, None] + dark
    return dark, light


def test_planted_patterns_are_found():
    dark, light = frames_of(np.random.default_rng(1))
    light[40, 60] += 120.0
    found = spatial_analysis(planes(dark), planes(light))
    peak = found.dark.horizontal.power.argmax()
    assert found.dark.horizontal.frequency[peak] == 0.25
    assert found.dark.horizontal.amplitude()[peak] == pytest.approx(0.5, rel=0.03)
    # The median of 96 powers, each with a relative error of 9 %, is known to 1.1 %.
    assert found.dark.horizontal.white == pytest.approx(0.09, rel=0.05)
    assert (found.dark.unit, found.light.unit) == ("DN", "%")
    assert found.light.mean_dn == pytest.approx(1000.0, rel=1e-3)
    # Only the unfiltered vertical spectrum contains the gradient of the light.
    assert found.light.vertical.power[1] > 20.0 * found.light.vertical.white
    assert found.light.vertical_filtered.power[1:].max() < 2.0 * found.light.vertical_filtered.white
    assert found.light.vertical_filtered.white == pytest.approx(1.0, rel=0.05)
    assert found.light.histogram.sigma == pytest.approx(np.sqrt(pixel_gain()), rel=0.02)
    assert found.light.along_rows.mean[-1] / found.light.along_rows.mean[0] == pytest.approx(1.04 / 0.96, rel=3e-3)
    assert (found.light.outliers.row[0], found.light.outliers.col[0]) == (40, 60)
    # The high-pass filter keeps 1 - h(0)^2 = 1 - 0.0808^2 of a single pixel's deviation.
    assert found.light.outliers.deviation[0] == pytest.approx(12.0, abs=3.0)


def test_remaining_temporal_noise_has_the_unit_of_the_spectrum():
    dark, light = frames_of(np.random.default_rng(2))
    found = spatial_analysis(planes(dark), planes(light))
    assert found.dark.horizontal.temporal == pytest.approx(0.04)
    assert found.light.vertical.temporal == pytest.approx((0.04 + 0.04) * 0.1**2, rel=2e-3)
    assert found.light.vertical_filtered.temporal == pytest.approx(0.08 * 0.1**2 * pixel_gain(), rel=2e-3)


def test_outlier_pixels_of_a_mosaic_have_sensor_positions():
    dark, light = frames_of(np.random.default_rng(3), (160, 160))
    dark[21, 44] += 9.0  # a green of the second site of the tile
    dark[0::2, 1::2] += 3.0  # different green levels do not make outlier pixels
    found = spatial_analysis(planes(dark, BAYER, 1), planes(light, BAYER, 1), OutlierThresholds(dark_dn=4.0))
    assert (found.dark.outliers.row.tolist(), found.dark.outliers.col.tolist()) == ([21], [44])
    assert found.dark.outliers.threshold == 4.0
    content = found.to_dict()
    assert (content["dark"]["row"], content["dark"]["col"], content["dark"]["unit"]) == ([21], [44], "DN")
    assert json.loads(json.dumps(content)) == content
    assert found.dark.histogram.count.sum() == 2 * 80 * 80


def test_planes_of_an_odd_sensor_are_cut_to_one_size():
    dark, light = frames_of(np.random.default_rng(4), (161, 163))
    found = spatial_analysis(planes(dark, BAYER, 1), planes(light, BAYER, 1))
    assert len(found.dark.along_columns.mean) == 81
    assert len(found.dark.along_rows.mean) == 80


def test_too_small_planes_are_missing_and_dark_needs_no_light():
    dark, _ = frames_of(np.random.default_rng(5), (30, 200))
    assert "high-pass needs 34" in spatial_analysis(planes(dark), Missing("no light")).reason
    dark, _ = frames_of(np.random.default_rng(5))
    alone = spatial_analysis(planes(dark), Missing("no light"))
    assert alone.light == Missing("no light")
    assert alone.to_dict()["light"] == {"reason": "no light"}


def test_profiles_of_one_plane():
    plane = np.random.default_rng(1).normal(100.0, 5.0, (31, 44))
    across, down = profiles([plane])
    np.testing.assert_allclose(across.mean, plane.mean(0), rtol=1e-14)
    np.testing.assert_array_equal(across.lowest, plane.min(0))
    np.testing.assert_array_equal(across.middle, plane[15])
    np.testing.assert_array_equal(down.highest, plane.max(1))
    np.testing.assert_array_equal(down.middle, plane[:, 22])


def test_profile_of_two_planes():
    planes = [np.full((4, 5), 2.0), np.full((4, 5), 6.0)]
    found, _ = profiles(planes)
    assert found.mean.tolist() == [4.0] * 5
    assert (found.lowest.max(), found.highest.min(), found.middle[0]) == (2.0, 6.0, 2.0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("length", [128, 125])
def test_white_noise_is_flat_at_its_variance(axis, length):
    """Five standard errors on about 64 frequencies.

    Each power is a mean over 600 lines, with a relative error of 1 / sqrt(600), or sqrt(2 / 600) at the last frequency
    of an even length. The median is 1 / 1800 too low.
    """
    shape = (600, length) if axis == 1 else (length, 600)
    plane = np.random.default_rng(1).normal(50.0, 3.0, shape)
    found = spectrogram([plane], axis)
    assert found.frequency[-1] == (0.5 if length % 2 == 0 else 62 / 125)
    np.testing.assert_allclose(found.power[1:], 9.0, rtol=5 * np.sqrt(2 / 600))
    assert found.white == pytest.approx(9.0, rel=0.02)


def test_the_mean_over_all_frequencies_is_the_variance():
    """Parseval's theorem; all frequencies but the first and the last count twice."""
    plane = np.random.default_rng(2).gamma(2.0, 3.0, (40, 64))
    power = spectrogram([plane], axis=1).power
    assert (power[0] + 2.0 * power[1:-1].sum() + power[-1]) / 64 == pytest.approx(plane.var(), rel=1e-12)


@pytest.mark.parametrize("cycles", [1, 10, 31, 32])
def test_sine_is_a_peak_with_its_amplitude_and_frequency(cycles):
    phase = 0.0 if cycles == 32 else 0.7
    wave = 5.0 + 0.3 * np.cos(2 * np.pi * cycles / 64 * np.arange(64.0) + phase)
    across = spectrogram([np.tile(wave, (50, 1))], axis=1)
    assert across.frequency[across.power.argmax()] == cycles / 64
    assert across.amplitude().max() == pytest.approx(0.3, rel=1e-9)
    if cycles < 32:
        assert across.power.max() == pytest.approx(0.3**2 * 64 / 4, rel=1e-9)
    assert np.delete(across.power, across.power.argmax()).max() < 1e-20
    # Along the columns the map is constant: all power is at frequency 0.
    along = spectrogram([np.tile(wave, (50, 1))], axis=0)
    assert along.power[1:].max() < 1e-20
    assert along.power[0] > 0.0


def test_strong_sine_does_not_change_the_white_part():
    rng = np.random.default_rng(3)
    plane = rng.normal(0.0, 1.0, (400, 200)) + 2.0 * np.sin(2 * np.pi * 0.2 * np.arange(200.0))
    found = spectrogram([plane], axis=1)
    assert found.frequency[found.power.argmax()] == 0.2
    assert found.amplitude().max() == pytest.approx(2.0, rel=0.02)
    assert found.white == pytest.approx(1.0, rel=0.03)


def test_spectrogram_of_several_planes_is_their_mean(monkeypatch):
    """The result does not depend on the size of the strips."""
    from photosite.calibration.spatial import nonuniformity as strips

    rng = np.random.default_rng(4)
    planes = [rng.normal(level, 2.0, (30, 40)) for level in (0.0, 100.0)]
    for axis in (0, 1):
        single = [spectrogram([plane], axis).power for plane in planes]
        together = spectrogram(planes, axis).power
        np.testing.assert_allclose(together, np.mean(single, axis=0), rtol=1e-12)
        monkeypatch.setattr(strips, "STRIP_VALUES", 70)
        np.testing.assert_allclose(spectrogram(planes, axis).power, together, rtol=1e-12)


def test_histogram_of_normal_sample():
    """Chi-square over the bins with at least ten expected pixels, five standard deviations sqrt(2 n) about n.

    The accumulated histogram: Kolmogorov's distance of 10^6 pixels exceeds 2.2 / 1000 for one seed in 8000.
    """
    found = histogram([np.random.default_rng(1).normal(0.0, 2.5, (1000, 1000))], [0.0])
    expected = found.normal()
    enough = expected >= 10.0
    chi_square = np.sum((found.count - expected)[enough] ** 2 / expected[enough])
    assert abs(chi_square - enough.sum()) < 5.0 * np.sqrt(2.0 * enough.sum())
    assert found.count.sum() == 1_000_000
    assert found.sigma == pytest.approx(2.5, rel=0.004)
    assert np.abs(found.percent_beyond - found.normal_beyond()).max() < 0.22


def test_bins_of_mean_frames_hold_equal_numbers_of_values():
    """The mean of 50 frames has steps of 1/50. Bins of other widths would alternately hold one or two values."""
    rng = np.random.default_rng(2)
    mean = np.round(rng.normal(700.0, 25.0, (500, 800))) / 50.0
    found = histogram([mean], [mean.mean()], grain=1 / 50)
    assert found.width == pytest.approx(np.round(found.width * 50) / 50)
    assert len(found.count) <= MOST_BINS
    expected = found.normal()
    enough = expected > 1000.0
    np.testing.assert_allclose(found.count[enough], expected[enough], rtol=6.0 / np.sqrt(1000.0))


@pytest.mark.parametrize("grain", [0.25, None])
def test_counts_match_direct_counting(grain):
    rng = np.random.default_rng(3)
    values = np.round(rng.normal(0.0, 40.0, (30, 100))) / 4.0
    found = histogram([values], [values.mean()], grain)
    values -= values.mean()
    assert found.count.sum() == 3000
    for k in range(0, len(found.count), 7):
        low = found.lower[k] - 1e-9
        assert found.count[k] == np.sum((values >= low) & (values < low + found.width)) or grain is None
    for at, percent in list(zip(found.deviation, found.percent_beyond, strict=True))[::5]:
        assert percent == pytest.approx(100.0 * np.mean(np.abs(values) >= at - 1e-9), abs=0.04)
    assert found.percent_beyond[0] == 100.0


def test_constant_map_has_one_bin():
    found = histogram([np.full((10, 10), 3.0)], [3.0], grain=0.5)
    assert found.count.tolist() == [100]
    assert found.percent_beyond.tolist() == [100.0]
    assert found.normal().tolist() == [100.0]


def test_outlier_pixels_are_found_and_ordinary_ones_are_not():
    """A million normal pixels list 0.1 pixels on average; more than two are found for one seed in 6000."""
    rng = np.random.default_rng(4)
    plane = rng.normal(0.0, 2.0, (1000, 1000))
    assert normal_threshold(plane, plane.size) == pytest.approx(2.0 * 5.33, rel=0.01)  # Phi(-5.33) 2e6 = 0.1
    assert normal_threshold(plane.round(), plane.size, 1.0) == pytest.approx(2.0 * 5.33, rel=0.05)
    hot = rng.choice(1_000_000, 40, replace=False)
    plane.ravel()[hot] += rng.choice([-30.0, 30.0], 40)
    places = np.arange(1000)
    found = outlier_pixels([plane], [0.0], [(places, places)])
    assert set(hot) <= set(found.row * 1000 + found.col)
    assert len(found.row) <= 42
    assert (np.diff(np.abs(found.deviation)) <= 0.0).all()
    given = outlier_pixels([plane], [0.0], [(places, places)], threshold=5.0)
    assert len(given.row) == np.sum(np.abs(plane) > 5.0)
    assert given.rule == "set by the user"


def test_patterns_survive_pickling_and_release_the_mean_frames():
    dark, light = frames_of(np.random.default_rng(1))
    plain, sent = spatial_analysis(planes(dark), planes(light)), spatial_analysis(planes(dark), planes(light))
    sent = pickle.loads(pickle.dumps(sent))
    for kind in ("dark", "light"):
        first, second = getattr(plain, kind), getattr(sent, kind)
        assert first.horizontal.power.tobytes() == second.horizontal.power.tobytes()
        assert first.outliers.row.tolist() == second.outliers.row.tolist()
    kept, references = np.array(dark), [dark]
    found = spatial_analysis(planes(kept), Missing("no light"))
    references[0] = weakref.ref(kept)
    del kept
    assert references[0]() is not None
    found.compute()
    gc.collect()
    assert references[0]() is None
