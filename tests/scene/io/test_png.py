"""PNG of 16 bits a channel, from an encoder written from the standard, and against 8 bits of the same picture."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from raising import raises

from photosite.errors import FileError
from photosite.scene.io.formats import read_scene
from photosite.scene.io.picture import TRANSPARENT, read_alpha
from photosite.scene.pictures import from_rgb

KINDS = {1: 0, 2: 4, 3: 2, 4: 6}
ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
Parts = list[tuple[bytes, bytes]]


def picture(channels: int, rows: int = 11, cols: int = 13) -> np.ndarray:
    """Noise, with a patch of equal neighbors."""
    codes = np.random.default_rng(channels).integers(0, 65536, (rows, cols, channels)).astype(np.uint16)
    codes[3:6, 2:9] = codes[3, 2]
    return codes


def paeth(a: int, b: int, c: int) -> int:
    p = a + b - c
    return min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]


def filtered(codes: np.ndarray, filters: list[int]) -> bytes:
    """ISO/IEC 15948, 9.2, byte by byte."""
    rows, _, channels = codes.shape
    step, out = 2 * channels, bytearray()
    above = bytes(codes[0].size * 2)
    for r in range(rows):
        line = codes[r].astype(">u2").tobytes()
        kind = filters[r % len(filters)]
        out.append(kind)
        for i, x in enumerate(line):
            a, b, c = (line[i - step] if i >= step else 0), above[i], (above[i - step] if i >= step else 0)
            out.append((x - (0, a, b, (a + b) // 2, paeth(a, b, c))[kind]) % 256)
        above = line
    return bytes(out)


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def encoded(
    codes: np.ndarray, filters: list[int] | None = None, extra: Parts | None = None, interlaced: bool = False
) -> bytes:
    rows, cols, channels = codes.shape
    filters = filters or [0, 1, 2, 3, 4]
    passes = [codes[r::down, c::right] for r, c, down, right in ADAM7] if interlaced else [codes]
    data = zlib.compress(b"".join(filtered(part, filters) for part in passes if part.size))
    cuts = [0, len(data) // 3, len(data) // 3, len(data)]  # three chunks, one of them empty
    head = struct.pack(">IIBBBBB", cols, rows, 16, KINDS[channels], 0, 0, int(interlaced))
    parts = [(b"IHDR", head), *(extra or []), *((b"IDAT", data[a:b]) for a, b in pairwise(cuts)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def written(path: Path, codes: np.ndarray, **how: object) -> Path:
    path.write_bytes(encoded(codes, **how))  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("filters", [[0], [1], [2], [3], [4], [4, 3, 2, 1, 0]], ids=str)
@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_scene_keeps_all_16_bits(tmp_path: Path, channels: int, filters: list[int], interlaced: bool) -> None:
    codes = picture(channels)
    file = written(tmp_path / "a.png", codes, filters=filters, interlaced=interlaced)
    scene = read_scene(file, mean_luminance_cd_m2=12.0, illuminant="A")
    wanted = from_rgb(np.repeat(codes, 3 // channels, axis=2), "A", 12.0)
    np.testing.assert_array_equal(scene.weights, wanted.weights)


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (2, 3), (8, 8), (9, 17)])
def test_interlaced_pictures_of_few_pixels(tmp_path: Path, size: tuple[int, int]) -> None:
    codes = picture(1, 9, 17)[: size[0], : size[1]]
    found = read_alpha(written(tmp_path / "a.png", codes, interlaced=True))
    np.testing.assert_array_equal(found, (codes[:, :, 0] / np.float32(65535)).astype(np.float32))


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize("orientation", [None, *range(1, 9)])
def test_8_and_16_bits_of_one_picture(tmp_path: Path, orientation: int | None, behind: bool) -> None:
    """257 times a code of 8 bits is the same value in 16, with the same orientation; EXIF before or behind pixels."""
    codes = (picture(3) >> 8).astype(np.uint8)
    exif = Image.Exif()
    if orientation is not None:
        exif[0x0112] = orientation
    Image.fromarray(codes).save(tmp_path / "8.png", exif=exif)
    extra = [(b"eXIf", exif.tobytes()[6:])] if orientation else []
    written(tmp_path / "16.png", codes.astype(np.uint16) * 257, extra=[] if behind else extra)
    if behind:
        content = (tmp_path / "16.png").read_bytes()
        (tmp_path / "16.png").write_bytes(content[:-12] + b"".join(chunk(*part) for part in extra) + content[-12:])
    scenes = [read_scene(tmp_path / name, mean_luminance_cd_m2=40) for name in ("8.png", "16.png")]
    np.testing.assert_allclose(scenes[1].weights, scenes[0].weights, atol=1e-7)


def test_the_icc_profile_is_used(tmp_path: Path, profile: Callable[..., bytes]) -> None:
    codes = np.clip(picture(3), 24000, 40000)
    file = written(tmp_path / "a.png", codes, extra=[(b"iCCP", b"any\0\0" + zlib.compress(profile("", "Display P3")))])
    found = read_scene(file, mean_luminance_cd_m2=40).weights
    np.testing.assert_array_equal(found, from_rgb(codes, space="Display P3").weights)


SRGB_PRIMARIES = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
P3_PRIMARIES = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)


def test_primaries_of_srgb_are_accepted(tmp_path: Path) -> None:
    for extra in ([(b"cHRM", SRGB_PRIMARIES)], [(b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", 45455))]):
        file = written(tmp_path / "a.png", picture(3), extra=extra)
        assert read_scene(file, mean_luminance_cd_m2=1).shape == (11, 13)


@pytest.mark.parametrize(
    ("extra", "what"),
    [
        ([(b"iCCP", b"name\0\0" + zlib.compress(b"nothing"))], "ICC profile that cannot be used"),
        ([(b"iCCP", b"name\0\0nothing")], "ICC profile that cannot be decompressed"),
        ([(b"gAMA", struct.pack(">I", 100_000))], "gamma (gAMA)"),
        ([(b"cHRM", P3_PRIMARIES)], "primaries and white"),
        ([(b"cICP", b"\x09\x10\0\x01")], "code points (cICP)"),
    ],
)
@pytest.mark.parametrize("bits", [8, 16])
def test_unknown_color_spaces_are_an_error(tmp_path: Path, extra: Parts, what: str, bits: int) -> None:
    file = tmp_path / "a.png"
    if bits == 16:
        written(file, picture(3), extra=extra)
    else:
        Image.fromarray((picture(3) >> 8).astype(np.uint8)).save(file)
        plain = file.read_bytes()
        file.write_bytes(plain[:33] + b"".join(chunk(*part) for part in extra) + plain[33:])
    with pytest.raises(FileError) as caught:
        read_scene(file, mean_luminance_cd_m2=1.0)
    assert what in caught.value.what


def assert_transparent(file: Path) -> None:
    with raises(FileError, TRANSPARENT):
        read_scene(file, mean_luminance_cd_m2=1)


@pytest.mark.parametrize("channels", [1, 3])
def test_transparent_pictures_are_an_error_and_opaque_ones_are_read(tmp_path: Path, channels: int) -> None:
    codes = picture(channels)
    alpha = np.full((*codes.shape[:2], 1), 65535, np.uint16)
    opaque = read_scene(written(tmp_path / "a.png", np.dstack([codes, alpha])), mean_luminance_cd_m2=1)
    plain = read_scene(written(tmp_path / "b.png", codes), mean_luminance_cd_m2=1)
    np.testing.assert_array_equal(opaque.weights, plain.weights)
    alpha[5, 6] = 65534  # invisible in 8 bits
    assert_transparent(written(tmp_path / "a.png", np.dstack([codes, alpha])))
    clear = codes[4, 4]
    assert_transparent(written(tmp_path / "a.png", codes, extra=[(b"tRNS", clear.astype(">u2").tobytes())]))
    other = np.full(channels, 1, np.uint16)
    assert not (codes == other).all(axis=2).any()
    file = written(tmp_path / "a.png", codes, extra=[(b"tRNS", other.astype(">u2").tobytes())])
    np.testing.assert_array_equal(read_scene(file, mean_luminance_cd_m2=1).weights, plain.weights)


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_opacity_of_16_bits(tmp_path: Path, channels: int) -> None:
    codes = picture(channels)
    np.testing.assert_array_equal(
        read_alpha(written(tmp_path / "a.png", codes)), (codes[:, :, -1] / np.float32(65535)).astype(np.float32)
    )


def test_opacity_in_color_is_an_error(tmp_path: Path) -> None:
    with raises(FileError, "opacity"):
        read_alpha(written(tmp_path / "a.png", picture(3)))


def header(**changes: int) -> bytes:
    fields = {"cols": 13, "rows": 11, "bits": 16, "kind": 2, "method": 0, "filter": 0, "interlaced": 0} | changes
    return chunk(b"IHDR", struct.pack(">IIBBBBB", *fields.values()))


def with_filter(kind: int, interlaced: int) -> bytes:
    """A file one row of which has another filter."""
    codes = picture(3)
    passes = [codes[r::down, c::right] for r, c, down, right in ADAM7] if interlaced else [codes]
    data = [bytearray(filtered(part, [0])) for part in passes]
    data[-1][2 * (1 + 13 * 6)] = kind
    body = header(interlaced=interlaced) + chunk(b"IDAT", zlib.compress(b"".join(data))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: whole[:-300],
        lambda whole: whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:],
        lambda whole: whole[:8] + header(rows=12) + whole[33:],
        lambda whole: whole[:8] + header(rows=1 << 20) + whole[33:],
        lambda whole: whole[:8] + header(kind=3) + whole[33:],
        lambda whole: whole[:8] + header(interlaced=2) + whole[33:],
        lambda whole: whole[:33] + chunk(b"tRNS", b"\0\1") + whole[33:],
        lambda whole: whole[:33] + chunk(b"IDAT", b"xyz") + whole[33:],
        lambda whole: whole[:33] + chunk(b"IEND", b"") + whole[33:],
        lambda whole: with_filter(5, interlaced=0),
        lambda whole: with_filter(9, interlaced=1),
    ],
)
def test_damaged_pictures_are_an_error(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    file = tmp_path / "a.png"
    file.write_bytes(damage(encoded(picture(3))))
    with pytest.raises(FileError) as caught:
        read_scene(file, mean_luminance_cd_m2=1)
    assert "is damaged" in caught.value.what
    assert "\n" not in str(caught.value)
