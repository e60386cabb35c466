"""`photosite temperature`: the doubling temperature of hidden frames, in the report and in the sensor file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps

SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=30, cols=40, black_level_dn=64, dark_current_e_per_s=40, dark_current_temperature_c=25, dark_doubling_c=6.5
)
CAMERA = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), SENSOR)


@pytest.fixture(scope="module")
def darks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames of three temperatures, within 0.4 deg C each, in one folder; and the sensor file to complete."""
    folder = tmp_path_factory.mktemp("series")
    (folder / "darks").mkdir()
    nominal = SENSOR.with_(dark_doubling_c=None, dark_current_temperature_c=None, dark_current_e_per_s=0)
    nominal.save(folder / "nominal.sensor.yaml")
    for celsius in (15.0, 25.0, 35.0):
        for time_s in (0.01, 5.0):
            for n in range(4):
                at = {"temperature_c": celsius + 0.1 * n, "seed": int(celsius), "frame": n}
                raw = CAMERA.expose(np.zeros((30, 40), np.float32), time_s, **at)
                raw.save(folder / "darks" / f"dark_{time_s:g}s_{celsius:g}C_{n}.tif")
    return folder


@pytest.mark.smoke("temperature")
def test_the_sensor_file_is_completed(photosite: Any, darks: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "mine.sensor.yaml", tmp_path / "dark.html"
    done = photosite(
        *("temperature", darks / "darks", "--sensor", darks / "nominal.sensor.yaml", "-o", out),
        *("--report", report, "--json"),
    )
    assert (done.status, done.err) == (0, "")
    low, high = done.json["doubling_c"]["interval_95"]
    assert low < 6.5 < high < low + 1.0
    assert [round(one["temperature_c"], 2) for one in done.json["measured"]] == [15.15, 25.15, 35.15]
    noise = ps.load_sensor(out).noise
    assert noise.dark_doubling_c.value == done.json["doubling_c"]["value"]
    assert noise.dark_current_temperature_c == pytest.approx(25.15)
    rate_e = SENSOR.electrons(noise.dark_voltage_mv_per_s.value)
    assert rate_e == pytest.approx(40 * 2 ** (0.15 / 6.5), rel=0.03)
    assert "Doubling temperature" in report.read_text(encoding="utf-8")


def test_exposure_times_that_the_frames_do_not_state(photosite: Any, darks: Path, tmp_path: Path) -> None:
    for raw in (darks / "darks").glob("dark_*"):
        frame = ps.read_raw(raw)
        name = raw.name.replace("dark_5s", "dark_long")
        named = tmp_path / name
        replace(frame, exposure_s=None).save(named) if "long" in name else frame.save(named)
    assert photosite("temperature", tmp_path).status == 2
    done = photosite("temperature", tmp_path, "--exposure", "5", "--json")
    assert (done.status, done.err) == (0, "")
    low, high = done.json["doubling_c"]["interval_95"]
    assert low < 6.5 < high < low + 1.0


def test_stated_temperatures(photosite: Any, darks: Path, tmp_path: Path) -> None:
    # The frames state three temperatures themselves.
    assert photosite("temperature", darks / "darks", "--at", "25").status == 2
    for celsius in (15, 35):
        (tmp_path / str(celsius)).mkdir()
        for frame in (darks / "darks").glob(f"*_{celsius}C_*"):
            frame.rename(tmp_path / str(celsius) / frame.name)
    done = photosite("temperature", tmp_path / "15", tmp_path / "35", "--at", "15,35")
    assert "doubling temperature" in done.out
    assert "take a third" in done.out
    assert photosite("temperature", tmp_path / "15", "--at", "15,35").status == 2
    assert photosite("temperature", tmp_path / "15", "-o", tmp_path / "a.yaml").status == 2
