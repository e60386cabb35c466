"""How a lens spreads the light of a point on the sensor: what a camera asks of any lens, whatever it is made of.

Positions on the sensor are (y, x) in m: y down the frame's rows, x along its columns, 0 on the axis, upright as the
frame is. A point spread is normalised to its own light. Its transfer function is

    otf(fy, fx) = integral of psf(y, x) exp(-2 pi i (fy y + fx x)) dy dx,

1 at (0, 0) for a point spread of its own; a mode of a `FieldSpread` may have any value there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_numbers

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RadialSpread:
    """The same everywhere on the sensor, and rotationally symmetric: its transfer function is real.

    Parameters
    ----------
    otf
        (frequency_per_m of any shape, wavelength_nm) -> real values of that shape.
    cutoff_per_m
        wavelength_nm -> frequency beyond which the transfer function is 0, cycles/m.
    reach_m
        wavelength_nm -> radius on the sensor that holds 99.5 % of the light.
    """

    otf: Callable[[Array, float], Array]
    cutoff_per_m: Callable[[float], float]
    reach_m: Callable[[float], float]


@dataclass(frozen=True, eq=False)
class PlaneSpread:
    """The same everywhere on the sensor, of any shape.

    Parameters
    ----------
    otf
        (fy_per_m, fx_per_m, wavelength_nm) -> complex values of the shape to which the frequencies broadcast.
    cutoff_per_m, reach_m
        As for `RadialSpread`; in the direction in which they are largest.
    wavelength_nm
        Where the spread is known; between these it is linear in wavelength, beyond them that of the nearest. None: it
        is its own at every wavelength.
    """

    otf: Callable[[Array, Array, float], NDArray[np.complex128]]
    cutoff_per_m: Callable[[float], float]
    reach_m: Callable[[float], float]
    wavelength_nm: Array | None = None


@dataclass(frozen=True, eq=False)
class FieldSpread:
    """Different from place to place: sum over r of weights[r] (at the point's own image position) x modes[r].

    Parameters
    ----------
    y_m, x_m
        (P,), (Q,) increasing: nodes on the sensor. Weights are linear between them, beyond them those of the nearest.
    weights
        (R, P, Q).
    modes
        R spreads, which share their `wavelength_nm`. Together, at every node, they make a point spread of light 1.
    relative_error
        RMS difference of the sum from the lens's own point spreads, over all nodes and wavelengths, relative to
        their RMS; 0 where nothing was left out.
    """

    y_m: Array
    x_m: Array
    weights: Array
    modes: tuple[PlaneSpread, ...]
    relative_error: float = 0.0


Spread = RadialSpread | PlaneSpread | FieldSpread


@dataclass(frozen=True, eq=False)
class RadialMapping:
    """Where a point's image really falls: distortion, and with several wavelengths lateral chromatic aberration.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing; linear between, beyond them that of the nearest. One wavelength: the same for all.
    ideal_m
        (n,) increasing from 0: image heights of a lens without distortion, focal length and distance being the same.
    real_m
        (L, n): the image heights of this lens, increasing from 0.

    Raises
    ------
    InputError
        If shapes do not fit, a value is not finite, or heights or wavelengths do not increase.
    """

    wavelength_nm: Array
    ideal_m: Array
    real_m: Array

    def __post_init__(self) -> None:
        grid, ideal, real = (np.asarray(a, np.float64) for a in (self.wavelength_nm, self.ideal_m, self.real_m))
        lines = grid.ndim == ideal.ndim == 1
        if not lines or grid.size < 1 or ideal.size < 2 or real.shape != (grid.size, ideal.size):
            raise InputError(
                "a mapping is wavelength_nm (L,), ideal_m (n,) of 2 heights or more and real_m (L, n): got shapes "
                f"{grid.shape}, {ideal.shape} and {real.shape}"
            )
        if not all(np.isfinite(a).all() for a in (grid, ideal, real)):
            raise InputError("a mapping's wavelengths and heights must be finite; some are NaN or infinite")
        if (np.diff(grid) <= 0).any():
            raise InputError("a mapping's wavelengths must increase; sort them, with their rows of real_m")
        for name, heights in (("ideal_m", ideal[None]), ("real_m", real)):
            if (heights[:, 0] != 0).any() or (np.diff(heights) <= 0).any():
                raise InputError(
                    f"a mapping's {name} must increase from 0 on the axis; an image that folds back over itself, or a "
                    "table that is not sorted by height, cannot be laid on a sensor"
                )
        for name, value in (("wavelength_nm", grid), ("ideal_m", ideal), ("real_m", real)):
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class VeilingGlare:
    """Light that lens surfaces and barrel scatter over the sensor.

    Parameters
    ----------
    fraction
        Of all light that arrives, 0 to below 1: the veiling glare index of an even field, ISO 9358.
    spread_m
        Scale of the scatter on the sensor: it falls as exp(-distance / spread). None: even over the whole frame.

    Raises
    ------
    InputError
        If the fraction is not from 0 to below 1, or the scale is not above 0.
    """

    fraction: float
    spread_m: float | None = None

    def __post_init__(self) -> None:
        check_numbers(self, "fraction", *(["spread_m"] if self.spread_m is not None else []))
        if not 0 <= self.fraction < 1:
            raise InputError(f"veiling glare is a fraction of all light, 0 to below 1, not {self.fraction}")
        if self.spread_m is not None and not (math.isfinite(self.spread_m) and self.spread_m > 0):
            raise InputError(
                f"veiling glare's spread must be above 0 m, not {self.spread_m}; None spreads it evenly over the frame"
            )


class Optics(Protocol):
    """What a camera asks of its lens. Distances are from the lens to the object, in m."""

    def magnification(self, distance_m: float) -> float:
        """|m|, image size over object size."""
        ...

    def irradiance_per_radiance(self, wavelength_nm: Array, distance_m: float) -> Array:
        """(wavelengths,) sr: on-axis irradiance over radiance, transmittance included."""
        ...

    def relative_illumination(self, image_height_m: Array, distance_m: float) -> Array | None:
        """Irradiance over that on axis at distances from the axis on the sensor; None where it is 1 everywhere."""
        ...

    def spread(self, distance_m: float) -> Spread:
        """How the light of a point is spread."""
        ...

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """Where points fall; None where that is where a lens without distortion has them."""
        ...

    @property
    def veiling_glare(self) -> VeilingGlare | None:
        """What is scattered over the sensor; None where nothing is."""
        ...
