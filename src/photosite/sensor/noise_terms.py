"""The noise sources of a sensor, effects included, as variances in electrons that its pixels collect.

One frame of an even surface is meant, and a small spread about the mean signal. Left out are single pixels that stand
out, such as hot, dead and stuck ones, and what is smooth over the frame: glow, the drift of the black level, and the
converter's error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.sensor.effects.model import Effects
from photosite.sensor.model import Sensor

QUANTIZATION_DN2 = 1 / 12
"""Variance of rounding to whole numbers."""

_ITERATIONS = 30

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseTerms:
    """Variances of a sensor's noise sources.

    Noise behind the pixels counts as the electrons that would give the same change of the output: read noise over the
    gain of electron multiplication and over the slope of the response curve.

    Parameters
    ----------
    sensor
        The sensor; of several captures, the first one.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> for effect in ({}, {"em_gain": {"gain": 100}}, {"interpixel_capacitance": {"coupling_percent": 1}}):
    ...     terms = NoiseTerms(sensor.with_(**effect))
    ...     round(terms.shot, 3), round(terms.read_e2**0.5, 3)
    (1.0, 17.333)
    (1.99, 0.173)
    (0.922, 17.333)
    """

    sensor: Sensor

    @cached_property
    def _effects(self) -> Effects:
        return self.sensor.effects or Effects()

    @property
    def multiplication(self) -> float:
        """Mean electrons at the amplifier per collected electron."""
        return 1.0 if (em := self._effects.em_gain) is None else em.gain.value

    @property
    def independent_fraction(self) -> float:
        """Fraction that interpixel capacitance leaves of variance that is independent between pixels."""
        coupling = self._effects.interpixel_capacitance
        return 1.0 if coupling is None else coupling.variance_factor

    @property
    def shot(self) -> float:
        """Variance per collected electron."""
        return (1.0 if (em := self._effects.em_gain) is None else em.excess_noise_factor) * self.independent_fraction

    @property
    def linear(self) -> float:
        """Variance per collected electron over a frame: shot, and covariance of channels' gains and offsets."""
        if (channels := self._effects.readout_channels) is None:
            return self.shot
        gains, offsets = channels.tables()
        return self.shot + 2.0 * float(np.mean((gains - gains.mean()) * offsets)) / self.multiplication

    @property
    def read_e2(self) -> float:
        """Variance from frame to frame at a small signal, without rounding: read noise and telegraph noise."""
        variance = self.sensor.electrons(self.sensor.noise.read_noise_mv.value) ** 2
        if (blinking := self._effects.telegraph_noise) is not None:
            variance += blinking.variance_e2
        return variance / self.multiplication**2

    @property
    def induced_e2(self) -> float:
        """Variance of the charge that the clocks of a multiplication register generate."""
        return 0.0 if (em := self._effects.em_gain) is None else self.shot * em.clock_induced_charge_e

    @property
    def dsnu_e2(self) -> float:
        """Variance of the offsets over the pixels, at a small signal."""
        variance = self.sensor.electrons(self.sensor.noise.dsnu_mv.value) ** 2 + self._effects.line_variances[0]
        return variance / self.multiplication**2

    @property
    def prnu2(self) -> float:
        """Relative variance of the response over the pixels."""
        of_pixels = (self.sensor.noise.prnu_percent.value / 100.0) ** 2 * self.independent_fraction
        return of_pixels + self._effects.line_variances[1]

    @cached_property
    def _slopes(self) -> tuple[Array, Array] | None:
        if (curve := self._effects.response_curve) is None:
            return None
        signal, step = curve.nodes(self.sensor.pixel.well_capacity_e.value)
        return np.arange(signal.size, dtype=np.float64) * step, np.asarray(np.gradient(signal, step))

    def slope(self, signal_e: ArrayLike) -> Array:
        """Return the slope of the response curve over that at a small signal."""
        signal = np.asarray(signal_e, np.float64)
        return np.ones_like(signal) if self._slopes is None else np.interp(signal, *self._slopes)

    def rounding_e2(self, signal_e: ArrayLike) -> Array:
        """Return the variance of rounding to the numbers that the output has at a signal."""
        signal, sensor = np.asarray(signal_e, np.float64), self.sensor
        gain, steps = sensor.system_gain_dn_per_e, np.ones_like(signal)
        if (output := self._effects.output) is not None:
            black, curve = sensor.readout.black_level_dn.value, self._effects.response_curve
            well_e = sensor.pixel.well_capacity_e.value
            at_amplifier = signal * self.multiplication if curve is None else curve.signal_e(signal, well_e)
            steps = output.steps_dn(black + gain * at_amplifier, black, sensor.white_level_dn)
        return np.asarray(QUANTIZATION_DN2 * (steps / (gain * self.multiplication * self.slope(signal))) ** 2)

    def floor_e2(self, signal_e: ArrayLike = 0.0) -> Array:
        """Return the variance over the pixels of a frame that is there without light, without rounding."""
        return np.asarray((self.read_e2 + self.dsnu_e2) / self.slope(signal_e) ** 2 + self.induced_e2)

    def signal_at_snr_e(self, snr_db: float, other_e2: float = 0.0) -> float | None:
        """Return the signal S in electrons at which S^2 is 10^(snr_db / 10) times the variance of a frame.

        Rounding is left out, and `other_e2` added. None if PRNU limits the ratio to less at any signal.
        """
        ratio = 10.0 ** (snr_db / 10.0)
        square = 1.0 - ratio * self.prnu2
        if not square > 0:
            return None
        linear, signal = ratio * self.linear, 0.0
        # By the slope of the response curve the floor depends on the signal, but little.
        for _ in range(1 if self._slopes is None else _ITERATIONS):
            floor_e2 = float(self.floor_e2(signal)) + other_e2
            signal = (linear + (linear**2 + 4.0 * square * ratio * floor_e2) ** 0.5) / (2.0 * square)
        return signal
