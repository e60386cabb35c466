"""PNG pictures, read back by other decoders."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from photosite.develop.picture import save_picture
from photosite.errors import FileError, InputError


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(4).random((37, 23, 3), dtype=np.float32)


def test_8_bits_through_pillow(picture: np.ndarray, tmp_path: Path) -> None:
    save_picture(picture, tmp_path / "p.png")
    with Image.open(tmp_path / "p.png") as image:
        assert image.mode == "RGB"
        assert image.info["srgb"] == 0
        np.testing.assert_array_equal(np.asarray(image), np.rint(picture * 255))


def test_16_bits_by_the_standard(picture: np.ndarray, tmp_path: Path) -> None:
    """Pillow reduces 16-bit colour to 8 bits, so the chunks are parsed by ISO/IEC 15948; Pillow checks the CRCs."""
    save_picture(picture, tmp_path / "p.png", bits=16)
    with Image.open(tmp_path / "p.png") as image:
        image.verify()
    data = (tmp_path / "p.png").read_bytes()
    at, chunks = 8, {}
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        chunks[kind] = data[at + 8 : at + 8 + length]
        at += 12 + length
    assert struct.unpack(">IIBBBBB", chunks[b"IHDR"]) == (23, 37, 16, 2, 0, 0, 0)
    lines = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(37, 1 + 23 * 6)
    assert not lines[:, 0].any()
    values = lines[:, 1:].copy().view(">u2").reshape(37, 23, 3)
    np.testing.assert_array_equal(values, np.rint(picture * 65535))


@pytest.mark.parametrize(
    ("shape", "value", "name", "bits"),
    [
        ((4, 4), 0.5, "p.png", 8),
        ((4, 4, 4), 0.5, "p.png", 8),
        ((0, 4, 3), 0.5, "p.png", 8),
        ((4, 4, 3), 1.5, "p.png", 8),
        ((4, 4, 3), -0.1, "p.png", 8),
        ((4, 4, 3), float("nan"), "p.png", 8),
        ((4, 4, 3), 0.5, "p.jpg", 8),
        ((4, 4, 3), 0.5, "p.png", 12),
    ],
)
def test_invalid_arguments(shape: tuple[int, ...], value: float, name: str, bits: int, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        save_picture(np.full(shape, value, np.float32), tmp_path / name, bits=bits)
    assert list(tmp_path.iterdir()) == []


def test_missing_folder(picture: np.ndarray, tmp_path: Path) -> None:
    with pytest.raises(FileError):
        save_picture(picture, tmp_path / "nowhere" / "p.png")
