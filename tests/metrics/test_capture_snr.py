"""The signal-to-noise ratio of several captures: closed forms against simulated frames, and dips at transitions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.sensor.capture_readout import capture_scale, combined
from photosite.sensor.readout import read_captures
from photosite.sensor.shot import Shot


def mono(name: str, **changes: Any) -> ps.Sensor:
    preset = ps.load_sensor(name)
    data = preset.model_dump() | {"channels": {"M": preset.channels["G"].model_dump()}}
    data["array"] = {"rows": 300, "cols": 300}
    return ps.Sensor.model_validate(data).with_(**changes)


OVERFLOW = {
    "parts": [
        {"name": "well", "well_capacity_e": 3000},
        {
            "name": "capacitor",
            "charge": "overflow",
            "charge_of": "well",
            "well_capacity_e": 60000,
            "relative_gain": 0.2,
        },
    ],
    "combination": {"dn_per_e": 4, "switch_percent": 70, "blend_percent": 40},
}
SENSORS = {
    "split": mono("split-pixel-automotive", dcnu_percent=30),
    "dual": mono("dual-gain-phone"),
    "overflow": mono("dual-gain-phone", captures=OVERFLOW),
}


@pytest.mark.parametrize("name", SENSORS)
def test_closed_forms_agree_with_captures(name: str) -> None:
    """The standard uncertainty of a ratio from 90 000 pixels is 0.02 dB."""
    sensor, time_s = SENSORS[name], 0.03
    budget = ps.capture_budget(sensor, [1.0], time_s)
    ends = [each.light_e for each in budget.transitions]
    light = np.array(
        [20.0, *(end * fraction for end in ends for fraction in (0.93, 0.97, 1.0, 1.03, 1.07)), ends[-1] * 2]
    )
    budget = ps.capture_budget(sensor, light, time_s)
    black = sensor.readout.black_level_dn.value
    rule = sensor.captures.combination
    for index, level in enumerate(light):
        mean = np.full((300, 300), level, np.float32)
        frames = read_captures(sensor, None, mean, time_s, Shot(seed=index))
        for part, curve in budget.captures_db.items():
            scale = capture_scale(sensor, part)
            if np.isnan(curve[index]) or (part == "capacitor"):
                continue
            spread = (frames[part] - black).std() / scale.dn_per_light_e
            assert 20 * np.log10(level / spread) == pytest.approx(curve[index], abs=0.1), (part, level)
        dn = combined(sensor, frames)
        linear = dn if rule.companding is None else rule.companding.decompand(dn)
        spread = linear.std() / rule.dn_per_e.value
        assert 20 * np.log10(level / spread) == pytest.approx(budget.combined_db[index], abs=0.1), level


def test_dips_at_transitions() -> None:
    budget = ps.capture_budget(SENSORS["split"], np.geomspace(1, 5e5, 800))
    first, second = budget.transitions
    assert (first.above, first.below, second.below) == ("large-high", "large-low", "small")
    assert first.light_e == pytest.approx(0.8 * 4031 / 4096 * 1.078 / 200e-6)
    # Shot noise is common to both gains; the small photodiode has 1 % of the electrons.
    assert 0 < first.before_db - first.after_db < 0.1
    assert second.before_db - second.after_db > 10
    at = np.searchsorted(budget.light_e, second.light_e)
    assert budget.combined_db[at - 20] - budget.combined_db[at + 20] > 10
    assert np.isnan(ps.capture_budget(SENSORS["split"], [8e5]).combined_db).all()
    assert "dips" in repr(budget)


def test_plot_over_luminance_and_one_noise_budget() -> None:
    sensor = ps.load_sensor("split-pixel-automotive")
    axes = ps.capture_budget(sensor, np.geomspace(10, 1e6, 50)).plot(electrons_per_cd_m2=10.0)
    assert axes.get_xlabel().startswith("luminance")
    assert axes.lines[0].get_xdata()[0] == pytest.approx(1.0)
    assert [text.get_text() for text in axes.texts] == ["16.0 dB"]
    with raises(InputError, "captures"):
        ps.noise_budget(sensor, [0.1])


def test_rejects_sensors_with_one_capture() -> None:
    with pytest.raises(ps.errors.InputError):
        ps.capture_budget(ps.load_sensor("nikon-d200"), [100.0])
