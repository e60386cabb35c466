"""Lens and sensor of a camera: the part of `Camera` that mean images and metadata are computed from."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.color_matrix import color_matrix
from photosite.color.spectrum import Rule
from photosite.errors import InputError
from photosite.optics.lens import Optics
from photosite.sensor.chip import MeasuredChip
from photosite.sensor.io.sensor_file import load_measured_chip
from photosite.sensor.model import Sensor
from photosite.values.choice import check_choice
from photosite.values.shown import Shown


@dataclass(frozen=True)
class CameraParts(Shown):
    """Lens and sensor, and how the scene is sampled; see `Camera`. Measured maps are loaded when it is made."""

    optics: Optics
    sensor: Sensor
    integration: Rule = "trapezoid"
    cells_per_pixel: int = 1
    gain_setting: InitVar[float | None] = None
    measured_chip: MeasuredChip | None = field(init=False, repr=False, compare=False)

    def __post_init__(self, gain_setting: float | None) -> None:
        hint = "Write Camera(optics, sensor), the lens first"
        if not callable(getattr(self.optics, "irradiance_per_radiance", None)):
            expected = "a lens, such as DiffractionLimited(2.8, 50)"
            raise InputError("optics", value=self.optics, expected=expected, hint=hint)
        if not isinstance(self.sensor, Sensor):
            expected = "a sensor, such as load_sensor('nikon-d200')"
            raise InputError("sensor", value=self.sensor, expected=expected, hint=hint)
        if gain_setting is not None:
            object.__setattr__(self, "sensor", self.sensor.at_gain_setting(gain_setting))
        check_choice("integration", self.integration, Rule)
        cells = self.cells_per_pixel
        if not isinstance(cells, int | np.integer) or isinstance(cells, bool) or cells < 1 or cells % 2 == 0:
            raise InputError("cells_per_pixel", value=cells, expected="odd and positive: 1, 3, 5, ...")
        object.__setattr__(self, "measured_chip", load_measured_chip(self.sensor))

    def __reduce__(self) -> tuple[Any, ...]:
        # Maps of hundreds of megabytes are loaded again, not sent to other processes.
        return type(self), (self.optics, self.sensor, self.integration, self.cells_per_pixel)

    @cached_property
    def color_matrices(self) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """Color matrices under D65 and illuminant A, as DNG defines them."""
        return color_matrix(self.sensor), color_matrix(self.sensor, "A")
