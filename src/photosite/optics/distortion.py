"""Distortion and lateral colour as lens makers, calibrations and design programs give them, made one mapping.

Ideal heights are those of the lens without distortion: image distance times the tangent of the field angle. What comes
out is a `RadialMapping`; its curve between heights is that of `photosite.optics.mapping`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_kind
from photosite.optics.lens import camera_wavelengths
from photosite.optics.mapping import image_height
from photosite.optics.radial_table import FieldPoints, check_values, even_curve, numbers
from photosite.optics.spread import RadialMapping

Array = NDArray[np.float64]

_NODES = 65
"""Heights of a mapping that is made of several tables."""
_ANY_WAVELENGTH_NM = np.array([550.0])
_LARGEST_SHARE = 0.1
"""Of the image height: a lateral colour beyond it is a wrong unit rather than a lens."""
_LEAST_RATIO = 0.2
"""Of the first place off the axis: fisheyes come down to it at 78 degrees."""
_ANY_HEIGHT_M = 1.0
"""Beyond any sensor's corner."""


@dataclass(frozen=True, eq=False)
class Distortion:
    """Real over ideal image height.

    Parameters
    ----------
    field
        Where: ideal image heights, or field angles.
    ratio
        (n,) real height over ideal height: 1 + percent / 100. On the axis it is not used.

    Raises
    ------
    InputError
        If the image would fold back, there is no place off the axis, or the first of them falls at less than a fifth
        or more than five times its ideal height: then heights are in another unit.

    Examples
    --------
    >>> barrel = Distortion.from_percent(FieldPoints(height_mm=[0, 7, 14]), [0, -1, -4])
    >>> barrel.heights_m(0.05)[1] * 1e3
    array([ 0.  ,  6.93, 13.44])
    """

    field: FieldPoints
    ratio: Array

    def __post_init__(self) -> None:
        check_kind("Distortion", "field", self.field, FieldPoints, "FieldPoints(height_mm=[...]) or (angle_deg=[...])")
        ratio = check_values("distortion", self.ratio, (self.field.size,))
        object.__setattr__(self, "ratio", ratio)
        if self.field.size == 1 and self.field.starts_on_axis:
            raise InputError("distortion on the axis alone says nothing; give places off the axis")
        first = float(ratio[int(self.field.starts_on_axis)])
        if not _LEAST_RATIO <= first <= 1 / _LEAST_RATIO:
            raise InputError(
                f"distortion puts the first place off the axis at {first:.3g} times its ideal height: real heights are "
                "in mm, as height_mm is, and percent are 100 (real / ideal - 1)"
            )
        real = self.heights_m(1.0)[1]
        if (np.diff(real) <= 0).any():
            raise InputError(
                f"the distorted image folds back {self._place(int(np.argmin(np.diff(real))))}; check the sign and "
                "the unit (percent of the ideal height), and that fields are sorted"
            )

    @classmethod
    def from_percent(cls, field: FieldPoints, percent: ArrayLike) -> Distortion:
        """From 100 (real - ideal) / ideal, negative for a barrel, at ideal heights or field angles."""
        return cls(field, 1 + numbers("percent", percent) / 100)

    @classmethod
    def from_real_heights(cls, field: FieldPoints, real_mm: ArrayLike, image_distance_mm: float) -> Distortion:
        """From where field points fall on the sensor.

        Parameters
        ----------
        field
            Ideal heights or field angles, from the axis.
        real_mm
            (n,) heights on the sensor.
        image_distance_mm
            At which field angles have their ideal heights: the focal length, for far objects.
        """
        ideal = field.ideal_m(image_distance_mm * 1e-3) * 1e3
        real = check_values("real image height", real_mm, (field.size,))
        if field.starts_on_axis and real[0] != 0:
            raise InputError(f"the axis falls on the axis: real image height must begin with 0, not {real[0]:g} mm")
        ratio = np.ones(field.size)
        np.divide(real, ideal, out=ratio, where=ideal > 0)
        return cls(field, ratio)

    @classmethod
    def polynomial(cls, k1: float, k2: float = 0.0, k3: float = 0.0, *, max_field_deg: float = 45.0) -> Distortion:
        """From the radial terms of a camera calibration: real = ideal (1 + k1 u^2 + k2 u^4 + k3 u^6).

        Parameters
        ----------
        k1, k2, k3
            For u = ideal height over image distance, the tangent of the field angle.
        max_field_deg
            Up to where it holds: at the least the frame's corner.

        Raises
        ------
        InputError
            If the image folds back before max_field_deg, or a number cannot be.

        Notes
        -----
        D. C. Brown, Photogrammetric Engineering 37 (1971) 855; k1, k2, k3 of OpenCV and of most calibration tools.

        Examples
        --------
        >>> Distortion.polynomial(-0.1, max_field_deg=20).ratio[-1].round(6)
        np.float64(0.986753)
        >>> Distortion.polynomial(-0.9)
        Traceback (most recent call last):
        photosite.errors.InputError: the distorted image folds back at 31.33 degrees; k1, k2, k3 hold ...
        """
        for name, value in (("k1", k1), ("k2", k2), ("k3", k3), ("max_field_deg", max_field_deg)):
            check_kind("Distortion.polynomial", name, value, Real, "a number")
        if not (all(map(math.isfinite, (k1, k2, k3))) and 0 < max_field_deg < 90):
            raise InputError(
                f"k1, k2, k3 are finite and max_field_deg between 0 and 90: {k1}, {k2}, {k3}, {max_field_deg}"
            )
        u = math.tan(math.radians(max_field_deg)) * np.sqrt(np.linspace(0.0, 1.0, _NODES))
        fine = np.linspace(0.0, u[-1], 4001)
        slope = 1 + 3 * k1 * fine**2 + 5 * k2 * fine**4 + 7 * k3 * fine**6
        if (slope <= 0).any():
            turn = math.degrees(math.atan(fine[np.argmax(slope <= 0)]))
            raise InputError(
                f"the distorted image folds back at {turn:.4g} degrees; k1, k2, k3 hold up to the frame's corner only: "
                "give max_field_deg below that"
            )
        angle = np.degrees(np.arctan(u))
        return cls(FieldPoints(angle_deg=angle), 1 + k1 * u**2 + k2 * u**4 + k3 * u**6)

    def heights_m(self, image_distance_m: float) -> tuple[Array, Array]:
        """Ideal and real image heights, both from 0."""
        ideal = self.field.ideal_m(image_distance_m)
        real = ideal * self.ratio
        if not self.field.starts_on_axis:
            ideal, real = np.concatenate([[0.0], ideal]), np.concatenate([[0.0], real])
        return ideal, real

    def _place(self, index: int) -> str:
        if self.field.height_mm is not None:
            return f"beyond {self.field.height_mm[max(index, 0)]:.4g} mm"
        angle = self.field.angle_deg
        return "" if angle is None else f"beyond {angle[max(index, 0)]:.4g} degrees"


@dataclass(frozen=True, eq=False)
class LateralColor:
    """How far each wavelength's image lies from where the distortion has it, outwards.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing; between these linear, beyond them that of the nearest.
    field
        Where: image heights on the sensor without lateral colour, or field angles.
    shift_um
        (L, n).
    everywhere
        Whether the shift goes on in proportion to height beyond the last place, as that of a magnification does.

    Raises
    ------
    InputError
        If a shift is more than a tenth of the image height, or a wavelength below 100 nm: then it is in another unit.

    Examples
    --------
    >>> LateralColor.from_magnification([450, 550, 650], [1.0004, 1, 0.9997]).shift_um.tolist()
    [[0.4], [0.0], [-0.3]]
    """

    wavelength_nm: Array
    field: FieldPoints
    shift_um: Array
    everywhere: bool = False

    def __post_init__(self) -> None:
        check_kind(
            "LateralColor", "field", self.field, FieldPoints, "FieldPoints(height_mm=[...]) or (angle_deg=[...])"
        )
        grid = camera_wavelengths(self.wavelength_nm)
        shift = check_values("lateral colour", self.shift_um, (grid.size, self.field.size))
        if self.field.size == 1 and self.field.starts_on_axis:
            raise InputError("lateral colour on the axis alone says nothing; give places off the axis")
        height = self.field.height_mm
        if height is not None and (np.abs(shift) > _LARGEST_SHARE * 1e3 * np.maximum(height, 1e-3)).any():
            raise InputError(
                "lateral colour is more than a tenth of the image height somewhere; shifts are in um, outwards, and 0 "
                "on the axis"
            )
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "shift_um", shift)

    @classmethod
    def from_magnification(cls, wavelength_nm: ArrayLike, magnification: ArrayLike) -> LateralColor:
        """From image heights of each wavelength over that of the reference wavelength."""
        scale = check_values("magnification", magnification, (np.size(wavelength_nm),))
        shift = ((scale - 1) * 1e3)[:, None].round(12)
        return cls(np.asarray(wavelength_nm, np.float64), FieldPoints(height_mm=np.array([1.0])), shift, True)


def combined_mapping(
    distortion: Distortion | None, lateral_color: LateralColor | None, image_distance_m: float
) -> RadialMapping | None:
    """Distortion and lateral colour as one mapping; None where there is neither.

    Parameters
    ----------
    distortion
        Of the reference wavelength.
    lateral_color
        Added to that.
    image_distance_m
        From the lens to the sensor: it makes heights of field angles.
    """
    bare = None
    if distortion is not None:
        ideal, real = distortion.heights_m(image_distance_m)
        bare = RadialMapping(_ANY_WAVELENGTH_NM, ideal, real[None])
    if lateral_color is None:
        return bare
    places = lateral_color.field.ideal_m(image_distance_m)
    known_m = _ANY_HEIGHT_M if lateral_color.everywhere else places[-1]
    ideal = (known_m if bare is None else bare.ideal_m[-1]) * np.sqrt(np.linspace(0.0, 1.0, _NODES))
    real = ideal
    if bare is not None:
        curve = image_height(bare, float(bare.wavelength_nm[0]))
        real = curve(ideal)
        if lateral_color.field.angle_deg is not None:
            places = curve(places)
    return RadialMapping(lateral_color.wavelength_nm, ideal, real + _shifts_m(lateral_color, places, real))


def _shifts_m(color: LateralColor, places_m: Array, real_m: Array) -> Array:
    """(L, n): shift over height is an even function; beyond the table it is that of its end."""
    off_axis = places_m > 0
    share = color.shift_um[:, off_axis] * 1e-6 / places_m[off_axis]
    return np.stack([real_m * even_curve(places_m[off_axis], row, real_m) for row in share])
