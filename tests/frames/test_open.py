"""Folders of frames, and what must be alike in a set."""

from __future__ import annotations

import pickle
import re
from types import MappingProxyType

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames import listing
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from


def put(path, value=64, shape=(24, 26), **fields):
    RawFrame(np.full(shape, value, np.uint16), **({"bits": 12, "exposure_s": 0.1} | fields)).save(path)


@pytest.mark.parametrize("ending", ["dng", "tif", "png"])
def test_a_folder_by_the_files_own_words(tmp_path, ending):
    for number, (kind, exposure_s) in enumerate([("light", 0.2), ("dark", 0.1), ("dark", 0.2), ("dark", 0.1)]):
        metadata = MappingProxyType({"kind": kind, **({"photons_per_pixel": 500.0} if kind == "light" else {})})
        put(tmp_path / f"{number}.{ending}", number, exposure_s=exposure_s, metadata=metadata, cfa=cfa_from("grbg"))
    (tmp_path / "notes.md").write_text("not a frame")
    (tmp_path / ".hidden.png").write_bytes(b"not a frame either")
    frames = ps.open_frames(tmp_path)
    seen = [(g.kind, g.exposure_s, g.photons_per_pixel, [int(dn[0, 0]) for dn in g]) for g in frames.groups]
    assert seen == [("dark", 0.1, None, [1, 3]), ("dark", 0.2, None, [2]), ("light", 0.2, 500.0, [0])]
    assert (frames.cfa, frames.source) == (cfa_from("grbg"), str(tmp_path))


@pytest.mark.parametrize(
    ("name", "kind"),
    [("dark_001", "dark"), ("Bias-3", "dark"), ("DARKS1", "dark"), ("flat field 2", "light"), ("bright_7", "light")],
)
def test_kind_by_name(tmp_path, name, kind):
    put(tmp_path / f"{name}.png")
    assert [g.kind for g in open_frames(tmp_path).groups] == [kind]


@pytest.mark.parametrize(
    ("name", "fields", "why"),
    [
        ("dark_flat", {}, "both dark and light in its name"),
        (
            "dark",
            {"exposure_s": None},
            "does not state its exposure, nor does its name; say it in a protocol.yaml: 'photosite_pro",
        ),
        ("dark", {"metadata": MappingProxyType({"kind": "grey"})}, "states the kind 'grey'"),
        ("dark", {"metadata": MappingProxyType({"photons_per_pixel": "few"})}, "photons_per_pixel 'few'"),
        ("dark", {"exposure_s": -1.0}, "above 0 s, not -1"),
    ],
)
def test_a_frame_that_does_not_say_enough(tmp_path, name, fields, why):
    put(tmp_path / f"{name}.png", **fields)
    with pytest.raises(FileError, match=re.escape(why)):
        open_frames(tmp_path)


def test_folders_without_frames(tmp_path):
    with pytest.raises(FileError, match="holds no frames"):
        open_frames(tmp_path)
    with pytest.raises(FileError, match="no such file or folder"):
        open_frames(tmp_path / "nowhere")
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text("v 3.0\n")
    with pytest.raises(FileError, match=r"holds 2 descriptors, a\.txt and others"):
        open_frames(tmp_path)


def test_frames_in_subfolders(tmp_path):
    """As a measurement lies on disk: by the subfolder's name, unless the file's own name says otherwise."""
    for place, name in (("dark", "DSC_0001"), ("dark", "DSC_0002"), ("flats 2", "DSC_0003"), ("dark", "flat_0004")):
        (tmp_path / place).mkdir(exist_ok=True)
        put(tmp_path / place / f"{name}.png")
    (tmp_path / ".hidden").mkdir()
    put(tmp_path / ".hidden" / "dark_1.png")
    assert [(g.kind, len(g)) for g in open_frames(tmp_path).groups] == [("dark", 2), ("light", 2)]
    (tmp_path / "flats 2" / "protocol.yaml").write_text("photosite_protocol: 1")
    with pytest.raises(FileError, match="subfolder flats 2 is a measurement of its own"):
        open_frames(tmp_path)


def test_subfolders_without_frames_are_named(tmp_path):
    for name in ("charts", "notes"):
        (tmp_path / name).mkdir()
    with pytest.raises(FileError, match=r"holds no frames .*subfolders \(charts, notes\) hold no frames either"):
        open_frames(tmp_path)


def test_what_is_no_measurement(tmp_path):
    put(tmp_path / "dark.png")
    with pytest.raises(FileError, match="is one frame; a measurement is"):
        open_frames(tmp_path / "dark.png")
    (tmp_path / "a.txt").write_text("hello\n")
    with pytest.raises(FileError, match="no EMVA 1288 descriptor"):
        open_frames(tmp_path / "a.txt")
    with pytest.raises(InputError, match="1 to 16 bits, not 20"):
        open_frames(tmp_path, bits=20)
    with pytest.raises(InputError, match="unknown colour filter array"):
        open_frames(tmp_path, cfa="xyz")


@pytest.mark.parametrize(
    ("odd", "why"),
    [
        ({"shape": (24, 27)}, "has size 24 x 27, but .*dark_1.* has 24 x 26"),
        ({"bits": 14}, "has bits 14, but .*dark_1.* has 12"),
        ({"cfa": cfa_from("rggb")}, "has colour filter array RG/GB, but .*dark_1.* has M"),
    ],
)
@pytest.mark.parametrize("ending", ["dng", "tif", "png"])
def test_mixed_frames_name_the_odd_one(tmp_path, ending, odd, why):
    for number in (1, 2, 3):
        put(tmp_path / f"dark_{number}.{ending}", **(odd if number == 2 else {}))
    with pytest.raises(FileError, match=rf"dark_2\.{ending}: {why}"):
        open_frames(tmp_path)


def test_eight_and_sixteen_bits_do_not_mix(tmp_path):
    (tmp_path / "data.txt").write_text("v 3\nn 12 4 4\nd 40\ni a.png\ni b.png\n")
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(tmp_path / "a.png")
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "b.png")
    with pytest.raises(FileError, match=r"b\.png: stores 8 bits a pixel, too few for a 12-bit"):
        open_frames(tmp_path)


def test_bits_and_mosaic_from_the_caller(tmp_path):
    (tmp_path / "protocol.yml").write_text("photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: a.png}]\n")
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(tmp_path / "a.png")
    assumed = open_frames(tmp_path)
    assert assumed.bits == 16
    assert [note.split(":")[0] for note in assumed.notes] == ["no bits are stated"]
    frames = open_frames(tmp_path, bits=10, cfa=[["G", "R"], ["B", "G"]])
    assert frames.notes == ()
    assert (frames.bits, frames.cfa) == (10, cfa_from("grbg"))


def test_opening_reads_no_pixels(tmp_path, monkeypatch):
    for number in range(3):
        put(tmp_path / f"dark_{number}.png")
    read = []
    real = listing.read_frame
    monkeypatch.setattr(listing, "read_frame", lambda *args: read.append(args) or real(*args))
    frames = open_frames(tmp_path)
    assert read == []
    assert len(list(frames.groups[0])) == 3
    assert len(read) == 3


def test_a_file_truncated_before_and_after_opening(tmp_path):
    for number in range(2):
        put(tmp_path / f"dark_{number}.dng")
    frames = open_frames(tmp_path)
    whole = (tmp_path / "dark_1.dng").read_bytes()
    (tmp_path / "dark_1.dng").write_bytes(whole[:-1])
    with pytest.raises(FileError, match=r"dark_1\.dng: is truncated"):
        list(frames.groups[0])
    with pytest.raises(FileError, match=r"dark_1\.dng: is truncated"):
        open_frames(tmp_path)
    (tmp_path / "dark_1.dng").unlink()
    with pytest.raises(FileError, match=r"dark_1\.dng: there is no such file"):
        list(frames.groups[0])
    put(tmp_path / "dark_1.dng", shape=(30, 30))
    with pytest.raises(FileError, match=r"is now \(30, 30\); it was \(24, 26\)"):
        list(frames.groups[0])


def test_a_link_to_a_listed_file_is_the_same_frame(tmp_path):
    put(tmp_path / "dark_1.png")
    (tmp_path / "dark_2.png").symlink_to(tmp_path / "dark_1.png")
    with pytest.raises(FileError, match=r"dark_2\.png: is listed twice, first at .*dark_1\.png"):
        open_frames(tmp_path)


def test_black_levels_that_differ_are_not_stated(tmp_path):
    put(tmp_path / "dark_1.png", black_level_dn=60.0)
    assert open_frames(tmp_path).black_level_dn == 60.0
    put(tmp_path / "dark_2.png", black_level_dn=61.0)
    assert open_frames(tmp_path).black_level_dn is None


def test_a_set_goes_to_another_process(tmp_path):
    put(tmp_path / "dark_1.dng", 77)
    frames = pickle.loads(pickle.dumps(open_frames(tmp_path)))
    assert int(next(iter(frames.groups[0])).max()) == 77
