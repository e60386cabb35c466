"""The sensor file's section `optical_stack`: content and validation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raising import raises

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


def test_round_trip(tmp_path: Path) -> None:
    sensor = D200.with_(optical_stack=STACK)
    sensor.save(tmp_path / "mine.sensor.yaml")
    again = load_sensor(tmp_path / "mine.sensor.yaml")
    assert again == sensor
    stack = again.optical_stack
    assert stack is not None
    assert stack.low_pass_filter is not None
    assert stack.low_pass_filter.split_x_um.standard_uncertainty == 0.2
    assert "cover_glass: 0.92\n" in dump_sensor(sensor)


def test_sensors_without_a_stack() -> None:
    assert D200.optical_stack is None
    assert "optical_stack" not in dump_sensor(D200)
    grid = np.arange(350, 850, 7.0)
    assert (D200.response_at("G", grid) == D200.channels["G"].quantum_efficiency_at(grid)).all()


def test_with_changes_parts_by_name() -> None:
    sensor = D200.with_(cover_glass=0.9)
    other = sensor.with_(cover_glass=0.8, low_pass_filter={"split_y_um": 3})
    assert sensor.response_at("R", [600]) / D200.response_at("R", [600]) == pytest.approx(0.9)
    assert other.response_at("R", [600]) / D200.response_at("R", [600]) == pytest.approx(0.8)
    assert other.with_(cover_glass=None, low_pass_filter=None) == D200
    assert other.with_(optical_stack=None) == D200
    assert other.with_(read_noise_mv=1).optical_stack == other.optical_stack


def test_response_is_transmittance_times_efficiency() -> None:
    sensor = D200.with_(optical_stack=STACK)
    efficiency = D200.channels["R"].quantum_efficiency_at([600.0])[0]
    passed = 0.92 * (0.98 + (600 - 380) / (650 - 380) * (0.9 - 0.98))
    assert sensor.response_at("R", [600.0])[0] == pytest.approx(passed * efficiency, rel=1e-12)
    grid, values = sensor.response("R")
    assert 650.0 in grid
    assert values == pytest.approx(sensor.response_at("R", grid), abs=0)


def angular(angle_deg: list[float], relative_response: Any) -> dict[str, Any]:
    return {"angular_response": {"angle_deg": angle_deg, "relative_response": relative_response}}


def infrared(wavelength_nm: list[float]) -> dict[str, Any]:
    return {"infrared_filter": {"wavelength_nm": wavelength_nm, "transmittance": [1, 0]}}


def optical(kernels: dict[str, Any]) -> dict[str, Any]:
    return {"crosstalk": {"optical": kernels}}


NEGATIVE = [[0, 0, 0], [-0.1, 1.1, 0], [0, 0, 0]]
RESPONSE = "relative_response"
WRONG: list[tuple[dict[str, Any], str]] = [
    ({"cover_glass": 92}, "transmittance[0]"),
    ({"cover_glass": "clear"}, "transmittance"),
    ({"cover_glass": {"transmittance": [0.9, 0.8]}}, "transmittance has 2 entries"),
    (infrared([400, 650]), "wavelength_nm"),
    (infrared([800, 300]), "the entries"),
    (infrared([300]), "transmittance"),
    ({"low_pass_filter": {"split_x_um": -1}}, "value"),
    (angular([0, 30], {"R": [1, 1]}), "the channels G, B are missing"),
    (angular([0, 30], [1, 1, 1]), RESPONSE),
    (angular([0, 30], [0.9, 0.8]), RESPONSE),
    (angular([0, 30], [1, -0.1]), RESPONSE),
    (angular([0, 30], 1), "the table"),
    (angular([5, 30], [1, 1]), "angle_deg"),
    (angular([0, 90], [1, 0]), "angle_deg"),
    (angular([0, 9, 9], [1, 1, 1]), "the entries"),
    ({"crosstalk": {}}, "'optical' and 'electrical' are both missing"),
    (optical({"R": PLUS, "G": PLUS, "X": PLUS}), "unknown channel 'X'"),
    ({"crosstalk": {"electrical": {"R": PLUS}}}, "the channels G, B are missing"),
    (optical({name: [[0.1, 0.9]] for name in "RGB"}), "kernel of R"),
    (optical({"R": [[0] * 801] * 801}), "kernel of R"),
    (optical({"R": [[1], [0, 0], [0] * 5]}), "kernel of R"),
    (optical({name: [[0.99999]] for name in "RGB"}), "sum of the kernel of R"),
    (optical(dict.fromkeys("RGB", NEGATIVE)), "kernel of R"),
    (optical(dict.fromkeys("RGB", PLUS)) | {"rows": 1}, "the array"),
]


@pytest.mark.parametrize(("changes", "what"), WRONG)
def test_invalid_stacks(changes: dict[str, Any], what: str) -> None:
    with raises(InputError, what) as caught:
        D200.with_(**changes)
    assert "optical_stack" in str(caught.value)


@pytest.mark.parametrize(
    ("lines", "what", "where", "line"),
    [
        (["  cover_glas: 0.9"], "unknown field 'cover_glas'", "optical_stack", 1),
        (["  crosstalk:", "    opticl: {}"], "unknown field 'opticl'", "optical_stack.crosstalk", 2),
        (["  angular_response:", "    angle_deg: [0, 20]"], "field 'relative_response' is missing", None, 1),
        (["  cover_glass: {value: 0.9}"], "unknown field 'value'", "optical_stack.cover_glass", 1),
        (["  infrared_filter:", "    transmittance: [1, 1]"], "transmittance has 2 entries", None, 1),
    ],
)
def test_errors_have_section_and_line(lines: list[str], what: str, where: str | None, line: int) -> None:
    text = [*dump_sensor(D200).splitlines(), "optical_stack:", *lines]
    with raises(FileError, what, line=len(text) - len(lines) + line) as caught:
        parse_sensor("\n".join(text), "mine.yaml")
    assert where is None or caught.value.where == where


def test_filters_must_cover_the_response() -> None:
    """The filter must cover the response from the last 0 before to the first 0 after it."""
    channel = {"wavelength_nm": [400, 490, 550, 610, 700], "quantum_efficiency": [0, 0, 0.5, 0, 0]}
    sensor = D200.with_(cfa="mono", channels={"M": channel})
    enough = {"wavelength_nm": [490, 610], "transmittance": [0.5, 0.5]}
    assert sensor.with_(infrared_filter=enough).response_at("M", [450, 550, 650]).tolist() == [0, 0.25, 0]
    with raises(InputError, "wavelength_nm", where="optical_stack.infrared_filter"):
        sensor.with_(infrared_filter={**enough, "wavelength_nm": [491, 610]})


def test_schema_of_the_stack() -> None:
    schema = json.loads(json.dumps(Sensor.model_json_schema()))
    assert set(schema["$defs"]["OpticalStack"]["properties"]) == set(STACK)
    number, table = schema["$defs"]["Transmittance"]["anyOf"]
    assert number == {"type": "number", "minimum": 0, "maximum": 1}
    assert table["required"] == ["transmittance"]
    assert "optical_stack" not in schema["required"]


def test_the_documented_stack_is_valid() -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "optical-stack.md").read_text(encoding="utf-8")
    block = page.split("```yaml\n")[1].split("```")[0]
    sensor = parse_sensor(dump_sensor(D200) + block, "page.yaml")
    assert sensor.optical_stack is not None
    assert all(part is not None for _, part in sensor.optical_stack)
