"""Images of charts with known image quality, by plain NumPy, without the simulator and the measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

from photosite.metrics.chart_image import ChartImage
from photosite.values.cfa import MONOCHROME, Cfa

Array = NDArray[np.float64]
_CELLS = 5
RGGB: Cfa = (("R", "G"), ("G", "B"))


@dataclass(frozen=True)
class VirtualEdge:
    """An edge under a Gaussian blur on square pixels of `points` x `points` points, with shot and read noise.

    `levels` are the mean electrons on the dark and on the bright side, in even light.
    """

    electrons: Array
    sigma_px: float
    angle_rad: float
    points: int = _CELLS
    cfa: Cfa = MONOCHROME
    levels: tuple[float, float] = (0.0, 0.0)

    def response(self, frequency: float) -> float:
        """Return the response across the edge: the Gaussian times the pixel."""
        blur = math.exp(-2.0 * (math.pi * self.sigma_px * frequency) ** 2)
        axes = frequency * math.cos(self.angle_rad), frequency * math.sin(self.angle_rad)
        return blur * math.prod(float(np.sinc(each) / np.sinc(each / self.points)) for each in axes)

    def crossing(self, level: float) -> float | None:
        """Return the frequency at which the response is a level; None if that is above 1 cycle/pixel."""
        if self.response(0.999) > level:
            return None
        return float(brentq(lambda frequency: self.response(frequency) - level, 1e-6, 0.999))

    def rise(self) -> float:
        """Return the distance over which the profile rises from 10 to 90 %."""
        part = (np.arange(self.points) + 0.5) / self.points - 0.5
        offset = part[:, None] * math.cos(self.angle_rad) + part * math.sin(self.angle_rad)

        def profile(distance: float) -> float:
            return float(ndtr((distance + offset) / self.sigma_px).mean()) - 0.9

        return 2.0 * float(brentq(profile, 0.0, 10.0 * self.sigma_px + 2.0))

    @property
    def image(self) -> ChartImage:
        """The frame, a mosaic where it has a tile: the chart is gray, so that all channels have one response."""
        return ChartImage((self.electrons,), "electrons", self.cfa)


def virtual_edge(
    random: np.random.Generator, *, bent: bool = False, uneven: bool = False, cfa: Cfa = MONOCHROME
) -> VirtualEdge:
    """Return an edge of random blur, angle, contrast and light; bent by distortion, under uneven light, in a mosaic."""
    rows, cols = 100, 90
    sigma, angle = random.uniform(0.3, 1.2), math.radians(random.uniform(2.5, 9.0) * random.choice([-1, 1]))
    contrast, bright = random.uniform(2.0, 20.0), 10 ** random.uniform(2.5, 4.3)
    part = (np.arange(_CELLS) + 0.5) / _CELLS
    y, x = ((np.arange(size)[:, None] + part).ravel() for size in (rows, cols))
    at = cols / 2 + random.uniform(-3, 3) + math.tan(angle) * (y - rows / 2)
    if bent:
        at = at + random.uniform(-2, 2) * ((y - rows / 2) / (rows / 2)) ** 2
    distance = (x - at[:, None]) * math.cos(angle) * random.choice([-1, 1])
    step = ndtr(distance / sigma).reshape(rows, _CELLS, cols, _CELLS).mean(axis=(1, 3))
    mean = bright * (1 / contrast + (1 - 1 / contrast) * step)
    if uneven:
        along = random.uniform(-0.1, 0.1) * np.linspace(-1, 1, rows)[:, None]
        mean = mean * (1 + random.uniform(-0.1, 0.1) * np.linspace(-1, 1, cols) + along)
    noisy = random.poisson(mean) + random.normal(0.0, 5.0, mean.shape)
    return VirtualEdge(noisy, sigma, angle, cfa=cfa, levels=(bright / contrast, bright))


def kind_of_edge(random: np.random.Generator, number: int) -> VirtualEdge:
    """Return an edge whose kinds alternate: bent or straight, in even light or not, monochrome or in a mosaic."""
    return virtual_edge(
        random, bent=number % 2 == 1, uneven=number % 4 >= 2, cfa=RGGB if number % 8 >= 4 else MONOCHROME
    )


@dataclass(frozen=True)
class VirtualSquares:
    """Slanted squares whose edges have Gaussian blurs of their own, with the shot noise of the frame.

    `sigma_px` holds the blur across the vertical and across the horizontal edges of each square, by row and column.
    """

    electrons: Array
    sigma_px: dict[tuple[int, int], tuple[float, float]]
    angle_rad: float

    def mtf50(self, place: tuple[int, int], vertical: bool) -> float:
        """Return the frequency at which the Gaussian times the pixel is 0.5."""
        edge = VirtualEdge(np.zeros(0), self.sigma_px[place][0 if vertical else 1], self.angle_rad)
        found = edge.crossing(0.5)
        assert found is not None
        return found


Blurs = dict[tuple[int, int], tuple[float, float]]


def virtual_squares(
    random: np.random.Generator, size: tuple[int, int] = (3, 4), *, blurs: Blurs | None = None, move: float = 0.0
) -> VirtualSquares:
    """Return squares of half their distance of 120 pixels, each moved by up to `move` pixels; drawn blurs for None."""
    angle, pitch = math.radians(5.0), 120
    tiles: list[list[Array]] = []
    sigmas = {} if blurs is None else dict(blurs)
    part = (np.arange(_CELLS * pitch) + 0.5) / _CELLS - pitch / 2
    for r in range(size[0]):
        tiles.append([])
        for c in range(size[1]):
            sigma = sigmas.setdefault((r, c), (random.uniform(0.5, 1.3), random.uniform(0.5, 1.3)))
            y, x = part[:, None] - random.uniform(-move, move), part - random.uniform(-move, move)
            along, upward = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
            inside: Array = np.ones(())
            for at, spread in ((along, sigma[0]), (upward, sigma[1])):
                inside = inside * ndtr((pitch / 4 - at) / spread) * ndtr((pitch / 4 + at) / spread)
            tiles[-1].append(inside.reshape(pitch, _CELLS, pitch, _CELLS).mean(axis=(1, 3)))
    mean = 8000.0 * (1.0 - 0.75 * np.block(tiles))
    return VirtualSquares(random.poisson(mean) + random.normal(0.0, 5.0, mean.shape), sigmas, angle)


@dataclass(frozen=True)
class VirtualNoise:
    """Gain in DN/e-, read noise and DSNU in electrons, PRNU as a fraction, black level in DN."""

    gain: float
    read_noise: float
    dsnu: float
    prnu: float
    black: float = 200.0

    @property
    def temporal_floor(self) -> float:
        """Variance of a pixel without light in DN2, with that of rounding."""
        return (self.gain * self.read_noise) ** 2 + 1.0 / 12.0

    def frames(self, random: np.random.Generator, mean_e: Array, count: int, white: int) -> list[NDArray[np.uint16]]:
        """Return frames of one chip with a mean image in electrons."""
        pattern = mean_e * (1.0 + random.normal(0.0, self.prnu, mean_e.shape))
        offset = random.normal(0.0, self.dsnu, mean_e.shape)
        made = []
        for _ in range(count):
            charge = (
                random.poisson(np.maximum(pattern, 0.0)) + offset + random.normal(0.0, self.read_noise, mean_e.shape)
            )
            made.append(np.clip(np.rint(self.gain * charge + self.black), 0, white).astype(np.uint16))
        return made


def virtual_noise(random: np.random.Generator) -> VirtualNoise:
    """Return a sensor of random noise whose quantization is fine."""
    gain = 10 ** random.uniform(-0.6, 0.3)
    return VirtualNoise(
        gain, random.uniform(1.0, 8.0) / min(gain, 1.0), random.uniform(0.2, 3.0), random.uniform(0.002, 0.015)
    )


def blurred(fine: Array, cells: int, sigma_px: float, *, squares: bool = False) -> Array:
    """Return an image of square pixels of `cells` x `cells` points, or of as many squares, under a Gaussian blur."""
    fy, fx = (np.fft.fftfreq(size) * cells for size in fine.shape)  # cycles per pixel
    gauss = np.exp(-2.0 * (np.pi * sigma_px) ** 2 * (fy[:, None] ** 2 + fx**2))
    if squares:  # once for the squares, and once as the sum of points becomes that over the pixel
        gauss *= np.sinc(fy[:, None] / cells) ** 2 * np.sinc(fx / cells) ** 2
    smooth: Array = np.fft.ifft2(np.fft.fft2(fine) * gauss).real
    rows, cols = (size // cells for size in fine.shape)
    return np.asarray(smooth.reshape(rows, cells, cols, cells).mean(axis=(1, 3)))


def response(frequency: Array, sigma_px: float, cells: int = 0) -> Array:
    """Return the mean over directions of a Gaussian blur times square pixels, of `cells` x `cells` points if not 0."""
    angle = np.linspace(0.0, np.pi / 2, 91)
    along = (frequency[..., None] * part for part in (np.cos(angle), np.sin(angle)))
    pixel = [np.sinc(each) / (np.sinc(each / cells) if cells else 1.0) for each in along]
    across = pixel[0] * pixel[1]
    return np.asarray(np.exp(-2.0 * (np.pi * sigma_px * frequency) ** 2) * across.mean(axis=-1))
