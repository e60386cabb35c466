"""`photosite calibrate` on frames of several gain settings, and what is exported from them."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import pytest
from virtual_gain_series import GainModel, GainSeriesLab, gain_series_lab

import photosite as ps
from photosite.calibration.gain_series.result import GainSeries
from photosite.engine.threads import threads_for
from photosite.frames.io.darktable import read_darktable
from photosite.frames.io.libcamera import LIBCAMERA_LOSS

SETTINGS = (100, 200, 400, 800, 1600)


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, GainSeriesLab]:
    d200 = ps.load_sensor("nikon-d200")
    base = d200.with_(rows=48, cols=64, black_level_dn=200, analog_gain=1.0, well_capacity_e=60_000)
    lab = gain_series_lab(base, GainModel(0.2, 1.5, switch_at=400), SETTINGS, seed=4)
    folder = tmp_path_factory.mktemp("series") / "stack"
    with threads_for(1):
        lab.write(folder)
    return folder, lab


@pytest.fixture(scope="module")
def series(shot: tuple[Path, GainSeriesLab]) -> GainSeries:
    frames = ps.open_frames(shot[0])
    return ps.calibrate(frames, frames.sensor)


@pytest.fixture
def calibrated_once(series: GainSeries, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give commands the calibration that all these tests share."""
    module = importlib.import_module("photosite.calibration.calibrate")
    monkeypatch.setattr(module, "calibrate_series", lambda frames, sensor, progress, **options: series)


@pytest.mark.usefixtures("calibrated_once")
def test_table(photosite: Any, shot: tuple[Path, GainSeriesLab]) -> None:
    done = photosite("calibrate", shot[0])
    assert done.status == 0
    lines = done.out.splitlines()
    assert "300 frames at 5 gain settings (proportional)" in lines[0]
    assert [line.split()[0] for line in lines[3:8]] == [f"{setting}" for setting in SETTINGS]
    assert "The conversion gain switches between the settings 200 and 400" in done.out
    # K is 0.23 at 200 and 1.4 at 400, where the conversion gain is three times as high.
    assert "The gain setting of 1 DN per electron is unknown: the gain passes" in done.out


@pytest.mark.usefixtures("calibrated_once")
def test_json_sensors_and_report(photosite: Any, shot: tuple[Path, GainSeriesLab], tmp_path: Path) -> None:
    sensor, report = tmp_path / "mine.sensor.yaml", tmp_path / "report.html"
    done = photosite("calibrate", shot[0], "-o", sensor, "--report", report, "--json")
    assert done.status == 0
    found = done.json
    assert found["conversion_gain_switch"]["between"] == [200, 400]
    assert found["sensor"] == str(sensor)
    measured = ps.load_sensor(sensor)
    assert measured.all_gain_settings == SETTINGS
    assert found["report"] == str(report)
    for entry, laboratory in zip(found["settings"], shot[1].labs, strict=True):
        gain = entry["parameters"]["system_gain_dn_per_e"]
        true = laboratory.camera.sensor.system_gain_dn_per_e
        assert abs(gain["value"] - true) < 4.5 * gain["standard_uncertainty"]  # 5 figures: a false alarm in 30 000
        at_setting = measured.at_gain_setting(entry["setting"])
        assert at_setting.system_gain_dn_per_e == pytest.approx(gain["value"], rel=1e-9)
        noise = entry["parameters"]["read_noise_dn"]["value"]
        assert at_setting.noise.read_noise_mv.value / at_setting.mv_per_dn == pytest.approx(noise, rel=1e-6)
    page = report.read_text(encoding="utf-8")
    assert "Gain series of Nikon D200" in page
    assert page.count("<svg") + page.count("data:image/svg+xml") >= 1


def test_checkpoints_are_used_and_removed(
    photosite: Any, shot: tuple[Path, GainSeriesLab], series: GainSeries, tmp_path: Path
) -> None:
    """Tests of `photosite.calibration.reduction.checkpoint` interrupt a calibration."""
    done = photosite("calibrate", shot[0], "--checkpoint", tmp_path / "sums", "--json")
    assert done.json["settings"] == json.loads(json.dumps(series.to_dict()["settings"]))
    assert (tmp_path / "sums").is_dir()
    assert not [path for path in (tmp_path / "sums").rglob("*") if path.is_file()]


@pytest.mark.usefixtures("calibrated_once")
def test_darktable_out_and_in(photosite: Any, shot: tuple[Path, GainSeriesLab], tmp_path: Path) -> None:
    output = tmp_path / "noise.json"
    done = photosite("export", shot[0], "darktable", "--maker", "Acme", "--model", "X-1", "-o", output)
    assert done.status == 0
    assert "not in the file: levels" in done.err
    profiles = read_darktable(output)
    assert [profile.gain_setting for profile in profiles] == list(SETTINGS)
    for profile, laboratory in zip(profiles, shot[1].labs, strict=True):
        true = laboratory.camera.sensor.system_gain_dn_per_e / (4095 - 200)
        assert profile.slope[0].value == pytest.approx(true, rel=0.05)

    sensor = tmp_path / "x1.sensor.yaml"
    done = photosite(
        "import", output, "--gain-setting", 400, "--sensor", shot[0] / "nominal.sensor.yaml", "-o", sensor, "--json"
    )
    assert done.status == 0
    assert "0.0625 of the raw noise variance" in done.err
    assert done.json["sensor"] == str(sensor)
    # The nominal sensor states no black level: the profile's white is 4095 DN above black there.
    expected = profiles[2].slope[0].value * 4095
    assert ps.load_sensor(sensor).system_gain_dn_per_e == pytest.approx(expected, rel=1e-9)


@pytest.mark.usefixtures("calibrated_once")
def test_libcamera_of_the_lowest_setting(photosite: Any, shot: tuple[Path, GainSeriesLab], tmp_path: Path) -> None:
    output = tmp_path / "tuning.json"
    done = photosite("export", shot[0], "libcamera", "--target", "pisp", "-o", output, "--json")
    assert done.status == 0
    assert "gain setting 100 is assumed to be analog gain 1" in done.err
    assert done.json["loss"] == LIBCAMERA_LOSS
    tuning = json.loads(output.read_text())
    assert tuning["target"] == "pisp"
    (profile,) = photosite("import", output, "--json").json["profiles"]
    gain = profile["channels"]["M"]["slope"] * (profile["white_level_dn"] - profile["black_level_dn"])
    true = shot[1].labs[0].camera.sensor.system_gain_dn_per_e
    assert gain / 16 == pytest.approx(true, rel=0.05)  # 16 bits for 12; the gain is known to 1 %
    shown = photosite("import", output)
    assert shown.status == 0
    assert shown.out.splitlines()[1].split()[0] == "1"


@pytest.mark.usefixtures("calibrated_once")
def test_one_setting_of_a_series(photosite: Any, shot: tuple[Path, GainSeriesLab], tmp_path: Path) -> None:
    output = tmp_path / "noise.json"
    assert photosite("export", shot[0], "darktable", "--gain-setting", 800, "-o", output).status == 0
    assert [profile.gain_setting for profile in read_darktable(output)] == [800]
    refused = photosite("export", shot[0], "darktable", "--gain-setting", 150, "--force", "-o", output)
    assert refused.status == 2
    assert "one of the noise profiles': 100, 200, 400, 800, 1600, got 150" in refused.err
