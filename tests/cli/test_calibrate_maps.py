"""`photosite calibrate --maps`: the chip's maps beside the sensor file, and frames simulated from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from scipy.io import loadmat

import photosite as ps
from photosite.sensor.io.sensor_file import dump_sensor, load_measured_chip
from photosite.sensor.sections import Maps

SHARED = dump_sensor(ps.load_sensor("nikon-d200").with_(maps=Maps(file="mine.maps.h5", sha256="0" * 64)))


def test_maps_lie_beside_the_sensor_file_and_are_simulated(photosite: Any, stack: Path, tmp_path: Path) -> None:
    """The offsets of the simulated dark frames are those of the chip that was shot: correlation of 0.7 and more."""
    done = photosite("calibrate", stack, "--maps", "--all", "-o", tmp_path / "mine.sensor.yaml")
    assert done.status == 0, done.err
    for words in (
        "row noise",
        "Tukey lambda (0.1356: normal)",
        "defective pixels",
        "blinking",
        "Fraction of hot pixels",
    ):
        assert words in done.out
    assert done.out.endswith(f"wrote {tmp_path / 'mine.maps.h5'}\n")
    sensor = ps.load_sensor(tmp_path / "mine.sensor.yaml")
    assert load_measured_chip(sensor) is not None
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    black = np.zeros((66, 98), np.float32)
    simulated = np.mean([camera.expose(black, 0.01, seed=1, frame=i).dn for i in range(30)], axis=0)
    shot = ps.open_frames(stack).of_kind("dark")[0]
    mean = np.mean(list(shot), axis=0)
    assert np.corrcoef(simulated.ravel(), mean.ravel())[0, 1] > 0.7


def test_shared_maps_are_noticed_before_the_calibration(photosite: Any, stack: Path, tmp_path: Path) -> None:
    for name in ("mine", "other"):
        (tmp_path / f"{name}.sensor.yaml").write_text(SHARED, encoding="utf-8")
    (tmp_path / "mine.maps.h5").write_bytes(b"")
    done = photosite("calibrate", stack, "--maps", "--force", "-o", tmp_path / "mine.sensor.yaml")
    assert (done.status, done.out, done.err.count("\n")) == (2, "", 1)
    assert "other.sensor.yaml" in done.err


def test_gains_of_the_pixels_reach_the_files_of_microscopy(photosite: Any, tmp_path: Path) -> None:
    """Half of the columns have 1.3 times the gain: the exported map says so, and the sensor file simulates it."""
    rng, gain = np.random.default_rng(1), np.where(np.arange(48) < 24, 2.0, 2.6)
    (tmp_path / "levels").mkdir()
    for name, electrons, count in (("dark", 0, 200), ("flat_a", 100, 100), ("flat_b", 300, 100), ("flat_c", 600, 100)):
        signal = rng.poisson(electrons, (count, 32, 48)) + rng.normal(0, 1.5, (count, 32, 48))
        dn = np.rint(100 + gain * signal).astype(np.uint16)
        tifffile.imwrite(tmp_path / "levels" / f"{name}_10ms.tif", dn, photometric="minisblack")
    sensor, found = tmp_path / "a.sensor.yaml", tmp_path / "smap.mat"
    calibrate = ("calibrate", tmp_path / "levels", "--bits", 12, "--pixel-gain", "--sensor", "sony-imx174")
    done = photosite(*calibrate, "-o", sensor)
    assert done.status == 0, done.err
    assert "gains of the pixels: spread 12." in done.out  # 0.3 of the signal-weighted mean, 2.34
    assert photosite("export", sensor, "smap", "-o", found).status == 0
    exported = 1.0 / loadmat(found)["gainmap"]
    ratio = np.median(exported[:, 24:]) / np.median(exported[:, :24])
    assert abs(ratio / 1.3 - 1.0) < 4 * 1.25 * np.sqrt(2.0) * 0.09 / np.sqrt(exported.size / 2)
    chip = load_measured_chip(ps.load_sensor(sensor))
    assert chip is not None
    assert np.allclose(chip.pixel_gain_dn_per_e, exported, rtol=1e-6)
    other = tmp_path / "direct.mat"
    done = photosite("export", tmp_path / "levels", "smap", "--pixel-gain", "--bits", 12, "-o", other)
    assert done.status == 0, done.err
    assert np.allclose(1.0 / loadmat(other)["gainmap"], exported, rtol=1e-6)
