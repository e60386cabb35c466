"""Distribution of the dark current: hot pixels hidden in maps and frames, found again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.effects.hot_pixels import dark_distribution
from photosite.frames.frame_set import FrameSet
from photosite.sensor.readout import digital_numbers

NAMES = ("fraction", "median_dn_per_s", "log_spread", "mean_dn_per_s", "dcnu_percent")
HIGHEST = 1500.0


def drawn(rng: np.random.Generator, pixels: int = 40_000) -> tuple[np.ndarray, float, tuple[float, ...]]:
    """Dark currents of a chip in DN/s, limited at 1500, their uncertainty, and the truth in the order of `NAMES`."""
    mean, spread, noise = rng.uniform(1, 10), rng.uniform(0.05, 0.4), 10 ** rng.uniform(-1, 0.3)
    fraction, median, width = 10 ** rng.uniform(-3, -1.7), 10 ** rng.uniform(1.3, 2.7), rng.uniform(0.4, 1.4)
    sigma = np.sqrt(np.log1p(spread**2))
    rate = mean * rng.lognormal(-(sigma**2) / 2, sigma, pixels) + rng.normal(0, noise, pixels)
    hot = rng.random(pixels) < fraction
    rate[hot] += median * rng.lognormal(0, width, hot.sum())
    return np.minimum(rate, HIGHEST), noise, (fraction, median, width, mean, 100 * spread)


def outcomes(chips: int) -> tuple[np.ndarray, np.ndarray]:
    """(chips, 5) whether the intervals cover, and errors in standard uncertainties, where there is an estimate."""
    rng, inside, errors = np.random.default_rng(3), [], []
    for _ in range(chips):
        rate, noise, truth = drawn(rng)
        found = dark_distribution(rate, np.full(rate.size, noise), 0.95 * HIGHEST)
        if found.fraction.value is None:
            continue
        entries = [found.estimates[name] for name in NAMES]
        inside.append([e.interval_95[0] < true < e.interval_95[1] for e, true in zip(entries, truth, strict=True)])
        errors.append([(e.value - true) / e.standard_uncertainty for e, true in zip(entries, truth, strict=True)])
    return np.array(inside), np.array(errors)


def test_hot_pixels_are_found() -> None:
    inside, errors = outcomes(4)
    assert len(inside) == 4
    assert inside.sum() >= 16
    assert np.abs(errors).max() < 4


@pytest.mark.slow
def test_intervals_cover() -> None:
    """200 chips: 90 % is three binomial sigma below 95 %; the mean error is a fifth of the uncertainty."""
    inside, errors = outcomes(200)
    assert len(inside) > 180
    assert (inside.mean(axis=0) > 0.90).all()
    assert (np.abs(errors.mean(axis=0)) < 0.25).all()


@pytest.mark.slow
def test_without_hot_pixels_there_is_a_reason() -> None:
    """200 chips with nonuniform dark current and noise of different pixels, but no tail."""
    rng = np.random.default_rng(8)
    for _ in range(200):
        noise = rng.uniform(0.1, 2) * rng.lognormal(0, 0.3, 20_000)
        rate = rng.uniform(0, 5) * rng.lognormal(0, rng.uniform(0, 0.5), noise.size) + rng.normal(0, noise)
        found = dark_distribution(rate, noise)
        assert found.fraction.value is None
        assert found.above < 20


def test_another_tail_has_a_reason() -> None:
    rng = np.random.default_rng(2)
    rate = rng.normal(5.0, 0.5, 40_000)
    rate[:200], rate[200:400] = 50.0 + rng.normal(0, 1, 200), 900.0 + rng.normal(0, 1, 200)
    found = dark_distribution(rate, np.full(rate.size, 0.5))
    assert found.above == 400
    assert found.fraction.value is None


def test_from_frames(tmp_path: Path) -> None:
    """Hot pixels, of which some saturate, on a glow: the sensor file has tail, body and glow apart, the report both.

    The glow of 500 e-/s at the corner is as large as that of many hot pixels, and makes no pixel a defect.
    """
    hot = {"fraction": 0.01, "median_e_per_s": 1000.0, "log_spread": 1.2}
    mono = {"cfa": "mono", "channels": {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}}
    sensor = ps.load_sensor("nikon-d200").with_(
        **mono, rows=100, cols=120, black_level_dn=100, dark_current_e_per_s=30, dcnu_percent=20, hot_pixels=hot,
        glow={"places": ["top_left"], "peak_e_per_s": 500, "decay_pixels": 12},
    )  # fmt: skip
    steps = [("dark", t, 0) for t in (0.01, 5.0) for _ in range(6)]
    steps += [("light", 0.01 * n, 3000 * n) for n in range(1, 6) for _ in range(2)]
    frames = [
        (kind, t, digital_numbers(sensor, np.full((100, 120), electrons, np.float32), t, seed=2, frame=n))
        for n, (kind, t, electrons) in enumerate(steps)
    ]
    base = sensor.with_(hot_pixels=None, glow=None, dcnu_percent=0, dark_current_e_per_s=0)
    calibration = ps.calibrate(FrameSet.from_arrays(frames, bits=12, sensor=base), maps=True)
    assert max(dn.max() for kind, _, dn in frames if kind == "dark") == 4095
    measured = calibration.sensor
    assert measured.effects is not None
    found = measured.effects.hot_pixels
    assert found is not None
    for name, truth in hot.items():
        entry = getattr(found, name)
        assert abs(entry.value - truth) < 3.5 * entry.standard_uncertainty < truth
    noise = measured.noise
    assert noise.dcnu_percent.value == pytest.approx(20, abs=1)
    assert sensor.electrons(noise.dark_voltage_mv_per_s.value) == pytest.approx(30, rel=0.05)
    assert measured.effects.glow.peak_e_per_s == pytest.approx(500, rel=0.1)
    assert calibration.chip.defects.counts()["hot"] < 144
    assert calibration.dcnu_percent.value > 50  # the glow
    assert calibration.to_dict()["dark_distribution"]["above"] > 50
    calibration.report(tmp_path / "report.html")
    assert "of hot pixels" in (tmp_path / "report.html").read_text(encoding="utf-8")
