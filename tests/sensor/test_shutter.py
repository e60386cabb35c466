"""The sensor file's section `shutter`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.sensor.io.sensor_file import dump_sensor, load_sensor

D200 = load_sensor("nikon-d200").with_(rows=5, cols=4)


def test_old_files_have_a_global_shutter() -> None:
    assert D200.shutter is None
    assert "shutter" not in dump_sensor(D200)
    assert D200.row_start_s.tolist() == [0.0] * 5


def test_rows_start_one_line_time_apart(tmp_path: Path) -> None:
    rolling = D200.with_(line_time_us={"value": 12.5, "standard_uncertainty": 0.1})
    assert rolling.row_start_s == pytest.approx(12.5e-6 * np.arange(5))
    upward = rolling.with_(direction="bottom_up")
    assert upward.row_start_s == pytest.approx(12.5e-6 * np.arange(5)[::-1])
    assert rolling.with_(shutter={"kind": "global"}).row_start_s.tolist() == [0.0] * 5
    assert rolling.with_(shutter=None) == D200
    upward.save(tmp_path / "mine.sensor.yaml")
    assert load_sensor(tmp_path / "mine.sensor.yaml") == upward


def test_a_rolling_shutter_needs_a_line_time() -> None:
    with raises(InputError, "line_time_us is missing for a rolling shutter", where="shutter"):
        D200.with_(shutter={"kind": "rolling"})
    with raises(InputError, "value", where="shutter.line_time_us"):
        D200.with_(line_time_us=0)
    with raises(InputError, "direction", where="shutter"):
        D200.with_(shutter={"line_time_us": 10, "direction": "left"})
