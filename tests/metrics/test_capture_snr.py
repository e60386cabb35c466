"""The signal-to-noise ratio of several captures: closed forms against simulated frames, and dips at transitions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from raising import raises
from scipy.stats import norm

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.snr import signal_at_snr_e
from photosite.sensor.capture_readout import capture_scale, combined, part_sensor
from photosite.sensor.combined_noise import CombinedNoise
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
    "combination": {"dn_per_e": 16, "switch_percent": 70, "blend_percent": 40, "black_level_dn": 64},
}
STAGGERED = {
    "parts": [
        {"name": "long"},
        {"name": "middle", "relative_exposure": 0.1},
        {"name": "short", "relative_exposure": 0.01},
    ],
    "combination": {"dn_per_e": 8, "switch_percent": 75, "blend_percent": 20, "black_level_dn": 64},
}
SENSORS = {
    "split": mono("split-pixel-automotive", dcnu_percent=30),
    "dual": mono("dual-gain-phone"),
    "overflow": mono("dual-gain-phone", captures=OVERFLOW),
    "staggered": mono("dual-gain-phone", captures=STAGGERED, prnu_percent=2, dsnu_e=1.5, dark_current_e_per_s=100),
}


FALSE_ALARMS = 1e-3
"""Rate of each Monte Carlo test under the closed forms, over all its levels."""


def spread_of(sensor: ps.Sensor, light_e: float, time_s: float, seed: int) -> tuple[float, float]:
    """Return the variance of a simulated combined frame in electrons of light, and its standard uncertainty."""
    mean = np.full((sensor.array.rows, sensor.array.cols), light_e, np.float32)
    rule = sensor.captures.combination
    dn = combined(sensor, read_captures(sensor, None, mean, time_s, Shot(seed=seed)))
    light = (dn if rule.companding is None else rule.companding.decompand(dn)) / rule.dn_per_e.value
    squares = (light - light.mean()) ** 2
    return float(squares.mean()), float(squares.std() / light.size**0.5)


@pytest.mark.parametrize("name", SENSORS)
def test_the_variance_is_that_of_simulated_combined_frames(name: str) -> None:
    sensor, time_s = SENSORS[name], 0.03
    noise = CombinedNoise(sensor, time_s)
    ends = [each.light_e for each in noise.transitions]
    inside = (end * fraction for end in ends for fraction in (0.93, 0.97, 1.0, 1.03, 1.07))
    light = [1.0, 20.0, *inside, 2.0 * ends[-1], 0.9 * noise.light_capacity_e]
    limit = norm.isf(FALSE_ALARMS / (2 * len(light)))
    for seed, level in enumerate(light):
        variance, uncertainty = spread_of(sensor, level, time_s, seed)
        assert abs(float(noise.variance_e2(level)) - variance) < limit * uncertainty, level


def test_effects_count() -> None:
    sensor = mono("dual-gain-phone", interpixel_capacitance={"coupling_percent": 1.5})
    noise = CombinedNoise(sensor)
    light = (5.0, 0.5 * noise.transitions[0].light_e, 0.5 * noise.light_capacity_e)
    limit = norm.isf(FALSE_ALARMS / (2 * len(light)))
    for seed, level in enumerate(light):
        variance, uncertainty = spread_of(sensor, level, 0.0, seed)
        assert abs(float(noise.variance_e2(level)) - variance) < limit * uncertainty, level


@pytest.mark.parametrize("name", SENSORS)
def test_each_capture_has_its_ratio(name: str) -> None:
    """The standard uncertainty of a ratio from 90 000 pixels is 0.02 dB."""
    sensor = SENSORS[name]
    light = 0.5 * ps.capture_budget(sensor, [1.0]).transitions[0].light_e
    budget = ps.capture_budget(sensor, light)
    frames = read_captures(sensor, None, np.full((300, 300), light, np.float32), 0.0, Shot(seed=1))
    for part, curve in budget.captures_db.items():
        if sensor.captures[part].charge != "overflow":  # nothing overflows yet
            electrons = frames[part] / capture_scale(sensor, part).dn_per_light_e
            assert 20 * np.log10(light / electrons.std()) == pytest.approx(float(curve), abs=0.1), part


def test_closed_forms_by_hand() -> None:
    """A small photodiode of a hundredth: above the last transition, the frame is that photodiode times 100."""
    sensor = SENSORS["split"].with_(dcnu_percent=0, dark_current_e_per_s=0, prnu_percent=1)
    small = {part.name: part for part in sensor.captures.parts}["small"]
    noise, light = CombinedNoise(sensor), 4e5
    part = part_sensor(sensor, "small")
    dsnu_e, rounding_e2 = part.electrons(sensor.noise.dsnu_mv.value), 1 / 12 / part.system_gain_dn_per_e**2
    reading_e2 = small.read_noise_e.value**2 + dsnu_e**2 + rounding_e2
    by_hand = (light / 100 + (0.01 * light / 100) ** 2 + reading_e2) * 100**2
    output_step = sensor.captures.combination.companding.step_dn(light * 16) / 16
    assert float(noise.variance_e2(light)) == pytest.approx(by_hand + output_step**2 / 12, rel=1e-6)
    assert noise.light_capacity_e == pytest.approx(7900 * 100)
    assert np.isnan(noise.snr_db(7.91e5))
    # A frame of 12 bits that saturates before its captures do.
    short = SENSORS["dual"].captures.model_dump() | {"combination": {"dn_per_e": 1.24, "bits": 12}}
    assert CombinedNoise(SENSORS["dual"].with_(captures=short)).light_capacity_e == pytest.approx(4095 / 1.24)


def test_output_that_holds_the_numbers_of_a_capture_adds_no_rounding() -> None:
    """The phone's output has the steps of its first converter: rounding counts once."""
    sensor = SENSORS["dual"]
    gain, rule = sensor.system_gain_dn_per_e, sensor.captures.combination
    assert rule.dn_per_e.value == pytest.approx(gain, rel=1e-3)
    rounding = CombinedNoise(sensor, sources=frozenset({"rounding"}))
    assert float(rounding.variance_e2(1.0)) == pytest.approx(1 / 12 / gain**2)
    assert float(rounding.variance_e2(5000.0)) == pytest.approx(1 / 12 / (gain / 4) ** 2, rel=1e-6)


def test_noise_budget_is_that_of_the_combined_frame() -> None:
    sensor = SENSORS["split"].with_(dcnu_percent=0)
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    light = np.array([100.0, 1e3, 1e4, 1e5, 7e5])
    budget = ps.noise_budget(sensor, light * v_per_e)
    assert budget.total_db == pytest.approx(ps.capture_budget(sensor, light).combined_db, abs=0.02)
    parts = sum(10 ** (-getattr(budget, f"{name}_db") / 10) for name in ("shot", "read", "dsnu", "prnu"))
    assert budget.total_db == pytest.approx(-10 * np.log10(parts), abs=1e-6)
    assert [each.below for each in budget.transitions] == ["large-low", "small"]
    assert "from large-low to small at 1.732e+04 e-" in budget._table().title
    at = CombinedNoise(sensor, sources=frozenset({"read", "dsnu"})).variance_e2(
        budget.dark_limited_below_volts / v_per_e
    )
    assert budget.dark_limited_below_volts / v_per_e == pytest.approx(float(at), rel=0.01)
    light_e = signal_at_snr_e(sensor, 20.0)
    assert float(ps.noise_budget(sensor, light_e * v_per_e).total_db) == pytest.approx(20.0, abs=1e-6)
    with raises(InputError, "snr_db"):
        signal_at_snr_e(sensor, 60.0)


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


def test_plot_over_luminance() -> None:
    sensor = ps.load_sensor("split-pixel-automotive")
    axes = ps.capture_budget(sensor, np.geomspace(10, 1e6, 50)).plot(electrons_per_cd_m2=10.0)
    assert axes.get_xlabel().startswith("luminance")
    assert axes.lines[0].get_xdata()[0] == pytest.approx(1.0)
    assert [text.get_text() for text in axes.texts] == ["16.0 dB"]


def test_rejects_sensors_with_one_capture() -> None:
    with pytest.raises(ps.errors.InputError):
        ps.capture_budget(ps.load_sensor("nikon-d200"), [100.0])
