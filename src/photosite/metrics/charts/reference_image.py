"""A gray chart drawn on the pixels of its image: what the image would be without lens, pixels and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy import fft

from photosite.errors import InputError
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.values.region import Region

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_FINE = 7
"""Points along a pixel's side at which the chart is looked up. Its samples are squares, whose borders have frequencies
above the sampling frequency of the pixels: with one point, MTF50 of a sharp camera was a third too low."""
_LIGHT_BLOCKS = 8
"""Blocks along a side whose means show the light."""
_BLOCKS = 5
"""Blocks along a side in which the displacement of the image from the chart is measured."""
_LOW_FREQUENCY = 0.15
"""Highest frequency in cycles/pixel of the displacements."""
_ROUNDS = 3
_ALIGNED_PX = 0.02
_LARGEST_PX = 8.0
"""Displacement from which the chart counts as elsewhere."""


class ReferenceImage:
    """Spectra of a gray chart and of an image of it in the same square of pixels.

    Parameters
    ----------
    chart
        The chart in the image; its corners may be off by a few pixels.
    region
        The square of pixels.
    values, mask
        (rows, cols) of the image there, and which pixels count; those of other channels do not.

    Raises
    ------
    InputError
        If the image does not show the chart.
    """

    def __init__(self, chart: PlacedChart, region: Region, values: Array, mask: NDArray[np.bool_]) -> None:
        self._chart, self._region = chart, region
        self._values = np.where(mask, values - values[mask].mean(), 0.0)
        size = region.shape
        coarse = min(max(math.ceil(chart.samples_per_pixel), 1), _FINE)
        self._by_area = chart.samples_per_pixel > 2
        self._shift = np.zeros((2, 3, 3))
        for _ in range(_ROUNDS):
            self._gray = np.mean([drawn for *_, drawn in self._drawn(coarse)], axis=0)
            moved = self._displacements(self._gray)
            self._shift += moved
            if np.abs(self._field(moved, *self._grid())).max() < _ALIGNED_PX:
                break
        if np.abs(self._field(self._shift, *self._grid())).max() > _LARGEST_PX:
            raise InputError(
                "texture", expected="that of the chart at its corners", hint="Check --corners and the seed"
            )
        self.window = _window(*size)
        self.reference = self._spectrum(_FINE)
        """Spectrum of the chart, (rows, cols), relative to its brightest sample."""
        self.frequency = np.hypot(*np.meshgrid(fft.fftfreq(size[0]), fft.fftfreq(size[1]), indexing="ij"))

    def spectrum(self, values: Array, mask: NDArray[np.bool_]) -> Complex:
        """Return the spectrum of an image under the window; that of a sparse channel at its full density."""
        level = values[mask].mean()
        found: Complex = fft.fft2(np.where(mask, values - level, 0.0) * self.window) / mask.mean()
        return found

    def light(self, values: Array, mask: NDArray[np.bool_]) -> Array:
        """Return (rows, cols) signal of the chart's brightest sample: a polynomial of order 2, from means of blocks."""
        row, col = self._grid()
        powers = [(i, j) for i in range(3) for j in range(3 - i)]
        seen = [np.where(mask, self._gray * np.outer(row**i, col**j), 0.0) for i, j in powers]
        model, level = np.stack([_block_sums(each) for each in seen], axis=1), _block_sums(np.where(mask, values, 0.0))
        gray = model[:, 0]
        fit = np.linalg.lstsq(model / gray[:, None], level / gray)[0]
        return np.asarray(sum(c * np.outer(row**i, col**j) for c, (i, j) in zip(fit, powers, strict=True)))

    def _grid(self) -> tuple[Array, Array]:
        """Return rows and columns of the pixels' centers in the region, from -1 to 1."""
        rows, cols = self._region.shape
        return tuple((np.arange(size) + 0.5) / size * 2.0 - 1.0 for size in (rows, cols))  # type: ignore[return-value]

    @staticmethod
    def _field(coefficients: Array, row: Array, col: Array) -> Array:
        """Return (2, rows, cols) displacements of a polynomial of order 2 on each axis."""
        return np.stack([polynomial.polygrid2d(row, col, each) for each in coefficients])

    def _in_scene(self, down: float, along: float) -> Array:
        """Return (rows, cols, 2) where points of the pixels, at a distance from their centers, are in the chart."""
        rows, cols = self._region.shape
        row, col = (
            part + 2.0 * step / size for part, step, size in zip(self._grid(), (down, along), (rows, cols), strict=True)
        )
        moved = self._field(self._shift, row, col)
        y = self._region.r0 + (row[:, None] + 1.0) / 2.0 * rows - moved[0]
        x = self._region.c0 + (col + 1.0) / 2.0 * cols - moved[1]
        return self._chart.to_scene(np.stack([y, x], axis=-1))

    def _drawn(self, fine: int) -> Iterator[tuple[float, float, Array]]:
        """Yield the chart at `fine` points along the side of each pixel: a picture for each place in the pixels.

        Several samples in a pixel are averaged over the pixel's part around each point.
        """
        middle = self._in_scene(0.0, 0.0)
        by_row = self._in_scene(0.5, 0.0) - self._in_scene(-0.5, 0.0)
        by_col = self._in_scene(0.0, 0.5) - self._in_scene(0.0, -0.5)
        places = (np.arange(fine) + 0.5) / fine - 0.5
        down_side, along_side = np.hypot(by_row, by_col).mean(axis=(0, 1)) / fine  # also of a chart that is turned
        size = float(down_side), float(along_side)
        for down in places:
            for along in places:
                points = middle + down * by_row + along * by_col
                yield down, along, self._chart.gray_over(points, size) if self._by_area else self._chart.gray_of(points)

    def _spectrum(self, fine: int) -> Complex:
        """Return the spectrum of the chart at the frequencies of the image, without the points' own averaging."""
        rows, cols = self._region.shape
        fy, fx = fft.fftfreq(rows)[:, None], fft.rfftfreq(cols)
        level = self._chart.scene.weights[0].mean()
        half = np.zeros((rows, len(fx)), np.complex128)
        for down, along, drawn in self._drawn(fine):
            seen: Complex = fft.rfft2((drawn - level) * _window(rows, cols, down, along))
            seen *= np.exp(-2j * np.pi * down * fy)
            seen *= np.exp(-2j * np.pi * along * fx)
            half += seen
        if self._by_area:  # the response of the mean over the part of a pixel
            half /= np.sinc(fy / fine) * np.sinc(fx / fine)
        whole = np.empty((rows, cols), np.complex128)
        whole[:, : len(fx)] = half / fine**2
        whole[:, len(fx) :] = np.conj(whole[-np.arange(rows), 1 : cols - len(fx) + 1][:, ::-1])
        return whole

    def _displacements(self, drawn: Array) -> Array:
        """Return coefficients of the displacement of the image from the chart on its pixels, from blocks."""
        rows, cols = self._region.shape
        height, width = rows // _BLOCKS, cols // _BLOCKS
        window = _window(height, width)
        fy, fx = fft.fftfreq(height)[:, None], fft.fftfreq(width)
        low = (np.hypot(fy, fx) < _LOW_FREQUENCY) & (np.hypot(fy, fx) > 0)
        places, shifts = [], []
        for r in range(_BLOCKS):
            for c in range(_BLOCKS):
                part = slice(r * height, (r + 1) * height), slice(c * width, (c + 1) * width)
                one, other = (each[part] - each[part].mean() for each in (drawn, self._values))
                cross = fft.fft2(other * window) * np.conj(fft.fft2(one * window))
                shifts.append(_peak(np.where(low, cross, 0.0)))
                places.append(((r + 0.5) / _BLOCKS * 2 - 1, (c + 0.5) / _BLOCKS * 2 - 1))
        row, col = np.array(places).T
        powers = [(i, j) for i in range(3) for j in range(3) if i + j <= 2]
        model = np.column_stack([row**i * col**j for i, j in powers])
        found = np.zeros((2, 3, 3))
        moved = np.array(shifts)
        for axis in range(2):
            fit = np.linalg.lstsq(model, moved[:, axis])[0]
            rest = moved[:, axis] - model @ fit
            good = np.abs(rest) <= 3.0 * 1.4826 * np.median(np.abs(rest)) + 0.02
            fit = np.linalg.lstsq(model[good], moved[good, axis])[0]
            for (i, j), value in zip(powers, fit, strict=True):
                found[axis, i, j] = value
        return found


def _block_sums(values: Array) -> Array:
    """Return the sums of the blocks of a picture, row by row."""
    rows, cols = (np.arange(_LIGHT_BLOCKS) * size // _LIGHT_BLOCKS for size in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), cols, axis=1).ravel())


def _window(rows: int, cols: int, down: float = 0.0, along: float = 0.0) -> Array:
    """Return the Hann window at points at a distance from the pixels' centers."""
    one, other = (
        np.sin(np.pi * (np.arange(size) + 0.5 + step) / size) ** 2 for size, step in ((rows, down), (cols, along))
    )
    return np.outer(one, other)


def _peak(cross: Complex) -> tuple[float, float]:
    """Return the displacement of the largest correlation, by a parabola through it and its neighbors."""
    correlation = fft.ifft2(cross).real
    rows, cols = correlation.shape
    r, c = np.unravel_index(int(np.argmax(correlation)), correlation.shape)

    def between(low: float, middle: float, high: float) -> float:
        bend = low - 2.0 * middle + high
        return 0.5 * (low - high) / bend if bend else 0.0

    down = between(*(float(correlation[(r + step) % rows, c]) for step in (-1, 0, 1)))
    along = between(*(float(correlation[r, (c + step) % cols]) for step in (-1, 0, 1)))
    return (r + rows // 2) % rows - rows // 2 + down, (c + cols // 2) % cols - cols // 2 + along
