"""Polarization and binning in the shell: `photosite polarizers`, and options of develop and simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.frames.binning import bin_frame
from photosite.sensor.assumed_channels import assumed_channels
from photosite.sensor.readout import digital_numbers
from photosite.values.cfa import NAMED, channel_mask

CFA = NAMED["polarization"]
TRUTH = {"P90": (90.5, 40.0), "P45": (44.0, 60.0), "P135": (135.2, 30.0), "P0": (1.0, 50.0)}
SENSOR = ps.load_sensor("sony-imx174").with_(
    rows=24, cols=32, cfa=CFA, channels=assumed_channels(tuple(TRUTH), 0.6), black_level_dn=64, prnu_percent=0.5
)


def behind(angle_deg: float | None, degree: float = 1.0) -> np.ndarray:
    """Mean electrons in light of an angle; none without one."""
    mean = np.zeros((24, 32), np.float32)
    for name, (own_deg, ratio) in TRUTH.items():
        if angle_deg is not None:
            swing = degree * (ratio - 1) / (ratio + 1) * np.cos(np.radians(2 * (angle_deg - own_deg)))
            mean[channel_mask(CFA, name, mean.shape)] = 10000 * (1 + swing)
    return mean


def saved(folder: Path, name: str, mean: np.ndarray, seed: int) -> Path:
    dn = digital_numbers(SENSOR, mean, 0.01, seed=seed)
    ps.RawFrame(dn, 12, CFA, black_level_dn=64, exposure_s=0.01).save(folder / name)
    return folder / name


@pytest.mark.smoke("polarizers")
def test_polarizers_are_measured(photosite: Any, tmp_path: Path) -> None:
    (tmp_path / "turned").mkdir()
    for angle in (0, 45, 90, 135):
        for n in range(3):
            saved(tmp_path / "turned", f"flat_{angle}deg_{n}.h5", behind(angle), 10 * angle + n)
    for n in range(4):
        saved(tmp_path / "turned", f"dark_{n}.h5", behind(None), 5000 + n)
    SENSOR.save(tmp_path / "mine.sensor.yaml")
    out, figure = tmp_path / "complete.sensor.yaml", tmp_path / "p.png"
    given = ("--sensor", tmp_path / "mine.sensor.yaml", "-o", out, "--figure", figure)
    done = photosite("polarizers", tmp_path / "turned", *given, "--json")
    assert (done.status, done.err) == (0, "")
    sensor = ps.load_sensor(out)
    for name, (angle, ratio) in TRUTH.items():
        found = done.json["channels"][name]
        assert abs(found["angle_deg"]["value"] - angle) < 4.5 * found["angle_deg"]["standard_uncertainty"] < 0.5
        assert abs(found["leakage"]["value"] - 1 / ratio) < 4.5 * found["leakage"]["standard_uncertainty"]
        assert sensor.channels[name].polarization_angle_deg == found["angle_deg"]["value"]
    assert figure.stat().st_size > 1000
    assert "extinction ratio" in photosite("polarizers", tmp_path / "turned").out
    saved(tmp_path / "turned", "unknown.h5", behind(0), 1)
    assert "states an angle" in photosite("polarizers", tmp_path / "turned").err


@pytest.mark.smoke("develop")
def test_stokes_parameters(photosite: Any, tmp_path: Path) -> None:
    shot = saved(tmp_path, "shot.h5", behind(30.0, degree=0.5), 3)
    seen = ps.stokes(ps.read_raw(shot))
    assert photosite("develop", shot, "-o", tmp_path / "maps.h5", "--polarization", "stokes").status == 0
    with h5py.File(tmp_path / "maps.h5") as file:
        for name in ("s0", "s1", "s2", "dolp", "aolp_deg"):
            np.testing.assert_array_equal(file[name][()], getattr(seen, name).astype(np.float32))
    done = photosite("develop", shot, "-o", tmp_path / "a.png", "--polarization", "degree", "--json")
    assert done.json["mean_degree"] == pytest.approx(0.5, abs=0.05)
    with Image.open(tmp_path / "a.png") as image:
        np.testing.assert_allclose(np.asarray(image)[..., 0], 255 * np.clip(seen.dolp, 0, 1), atol=0.51)
    assert photosite("develop", shot, "-o", tmp_path / "b.png", "--polarization", "angle").status == 0
    with Image.open(tmp_path / "b.png") as image:
        red, green, blue = np.asarray(image, float).mean(axis=(0, 1))
    assert red > green > blue  # 30 degrees: hue of 60 degrees or less
    assert photosite("develop", shot, "-o", tmp_path / "c.png", "--polarization", "stokes").status == 2
    assert photosite("develop", shot, "-o", tmp_path / "c.h5").status == 2


def test_binning(photosite: Any, tmp_path: Path) -> None:
    size = ("--rows", 48, "--cols", 64)
    sensor = ps.load_sensor("sony-imx174").with_(cfa="quad-rggb", channels=ps.load_sensor("nikon-d200").channels)
    sensor.with_(black_level_dn=64).save(tmp_path / "quad.sensor.yaml")
    shoot = ("simulate", "--sensor", tmp_path / "quad.sensor.yaml", *size, "--luminance", 100)
    assert photosite(*shoot, "-o", tmp_path / "a.h5").status == 0
    done = photosite(*shoot, "--bin", 2, "--bin-kind", "sum", "-o", tmp_path / "b.h5", "--json")
    assert (done.json["rows"], done.json["cols"], done.json["bits"]) == (24, 32, 14)
    whole, binned = ps.read_raw(tmp_path / "a.h5"), ps.read_raw(tmp_path / "b.h5")
    assert binned.cfa == (("R", "G"), ("G", "B"))
    level = binned.dn.mean() - binned.black_level_dn
    assert level == pytest.approx(4 * (whole.dn.mean() - whole.black_level_dn), rel=0.02)
    assert photosite("develop", tmp_path / "a.h5", "--bin", 2, "-o", tmp_path / "a.png").status == 0
    expected = ps.develop(bin_frame(whole, 2))
    with Image.open(tmp_path / "a.png") as image:
        np.testing.assert_array_equal(np.asarray(image), np.rint(expected * 255))
