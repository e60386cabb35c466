"""Gain and excess noise of a multiplication register: hidden in frames, found again, in command, file and report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.diagnosed import limits
from tests.helpers.raising import raises

import photosite as ps
from photosite.calibration.effects.em_gain import EmGainResult, measure_em_gain
from photosite.cli.main import run
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.effects.em_gain import EmGain
from photosite.sensor.readout import digital_numbers

SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=40,
    cols=50,
    cfa="mono",
    channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.9, 0.9]}},
    bits=16,
    black_level_dn=200,
    system_gain_dn_per_e=0.1,
    read_noise_e=40,
    dsnu_e=5,
    prnu_percent=0.5,
    well_capacity_e=400_000,
)
RATE_E = 1e6
"""Electrons per second from the light."""


def simulated(camera: ps.Sensor, longest_s: float, seed: int, frames: int = 6) -> list[tuple[str, float, np.ndarray]]:
    """Dark frames, and flat fields of eight exposure times in the same light."""
    steps = [("dark", longest_s, 0.0)] * 8
    steps += [("light", n * longest_s / 8, RATE_E * n * longest_s / 8) for n in range(1, 9) for _ in range(frames)]
    size = camera.array.rows, camera.array.cols
    return [
        (kind, t, digital_numbers(camera, np.full(size, electrons, np.float32), t, seed=seed, frame=number))
        for number, (kind, t, electrons) in enumerate(steps)
    ]


def frame_set(frames: list[tuple[str, float, np.ndarray]]) -> FrameSet:
    return FrameSet.from_arrays(frames, bits=16, sensor=SENSOR)


def measured(seed: int, gain: float, stages: int) -> tuple[EmGainResult, EmGain]:
    register = SENSOR.with_(em_gain={"gain": gain, "stages": stages}, serial=str(seed))
    stated = EmGain(gain=1, stages=stages)
    unity = ps.calibrate(frame_set(simulated(SENSOR.with_(serial=str(seed)), 0.3, seed)))
    found = measure_em_gain(unity, ps.calibrate(frame_set(simulated(register, 30 / gain / 1000, seed + 1000))), stated)
    assert register.effects is not None
    assert register.effects.em_gain is not None
    return found, register.effects.em_gain


def test_noise_against_theory() -> None:
    found, true = measured(7, 100.0, 300)
    assert found.theory == pytest.approx(true.excess_noise_factor, rel=0.01)
    assert not found.warnings
    few = EmGainResult(found.gain, found.excess_noise_factor, found.read_noise_e, EmGain(gain=1, stages=1))
    assert limits(few)["unexpected-excess-noise"] == found.excess_noise_factor.value
    with raises(CalibrationError, "the gain, 0.01, is below 1"):
        _ = measure_em_gain(found.multiplied, found.unity).section


@pytest.mark.smoke("emgain")
def test_command(tmp_path: Path, capsys: Any) -> None:
    register = SENSOR.with_(em_gain={"gain": 100.0, "stages": 300})
    for folder, camera, longest_s in (("unity", SENSOR, 0.3), ("gain", register, 3e-4)):
        (tmp_path / folder).mkdir()
        for number, (kind, t, dn) in enumerate(simulated(camera, longest_s, 3, frames=4)):
            raw = ps.RawFrame(dn, 16, black_level_dn=200, exposure_s=t)
            raw.save(tmp_path / folder / f"{kind}_{number}.tif")
    SENSOR.with_(em_gain={"gain": 1, "stages": 300, "clock_induced_charge_e": 0.01}).save(tmp_path / "nominal.yaml")
    names = [str(tmp_path / name) for name in ("unity", "gain", "nominal.yaml", "emccd.sensor.yaml", "em.html")]
    assert run(["emgain", *names[:2], "--sensor", names[2], "-o", names[3], "--report", names[4]]) == 0
    assert "with 300 stages" in Path(names[4]).read_text(encoding="utf-8")
    assert "excess noise factor" in capsys.readouterr().out
    sensor = ps.load_sensor(names[3])
    assert sensor.effects is not None
    found = sensor.effects.em_gain
    assert found is not None
    assert found.gain.value == pytest.approx(100, abs=4 * found.gain.standard_uncertainty)
    assert 0 < found.gain.standard_uncertainty < 3
    assert (found.stages, found.clock_induced_charge_e) == (300, 0.01)
    assert sensor.system_gain_dn_per_e == pytest.approx(0.1, rel=0.05)
