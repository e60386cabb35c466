"""HDF5 files of others: the documented layout, what is found by itself, and what is refused."""

from __future__ import annotations

import pickle
import re
import struct

import h5py
import numpy as np
import pytest

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.io import hdf5
from photosite.frames.io.read import read_headers, read_raw
from photosite.frames.open import open_frames
from photosite.values.cfa import cfa_from


def stack(seed=0, frames=3, top=4096):
    return np.random.default_rng(seed).integers(0, top, (frames, 6, 8)).astype(np.uint16)


def test_a_whole_measurement_in_one_file(tmp_path):
    """Attributes of the file, a group and a dataset, the nearest counting; one value a frame; names for the rest."""
    darks, flats, single = stack(1), stack(2, 4), stack(3)[0]
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file.attrs.update({"bits": 12, "cfa": "rggb", "black_level_dn": 64.0, "iso": 100, "operator": "Ada"})
        darks_set = file.create_dataset("dark/10ms", data=darks, chunks=(1, 6, 8), compression="gzip")
        darks_set.attrs["temperature_c"] = [20.0, 20.5, 21.0]
        file.create_dataset("lit/a", data=flats).attrs["exposure_ms"] = [10.0, 10.0, 20.0, 20.0]
        file["lit"].attrs.update({"kind": "light", "iso": np.uint16(200)})
        file["lit/a"].attrs["gain_setting"] = 100
        file["lit/a"].attrs["photons_per_pixel"] = [500.0, 500.0, 1000.0, 1000.0]
        file.create_dataset("flat_5ms", data=single)
        file.create_dataset("wavelength_nm", data=np.arange(5.0))
        file.create_dataset("gain_map", data=np.ones((6, 8)))
    frames = open_frames(tmp_path / "m.h5")
    seen = [(g.kind, g.exposure_s, g.photons_per_pixel, g.gain_setting, g.temperature_c, len(g)) for g in frames.groups]
    assert seen == [
        ("dark", 0.01, None, 100.0, 20.5, 3),
        ("light", 0.005, None, 100.0, None, 1),
        ("light", 0.01, 500.0, 100.0, None, 2),
        ("light", 0.02, 1000.0, 100.0, None, 2),
    ]
    assert (frames.bits, frames.cfa, frames.black_level_dn) == (12, cfa_from("rggb"), 64.0)
    assert frames.groups[0].frames[2].name == f"{tmp_path / 'm.h5'}:/dark/10ms[2]"
    assert np.array_equal(np.stack(list(frames.groups[0])), darks)
    assert np.array_equal(np.stack([*frames.groups[2], *frames.groups[3]]), flats)
    assert np.array_equal(next(iter(pickle.loads(pickle.dumps(frames)).groups[1])), single)
    frame = read_raw(tmp_path / "m.h5", index=1)
    assert np.array_equal(frame.dn, darks[1])
    assert frame.metadata["operator"] == "Ada"
    assert (frame.metadata["iso"], frame.metadata["temperature_c"]) == (100, 20.5)


def test_frames_are_read_one_by_one(tmp_path, monkeypatch):
    """Opening reads no pixels, and a frame of a stack costs a frame."""
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file.create_dataset("dark_1s", data=stack())
    read = []
    real = h5py.Dataset.__getitem__
    monkeypatch.setattr(h5py.Dataset, "__getitem__", lambda self, at: read.append(at) or real(self, at))
    frames = open_frames(tmp_path / "m.h5")
    assert read == []
    frames.groups[0].frames[1].read()
    assert read == [1]


def test_a_folder_of_stacks(tmp_path):
    for name, seed in (("dark_1-100s.h5", 1), ("flat_1-100s.hdf5", 2)):
        with h5py.File(tmp_path / name, "w") as file:
            file["data"] = stack(seed)
    assert [(g.kind, g.exposure_s, len(g)) for g in open_frames(tmp_path, bits=12).groups] == [
        ("dark", 0.01, 3),
        ("light", 0.01, 3),
    ]


@pytest.mark.parametrize(
    ("cfa", "tile"),
    [
        ("GBRG", cfa_from("gbrg")),
        ("RG/GW", (("R", "G"), ("G", "W"))),
        (np.array([["Red", "Green"]], dtype=object), (("Red", "Green"),)),
        (np.array([[b"B", b"G"], [b"G", b"R"]]), cfa_from("bggr")),
    ],
)
def test_tiles(tmp_path, cfa, tile):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = stack()[0]
        file["data"].attrs["cfa"] = cfa
    assert read_headers(tmp_path / "a.h5")[0].cfa == tile


def made(path, data=None, name="data", **attributes):
    with h5py.File(path, "w") as file:
        file.create_dataset(name, data=stack() if data is None else data).attrs.update(attributes)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        ({"data": np.zeros((4, 5))}, r"holds no frames, .*of uint8 or uint16: /data \(4, 5\) float64"),
        ({"data": np.zeros(7, np.uint16)}, r"/data \(7,\) uint16"),
        ({"data": np.zeros((40, 50, 3), np.uint8)}, r"/data is \(40, 50, 3\), a picture in colour"),
        ({"data": np.zeros((0, 5), np.uint8)}, r"/data is empty: \(0, 5\)"),
        ({"exposure_time": 5.0}, "an attribute 'exposure_time' of unknown unit; name it exposure_s, in seconds"),
        ({"exposure_s": "long"}, "exposure_s is 'long', not a number"),
        ({"exposure_s": [1.0, 2.0]}, r"exposure_s has shape \(2,\); it is one value, or one a frame"),
        ({"exposure_s": -1.0}, "above 0 s, not -1"),
        ({"exposure_s": 1.0, "kind": "grey"}, "states the kind 'grey'"),
        ({"exposure_s": 1.0, "kind": "dark", "gain_setting": "high"}, "gain_setting 'high', which is no number"),
        ({"bits": 12.5}, "12.5 is no whole number"),
        ({"bits": 17}, "16 bits, not 17"),
        ({"bits": "many"}, "an attribute cannot be"),
        ({"cfa": "xyz"}, "unknown colour filter array 'xyz'"),
        ({"black_level_dn": "low"}, "an attribute cannot be"),
    ],
)
def test_what_is_refused(tmp_path, make, why):
    made(tmp_path / "a.h5", **({"exposure_s": 1.0, "kind": "dark"} | make if "exposure_time" not in make else make))
    with pytest.raises(FileError, match=f"^{re.escape(str(tmp_path / 'a.h5'))}.*{why}") as caught:
        open_frames(tmp_path / "a.h5")
    assert "\n" not in str(caught.value)


def test_numbers_above_the_bits(tmp_path):
    made(tmp_path / "a.h5", exposure_s=1.0, kind="dark", bits=10)
    frames = open_frames(tmp_path / "a.h5")
    with pytest.raises(FileError, match=r"a\.h5:/data\[0\]: holds \d+ DN, which 10 bits cannot"):
        list(frames.groups[0])


def test_one_of_many_has_to_be_named(tmp_path):
    made(tmp_path / "a.h5")
    with pytest.raises(FileError, match="holds 3 frames; say which by its index"):
        read_raw(tmp_path / "a.h5")
    with pytest.raises(FileError, match="holds 3 frames, counted from 0; there is no frame 3"):
        read_raw(tmp_path / "a.h5", index=3)
    made(tmp_path / "b.h5", stack()[0])
    with pytest.raises(FileError, match="is one frame; a measurement is"):
        open_frames(tmp_path / "b.h5")


def test_more_pixels_said_than_stored(tmp_path):
    """A shape that was never written must not become a million frames."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("data", shape=(10**9, 100, 100), dtype=np.uint16, chunks=(1, 100, 100))
    with pytest.raises(FileError, match="bytes of pixels and stores 0; it was not written whole"):
        read_headers(tmp_path / "a.h5")


def test_text_of_variable_length_that_is_damaged_does_not_hang(tmp_path):
    """libhdf5 itself walks such a heap for ever."""
    made(tmp_path / "a.h5", cfa="rggb", kind="dark")
    whole = (tmp_path / "a.h5").read_bytes()
    heap = whole.index(b"GCOL")
    assert read_headers(tmp_path / "a.h5")[0].cfa == cfa_from("rggb")
    for at, bit in ((24, 64), (48, 128), (8, 1), (15, 128)):
        damaged = bytearray(whole)
        damaged[heap + at] ^= bit
        (tmp_path / "b.h5").write_bytes(damaged)
        with pytest.raises(FileError, match="is damaged"):
            read_headers(tmp_path / "b.h5")
    assert whole[:8] == hdf5.SIGNATURE


def test_an_exposure_listed_otherwise_is_told(tmp_path):
    """A warning where files state another exposure than their listing."""
    made(tmp_path / "a.h5", exposure_s=0.01)
    (tmp_path / "protocol.yaml").write_text(
        "photosite_protocol: 1\nframes: [{kind: dark, exposure: 10, files: a.h5}]\n"
    )
    with pytest.warns(PhotositeWarning, match=r"3 files state another exposure.*0\.01 s for 10 s.*check its unit"):
        assert open_frames(tmp_path).groups[0].exposure_s == 10.0


@pytest.mark.parametrize("libver", ["earliest", "latest"])
@pytest.mark.parametrize("value", ["RG/GB", ["dark", "dark"]])
def test_text_longer_than_the_file_is_refused_before_room_is_made_for_it(tmp_path, libver, value):
    """libhdf5 would ask for the length said, up to 4 GiB."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", libver=libver) as file:
        data = file.create_dataset("frames", data=np.full((2, 4, 4), 64, np.uint16))
        data.attrs["exposure_s"] = 0.1
        data.attrs["note"] = value
    assert len(read_headers(path)) == 2
    content = bytearray(path.read_bytes())
    last = value if isinstance(value, str) else value[-1]
    heap = struct.pack("<Q", content.index(b"GCOL"))
    at = content.index(struct.pack("<I", len(last)) + heap, content.index(b"note\0"))
    content[at : at + 4] = struct.pack("<I", 0x4FCA2905)
    path.write_bytes(content)
    # The latest format has a checksum that says so first.
    with pytest.raises(FileError, match=r"an attribute's text has 1338648837 bytes|checksum"):
        read_headers(path)


def test_lists_of_variable_length_are_not_read(tmp_path):
    """Damage makes text to lists, and libhdf5 then reads from anywhere; netCDF's lists of references are no damage."""
    file = tmp_path / "a.h5"
    made(file, stack()[0], exposure_s=1.0)
    with h5py.File(file, "a") as opened:
        references = np.empty(1, object)
        references[0] = np.array([opened["data"].ref], h5py.ref_dtype)
        opened["data"].attrs.create("DIMENSION_LIST", references, dtype=h5py.vlen_dtype(h5py.ref_dtype))
    assert read_raw(file).exposure_s == 1.0
    with h5py.File(file, "a") as opened:
        numbers = np.empty(1, object)
        numbers[0] = np.arange(3)
        opened["data"].attrs.create("kind", numbers, dtype=h5py.vlen_dtype(np.int64))
    with pytest.raises(FileError, match="has a list of variable length as attribute 'kind'"):
        read_raw(file)
