"""Electron multiplication: the register of an EMCCD, with its gain and excess noise."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from photosite.engine.charge_stages import Register
from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import Positive, about
from photosite.values.validated import NonNegativeNumber, PositiveNumber

_LARGEST_E, _LARGEST_GAIN = 1e15, 1e5


class EmGain(EffectSection):
    """The multiplication register in front of the output amplifier.

    n electrons become a gamma-distributed number of electrons with mean n g and variance n g^2 (F^2 - 1), where g is
    the mean gain and F^2 the excess noise factor.

    References
    ----------
    Basden, Haniff and Mackay, MNRAS 345 (2003) 985: the gamma distribution. Robbins and Hadwen, IEEE Trans. Electron
    Devices 50 (2003) 1227: the excess noise of a register with a finite number of stages.

    Examples
    --------
    >>> round(EmGain(gain=300).excess_noise_factor, 3), round(EmGain(gain=300, stages=536).excess_noise_factor, 3)
    (1.997, 1.976)
    """

    changes_response = True
    of_single_captures = True

    gain: Positive = about("Mean electrons behind the register per electron in front of it.", "1", 300)
    stages: Annotated[int, Field(strict=True, ge=1)] | None = about(
        "Stages of the register, for its excess noise; by default a large number.", "1", 536, default=None
    )
    register_well_e: PositiveNumber | None = about(
        "Electrons that a pixel of the register can hold; by default any number.", "e-", 400000, default=None
    )
    clock_induced_charge_e: Annotated[NonNegativeNumber, Field(lt=10.0)] = about(
        "Mean electrons per pixel and frame that the clocks generate in front of the register.",
        "e-",
        0.002,
        default=0.0,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not 1.0 <= self.gain.value <= _LARGEST_GAIN:
            raise InputError("gain", value=self.gain.value, expected=f"1 to {_LARGEST_GAIN:g}")
        return self

    @property
    def excess_noise_factor(self) -> float:
        """F^2: variance of the signal over gain^2 times that of the charge, for charge with shot noise."""
        g = self.gain.value
        fall = 0.0 if self.stages is None else math.log(g) / self.stages
        return 2.0 * (g - 1.0) / g * math.exp(-fall) + 1.0 / g

    def register(self) -> Register | None:
        """Return the register; None where the gain is 1, so that there is nothing to multiply."""
        excess = self.excess_noise_factor - 1.0
        well = _LARGEST_E if self.register_well_e is None else self.register_well_e
        if excess <= 0.0:
            return None
        return Register(1.0 / excess, self.gain.value * excess, well, self.clock_induced_charge_e)
