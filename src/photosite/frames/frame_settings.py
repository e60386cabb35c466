"""The settings of a frame: dark or light, exposure time, light, gain setting and temperature."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Real
from typing import Literal

from photosite.errors import InputError

Kind = Literal["dark", "light"]
KINDS: tuple[Kind, ...] = ("dark", "light")

ABSOLUTE_ZERO_C = -273.15

_CONDITIONS = {
    "exposure_s": (0.0, "a number of seconds above 0; 0 for dark frames, or with photons_per_pixel"),
    "photons_per_pixel": (0.0, "a finite number, 0 or above"),
    "gain_setting": (0.0, "a finite number, 0 or above"),
    "temperature_c": (ABSOLUTE_ZERO_C, f"a finite number above {ABSOLUTE_ZERO_C:g}"),
}
"""Lowest value, and the condition in words."""


@dataclass(frozen=True)
class FrameSettings:
    """Settings of one frame; None where a source does not state the setting.

    Parameters
    ----------
    kind
        "dark" or "light".
    exposure_s
        Exposure time. 0 is that of bias frames; of light frames, whose photons must then be known, it means unknown.
    photons_per_pixel
        Mean number of photons per pixel during the exposure.
    gain_setting
        The camera's gain setting: ISO, or any other unit if all files use the same.
    temperature_c
        Temperature of the sensor, in degrees Celsius.

    Examples
    --------
    >>> FrameSettings("dark").or_else(FrameSettings("light", exposure_s=0.01, gain_setting=100))
    FrameSettings(kind='dark', exposure_s=0.01, photons_per_pixel=None, gain_setting=100, temperature_c=None)
    """

    kind: Kind | None = None
    exposure_s: float | None = None
    photons_per_pixel: float | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None

    def or_else(self, other: FrameSettings) -> FrameSettings:
        """Return these settings, with those that are missing taken from another source."""
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))
        return FrameSettings(*(second if first is None else first for first, second in pairs))

    def validated(self) -> FrameSettings:
        """Return these settings with floats for all numbers."""
        if self.kind is not None and self.kind not in KINDS:
            raise InputError("kind", value=self.kind, expected="'dark' or 'light'")
        numbers = {}
        for name, (lowest, condition) in _CONDITIONS.items():
            value = getattr(self, name)
            if value is None:
                continue
            number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
            lowest_is_valid = name != "temperature_c" and (name != "exposure_s" or self._zero_exposure)
            if not lowest <= number < math.inf or (number == lowest and not lowest_is_valid):
                raise InputError(name, value=value, expected=condition)
            numbers[name] = number
        return FrameSettings(self.kind, **numbers)

    @property
    def _zero_exposure(self) -> bool:
        """Whether the exposure time may be 0: descriptors label light of known photons so."""
        return self.kind == "dark" or self.photons_per_pixel is not None
