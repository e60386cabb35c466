"""Frames that were saved as JPEG, by Pillow."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from photosite.calibration.calibrate import calibrate
from photosite.calibration.checks.compression import concentration
from photosite.frames.frame_set import FrameSet

READ_DN = 0.6


def stack(quality: int | None, seed: int, gain: float = 0.05, shape: tuple[int, int] = (96, 128)) -> FrameSet:
    """Return frames of 8 bits through JPEG of a quality, or as they are."""
    rng = np.random.default_rng([seed, 3])
    offset, response = rng.normal(8.0, 0.15, shape), 1.0 + rng.normal(0.0, 0.01, shape)

    def frame(electrons: float) -> np.ndarray:
        dn = gain * rng.poisson(electrons * response) + offset + rng.normal(0.0, READ_DN, shape)
        numbers = np.clip(np.rint(dn), 0, 255).astype(np.uint8)
        if quality is not None:
            file = io.BytesIO()
            Image.fromarray(numbers).save(file, "JPEG", quality=quality)
            numbers = np.asarray(Image.open(file))
        return numbers.astype(np.uint16)

    levels = [("light", 0.01 * k, frame(0.09 / gain * 245.0 * k)) for k in range(1, 11) for _ in range(6)]
    return FrameSet.from_arrays([("dark", 0.01, frame(0.0)) for _ in range(16)] + levels, bits=8)


def found(frames: FrameSet) -> bool:
    return "jpeg-frames" in {entry.id for entry in calibrate(frames).diagnostics}


@pytest.mark.parametrize("quality", [100, 98, 95])
def test_compressed_frames_are_named(quality: int) -> None:
    assert found(stack(quality, 1))


@pytest.mark.parametrize("gain", [0.02, 0.05, 0.5])
def test_uncompressed_frames_are_not(gain: float) -> None:
    assert not found(stack(None, 2, gain))


@pytest.mark.parametrize("sigma", [0.3, 0.75, 1.5])
def test_fractions_of_uncompressed_frames_are_even(sigma: float) -> None:
    """Blocks of 40 frames together; a mean cosine beyond 5 standard errors occurs once in a million."""
    frames = np.random.default_rng(5).normal(90.3, sigma, (40, 128, 128)).round().astype(np.uint8)
    means, counts = np.array([concentration(frame) for frame in frames]).T
    if counts.sum():
        assert abs(means @ counts) < 5.0 * np.sqrt(counts.sum() / 2.0)
