"""Spread of the read noise, telegraph noise and defects that a sensor file states, measured back from its frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.chip_maps import pixel_noise
from photosite.calibration.chip_maps.noise_distribution import blinking_distribution, read_noise_distribution
from photosite.frames.frame_set import FrameSet
from photosite.sensor.chip import Blinking, DefectKind
from photosite.sensor.chip_effects import dead_pixels, stuck_pixels
from photosite.sensor.readout import digital_numbers
from photosite.values.estimate import Estimate

MONO = {"M": {"wavelength_nm": [550], "quantum_efficiency": [0.5]}}
ROWS, COLS = 100, 160
SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=ROWS,
    cols=COLS,
    cfa="mono",
    channels=MONO,
    black_level_dn=200,
    system_gain_dn_per_e=0.4,
    read_noise_e=6,
    dsnu_e=3,
    prnu_percent=1,
    dark_current_e_per_s=5,
    dcnu_percent=10,
    full_well_e=9000,
)


def variances(rng: np.random.Generator, spread: float, rms_dn: float, frames: int, pixels: int) -> np.ndarray:
    sigma = rms_dn * np.exp(spread * rng.standard_normal(pixels) - spread**2)
    return np.round(64.3 + rng.normal(0, sigma, (frames, pixels))).var(axis=0, ddof=1)


def covers(entry: Estimate, truth: float) -> bool:
    assert entry.interval_95 is not None
    return entry.interval_95[0] <= truth <= entry.interval_95[1]


@pytest.mark.slow
def test_intervals_of_the_spread_cover():
    """100 chips, four binomial sigma; and 60 without a spread: 5 % of them have no upper limit."""
    rng = np.random.default_rng(7)
    inside, limited = np.zeros(2, int), 0
    for _ in range(100):
        spread, frames = rng.uniform(0.03, 0.4), int(rng.integers(12, 40))
        found = read_noise_distribution(variances(rng, spread, rng.uniform(1.2, 4), frames, 9000), frames - 1, 1 / 12)[
            0
        ]
        inside += covers(found, spread)
    assert (inside >= 87).all(), inside
    for _ in range(60):
        found = read_noise_distribution(variances(rng, 0.0, 2.0, 24, 9000), 23, 1 / 12)[0]
        limited += found.upper_limit_95 is not None
    assert limited >= 51


def test_quiet_pixels_have_no_spread():
    found = read_noise_distribution(variances(np.random.default_rng(1), 0.2, 0.4, 20, 2000), 19, 1 / 12)[0]
    assert found.value is None


def blinking_chip(rng: np.random.Generator, fraction: float, amplitude: float, frames: int, high: float | None = None):
    """The estimates of a plain simulation of 20 000 pixels with a noise of 2 DN."""
    pixels = 20_000
    n = rng.binomial(pixels, fraction)
    part = rng.random((n, 1)) if high is None else np.full((n, 1), high)
    dn = rng.normal(64, 2, (pixels, frames))
    dn[:n] += rng.exponential(amplitude, (n, 1)) * ((rng.random((n, frames)) < part) - part)
    dn = np.round(dn)
    variance = dn.var(axis=1, ddof=1)
    limit = pixel_noise.noise_spread(variance, frames - 1).limit(1e-3, frames - 1)
    place = np.flatnonzero(variance > limit)
    jumps, levels = pixel_noise.find_blinking(dn[place])
    distance = (levels.upper - levels.lower)[jumps]
    row = place[jumps]
    found = Blinking(row, np.zeros_like(row), distance, levels.high_fraction[jumps], np.full(len(row), 2.0))
    return blinking_distribution(found, pixels, frames, float(np.sqrt(np.median(variance))), 1.0)


@pytest.mark.slow
def test_intervals_of_telegraph_noise_cover():
    """60 chips; a fraction of 1 % may be taken for another distribution."""
    rng = np.random.default_rng(8)
    inside, estimated = np.zeros(2, int), 0
    for _ in range(60):
        fraction, amplitude = rng.uniform(0.004, 0.05), rng.uniform(15, 50)
        found = blinking_chip(rng, fraction, amplitude, int(rng.integers(24, 60)))
        if found[0].value is not None:
            estimated += 1
            inside += [covers(found[0], fraction), covers(found[1], amplitude)]
    assert estimated >= 54
    assert (inside >= estimated - 9).all()


def test_telegraph_noise_of_another_kind_is_named():
    rng = np.random.default_rng(3)
    fraction, amplitude = blinking_chip(rng, 0.05, 40.0, 40, high=0.5)
    assert "not uniform" in (fraction.reason or "")
    fraction, amplitude = blinking_chip(rng, 0.0, 40.0, 24)
    assert fraction.value is None
    assert amplitude.value is None


@pytest.fixture(scope="module")
def measured():
    """A sensor with effects, its calibration, chip and temporal noise."""
    sensor = SENSOR.with_(
        read_noise_spread={"log_spread": 0.25},
        telegraph_noise={"fraction": 0.02, "amplitude_e": 100},
        black_level_drift={"standard_deviation_e": 8, "octaves": 1},
        hot_pixels={"fraction": 0.005, "median_e_per_s": 150, "log_spread": 0.5},
        pixel_defects={"dead_fraction": 0.001, "stuck_fraction": 0.0005, "dead_columns": 1, "clusters": 1},
    )
    plan = [("dark", 0.01, 32, 0.0), ("dark", 8.0, 10, 0.0)]
    plan += [("light", t, 4, 2e5 * t) for t in np.linspace(0.005, 0.05, 8).tolist()]
    frames = []
    for kind, exposure_s, count, electrons in plan:
        mean = np.full((ROWS, COLS), electrons, np.float32)
        for _ in range(count):
            frames.append((kind, exposure_s, digital_numbers(sensor, mean, exposure_s, seed=2, frame=len(frames))))
    frame_set = FrameSet.from_arrays(frames, bits=12, sensor=sensor)
    calibration = calibrate(frame_set, sensor.with_(effects=None), maps=True)
    return sensor, calibration, calibration.chip, calibration.temporal


def test_distribution_of_the_noise_is_measured(measured):
    """With a drift of the black level as large as the read noise, which belongs to no pixel."""
    sensor, _, chip, temporal = measured
    gain = sensor.system_gain_dn_per_e
    assert np.median(chip.read_noise_dn) / gain == pytest.approx(6.0 * np.exp(-(0.25**2)), rel=0.04)
    assert covers(temporal.read_noise_log_spread, 0.25)
    assert covers(temporal.blinking_fraction, 0.02)
    assert covers(temporal.blinking_amplitude_dn, 100 * gain)


def test_distribution_of_the_noise_is_in_the_sensor_file(measured):
    """The read noise is that without telegraph noise."""
    sensor, calibration, chip, temporal = measured
    found = replace(calibration, base=sensor.with_(effects=None), chip=chip, temporal=temporal).sensor
    telegraph, spread = found.effects.telegraph_noise, found.effects.read_noise_spread
    assert telegraph.fraction == temporal.blinking_fraction.value
    assert telegraph.amplitude_e * calibration.system_gain_dn_per_e.value == pytest.approx(
        temporal.blinking_amplitude_dn.value
    )
    assert spread.log_spread == temporal.read_noise_log_spread.value
    read = found.noise.read_noise_mv
    assert abs(read.value - sensor.noise.read_noise_mv.value) < 3 * read.standard_uncertainty < 0.1 * read.value
    left_out = calibration.findings["pixel_defects"].left_out
    assert calibration.read_noise_mv.value < 1.05 * read.value
    assert left_out.all_pixels["read_noise_dn"] > 1.2 * left_out.without["read_noise_dn"]
    assumed = replace(calibration, base=sensor).sensor.noise.read_noise_mv.value
    assert assumed == pytest.approx(sensor.noise.read_noise_mv.value, rel=0.15)


def test_drawn_defects_are_found(measured):
    """Of dead and stuck pixels 99 %, of hot ones with 60 e-/s or more 97 %; false alarms below 0.2 % of the chip."""
    sensor, _, chip, _ = measured
    defects = sensor.effects.pixel_defects
    found = {kind: chip.defects.of(kind).row * COLS + chip.defects.of(kind).col for kind in DefectKind}
    dead, stuck = dead_pixels(defects, sensor), stuck_pixels(defects, sensor)[0]
    assert np.isin(dead, found[DefectKind.DEAD]).mean() > 0.99
    assert np.isin(stuck, np.concatenate([found[DefectKind.DEAD], found[DefectKind.OFFSET]])).mean() > 0.99
    dark = [
        digital_numbers(sensor.with_(**changed), np.zeros((ROWS, COLS), np.float32), 8.0, seed=9).astype(float)
        for changed in ({"telegraph_noise": None}, {"telegraph_noise": None, "hot_pixels": None})
    ]
    hot = np.flatnonzero((dark[0] - dark[1]) / sensor.system_gain_dn_per_e / 8.0 > 60)
    assert hot.size > 40
    assert np.isin(hot, found[DefectKind.HOT]).mean() > 0.97
    for kind, true in ((DefectKind.DEAD, np.union1d(dead, stuck)), (DefectKind.HOT, hot)):
        assert (~np.isin(found[kind], true)).sum() < 0.002 * ROWS * COLS
