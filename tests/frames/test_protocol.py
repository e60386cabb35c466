"""YAML protocols: round trip, opening, and errors with lines."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.frame_settings import FrameSettings
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
def test_round_trip(tmp_path, cfa):
    written = Protocol(
        (
            ProtocolFrames(("dark/*.png",), FrameSettings("dark", 1 / 8000)),
            ProtocolFrames(("a b.png", "no: 1.png", "#c.png"), FrameSettings("light", 0.1 + 0.2, 1234.5)),
            ProtocolFrames(("1e3",), FrameSettings("dark", 30.0)),
            ProtocolFrames(("cold.png",), FrameSettings("dark", 30.0, None, 400.0, -10.5)),
            ProtocolFrames(("more/*.nef",), FrameSettings("light")),
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


def test_properties_from_the_protocol(tmp_path):
    from PIL import Image

    Image.fromarray(np.full((3, 4), 64, np.uint16)).save(tmp_path / "a.png")
    text = "photosite_protocol: 1\nbits: 14\ncfa: [[B, G], [G, R]]\nblack_level_dn: 60.5\n"
    frames = open_frames(protocol(tmp_path, text + "frames: [{kind: dark, exposure: 1, files: a.png}]\n"))
    assert (frames.bits, frames.cfa, frames.black_level_dn) == (14, cfa_from("bggr"), 60.5)
    assert frames.groups[0].frames[0].read().tolist() == [[64] * 4] * 3


def test_properties_from_the_sensor(tmp_path):
    from PIL import Image

    from photosite.sensor.io.sensor_file import load_sensor

    load_sensor("nikon-d200").with_(rows=3, cols=4).save(tmp_path / "mine.sensor.yaml")
    Image.fromarray(np.full((3, 4), 64, np.uint16)).save(tmp_path / "a.png")
    entry = "frames: [{kind: dark, exposure: 1, files: a.png}]\n"
    frames = open_frames(protocol(tmp_path, "photosite_protocol: 1\nsensor: mine.sensor.yaml\n" + entry))
    assert (frames.bits, frames.cfa) == (12, cfa_from("rggb"))
    assert frames.sensor is not None
    assert frames.sensor.pixel.width_um.value == 6.05
    with raises(FileError, "14 bits are stated for the frames, but the sensor 'Nikon D200' has 12"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\nbits: 14\nsensor: mine.sensor.yaml\n" + entry))
    with raises(FileError, "the frames are stated to have the color filter array GB/RG"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\ncfa: gbrg\nsensor: mine.sensor.yaml\n" + entry))
    with pytest.raises(FileError, match=r"nowhere\.yaml"):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\nsensor: nowhere.yaml\n" + entry))


GOOD = "{kind: dark, exposure: 1, files: a.png}"


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("", None, "is not a protocol of dark frames"),
        ("- a\n", None, "is not a protocol of dark frames"),
        ("photosite_protocol: 2\n", 1, "photosite_protocol"),
        ("photosite_protocol: 1\n", None, "frames"),
        ("photosite_protocol: 1\nframes: []\n", 2, "frames"),
        ("photosite_protocol: 1\nframes: a.png\n", 2, "frames"),
        ("photosite_protocol: 1\nframes:\n  - a.png\n", 3, "frames[0]"),
        (f"photosite_protocol: 1\nbits: 12.0\nframes: [{GOOD}]\n", 2, "bits"),
        (f"photosite_protocol: 1\nbits: true\nframes: [{GOOD}]\n", 2, "bits"),
        (f"photosite_protocol: 1\ncfa: rgbg\nframes: [{GOOD}]\n", 2, "cfa"),
        (f"photosite_protocol: 1\ncfa: 3\nframes: [{GOOD}]\n", 2, "cfa"),
        (f"photosite_protocol: 1\nblack_level_dn: -1\nframes: [{GOOD}]\n", 2, "black_level_dn"),
    ],
)
def test_invalid_protocols(tmp_path, text, line, what):
    path = protocol(tmp_path, text)
    with raises(FileError, what, path=str(path), line=line):
        read_protocol(path)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"photosite_protocol: 1\nbitz: 12\nframes: [{GOOD}]\n", 2),
        (f"photosite_protocol: 1\nname: 3\nframes: [{GOOD}]\n", 2),
        (f"photosite_protocol: 1\nbits: 12\nbits: 12\nframes: [{GOOD}]\n", 3),
        ("photosite_protocol: 1\nframes: [\n", 3),
    ],
)
def test_yaml_errors_have_the_line(tmp_path, text, line):
    with pytest.raises(FileError) as caught:
        read_protocol(protocol(tmp_path, text))
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("entry", "what"),
    [
        ("{exposure: 1, files: a.png}", "'kind' is missing"),
        ("{kind: dark, exposure: 1}", "'files' is missing"),
        ("{kind: flat, exposure: 1, files: a.png}", "kind"),
        *((f"{{kind: dark, exposure: {x}, files: a.png}}", "exposure_s") for x in ("-1/8000", "1/0", "fast")),
        ("{kind: light, exposure: 0, files: a.png}", "exposure_s"),
        *((f"{{kind: dark, exposure: {x}, files: a.png}}", "exposure_s") for x in (".inf", ".nan", "true", "[1]")),
        *((f"{{kind: dark, exposure: 1, files: {x}}}", "files") for x in ("3", "[]", "[a.png, 3]")),
        ("{kind: dark, exposure: 1, files: a.png, photons_per_pixel: many}", "photons_per_pixel"),
        ("{kind: dark, exposure: 1, files: a.png, gain_setting: -1}", "gain_setting"),
        ("{kind: dark, exposure: 1, files: a.png, temperature_c: -300}", "temperature_c"),
        ("{kind: dark, exposure: 1, files: a.png, temperature_c: cold}", "temperature_c"),
    ],
)
def test_invalid_entries(tmp_path, entry, what):
    path = protocol(tmp_path, f"photosite_protocol: 1\nframes:\n  - {GOOD}\n  - {entry}\n")
    with raises(FileError, what, path=str(path), line=4, where="frames[1]"):
        read_protocol(path)


def test_missing_files(tmp_path):
    put(tmp_path, "a.png")
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, exposure: 1, files: '*.dng'}\n")
    with raises(FileError, "no file matches '*.dng'", line=3):
        open_frames(path)
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, exposure: 1, files: [a.png, b.png]}\n")
    with raises(FileError, "there is no such file", line=3, hint="There is a file 'a.png'"):
        open_frames(path)


def test_a_file_listed_twice(tmp_path):
    put(tmp_path, "a.png", "b.png")
    path = protocol(
        tmp_path,
        "photosite_protocol: 1\nframes:\n"
        "  - {kind: dark, exposure: 1, files: a.png}\n  - {kind: dark, exposure: 2, files: '*.png'}\n",
    )
    with raises(FileError, "the frame is listed twice, first at line 3", line=4):
        open_frames(path)


def test_brackets_in_a_file_name(tmp_path):
    put(tmp_path, "dark[1].png")
    path = protocol(tmp_path, "photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: 'dark[1].png'}]\n")
    assert open_frames(path).frame_count == 1


def test_files_that_are_not_text(tmp_path):
    path = tmp_path / "protocol.yaml"
    path.write_bytes(bytes(range(256)))
    with raises(FileError, "is not a", path=str(path)):
        read_protocol(path)
    with raises(FileError, "there is no such file", path=str(tmp_path / "other.yaml")):
        read_protocol(tmp_path / "other.yaml")


def test_the_protocol_overrides_the_files(tmp_path):
    """Settings of an entry override those of its files."""
    put(tmp_path, "a.png", exposure_s=1.0, metadata=MappingProxyType({"iso": 100, "temperature_c": 20.0}))
    put(tmp_path, "b.png", value=65, metadata=MappingProxyType({"gain_setting": 3.5, "iso": 200}))
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, exposure: 1, files: [a.png, b.png]}\n")
    assert [(g.gain_setting, g.temperature_c) for g in open_frames(path).groups] == [(3.5, None), (100.0, 20.0)]
    entry = "{kind: dark, exposure: 1, files: [a.png, b.png], gain_setting: 800, temperature_c: -5}"
    path = protocol(tmp_path, f"photosite_protocol: 1\nframes:\n  - {entry}\n")
    assert [(g.gain_setting, g.temperature_c) for g in open_frames(path).groups] == [(800.0, -5.0)]
    put(tmp_path, "b.png", metadata=MappingProxyType({"iso": "auto"}))
    with raises(FileError, "gain_setting", value="auto", where=str(tmp_path / "b.png")):
        open_frames(protocol(tmp_path, "photosite_protocol: 1\nframes: [{kind: dark, exposure: 1, files: b.png}]\n"))


def test_exposures_from_the_files(tmp_path):
    """One entry for all dark frames of a camera; an error names a file without exposure, and the line."""
    put(tmp_path, "a.png", exposure_s=1.0)
    put(tmp_path, "b_2s.png", value=65, exposure_s=2.0)
    path = protocol(tmp_path, "photosite_protocol: 1\nframes:\n  - {kind: dark, files: '*.png'}\n")
    assert [(g.kind, g.exposure_s) for g in open_frames(path).groups] == [("dark", 1.0), ("dark", 2.0)]
    put(tmp_path, "b_2s.png", value=65)
    with raises(FileError, "the file does not state the exposure", line=3):
        open_frames(path)


def test_different_temperatures_give_a_warning(tmp_path):
    entries = "".join(
        f"  - {{kind: dark, exposure: {n}, files: {n}.png, temperature_c: {celsius}}}\n"
        for n, celsius in ((1, 20), (2, 22))
    )
    put(tmp_path, "1.png", "2.png")
    assert open_frames(protocol(tmp_path, f"photosite_protocol: 1\nframes:\n{entries}")).diagnostics == ()
    path = protocol(tmp_path, f"photosite_protocol: 1\nframes:\n{entries.replace('22', '22.1')}")
    with pytest.warns(PhotositeWarning, match=r"temperature varied from 20 to 22\.1 degrees Celsius"):
        frames = open_frames(path)
    assert "from 20 to 22.1" in frames.warnings[0]
