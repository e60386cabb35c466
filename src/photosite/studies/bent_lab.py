"""A virtual laboratory whose converter bends the signal."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.frames.frame_set import FrameSet, FrameSource
from photosite.studies.truth import measured_truth
from photosite.studies.virtual_lab import VirtualLab, nominal_sensor

if TYPE_CHECKING:
    from photosite.calibration.result import Calibration

FINE_BITS, FINE_STEPS = 16, 8
"""Bits of the frames before the bend, and their steps per final digital number: twice the range of 12 bits."""

STEP_VARIANCE = 2.0 / (12.0 * FINE_STEPS**2)
"""Variance of the first rounding and of the uniform noise that hides its steps from the second one, DN^2."""

AT_SATURATION = (
    *("saturation_dn", "saturation_capacity_e", "saturation_capacity_photons"),
    *("snr_max_db", "dynamic_range_db"),
)
"""Parameters at saturation, whose true value the bend changes."""


@dataclass(frozen=True)
class BentLab:
    """A laboratory with a bent response.

    Parameters
    ----------
    lab
        The laboratory before the bend, of 12 bits.
    size, power
        Deviation at full scale, relative to a straight response, and the power of the signal that it grows with. Beyond
        full scale the response is straight.
    """

    lab: VirtualLab
    size: float
    power: int

    def frame_set(self) -> FrameSet:
        """Return the bent frames as `calibrate` takes them."""
        sensor = self.lab.camera.sensor
        read_dn = sensor.noise.read_noise_mv.value / sensor.mv_per_dn
        fine = sensor.with_(
            read_noise_mv=math.sqrt(read_dn**2 - STEP_VARIANCE) * sensor.mv_per_dn,
            bits=FINE_BITS,
            analog_gain=sensor.readout.analog_gain.value * FINE_STEPS / 2 ** (FINE_BITS - sensor.readout.bits),
            black_level_dn=sensor.readout.black_level_dn.value * FINE_STEPS,
        )
        lab = replace(self.lab, camera=replace(self.lab.camera, sensor=fine))
        frames = lab.frame_set()
        groups = tuple(
            replace(group, frames=tuple(FrameSource(f.name, partial(self._bent, f)) for f in group.frames))
            for group in frames.groups
        )
        bits, black = sensor.readout.bits, sensor.readout.black_level_dn.value
        return replace(frames, groups=groups, bits=bits, sensor=nominal_sensor(sensor), black_level_dn=black)

    def _bent(self, frame: FrameSource) -> NDArray[np.uint16]:
        readout = self.lab.camera.sensor.readout
        black, white = readout.black_level_dn.value, (1 << readout.bits) - 1
        rng = np.random.default_rng([self.lab.seed, zlib.crc32(frame.name.encode())])
        steps = frame.read()
        fine = steps + rng.uniform(-0.5, 0.5, steps.shape)
        share = (fine / FINE_STEPS - black) / (white - black)
        low, beyond = np.minimum(share, 1.0), np.maximum(share - 1.0, 0.0)
        bent = low + self.size * np.abs(low) ** (self.power - 1) * low + (1.0 + self.size * self.power) * beyond
        return np.asarray(np.clip(np.rint(black + (white - black) * bent), 0, white), np.uint16)

    def truth(self, calibration: Calibration) -> dict[str, float]:
        """Return the true parameters except those at saturation: gain and responsivity are those at small signal."""
        found = measured_truth(self.lab, calibration)
        return {name: value for name, value in found.items() if name not in AT_SATURATION}
