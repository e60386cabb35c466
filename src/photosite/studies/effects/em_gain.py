"""Electron multiplication, measured with two calibrations in the same light."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from photosite.calibration.effects.em_gain import measure_em_gain
from photosite.calibration.setting import calibrate_setting
from photosite.sensor.effects.em_gain import EmGain
from photosite.studies.effect_study import Drawing, EffectStudy, Range
from photosite.studies.outcome import Outcomes, compare_estimates
from photosite.studies.protocol import ShootingProtocol
from photosite.studies.virtual_lab import VirtualLab
from photosite.values.uncertain import Measured


def _draw(drawing: Drawing, gain: Range) -> dict[str, Any]:
    return {"em_gain": {"gain": drawing.between(*gain), "stages": int(drawing.rng.integers(100, 600))}}


def _measure(lab: VirtualLab) -> tuple[Outcomes, tuple[str, ...]]:
    """Calibrate without the register, and with it at exposure times that are shorter by its gain."""
    sensor, protocol = lab.camera.sensor, lab.protocol
    register: EmGain = sensor.effects.em_gain  # type: ignore[assignment, union-attr]
    steps = tuple(replace(step, exposure_s=step.exposure_s / register.gain.value) for step in protocol.steps)
    plain = replace(lab, camera=replace(lab.camera, sensor=sensor.with_(em_gain=None)))
    multiplied = replace(lab, protocol=ShootingProtocol(protocol.name, steps), seed=lab.seed + (1 << 20))
    unity, measured = (calibrate_setting(each.frame_set()) for each in (plain, multiplied))
    stated = EmGain(gain=Measured(1.0), stages=register.stages)
    found = measure_em_gain(unity, measured, stated)
    estimates = {name: getattr(found, name) for name in ("gain", "excess_noise_factor")}
    truth = {"gain": register.gain.value, "excess_noise_factor": register.excess_noise_factor}
    return compare_estimates(estimates, truth), (*unity.warnings, *found.warnings)


STUDY = EffectStudy(draw=_draw, measure=_measure, planned=False)
