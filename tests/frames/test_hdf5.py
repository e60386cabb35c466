"""HDF5 files of other programs: the documented layout, and invalid files."""

from __future__ import annotations

import pickle
import struct

import h5py
import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError, PhotositeWarning
from photosite.files import hdf5
from photosite.frames.io.formats import read_headers, read_pixels, read_raw
from photosite.frames.open import open_frames
from photosite.optics.io.tables import load_hdf5
from photosite.sensor.io.sensor_file import read_maps
from photosite.values.cfa import cfa_from


def stack(seed=0, frames=3, top=4096):
    return np.random.default_rng(seed).integers(0, top, (frames, 6, 8)).astype(np.uint16)


def test_a_whole_measurement_in_one_file(tmp_path):
    """Attributes of file, group and dataset, the nearest counts; one value per frame; names state the rest."""
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
    """Opening reads one dark frame of 16 bits, and reading a frame of a stack reads that frame only."""
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file.create_dataset("dark_1s", data=stack())
    read = []
    real = h5py.Dataset.__getitem__
    monkeypatch.setattr(h5py.Dataset, "__getitem__", lambda self, at: read.append(at) or real(self, at))
    frames = open_frames(tmp_path / "m.h5")
    assert read == [0]  # numbers below 0 may be stored as unsigned ones
    read.clear()
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


INVALID_ATTRIBUTES = [("bits", 12.5), ("bits", "many"), ("cfa", "xyz"), ("black_level_dn", "low")]


def made(path, data=None, name="data", **attributes):
    with h5py.File(path, "w") as file:
        file.create_dataset(name, data=stack() if data is None else data).attrs.update(attributes)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        ({"data": np.zeros((4, 5), complex)}, "the file holds no frames, but /data (4, 5) complex128"),
        ({"data": np.zeros(7, np.uint16)}, "the file holds no frames, but /data (7,) uint16"),
        ({"data": np.zeros((40, 50, 3), np.uint8)}, "the shape (40, 50, 3) is that of a color picture"),
        ({"data": np.zeros((0, 5), np.uint8)}, "the dataset is empty"),
        ({"exposure_time": 5.0}, "the unit of the attribute 'exposure_time' is unknown"),
        ({"exposure_s": "long"}, "exposure_s"),
        ({"exposure_s": [1.0, 2.0]}, "exposure_s"),
        ({"exposure_s": -1.0}, "exposure_s"),
        ({"kind": "grey"}, "kind"),
        ({"gain_setting": "high"}, "gain_setting"),
        ({"bits": 17}, "bits"),
        *(({name: value}, "an attribute is invalid") for name, value in INVALID_ATTRIBUTES),
    ],
)
def test_invalid_files(tmp_path, make, what):
    made(tmp_path / "a.h5", **({"exposure_s": 1.0, "kind": "dark"} | make if "exposure_time" not in make else make))
    with raises(FileError, what) as caught:
        open_frames(tmp_path / "a.h5")
    assert caught.value.path.startswith(str(tmp_path / "a.h5"))


def test_numbers_above_the_bits(tmp_path):
    made(tmp_path / "a.h5", exposure_s=1.0, kind="dark", bits=10)
    frames = open_frames(tmp_path / "a.h5")
    with raises(FileError, "dn", path=f"{tmp_path / 'a.h5'}:/data[0]"):
        list(frames.groups[0])


def test_reading_one_of_many_needs_an_index(tmp_path):
    made(tmp_path / "a.h5")
    with raises(FileError, "the file holds 3 frames"):
        read_raw(tmp_path / "a.h5")
    with raises(FileError, "index", value=3):
        read_raw(tmp_path / "a.h5", index=3)
    made(tmp_path / "b.h5", stack()[0])
    with raises(FileError, "the file holds a single frame"):
        open_frames(tmp_path / "b.h5")


def test_datasets_that_were_not_written(tmp_path):
    """A shape without data must not become a billion frames."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("data", shape=(10**9, 100, 100), dtype=np.uint16, chunks=(1, 100, 100))
    with raises(FileError, "stores 0 bytes of ", where="/data"):
        read_headers(tmp_path / "a.h5")


def test_damaged_text_of_variable_length_does_not_hang(tmp_path, monkeypatch):
    """libhdf5 loops for ever over some of these heaps."""
    made(tmp_path / "a.h5", cfa="rggb", kind="dark")
    whole = (tmp_path / "a.h5").read_bytes()
    heap = whole.index(b"GCOL")
    assert read_headers(tmp_path / "a.h5")[0].cfa == cfa_from("rggb")
    monkeypatch.setattr(hdf5, "TIME_LIMIT_S", 0.3)
    for at, bit in ((24, 64), (48, 128), (8, 1), (15, 128)):
        damaged = bytearray(whole)
        damaged[heap + at] ^= bit
        (tmp_path / "b.h5").write_bytes(damaged)
        with pytest.raises(FileError) as caught:
            read_headers(tmp_path / "b.h5")
        assert "is damaged" in caught.value.what


def test_different_listed_exposure_gives_a_warning(tmp_path):
    made(tmp_path / "a.h5", exposure_s=0.01)
    (tmp_path / "protocol.yaml").write_text(
        "photosite_protocol: 1\nframes: [{kind: dark, exposure: 10, files: a.h5}]\n"
    )
    with pytest.warns(PhotositeWarning, match=r"3 files state another exposure.*0\.01 s, listed 10 s"):
        assert open_frames(tmp_path).groups[0].exposure_s == 10.0


@pytest.mark.parametrize("libver", ["earliest", "latest"])
@pytest.mark.parametrize("value", ["RG/GB", ["dark", "dark"]])
def test_text_longer_than_the_file_is_an_error(tmp_path, libver, value):
    """libhdf5 may allocate the stated length, up to 4 GiB; it does so in the child process."""
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
    with pytest.raises(FileError) as caught:
        read_headers(path)
    assert "attributes cannot be read" in caught.value.what


def test_lists_of_variable_length_are_not_read(tmp_path):
    """Damage turns text into lists, which can crash libhdf5; netCDF's lists of references are valid."""
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
    with pytest.raises(FileError) as caught:
        read_raw(file)
    assert caught.value.where == "/data: kind"


def elsewhere(path, name, kind, data):
    """Write a file whose dataset `name` is in another file."""
    other = path.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file["secret"] = data
    with h5py.File(path, "w") as file:
        if kind == "link":
            file["frames"] = np.zeros((4, 4), np.uint16)
            file[name] = h5py.ExternalLink("other.h5", "/secret")
        elif kind == "storage":
            file.create_dataset(name, data.shape, data.dtype, external=[(str(other), 0, data.nbytes)])
        else:
            layout = h5py.VirtualLayout(data.shape, data.dtype)
            layout[:] = h5py.VirtualSource("other.h5", "secret", data.shape)
            file.create_virtual_dataset(name, layout)


@pytest.mark.parametrize("kind", ["link", "storage", "virtual"])
@pytest.mark.parametrize(("read", "name"), [(read_raw, "dn"), (read_maps, "offset"), (load_hdf5, "psf")])
def test_data_in_another_file_are_not_read(tmp_path, kind, read, name):
    """A file of unknown origin must not show the content of the user's other files."""
    path = tmp_path / "a.h5"
    elsewhere(path, name, kind, np.arange(64, dtype=np.uint16).reshape(8, 8))
    with pytest.raises(FileError) as caught:
        read(path)
    assert caught.value.where == f"/{name}"


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("dtype", ["u1", "<u2", ">u2", "u4"])
@pytest.mark.parametrize("chunks", [(1, 4, 5), (2, 7, 11), (3, 12, 16)])
def test_compressed_stacks_are_those_of_h5py(tmp_path, chunks, dtype, shuffle):
    """Chunks that end beyond the frame, with several frames each, and one that was never written."""
    stack = np.random.default_rng(1).integers(0, 200, (5, 12, 16)).astype(dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        options = {"shape": stack.shape, "dtype": stack.dtype, "chunks": chunks, "compression": "gzip"}
        data = file.create_dataset("light/10ms", shuffle=shuffle, fillvalue=7, **options)
        data[:4] = stack[:4]
        file.attrs["bits"] = 16 if stack.dtype.itemsize < 4 else 20
        expected = data[()]
    for k, header in enumerate(read_headers(tmp_path / "a.h5")):
        np.testing.assert_array_equal(read_pixels(tmp_path / "a.h5", header.location), expected[k])


def test_damaged_compression_is_an_error(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset(
            "frame", data=np.arange(64, dtype=np.uint16).reshape(8, 8), chunks=(8, 8), compression="gzip"
        )
        data.attrs["bits"] = 12
        place = data.id.get_chunk_info(0)
    content = bytearray((tmp_path / "a.h5").read_bytes())
    content[place.byte_offset + 4 : place.byte_offset + place.size - 4] = bytes(place.size - 8)
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.h5")
    assert "a.h5" in str(caught.value)
