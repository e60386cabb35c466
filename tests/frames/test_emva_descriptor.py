"""EMVA 1288 descriptors: variants of the format, errors, and 300 real frames."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image
from raising import raises

from photosite.errors import FileError, InputError
from photosite.frames.frame_set import FrameSet
from photosite.frames.io.emva_descriptor import looks_like_descriptor, read_descriptor, write_descriptor
from photosite.frames.open import open_frames

HEAD = "v 3.0\nn 12 4 3\n"


def put_images(folder, *names, value=0, shape=(3, 4)):
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        Image.fromarray(np.full(shape, value, np.uint16)).save(folder / name)


def descriptor(folder, text, name="data.txt", encoding="utf-8"):
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


def test_a_descriptor(tmp_path):
    put_images(tmp_path, "images/b1.png", "images/b2.png", value=20)
    put_images(tmp_path, "images/d1.png", "images/d2.png", "d 3.png", value=10)
    path = descriptor(
        tmp_path,
        "# comment\n" + HEAD + "b 125000 500.5\ni images\\b1.png\ni images\\b2.png\n"
        "d 125000.0\ni images\\d1.png\ni images\\d2.png\ni d 3.png\n",
    )
    frames = open_frames(path)
    dark, light = frames.groups
    assert (dark.kind, dark.exposure_s, dark.photons_per_pixel, len(dark)) == ("dark", 1 / 8000, 0.0, 3)
    assert (light.kind, light.exposure_s, light.photons_per_pixel, len(light)) == ("light", 1 / 8000, 500.5, 2)
    assert (frames.rows, frames.cols, frames.bits) == (3, 4, 12)
    assert [int(dn[0, 0]) for dn in light] == [20, 20]
    assert frames.source == str(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_case_whitespace_and_encoding(tmp_path, newline, encoding):
    put_images(tmp_path, "images/a.png", "images/b.png")
    text = "# Müller\n\n  V 3.0 \nN  12\t4  3\n\tD   40000,5\n I\timages\\a.png  \n   # x\ni images/b.png"
    path = descriptor(tmp_path, text.replace("\n", newline), encoding=encoding)
    assert looks_like_descriptor(path)
    (group,) = open_frames(path).groups
    assert (len(group), group.exposure_s) == (2, 40000.5e-9)


def test_series_of_one_setting_are_one_group(tmp_path):
    put_images(tmp_path, *(f"{n}.png" for n in range(5)))
    pair, stack = "d 40\ni 0.png\ni 1.png\n", "d 40.0\ni 2.png\ni 3.png\ni 4.png\n"
    (group,) = open_frames(descriptor(tmp_path, HEAD + pair + stack)).groups
    assert len(group) == 5


def test_exposures_of_zero_are_labels(tmp_path):
    put_images(tmp_path, "a.png", "b.png", "c.png")
    frames = open_frames(descriptor(tmp_path, HEAD + "d 0\ni a.png\nb 0 500\ni b.png\nb 0 800\ni c.png\n"))
    assert [(g.kind, g.exposure_s, g.photons_per_pixel) for g in frames.groups] == [
        ("dark", 0.0, 0.0),
        ("light", 0.0, 500.0),
        ("light", 0.0, 800.0),
    ]


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("x 1\n", 3, "the command"),
        ("b 40\ni a.png\n", 3, "the line"),
        ("b 40 x\ni a.png\n", 3, "the line"),
        ("b 40 nan\ni a.png\n", 3, "the line"),
        ("b 40 -1\ni a.png\n", 3, "photons_per_pixel"),
        ("d 40 12\ni a.png\n", 3, "the line"),
        ("d -1\ni a.png\n", 3, "exposure_s"),
        ("d\n", 3, "the line"),
        ("i a.png\n", 3, "the frame comes before any"),
        ("d 40\ni\n", 4, "the line"),
        ("d 40\nd 50\ni a.png\n", 3, "the series has no frames"),
        ("d 40\n", 3, "the series has no frames"),
        ("n 12 4 3\n", 3, "there is a second line"),
        ("", None, "there are no frames"),
    ],
)
def test_invalid_lines(tmp_path, text, line, what):
    put_images(tmp_path, "a.png")
    path = descriptor(tmp_path, HEAD + text)
    with raises(FileError, what, path=str(path), line=line):
        read_descriptor(path)


@pytest.mark.parametrize(
    ("size", "what"),
    [
        ("n 12 4\n", "the line"),
        ("n 12 4.5 3\n", "bits, width and height"),
        ("n 24 4 3\n", "bits"),
        ("n 12 0 3\n", "bits, width and height"),
        ("", "the line 'n bits width height' is missing"),
    ],
)
def test_invalid_sizes(tmp_path, size, what):
    put_images(tmp_path, "a.png")
    with raises(FileError, what):
        read_descriptor(descriptor(tmp_path, "v 3\n" + size + "d 40\ni a.png\n"))


def test_missing_frames(tmp_path):
    put_images(tmp_path, "a.png")
    path = descriptor(tmp_path, HEAD + "d 40\ni a.png\ni b.png\ni c.png\n")
    missing = str(tmp_path / "b.png")
    with raises(FileError, "there is no such file, and 1 more of 3", path=str(path), line=5, where=missing):
        open_frames(path)


def test_file_names_are_case_sensitive(tmp_path):
    """Commands ignore case; file names do not."""
    put_images(tmp_path, "A.png")
    if (tmp_path / "a.PNG").exists():
        pytest.skip("skipped: the file system ignores case")
    with raises(FileError, "there is no such file", hint="There is a file 'A.png'"):
        open_frames(descriptor(tmp_path, HEAD + "D 40\nI a.PNG\n"))


def test_a_frame_listed_twice(tmp_path):
    """Its temporal noise would be 0."""
    put_images(tmp_path, "images/a.png", "images/b.png")
    path = descriptor(tmp_path, HEAD + "d 40\ni images\\a.png\ni images\\b.png\ni images\\..\\images\\a.png\n")
    with raises(FileError, "the frame is listed twice, first at line 4", path=str(path), line=6):
        open_frames(path)


def test_sizes_and_bits_are_the_descriptors(tmp_path):
    put_images(tmp_path, "a.png")
    put_images(tmp_path, "b.png", shape=(4, 3))
    with raises(FileError, "the size is 4 x 3, but 3 x 4 is stated", line=5):
        open_frames(descriptor(tmp_path, HEAD + "d 40\ni a.png\ni b.png\n"))
    put_images(tmp_path, "c.png", value=4096)
    frames = open_frames(descriptor(tmp_path, HEAD + "d 40\ni c.png\n"))
    with raises(FileError, "dn", value=4096, path=str(tmp_path / "c.png")):
        list(frames.groups[0])
    with raises(FileError, "bits", value=14):
        open_frames(descriptor(tmp_path, HEAD + "d 40\ni a.png\n"), bits=14)


def test_the_real_measurement(emva_frames):
    """640 x 480, 12 bits: 50 exposures of 2 dark and 2 light frames, and 50 of each at one more; counts from grep."""
    path = emva_frames
    text = path.read_text()
    listed = re.findall(r"^i (.*)$", text, flags=re.M)
    frames = open_frames(path)
    assert (frames.rows, frames.cols, frames.bits, frames.frame_count) == (480, 640, 12, len(listed))
    assert frames.frame_count == 300
    for kind in ("dark", "light"):
        groups = frames.of_kind(kind)
        assert sorted(map(len, groups)) == [2] * 50 + [50]
        assert [g.exposure_s for g in groups] == sorted(g.exposure_s for g in groups)
    exposures = {float(ns) / 1e9 for ns in re.findall(r"^d ([\d.]+)", text, flags=re.M)}
    assert {g.exposure_s for g in frames.groups} == exposures
    spatial = next(g for g in frames.of_kind("light") if len(g) == 50)
    assert (spatial.exposure_s, spatial.photons_per_pixel) == (0.00516, 15508.0)
    dn = next(iter(spatial))
    name = spatial.frames[0].name
    assert np.array_equal(dn, np.asarray(Image.open(name)))
    assert open_frames(path.parent).frame_count == 300  # a folder with one descriptor


EXPOSURES = (1 / 8000, 1 / 3, 0.01, 1e-5, 30.0, 0.1 + 1e-16)


def measurement(photons=True):
    rng = np.random.default_rng(2)
    frames = []
    for exposure_s in EXPOSURES:
        for kind, light in (("dark", 0.0), ("light", 1234.567 * exposure_s)):
            for _ in range(2):
                dn = rng.integers(0, 4096, (5, 7)).astype(np.uint16)
                frames.append((kind, exposure_s, dn, light) if photons else (kind, exposure_s, dn))
    return FrameSet.from_arrays(frames, bits=12)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_round_trip(tmp_path, suffix):
    written = measurement()
    path = write_descriptor(written, tmp_path / "set", suffix=suffix)
    again = open_frames(path)
    assert (again.rows, again.cols, again.bits, again.frame_count) == (5, 7, 12, written.frame_count)
    for before, after in zip(written.groups, again.groups, strict=True):
        assert (after.kind, after.exposure_s) == (before.kind, before.exposure_s)
        assert after.photons_per_pixel == before.photons_per_pixel
        for one, other in zip(before, after, strict=True):
            np.testing.assert_array_equal(one, other)


def test_written_lines(tmp_path):
    path = write_descriptor(measurement(), tmp_path / "set")
    lines = path.read_text().splitlines()
    assert lines[:2] == ["v 4.0", "n 12 7 5"]
    assert lines[2] == "d 10000.0"
    assert lines[3] == r"i images\d0_0000.png"
    with Image.open(tmp_path / "set" / "images" / "d0_0000.png") as image:
        assert image.mode == "I;16"


def test_writing_needs_photons(tmp_path):
    with raises(InputError, "the light frames at 1e-05 s do not state"):
        write_descriptor(measurement(photons=False), tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_writing_needs_one_gain_setting(tmp_path):
    dn = np.zeros((2, 2), np.uint16)
    two = FrameSet.from_arrays([("dark", 0.1, dn, 0.0, 100.0), ("dark", 0.1, dn, 0.0, 200.0)], bits=8)
    with raises(InputError, "the frames have several gain settings (100, 200)"):
        write_descriptor(two, tmp_path / "set")


def test_a_folder_with_files_is_unchanged(tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "mine.txt").write_text("mine")
    with raises(FileError, "exists already and is not an empty folder", path=str(tmp_path / "set")):
        write_descriptor(measurement(), tmp_path / "set")
    assert [p.name for p in (tmp_path / "set").iterdir()] == ["mine.txt"]
