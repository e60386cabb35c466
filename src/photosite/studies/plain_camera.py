"""A virtual camera of plain NumPy, independent of the engine, and disturbances of its frames."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve

from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
from photosite.sensor.model import Sensor
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.values.cfa import MONOCHROME, Cfa

Frame = NDArray[np.float64]
Change = Callable[[Frame, np.random.Generator, int], Frame]
"""Function of (rows, cols) values, a generator of random numbers, and the number of the frame in the set, from 0."""


def unchanged(values: Frame, rng: np.random.Generator, frame: int) -> Frame:
    """Return the values."""
    return values


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """What happens to light, charge and digital numbers of every frame.

    Parameters
    ----------
    light, charge, numbers
        Changes of the expected electrons of the light, of electrons, and of digital numbers before rounding.
    lag, blend
        Share of the charge that the next frame receives; share of the saved frame that is blended into the next one.
    hot
        Fraction of the pixels that are hot, and their dark current in e-/s.
    hot_e_per_s
        (rows, cols) dark current that is added to that of the pixels.
    wrong_level
        Number of the protocol's step, from 0, that gets more light than stated, and the factor.
    """

    light: Change = unchanged
    charge: Change = unchanged
    numbers: Change = unchanged
    lag: float = 0.0
    blend: float = 0.0
    hot: tuple[float, float] = (0.0, 0.0)
    hot_e_per_s: Frame | float = 0.0
    wrong_level: tuple[int, float] = (0, 1.0)


@dataclass(frozen=True, kw_only=True)
class PlainCamera:
    """A virtual camera under a uniform light, limited by its converter.

    Parameters
    ----------
    shape, bits, cfa
        Size of the chip, bits of the converter, and the color filter array that is stated for the frames.
    gain, black_dn, read_noise_e, dsnu_dn, prnu
        System gain in DN/e-, black level in DN, read noise in e-, DSNU in DN, and PRNU relative to 1.
    electrons_per_s
        Electrons of the light in each pixel.
    dark_e_per_s, dcnu
        Dark current in e-/s, and its standard deviation over pixels relative to the mean (log-normal).
    quantum_efficiency
        Electrons per photon if the light is metered, otherwise None.
    sensor
        What is known before the measurement, or None.
    """

    shape: tuple[int, int]
    gain: float
    black_dn: float
    read_noise_e: float
    dsnu_dn: float
    prnu: float
    electrons_per_s: float
    dark_e_per_s: float = 0.0
    dcnu: float = 0.0
    bits: int = 12
    cfa: Cfa = MONOCHROME
    quantum_efficiency: float | None = None
    sensor: Sensor | None = None

    def frame_set(self, protocol: ShootingProtocol, disturbance: Disturbance, seed: int) -> FrameSet:
        """Return the frames of a protocol in memory, in its order."""
        rng = np.random.default_rng(seed)
        response = 1.0 + self.prnu * rng.normal(size=self.shape)
        offset = self.black_dn + self.dsnu_dn * rng.normal(size=self.shape)
        dark_rate = self._dark_rate(disturbance, rng) + disturbance.hot_e_per_s
        left, last = np.zeros(self.shape), offset
        white = (1 << self.bits) - 1
        groups = []
        count = itertools.count()
        for number, step in enumerate(protocol.steps):
            electrons = self._electrons(step)
            if number == disturbance.wrong_level[0]:
                electrons *= disturbance.wrong_level[1]
            frames = []
            for i in range(step.count):
                frame = next(count)
                light = disturbance.light(np.full(self.shape, electrons) * response, rng, frame)
                collected = rng.poisson(light + dark_rate * step.exposure_s).astype(np.float64)
                charge = disturbance.charge(collected, rng, frame)
                left, charge = disturbance.lag * charge, (1.0 - disturbance.lag) * charge + left
                read = rng.normal(0.0, self.read_noise_e, self.shape)
                numbers = disturbance.numbers(offset + self.gain * (charge + read), rng, frame)
                last = (1.0 - disturbance.blend) * numbers + disturbance.blend * last
                dn = np.clip(np.rint(last), 0, white).astype(np.uint16)
                frames.append(FrameSource(f"{step.kind} {step.exposure_s:g} s, frame {i}", partial(np.array, dn)))
            groups.append(FrameGroup(step.kind, step.exposure_s, tuple(frames), self._photons(step)))
        groups.sort(key=lambda group: (group.kind, group.exposure_s))
        rows, cols = self.shape
        black = None if self.sensor is None else self.black_dn
        return FrameSet(tuple(groups), rows, cols, self.bits, self.cfa, sensor=self.sensor, black_level_dn=black)

    def _dark_rate(self, disturbance: Disturbance, rng: np.random.Generator) -> Frame:
        if not self.dark_e_per_s:
            return np.zeros(self.shape)
        sigma = math.sqrt(math.log1p(self.dcnu**2))
        rate = self.dark_e_per_s * np.exp(sigma * rng.normal(size=self.shape) - sigma**2 / 2)
        fraction, hot_e_per_s = disturbance.hot
        return np.where(rng.random(self.shape) < fraction, hot_e_per_s, rate) if fraction else rate

    def _photons(self, step: Step) -> float | None:
        if self.quantum_efficiency is None:
            return None
        return self._electrons(step) / self.quantum_efficiency

    def _electrons(self, step: Step) -> float:
        return self.electrons_per_s * step.exposure_s if step.kind == "light" else 0.0


def convolved(weights: Sequence[Sequence[float]]) -> Change:
    """Return a convolution with weights that are symmetric about their center."""
    kernel = np.array(weights)
    return lambda values, *_: np.asarray(convolve(values, kernel, mode="nearest"))


def bands(size: float, period_rows: float) -> Change:
    """Return the flicker of a light under a rolling shutter: bands of a relative amplitude, with a random phase."""

    def light(values: Frame, rng: np.random.Generator, frame: int) -> Frame:
        phase = 2.0 * math.pi * np.arange(len(values))[:, None] / period_rows + rng.uniform(0.0, 2.0 * math.pi)
        return np.asarray(values * (1.0 + size * np.sin(phase)))

    return light


def bent(size: float, power: int, saturation_e: float) -> Change:
    """Return a response with a relative deviation at saturation that grows with a power of the electrons."""
    return lambda values, *_: np.asarray(values * (1.0 + size * (values / saturation_e) ** (power - 1)))


def darker_corners(shape: tuple[int, int], fraction: float) -> Frame:
    """Return a smooth light of mean 1; its corners lie 2 `fraction` below its center."""
    rows, cols = (np.linspace(-1.0, 1.0, length) for length in shape)
    fall = 1.0 - fraction * np.add.outer(rows**2, cols**2)
    even: Frame = fall / fall.mean()
    return even
