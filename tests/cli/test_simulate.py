"""`photosite simulate`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps

SMALL = ("--rows", 66, "--cols", 98)


def test_json_tells_what_was_written(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "shot.dng"
    done = photosite("simulate", *SMALL, "--seed", 7, "--exposure", "1/10", "-o", file, "--json")
    assert (done.status, done.err) == (0, "")
    raw = ps.read_raw(file)
    said = done.json
    assert said["path"] == str(file)
    assert (said["rows"], said["cols"], said["seed"]) == (66, 98, 7)
    assert said["exposure_s"] == raw.exposure_s == 0.1
    assert said["mean_dn"] == raw.dn.mean()
    assert said["max_dn"] == raw.dn.max()
    assert said["saturated_fraction"] == (raw.dn == 4095).mean()


def test_the_first_run_says_what_it_waits_for(photosite: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photosite.engine.jit.kernels_are_cached", lambda: False)
    done = photosite("simulate", *SMALL, "-o", tmp_path / "shot.dng", "--json")
    assert done.err == "compiling kernels (once; about 20 s) ...\n"
    assert done.json["rows"] == 66


def test_is_what_the_library_gives(photosite: Any, tmp_path: Path) -> None:
    photosite("simulate", *SMALL, "--seed", 7, "--black-level", 64, "-o", tmp_path / "shot.tif")
    sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98, black_level_dn=64)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    expected = camera.capture(ps.charts.macbeth("A", 40), exposure_s=1 / 3, seed=7)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, expected.dn)


@pytest.mark.parametrize("scene", ["macbeth", "uniform", "slanted-edge"])
def test_scenes(photosite: Any, tmp_path: Path, scene: str) -> None:
    dim, bright = (
        photosite(
            "simulate", *SMALL, "--scene", scene, "--luminance", cd_m2, "-o", tmp_path / f"{cd_m2}.png", "--json"
        ).json
        for cd_m2 in (5, 10)
    )
    # Twice the light, twice the signal: the D200's preset has no pedestal, and shot noise leaves the mean of
    # 6468 pixels good to a percent.
    assert bright["mean_dn"] == pytest.approx(2 * dim["mean_dn"], rel=0.02)


def test_preview_is_a_picture_of_the_frame(photosite: Any, tmp_path: Path) -> None:
    photosite("simulate", *SMALL, "-o", tmp_path / "shot.dng", "--preview", tmp_path / "shot.png")
    with Image.open(tmp_path / "shot.png") as picture:
        assert (picture.size, picture.mode) == ((98, 66), "RGB")


@pytest.mark.parametrize("illuminant", ["A", "D65"])
def test_libraw_balances_by_the_light(photosite: Any, tmp_path: Path, illuminant: str) -> None:
    """An even gray comes out gray by the file's own balance: its channels' means, good to 0.3 %, against the tag."""
    file = tmp_path / "gray.dng"
    photosite("simulate", *SMALL, "--scene", "uniform", "--illuminant", illuminant, "--black-level", 64, "-o", file)
    code = "import json,sys,rawpy; print(json.dumps(rawpy.imread(sys.argv[1]).camera_whitebalance[:3]))"
    gains = json.loads(subprocess.run([sys.executable, "-I", "-c", code, file], capture_output=True, check=True).stdout)
    dn = ps.read_raw(file).dn.astype(float) - 64
    means = np.array(
        [dn[0::2, 0::2].mean(), (dn[0::2, 1::2].mean() + dn[1::2, 0::2].mean()) / 2, dn[1::2, 1::2].mean()]
    )
    balanced = means * gains
    np.testing.assert_allclose(balanced / balanced[1], 1, atol=0.01)


@pytest.mark.parametrize(
    ("rows", "cols"), [(334, 500), pytest.param(2592, 3872, marks=pytest.mark.slow)], ids=["small", "full size"]
)
def test_dng_is_read_by_libraw_in_a_fresh_process(photosite: Any, tmp_path: Path, rows: int, cols: int) -> None:
    file, pixels = tmp_path / "shot.dng", tmp_path / "libraw.npy"
    size = () if rows == 2592 else ("--rows", rows, "--cols", cols)
    assert photosite("simulate", *size, "-o", file, "--seed", 3).status == 0
    code = (
        "import sys, numpy, rawpy\n"
        "with rawpy.imread(sys.argv[1]) as raw:\n"
        "    assert raw.raw_pattern.tolist() == [[0, 1], [3, 2]], raw.raw_pattern\n"
        "    numpy.save(sys.argv[2], raw.raw_image)\n"
    )
    subprocess.run([sys.executable, "-c", code, file, pixels], check=True)
    sensor = ps.load_sensor("nikon-d200").with_(rows=rows, cols=cols)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    expected = camera.capture(ps.charts.macbeth("A", 40), exposure_s=1 / 3, seed=3)
    assert expected.shape == (rows, cols)
    np.testing.assert_array_equal(np.load(pixels), expected.dn)
