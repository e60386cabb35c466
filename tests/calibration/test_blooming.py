"""Blooming measured beside hot pixels that overflow in long dark frames; the drain is hidden in the frames."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.effects.blooming import BloomingResult, measure_blooming
from photosite.calibration.reduction.reduce import TakenFrames
from photosite.frames.frame_set import FrameSet
from photosite.sensor.readout import digital_numbers
from photosite.values.estimate import Estimate

SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=80,
    cols=100,
    cfa="mono",
    channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}},
    black_level_dn=100,
    system_gain_dn_per_e=0.1,
    well_capacity_e=20_000,
    read_noise_e=8,
    dsnu_e=5,
    dark_current_e_per_s=30,
    dcnu_percent=20,
    hot_pixels={"fraction": 0.004, "median_e_per_s": 5000, "log_spread": 0.4},
)


def measured(seed: int, blooming: Any, well_dn: float = 2000.0, times: Any = (0.01, 1.0, 8.0)) -> BloomingResult:
    camera = SENSOR.with_(serial=str(seed), blooming=blooming, well_capacity_e=10 * well_dn)
    dark = np.zeros((80, 100), np.float32)
    frames = [
        ("dark", t, digital_numbers(camera, dark, t, seed=seed, frame=4 * k + n))
        for k, t in enumerate(times)
        for n in range(4)
    ]
    listed = FrameSet.from_arrays(frames, bits=12)
    used = [SimpleNamespace(source=source) for group in listed.groups for source in group.frames]
    levels = {"saturation_dn": Estimate(min(well_dn + 100.0, 4095.0), 0.0), "black_level_dn": Estimate(100.0, 0.0)}
    evidence = SimpleNamespace(
        reduction=SimpleNamespace(as_taken=TakenFrames(listed, used)),
        parameters=SimpleNamespace(**levels),
        chip=object(),
    )
    found = measure_blooming(evidence)  # type: ignore[arg-type]
    assert isinstance(found, BloomingResult)
    return found


def test_no_blooming_is_not_seen() -> None:
    found = [measured(seed, None) for seed in range(6)]
    assert sum(one.seen for one in found) <= 1
    assert next(one for one in found if not one.seen).section(SENSOR, "frames") == {}
    assert all(one.kept.interval_95 == (0.0, one.kept.upper_limit_95) for one in found if not one.seen)
    section = measured(1, {"drained": 0.6}).section(SENSOR, "frames")
    assert section["blooming"].drained.value == pytest.approx(0.6, abs=0.03)


def test_reasons() -> None:
    assert "converter saturates" in measured(1, {}, well_dn=5000.0).kept.reason
    assert "take one in between" in measured(1, {}, times=(0.01, 8.0)).kept.reason
