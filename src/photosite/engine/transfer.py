"""From weight maps to channel images in the frequency domain: one sum over maps, one inverse a channel.

The maps are constant over square cells, one or more a pixel. A pixel reads the map, spread by the lens and the cell,
averaged over its photodetector, at its centre: exactly the discrete convolution with the kernel
`(spread * aperture * cell)(pixel centre - cell centre)`. That kernel's transform is the continuous one folded at the
sampling frequency,

    H(f) = sum_m transfer(|f + m fs|) aperture(f + m fs) cell(f + m fs),

and because the lens passes nothing beyond its cutoff the sum is short. Without the folded terms the kernel would
ring, and dark samples beside bright ones would come out negative. At f = 0 only m = 0 is left: a uniform field keeps
its value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

_FOLD_NODES = 65
"""Nodes of each axis on which the folded terms are computed before cubic interpolation."""


@dataclass(frozen=True, eq=False)
class Sampling:
    """The grid of cells and the photodetector on it. Lengths in m.

    Parameters
    ----------
    pitch_m
        (along rows, along columns): distance of pixels vertically and horizontally.
    detector_m
        (vertical, horizontal) size of the photodetector, centred in the pixel.
    cells_per_pixel
        On each axis; odd, so that a cell lies at the pixel's centre.
    """

    pitch_m: tuple[float, float]
    detector_m: tuple[float, float]
    cells_per_pixel: int = 1

    def cell_m(self, axis: int) -> float:
        """Size of a cell on an axis, 0 vertical, 1 horizontal."""
        return self.pitch_m[axis] / self.cells_per_pixel

    def aperture(self, axis: int, frequency_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transfer of photodetector and cell on an axis: two sinc functions."""
        product: NDArray[np.float64] = np.sinc(frequency_per_m * self.detector_m[axis]) * np.sinc(
            frequency_per_m * self.cell_m(axis)
        )
        return product


@dataclass(frozen=True, eq=False)
class RadialTransfer:
    """Transfer of a rotationally symmetric lens, summed over wavelength, for each channel and map.

    Parameters
    ----------
    table
        (channels, maps, nodes) at frequencies 0, step, 2 step, ...; linear between, 0 beyond.
    step_per_m
        Distance of nodes, cycles/m.
    """

    table: NDArray[np.float64]
    step_per_m: float

    @property
    def reach_per_m(self) -> float:
        """Frequency beyond which nothing passes."""
        return float(self.step_per_m * (self.table.shape[2] - 1))

    def at(self, frequency_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(channels, maps, ...) at frequencies of any shape."""
        nodes = self.table.shape[2]
        position = frequency_per_m / self.step_per_m
        index = np.minimum(position.astype(np.intp), nodes - 2)
        share = position - index
        values: NDArray[np.float64] = np.where(
            position <= nodes - 1,
            self.table[:, :, index] * (1 - share) + self.table[:, :, index + 1] * share,
            0.0,
        )
        return values


def folded(
    transfer: RadialTransfer, sampling: Sampling, fy_per_m: NDArray[np.float64], fx_per_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(channels, maps, fy, fx): the terms with m other than 0, at frequencies up to half the sampling frequency."""
    rate = [1.0 / sampling.cell_m(axis) for axis in (0, 1)]
    most = [int(np.ceil(transfer.reach_per_m / r + 0.5)) for r in rate]
    total = np.zeros((*transfer.table.shape[:2], fy_per_m.size, fx_per_m.size))
    for m in range(-most[0], most[0] + 1):
        fy = fy_per_m + m * rate[0]
        for n in range(-most[1], most[1] + 1):
            fx = fx_per_m + n * rate[1]
            near = np.hypot(np.abs(fy).min(), np.abs(fx).min())
            if (m, n) == (0, 0) or near > transfer.reach_per_m:
                continue
            aperture = sampling.aperture(0, fy)[:, None] * sampling.aperture(1, fx)[None, :]
            total += transfer.at(np.hypot(fy[:, None], fx[None, :])) * aperture
    return total


def channel_images(
    maps: NDArray[np.float32], transfer: RadialTransfer, sampling: Sampling, workers: int = -1
) -> NDArray[np.float32]:
    """Every channel's image at every cell.

    Parameters
    ----------
    maps
        (maps, rows, cols) on the cells, padded by the caller; the far edges count as neighbours.
    transfer, sampling
        What happens to them.
    workers
        Threads of the transforms; -1 takes all cores.

    Returns
    -------
    ndarray
        (channels, rows, cols) float32.
    """
    _, rows, cols = maps.shape
    fy = np.abs(np.fft.fftfreq(rows, sampling.cell_m(0))).astype(np.float64)
    fx = np.fft.rfftfreq(cols, sampling.cell_m(1)).astype(np.float64)
    fold = _fold_on_grid(transfer, sampling, fy, fx)
    aperture_y, aperture_x = sampling.aperture(0, fy), sampling.aperture(1, fx)
    spectra = np.zeros((transfer.table.shape[0], rows, fx.size), np.complex64)
    transforms = [scipy.fft.rfft2(m, workers=workers) for m in maps]
    for row in range(rows):
        direct = transfer.at(np.hypot(fy[row], fx)) * (aperture_y[row] * aperture_x)
        response = direct + fold(row)
        for k, transform in enumerate(transforms):
            spectra[:, row] += response[:, k] * transform[row]
    images = [scipy.fft.irfft2(spectrum, s=(rows, cols), workers=workers) for spectrum in spectra]
    return np.stack(images).astype(np.float32, copy=False)


class _fold_on_grid:  # noqa: N801 - a function with a table
    """The folded terms of one row of frequencies, interpolated by cubic splines on both axes."""

    def __init__(
        self, transfer: RadialTransfer, sampling: Sampling, fy: NDArray[np.float64], fx: NDArray[np.float64]
    ) -> None:
        from scipy.interpolate import make_interp_spline

        nodes = [np.linspace(0, 0.5 / sampling.cell_m(axis), _FOLD_NODES) for axis in (0, 1)]
        table = folded(transfer, sampling, *nodes)
        along_x = make_interp_spline(nodes[1], np.moveaxis(table, 3, 0), k=3)(fx)  # (fx, channels, maps, node)
        self._rows = make_interp_spline(nodes[0], np.moveaxis(along_x, 3, 0), k=3)  # -> (fx, channels, maps)
        self._fy = fy

    def __call__(self, row: int) -> NDArray[np.float64]:
        values: NDArray[np.float64] = np.moveaxis(self._rows(self._fy[row]), 0, 2)
        return values
