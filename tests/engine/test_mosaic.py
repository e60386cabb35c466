"""The spectrum of a kernel at the frequencies of a large frame, compared with the direct sum."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.engine.mosaic import TAPS, Gridding, _kernel_line


def summed(kernel: NDArray[np.float64], rows: int, cols: int) -> NDArray[np.complex128]:
    """(rows, cols // 2 + 1): sum over the kernel's cells, term by term in double precision."""
    shift = np.arange(len(kernel)) - len(kernel) // 2
    down = np.exp(-2j * np.pi * np.arange(rows)[:, None] * shift / rows)
    across = np.exp(-2j * np.pi * np.arange(cols // 2 + 1)[:, None] * shift / cols)
    return np.asarray(down @ kernel @ across.T)


def interpolated(kernels: NDArray[np.float64], rows: int, cols: int) -> NDArray[np.complex64]:
    gridding = Gridding.of(kernels.shape[1], rows)
    table = gridding.table(kernels, cols).view(np.float32)
    out = np.empty((len(kernels), rows, table.shape[2]), np.float32)
    for channel, lines in enumerate(table):
        for row in range(rows):
            _kernel_line(out[channel, row], lines, gridding.first[row], gridding.taps[row])
    return out.view(np.complex64)


@pytest.mark.parametrize(("size", "rows", "cols"), [(65, 200, 180), (65, 97, 131), (75, 40, 60), (99, 30, 32)])
def test_spectrum_of_a_kernel_is_accurate_to_a_millionth(size: int, rows: int, cols: int) -> None:
    """For kernels that are large in all corners, the worst case, and for kernels wider than the frame."""
    kernels = np.random.default_rng(5).random((2, size, size))
    got = interpolated(kernels, rows, cols)
    for ours, kernel in zip(got, kernels, strict=True):
        assert np.abs(ours - summed(kernel, rows, cols)).max() < 1e-6 * kernel.sum()


def test_shift_is_a_phase_with_the_right_sign() -> None:
    """One cell down and two to the right: exp(-2 pi i (fy + 2 fx)), exact to single precision."""
    kernel = np.zeros((1, 65, 65))
    kernel[0, 33, 34] = 1
    fy, fx = np.arange(64)[:, None] / 64, np.arange(41)[None, :] / 80
    assert np.abs(interpolated(kernel, 64, 80)[0] - np.exp(-2j * np.pi * (fy + 2 * fx))).max() < 1e-6


def test_only_the_nearest_rows_contribute() -> None:
    gridding = Gridding.of(65, 300)
    position = np.arange(300) * 130 / 300
    nearest = (gridding.first[:, None] + np.arange(TAPS)) % 130
    distance = np.abs((nearest - position[:, None] + 65) % 130 - 65)
    assert distance.max() <= TAPS / 2
