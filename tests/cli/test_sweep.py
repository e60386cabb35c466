"""`photosite sweep`: the table, the figure, errors with lines, and the same table after interruptions."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import photosite as ps

TEXT = """photosite_sweep: 1
name: pixels
camera: {sensor: vendor-2.2um, optics: {f_number: 2.8, focal_length_mm: 4}}
values:
  pixel_width_um: [1.1, 2.2]
  f_number: [2, 4]
measure: {snr: {luminance_cd_m2: 20, exposure: 1/15}}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "a.sweep.yaml").write_text(TEXT)
    return tmp_path / "a.sweep.yaml"


@pytest.mark.smoke("sweep")
def test_the_table_is_that_of_the_library(photosite: Any, file: Path, tmp_path: Path) -> None:
    done = photosite("sweep", file, "-o", tmp_path / "a.csv", "--figure", tmp_path / "a.png", "--json")
    assert done.status == 0
    camera = ps.Camera(ps.DiffractionLimited(2.8, 4), ps.load_sensor("vendor-2.2um"))
    expected = [
        [width, number, *ps.studies.snr(changed, luminance_cd_m2=20, exposure_s=1 / 15).values()]
        for width in (1.1, 2.2)
        for number in (2, 4)
        for changed in [ps.Camera(ps.DiffractionLimited(number, 4), camera.sensor.with_pixel_width(width))]
    ]
    assert done.json["name"] == "pixels"
    assert done.json["rows"] == expected
    with (tmp_path / "a.csv").open() as stream:
        names, *rows = csv.reader(stream)
    assert names == ["pixel_width_um", "f_number", "signal_e", "noise_e", "snr_db"]
    assert [[float(cell) for cell in row] for row in rows] == expected
    assert (tmp_path / "a.png").stat().st_size > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.png", "a.sweep.yaml"]
    assert photosite("sweep", file, "-o", tmp_path / "a.csv").status == 2


def test_a_cell_without_a_number_is_empty(photosite: Any, file: Path, tmp_path: Path) -> None:
    file.write_text(TEXT.replace("20", "1e6"))
    done = photosite("sweep", file, "-o", tmp_path / "a.csv", "--json")
    assert {row[-1] for row in done.json["rows"]} == {None}
    assert (tmp_path / "a.csv").read_text().splitlines()[1].endswith(",")


def test_figures_of_sensors_and_scenes(photosite: Any, file: Path) -> None:
    file.write_text(TEXT[: TEXT.index("measure")] + "measure: sensor_figures\n")
    found = photosite("sweep", file, "--json").json
    figures = ps.studies.compare_sensors({"a": ps.load_sensor("vendor-2.2um")}, f_number=2).sensors["a"]
    row = dict(zip(found["measured"], found["rows"][2][2:], strict=True))
    assert row["snr10_lux"] == pytest.approx(figures.snr10_lux, rel=1e-3)
    text = TEXT.replace("  f_number: [2, 4]", "  mean_luminance_cd_m2: [10, 20]").replace("luminance_cd_m2: 20, ", "")
    file.write_text(text + "scene: {source: macbeth, illuminant: A}\n")
    rows = photosite("sweep", file, "--json").json["rows"]
    assert rows[1][2] / rows[0][2] == pytest.approx(2)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("f_number: [2, 4]", "f_number: [2, 0.1]", ":6: f_number = 0.1: f_number must be"),
        ("pixel_width_um", "pixel_width", ":5: field must be a field of sensor, lens or scene"),
        ("snr:", "snrr:", ":7: measure: unknown field 'snrr'. Did you mean 'snr'?"),
        ("1/15", "-1", ":7: measure.snr.exposure"),
        ("[1.1, 2.2]", "[]", ":5: "),
        ("vendor-2.2um", "vendor", ":3: sensor must be a preset"),
        ("cd_m2: 20", "cd_m2: 20, illuminant: X9", ":7: illuminant must be a known name"),
        ("cd_m2: 20", "cd_m2: 20, illuminant: lamp.csv", "/lamp.csv: there is no such file"),
        ("f_number: [2", "distance_m: [2", ":6: field must be"),
        ("photosite_sweep", "photosite_camera", "is a camera file, not a sweep file"),
        ("measure: {", "scene: macbeth\nmeasure: {", ":8: measure: luminance_cd_m2 does not apply with a scene"),
        ("measure: {", "scene: {source: macbet}\nmeasure: {", ":7: scene: source must be"),
    ],
)
def test_errors_have_the_line(photosite: Any, file: Path, tmp_path: Path, old: str, new: str, said: str) -> None:
    file.write_text(TEXT.replace(old, new))
    done = photosite("sweep", file, "-o", tmp_path / "a.csv")
    assert (done.status, done.out, done.err.count("\n")) == (2, "", 1)
    assert said in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.sweep.yaml"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--x", "f_number"], "--figure"),
        (["--figure", "a.png", "--x", "snr_db"], "--x must be a field"),
        (["--figure", "a.png", "--y", "f_number"], "--y must be one of signal_e, noise_e, snr_db"),
    ],
)
def test_errors_of_figures(
    photosite: Any, file: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], said: str
) -> None:
    monkeypatch.chdir(file.parent)
    done = photosite("sweep", file, *options)
    assert (done.status, done.out) == (2, "")
    assert said in done.err
    assert not Path("a.png").exists()


@pytest.mark.slow
def test_a_sweep_whose_scheduler_is_lost_is_resumed(photosite: Any, file: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    widths = ", ".join(f"{1 + k / 1000}" for k in range(1000))
    file.write_text(TEXT.replace("1.1, 2.2", widths))
    scheduler_file, results = tmp_path / "scheduler.json", tmp_path / "a.csv.partial" / "results.jsonl"
    programs = [
        ("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", scheduler_file),
        ("worker", "--scheduler-file", scheduler_file, "--nthreads", "1", "--no-nanny"),
    ]
    started = []
    try:
        for name, *call in programs:
            program = [sys.executable, "-m", f"distributed.cli.dask_{name}", "--no-dashboard", *map(str, call)]
            started.append(subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            while not scheduler_file.exists():
                time.sleep(0.05)

        def kill() -> None:
            while not (results.exists() and results.read_bytes().count(b"\n") > 20):
                time.sleep(0.01)
            started[0].kill()

        address = json.loads(scheduler_file.read_text())["address"]
        threading.Thread(target=kill, daemon=True).start()
        done = photosite("sweep", file, "-o", tmp_path / "a.csv", "--dask", address)
    finally:
        for process in started:
            process.kill()
            process.wait()
    last = done.err.rstrip("\n").replace("\r", "\n").splitlines()[-1]
    assert (done.status, done.out) == (2, "")
    assert last.startswith(f"photosite: {address}: the scheduler was lost")
    assert "distributed" not in done.err
    assert not (tmp_path / "a.csv").exists()
    assert 20 < results.read_bytes().count(b"\n") < 2000
    assert photosite("sweep", file, "-o", tmp_path / "a.csv").status == 0
    assert photosite("sweep", file, "-o", tmp_path / "b.csv").status == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert not results.parent.exists()


def test_processes_do_not_apply_to_a_scheduler(photosite: Any, file: Path, tmp_path: Path) -> None:
    for options in (["--processes", 1, "--dask", "nowhere"], ["--dask", "nowhere", "--processes", 2]):
        done = photosite("sweep", file, "-o", tmp_path / "a.csv", *options)
        assert (done.status, done.out, done.err.count("\n")) == (2, "", 1)
        assert "--processes" in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.sweep.yaml"]


def test_an_address_without_a_scheduler_leaves_nothing_behind(photosite: Any, file: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    done = photosite("sweep", file, "-o", tmp_path / "a.csv", "--dask", "nowhere")
    assert (done.status, done.err.count("\n")) == (2, 1)
    assert "--dask" in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.sweep.yaml"]
