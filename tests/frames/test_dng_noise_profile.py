"""NoiseProfile tags in DNG files of photosite and of other programs, in both byte orders."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import rawpy
from raising import raises

import photosite as ps
from photosite.errors import FileError
from photosite.frames.io.dng_noise_profile import read_dng_profile, write_dng_profile
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.noise_profile import NoiseProfile
from photosite.values.uncertain import Measured

PROFILE = NoiseProfile(
    ("R", "G", "B"),
    (Measured(1e-4), Measured(2e-4), Measured(3e-4)),
    (Measured(1e-7), Measured(2e-7), Measured(3e-7)),
    black_level_dn=95,
    white_level_dn=4095,
)


def frame(cfa=(("R", "G"), ("G", "B"))):
    dn = np.random.default_rng(1).integers(90, 4000, (32, 48)).astype(np.uint16)
    return RawFrame(dn, bits=12, cfa=cfa, black_level_dn=95, exposure_s=0.01, metadata={"iso": 400})


def foreign(path, order="<", sub=False, cfa=True):
    """A DNG by another program: one strip, RGGB or linear, the raw image in the first directory or in a SubIFD."""
    pixels = frame().dn.astype(f"{order}u2")

    def entry(tag, kind, values, at):
        code = {1: "B", 3: "H", 4: "I"}[kind]
        data = struct.pack(f"{order}{len(values)}{code}", *values)
        inline = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack(f"{order}I", at)
        return struct.pack(f"{order}HHI", tag, kind, len(values)) + inline

    def directory(entries):
        return (
            struct.pack(f"{order}H", len(entries))
            + b"".join(sorted(entries, key=lambda e: struct.unpack(f"{order}H", e[:2])[0]))
            + bytes(4)
        )

    data_at = 8
    main_at = data_at + pixels.nbytes
    raw = [
        entry(254, 4, [0], 0), entry(256, 4, [48], 0), entry(257, 4, [32], 0), entry(258, 3, [16], 0),
        entry(259, 3, [1], 0), entry(262, 3, [32803 if cfa else 34892], 0), entry(273, 4, [data_at], 0),
        entry(277, 3, [1], 0), entry(278, 4, [32], 0), entry(279, 4, [pixels.nbytes], 0),
        entry(50714, 3, [95], 0), entry(50717, 3, [4095], 0),
    ]  # fmt: skip
    if cfa:
        raw += [entry(33421, 3, [2, 2], 0), entry(33422, 1, [0, 1, 1, 2], 0)]
    version = entry(50706, 1, [1, 4, 0, 0], 0)
    if sub:
        small = [entry(254, 4, [1], 0), entry(256, 4, [4], 0), entry(257, 4, [3], 0), entry(258, 3, [8], 0)]
        small += [entry(262, 3, [1], 0), version, entry(277, 3, [1], 0)]
        sub_at = main_at + 2 + 12 * (len(small) + 1) + 4
        content = directory([*small, entry(330, 4, [sub_at], 0)]) + directory(raw)
    else:
        content = directory([*raw, version])
    head = {"<": b"II*\0", ">": b"MM\0*"}[order] + struct.pack(f"{order}I", main_at)
    path.write_bytes(head + pixels.tobytes() + content)
    return path


def test_own_frames(tmp_path):
    frame().save(tmp_path / "shot.dng")
    write_dng_profile(PROFILE, tmp_path / "shot.dng", tmp_path / "with.dng")
    again = ps.read_raw(tmp_path / "with.dng")
    np.testing.assert_allclose(again.noise_profile, [(1e-4, 1e-7), (2e-4, 2e-7), (3e-4, 3e-7)], rtol=1e-12)
    np.testing.assert_array_equal(again.dn, frame().dn)
    found = read_dng_profile(tmp_path / "with.dng")
    assert found.gain_setting == 400
    assert found.channels == ("R", "G", "B")
    assert "slopes differ" in found.notes[0]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("sub", [False, True])
def test_other_programs_frames(tmp_path, order, sub):
    source = foreign(tmp_path / "shot.dng", order, sub)
    before = source.read_bytes()
    with raises(FileError, "the file has no NoiseProfile tag"):
        read_dng_profile(source)
    write_dng_profile(PROFILE, source, tmp_path / "with.dng")
    found = read_dng_profile(tmp_path / "with.dng")
    assert [s.value for s in found.slope] == [1e-4, 2e-4, 3e-4]
    assert [o.value for o in found.offset] == [1e-7, 2e-7, 3e-7]
    assert (found.black_level_dn, found.white_level_dn) == (95, 4095)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "with.dng").dn, frame().dn)
    with rawpy.imread(str(tmp_path / "with.dng")) as decoded:  # LibRaw reads it, too
        np.testing.assert_array_equal(decoded.raw_image, frame().dn)
    assert source.read_bytes() == before

    # Written again, in place: the tag is replaced, not duplicated.
    write_dng_profile(
        NoiseProfile(("M",), (Measured(5e-4),), (Measured(1e-6),)), tmp_path / "with.dng", tmp_path / "with.dng"
    )
    assert {s.value for s in read_dng_profile(tmp_path / "with.dng").slope} == {5e-4}


def test_monochrome_and_other_levels(tmp_path):
    """Profile numbers follow the file's levels: with white at 16 383 in 14 bits a 12-bit gain is 4 times as many DN."""
    source = foreign(tmp_path / "shot.dng", cfa=False)
    wide = NoiseProfile(("M",), (Measured(1e-4),), (Measured(1e-7),), None, 380, 16383)
    write_dng_profile(wide, source, tmp_path / "with.dng")
    found = read_dng_profile(tmp_path / "with.dng")
    assert found.system_gain_dn_per_e.value == pytest.approx(wide.system_gain_dn_per_e.value / 4, rel=1e-12)
    assert found.dark_noise_dn.value == pytest.approx(wide.dark_noise_dn.value / 4, rel=1e-12)


def test_truncated_files(tmp_path):
    source = foreign(tmp_path / "shot.dng")
    source.write_bytes(source.read_bytes()[:-20])
    with raises(FileError, "is truncated"):
        write_dng_profile(PROFILE, source, tmp_path / "with.dng")
    assert not (tmp_path / "with.dng").exists()


def test_damaged_directories(tmp_path):
    """500 files with changed bytes in their directories: a FileError, or a file that can be read back."""
    rng = np.random.default_rng(8)
    content = foreign(tmp_path / "shot.dng", sub=True).read_bytes()
    start = 8 + 2 * 32 * 48
    errors = []
    for _ in range(500):
        damaged = bytearray(content)
        for at in rng.integers(start, len(content), rng.integers(1, 4)):
            damaged[at] = rng.integers(256)
        (tmp_path / "damaged.dng").write_bytes(damaged)
        try:
            write_dng_profile(PROFILE, tmp_path / "damaged.dng", tmp_path / "with.dng")
        except FileError as error:
            errors.append(str(error))
        else:
            assert len(read_dng_profile(tmp_path / "with.dng").slope) in (1, 2, 3, 4)
    assert 100 < len(errors) < 490
    assert all("damaged.dng: " in error for error in errors)
