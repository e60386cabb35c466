"""`photosite simulate`."""

from __future__ import annotations

import json
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image

import photosite as ps
from photosite.engine.kernel_folder import kernel_folder
from photosite.values.exposure import format_exposure

SMALL = ("--rows", 66, "--cols", 98)


@pytest.mark.smoke("simulate")
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
    monkeypatch.setattr("photosite.engine.kernel_folder.is_cached", lambda kernel: False)
    done = photosite("simulate", *SMALL, "-o", tmp_path / "shot.dng", "--json")
    assert str(kernel_folder()) in done.err
    assert done.json["rows"] == 66


def test_a_video_of_a_panned_chart_in_flickering_light(photosite: Any, tmp_path: Path) -> None:
    of_time = ("--flicker", "100Hz:0.3", "--line-time", 50, "--motion", "-20,300", "--fps", 24, "--exposure", "1/200")
    done = photosite("simulate", *SMALL, *of_time, "--frames", 2, "-o", tmp_path / "clip.h5")
    assert done.status == 0
    sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98, line_time_us=50)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    seen = ps.scenes.DynamicScene(
        ps.charts.macbeth("A", 40), ps.scenes.SineFlicker(100.0, 0.3), ps.scenes.Motion(-20.0, 300.0)
    )
    for number, expected in enumerate(camera.record(seen, 2, 24.0, 1 / 200)):
        written = ps.read_raw(tmp_path / f"clip-{number + 1}.h5")
        np.testing.assert_array_equal(written.dn, expected.dn)
        assert written.metadata["start_s"] == number / 24
    alone = photosite("simulate", *SMALL, *of_time[:4], "--exposure", "1/200", "-o", tmp_path / "shot.dng")
    assert alone.status == 0
    lit = ps.scenes.DynamicScene(ps.charts.macbeth("A", 40), ps.scenes.SineFlicker(100.0, 0.3))
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.dng").dn, camera.capture(lit, 1 / 200).dn)


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


@pytest.mark.parametrize("illuminant", ["A", "D65", "FL2"])
def test_gray_patches_are_gray(photosite: Any, tmp_path: Path, illuminant: str) -> None:
    """White and neutral 8 of a ColorChecker in preview and developed frame: linear values within 1 %.

    The reflectance of the darker gray patches itself is up to 1.3 % from neutral.
    """
    files = ("-o", tmp_path / "shot.dng", "--preview", tmp_path / "preview.png")
    light = ("--illuminant", illuminant, "--black-level", 64, "--exposure", "auto")
    photosite("simulate", "--rows", 132, "--cols", 196, *light, *files)
    photosite("develop", tmp_path / "shot.dng", "-o", tmp_path / "developed.png", "--depth", 8)
    for name in ("preview", "developed"):
        with Image.open(tmp_path / f"{name}.png") as image:
            picture = np.asarray(image) / 255
        linear = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
        for col in (4, 36):
            means = linear[102:124, col + 6 : col + 24].mean(axis=(0, 1))
            np.testing.assert_allclose(means / means[1], 1, atol=0.01, err_msg=f"{name}, column {col}")


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


def test_automatic_exposure_and_hints(photosite: Any, tmp_path: Path) -> None:
    """auto puts the 99.5th percentile at 80 % of saturation; other times far from it get a hint with that time."""
    shot = ("simulate", *SMALL, "-o", tmp_path / "shot.tif", "--json", "--force")
    automatic = photosite(*shot, "--exposure", "auto")
    frame = ps.read_raw(tmp_path / "shot.tif")
    assert np.percentile(frame.dn, 99.5) == pytest.approx(0.8 * 4095, rel=0.05)
    assert automatic.err == ""
    time_s = automatic.json["exposure_s"]
    assert time_s == automatic.json["suggested_exposure_s"] == frame.exposure_s
    for factor, what in ((8, "saturated"), (1e-3, "almost black")):
        hinted = photosite(*shot, "--exposure", f"{factor * time_s}s")
        assert hinted.err.count("\n") == 1, hinted.err
        assert what in hinted.err
        assert f"--exposure {format_exposure(time_s)} (or auto)" in hinted.err
        assert hinted.json["suggested_exposure_s"] == time_s


@pytest.mark.parametrize("suffix", [".tif", ".h5"])
def test_frames_with_their_clean_mosaic(photosite: Any, tmp_path: Path, suffix: str) -> None:
    """Without a fixed pattern, the mean of many frames approaches the clean mosaic."""
    clean = tmp_path / f"clean{suffix}"
    sensor = ps.load_sensor("nikon-d200").with_(black_level_dn=64, dsnu_mv=0, prnu_percent=0)
    sensor.save(tmp_path / "even.sensor.yaml")
    more = ("--sensor", tmp_path / "even.sensor.yaml", "--frames", 12, "--clean", clean, "--seed", 4)
    done = photosite("simulate", *SMALL, *more, "-o", tmp_path / "noisy.tif", "--json")
    paths = [tmp_path / f"noisy-{number:02d}.tif" for number in range(1, 13)]
    assert done.json["paths"] == [str(path) for path in paths]
    frames = np.stack([ps.read_raw(path).dn for path in paths]).astype(float)
    if suffix == ".tif":
        mosaic = tifffile.imread(clean)
    else:
        with h5py.File(clean) as file:
            mosaic = file["clean"][()]
            assert file["clean"].attrs["black_level_dn"] == 64
    assert mosaic.dtype == np.float32
    assert (frames[0] != frames[1]).mean() > 0.5
    residual = frames.mean(axis=0) - mosaic
    assert abs(residual.mean()) < 0.5
    assert residual.std() < 0.5 * (frames[0] - mosaic).std()
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor.with_(rows=66, cols=98))
    third = list(camera.stream(ps.charts.macbeth("A", 40), 1 / 3, frames=3, seed=4))[2]
    np.testing.assert_array_equal(third.dn, frames[2])


def test_metadata_of_the_dng(photosite: Any, tmp_path: Path) -> None:
    lens = ("--f-number", 5.6, "--focal-length", 85)
    photosite("simulate", *SMALL, *lens, "-o", tmp_path / "shot.dng")
    with tifffile.TiffFile(tmp_path / "shot.dng") as file:
        tags = {code: file.pages[0].tags[code].value for code in (33437, 37386, 306, 50778, 50779, 50721, 50722)}
    assert tags[33437][0] / tags[33437][1] == pytest.approx(5.6)
    assert tags[37386][0] / tags[37386][1] == pytest.approx(85)
    datetime.strptime(tags[306], "%Y:%m:%d %H:%M:%S")
    assert (tags[50778], tags[50779]) == (17, 21)  # Exif's LightSource: CIE A, D65
    frame = ps.read_raw(tmp_path / "shot.dng")
    matrices = [np.reshape(tags[code], (9, 2)) for code in (50721, 50722)]
    for table, expected in zip(matrices, (frame.color_matrix_a, frame.color_matrix), strict=True):
        order = ["RGB".index(name) for name in frame.channels]
        np.testing.assert_allclose((table[:, 0] / table[:, 1]).reshape(3, 3)[order], expected, atol=1e-6)


def test_a_preview_of_rgbw_has_colors(photosite: Any, tmp_path: Path) -> None:
    """Clear pixels, here the sum of the others, keep the colors: within 0.08 of those of a Bayer mosaic."""
    bayer = ps.load_sensor("nikon-d200").with_(black_level_dn=64)
    channels = {name: channel.model_dump() for name, channel in bayer.channels.items()}
    clear = np.sum([channel["quantum_efficiency"] for channel in channels.values()], axis=0)
    channels["W"] = {**channels["G"], "quantum_efficiency": tuple(np.minimum(clear, 1.0).tolist())}
    tile = [list(row) for row in ("WRWG", "RWGW", "WGWB", "GWBW")]
    pictures = []
    for name, sensor in (("bayer", bayer), ("rgbw", bayer.with_(cfa=tile, channels=channels))):
        sensor.save(tmp_path / f"{name}.sensor.yaml")
        shot = ("--sensor", tmp_path / f"{name}.sensor.yaml", "--rows", 132, "--cols", 196, "--exposure", "auto")
        files = ("-o", tmp_path / f"{name}.h5", "--preview", tmp_path / f"{name}.png")
        assert photosite("simulate", *shot, "--illuminant", "D65", *files).status == 0
        with Image.open(tmp_path / f"{name}.png") as picture:
            pixels = np.asarray(picture)[6:126, 4:192] / 255
        pictures.append(
            np.array(
                [
                    [pixels[r + 6 : r + 22, c + 6 : c + 22].mean(axis=(0, 1)) for c in range(0, 188, 32)]
                    for r in range(0, 120, 32)
                ]
            )
        )
    assert np.ptp(pictures[0], axis=-1).max() > 0.4
    np.testing.assert_allclose(pictures[1], pictures[0], atol=0.08)


def test_a_color_filter_array_that_dng_does_not_hold(photosite: Any, tmp_path: Path) -> None:
    quad = [list(row) for row in ("RRGG", "RRGG", "GGBB", "GGBB")]
    sensor = ps.load_sensor("nikon-d200").with_(cfa=quad, black_level_dn=64)
    sensor.save(tmp_path / "quad.sensor.yaml")
    shot = ("simulate", "--sensor", tmp_path / "quad.sensor.yaml", *SMALL)
    refused = photosite(*shot, "-o", tmp_path / "shot.dng")
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert ".tif" in refused.err
    assert ".h5" in refused.err
    taken = photosite(*shot, "-o", tmp_path / "shot.h5", "--preview", tmp_path / "shot.jpg")
    assert (taken.status, taken.err) == (0, "")
    with Image.open(tmp_path / "shot.jpg") as picture:
        white = np.asarray(picture)[52:60, 4:12].reshape(-1, 3).mean(axis=0)
    assert np.ptp(white) < 0.03 * white.mean()


def test_existing_files_are_overwritten_with_force_only(photosite: Any, tmp_path: Path) -> None:
    (tmp_path / "shot-2.tif").write_text("mine")
    call = ("simulate", *SMALL, "--frames", 2, "-o", tmp_path / "shot.tif")
    assert photosite(*call).status == 2
    assert (tmp_path / "shot-2.tif").read_text() == "mine"
    assert not (tmp_path / "shot-1.tif").exists()
    assert photosite(*call, "--force").status == 0
    assert ps.read_raw(tmp_path / "shot-2.tif").shape == (66, 98)


def test_full_wells_are_counted_and_the_suggested_exposure_avoids_them(photosite: Any, tmp_path: Path) -> None:
    sensor = tmp_path / "full.sensor.yaml"
    changes = {"well_capacity_e": 8000, "system_gain_dn_per_e": 0.4, "black_level_dn": 100}
    ps.load_sensor("nikon-d200").with_(rows=66, cols=98, **changes).save(sensor)
    words = ("simulate", "--sensor", sensor, "--luminance", 400, "--json")
    bright = photosite(*words, "--exposure", "1/2", "-o", tmp_path / "bright.dng")
    auto = photosite(*words, "--exposure", "auto", "-o", tmp_path / "auto.dng")
    assert bright.json["saturated_fraction"] > 0.3
    assert "are saturated" in bright.err
    assert bright.json["white_level_dn"] < 3300
    assert auto.json["saturated_fraction"] < 0.005
    assert "hint" not in auto.err
