"""Virtual chips: frames of a chip as maps, and defects at their positions."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_chips import drawn_maps, plant_blinking, plant_dead, plant_hot

from photosite.errors import InputError
from photosite.sensor.chip import DefectKind
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.readout import digital_numbers

SENSOR = load_sensor("nikon-d200").with_(
    rows=60, cols=80, black_level_dn=64, dark_voltage_mv_per_s=0.5, dcnu_percent=20.0
)


def frames(sensor, count, mean=500.0):
    photo = np.full((60, 80), mean, np.float32)
    return np.array([digital_numbers(sensor, photo, 0.5, seed=5, frame=i) for i in range(count)])


def test_maps_give_the_frames_of_the_drawn_chip(tmp_path) -> None:
    """The 32-bit maps may change the rounding of single values by 1 DN."""
    drawn, measured = frames(SENSOR, 4), frames(SENSOR.with_(maps=drawn_maps(SENSOR).save(tmp_path / "a.maps.h5")), 4)
    difference = np.abs(drawn.astype(int) - measured)
    assert difference.max() <= 1
    assert np.count_nonzero(difference) < 1e-4 * difference.size
    part = digital_numbers(SENSOR, np.full((60, 80), 500, np.float32), 0.5, seed=5, region=(10, 20, 31, 71))
    assert (np.abs(part.astype(int) - drawn[0, 10:20, 31:71]) == 0).all()


def test_regions_and_seeds_of_a_measured_chip(tmp_path) -> None:
    chip = plant_blinking(drawn_maps(SENSOR), np.full(40, 60.0), np.full(40, 0.5))
    sensor = SENSOR.with_(maps=chip.save(tmp_path / "a.maps.h5"))
    photo = np.full((60, 80), 500.0, np.float32)
    whole = digital_numbers(sensor, photo, 0.5, seed=5)
    part = digital_numbers(sensor, photo, 0.5, seed=5, region=(10, 50, 31, 71))
    assert (part == whole[10:50, 31:71]).all()
    assert (digital_numbers(sensor, photo, 0.5, seed=6) != whole).any()


def test_measured_chip_of_another_size_is_an_error(tmp_path) -> None:
    sensor = SENSOR.with_(maps=drawn_maps(SENSOR).save(tmp_path / "a.maps.h5"))
    with pytest.raises(InputError) as caught:
        digital_numbers(sensor.with_(cols=70), np.zeros((60, 70), np.float32), 0.5, seed=5)
    assert (caught.value.what, caught.value.value) == ("maps", (60, 80))


def test_defects_have_the_planned_effect(tmp_path) -> None:
    """Means over 64 frames within 5 standard errors: false alarms below 1e-4 for all 60 pixels."""
    gain = SENSOR.system_gain_dn_per_e
    chip = plant_hot(drawn_maps(SENSOR), SENSOR, np.linspace(50, 400, 20), 1.0)
    chip = plant_dead(chip, np.linspace(0, 0.4, 20))
    chip = plant_blinking(chip, np.full(20, 60.0), np.linspace(0.2, 0.8, 20))
    assert chip.defects.counts() | {"hot": 20, "dead": 20, "blinking": 20} == chip.defects.counts()
    assert len(set(zip(chip.defects.row.tolist(), chip.defects.col.tolist(), strict=True))) == 60
    stack = frames(SENSOR.with_(maps=chip.save(tmp_path / "a.maps.h5")), 64).astype(float)
    mean = stack.mean(axis=0)
    expected = 64 + chip.offset_dn + 500 * gain * (1 + chip.prnu) + 0.5 * chip.dark_rate_dn_per_s
    for kind in (DefectKind.HOT, DefectKind.DEAD, DefectKind.BLINKING):
        row, col = (values for values in (chip.defects.of(kind).row, chip.defects.of(kind).col))
        error = stack[:, row, col].std(axis=0, ddof=1) / 8
        assert (np.abs(mean - expected)[row, col] < 5 * error).all(), kind
    blinks = chip.blinking
    spread = stack[:, blinks.row, blinks.col].var(axis=0, ddof=1)
    noise = chip.read_noise_dn[0, 0] ** 2 + gain * 500 * gain
    telegraph = blinks.amplitude_dn**2 * blinks.high_fraction * (1 - blinks.high_fraction)
    assert np.mean(spread / (telegraph + noise)) == pytest.approx(1.0, abs=0.1)  # 20 variances of 64: 5 sigma


def test_more_defects_than_pixels_are_rejected() -> None:
    with pytest.raises(InputError) as caught:
        plant_dead(drawn_maps(SENSOR), np.zeros(4801))
    assert caught.value.value == 4801
