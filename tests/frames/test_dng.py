"""DNG written by photosite, read by LibRaw and tifffile."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
import rawpy
import tifffile
from raising import raises

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.frames.io.formats import read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from, channel_names, plane_names, tile_text

BAYER = ("rggb", "bggr", "gbrg", "grbg")

# sRGB's primaries and white as LibRaw has them (its xyz_rgb).
SRGB_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
MATRIX_RGB = np.array([[0.84, -0.22, -0.08], [-0.41, 1.25, 0.17], [-0.06, 0.18, 0.66]])
"""XYZ to camera, rows R, G, B."""

READER = """
import json, sys
import numpy as np, rawpy
seen = []
for path in sys.argv[1:]:
    expected = np.load(path.replace(".dng", ".npy"))
    with rawpy.imread(path) as raw:
        pattern = raw.raw_pattern
        seen.append({
            "raw": np.array_equal(raw.raw_image, expected),
            "visible": np.array_equal(raw.raw_image_visible, expected),
            "dtype": str(raw.raw_image.dtype),
            "black": list(map(int, raw.black_level_per_channel)),
            "white": int(raw.white_level),
            "colours": raw.num_colors,
            "pattern": "".join(chr(raw.color_desc[n]) for n in pattern.ravel()) if raw.num_colors > 1 else "",
            "to_srgb": raw.color_matrix[:, :3].tolist(),
            "xyz_to_camera": raw.rgb_xyz_matrix.tolist(),
            "balance": raw.camera_whitebalance[:3],
            "shutter_s": raw.other.shutter_speed,
        })
print(json.dumps(seen))
"""


def in_a_fresh_process(paths) -> list[dict]:
    """Read the files with LibRaw in a process without photosite."""
    done = subprocess.run(
        [sys.executable, "-I", "-c", READER, *map(str, paths)], capture_output=True, text=True, check=True, timeout=120
    )
    return json.loads(done.stdout)


def saved(path, frame: RawFrame):
    np.save(path.with_suffix(".npy"), frame.dn)
    frame.save(path)
    return path


def make_frame(shape, bits, cfa, **fields) -> RawFrame:
    dn = np.random.default_rng(bits).integers(0, 1 << bits, shape, dtype=np.uint16)
    dn[0, 0], dn[-1, -1] = (1 << bits) - 1, 0
    return RawFrame(dn, bits=bits, cfa=cfa_from(cfa), **fields)


def test_libraw_reads_the_same_pixels(tmp_path):
    """Odd sizes, every Bayer order and mono, every depth: pixels, levels, pattern, exposure."""
    cases = [
        (shape, bits, cfa)
        for shape in ((22, 22), (23, 25), (101, 76), (64, 129))
        for bits in (10, 12, 14, 16)
        for cfa in (*BAYER, "mono")
    ]
    paths = [
        saved(
            tmp_path / f"{number}.dng",
            make_frame(shape, bits, cfa, black_level_dn=float(number), exposure_s=(number + 1) / 8000),
        )
        for number, (shape, bits, cfa) in enumerate(cases)
    ]
    for number, (case, seen) in enumerate(zip(cases, in_a_fresh_process(paths), strict=True)):
        _, bits, cfa = case
        assert seen["raw"], case
        assert seen["visible"], case
        assert seen["dtype"] == "uint16"
        assert seen["black"] == [number] * 4, case
        assert seen["white"] == (1 << bits) - 1, case
        assert seen["pattern"] == ("" if cfa == "mono" else cfa.upper()), case
        assert seen["colours"] == (1 if cfa == "mono" else 3), case
        assert seen["shutter_s"] == np.float32((number + 1) / 8000), case


def test_the_d200_at_full_size(tmp_path):
    frame = make_frame((2592, 3872), 12, "rggb", metadata=MappingProxyType({"camera": "Nikon D200"}))
    (seen,) = in_a_fresh_process([saved(tmp_path / "d200.dng", frame)])
    assert seen["raw"]
    assert seen["visible"]
    assert (seen["white"], seen["pattern"]) == (4095, "RGGB")
    assert np.array_equal(read_raw(tmp_path / "d200.dng").dn, frame.dn)


def test_libraw_uses_the_colour_matrix(tmp_path):
    """LibRaw's camera to sRGB is the inverse of (XYZ to camera)(sRGB to XYZ), its rows summing to 1.

    The rows are in the tile's order of channels, so that confused planes and channels show. The camera is called
    Nikon D200 because LibRaw has its own matrix and white level for that name.
    """
    neutral = [0.75, 1.0, 0.3125]
    metadata = {"camera": "Nikon D200", "as_shot_neutral": ",".join(map(str, neutral))}
    paths = []
    for cfa in BAYER:
        frame = make_frame((30, 30), 12, cfa, metadata=metadata)
        rows = ["RGB".index(name) for name in frame.channels]
        paths.append(saved(tmp_path / f"{cfa}.dng", replace(frame, color_matrix=MATRIX_RGB[rows])))
    to_camera = MATRIX_RGB @ SRGB_TO_XYZ
    to_camera /= to_camera.sum(axis=1, keepdims=True)
    for seen in in_a_fresh_process(paths):
        np.testing.assert_allclose(seen["to_srgb"], np.linalg.inv(to_camera), rtol=0, atol=2e-6)
        assert not np.any(seen["xyz_to_camera"])  # LibRaw's own table is not used
        assert seen["white"] == 4095
        np.testing.assert_allclose(seen["balance"], 1 / np.array(neutral), rtol=1e-6)


@pytest.mark.parametrize("cfa", ["gbrg", "mono"])
def test_tags_as_tifffile_reads_them(tmp_path, cfa):
    mono = cfa == "mono"
    channels = ("M",) if mono else ("G", "B", "R")
    noise = {"M": (1e-4, 1e-7), "R": (1e-4, 1e-7), "G": (2e-4, 2e-7), "B": (3e-4, 3e-7)}
    frame = make_frame(
        (24, 31),
        14,
        cfa,
        black_level_dn=64.3,
        white_level_dn=16000.0,
        exposure_s=1 / 3,
        color_matrix=None if mono else MATRIX_RGB[[1, 2, 0]],
        noise_profile=np.array([noise[name] for name in channels]),
        metadata=MappingProxyType({"camera": "Kamera µ", "iso": 200}),
    )
    frame.save(tmp_path / "a.dng")
    with tifffile.TiffFile(tmp_path / "a.dng") as file:
        assert len(file.pages) == 1
        assert np.array_equal(file.pages.first.asarray(), frame.dn)
        tags = {tag.code: tag.value for tag in file.pages.first.tags.values()}
    assert tags[262] == (34892 if mono else 32803)
    assert tags[50706] == b"\x01\x04\x00\x00"
    assert tags[50708] == "photosite Kamera ?"
    assert (tags[271], tags[272], tags[274], tags[34855]) == ("photosite", "Kamera ?", 1, 200)
    assert tags[33434] == (1, 3)
    assert tags[50714] == (643, 10)
    assert tags[50717] == 16000
    assert tags[50829] == (0, 0, 24, 31)
    assert (tags[50719], tags[50720]) == ((0, 0), (31, 24))
    planes = ("M",) if mono else ("R", "G", "B")
    assert np.reshape(tags[51041], (-1, 2)).tolist() == [list(noise[name]) for name in planes]
    if mono:
        assert not {33421, 33422, 50710, 50711, 50721, 50728} & set(tags)
        return
    assert (tags[33421], tags[33422], tags[50710], tags[50711]) == ((2, 2), b"\1\2\0\1", b"\0\1\2", 1)
    ratios = np.reshape(tags[50721], (9, 2)).astype(np.float64)
    np.testing.assert_allclose((ratios[:, 0] / ratios[:, 1]).reshape(3, 3), MATRIX_RGB, rtol=1e-9)
    assert tags[50778] == 21
    assert 50728 not in tags  # the light is unknown


def test_black_levels_with_a_fraction(tmp_path):
    """The tag holds the fraction and photosite reads it; LibRaw truncates it."""
    levels = [0.5, 63.9999, 256 / 3, 1e-6, 1000.123456789]
    paths = []
    for number, black in enumerate(levels):
        path = saved(tmp_path / f"{number}.dng", make_frame((24, 24), 12, "rggb", black_level_dn=black))
        assert read_raw(path).black_level_dn == black
        with tifffile.TiffFile(path) as file:
            top, bottom = file.pages.first.tags[50714].value
        assert top / bottom == pytest.approx(black, rel=1e-9)
        paths.append(path)
    for black, seen in zip(levels, in_a_fresh_process(paths), strict=True):
        assert seen["raw"]
        assert seen["black"] == [int(black)] * 4


def test_frames_too_small_for_libraw_are_written_with_a_warning(tmp_path):
    frame = make_frame((8, 30), 12, "rggb")
    with pytest.warns(PhotositeWarning, match="8 x 30 pixels; .* smaller than 22 x 22"):
        frame.save(tmp_path / "a.dng")
    assert np.array_equal(read_raw(tmp_path / "a.dng").dn, frame.dn)


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"cfa": [["R", "G", "B"]]}, "cfa"),
        ({"white_level_dn": 4000.5}, "white_level_dn"),
        ({"exposure_s": 1e-12}, "exposure_s"),
        ({"color_matrix": np.eye(2)}, "color_matrix"),
        ({"color_matrix": -np.eye(3)}, "color_matrix"),
        ({"color_matrix": np.eye(3), "metadata": {"as_shot_neutral": "1,0,1"}}, "as_shot_neutral"),
        ({"color_matrix": np.eye(3), "metadata": {"as_shot_neutral": "A"}}, "as_shot_neutral"),
        ({"noise_profile": np.ones((1, 2))}, "noise_profile"),
    ],
)
def test_frames_that_dng_cannot_hold(tmp_path, fields, what):
    fields = {"cfa": "rggb"} | fields
    frame = make_frame((24, 24), 12, **fields)
    with raises(InputError, what):
        frame.save(tmp_path / "a.dng")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("code", "value", "what"), [(50717, 4000, "white level"), (33422, b"\2\1\1\0", "color filter array")]
)
def test_an_edited_dng(tmp_path, code, value, what):
    make_frame((24, 24), 12, "rggb").save(tmp_path / "a.dng")
    with tifffile.TiffFile(tmp_path / "a.dng", mode="r+") as file:
        file.pages.first.tags[code].overwrite(value)
    with raises(FileError, f"the file was edited: its tags state {what}"):
        read_raw(tmp_path / "a.dng")


@pytest.mark.parametrize("tile", ["x-trans", "rccb", "ryycy", "RG/WB", "YCy/GM", "RB/GG", "RG/GW"])
def test_libraw_reads_other_mosaics(tile, tmp_path):
    """The visible raw, and which pixels have one color, in the order of the rows of ColorMatrix."""
    cfa = cfa_from(tile)
    rng, names = np.random.default_rng(9), channel_names(cfa)
    matrix, profile = rng.uniform(0.1, 1, (len(names), 3)), rng.uniform(1e-5, 1e-4, (len(names), 2))
    neutral = ",".join(map(str, np.linspace(1, 0.5, len(names))))
    dn = rng.integers(64, 4096, (36, 42)).astype(np.uint16)
    frame = RawFrame(
        *(dn, 12, cfa), black_level_dn=64, color_matrix=matrix, noise_profile=profile,
        metadata={"as_shot_neutral": neutral},
    )  # fmt: skip
    frame.save(tmp_path / "a.dng")
    with rawpy.imread(str(tmp_path / "a.dng")) as decoder:
        np.testing.assert_array_equal(decoder.raw_image_visible, dn)
        colors = decoder.raw_colors_visible[: len(cfa), : len(cfa[0])].copy()
        white_balance = decoder.camera_whitebalance
    if len(names) == 3:
        colors[colors == 3] = 1  # the second green
    numbers = {name: set(colors[[[c == name for c in row] for row in cfa]].tolist()) for name in names}
    assert sorted(map(len, numbers.values())) == [1] * len(names)
    order = [next(iter(numbers[name])) for name in names]
    assert sorted(order) == list(range(len(names)))
    of_plane = dict(zip(plane_names(cfa), np.linspace(1, 0.5, len(names)), strict=True))
    for name, number in zip(names, order, strict=True):
        assert white_balance[number] == pytest.approx(1 / of_plane[name], rel=1e-4)
    read = read_raw(tmp_path / "a.dng")
    assert (read.cfa, read.as_shot_neutral) == (cfa, frame.as_shot_neutral)
    np.testing.assert_allclose(read.color_matrix, matrix, rtol=1e-12)
    # Without photosite's own description, from the tags alone.
    with tifffile.TiffFile(tmp_path / "a.dng", mode="r+") as file:
        file.pages.first.tags["ImageDescription"].overwrite("")
    tags = read_raw(tmp_path / "a.dng")
    assert tags.cfa == tuple(tuple("W" if name == "C" else name for name in row) for row in cfa)
    np.testing.assert_allclose(tags.color_matrix, matrix, rtol=1e-6)
    np.testing.assert_allclose(tags.noise_profile, profile, rtol=1e-12)
    np.testing.assert_allclose(tags.as_shot_neutral, frame.as_shot_neutral, rtol=1e-4)


@pytest.mark.parametrize("tile", ["quad-rggb", "rgbw", "rgb-ir", "polarization", "polarization-rggb", "RW/CB"])
def test_other_mosaics_need_another_format(tile, tmp_path):
    cfa = cfa_from(tile)
    frame = RawFrame(np.full((24, 24), 100, np.uint16), bits=12, cfa=cfa)
    with raises(InputError, "cfa", value=tile_text(cfa), hint="Save as TIFF (.tif) or HDF5 (.h5)"):
        frame.save(tmp_path / "a.dng")
    for name in ("a.tif", "a.h5", "a.png"):
        frame.save(tmp_path / name)
        assert read_raw(tmp_path / name).cfa == cfa
