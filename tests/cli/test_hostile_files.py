"""Files that would keep a reader busy: one line, in time that follows from what they really hold."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.sections import Maps

GIGABYTE = 1 << 30
SUFFIXES = [
    "dng",
    "tif",
    "png",
    "h5",
    "fits",
    "nef",
    "yaml",
    "json",
    "csv",
    "txt",
    "mat",
    "exr",
    "hdr",
    "npz",
    "cgats",
    "cxf",
    "jpg",
    "pic",
]
IEND = b"\0\0\0\0IEND\xaeB`\x82"


@pytest.fixture
def in_time() -> Iterator[None]:
    """Stops a test that hangs; a file of 100 GB takes hours, a pipe for ever."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise AssertionError("more than 100 s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(100)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def refused(photosite: Any, in_time: None) -> Callable[..., str]:
    """Runs a command that must fail with one line; returns it."""

    def call(*arguments: object) -> str:
        done = photosite(*arguments)
        assert done.status == 2, done
        lines = [line for line in done.err.splitlines() if not line.endswith("...")]  # of progress
        assert len(lines) == 1, done.err
        return lines[0]

    return call


@contextmanager
def little_memory(most_bytes: float) -> Iterator[None]:
    """Fails if the block allocates more at a time."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most_bytes
    finally:
        tracemalloc.stop()


def _commands(file: Path, folder: Path) -> list[tuple[object, ...]]:
    return [
        ("develop", file, "-o", folder / "o.png"),
        ("calibrate", file),
        ("scenes", "show", file),
        ("convert", file, "-o", folder / "o.h5"),
        ("sensors", "check", file),
        ("optics", "check", file),
        ("simulate", "--camera", file, "-o", folder / "o.dng"),
        ("sweep", file, "-o", folder / "o.csv"),
        ("spectral", file),
        ("plan", "--protocol", file),
        ("cameras", "list", "--profiles", file),
        ("import", file),
        ("compare", file),
        ("export", file, "darktable", "-o", folder / "o.json"),
        ("calibrate", folder, "--linearize", file),
    ]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_pipes_and_devices(refused: Any, tmp_path: Path, suffix: str) -> None:
    pipe, device = tmp_path / f"pipe.{suffix}", tmp_path / f"device.{suffix}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for file in (pipe, device):
        for arguments in _commands(file, tmp_path):
            refused(*arguments)


def _frame() -> RawFrame:
    return RawFrame(np.random.default_rng(1).integers(60, 900, (20, 30)).astype(np.uint16), bits=12, exposure_s=0.1)


def _extended(path: Path, size: int, end: bytes = b"") -> Path:
    """A valid file, then a hole, then `end`."""
    with path.open("r+b") as file:
        file.seek(size - len(end))
        file.write(end)
        file.truncate(size)
    return path


@pytest.mark.parametrize("size", [GIGABYTE // 2, 100 * GIGABYTE])
def test_png_with_a_hole(refused: Any, tmp_path: Path, size: int) -> None:
    _frame().save(tmp_path / "a.png")
    file = _extended(tmp_path / "a.png", size, IEND)
    refused("develop", file, "-o", tmp_path / "o.png")
    refused("scenes", "show", file, "--luminance", 100)


@pytest.mark.parametrize("size", [GIGABYTE // 2, 100 * GIGABYTE])
def test_jpeg_with_a_hole(refused: Any, tmp_path: Path, size: int) -> None:
    Image.new("RGB", (8, 8)).save(tmp_path / "a.jpg")
    refused("scenes", "show", _extended(tmp_path / "a.jpg", size), "--luminance", 100)


def test_fits_with_a_hole(photosite: Any, refused: Any, tmp_path: Path) -> None:
    """Bytes after the last unit are no header; a hole of 100 GB is not searched for one."""
    fits = pytest.importorskip("astropy.io.fits")
    fits.writeto(tmp_path / "a.fits", _frame().dn, fits.Header({"EXPTIME": 0.1}))
    file = _extended(tmp_path / "a.fits", GIGABYTE // 2)
    with little_memory(100e6):
        assert photosite("develop", file, "-o", tmp_path / "o.png").status == 0
    refused("develop", _extended(file, 100 * GIGABYTE), "-o", tmp_path / "p.png")
    (tmp_path / "b.fits").write_bytes(file.open("rb").read(80))
    refused("calibrate", _extended(tmp_path / "b.fits", GIGABYTE // 2))


def test_fits_units_after_the_first_are_found(tmp_path: Path) -> None:
    fits = pytest.importorskip("astropy.io.fits")
    header = fits.Header({"EXPTIME": 0.1})
    units = [fits.PrimaryHDU(), *(fits.ImageHDU(_frame().dn, header) for _ in range(3))]
    fits.HDUList(units).writeto(tmp_path / "dark.fits")
    assert ps.open_frames(tmp_path / "dark.fits").frame_count == 3


def test_envi_header_with_a_hole(refused: Any, tmp_path: Path) -> None:
    (tmp_path / "a.hdr").write_text("ENVI\nsamples = 2\nlines = 2\nbands = 2\n")
    (tmp_path / "a.img").write_bytes(bytes(16))
    refused("scenes", "show", _extended(tmp_path / "a.hdr", 100 * GIGABYTE))
    assert "16 MiB" in refused("scenes", "show", _extended(tmp_path / "a.hdr", 1 << 25))


def test_radiance_with_a_hole(refused: Any, photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "a.pic"
    file.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n" + bytes([128, 99, 80, 129] * 4))
    shown = ("scenes", "show", file, "--luminance", 100)
    assert photosite(*shown).status == 0
    for size in (GIGABYTE // 2, 100 * GIGABYTE):
        _extended(file, size)
        refused(*shown)


@pytest.mark.parametrize("kind", ["psf", "lens_design", "pupil"])
def test_npz_is_not_inflated_beyond_its_size(refused: Any, tmp_path: Path, kind: str) -> None:
    """30 MB of zeros a kilobyte: 240 MB in 240 KB."""
    big = np.zeros(30 << 20)
    names = {"psf": "psf", "lens_design": "psf", "pupil": "amplitude"}
    others = {"spacing_um": 0.5, "wavelength_nm": [550.0], "field_y": [0], "field_x": [0], "unit": "mm"}
    np.savez_compressed(tmp_path / "a.npz", **{names[kind]: big}, **others)
    blur = {
        "psf": "{kind: psf, file: a.npz}",
        "lens_design": "{kind: lens_design, source: a.npz}",
        "pupil": "{kind: wavefront, pupil: {amplitude: a.npz}}",
    }
    lens = tmp_path / "a.optics.yaml"
    lens.write_text(f"photosite_optics: 1\nf_number: 4\nfocal_length_mm: 50\nblur: {blur[kind]}\n")
    with little_memory(50e6):
        assert "numbers" in refused("optics", "check", lens)


def test_pictures_of_other_formats_are_not_opened(refused: Any, tmp_path: Path) -> None:
    """Pillow reads PostScript by starting Ghostscript."""
    (tmp_path / "a.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n")
    assert "PNG" in refused("scenes", "show", tmp_path / "a.png", "--luminance", 100)


def test_messages_of_libraries_do_not_reach_standard_error(tmp_path: Path) -> None:
    script = """
import logging, os, sys, warnings
import photosite.sensor.io.sensor_file as file
from photosite.cli.main import main
def noisy(*arguments):
    os.write(2, b"libpng warning: raw\\n")
    logging.getLogger("tifffile").error("raw")
    warnings.warn("raw", RuntimeWarning)
    raise file.FileError("a.yaml", "is not a sensor file")
file.load_sensor = noisy
sys.argv = ["photosite", "sensors", "check", "a.yaml"]
main()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, done.stderr) == (2, "photosite: a.yaml: is not a sensor file\n")


def test_folder_names_that_are_not_utf8(photosite: Any, tmp_path: Path) -> None:
    """A name of the file system may hold any bytes; texts that are written have escapes for them."""
    folder = tmp_path / os.fsdecode(b"\xff\x1b cam")
    folder.mkdir()
    Image.fromarray(np.full((30, 40, 3), 99, np.uint8)).save(folder / "p.png")
    small = ("--crop", "8x8", "--crops", 1, "--sensor", "vendor-2.2um")
    for form in ("hdf5", "webdataset"):
        done = photosite("dataset", folder / "p.png", *small, "--format", form, "-o", folder / form)
        assert done.status == 0, done
        assert "\x1b" not in (folder / form / "CARD.md").read_text("utf-8")
    maps = Maps(file=str(folder / "a.maps.h5"), sha256="0" * 64)
    assert ps.load_sensor("nikon-d200").with_(maps=maps).maps == maps
    with pytest.raises(ValueError, match="file"):
        Maps(file="", sha256="0" * 64)


@pytest.mark.slow
def test_png_frames_beyond_the_limits_of_pillow(photosite: Any, tmp_path: Path) -> None:
    """Pillow warns of more than 89 megapixels, and refuses more than 179."""
    for side in (9500, 13500):
        dn = np.zeros((side, side), np.uint8)
        dn[5, 7] = 9
        Image.fromarray(dn).save(tmp_path / "a.png")
        frame = ps.read_raw(tmp_path / "a.png")
        assert (frame.shape, frame.dn[5, 7]) == ((side, side), 9)
