"""Opening folders of frames, and the checks that frames of a set agree."""

from __future__ import annotations

import pickle
from types import MappingProxyType

import numpy as np
import pytest
from PIL import Image
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames import from_files
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from


def put(path, value=64, shape=(24, 26), **fields):
    RawFrame(np.full(shape, value, np.uint16), **({"bits": 12, "exposure_s": 0.1} | fields)).save(path)


@pytest.mark.parametrize("ending", ["dng", "tif", "png"])
def test_settings_from_metadata(tmp_path, ending):
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
    ("name", "fields", "what"),
    [
        ("dark_flat", {}, "the name 'dark_flat' states both"),
        ("dark", {"exposure_s": None}, "the file and name do not state the exposure time"),
        ("dark", {"metadata": MappingProxyType({"kind": "grey"})}, "kind"),
        ("dark", {"metadata": MappingProxyType({"photons_per_pixel": "few"})}, "photons_per_pixel"),
        ("dark", {"exposure_s": -1.0}, "exposure_s"),
    ],
)
def test_invalid_or_missing_settings(tmp_path, name, fields, what):
    put(tmp_path / f"{name}.png", **fields)
    with raises(FileError, what, path=str(tmp_path / f"{name}.png")):
        open_frames(tmp_path)


def test_folders_without_frames(tmp_path):
    with raises(FileError, "the folder has no frames"):
        open_frames(tmp_path)
    with raises(FileError, "there is no such file or folder"):
        open_frames(tmp_path / "nowhere")
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text("v 3.0\n")
    with raises(FileError, "the folder has 2 descriptors"):
        open_frames(tmp_path)


def test_frames_in_subfolders(tmp_path):
    """The subfolder's name states the kind, unless the file's name does."""
    for place, name in (("dark", "DSC_0001"), ("dark", "DSC_0002"), ("flats 2", "DSC_0003"), ("dark", "flat_0004")):
        (tmp_path / place).mkdir(exist_ok=True)
        put(tmp_path / place / f"{name}.png")
    (tmp_path / ".hidden").mkdir()
    put(tmp_path / ".hidden" / "dark_1.png")
    assert [(g.kind, len(g)) for g in open_frames(tmp_path).groups] == [("dark", 2), ("light", 2)]
    (tmp_path / "flats 2" / "protocol.yaml").write_text("photosite_protocol: 1")
    with raises(
        FileError, "the folder has no frames", hint="Its subfolder flats 2 is a separate measurement: open that"
    ):
        open_frames(tmp_path)


def test_subfolders_without_frames(tmp_path):
    for name in ("charts", "notes"):
        (tmp_path / name).mkdir()
    with pytest.raises(FileError, match=r"subfolders \(charts, notes\) have none"):
        open_frames(tmp_path)


def test_paths_that_are_not_a_measurement(tmp_path):
    put(tmp_path / "dark.png")
    with raises(FileError, "the file holds a single frame"):
        open_frames(tmp_path / "dark.png")
    (tmp_path / "a.txt").write_text("hello\n")
    with raises(FileError, "the file is neither a YAML protocol nor"):
        open_frames(tmp_path / "a.txt")
    with raises(InputError, "bits", value=25):
        open_frames(tmp_path, bits=25)
    with raises(InputError, "cfa"):
        open_frames(tmp_path, cfa="xyz")


@pytest.mark.parametrize(
    ("odd", "what"),
    [
        ({"shape": (24, 27)}, "the size is 24 x 27, but"),
        ({"bits": 14}, "the bit depth is 14, but"),
        ({"cfa": cfa_from("rggb")}, "the color filter array is RG/GB, but"),
    ],
)
@pytest.mark.parametrize("ending", ["dng", "tif", "png"])
def test_frames_that_disagree(tmp_path, ending, odd, what):
    for number in (1, 2, 3):
        put(tmp_path / f"dark_{number}.{ending}", **(odd if number == 2 else {}))
    with raises(FileError, what, path=str(tmp_path / f"dark_2.{ending}")):
        open_frames(tmp_path)


def test_eight_and_sixteen_bits_do_not_mix(tmp_path):
    (tmp_path / "data.txt").write_text("v 3\nn 12 4 4\nd 40\ni a.png\ni b.png\n")
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(tmp_path / "a.png")
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "b.png")
    with raises(FileError, "bits", value=12, path=str(tmp_path / "b.png")):
        open_frames(tmp_path)


def test_the_black_level_of_the_caller(tmp_path):
    for number in (1, 2):
        put(tmp_path / f"dark_{number}.tif", 64 + number, black_level_dn=16)
    assert open_frames(tmp_path).black_level_dn == 16
    assert open_frames(tmp_path, black_level_dn=64).black_level_dn == 64
    for wrong in (-1, float("nan"), 2.0**24):
        with raises(InputError, "black_level_dn"):
            open_frames(tmp_path, black_level_dn=wrong)


def test_bits_and_cfa_from_the_caller(tmp_path):
    (tmp_path / "protocol.yml").write_text("photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: a.png}]\n")
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(tmp_path / "a.png")
    assumed = open_frames(tmp_path)
    assert assumed.bits == 16
    assert [note.split(";")[0] for note in assumed.warnings] == ["the bit depth is not stated"]
    frames = open_frames(tmp_path, bits=10, cfa=[["G", "R"], ["B", "G"]])
    assert frames.diagnostics == ()
    assert (frames.bits, frames.cfa) == (10, cfa_from("grbg"))


def test_opening_reads_no_pixels(tmp_path, monkeypatch):
    for number in range(3):
        put(tmp_path / f"dark_{number}.png")
    read = []
    real = from_files.read_frame
    monkeypatch.setattr(from_files, "read_frame", lambda *args: read.append(args) or real(*args))
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
    with raises(FileError, "is truncated", path=str(tmp_path / "dark_1.dng")):
        list(frames.groups[0])
    with raises(FileError, "is truncated", path=str(tmp_path / "dark_1.dng")):
        open_frames(tmp_path)
    (tmp_path / "dark_1.dng").unlink()
    with raises(FileError, "there is no such file"):
        list(frames.groups[0])
    put(tmp_path / "dark_1.dng", shape=(30, 30))
    with raises(FileError, "the frame was (24, 26)"):
        list(frames.groups[0])


def test_a_link_is_the_same_frame_as_its_target(tmp_path):
    put(tmp_path / "dark_1.png")
    (tmp_path / "dark_2.png").symlink_to(tmp_path / "dark_1.png")
    with raises(FileError, "the frame is listed twice", path=str(tmp_path / "dark_2.png")):
        open_frames(tmp_path)


def test_different_black_levels(tmp_path):
    put(tmp_path / "dark_1.png", black_level_dn=60.0)
    assert open_frames(tmp_path).black_level_dn == 60.0
    put(tmp_path / "dark_2.png", black_level_dn=61.0)
    assert open_frames(tmp_path).black_level_dn is None


def test_frame_sets_can_be_pickled(tmp_path):
    put(tmp_path / "dark_1.dng", 77)
    frames = pickle.loads(pickle.dumps(open_frames(tmp_path)))
    assert int(next(iter(frames.groups[0])).max()) == 77


@pytest.mark.parametrize("ending", ["dng", "tif", "png", "h5"])
def test_headers_are_read_again_only_where_a_file_has_changed(tmp_path, monkeypatch, ending):
    monkeypatch.setattr("photosite.files.small_files.SETTLED_NS", -1 << 62)  # the files have just been written
    for number in range(2):
        put(tmp_path / f"dark{number}.{ending}", 60 + number)
    first, second = open_frames(tmp_path).groups[0].frames
    with monkeypatch.context() as without:
        without.setattr("photosite.frames.io.formats.detect_format", None)
        if ending == "png":
            assert first.open_rows() is None
            assert (first.read() == 60).all()
    assert (second.read() == 61).all()
    put(tmp_path / f"dark1.{ending}", 7, shape=(26, 24))
    with raises(FileError, "the frame was (24, 26) when", path=second.name):
        second.read()
