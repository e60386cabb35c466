"""`photosite calibrate` on one measurement in the containers that cameras and laboratories use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile

import photosite as ps
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet
from photosite.frames.frame_settings import Kind

fits = pytest.importorskip("astropy.io.fits")


@pytest.fixture(scope="module")
def groups(stack: Path) -> list[tuple[Kind, float, np.ndarray]]:
    """Two frames of every other exposure time."""
    groups = ps.open_frames(stack).groups
    dark = [group for group in groups if group.kind == "dark"]
    return [(g.kind, g.exposure_s, np.stack(list(g)[:2])) for g in (*dark[::4], *groups[len(dark) :])]


@pytest.fixture(scope="module")
def expected(stack: Path, groups: list[tuple[Kind, float, np.ndarray]]) -> Calibration:
    """The calibration of the frames in memory."""
    frames = [(kind, exposure_s, dn) for kind, exposure_s, both in groups for dn in both]
    sensor = ps.load_sensor(stack / "nominal.sensor.yaml")
    return ps.calibrate(FrameSet.from_arrays(frames, bits=12, cfa=sensor.array.cfa), sensor)


def one_hdf5(folder: Path, groups: Any) -> list[Any]:
    with h5py.File(folder / "all.h5", "w") as file:
        file.attrs.update({"bits": 12, "cfa": "rggb"})
        for number, (kind, exposure_s, dn) in enumerate(groups):
            file[f"{number}"] = dn
            file[f"{number}"].attrs.update({"kind": kind, "exposure_s": exposure_s})
    return [folder / "all.h5"]


def tiff_bursts(folder: Path, groups: Any) -> list[Any]:
    for kind, exposure_s, dn in groups:
        tifffile.imwrite(folder / f"{kind}_{exposure_s!r}s.tif", dn, photometric="minisblack")
    return [folder, "--bits", 12, "--cfa", "rggb"]


def fits_cubes(folder: Path, groups: Any) -> list[Any]:
    for number, (kind, exposure_s, dn) in enumerate(groups):
        for part, frame in enumerate(dn):
            unit = fits.PrimaryHDU(frame)
            unit.header.update({"EXPTIME": exposure_s, "IMAGETYP": f"{kind} frame", "BAYERPAT": "RGGB", "GAIN": 100})
            unit.writeto(folder / f"{number:02d}_{part:03d}.fits")
    return [folder, "--bits", 12]


@pytest.mark.parametrize("make", [one_hdf5, tiff_bursts, fits_cubes])
def test_the_container_changes_no_figure(
    photosite: Any, stack: Path, groups: Any, expected: Calibration, tmp_path: Path, make: Any
) -> None:
    arguments = make(tmp_path, groups)
    done = photosite("calibrate", *arguments, "--sensor", stack / "nominal.sensor.yaml", "--json")
    assert done.err == ""
    assert expected.system_gain_dn_per_e.value is not None
    for part in ("parameters", "channels"):
        assert done.json[part] == json.loads(json.dumps(expected.to_dict()[part])), part


def test_classification_by_level_warns_and_can_be_overridden(photosite: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    for number, (exposure, level, noise) in enumerate(
        [(0.01, 64, 2), (0.02, 64, 2), (0.01, 500, 15), (0.02, 936, 21), (0.04, 1808, 29)]
    ):
        with h5py.File(tmp_path / f"{number}.h5", "w") as file:
            file["f"] = rng.normal(level, noise, (6, 24, 32)).round().astype(np.uint16)
            file["f"].attrs.update({"exposure_s": exposure, "bits": 12})
    done = photosite("calibrate", tmp_path, "--json")
    assert done.err == "", "the warning is in the result, and nowhere else"
    assert "12 dark (mean 6" in done.json["warnings"][0]
    assert "18 light (mean 4" in done.json["warnings"][0]
    assert "classified by level" in done.json["warnings"][0]
    said = photosite("calibrate", tmp_path, "--dark", "[01].h5", "--light", "[234].h5", "--json")
    assert said.err == ""
    assert said.json["parameters"] == done.json["parameters"]
    wrong = photosite("calibrate", tmp_path, "--dark", "*.nef")
    assert (wrong.status, wrong.err.count("\n")) == (2, 1)
    assert "got '*.nef'" in wrong.err


def test_simulated_into_hdf5(photosite: Any, tmp_path: Path) -> None:
    for ending in ("h5", "tif"):
        done = photosite("simulate", "--rows", 24, "--cols", 36, "--seed", 3, "-o", tmp_path / f"shot.{ending}")
        assert done.status == 0
    one, other = (ps.read_raw(tmp_path / f"shot.{ending}") for ending in ("h5", "tif"))
    assert np.array_equal(one.dn, other.dn)
    assert (one.cfa, one.exposure_s) == (other.cfa, other.exposure_s)
    of_both = [{name: value for name, value in frame.metadata.items() if name != "date_time"} for frame in (one, other)]
    assert of_both[0] == of_both[1]
