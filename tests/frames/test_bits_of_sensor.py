"""Bits and mosaic of frames that do not state them come from the sensor; conflicts name both sources."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile
from click.testing import CliRunner
from raising import raises

import photosite as ps
from photosite.cli.calibrate import command
from photosite.cli.main import run
from photosite.errors import FileError
from photosite.values.cfa import cfa_from

SENSOR = ps.load_sensor("nikon-d200")
DN = np.random.default_rng(1).integers(60, 4000, (24, 32)).astype(np.uint16)


def test_frames_without_bits_and_mosaic(tmp_path):
    tifffile.imwrite(tmp_path / "dark_1s.tif", DN, photometric="minisblack")
    frames = ps.open_frames(tmp_path, sensor=SENSOR)
    assert (frames.bits, frames.cfa, frames.sensor) == (12, SENSOR.array.cfa, SENSOR)
    assert frames.diagnostics == ()
    assert ps.open_frames(tmp_path).diagnostics[0].id == "assumed-bit-depth"


def test_numbers_that_are_shifted_by_the_bits_of_the_sensor(tmp_path):
    tifffile.imwrite(tmp_path / "dark_1s.tif", DN * 16, photometric="minisblack")
    frames = ps.open_frames(tmp_path, sensor=SENSOR)
    np.testing.assert_array_equal(next(iter(frames.groups[0])), DN)
    assert [entry.id for entry in frames.diagnostics] == ["numbers-shifted-down"]


def test_numbers_above_the_bits_of_the_sensor_name_it(tmp_path):
    tifffile.imwrite(tmp_path / "dark_1s.tif", DN * 16 + 1, photometric="minisblack")
    expected = "at most 4095, for 12 bits, which the sensor 'Nikon D200' has"
    with raises(FileError, "dn", value=int(DN.max()) * 16 + 1, expected=expected):
        next(iter(ps.open_frames(tmp_path, sensor=SENSOR).groups[0]))
    with raises(FileError, "dn", expected=expected):
        ps.read_raw(tmp_path / "dark_1s.tif", sensor=SENSOR)
    with raises(FileError, "dn", expected="at most 4095, for 12 bits"):
        next(iter(ps.open_frames(tmp_path, sensor=SENSOR, bits=12).groups[0]))


@pytest.mark.parametrize(
    ("frame", "given", "what"),
    [
        ((DN >> 4, 10, "rggb"), {}, "the files state 10 bits, but the sensor 'Nikon D200' has 12"),
        ((DN, 12, "bggr"), {}, "the files state the color filter array BG/GR, but the sensor 'Nikon D200' has"),
        ((DN, None, None), {"bits": 14}, "14 bits are stated for the frames, but the sensor 'Nikon D200' has 12"),
        ((DN, None, None), {"cfa": "bggr"}, "the frames are stated to have the color filter array BG/GR, but"),
        ((DN.astype(np.uint8), None, None), {}, "the files store 8 bits, but the sensor 'Nikon D200' has 12"),
    ],
)
def test_conflicts_name_both_sources(tmp_path, frame, given, what):
    dn, bits, cfa = frame
    if bits is None:
        tifffile.imwrite(tmp_path / "dark_1s.tif", dn, photometric="minisblack")
    else:
        ps.RawFrame(dn, bits, cfa_from(cfa), exposure_s=1.0).save(tmp_path / "dark_1s.tif")
    with raises(FileError, what):
        ps.open_frames(tmp_path, sensor=SENSOR, **given)


def test_a_single_frame_takes_bits_and_mosaic_of_the_sensor(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", DN, photometric="minisblack")
    frame = ps.read_raw(tmp_path / "a.tif", sensor=SENSOR)
    assert (frame.bits, frame.cfa) == (12, SENSOR.array.cfa)
    np.testing.assert_array_equal(frame.dn, DN)
    with raises(FileError, "14 bits are stated for the frames, but the sensor 'Nikon D200' has 12"):
        ps.read_raw(tmp_path / "a.tif", sensor=SENSOR, bits=14)
    ps.RawFrame(DN, 12, cfa_from("bggr")).save(tmp_path / "b.dng")
    with raises(FileError, "the files state the color filter array BG/GR, but the sensor 'Nikon D200' has"):
        ps.read_raw(tmp_path / "b.dng", sensor=SENSOR)


@pytest.mark.parametrize("name", ["develop", "mtf"])
def test_commands_of_one_frame_take_the_sensor(tmp_path, capsys, name):
    tifffile.imwrite(tmp_path / "a.tif", DN.astype(np.uint8), photometric="minisblack")
    arguments = [name, str(tmp_path / "a.tif"), "--sensor", "nikon-d200"]
    assert run([*arguments, *(["-o", str(tmp_path / "a.png")] if name == "develop" else [])]) == 2
    assert "the file stores 8 bits, but the sensor 'Nikon D200' has 12" in capsys.readouterr().err


def test_command_takes_the_bits_of_the_sensor(tmp_path):
    rng = np.random.default_rng(2)
    for kind, electrons in (("dark", 0), *(("flat", n) for n in (1000, 2000, 4000))):
        for number in range(2):
            dn = 64.5 + 0.5 * (rng.poisson(electrons, (32, 32)) + 3 * rng.standard_normal((32, 32)))
            name = f"{kind}_{max(electrons, 1000)}ms_{number}.tif"
            tifffile.imwrite(tmp_path / name, dn.astype(np.uint16), photometric="minisblack")
    done = CliRunner().invoke(command, [str(tmp_path), "--sensor", "nikon-d200", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["parameters"]["system_gain_dn_per_e"]["value"] == pytest.approx(0.5, rel=0.1)
