"""Distortion and lateral color: as lenses state them, and the radial mapping of image points that they make.

Between tabulated heights the mapping is the ideal height times a cubic spline in the squared height, since distortion
is an odd function; orders up to the seventh are reproduced exactly. If that spline folds back, the monotone cubic of
Fritsch and Carlson (1980) replaces it. Beyond the last height the mapping is a straight line. Between wavelengths,
heights are interpolated linearly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.optics.checks import camera_wavelengths, check_number, check_type, number_array
from photosite.optics.field_points import FieldPoints, even_curve
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_INVERSE_NODES = 4097
"""Nodes of the inverse, evenly spaced in squared height."""
_CHECKS_PER_INTERVAL = 8
"""Points between two tabulated heights at which the curve must increase."""
_CURVE_POINTS = 1 << 16
"""Points at which the curve is evaluated for its inversion; linear interpolation errs by 1e-10 of the reach."""
_CUBIC_STEP = 2.5
"""Node distance allowed with cubic weights, relative to that with linear weights."""

_NODES = 65
"""Heights of a mapping that combines several tables."""
_ANY_WAVELENGTH_NM = np.array([550.0])
_LARGEST_FRACTION = 0.1
"""Largest lateral color relative to the image height; more indicates a wrong unit."""
_LEAST_RATIO = 0.2
"""Smallest ratio of the first point off the axis; fisheyes reach it at 78 degrees."""
_ANY_HEIGHT_M = 1.0
"""Beyond the corner of any sensor."""
_FIELD_EXAMPLE = "FieldPoints(height_mm=[0, 7, 14])"


@dataclass(frozen=True, eq=False)
class RadialMapping(Shown):
    """Real image heights of a lens: distortion and, with several wavelengths, lateral chromatic aberration.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing; linear in between, the nearest one beyond. One wavelength applies to all light.
    ideal_m
        (n,) increasing from 0: image heights of a distortion-free lens of the same focal length and distance.
    real_m
        (L, n): image heights of this lens, increasing from 0.

    Raises
    ------
    InputError
        If shapes do not match, a value is not finite, or heights or wavelengths do not increase.
    """

    wavelength_nm: Array
    ideal_m: Array
    real_m: Array

    def __post_init__(self) -> None:
        grid, ideal, real = (np.asarray(a, np.float64) for a in (self.wavelength_nm, self.ideal_m, self.real_m))
        vectors = grid.ndim == ideal.ndim == 1
        if not vectors or grid.size < 1 or ideal.size < 2 or real.shape != (grid.size, ideal.size):
            expected = f"of shape (L, n), n >= 2, for wavelength_nm {grid.shape} and ideal_m {ideal.shape}"
            raise InputError("real_m", value=real.shape, expected=expected)
        for name, values in (("wavelength_nm", grid), ("ideal_m", ideal), ("real_m", real)):
            if not np.isfinite(values).all():
                raise InputError(name, value=values.tolist(), expected="finite")
            if (np.diff(values) <= 0).any() or (name != "wavelength_nm" and (values[..., 0] != 0).any()):
                expected = "increasing" if name == "wavelength_nm" else "increasing from 0"
                raise InputError(name, value=values.tolist(), expected=expected)
            object.__setattr__(self, name, values)


@dataclass(frozen=True, eq=False)
class HeightCurve:
    """Real image height as a function of ideal image height at one wavelength, both in m.

    `tabulated` is the curve up to `last_m`, the last tabulated ideal height; beyond, it is straight, with `end_slope`.
    """

    tabulated: Callable[[Any], Any]
    last_m: float
    end_slope: float

    def __call__(self, ideal_m: Array) -> Array:
        inside = np.asarray(self.tabulated(np.minimum(ideal_m, self.last_m)), np.float64)
        return inside + self.end_slope * np.maximum(np.asarray(ideal_m) - self.last_m, 0.0)


def heights_at(mapping: RadialMapping, wavelength_nm: float) -> Array:
    """Return the (n,) real image heights at one wavelength, m."""
    grid = mapping.wavelength_nm
    at = float(np.clip(wavelength_nm, grid[0], grid[-1]))
    if grid.size == 1:
        return np.asarray(mapping.real_m[0], np.float64)
    index = int(np.clip(np.searchsorted(grid, at, side="right") - 1, 0, grid.size - 2))
    fraction = (at - grid[index]) / (grid[index + 1] - grid[index])
    return np.asarray(
        mapping.real_m[index] + fraction * (mapping.real_m[index + 1] - mapping.real_m[index]), np.float64
    )


def image_height(mapping: RadialMapping, wavelength_nm: float) -> HeightCurve:
    """Return the curve from ideal to real image heights at one wavelength.

    Examples
    --------
    >>> barrel = RadialMapping(np.array([550.0]), np.array([0.0, 5e-3, 10e-3]), np.array([[0.0, 4.95e-3, 9.6e-3]]))
    >>> image_height(barrel, 550.0)(np.array([0.0, 5e-3, 10e-3]))
    array([0.     , 0.00495, 0.0096 ])
    """
    from scipy.interpolate import PchipInterpolator

    ideal, real = mapping.ideal_m, heights_at(mapping, wavelength_nm)
    curve = _odd_spline(ideal, real)
    fractions = np.linspace(0.0, 1.0, _CHECKS_PER_INTERVAL, endpoint=False)
    fine = np.append((ideal[:-1, None] + fractions * np.diff(ideal)[:, None]).ravel(), ideal[-1])
    if (np.diff(curve(fine)) <= 0).any():
        curve = PchipInterpolator(np.concatenate([-ideal[:0:-1], ideal]), np.concatenate([-real[:0:-1], real]))
    end = float(ideal[-1])
    near_end = end - 1e-4 * float(ideal[-1] - ideal[-2])
    return HeightCurve(curve, end, float(curve(end) - curve(near_end)) / (end - near_end))


def _odd_spline(ideal: Array, real: Array) -> Callable[[Any], Any]:
    from scipy.interpolate import CubicSpline

    ratio = real[1:] / ideal[1:]
    if ratio.size == 1:
        return lambda height: height * ratio[0]
    spline = CubicSpline(ideal[1:] ** 2, ratio)
    return lambda height: height * spline(np.square(height))


def inverse_scale(mapping: RadialMapping, wavelength_nm: float, reach_m: float) -> tuple[Array, float]:
    """Return ideal over real image height, evenly spaced in squared real height, and that spacing in m^2.

    The (4097,) values reach from the axis to `reach_m`, the largest real height that is needed.

    Examples
    --------
    >>> smaller = RadialMapping(np.array([550.0]), np.array([0.0, 10e-3]), np.array([[0.0, 8e-3]]))
    >>> scale, step_m2 = inverse_scale(smaller, 550.0, 12e-3)
    >>> scale.round(9).min(), scale.round(9).max()
    (np.float64(1.25), np.float64(1.25))
    """
    curve = image_height(mapping, wavelength_nm)
    far = float(mapping.ideal_m[-1])
    while curve(np.array([far]))[0] < reach_m:  # ends: beyond the table the curve is straight and increases
        far *= 2
    ideal = np.linspace(0.0, far, _CURVE_POINTS)
    step_m2 = reach_m**2 / (_INVERSE_NODES - 1)
    real = np.sqrt(step_m2 * np.arange(1, _INVERSE_NODES))
    scale = np.interp(real, curve(ideal), ideal) / real
    # On the axis the quotient is the derivative. The curve is odd, so the scale is even and flat at its first node.
    first = ideal[1] / curve(ideal[1:2])
    return np.concatenate([first, scale]), step_m2


def wavelength_nodes(
    mapping: RadialMapping, wavelength_nm: Array, reach_m: float, step_m: float
) -> tuple[Array, Array]:
    """Return a few of the (wavelengths,), whose images represent all, and the (nodes, wavelengths) weights on them.

    `reach_m` is the largest ideal image height that is needed. `step_m` is the largest distance between the images of
    neighboring nodes, where it is largest, for linear weights on two nodes. Weights sum to 1 over the nodes; cubic
    ones may be negative.

    Notes
    -----
    Linear weights leave (1 / 8) (2 pi f h)^2 of a wave of frequency f between nodes at the distance h; Lagrange's cubic
    weights on four nodes leave (3 / 128) (2 pi f h)^4. At half a cycle per 5 steps, cubic weights are as good at 2.5
    times the distance, and better at lower frequencies. Whichever needs fewer nodes is used.

    Examples
    --------
    >>> colors = RadialMapping(np.array([400.0, 700.0]), np.array([0, 1e-2]), np.array([[0, 1e-2], [0, 1.0004e-2]]))
    >>> nodes, weights = wavelength_nodes(colors, np.arange(400.0, 701.0, 10), 1e-2, 1e-6)
    >>> nodes, weights.shape
    (array([400., 500., 600., 700.]), (4, 31))
    """
    grid = np.asarray(wavelength_nm, np.float64)
    single = np.array([grid[grid.size // 2]]), np.ones((1, grid.size))
    if mapping.wavelength_nm.size == 1 or grid.size == 1:
        return single
    ideal = np.linspace(0.0, reach_m, 33)
    real = np.stack([image_height(mapping, w)(ideal) for w in grid])
    # Path length of the image from the first wavelength to each; nodes are evenly spaced along it.
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(real, axis=0)).max(axis=1))])
    linear, cubic = (math.ceil(path[-1] / step - 1e-6) + 1 for step in (step_m, _CUBIC_STEP * step_m))
    count = min(linear, max(cubic, 4))
    if count == 1:
        return single
    if count >= grid.size:
        return grid, np.eye(grid.size)
    places = np.linspace(0.0, path[-1], count)
    moving = np.concatenate([[True], np.diff(path) > 0])
    nodes = np.interp(places, path[moving], grid[moving])
    position = np.clip(path / places[1], 0.0, count - 1)
    return nodes, _lagrange_weights(position, count)


def _lagrange_weights(position: Array, count: int) -> Array:
    """Return (count, n) Lagrange weights at positions 0 to count - 1: cubic, or linear for fewer than four nodes."""
    points = 4 if count >= 4 else 2
    first = np.clip(np.floor(position).astype(np.int64) - (points // 2 - 1), 0, count - points)
    weights = np.zeros((count, position.size))
    for own in range(points):
        others = [other for other in range(points) if other != own]
        weight = np.prod([(position - first - other) / (own - other) for other in others], axis=0)
        weights[first + own, np.arange(position.size)] = weight
    return weights


# Distortion and lateral color, as lens data sheets, camera calibrations and design programs state them.
#
# Ideal heights are those of the distortion-free lens: image distance times the tangent of the field angle. Both combine
# to a `RadialMapping`, which also defines the curve between tabulated heights.


@dataclass(frozen=True, eq=False)
class Distortion(Shown):
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
class LateralColor(Shown):
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
            excess = np.abs(shift) > _LARGEST_FRACTION * 1e3 * np.maximum(height, 1e-3)
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
    # Shift over height is an even function, constant beyond the table.
    off_axis = heights > 0
    relative = lateral_color.shift_um[:, off_axis] * 1e-6 / heights[off_axis]
    shifts = np.stack([real * even_curve(heights[off_axis], row, real) for row in relative])
    return RadialMapping(lateral_color.wavelength_nm, ideal, real + shifts)
