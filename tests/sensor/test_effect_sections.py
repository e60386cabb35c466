"""What the sections of effects state about themselves is true of frames, and reaches sensors, studies and budgets."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.effects.model import Effects
from photosite.sensor.noise_terms import NoiseTerms
from photosite.sensor.readout import digital_numbers
from photosite.studies.virtual_lab import nominal_sensor

SENSOR = ps.load_sensor("nikon-d200").with_(rows=40, cols=48, black_level_dn=64)
EXAMPLES = {name: field.examples[0] for name, field in Effects.model_fields.items() if field.examples}
CAPTURES = {"parts": [{"name": "a"}, {"name": "b", "relative_sensitivity": 0.1}], "combination": {"dn_per_e": 1}}


@pytest.mark.parametrize("name", EXAMPLES)
def test_effects_that_change_the_response_say_so(name: str) -> None:
    sensor = SENSOR.with_(**{name: EXAMPLES[name]})
    light = np.full((40, 48), 0.6 * SENSOR.saturation_capacity_e, np.float32)
    change = clean_numbers(sensor, light)[20, 24] / clean_numbers(SENSOR, light)[20, 24] - 1.0
    assert (abs(change) > 1e-3) == sensor.effects.stated[name].changes_response  # type: ignore[union-attr]


@pytest.mark.parametrize("name", EXAMPLES)
def test_several_captures_exclude_effects_of_single_ones(name: str) -> None:
    changes = {name: EXAMPLES[name]}
    if SENSOR.with_(**changes).effects.stated[name].of_single_captures:  # type: ignore[union-attr]
        with raises(InputError, f"effects.{name} and captures are both given"):
            SENSOR.with_(captures=CAPTURES, **changes)
    else:
        dark = np.zeros((40, 48), np.float32)
        assert digital_numbers(SENSOR.with_(captures=CAPTURES, **changes), dark, 0.1).shape == (40, 48)


def test_effects_of_the_register_and_the_output_exclude_captures() -> None:
    every = Effects(**{name: EXAMPLES[name] for name in EXAMPLES if name != "response_curve"})
    assert every.of_single_captures == ["blooming", "charge_transfer", "em_gain", "output"]


def test_nominal_sensors_have_lines_without_light_and_the_corner_of_the_output() -> None:
    transfer = {"parallel_inefficiency": 1e-5, "output": "top_right"}
    sensor = SENSOR.with_(optical_black={"left": 8}, charge_transfer=transfer, glow=EXAMPLES["glow"])
    assert nominal_sensor(sensor).effects == Effects(optical_black={"left": 8}, charge_transfer={"output": "top_right"})
    assert nominal_sensor(SENSOR.with_(glow=EXAMPLES["glow"])).effects is None


def test_variances_of_channels_and_lines_are_in_the_budget() -> None:
    channels = {"relative_gain": [[1.02, 0.98]], "offset_e": [[30, -30]]}
    lines = {"row_offset_e": 3, "column_offset_e": 4, "column_gain_percent": 1}
    plain, both = NoiseTerms(SENSOR), NoiseTerms(SENSOR.with_(readout_channels=channels, line_pattern=lines))
    assert both.dsnu_e2 - plain.dsnu_e2 == pytest.approx(900 + 25)
    assert both.prnu2 - plain.prnu2 == pytest.approx(4e-4 + 1e-4)
