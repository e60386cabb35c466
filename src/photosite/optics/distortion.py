"""Distortion and lateral color, as lens data sheets, camera calibrations and design programs state them.

Ideal heights are those of the distortion-free lens: image distance times the tangent of the field angle. Both combine
to a `RadialMapping`, which also defines the curve between tabulated heights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.optics.checks import camera_wavelengths, check_number, check_type, number_array
from photosite.optics.field_points import FieldPoints, even_curve
from photosite.optics.mapping import RadialMapping, image_height

Array = NDArray[np.float64]

_NODES = 65
"""Heights of a mapping that combines several tables."""
_ANY_WAVELENGTH_NM = np.array([550.0])
_LARGEST_SHARE = 0.1
"""Largest lateral color relative to the image height; more indicates a wrong unit."""
_LEAST_RATIO = 0.2
"""Smallest ratio of the first point off the axis; fisheyes reach it at 78 degrees."""
_ANY_HEIGHT_M = 1.0
"""Beyond the corner of any sensor."""
_FIELD_EXAMPLE = "FieldPoints(height_mm=[0, 7, 14])"


@dataclass(frozen=True, eq=False)
class Distortion:
    """Real over ideal image height.

    Parameters
    ----------
    field
        Ideal image heights, or field angles.
    ratio
        (n,) real height over ideal height: 1 + percent / 100. The value on the axis is not used.

    Raises
    ------
    InputError
        If the image folds back, no point is off the axis, or the first one has a ratio below 1/5 or above 5, which
        indicates a wrong unit.

    Examples
    --------
    >>> barrel = Distortion.from_percent(FieldPoints(height_mm=[0, 7, 14]), [0, -1, -4])
    >>> barrel.heights_m(0.05)[1] * 1e3
    array([ 0.  ,  6.93, 13.44])
    """

    field: FieldPoints
    ratio: Array

    def __post_init__(self) -> None:
        check_type("field", self.field, FieldPoints, _FIELD_EXAMPLE)
        ratio = number_array("ratio", self.ratio, (self.field.size,))
        object.__setattr__(self, "ratio", ratio)
        self.field.check_off_axis()
        first = float(ratio[int(self.field.starts_on_axis)])
        hint = "Give real heights in mm, and percent as 100 (real / ideal - 1)"
        expected = f"from {_LEAST_RATIO} to {1 / _LEAST_RATIO:g} at the first point off the axis"
        low, high = _LEAST_RATIO, 1 / _LEAST_RATIO
        check_number("ratio", first, expected, at_least=low, at_most=high, hint=hint)
        steps = np.diff(self.heights_m(1.0)[1])
        if (steps <= 0).any():
            raise InputError(
                f"the distorted image folds back {self._place(int(np.argmin(steps)))}",
                hint="Check the sign, the unit (percent of the ideal height) and the order of the field points",
            )

    @classmethod
    def from_percent(cls, field: FieldPoints, percent: ArrayLike) -> Distortion:
        """Return the distortion from 100 (real - ideal) / ideal, negative for a barrel."""
        return cls(field, 1 + number_array("percent", percent) / 100)

    @classmethod
    def from_real_heights(cls, field: FieldPoints, real_mm: ArrayLike, image_distance_mm: float) -> Distortion:
        """Return the distortion from measured image heights.

        Parameters
        ----------
        field
            Ideal heights or field angles, from the axis.
        real_mm
            (n,) heights on the sensor.
        image_distance_mm
            Image distance that turns field angles into ideal heights: the focal length, for far objects.
        """
        ideal = field.ideal_m(image_distance_mm * 1e-3) * 1e3
        real = number_array("real_height_mm", real_mm, (field.size,))
        if field.starts_on_axis and real[0] != 0:
            raise InputError("real_height_mm", value=real[0], expected="0 on the axis")
        ratio = np.ones(field.size)
        np.divide(real, ideal, out=ratio, where=ideal > 0)
        return cls(field, ratio)

    @classmethod
    def polynomial(cls, k1: float, k2: float = 0.0, k3: float = 0.0, *, max_field_deg: float = 45.0) -> Distortion:
        """Return the distortion real = ideal (1 + k1 u^2 + k2 u^4 + k3 u^6) of a camera calibration.

        Parameters
        ----------
        k1, k2, k3
            Radial coefficients as in OpenCV (D. C. Brown, Photogrammetric Engineering 37 (1971) 855), for the tangent
            of the field angle u, ideal height over image distance.
        max_field_deg
            Largest field angle of validity, at least that of the frame's corner.

        Raises
        ------
        InputError
            If the image folds back before max_field_deg, or a value is out of range.

        Examples
        --------
        >>> Distortion.polynomial(-0.1, max_field_deg=20).ratio[-1].round(6)
        np.float64(0.986753)
        >>> Distortion.polynomial(-0.9)
        Traceback (most recent call last):
        photosite.errors.InputError: the distorted image folds back at 31.33 degrees. Lower max_field_deg...
        """
        for name, value in (("k1", k1), ("k2", k2), ("k3", k3)):
            check_number(name, value)
        check_number("max_field_deg", max_field_deg, "between 0 and 90", above=0, below=90)
        u = math.tan(math.radians(max_field_deg)) * np.sqrt(np.linspace(0.0, 1.0, _NODES))
        fine = np.linspace(0.0, u[-1], 4001)
        slope = 1 + 3 * k1 * fine**2 + 5 * k2 * fine**4 + 7 * k3 * fine**6
        if (slope <= 0).any():
            turn = math.degrees(math.atan(fine[np.argmax(slope <= 0)]))
            raise InputError(
                f"the distorted image folds back at {turn:.4g} degrees",
                hint="Lower max_field_deg: k1, k2, k3 hold up to the corner of the calibrated frame only",
            )
        angle = np.degrees(np.arctan(u))
        return cls(FieldPoints(angle_deg=angle), 1 + k1 * u**2 + k2 * u**4 + k3 * u**6)

    def heights_m(self, image_distance_m: float) -> tuple[Array, Array]:
        """Return ideal and real image heights, both from 0."""
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
    """Radial displacement of each wavelength's image from the distorted position, positive outwards.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing; linear in between, the nearest one beyond.
    field
        Image heights on the sensor without lateral color, or field angles.
    shift_um
        (L, n).
    everywhere
        Whether the shift continues in proportion to height beyond the last point, as that of a magnification does.

    Raises
    ------
    InputError
        If a shift exceeds a tenth of the image height or a wavelength is below 100 nm, which indicates a wrong unit.

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
        check_type("field", self.field, FieldPoints, _FIELD_EXAMPLE)
        grid = camera_wavelengths(self.wavelength_nm)
        shift = number_array("shift_um", self.shift_um, (grid.size, self.field.size))
        self.field.check_off_axis()
        height = self.field.height_mm
        if height is not None:
            excess = np.abs(shift) > _LARGEST_SHARE * 1e3 * np.maximum(height, 1e-3)
            if excess.any():
                raise InputError(
                    "shift_um",
                    value=shift[excess][0],
                    expected="at most a tenth of the image height",
                    hint="Give shifts in um, positive outwards, 0 on the axis",
                )
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "shift_um", shift)

    @classmethod
    def from_magnification(cls, wavelength_nm: ArrayLike, magnification: ArrayLike) -> LateralColor:
        """Return the lateral color from image heights relative to those of the reference wavelength."""
        scale = number_array("magnification", magnification, (np.size(wavelength_nm),))
        shift = ((scale - 1) * 1e3)[:, None].round(12)
        return cls(np.asarray(wavelength_nm, np.float64), FieldPoints(height_mm=np.array([1.0])), shift, True)


def combined_mapping(
    distortion: Distortion | None, lateral_color: LateralColor | None, image_distance_m: float
) -> RadialMapping | None:
    """Return distortion and lateral color as one mapping; None if both are None.

    The image distance turns field angles into heights.
    """
    achromatic = None
    if distortion is not None:
        ideal, real = distortion.heights_m(image_distance_m)
        achromatic = RadialMapping(_ANY_WAVELENGTH_NM, ideal, real[None])
    if lateral_color is None:
        return achromatic
    heights = lateral_color.field.ideal_m(image_distance_m)
    known_m = _ANY_HEIGHT_M if lateral_color.everywhere else heights[-1]
    ideal = (known_m if achromatic is None else achromatic.ideal_m[-1]) * np.sqrt(np.linspace(0.0, 1.0, _NODES))
    real = ideal
    if achromatic is not None:
        curve = image_height(achromatic, float(achromatic.wavelength_nm[0]))
        real = curve(ideal)
        if lateral_color.field.angle_deg is not None:
            heights = curve(heights)
    return RadialMapping(lateral_color.wavelength_nm, ideal, real + _shifts_m(lateral_color, heights, real))


def _shifts_m(color: LateralColor, table_m: Array, real_m: Array) -> Array:
    """Return (L, n) shifts: shift over height is an even function, constant beyond the table."""
    off_axis = table_m > 0
    share = color.shift_um[:, off_axis] * 1e-6 / table_m[off_axis]
    return np.stack([real_m * even_curve(table_m[off_axis], row, real_m) for row in share])
