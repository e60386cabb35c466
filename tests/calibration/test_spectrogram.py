"""Spectrograms of planes whose spectrum is known."""

import numpy as np
import pytest

from photosite.calibration.spatial.spectrogram import spectrogram


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("length", [128, 125])
def test_white_noise_is_flat_at_its_variance(axis, length):
    """Each power is a mean over 600 lines with a relative spread of 1 / sqrt(600), sqrt(2 / 600) at the last frequency
    of an even length: five of the latter on about 64 frequencies. The median lies 1 / 1800 low."""
    shape = (600, length) if axis == 1 else (length, 600)
    plane = np.random.default_rng(1).normal(50.0, 3.0, shape)
    found = spectrogram([plane], axis)
    assert found.frequency[-1] == (0.5 if length % 2 == 0 else 62 / 125)
    np.testing.assert_allclose(found.power[1:], 9.0, rtol=5 * np.sqrt(2 / 600))
    assert found.white == pytest.approx(9.0, rel=0.02)


def test_the_mean_over_all_frequencies_is_the_variance():
    """Parseval; frequencies between the first and the last stand for two."""
    plane = np.random.default_rng(2).gamma(2.0, 3.0, (40, 64))
    power = spectrogram([plane], axis=1).power
    assert (power[0] + 2.0 * power[1:-1].sum() + power[-1]) / 64 == pytest.approx(plane.var(), rel=1e-12)


@pytest.mark.parametrize("cycles", [1, 10, 31, 32])
def test_a_wave_is_a_peak_of_its_amplitude_at_its_frequency(cycles):
    phase = 0.0 if cycles == 32 else 0.7
    wave = 5.0 + 0.3 * np.cos(2 * np.pi * cycles / 64 * np.arange(64.0) + phase)
    across = spectrogram([np.tile(wave, (50, 1))], axis=1)
    assert across.frequency[across.power.argmax()] == cycles / 64
    assert across.amplitude().max() == pytest.approx(0.3, rel=1e-9)
    if cycles < 32:
        assert across.power.max() == pytest.approx(0.3**2 * 64 / 4, rel=1e-9)
    assert np.delete(across.power, across.power.argmax()).max() < 1e-20
    # Along the columns nothing changes: all of it stands at frequency 0.
    along = spectrogram([np.tile(wave, (50, 1))], axis=0)
    assert along.power[1:].max() < 1e-20
    assert along.power[0] > 0.0


def test_a_strong_wave_leaves_the_white_part_alone():
    rng = np.random.default_rng(3)
    plane = rng.normal(0.0, 1.0, (400, 200)) + 2.0 * np.sin(2 * np.pi * 0.2 * np.arange(200.0))
    found = spectrogram([plane], axis=1)
    assert found.frequency[found.power.argmax()] == 0.2
    assert found.amplitude().max() == pytest.approx(2.0, rel=0.02)
    assert found.white == pytest.approx(1.0, rel=0.03)


def test_several_planes_count_alike_each_about_its_own_mean(monkeypatch):
    """In pieces, too: what is transformed together changes nothing."""
    from photosite.calibration.spatial import strips

    rng = np.random.default_rng(4)
    planes = [rng.normal(level, 2.0, (30, 40)) for level in (0.0, 100.0)]
    for axis in (0, 1):
        single = [spectrogram([plane], axis).power for plane in planes]
        together = spectrogram(planes, axis).power
        np.testing.assert_allclose(together, np.mean(single, axis=0), rtol=1e-12)
        monkeypatch.setattr(strips, "VALUES_AT_A_TIME", 70)
        np.testing.assert_allclose(spectrogram(planes, axis).power, together, rtol=1e-12)
