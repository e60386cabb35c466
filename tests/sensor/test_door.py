"""The sensor file's section `optical_stack`: what it holds, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photosite.errors import FileError, InputError
from photosite.sensor.io.sensor_file import dump_sensor, load_sensor, parse_sensor
from photosite.sensor.model import Sensor

D200 = load_sensor("nikon-d200")
PLUS = [[0, 0.01, 0], [0.01, 0.96, 0.01], [0, 0.01, 0]]
STACK: dict[str, Any] = {
    "infrared_filter": {"wavelength_nm": [380, 650, 780], "transmittance": [0.98, 0.9, 0], "source": "data sheet"},
    "cover_glass": 0.92,
    "low_pass_filter": {"split_x_um": {"value": 6, "standard_uncertainty": 0.2}},
    "angular_response": {"angle_deg": [0, 30], "relative_response": {"R": [1, 0.7], "G": [1, 0.6], "B": [1, 0.5]}},
    "crosstalk": {"optical": dict.fromkeys("RGB", PLUS), "electrical": {name: [[1]] for name in "RGB"}},
}


def test_a_file_with_a_stack_comes_back_as_it_was(tmp_path: Path) -> None:
    sensor = D200.with_(optical_stack=STACK)
    sensor.save(tmp_path / "mine.sensor.yaml")
    again = load_sensor(tmp_path / "mine.sensor.yaml")
    assert again == sensor
    stack = again.optical_stack
    assert stack is not None
    assert stack.low_pass_filter is not None
    assert stack.low_pass_filter.split_x_um.standard_uncertainty == 0.2
    assert "cover_glass: 0.92\n" in dump_sensor(sensor)


def test_sensors_without_a_stack_stay_as_they_are() -> None:
    assert D200.optical_stack is None
    assert "optical_stack" not in dump_sensor(D200)
    grid = np.arange(350, 850, 7.0)
    assert (D200.response_at("G", grid) == D200.channels["G"].quantum_efficiency_at(grid)).all()


def test_parts_are_changed_by_name() -> None:
    sensor = D200.with_(cover_glass=0.9)
    other = sensor.with_(cover_glass=0.8, low_pass_filter={"split_y_um": 3})
    assert sensor.response_at("R", [600]) / D200.response_at("R", [600]) == pytest.approx(0.9)
    assert other.response_at("R", [600]) / D200.response_at("R", [600]) == pytest.approx(0.8)
    assert other.with_(cover_glass=None, low_pass_filter=None) == D200
    assert other.with_(optical_stack=None) == D200
    assert other.with_(read_noise_mv=1).optical_stack == other.optical_stack


def test_response_is_what_the_filters_pass_times_the_efficiency() -> None:
    sensor = D200.with_(optical_stack=STACK)
    efficiency = D200.channels["R"].quantum_efficiency_at([600.0])[0]
    passed = 0.92 * (0.98 + (600 - 380) / (650 - 380) * (0.9 - 0.98))
    assert sensor.response_at("R", [600.0])[0] == pytest.approx(passed * efficiency, rel=1e-12)
    grid, values = sensor.response("R")
    assert 650.0 in grid
    assert values == pytest.approx(sensor.response_at("R", grid), abs=0)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"cover_glass": 92}, "transmittance is a fraction, 0 to 1, not 92; percent are divided by 100"),
    ({"cover_glass": "clear"}, "cover_glass: a number, 0 to 1, or wavelength_nm and transmittance"),
    ({"cover_glass": {"transmittance": [0.9, 0.8]}}, "has 2 numbers and no wavelength_nm"),
    ({"infrared_filter": {"wavelength_nm": [400, 650], "transmittance": [1, 0]}}, "channel R responds from 380 to 780"),
    ({"infrared_filter": {"wavelength_nm": [800, 300], "transmittance": [1, 0]}}, "wavelength_nm must increase"),
    ({"infrared_filter": {"wavelength_nm": [300], "transmittance": [1, 0]}}, "1 wavelengths, 2 transmittances"),
    ({"low_pass_filter": {"split_x_um": -1}}, "low_pass_filter.split_x_um: must be at least 0, not -1"),
    ({"angular_response": {"angle_deg": [0, 30], "relative_response": {"R": [1, 1]}}}, "lacks G, B"),
    ({"angular_response": {"angle_deg": [0, 30], "relative_response": [1, 1, 1]}}, "one number per angle: 2, not 3"),
    ({"angular_response": {"angle_deg": [0, 30], "relative_response": [0.9, 0.8]}}, "must be 1 at 0 degrees"),
    ({"angular_response": {"angle_deg": [0, 30], "relative_response": [1, -0.1]}}, "must be 0 or more"),
    ({"angular_response": {"angle_deg": [0, 30], "relative_response": 1}}, "must be a list of numbers, one per angle"),
    ({"angular_response": {"angle_deg": [5, 30], "relative_response": [1, 1]}}, "from 0, the axis, to below 90"),
    ({"angular_response": {"angle_deg": [0, 90], "relative_response": [1, 0]}}, "from 0, the axis, to below 90"),
    ({"angular_response": {"angle_deg": [0, 9, 9], "relative_response": [1, 1, 1]}}, "angle_deg must increase"),
    ({"crosstalk": {}}, "give 'optical' or 'electrical'"),
    ({"crosstalk": {"optical": {"R": PLUS, "G": PLUS, "X": PLUS}}}, "crosstalk.optical has 'X'; known are: R, G, B"),
    ({"crosstalk": {"electrical": {"R": PLUS}}}, "crosstalk.electrical lacks G, B; give every channel its own"),
    ({"crosstalk": {"optical": {name: [[0.1, 0.9]] for name in "RGB"}}}, "must be square and odd"),
    ({"crosstalk": {"optical": {"R": [[0] * 801] * 801}}}, r"from 1 x 1 to 9 x 9, not 801 rows of 801"),
    ({"crosstalk": {"optical": {"R": [[1], [0, 0], [0] * 5]}}}, r"9 x 9, not 3 rows of 1 to 5"),
    ({"crosstalk": {"optical": {name: [[0.99999]] for name in "RGB"}}}, "must sum to 1"),
    ({"crosstalk": {"optical": {name: [[0, 0, 0], [-0.1, 1.1, 0], [0, 0, 0]] for name in "RGB"}}}, "one is -0.1"),
    ({"crosstalk": {"optical": dict.fromkeys("RGB", PLUS)}, "rows": 1}, "one whole tile or more, 2 x 2 pixels"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_wrong_stacks_are_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        D200.with_(**changes)
    assert message in str(caught.value)
    assert "optical_stack" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("lines", "message", "line"),
    [
        (["  cover_glas: 0.9"], "unknown field 'cover_glas' in optical_stack; did you mean 'cover_glass'", 1),
        (["  crosstalk:", "    opticl: {}"], "unknown field 'opticl' in optical_stack.crosstalk; did you mean", 2),
        (["  angular_response:", "    angle_deg: [0, 20]"], "'relative_response' is missing from optical_stack", 1),
        (["  cover_glass: {value: 0.9}"], "unknown field 'value' in optical_stack.cover_glass", 1),
        (["  infrared_filter:", "    transmittance: [1, 2]"], "has 2 numbers and no wavelength_nm", 1),
    ],
)
def test_wrong_files_say_where(lines: list[str], message: str, line: int) -> None:
    text = [*dump_sensor(D200).splitlines(), "optical_stack:", *lines]
    with pytest.raises(FileError) as caught:
        parse_sensor("\n".join(text), "mine.yaml")
    assert message in str(caught.value)
    assert caught.value.line == len(text) - len(lines) + line


def test_tables_end_only_where_nothing_responds() -> None:
    """A channel that responds from 500 to 600 nm, between zeros: the filter is asked for between these."""
    channel = {"wavelength_nm": [400, 490, 550, 610, 700], "quantum_efficiency": [0, 0, 0.5, 0, 0]}
    sensor = D200.with_(cfa="mono", channels={"M": channel})
    enough = {"wavelength_nm": [490, 610], "transmittance": [0.5, 0.5]}
    assert sensor.with_(infrared_filter=enough).response_at("M", [450, 550, 650]).tolist() == [0, 0.25, 0]
    with pytest.raises(InputError, match="channel M responds from 490 to 610 nm"):
        sensor.with_(infrared_filter={**enough, "wavelength_nm": [491, 610]})


def test_the_schema_has_the_stack() -> None:
    schema = json.loads(json.dumps(Sensor.model_json_schema()))
    assert set(schema["$defs"]["OpticalStack"]["properties"]) == set(STACK)
    number, table = schema["$defs"]["Transmittance"]["anyOf"]
    assert number == {"type": "number", "minimum": 0, "maximum": 1}
    assert table["required"] == ["transmittance"]
    assert "optical_stack" not in schema["required"]


def test_the_documented_stack_is_a_stack() -> None:
    page = (Path(__file__).parents[2] / "docs" / "optical-stack.md").read_text(encoding="utf-8")
    block = page.split("```yaml\n")[1].split("```")[0]
    sensor = parse_sensor(dump_sensor(D200) + block, "page.yaml")
    assert sensor.optical_stack is not None
    assert all(part is not None for _, part in sensor.optical_stack)
