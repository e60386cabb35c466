"""Defects, hot and blinking pixels, glow, drift and the spread of the read noise, against plain NumPy distributions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats
from tests.helpers.raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.sensor.chip_effects import dead_pixels, stuck_pixels, telegraph_pixels
from photosite.sensor.effects.model import Effects
from photosite.sensor.readout import digital_numbers

ROWS, COLS = 120, 150
SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=ROWS,
    cols=COLS,
    black_level_dn=512,
    system_gain_dn_per_e=0.4,
    read_noise_e=2,
    dsnu_mv=0,
    prnu_percent=0,
    dark_voltage_mv_per_s=0,
    full_well_e=8000,
)
GAIN = SENSOR.system_gain_dn_per_e
ALL: dict[str, Any] = {
    "hot_pixels": {"fraction": 0.05, "median_e_per_s": 200, "log_spread": 0.7},
    "pixel_defects": {
        "dead_fraction": 0.01,
        "stuck_fraction": 0.01,
        "dead_columns": 2,
        "clusters": 3,
        "listed": [{"kind": "stuck", "rows": [5, 9], "cols": [7, 7], "value": 77}],
    },
    "telegraph_noise": {"fraction": 0.2, "amplitude_e": 30, "correlation_frames": 3},
    "read_noise_spread": {"log_spread": 0.3},
    "glow": {"places": ["top_left", "right"], "peak_e_per_s": 50, "decay_pixels": 20},
    "black_level_drift": {"standard_deviation_e": 5},
}


def frame(sensor: ps.Sensor, level: float = 0.0, number: int = 0, **options: Any) -> np.ndarray[Any, Any]:
    mean = np.full((ROWS, COLS), level, np.float32)
    options = {"seed": 3, "frame": number} | options
    return digital_numbers(sensor, mean, options.pop("exposure_s", 1.0), **options).astype(float)


def stack(sensor: ps.Sensor, frames: int, **options: Any) -> np.ndarray[Any, Any]:
    return np.array([frame(sensor, number=n, **options) for n in range(frames)])


@pytest.mark.parametrize("region", [(0, 1, 0, 1), (4, 50, 3, 150), (119, 120, 0, 150), (3, 9, 7, 8)])
def test_regions_are_parts_of_the_frame(region: tuple[int, int, int, int]):
    r0, r1, c0, c1 = region
    sensor = SENSOR.with_(**ALL)
    assert (
        frame(sensor, 500, 6, region=None)[r0:r1, c0:c1]
        == digital_numbers(sensor, np.full((ROWS, COLS), 500, np.float32), 1.0, seed=3, frame=6, region=region)
    ).all()


def test_effects_of_size_zero_change_nothing():
    none = {
        "hot_pixels": {"fraction": 0, "median_e_per_s": 200},
        "pixel_defects": {},
        "telegraph_noise": {"fraction": 0, "amplitude_e": 30},
        "read_noise_spread": {"log_spread": 0},
        "glow": {"places": ["top"], "peak_e_per_s": 0, "decay_pixels": 20},
        "black_level_drift": {"standard_deviation_e": 0},
    }
    assert (frame(SENSOR, 300) == frame(SENSOR.with_(**none), 300)).mean() > 0.9999


def test_hot_pixels_are_log_normal():
    hot = SENSOR.with_(hot_pixels={"fraction": 0.05, "median_e_per_s": 500, "log_spread": 0.5}, read_noise_mv=0)
    rate = (frame(hot, exposure_s=2.0) - 512) / GAIN / 2.0
    found = rate[rate > 40]  # 1e-7 of the hot pixels are below
    assert abs(found.size - 0.05 * rate.size) < 4.5 * math.sqrt(0.05 * 0.95 * rate.size)
    assert stats.kstest(np.log(found), stats.norm(math.log(500), 0.5).cdf).pvalue > 1e-4
    more = frame(hot.with_(hot_pixels={"fraction": 0.1, "median_e_per_s": 500, "log_spread": 0.5}), exposure_s=2.0)
    assert (more[rate > 40] == frame(hot, exposure_s=2.0)[rate > 40]).all()
    assert (frame(hot.with_(serial="2")) > 530).sum() != (frame(hot) > 530).sum()


def test_defects_are_drawn_and_listed():
    listed = [
        {"kind": "dead", "rows": [100, 119], "cols": [140, 140], "value": 0.25},
        {"kind": "stuck", "rows": [5, 6], "cols": [7, 8], "value": 77},
        {"kind": "stuck", "rows": [9, 9], "cols": [0, 149]},
        {"kind": "hot", "rows": [20, 20], "cols": [30, 30], "value": 1000},
    ]
    plain = {"dead_fraction": 0.02, "stuck_fraction": 0.01, "dead_columns": 2, "clusters": 3, "cluster_pixels": 9}
    sensor = SENSOR.with_(pixel_defects={**plain, "listed": listed})
    light = frame(sensor, 3000)
    assert (light[5:7, 7:9] == 77).all()
    assert (light[9] == SENSOR.white_level_dn).all()
    assert light[100:, 140].mean() == pytest.approx(512 + 0.25 * 3000 * GAIN, abs=20)
    dark = stack(sensor, 3, level=0.0, exposure_s=0.5)
    assert dark[:, 20, 30].mean() == pytest.approx(512 + 500 * GAIN, abs=30)
    defects = Effects(pixel_defects=plain).pixel_defects
    assert defects is not None
    dead, (stuck, value) = dead_pixels(defects, sensor), stuck_pixels(defects, sensor)
    columns = np.flatnonzero(np.bincount(dead % COLS, minlength=COLS) == ROWS)
    assert columns.size == 2
    apart = dead[~np.isin(dead % COLS, columns)]
    expected = 0.02 * ROWS * (COLS - 2)
    assert abs(apart.size - expected - 27) < 4.5 * math.sqrt(expected) + 14  # clusters may leave the chip or overlap
    assert abs(stuck.size - 0.01 * ROWS * COLS) < 4.5 * math.sqrt(0.01 * ROWS * COLS)
    assert stats.kstest(value, stats.uniform(0, 4096).cdf).pvalue > 1e-4
    assert not np.isin(stuck, dead[np.isin(dead, stuck)]).all()


def test_telegraph_noise_has_two_states_of_a_markov_chain():
    """Amplitudes exponential, shares of time uniform; autocorrelation exp(-k / 3), against a plain simulation."""
    noise = {"fraction": 0.2, "amplitude_e": 60, "correlation_frames": 3}
    sensor = SENSOR.with_(telegraph_noise=noise, read_noise_mv=0)
    assert sensor.effects is not None
    assert sensor.effects.telegraph_noise is not None
    numbers, amplitude, high = telegraph_pixels(sensor.effects.telegraph_noise, sensor)
    pixels = ROWS * COLS
    assert abs(numbers.size - 0.2 * pixels) < 4.5 * math.sqrt(0.16 * pixels)
    assert stats.kstest(amplitude, stats.expon(scale=60).cdf).pvalue > 1e-4
    assert stats.kstest(high, stats.uniform().cdf).pvalue > 1e-4
    series = stack(sensor, 40).reshape(40, -1)
    assert (np.ptp(np.delete(series, numbers, axis=1), axis=0) == 0).all()
    state = (series[:, numbers] - 512) / GAIN > (0.5 - high) * amplitude
    clear = (amplitude > 20) & (high > 0.1) & (high < 0.9)
    state, high = state[:, clear].astype(float), high[clear]
    rng, keep = np.random.default_rng(1), math.exp(-1 / 3)
    plain = np.empty_like(state)
    plain[0] = rng.random(high.size) < high
    for n in range(1, 40):
        plain[n] = np.where(rng.random(high.size) < keep, plain[n - 1], rng.random(high.size) < high)
    for lag in (0, 1, 4):
        size = high * (1 - high)
        values = [float(((one[: 40 - lag] - high) * (one[lag:] - high)).mean() / size.mean()) for one in (state, plain)]
        assert values[0] == pytest.approx(keep**lag, abs=0.03)
        assert values[0] == pytest.approx(values[1], abs=0.04)
    fractions = [np.sort(one.mean(axis=0)) for one in (state, plain)]
    assert stats.ks_2samp(*fractions).pvalue > 1e-4
    assert (frame(sensor, number=39) == series[39].reshape(ROWS, COLS)).all()


@pytest.mark.parametrize("spread", [{"log_spread": 0.4}, {"quantiles": [0.5, 1, 1, 1.2, 4]}])
def test_read_noise_differs_from_pixel_to_pixel(spread: dict[str, Any]):
    """Variances over 30 frames against those of a plain simulation; their mean is the sensor's."""
    noisy = SENSOR.with_(read_noise_e=20, read_noise_spread=spread)
    variance = stack(noisy, 30).var(axis=0, ddof=1).ravel() / GAIN**2
    rng = np.random.default_rng(5)
    if "log_spread" in spread:
        sigma = np.exp(0.4 * rng.standard_normal(variance.size) - 0.16)
    else:
        sigma = np.interp(rng.random(variance.size), np.linspace(0, 1, 5), spread["quantiles"])
        sigma /= math.sqrt(np.mean(sigma**2))
    plain = np.round(rng.normal(0, 20 * GAIN * sigma, (30, sigma.size))).var(axis=0, ddof=1) / GAIN**2
    assert stats.ks_2samp(variance, plain).pvalue > 1e-4
    assert variance.mean() == pytest.approx(400 + 1 / 12 / GAIN**2, rel=0.02)


def test_glow_falls_off_from_its_places():
    sensor = SENSOR.with_(glow={"places": ["left"], "peak_e_per_s": 300, "decay_pixels": 25})
    electrons = (stack(sensor, 4, exposure_s=4.0).mean(axis=(0, 1)) - 512) / GAIN
    expected = 1200 * np.exp(-np.arange(COLS) / 25)
    assert (abs(electrons - expected) < 4.5 * np.sqrt((expected + 5) / (4 * ROWS)) + 0.05).all()


def test_the_black_level_drifts_as_1_over_f():
    """Standard deviation over many seeds; power falls as 1/f between the shortest and the longest step."""
    sensor = SENSOR.with_(
        rows=2, cols=2, read_noise_mv=0, black_level_drift={"standard_deviation_e": 100, "octaves": 8}
    )
    mean = np.zeros((2, 2), np.float32)

    def series(seed: int, frames: int) -> np.ndarray[Any, Any]:
        return np.array([digital_numbers(sensor, mean, 1.0, seed=seed, frame=n)[0, 0] for n in range(frames)], float)

    level = np.array([series(seed, 128) for seed in range(24)])
    first = (level[:, 0] - 512) / GAIN
    assert abs(np.mean(first**2) / 1e4 - 1) < 4.5 * math.sqrt(2 / 24)
    power = (np.abs(np.fft.rfft(level * np.hanning(128), axis=1)) ** 2).mean(axis=0)
    frequency = np.arange(2, 33)
    slope = np.polyfit(np.log(frequency), np.log(power[2:33]), 1)[0]
    assert -1.4 < slope < -0.6
    assert (series(5, 3) == level[5, :3]).all()


def test_hot_pixels_follow_the_temperature_and_glow_does_not():
    sensor = SENSOR.with_(
        **{name: ALL[name] for name in ("hot_pixels", "glow")}, dark_current_temperature_c=20, dark_doubling_c=5
    )
    warm = sensor.at_temperature(30).effects
    assert warm is not None
    assert warm.hot_pixels is not None
    assert warm.hot_pixels.median_e_per_s.value == pytest.approx(800)
    assert warm.glow == sensor.effects.glow  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("effects", "what", "where"),
    [
        ({"pixel_defects": {"dead_columns": 151}}, "dead_columns", "effects.pixel_defects"),
        (
            {"pixel_defects": {"listed": [{"kind": "dead", "rows": [0, 120], "cols": [0, 0]}]}},
            "listed[0].rows",
            "effects.pixel_defects",
        ),
        (
            {"pixel_defects": {"listed": [{"kind": "hot", "rows": [0, 0], "cols": [0, 0]}]}},
            "field 'value' is missing",
            "effects.pixel_defects.listed[0]",
        ),
        ({"read_noise_spread": {"quantiles": [2, 1]}}, "quantiles", "effects.read_noise_spread"),
        ({"read_noise_spread": {}}, "'log_spread' and 'quantiles' are both missing", "effects.read_noise_spread"),
        ({"output": {"companding": "log"}}, "companding", "effects.output"),
        ({"glow": {"places": ["middle"], "peak_e_per_s": 1, "decay_pixels": 1}}, "places[0]", "effects.glow"),
    ],
)
def test_invalid_effects(effects: dict[str, Any], what: str, where: str):
    with raises(InputError, what, where=where):
        SENSOR.with_(effects=effects)
