"""DSNU, PRNU and DCNU within readout channels, on frames that plain NumPy draws."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.frames.frame_set import FrameSet
from photosite.sensor.readout import digital_numbers
from photosite.studies.conditions import Condition

SHAPE = (64, 96)
BLACK_DN, LIGHT_E_PER_S = 100.0, 1e5


def draw(seed: int, kind: str) -> tuple[FrameSet, dict[str, float], NDArray[np.float64]]:
    """Return frames of a chip with two columns or four quadrants of their own gain and offset, the spreads of its
    pixels, and the relative gains of the channels."""
    rng = np.random.default_rng(seed)
    gain, read_e, dsnu_e = rng.uniform(0.2, 0.4), rng.uniform(3.0, 8.0), rng.uniform(2.0, 8.0)
    prnu, dark_e_per_s, dcnu = rng.uniform(0.005, 0.02), rng.uniform(20.0, 60.0), rng.uniform(0.1, 0.3)
    rows, cols = np.indices(SHAPE)
    channel = cols % 2 if kind == "columns" else 2 * (2 * rows // SHAPE[0]) + 2 * cols // SHAPE[1]
    count, size, offset_e = (2, 0.015, 6.0) if kind == "columns" else (4, 0.15, 20.0)
    gains = 1.0 + size * np.append([0.8, -0.7], rng.uniform(-1.0, 1.0, count - 2))
    gains /= gains.mean()
    offset = rng.normal(0.0, offset_e, count)[channel] + rng.normal(0.0, dsnu_e, SHAPE)
    response, rate = 1.0 + prnu * rng.normal(size=SHAPE), dark_e_per_s * (1.0 + dcnu * rng.normal(size=SHAPE))

    def take(frame: str, exposure_s: float, light_e: float, number: int) -> list[tuple[str, float, NDArray[np.uint16]]]:
        mean = light_e * response + np.maximum(rate, 0.0) * exposure_s
        e = rng.poisson(mean, (number, *SHAPE)) + offset + read_e * rng.normal(size=(number, *SHAPE))
        dn = np.clip(np.rint(BLACK_DN + gain * gains[channel] * e), 0, 4095).astype(np.uint16)
        return [(frame, exposure_s, each) for each in dn]

    shots = [take("dark", t, 0.0, 6) for t in (0.001, 1.0, 4.0)]
    shots += [take("light", t, LIGHT_E_PER_S * t, 4) for t in (0.01, 0.02, 0.03, 0.045, 0.06, 0.075)]
    truth = {"dsnu_dn": dsnu_e * gain, "dsnu_e": dsnu_e, "prnu_percent": 100.0 * prnu, "dcnu_percent": 100.0 * dcnu}
    return FrameSet.from_arrays([shot for group in shots for shot in group], bits=12), truth, gains[channel]


@pytest.mark.parametrize("kind", ["columns", "quadrants"])
def test_intervals_contain_the_truth(kind: str) -> None:
    """At least 86 of 96: fewer have a probability of 3 in 1000 at 95 %, were they independent."""
    inside = []
    for seed in range(24):
        frames, truth, _ = draw(seed, kind)
        found = ps.calibrate(frames).pixel_nonuniformity
        for name, value in truth.items():
            low, high = found[name].interval_95 or (0.0, 0.0)
            inside.append(low <= value <= high)
    assert sum(inside) >= 86


def test_the_sensor_file_has_the_step_once() -> None:
    """Simulated flat fields spread as the drawn ones do; PRNU of the file is that of the pixels."""
    frames, truth, gains = draw(1, "quadrants")
    found = ps.calibrate(frames, Condition("nominal", "12 bits, monochrome", shape=SHAPE).sensor(0))
    sensor, channels = found.sensor, found.readout_channels
    assert channels is not None
    prnu = sensor.measured("prnu_percent")
    assert abs(prnu.value - truth["prnu_percent"]) < 3.9 * prnu.standard_uncertainty < 0.2 * truth["prnu_percent"]
    assert found.prnu_percent.value == pytest.approx(np.hypot(100.0 * gains.std(), truth["prnu_percent"]), rel=0.02)
    flat = np.full(SHAPE, 5000.0, np.float32)
    mean = np.mean([digital_numbers(sensor, flat, 0.01, seed=k) for k in range(40)], axis=0)
    dark = np.mean([digital_numbers(sensor, 0.0 * flat, 0.01, seed=k) for k in range(40)], axis=0)
    signal = mean - dark
    assert 100.0 * signal.std() / signal.mean() == pytest.approx(found.prnu_percent.value, rel=0.02)
    assert dark.std() == pytest.approx(found.dsnu_dn.value, rel=0.03)


def test_equal_channels_have_no_second_figures() -> None:
    rng = np.random.default_rng(3)
    shots = [("dark", t, rng.poisson(400.0, SHAPE).astype(np.uint16)) for t in (0.01, 0.1) for _ in range(4)]
    shots += [("light", t, rng.poisson(400.0 + 1e4 * t, SHAPE).astype(np.uint16)) for t in (0.02, 0.05) for _ in "ab"]
    found = ps.calibrate(FrameSet.from_arrays(shots, bits=12))
    assert not found.pixel_nonuniformity
    assert found.to_dict()["readout_channels"] is None
