"""The form has a field for every parameter of a sensor that frames depend on, with a valid example for each part."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from photosite.app.form import FormField, form
from photosite.app.lens_state import LensState, lens
from photosite.app.places import Places
from photosite.app.state import CameraState, SceneState, SensorState, changed_sensor, prepared
from photosite.optics.io.optics_file import (
    KINDS,
    ChromaticFocus,
    DistortionSection,
    Glare,
    LateralColorSection,
    OpticsModel,
    PupilSection,
    RelativeIllumination,
    Transmittance,
    WavefrontSection,
)
from photosite.sensor.model import Sensor
from photosite.sensor.optical_stack import OpticalStack
from photosite.sensor.sections import SECTIONS, GainSetting

NOT_IN_FRAMES = {"photosite_sensor", "name", "provenance", "covariance"}
FILES = {"maps"}
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
    assert others - shown.keys() == NOT_IN_FRAMES | FILES
    settings = {field.name for field in all_of(shown["gain_settings"])}
    assert set(GainSetting.model_fields) - settings - IN_ELECTRONS == {"covariance"}
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
    """Each part of a sensor that is sent back as the form shows it leaves the sensor unchanged."""
    for source in ("nikon-d200", "dual-gain-phone", "split-pixel-automotive"):
        own = changed_sensor(SensorState(source=source), Places())
        for field in fields_of(source):
            if field.fields and field.value is not None and field.name != "gain_settings":
                again = changed_sensor(SensorState(source=source, changes={field.name: field.value}), Places())
                assert again == own, field.name


def test_gain_settings_are_edited_and_one_of_them_is_chosen() -> None:
    own = changed_sensor(SensorState(source="google-pixel-4a"), Places())
    (table,) = (field for field in fields_of("google-pixel-4a") if field.name == "gain_settings")
    again = changed_sensor(
        SensorState(source="google-pixel-4a", gain_setting=440, changes={"gain_settings": table.value}), Places()
    )
    assert again.system_gain_dn_per_e == pytest.approx(own.at_gain_setting(440).system_gain_dn_per_e, rel=1e-9)
    assert again.all_gain_settings == own.all_gain_settings
    faster = [*table.value, table.value[-1] | {"setting": 1760, "analog_gain": 32, "read_noise_e": 4.0}]
    changes = {"gain_settings": faster, "prnu_percent": 2.5}
    changed = changed_sensor(SensorState(source="google-pixel-4a", gain_setting=1760, changes=changes), Places())
    assert changed.readout.analog_gain.value == 32
    assert changed.electrons(changed.noise.read_noise_mv.value) == pytest.approx(4.0)
    assert changed.noise.prnu_percent.value == 2.5
    of_form = form(SensorState(source="google-pixel-4a", gain_setting=1760, changes=changes), "macbeth", Places())
    values = {field.name: field.value for group in of_form.sensor for field in group.fields}
    assert values["analog_gain"] == 32
    assert len(values["gain_settings"]) == 4  # those of the file, so that changes can be marked


LEFT_OUT = {
    OpticsModel: {"photosite_optics", "name", "provenance"},
    RelativeIllumination: {"file", "program"},
    DistortionSection: {"file", "program", "wavelength_nm", "real_height_mm"},
    WavefrontSection: {"kind"},
    PupilSection: {"amplitude", "sha256"},
}
"""Fields of an optics file that are files or belong to one; real_height_mm is another unit of percent."""
OPTICS = {
    "relative_illumination": RelativeIllumination,
    "distortion": DistortionSection,
    "lateral_color": LateralColorSection,
    "veiling_glare": Glare,
    "blur": WavefrontSection,
    "pupil": PupilSection,
    "chromatic_focus": ChromaticFocus,
    "transmittance_table": Transmittance,
}


def test_every_parameter_of_an_optics_file_is_on_the_form() -> None:
    (group,) = form(SensorState(), "macbeth", Places()).lens
    shown = {part.name: part for field in group.fields for part in all_of(field)}
    assert set(OpticsModel.model_fields) - {field.name for field in group.fields} == LEFT_OUT[OpticsModel]
    for name, model in OPTICS.items():
        names = {text for part in all_of(shown[name]) for text in (part.name, *part.choices)}
        assert set(model.model_fields) - names == LEFT_OUT.get(model, set()), name
    of_files = {kind for kind, model in KINDS.items() if {"file", "source"} & model.model_fields.keys()}
    assert KINDS.keys() - of_files == {"diffraction", "wavefront"}


@pytest.mark.parametrize("name", sorted(OPTICS.keys() - {"pupil", "chromatic_focus"}))
def test_every_part_of_a_lens_that_is_switched_on_is_valid(name: str) -> None:
    (group,) = form(SensorState(), "macbeth", Places()).lens
    part = next(field for field in group.fields if field.name == name)
    inner = {field.name: field.example for field in part.fields if field.optional and field.fields}
    choices = next((field.choices for field in part.fields if field.name == "kind"), ("",))
    for kind in choices:
        value = part.example | inner | ({"kind": kind} if kind else {})
        changed = lens(LensState.model_validate({name: value}), Places())
        assert changed is lens(LensState.model_validate({name: value}), Places())  # with the PSF that it keeps
        attribute = {"relative_illumination": "illumination", "transmittance_table": "transmittance"}.get(name, name)
        assert getattr(changed, attribute) not in (None, 1.0)


def test_flicker_and_motion_are_on_the_form_and_valid_with_their_example() -> None:
    (light, *_) = form(SensorState(), "macbeth", Places()).scene
    examples = {field.name: field.example for field in light.fields if field.fields}
    assert set(examples) == {"flicker", "motion"}
    found = prepared(CameraState(scene=SceneState(**examples)), Places())
    scene = found.seen(found.scene())
    assert (scene.flicker.frequency_hz, scene.motion.cols_per_s) == (100.0, 100.0)
