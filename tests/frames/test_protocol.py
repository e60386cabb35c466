"""YAML protocols: written, read back, and their errors with lines."""

from __future__ import annotations

import re
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.io.protocol import Protocol, ProtocolFrames, read_protocol, write_protocol
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from


def protocol(folder, text, name="protocol.yaml"):
    path = folder / name
    path.write_text(text)
    return path


def put(folder, *names, value=64, shape=(3, 4), **fields):
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        RawFrame(np.full(shape, value, np.uint16), **({"bits": 12} | fields)).save(folder / name)


@pytest.mark.parametrize("cfa", [None, cfa_from("gbrg"), (("R", "G"), ("G", "W"))])
def test_what_is_written_is_read(tmp_path, cfa):
    written = Protocol(
        (
            ProtocolFrames("dark", 1 / 8000, ("dark/*.png",)),
            ProtocolFrames("light", 0.1 + 0.2, ("a b.png", "no: 1.png", "#c.png"), 1234.5),
            ProtocolFrames("dark", 30.0, ("1e3",)),
            ProtocolFrames("dark", 30.0, ("cold.png",), None, None, 400.0, -10.5),
            ProtocolFrames("light", None, ("more/*.nef",)),
        ),
        name="1.5",
        bits=12,
        cfa=cfa,
        black_level_dn=64.25,
        sensor="d200.sensor.yaml",
    )
    write_protocol(written, tmp_path / "protocol.yaml")
    read = read_protocol(tmp_path / "protocol.yaml")
    plain = tuple(replace(frames, line=None) for frames in read.frames)
    assert Protocol(plain, read.name, read.bits, read.cfa, read.black_level_dn, read.sensor) == written
    assert [f.line for f in read.frames] == sorted(f.line for f in read.frames)


def test_a_protocol_opens(tmp_path):
    put(tmp_path, "dark/2.png", "dark/1.png", value=60)
    put(tmp_path, "flat/1.png", "flat/2.png", "flat/3.tif", value=900)
    path = protocol(
        tmp_path,
        "photosite_protocol: 1\nname: test\nbits: 12\nframes:\n"
        "  - {kind: light, exposure: 5e-3, files: [flat/*.png, flat/3.tif], photons_per_pixel: 4000}\n"
        "  - {kind: dark, exposure: 1/200, files: dark/*.png}\n",
    )
    (tmp_path / "dark" / ".3-unfinished.png").write_bytes(b"half")  # hidden: not a frame
    for frames in (open_frames(path), open_frames(tmp_path), open_frames(str(path), bits=12)):
        dark, light = frames.groups
        assert (dark.kind, dark.exposure_s, light.exposure_s, light.photons_per_pixel) == ("dark", 0.005, 0.005, 4000.0)
        assert [source.name for source in dark.frames] == [str(tmp_path / "dark" / f"{n}.png") for n in (1, 2)]
        assert [int(dn[0, 0]) for dn in light] == [900, 900, 900]
        assert (frames.bits, frames.black_level_dn, frames.source) == (12, 0.0, str(path))


def test_the_protocol_says_what_files_do_not(tmp_path):
    from PIL import Image

    Image.fromarray(np.full((3, 4), 64, np.uint16)).save(tmp_path / "a.png")
    text = "photosite_protocol: 1\nbits: 14\ncfa: [[B, G], [G, R]]\nblack_level_dn: 60.5\n"
    frames = open_frames(protocol(tmp_path, text + "frames: [{kind: dark, exposure: 1, files: a.png}]\n"))
    assert (frames.bits, frames.cfa, frames.black_level_dn) == (14, cfa_from("bggr"), 60.5)
    assert frames.groups[0].frames[0].read().tolist() == [[64] * 4] * 3


def test_the_sensor_says_it_where_neither_does(tmp_path):
    from PIL import Image

    from photosite.sensor.io.sensor_file import load_sensor

    load_sensor("nikon-d200").with_(rows=3, cols=4).save(tmp_path / "mine.sensor.yaml")
    Image.fromarray(np.full((3, 4), 64, np.uint16)).save(tmp_path / "a.png")
    entry = "frames: [{kind: dark, exposure: 1, files: a.png}]\n"
    frames = open_frames(protocol(tmp_path, "photosite_protocol: 1\nsensor: mine.sensor.yaml\n" + entry))
    assert (frames.bits, frames.cfa) == (12, cfa_from("rggb"))
    assert frames.sensor is not None
    assert frames.sensor.pixel.width_um.value == 6.05
    with pytest.raises(FileError, match="frames have 14 bits, the sensor 'Nikon D200' 12"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\nbits: 14\nsensor: mine.sensor.yaml\n" + entry))
    with pytest.raises(FileError, match="mosaic GB/RG, the sensor 'Nikon D200' RG/GB"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\ncfa: gbrg\nsensor: mine.sensor.yaml\n" + entry))
    with pytest.raises(FileError, match=r"nowhere\.yaml"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\nsensor: nowhere.yaml\n" + entry))


GOOD = "{kind: dark, exposure: 1, files: a.png}"


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        ("", None, "expected 'photosite_protocol: 1'"),
        ("- a\n", None, "expected 'photosite_protocol: 1'"),
        ("photosite_protocol: 2\n", 1, "expected 'photosite_protocol: 1' (the file format's version), got 2"),
        ("photosite_protocol: 1\n", None, "'frames' is a list"),
        ("photosite_protocol: 1\nframes: []\n", 2, "'frames' is a list"),
        ("photosite_protocol: 1\nframes: a.png\n", 2, "'frames' is a list"),
        ("photosite_protocol: 1\nframes:\n  - a.png\n", 3, "is {kind, exposure, files}, not 'a.png'"),
        (f"photosite_protocol: 1\nbitz: 12\nframes: [{GOOD}]\n", 2, "has no key 'bitz'; did you mean 'bits'?"),
        (f"photosite_protocol: 1\nbits: 12.0\nframes: [{GOOD}]\n", 2, "whole number from 1 to 16, not 12.0"),
        (f"photosite_protocol: 1\nbits: true\nframes: [{GOOD}]\n", 2, "whole number from 1 to 16"),
        (f"photosite_protocol: 1\ncfa: rgbg\nframes: [{GOOD}]\n", 2, "unknown colour filter array 'rgbg'"),
        (f"photosite_protocol: 1\ncfa: 3\nframes: [{GOOD}]\n", 2, "'cfa':"),
        (f"photosite_protocol: 1\nname: 3\nframes: [{GOOD}]\n", 2, "'name' is text, not 3"),
        (
            f"photosite_protocol: 1\nblack_level_dn: -1\nframes: [{GOOD}]\n",
            2,
            "'black_level_dn' is a number, 0",
        ),
        (f"photosite_protocol: 1\nbits: 12\nbits: 12\nframes: [{GOOD}]\n", 3, "is not YAML: found duplicate key"),
        ("photosite_protocol: 1\nframes: [\n", 3, "is not YAML"),
    ],
)
def test_errors_name_the_line(tmp_path, text, line, why):
    path = protocol(tmp_path, text)
    place = str(path) if line is None else f"{path}:{line}"
    with pytest.raises(FileError, match=f"^{re.escape(place)}: .*{re.escape(why)}") as caught:
        read_protocol(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("entry", "why"),
    [
        ("{kind: dark, exposur: 1, files: a.png}", "has no key 'exposur'; did you mean 'exposure'?"),
        ("{exposure: 1, files: a.png}", "lacks 'kind'"),
        ("{kind: dark, exposure: 1}", "lacks 'files'"),
        ("{kind: flat, exposure: 1, files: a.png}", "'kind' is dark or light, not 'flat'"),
        ("{kind: dark, exposure: 0, files: a.png}", "above 0 s, not 0"),
        ("{kind: dark, exposure: -1/8000, files: a.png}", "above 0 s"),
        ("{kind: dark, exposure: 1/0, files: a.png}", "not '1/0'"),
        ("{kind: dark, exposure: fast, files: a.png}", "not 'fast'"),
        ("{kind: dark, exposure: .inf, files: a.png}", "above 0 s"),
        ("{kind: dark, exposure: .nan, files: a.png}", "above 0 s"),
        ("{kind: dark, exposure: true, files: a.png}", "not True"),
        ("{kind: dark, exposure: [1], files: a.png}", "not [1]"),
        ("{kind: dark, exposure: 1, files: 3}", "a path, a pattern or a list"),
        ("{kind: dark, exposure: 1, files: []}", "a path, a pattern or a list"),
        ("{kind: dark, exposure: 1, files: [a.png, 3]}", "a path, a pattern or a list"),
        ("{kind: dark, exposure: 1, files: a.png, photons_per_pixel: many}", "'photons_per_pixel' is a number"),
        ("{kind: dark, exposure: 1, files: a.png, gain_setting: -1}", "'gain_setting' is a number, 0 or above, not -1"),
        ("{kind: dark, exposure: 1, files: a.png, temperature_c: -300}", "is a number, -273.15 or above, not -300"),
        ("{kind: dark, exposure: 1, files: a.png, temperature_c: cold}", "'temperature_c' is a number, -273.15"),
    ],
)
def test_errors_of_an_entry_name_its_line(tmp_path, entry, why):
    path = protocol(tmp_path, f"photosite_protocol: 1\nframes:\n  - {GOOD}\n  - {entry}\n")
    with pytest.raises(FileError, match=f"^{re.escape(str(path))}:4: .*{re.escape(why)}"):
        read_protocol(path)


def test_patterns_and_files_that_are_not_there(tmp_path):
    put(tmp_path, "a.png")
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, exposure: 1, files: '*.dng'}\n")
    with pytest.raises(FileError, match=r":3: no file matches '\*\.dng'"):
        open_frames(path)
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, exposure: 1, files: [a.png, b.png]}\n")
    with pytest.raises(FileError, match=r":3: .*b\.png: there is no such file \(there is a 'a\.png'\)"):
        open_frames(path)


def test_a_file_under_two_settings(tmp_path):
    put(tmp_path, "a.png", "b.png")
    path = protocol(
        tmp_path,
        "photosite_protocol: 1\nframes:\n"
        "  - {kind: dark, exposure: 1, files: a.png}\n  - {kind: dark, exposure: 2, files: '*.png'}\n",
    )
    with pytest.raises(FileError, match=r":4: .*a\.png: is listed twice, first at line 3"):
        open_frames(path)


def test_brackets_in_a_name_that_is_there(tmp_path):
    put(tmp_path, "dark[1].png")
    path = protocol(tmp_path, "photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: 'dark[1].png'}]\n")
    assert open_frames(path).frame_count == 1


def test_binary_is_no_protocol(tmp_path):
    path = tmp_path / "protocol.yaml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(FileError, match="not text in UTF-8"):
        read_protocol(path)
    with pytest.raises(FileError, match="no such file"):
        read_protocol(tmp_path / "other.yaml")


def test_settings_by_the_protocol_and_by_the_files(tmp_path):
    """What the protocol says of an entry stands before what its files say."""
    put(tmp_path, "a.png", exposure_s=1.0, metadata=MappingProxyType({"iso": 100, "temperature_c": 20.0}))
    put(tmp_path, "b.png", value=65, metadata=MappingProxyType({"gain_setting": 3.5, "iso": 200}))
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, exposure: 1, files: [a.png, b.png]}\n")
    assert [(g.gain_setting, g.temperature_c) for g in open_frames(path).groups] == [(3.5, None), (100.0, 20.0)]
    said = "{kind: dark, exposure: 1, files: [a.png, b.png], gain_setting: 800, temperature_c: -5}"
    path = protocol(tmp_path, f"photosite_protocol: 1\nframes:\n  - {said}\n")
    assert [(g.gain_setting, g.temperature_c) for g in open_frames(path).groups] == [(800.0, -5.0)]
    put(tmp_path, "b.png", metadata=MappingProxyType({"iso": "auto"}))
    with pytest.raises(FileError, match=r"b\.png: states iso 'auto', which is no number"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: b.png}]\n"))


def test_exposures_by_the_files_where_the_protocol_is_silent(tmp_path):
    """One entry for all darks of a camera; a file that is silent too is named, with the line."""
    put(tmp_path, "a.png", exposure_s=1.0)
    put(tmp_path, "b_2s.png", value=65, exposure_s=2.0)
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, files: '*.png'}\n")
    assert [(g.kind, g.exposure_s) for g in open_frames(path).groups] == [("dark", 1.0), ("dark", 2.0)]
    put(tmp_path, "b_2s.png", value=65)
    with pytest.raises(FileError, match=r":3: .*b_2s\.png: does not state its exposure; say it in a protocol"):
        open_frames(path)


def test_temperatures_far_apart_are_told(tmp_path):
    entries = "".join(
        f"  - {{kind: dark, exposure: {n}, files: {n}.png, temperature_c: {celsius}}}\n"
        for n, celsius in ((1, 20), (2, 22))
    )
    put(tmp_path, "1.png", "2.png")
    assert open_frames(protocol(tmp_path, f"photosite_protocol: 1\nframes:\n{entries}")).notes == ()
    path = protocol(tmp_path, f"photosite_protocol: 1\nframes:\n{entries.replace('22', '22.1')}")
    with pytest.warns(PhotositeWarning, match=r"temperature went from 20 to 22\.1 degrees Celsius"):
        frames = open_frames(path)
    assert "from 20 to 22.1" in frames.notes[0]
