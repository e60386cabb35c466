"""Frames of a sensor: every rectangle is bit-identical to that part of the whole frame."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from virtual_chips import drawn_maps, plant_blinking

from photosite.errors import InputError
from photosite.sensor.chip import draw_chip
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.readout import digital_numbers
from photosite.studies.virtual_lab import nominal_sensor

SENSOR = load_sensor("nikon-d200").with_(
    black_level_dn=64, dark_voltage_mv_per_s=0.5, dcnu_percent=20.0, dsnu_mv=2.0, prnu_percent=5.0
)


def rectangles(rows: int, cols: int) -> list[tuple[int, int, int, int]]:
    ends = [[(a, b) for a in range(length) for b in range(a + 1, length + 1)] for length in (rows, cols)]
    return [(*down, *across) for down, across in product(*ends)]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"dsnu_mv": 0.0},
        {"prnu_percent": 0.0, "dark_voltage_mv_per_s": 0.0},
        {"row_noise_mv": 0.4, "column_noise_mv": 0.2},
    ],
)
@pytest.mark.parametrize("shape", [(6, 5), (1, 7), (7, 1), (1, 1)])
def test_every_rectangle_of_a_drawn_chip(shape: tuple[int, int], changes: dict[str, float]) -> None:
    sensor = SENSOR.with_(rows=shape[0], cols=shape[1], **changes)
    photo = np.linspace(0.0, 2000.0, shape[0] * shape[1], dtype=np.float32).reshape(shape)
    whole = digital_numbers(sensor, photo, 0.5, seed=5, frame=2)
    for region in rectangles(*shape):
        r0, r1, c0, c1 = region
        part = digital_numbers(sensor, photo, 0.5, seed=5, frame=2, region=region)
        np.testing.assert_array_equal(part, whole[r0:r1, c0:c1], err_msg=str(region))


def test_every_rectangle_of_a_measured_chip(tmp_path: Path) -> None:
    sensor = SENSOR.with_(rows=6, cols=5)
    chip = plant_blinking(drawn_maps(sensor), np.full(4, 60.0), np.full(4, 0.5))
    sensor = sensor.with_(maps=chip.save(tmp_path / "a.maps.h5"))
    photo = np.linspace(0.0, 2000.0, 30, dtype=np.float32).reshape(6, 5)
    whole = digital_numbers(sensor, photo, 0.5, seed=5, frame=2)
    for region in rectangles(6, 5):
        r0, r1, c0, c1 = region
        part = digital_numbers(sensor, photo, 0.5, seed=5, frame=2, region=region)
        np.testing.assert_array_equal(part, whole[r0:r1, c0:c1], err_msg=str(region))


@pytest.mark.parametrize("c0", [0, 1, 1000, 1023, 1024, 1025, 2048, 2099])
@pytest.mark.parametrize("width", [1, 2, 1023, 1024, 1025])
def test_columns_of_a_wide_chip(c0: int, width: int) -> None:
    """Rows are computed in runs of 1024 pixels."""
    sensor = SENSOR.with_(rows=2, cols=2100)
    c1 = min(c0 + width, 2100)
    photo = np.full((2, 2100), 500.0, np.float32)
    whole = digital_numbers(sensor, photo, 0.5, seed=5)
    np.testing.assert_array_equal(digital_numbers(sensor, photo, 0.5, seed=5, region=(0, 2, c0, c1)), whole[:, c0:c1])


@pytest.mark.parametrize("shape", [(40, 1), (1, 40), (1, 1)])
def test_a_chip_of_one_column_or_row_has_its_fixed_pattern(shape: tuple[int, int]) -> None:
    quiet = {"read_noise_mv": 0.0, "dark_voltage_mv_per_s": 0.0, "dsnu_mv": 20.0}
    sensor = SENSOR.with_(rows=shape[0], cols=shape[1], **quiet)
    offset_dn = draw_chip(sensor).offset_e.map().astype(np.float64) * sensor.system_gain_dn_per_e
    assert np.all(offset_dn != 0.0)
    found = digital_numbers(sensor, np.zeros(shape, np.float32), 0.5, seed=5)
    np.testing.assert_array_equal(found, np.clip(np.floor(64.5 + offset_dn), 0, 4095))


def test_rows_and_columns_fraction_a_part_of_the_read_noise() -> None:
    # Limits of 5 standard deviations of each variance, for normal noise: 1 false alarm in 500 000 seeds.
    rows, cols, frames = 400, 300, 24
    sensor = SENSOR.with_(rows=rows, cols=cols, read_noise_dn=5.0, dsnu_mv=0.0, dark_voltage_mv_per_s=0.0)
    noisy = sensor.with_(row_noise_dn=3.0, column_noise_dn=2.0)
    dark = np.zeros((rows, cols), np.float32)
    stack = np.stack([digital_numbers(noisy, dark, 0.1, seed=3, frame=n) for n in range(frames)]).astype(np.float64)
    stack -= stack.mean(axis=(1, 2), keepdims=True)
    of_rows, of_columns = stack.mean(axis=2), stack.mean(axis=1)
    rest = stack - of_rows[:, :, None] - of_columns[:, None, :]
    pixel = 25.0 - 9.0 - 4.0 + 1.0 / 12.0
    for values, variance, count in (
        (of_rows, 9.0 + pixel / cols, frames * rows),
        (of_columns, 4.0 + pixel / rows, frames * cols),
        (rest, pixel * (1 - 1 / rows) * (1 - 1 / cols), stack.size),
    ):
        assert values.var() == pytest.approx(variance, rel=5.0 * np.sqrt(2.0 / count) + 1.0 / 300.0)
    # Lines of other frames are others: correlations of 400 and 300 values, limit of 5 standard deviations.
    for values in (of_rows, of_columns):
        assert abs(np.corrcoef(values[0], values[1])[0, 1]) < 5.0 / np.sqrt(values.shape[1])
    # Without line noise, the frames are those of a sensor that does not state it.
    np.testing.assert_array_equal(
        digital_numbers(sensor, dark, 0.1, seed=3), digital_numbers(sensor.with_(row_noise_mv=0.0), dark, 0.1, seed=3)
    )


def test_line_noise_beyond_the_read_noise_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        SENSOR.with_(read_noise_dn=2.0, row_noise_dn=1.5, column_noise_dn=1.5)
    assert caught.value.what == "read_noise_mv"


def test_a_nominal_sensor_file_is_refused() -> None:
    """Its well capacity of 1 e-, which is still to be measured, makes every frame black."""
    nominal = nominal_sensor(SENSOR.with_(rows=4, cols=6))
    with pytest.raises(InputError) as caught:
        digital_numbers(nominal, np.full((4, 6), 500.0, np.float32), 0.5, seed=5)
    assert (caught.value.what, caught.value.value) == ("well_capacity_e", 1.0)
    assert "flat fields" in str(caught.value.hint)
    one_bit = SENSOR.with_(rows=4, cols=6, well_capacity_e=0.5 / SENSOR.system_gain_dn_per_e)
    assert digital_numbers(one_bit, np.full((4, 6), 500.0, np.float32), 0.5, seed=5).shape == (4, 6)
