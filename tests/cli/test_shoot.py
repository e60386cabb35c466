"""`photosite shoot`."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from virtual_chips import drawn_maps

import photosite as ps


@pytest.mark.smoke("shoot")
def test_shoots_the_papers_protocol(photosite: Any, tmp_path: Path) -> None:
    done = photosite("shoot", "--rows", 8, "--cols", 12, "-o", tmp_path / "stack", "--json")
    assert done.status == 0
    assert done.json["frames"] == 405
    frames = ps.open_frames(tmp_path / "stack")
    darks, lights = frames.of_kind("dark"), frames.of_kind("light")
    assert [sum(map(len, groups)) for groups in (darks, lights)] == [340, 65]
    assert (darks[0].exposure_s, len(darks[0]), darks[-1].exposure_s) == (1 / 8000, 160, 30)
    assert (lights[0].exposure_s, lights[-1].exposure_s, len(lights)) == (1 / 8000, 1 / 25, 13)
    assert {group.photons_per_pixel for group in frames.groups} == {None}


@pytest.fixture
def without_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the drawing of the frames, for tests of what is said before it."""
    monkeypatch.setattr("photosite.studies.virtual_lab.VirtualLab.write", lambda *arguments, **options: None)


@pytest.mark.usefixtures("without_frames")
def test_a_raised_black_level_gives_a_note(photosite: Any, tmp_path: Path) -> None:
    raised = photosite("shoot", "--rows", 8, "--cols", 12, "-o", tmp_path / "a", "--json")
    assert "black level raised from 0 to 32 DN" in raised.err
    assert raised.json["black_level_dn"] == 32
    assert "--no-pedestal keeps" in raised.err
    as_it_is = photosite("shoot", "--rows", 8, "--cols", 12, "--no-pedestal", "-o", tmp_path / "c", "--json")
    assert (as_it_is.err, as_it_is.json["black_level_dn"]) == ("", 0)
    both = photosite("shoot", "--no-pedestal", "--black-level", 3, "-o", tmp_path / "d")
    assert (both.status, both.err.count("\n")) == (2, 1)
    as_it_is = photosite("shoot", "--rows", 8, "--cols", 12, "--black-level", 0, "-o", tmp_path / "b", "--json")
    assert as_it_is.err == ""
    assert as_it_is.json["black_level_dn"] == 0


def test_changed_fields_of_the_sensor(photosite: Any, tmp_path: Path) -> None:
    fields = "--sensor-option", "read_noise_e=9", "--sensor-option", "black_level_dn=60"
    size = "--rows", 8, "--cols", 12
    shown = photosite("shoot", *size, *fields, "-o", tmp_path / "a")
    assert "black level raised" not in shown.err
    true = ps.load_sensor(tmp_path / "a" / "truth.sensor.yaml")
    assert true.electrons(true.noise.read_noise_mv.value) == pytest.approx(9)
    assert true.readout.black_level_dn.value == 60
    plan = photosite("plan", *size, *fields, "--step", "dark:1/100:9", "--step", "light:1/50:9", "--json").json
    assert plan["expected"]["read_noise_e"]["value"] == pytest.approx(9, rel=1e-3)
    wrong = photosite("shoot", *size, "--sensor-option", "read_noise=9", "-o", tmp_path / "b")
    assert (wrong.status, wrong.err.count("\n")) == (2, 1)
    assert "'read_noise'" in wrong.err


@pytest.mark.usefixtures("without_frames")
def test_maps_with_the_default_seed_give_a_note(photosite: Any, tmp_path: Path) -> None:
    """Maps of frames shot with seed 0 hold a share of its noise, which seed 0 repeats."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=8, cols=12, black_level_dn=32)
    sensor = sensor.with_(maps=drawn_maps(sensor).save(tmp_path / "mine.maps.h5"))
    sensor.save(tmp_path / "mine.sensor.yaml")
    size = ("--sensor", tmp_path / "mine.sensor.yaml", "--no-pedestal")
    silent = photosite("shoot", *size, "-o", tmp_path / "a")
    assert silent.status == 0, silent.err
    assert "maps contain residual noise of their frames" in silent.err
    assert "if these were simulated with seed 0" in silent.err
    for seed in (0, 1):
        assert "residual noise" not in photosite("shoot", *size, "--seed", seed, "-o", tmp_path / f"b{seed}").err
    plain = photosite("shoot", "--rows", 8, "--cols", 12, "--no-pedestal", "-o", tmp_path / "c")
    assert "residual noise" not in plain.err


def test_one_gain_setting_of_several(photosite: Any, tmp_path: Path) -> None:
    size = ("--sensor", "google-pixel-4a", "--gain-setting", 440, "--rows", 8, "--cols", 8)
    photosite("shoot", *size, "-o", tmp_path / "stack")
    assert ps.open_frames(tmp_path / "stack").gain_settings == (440,)
    assert ps.load_sensor(tmp_path / "stack" / "truth.sensor.yaml").readout.analog_gain.value == 8
    nominal = ps.load_sensor(tmp_path / "stack" / "nominal.sensor.yaml")
    assert (nominal.all_gain_settings, nominal.noise.dark_current_temperature_c) == ((440,), None)
    plan = photosite("plan", *size, "--step", "dark:1/100:9", "--step", "light:1/50:9", "--json").json
    gain = ps.load_sensor("google-pixel-4a").at_gain_setting(440).system_gain_dn_per_e
    assert plan["expected"]["system_gain_dn_per_e"]["value"] == pytest.approx(gain, rel=1e-3)
    wrong = photosite("shoot", *size[:3], 300, "-o", tmp_path / "other")
    assert "--gain-setting must be one of" in wrong.err


def test_photons_where_the_light_is_metered(photosite: Any, tmp_path: Path) -> None:
    photosite("shoot", "--rows", 8, "--cols", 12, "--photons", "-o", tmp_path / "stack")
    first, *_, last = ps.open_frames(tmp_path / "stack").of_kind("light")
    assert last.photons_per_pixel / first.photons_per_pixel == pytest.approx(8000 / 25)


def test_folder_with_something_in_it_is_left_alone(photosite: Any, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    refused = photosite("shoot", "--rows", 8, "--cols", 12, "--black-level", 64, "-o", tmp_path)
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_terminated_leaves_nothing(tmp_path: Path) -> None:
    """SIGINT is Python's KeyboardInterrupt: test_main.py and tests/files have its exit status and its cleaning up."""
    code = "from photosite.cli.main import main; main()"
    arguments = ["shoot", "--rows", "528", "--cols", "784", "--black-level", "64", "-o", str(tmp_path / "stack")]
    process = subprocess.Popen([sys.executable, "-c", code, *arguments], stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 120
        while not list(tmp_path.glob(".photosite-*/dark/*.tif")):
            assert process.poll() is None, "ended before it was interrupted"
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 143
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
