"""Design sweeps: any field, the pixel that shrinks, and results that do not depend on the processes."""

from __future__ import annotations

import importlib
import math
import multiprocessing
import shutil
import signal
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from worker_tasks import noted, noted_sweep

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.studies.gray_surface import electron_rates, total_variance_e2
from photosite.studies.sweep import Sweep

SENSOR = ps.load_sensor("vendor-2.2um").with_(rows=8, cols=8)
CAMERA = ps.Camera(ps.DiffractionLimited(f_number=2.8, focal_length_mm=4), SENSOR)
TWO_TABLES = ps.Lens(
    ps.DiffractionLimited(4, 50, falloff="none"),
    illumination=ps.optics.IlluminationTable(ps.optics.FieldPoints(angle_deg=[0, 20]), [1, 0.8]),
    distortion=ps.optics.Distortion.polynomial(-0.1),
)
BRIGHT = partial(ps.studies.snr, luminance_cd_m2=100.0)


def read_noise_e(camera: ps.Camera) -> float:
    return camera.sensor.electrons(camera.sensor.noise.read_noise_mv.value)


def test_rows_are_all_combinations_in_order() -> None:
    table = ps.studies.sweep(CAMERA, {"pixel_width_um": [1.1, 2.2], "f_number": (2, 4)})
    assert table.fields == ("pixel_width_um", "f_number")
    assert table.measured == ("signal_e", "noise_e", "snr_db")
    assert table["pixel_width_um"].tolist() == [1.1, 1.1, 2.2, 2.2]
    assert table["f_number"].tolist() == [2, 4, 2, 4]
    np.testing.assert_allclose(table["signal_e"][2:] / table["signal_e"][:2], 4.0, rtol=1e-5)
    np.testing.assert_allclose(table["signal_e"][::2] / table["signal_e"][1::2], 65 / 17, rtol=2e-3)
    single = ps.studies.snr(ps.Camera(ps.DiffractionLimited(4, 4), SENSOR))
    assert [table[name][3] for name in table.measured] == pytest.approx(list(single.values()))
    assert table.to_dict()["f_number"] == [2, 4, 2, 4]


def test_a_smaller_pixel_keeps_its_noise_in_electrons() -> None:
    def facts(camera: ps.Camera) -> dict[str, float]:
        sensor = camera.sensor
        return {
            "read_e": read_noise_e(camera),
            "dsnu_e": sensor.electrons(sensor.noise.dsnu_mv.value),
            "capacity_e": sensor.pixel.well_capacity_e.value,
            "swing_v": sensor.pixel.voltage_swing_v.value,
            "height_um": sensor.pixel.height_um.value,
            "dark_e_per_s": sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value),
        }

    dark = ps.Camera(CAMERA.optics, SENSOR.with_(dark_voltage_mv_per_s=2.0, height_um=3.3, black_level_dn=0))
    table = ps.studies.sweep(dark, {"pixel_width_um": [0.8, 2.2, 3.0]}, facts)
    area = (np.array([0.8, 2.2, 3.0]) / 2.2) ** 2
    np.testing.assert_allclose(table["read_e"], 45.8)
    np.testing.assert_allclose(table["dsnu_e"], 60.0)
    np.testing.assert_allclose(table["capacity_e"], 10_000 * area)
    np.testing.assert_allclose(table["dark_e_per_s"], 20.0 * area)
    np.testing.assert_allclose(table["swing_v"], 1.0)
    np.testing.assert_allclose(table["height_um"], 1.5 * np.array([0.8, 2.2, 3.0]))


def test_fields_of_every_part() -> None:
    lens = ps.Lens(ps.DiffractionLimited(4, 50), ps.optics.Wavefront({8: 50.0}), focus_distance_m=2.0)
    camera = ps.Camera(lens, SENSOR)
    scene = ps.charts.macbeth("D65", 100)

    def facts(camera: ps.Camera, scene: ps.Scene) -> dict[str, Any]:
        return {
            "read": camera.sensor.noise.read_noise_mv.value,
            "n": camera.optics.base.f_number,
            "focus": camera.optics.focus_distance_m,
            "blur": camera.optics.blur.defocus_um,
            "cells": camera.cells_per_pixel,
            "far": scene.distance_m,
            "light": scene.mean_luminance_cd_m2(),
        }

    values = {"read_noise_mv": 1.5, "f_number": 5.6, "focus_distance_m": 3.0, "defocus_um": 7.0}
    values |= {"cells_per_pixel": 3, "distance_m": 4.0, "mean_luminance_cd_m2": 12.0}
    table = ps.studies.sweep(camera, {name: [value] for name, value in values.items()}, facts, scene=scene)
    assert [table[name][0] for name in table.measured] == pytest.approx(list(values.values()))
    warm, cold = ps.studies.sweep(
        camera, {"illuminant": ["A", "D65"]}, lambda _, scene: scene.basis[0, -1], scene=scene
    ).rows
    assert warm[0] == "A"
    assert warm[1] > cold[1]


def test_snr_is_that_of_frames() -> None:
    """The ratio over the pixels of simulated frames of an even field, within their sampling error."""
    sensor = SENSOR.with_(rows=128, cols=128, dark_voltage_mv_per_s=20.0, dcnu_percent=50)
    camera = ps.Camera(CAMERA.optics, sensor)
    found = ps.studies.snr(camera, luminance_cd_m2=60, exposure_s=0.05, illuminant="A")
    raw = camera.capture(ps.charts.uniform("A", 60, distance_m=1e3), 0.05, seed=3)
    red = raw.dn[1::2, 0::2].astype(float) - sensor.readout.black_level_dn.value
    dark_e = sensor.electrons(20.0) * 0.05
    gain = sensor.system_gain_dn_per_e
    assert red.mean() / gain - dark_e == pytest.approx(found["signal_e"], rel=0.01)
    assert red.std() / gain == pytest.approx(found["noise_e"], rel=0.05)
    assert found["snr_db"] == pytest.approx(20 * math.log10(found["signal_e"] / found["noise_e"]))
    of_scene = ps.studies.snr(camera, ps.charts.uniform("A", 60, distance_m=1e3), exposure_s=0.05)
    assert of_scene["signal_e"] == pytest.approx(found["signal_e"], rel=1e-3)


def test_a_saturated_pixel_has_no_ratio() -> None:
    assert math.isnan(ps.studies.snr(CAMERA, luminance_cd_m2=1e6)["snr_db"])
    assert total_variance_e2(SENSOR, 0.0, 0.0) > 45.8**2
    assert electron_rates(CAMERA).shape == (3,)


@pytest.mark.parametrize(
    ("values", "options", "what", "hint"),
    [
        ({"f_numbr": [2]}, {}, "field", "f_number"),
        ({"f_number": 2}, {}, "f_number", None),
        ({"f_number": []}, {}, "values", None),
        ({}, {}, "values", None),
        ({"f_number": [4, 0.1]}, {}, "f_number", None),
        ({"pixel_width_um": [-1]}, {}, "pixel_width_um", None),
        ({"distance_m": [1.0]}, {}, "field", None),
        ({"name": ["a"]}, {"lens": ps.Lens(ps.DiffractionLimited(4, 50))}, "field", None),
        ({"angle_deg": [(0, 10)]}, {"lens": TWO_TABLES}, "field", None),
        ({"f_number": [2]}, {"processes": 0}, "processes", None),
        ({"f_number": [2]}, {"measure": lambda _: "bright"}, "measure", None),
        ({"f_number": [2]}, {"measure": lambda _: {"f_number": 1.0}}, "measure", None),
        ({"f_number": [2, 4]}, {"measure": lambda camera: {str(camera.optics.f_number): 1.0}}, "measure", None),
        ({"f_number": [2, 4]}, {"measure": lambda _: 1.0, "processes": 2}, "measure", "processes=1"),
    ],
)
def test_invalid_calls(values: Any, options: dict[str, Any], what: str, hint: str | None) -> None:
    options = dict(options)
    camera = ps.Camera(options.pop("lens"), SENSOR) if "lens" in options else CAMERA
    with pytest.raises(InputError) as caught:
        ps.studies.sweep(camera, values, **options)
    assert caught.value.what == what
    assert hint is None or hint in (caught.value.hint or "")


def test_plot_has_a_line_for_each_other_field() -> None:
    table = ps.studies.sweep(CAMERA, {"pixel_width_um": [0.8, 3.0], "f_number": [2, 4, 8]}, BRIGHT)
    axes = table.plot("pixel_width_um", "snr_db")
    assert [line.get_label() for line in axes.get_lines()] == ["f_number 2", "f_number 4", "f_number 8"]
    np.testing.assert_allclose(axes.get_lines()[1].get_ydata(), table["snr_db"][1::3])
    missing = Sweep(("f_number",), ("snr_db", "gain"), ((2.0, 30.0, math.nan), (4.0, 24.0, math.nan)))
    assert missing.plot().get_ylabel() == "snr_db"
    pyplot.close("all")
    with pytest.raises(InputError) as caught:
        table.plot("pixel_width")
    assert caught.value.value == "pixel_width"


def test_progress_is_shown_on_standard_error(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr(importlib.import_module("photosite.studies.sweep"), "_BAR_AFTER_S", 0.0)
    ps.studies.sweep(CAMERA, {"f_number": [2, 4]}, read_noise_e)
    shown = capsys.readouterr()
    assert "cameras" in shown.err
    assert not shown.out
    ps.studies.sweep(CAMERA, {"f_number": [2, 4]}, read_noise_e, progress=False)
    assert not capsys.readouterr().err


@pytest.mark.slow
def test_processes_give_the_same_rows() -> None:
    values = {"pixel_width_um": [0.8, 1.4, 3.0], "f_number": [2, 4]}
    alone = ps.studies.sweep(CAMERA, values, BRIGHT)
    for processes in (2, None):
        assert ps.studies.sweep(CAMERA, values, BRIGHT, processes=processes).rows == alone.rows


APERTURES = {"pixel_width_um": [1.1, 2.2, 3.3], "f_number": [2, 2.8, 4]}


def test_a_killed_sweep_resumes_with_the_same_table(tmp_path: Path) -> None:
    """The process is killed at the fifth camera; the others are not measured again."""
    notes, measure = tmp_path / "notes", partial(noted, str(tmp_path))
    notes.mkdir()
    (tmp_path / "deadly").touch()
    killed = multiprocessing.get_context("spawn").Process(target=noted_sweep, args=(str(tmp_path), CAMERA, APERTURES))
    killed.start()
    killed.join(60)
    assert killed.exitcode == -signal.SIGKILL
    assert len(list(notes.iterdir())) == 4
    shutil.rmtree(notes)
    notes.mkdir()
    (tmp_path / "deadly").unlink()
    with pytest.raises(FileError) as caught:
        ps.studies.sweep(CAMERA, {"f_number": [2]}, measure, checkpoint=tmp_path / "kept")
    assert caught.value.what == "holds the results of another sweep"
    with (tmp_path / "kept" / "results.jsonl").open("ab") as stream:
        stream.write(b'\0\0\xff\x0c\n[4, {"third": 0.5}]\n[5, {"third": 0.1')  # a power failure, half a line
    resumed = ps.studies.sweep(CAMERA, APERTURES, measure, checkpoint=tmp_path / "kept")
    assert len(list(notes.iterdir())) == 5
    assert repr(ps.studies.sweep(CAMERA, APERTURES, measure, checkpoint=tmp_path / "kept").rows) == repr(resumed.rows)
    for name, table in (("resumed", resumed), ("whole", ps.studies.sweep(CAMERA, APERTURES, measure))):
        table.save(tmp_path / f"{name}.csv")
    assert (tmp_path / "resumed.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
