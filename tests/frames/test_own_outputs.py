"""Outputs of photosite in a folder of frames are skipped and named once; the bench lists no frames as scenes."""

from __future__ import annotations

import pickle
import struct
import zlib

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.app.files import listed
from photosite.develop.develop import save_picture
from photosite.develop.polarization import save_stokes, stokes
from photosite.errors import FileError
from photosite.files.hdf5 import create_hdf5
from photosite.frames.frame_file import OwnOutputError
from photosite.frames.io.clean_mosaic import write_clean_mosaic
from photosite.frames.io.formats import raw_files
from photosite.values.cfa import NAMED

DN = np.random.default_rng(1).integers(60, 4000, (24, 32)).astype(np.uint16)


@pytest.fixture
def folder(tmp_path):
    for name in ("dark_1.tif", "dark_2.png", "dark_3.h5"):
        ps.RawFrame(DN, 12, exposure_s=1.0).save(tmp_path / name)
    save_picture(np.full((24, 32, 3), 0.5, np.float32), tmp_path / "preview.png")
    frame = ps.RawFrame(DN, 12)
    write_clean_mosaic(DN.astype(np.float32), frame, tmp_path / "clean.h5")
    write_clean_mosaic(DN.astype(np.float32), frame, tmp_path / "clean.tif")
    polarized = ps.RawFrame(DN, 12, NAMED["polarization"])
    save_stokes(stokes(polarized), tmp_path / "stokes.h5")
    scene = ps.charts.macbeth()
    scene.save(tmp_path / "scene.h5")
    with create_hdf5(tmp_path / "mine.maps.h5") as file:
        file.attrs["photosite_maps"] = 1
        file["offset_dn"] = DN.astype(np.float32)
    (tmp_path / "report.html").write_text("<html></html>")
    (tmp_path / "mine.sensor.yaml").write_text("photosite_sensor: 1\n")
    return tmp_path


def test_outputs_are_skipped_and_named_once(folder):
    frames = ps.open_frames(folder)
    assert sorted(f.path.name for group in frames.groups for f in group.frames) == [
        "dark_1.tif",
        "dark_2.png",
        "dark_3.h5",
    ]
    (entry,) = frames.diagnostics
    assert (entry.id, entry.size) == ("own-outputs-skipped", 6.0)
    for name in ("preview.png (a picture)", "mine.maps.h5 (a file of a chip's maps)", "scene.h5 (a scene)"):
        assert name in entry.text
    assert [file.name for file in raw_files(folder)] == ["dark_1.tif", "dark_2.png", "dark_3.h5"]


def test_an_output_that_is_named_is_an_error(folder):
    with raises(OwnOutputError, "the file is a picture that photosite wrote"):
        ps.read_raw(folder / "preview.png")
    text = "photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: clean.tif}]\n"
    (folder / "protocol.yaml").write_text(text)
    with raises(OwnOutputError, "the file is a noise-free mosaic"):
        ps.open_frames(folder)


def test_color_pictures_of_others_are_not_photosites(tmp_path):
    """libpng writes the chunk sRGB behind the header too."""
    from imagecodecs import png_encode

    chunk = struct.pack(">I5sI", 1, b"sRGB\0", zlib.crc32(b"sRGB\0"))
    content = png_encode(np.full((24, 32, 3), 128, np.uint8))
    (tmp_path / "flat_1s.png").write_bytes(content[:33] + chunk + content[33:])
    with raises(FileError, "pixels", value="RGB") as caught:
        ps.open_frames(tmp_path)
    assert not isinstance(caught.value, OwnOutputError)


@pytest.mark.parametrize("size", [24, 1000])  # compressed by imagecodecs, and in threads
def test_pictures_of_each_size_are_known(tmp_path, size):
    save_picture(np.full((size, 1000, 3), 0.5, np.float32), tmp_path / "preview.png")
    with raises(OwnOutputError, "the file is a picture that photosite wrote"):
        ps.read_raw(tmp_path / "preview.png")


def test_a_folder_of_outputs_alone(tmp_path):
    save_picture(np.full((24, 32, 3), 0.5, np.float32), tmp_path / "preview.png")
    with raises(FileError, "the file is a picture that photosite wrote") as caught:
        ps.open_frames(tmp_path)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.path, again.kind) == (str(tmp_path / "preview.png"), "a picture")


def test_the_bench_lists_as_scenes_what_may_be_one(folder):
    assert [entry.name for entry in listed(folder, "scene")] == ["preview.png", "scene.h5", "stokes.h5"]
