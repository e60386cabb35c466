"""Values that no device has are refused by their field's unit."""

from __future__ import annotations

import pytest

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.sensor.io.sensor_file import dump_sensor, parse_sensor
from photosite.sensor.model import Sensor
from photosite.values.limits import LIMITS

SENSOR = ps.load_sensor("nikon-d200")


@pytest.mark.parametrize("value", [1e300, 5e-324, 65_536.0])
def test_a_width_that_no_pixel_has(value: float) -> None:
    with pytest.raises(InputError) as caught:
        SENSOR.with_(width_um=value)
    assert (caught.value.what, caught.value.value) == ("width_um", value)


def test_the_error_of_a_file_names_the_line() -> None:
    text = dump_sensor(SENSOR).replace("width_um: ", "width_um: 1e300 #", 1)
    with pytest.raises(FileError) as caught:
        parse_sensor(text, "a.yaml")
    assert "width_um" in text.splitlines()[caught.value.line - 1]


def test_tables_and_uncertainties_are_checked() -> None:
    with pytest.raises(InputError):
        SENSOR.with_(channels={"M": {"wavelength_nm": [400, 1e9], "quantum_efficiency": [0.5, 0.5]}}, cfa="mono")
    with pytest.raises(InputError):
        SENSOR.with_(read_noise_e=ps.Measured(3.0, 1e200))


def test_every_numeric_field_of_a_sensor_file_has_limits_or_states_why_not() -> None:
    """Units without limits have bounds of their own, or no numbers."""
    bounded = {"none", "that of the field", "bit", "bits", "pixels", "rows"}
    units = set()

    def collect(schema: object) -> None:
        if isinstance(schema, dict):
            if isinstance(unit := schema.get("unit"), str):
                units.add(unit)
            for entry in schema.values():
                collect(entry)
        elif isinstance(schema, list):
            for entry in schema:
                collect(entry)

    collect(Sensor.model_json_schema())
    assert {"um", "e-", "uV/e-"} <= units
    assert units <= bounded | set(LIMITS)
