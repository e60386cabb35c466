"""The form has a field for every parameter of a sensor that frames depend on, with a valid example for each part."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from photosite.app.form import FormField, form
from photosite.app.state import CameraState, Places, SceneState, SensorState, bench, changed_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.optical_stack import OpticalStack
from photosite.sensor.sections import SECTIONS

NOT_IN_FRAMES = {"photosite_sensor", "name", "provenance", "covariance"}
CHOSEN_ELSEWHERE = {"gain_setting", "gain_settings", "gain_setting_is_iso", "maps"}
IN_ELECTRONS = {"read_noise_mv", "row_noise_mv", "column_noise_mv", "dsnu_mv", "dark_voltage_mv_per_s"}


def fields_of(sensor: str) -> list[FormField]:
    return [field for group in form(SensorState(source=sensor), "macbeth", Places()).sensor for field in group.fields]


def all_of(field: FormField) -> Iterator[FormField]:
    yield field
    for part in field.fields:
        yield from all_of(part)


def test_every_parameter_of_a_sensor_is_on_the_form() -> None:
    shown = {field.name: field for field in fields_of("nikon-d200")}
    for section, (model, _) in SECTIONS.items():
        missing = set(model.model_fields) - set(shown) - IN_ELECTRONS
        assert not missing, section
    assert {"rows", "cols", "cfa", "stacked", *OpticalStack.model_fields} <= shown.keys()
    others = set(Sensor.model_fields) - {*SECTIONS, "array", "optical_stack", "effects"}
    assert others - shown.keys() == NOT_IN_FRAMES | CHOSEN_ELSEWHERE
    for field in shown.values():
        for part in all_of(field):
            assert part.kind not in ("section", "list", "entries", "table") or part.fields, part.name


@pytest.mark.parametrize("sensor", ["nikon-d200", "sony-imx174"])
def test_every_part_that_is_switched_on_is_a_valid_sensor_with_the_values_of_its_example(sensor: str) -> None:
    parts = [field for field in fields_of(sensor) if field.optional and field.fields]
    assert len(parts) > 20
    for field in parts:
        changes = {"rows": 300, "cols": 300, field.name: field.example}
        changed = changed_sensor(SensorState(source=sensor, changes=changes), Places())
        owners = [changed, changed.optical_stack, changed.effects]
        assert any(getattr(owner, field.name, None) is not None for owner in owners), field.name


def test_the_values_of_the_form_make_the_same_sensor() -> None:
    """Each part of a sensor that is sent back as the form shows it leaves the sensor as it is."""
    for source in ("nikon-d200", "dual-gain-phone", "split-pixel-automotive"):
        own = changed_sensor(SensorState(source=source), Places())
        for field in fields_of(source):
            if field.fields and field.value is not None:
                again = changed_sensor(SensorState(source=source, changes={field.name: field.value}), Places())
                assert again == own, field.name


def test_flicker_and_motion_are_on_the_form_and_valid_with_their_example() -> None:
    (light, *_) = form(SensorState(), "macbeth", Places()).scene
    examples = {field.name: field.example for field in light.fields if field.fields}
    assert set(examples) == {"flicker", "motion"}
    found = bench(CameraState(scene=SceneState(**examples)), Places())
    scene = found.seen(found.scene())
    assert (scene.flicker.frequency_hz, scene.motion.cols_per_s) == (100.0, 100.0)
