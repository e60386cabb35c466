"""EMVA 1288 descriptors: the format's freedoms, its errors, and 300 real frames."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image

from photosite.errors import FileError
from photosite.frames.io.emva import looks_like_descriptor, read_descriptor
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


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        ("x 1\n", 3, "unknown command 'x'; known are: v, n, b, d, i"),
        ("b 40\ni a.png\n", 3, "expected 'b exposure_ns photons', got 'b 40'"),
        ("b 40 x\ni a.png\n", 3, "expected 'b exposure_ns photons'"),
        ("b 40 nan\ni a.png\n", 3, "expected 'b exposure_ns photons'"),
        ("b 40 -1\ni a.png\n", 3, "photons cannot be -1"),
        ("d 40 12\ni a.png\n", 3, "expected 'd exposure_ns', got 'd 40 12'"),
        ("d 0\ni a.png\n", 3, "ns above 0, not 0"),
        ("d\n", 3, "expected 'd exposure_ns'"),
        ("i a.png\n", 3, "a frame before any"),
        ("d 40\ni\n", 4, "expected 'i path'"),
        ("d 40\nd 50\ni a.png\n", 3, "a series without a frame"),
        ("d 40\n", 3, "a series without a frame"),
        ("n 12 4 3\n", 3, "a second 'n bits width height'"),
        ("", None, "names no frames"),
    ],
)
def test_errors_name_the_line(tmp_path, text, line, why):
    put_images(tmp_path, "a.png")
    path = descriptor(tmp_path, HEAD + text)
    place = str(path) if line is None else f"{path}:{line}"
    with pytest.raises(FileError, match=f"^{re.escape(place)}: .*{re.escape(why)}") as caught:
        read_descriptor(path)
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("size", "why"),
    [
        ("n 12 4\n", "expected 'n bits width height'"),
        ("n 12 4.5 3\n", "whole numbers"),
        ("n 24 4 3\n", "1 to 16 bits"),
        ("n 12 0 3\n", "above 0"),
        ("", "lacks its line 'n"),
    ],
)
def test_errors_of_the_size(tmp_path, size, why):
    put_images(tmp_path, "a.png")
    with pytest.raises(FileError, match=why):
        read_descriptor(descriptor(tmp_path, "v 3\n" + size + "d 40\ni a.png\n"))


def test_missing_frames_are_found_at_once(tmp_path):
    put_images(tmp_path, "a.png")
    path = descriptor(tmp_path, HEAD + "d 40\ni a.png\ni b.png\ni c.png\n")
    with pytest.raises(FileError, match=rf"{re.escape(str(path))}:5: .*b\.png: there is no such file.*1 more of 3"):
        open_frames(path)


def test_names_are_as_written(tmp_path):
    """Commands may be in capitals; names are the file system's."""
    put_images(tmp_path, "A.png")
    if (tmp_path / "a.PNG").exists():
        pytest.skip("skipped: this file system takes capitals for small letters")
    with pytest.raises(FileError, match=r"no such file \(there is a 'A\.png'\)"):
        open_frames(descriptor(tmp_path, HEAD + "D 40\nI a.PNG\n"))


def test_a_frame_listed_twice(tmp_path):
    """It would make the temporal noise of a pair zero."""
    put_images(tmp_path, "images/a.png", "images/b.png")
    path = descriptor(tmp_path, HEAD + "d 40\ni images\\a.png\ni images\\b.png\ni images\\..\\images\\a.png\n")
    with pytest.raises(FileError, match=rf"{re.escape(str(path))}:6: .*listed twice, first at line 4"):
        open_frames(path)


def test_sizes_and_bits_are_the_descriptors(tmp_path):
    put_images(tmp_path, "a.png")
    put_images(tmp_path, "b.png", shape=(4, 3))
    with pytest.raises(FileError, match=r":5: .*b\.png: has size 4 x 3, where 3 x 4 is said"):
        open_frames(descriptor(tmp_path, HEAD + "d 40\ni a.png\ni b.png\n"))
    put_images(tmp_path, "c.png", value=4096)
    frames = open_frames(descriptor(tmp_path, HEAD + "d 40\ni c.png\n"))
    with pytest.raises(FileError, match=r"c\.png: .*12-bit frame cannot hold 4096"):
        list(frames.groups[0])
    with pytest.raises(FileError, match="says 12 bits, not the 14 asked for"):
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
    assert open_frames(path.parent).frame_count == 300  # the folder stands for its one descriptor
