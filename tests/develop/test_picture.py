"""PNG pictures, read back by other decoders."""

from __future__ import annotations

from pathlib import Path

import imagecodecs
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


def test_16_bits(picture: np.ndarray, tmp_path: Path) -> None:
    """Pillow checks the chunks; it reduces 16-bit color to 8 bits, so imagecodecs decodes the values."""
    save_picture(picture, tmp_path / "p.png", bits=16)
    with Image.open(tmp_path / "p.png") as image:
        image.verify()
        assert image.info["srgb"] == 0
    values = imagecodecs.png_decode((tmp_path / "p.png").read_bytes())
    assert values.dtype == np.uint16
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
