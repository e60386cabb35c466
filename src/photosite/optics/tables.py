"""Measured or externally computed blur: tables of OTFs and of PSFs by wavelength.

A table applies on the sensor, at the working distance and focus it was made for: it is not scaled with magnification,
f-number or focus. Between its wavelengths it is linear, beyond them the nearest one applies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.optics.checks import camera_wavelengths, number_array
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import (
    Constant,
    PlanePsf,
    RadialPsf,
    SampledPsf,
    check_spacing,
    encircled_radius,
    sampled_otf,
)
from photosite.values.shown import Shown

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_UNITY_TOLERANCE = 1e-3
"""Tolerance on an OTF of 1 at frequency 0, and on the sum of a PSF."""
_LARGEST_END = 0.02
"""Modulation at the end of a table up to which it is taken as 0 beyond."""
_COARSE_MODULATION = 0.05
"""Modulation at the Nyquist frequency above which a PSF is undersampled."""
_ENCLOSED = 0.995


class PsfOptions(TypedDict, total=False):
    """What a file of PSFs need not state, see `PsfTable`."""

    spacing_um: float
    wavelength_nm: ArrayLike
    normalize: bool


@dataclass(frozen=True, eq=False)
class OtfTable(Shown):
    """OTFs over frequency for one or more wavelengths: a `Blur`.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    frequency_per_mm
        (n,) increasing from 0, cycles/mm on the sensor. With `fx_per_mm`: frequencies down the rows, symmetric about 0
        or from 0.
    values
        (L, n), real: MTF, or OTFs that change sign. With `fx_per_mm`: (L, n, m), complex.
    fx_per_mm
        (m,) increasing, frequencies along the columns of a lens without rotational symmetry. One of the two axes may
        begin at 0: the other half plane is the conjugate.
    beyond
        Values beyond the last frequency. "zero": the table must end at 2 % or less. "diffraction": the OTF of a lens
        without aberrations, scaled to the last value; radial tables only.

    Raises
    ------
    InputError
        If shapes do not match, an axis does not increase, a value is above 1 or not 1 at 0, the two halves of a 2-D
        table are not conjugate, or the table ends too high.

    Notes
    -----
    Radial tables are interpolated by monotone cubics (Fritsch and Carlson 1980), which do not overshoot; 2-D tables by
    cubic splines.

    Examples
    --------
    >>> table = OtfTable([550.0], [0.0, 50.0, 100.0], [[1.0, 0.5, 0.0]])
    >>> table.point_spread(DiffractionLimited(8, 50), 1.2).otf(np.array([0.0, 5e4, 2e5]), 600.0)
    array([1. , 0.5, 0. ])
    """

    wavelength_nm: Array
    frequency_per_mm: Array
    values: Complex | Array
    fx_per_mm: Array | None = None
    beyond: Literal["zero", "diffraction"] = "zero"

    def __post_init__(self) -> None:
        grid = camera_wavelengths(self.wavelength_nm)
        fy = _frequency_axis(self.frequency_per_mm, "frequency_per_mm")
        fx = None if self.fx_per_mm is None else _frequency_axis(self.fx_per_mm, "fx_per_mm")
        if np.iscomplexobj(self.values) and fx is None:
            raise InputError("values", expected="real for a radial table: MTF, or OTFs that change sign")
        if not np.iscomplexobj(self.values):
            number_array("values", self.values)
        values: NDArray[Any] = np.array(self.values, dtype=np.float64 if fx is None else np.complex128)
        shape = (grid.size, fy.size) if fx is None else (grid.size, fy.size, fx.size)
        if values.shape != shape:
            axes = "(wavelengths, frequencies)" if fx is None else "(wavelengths, fy, fx)"
            raise InputError("values", value=values.shape, expected=f"of shape {shape}, {axes}")
        if self.beyond not in ("zero", "diffraction") or (fx is not None and self.beyond != "zero"):
            expected = "'zero', or for radial tables 'diffraction'"
            raise InputError("beyond", value=self.beyond, expected=expected)
        if not np.isfinite(values).all():
            raise InputError("values", expected="finite")
        if fx is None and fy[0] != 0:
            raise InputError("frequency_per_mm", value=fy[0], expected="0 at first, where an OTF is 1")
        self._check_values(grid, fy, fx, values)
        for name, value in (("wavelength_nm", grid), ("frequency_per_mm", fy), ("values", values), ("fx_per_mm", fx)):
            object.__setattr__(self, name, value)

    def _check_values(self, grid: Array, fy: Array, fx: Array | None, values: NDArray[Any]) -> None:
        largest = np.abs(values).reshape(grid.size, -1).max(axis=1)
        if (largest > 1 + _UNITY_TOLERANCE).any():
            k = int(largest.argmax())
            expected = f"at most 1 at {grid[k]:g} nm"
            raise InputError("values", value=largest[k], expected=expected, hint="Divide values in percent by 100")
        if fx is None:
            at_zero = values[:, 0]
        else:
            if 0.0 not in fy or 0.0 not in fx:
                raise InputError("frequency_per_mm and fx_per_mm", expected="axes that contain 0 in a 2-D table")
            at_zero = values[:, int(np.searchsorted(fy, 0.0)), int(np.searchsorted(fx, 0.0))]
            _check_halves(fy, fx, values)
        if (np.abs(at_zero - 1) > _UNITY_TOLERANCE).any():
            k = int(np.abs(at_zero - 1).argmax())
            hint = "Divide the values of each wavelength by the one at frequency 0"
            raise InputError("values", value=at_zero[k], expected=f"1 at frequency 0, {grid[k]:g} nm", hint=hint)
        edges = [values[:, -1]] if fx is None else [values[:, -1], values[:, :, -1]]
        edges += [] if fx is None else [part for f, part in ((fy, values[:, 0]), (fx, values[:, :, 0])) if f[0] < 0]
        highest = max(float(np.abs(edge).max()) for edge in edges)
        if self.beyond == "zero" and highest > _LARGEST_END:
            expected = f"{_LARGEST_END} or less at the last frequency, {fy[-1]:g} per mm"
            hint = "Continue the table" + ("" if fx is not None else ", or pass beyond='diffraction'")
            raise InputError("values", value=highest, expected=expected, hint=hint)

    def point_spread(
        self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> RadialPsf | PlanePsf:
        """Return the PSF on the sensor; lens and distances only affect the diffraction beyond the table's end."""
        if self.fx_per_mm is not None:
            plane = _PlaneOtf(self)
            return PlanePsf(plane.otf, Constant(plane.corner_per_m), plane.reach_m, self.wavelength_nm)
        radial = _RadialOtf(self, base, distance_m if focus_distance_m is None else focus_distance_m)
        return RadialPsf(radial.otf, radial.cutoff_per_m, radial.reach_m)


@dataclass(frozen=True, eq=False)
class _RadialOtf:
    """The interpolated radial table, with the diffraction beyond its end."""

    table: OtfTable
    base: DiffractionLimited
    focused_m: float

    @cached_property
    def last_per_m(self) -> float:
        return float(self.table.frequency_per_mm[-1]) * 1e3

    @cached_property
    def _curves(self) -> Any:
        from scipy.interpolate import PchipInterpolator

        values = self.table.values / self.table.values[:, :1]
        return PchipInterpolator(self.table.frequency_per_mm, values, axis=1)

    def cutoff_per_m(self, wavelength_nm: float) -> float:
        if self.table.beyond == "zero":
            return self.last_per_m
        return max(self.last_per_m, self.base.cutoff_per_m(wavelength_nm, self.focused_m))

    def otf(self, frequency_per_m: Array, wavelength_nm: float) -> Array:
        f = np.abs(np.asarray(frequency_per_m, np.float64))
        curves = self._curves(np.minimum(f, self.last_per_m) * 1e-3)
        low, high, fraction = _neighbors(self.table.wavelength_nm, wavelength_nm)
        inside: Array = (1 - fraction) * curves[low] + fraction * curves[high]
        if self.table.beyond == "zero":
            return np.where(f <= self.last_per_m, inside, 0.0)
        end = float(self.base.otf(np.array([self.last_per_m]), wavelength_nm, self.focused_m)[0])
        tail = self.base.otf(f, wavelength_nm, self.focused_m) / end if end > 0 else np.zeros(f.shape)
        return np.where(f <= self.last_per_m, inside, inside * tail)

    def reach_m(self, wavelength_nm: float) -> float:
        f = np.linspace(0.0, self.cutoff_per_m(wavelength_nm), 2001)
        return _enclosing_radius(f, self.otf(f, wavelength_nm))


class _PlaneOtf:
    def __init__(self, table: OtfTable) -> None:
        from scipy.interpolate import RectBivariateSpline

        assert table.fx_per_mm is not None
        self.wavelength_nm = table.wavelength_nm
        self.fy, self.fx = fy, fx = table.frequency_per_mm, table.fx_per_mm
        zero = int(np.searchsorted(fy, 0.0)), int(np.searchsorted(fx, 0.0))
        order = min(3, fy.size - 1), min(3, fx.size - 1)
        self.splines = []
        for values in table.values / table.values[:, zero[0], zero[1]][:, None, None]:
            parts = (np.ascontiguousarray(part) for part in (values.real, values.imag))
            self.splines.append([RectBivariateSpline(fy, fx, part, kx=order[0], ky=order[1]) for part in parts])
        self.corner_per_m = 1e3 * math.hypot(np.abs(fy).max(), np.abs(fx).max())

    def otf(self, fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> Complex:
        y, x = np.broadcast_arrays(np.asarray(fy_per_m) * 1e-3, np.asarray(fx_per_m) * 1e-3)
        low, high, fraction = _neighbors(self.wavelength_nm, wavelength_nm)
        first = self._at(low, y, x)
        return first if fraction == 0 else (1 - fraction) * first + fraction * self._at(high, y, x)

    def _at(self, index: int, y: Array, x: Array) -> Complex:
        """Return the OTF of one tabulated wavelength; the half plane that the table lacks is the conjugate."""
        fy, fx = self.fy, self.fx
        flip = np.where(((x < 0) & (fx[0] == 0)) | ((y < 0) & (fy[0] == 0)), -1.0, 1.0)
        inside = (flip * y >= fy[0]) & (flip * y <= fy[-1]) & (flip * x >= fx[0]) & (flip * x <= fx[-1])
        real, imag = (spline.ev(flip * y, flip * x) for spline in self.splines[index])
        return np.where(inside, real + 1j * flip * imag, 0.0)

    def reach_m(self, wavelength_nm: float) -> float:
        # The energy within a radius depends on the mean of the OTF over directions only.
        f = np.linspace(0.0, self.corner_per_m, 801)
        angle = np.arange(0.0, math.pi, math.pi / 36)[:, None]
        mean = self.otf(f * np.sin(angle), f * np.cos(angle), wavelength_nm).real.mean(axis=0)
        return _enclosing_radius(f, mean)


@dataclass(frozen=True, eq=False)
class PsfTable(Shown):
    """Sampled PSFs for one or more wavelengths: a `Blur`.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    samples
        (L, n, n): point values of the PSF, not cell means; first row on top. The image point is the sample
        (n // 2, n // 2), the middle one for odd n; a centroid elsewhere shifts the image. Each wavelength sums to 1.
    spacing_um
        Distance between samples on the sensor.
    normalize
        Divide each wavelength by its sum.

    Raises
    ------
    InputError
        If shapes do not match, samples are below -0.1 % of the peak, do not sum to 1 within 0.001, or are too coarse.

    Notes
    -----
    The OTF is the Fourier sum of the samples up to the Nyquist frequency, and 0 beyond. If it is above 0.05 there, the
    table is rejected as too coarse; a spacing of lambda N / 2 is fine enough for a lens without aberrations.

    Examples
    --------
    >>> x = np.arange(-8, 9) * 0.5
    >>> gauss = np.exp(-(x[:, None] ** 2 + x**2) / 2)
    >>> table = PsfTable([550.0], [gauss / gauss.sum()], spacing_um=0.5)
    >>> table.point_spread(DiffractionLimited(8, 50), 1.2).otf(np.array([0.0]), np.array([1e5]), 500.0).real.round(4)
    array([0.8209])
    """

    wavelength_nm: Array
    samples: Array
    spacing_um: float
    normalize: bool = False

    def __post_init__(self) -> None:
        grid = camera_wavelengths(self.wavelength_nm)
        samples = number_array("samples", self.samples)
        if not samples.size or samples.ndim != 3 or samples.shape != (grid.size, samples.shape[1], samples.shape[1]):
            expected = f"an array (L, n, n) for {grid.size} wavelengths L"
            raise InputError("samples", value=samples.shape, expected=expected)
        check_spacing(self.spacing_um)
        sums = np.array([_checked_sum(s, w, self.spacing_um) for s, w in zip(samples, grid, strict=True)])
        for k in np.flatnonzero(np.abs(sums - 1) > _UNITY_TOLERANCE):
            if not self.normalize:
                hint = "Divide the samples by their sum, or pass normalize=True"
                raise InputError("samples", where=f"{grid[k]:g} nm", value=sums[k], expected="of sum 1", hint=hint)
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "samples", samples / sums[:, None, None])

    def point_spread(
        self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> PlanePsf:
        """Return the PSF on the sensor, whatever the lens and the distances."""
        corner_per_m = math.sqrt(2) * 0.5 / (self.spacing_um * 1e-6)
        return PlanePsf(self._sampled, Constant(corner_per_m), self._reach_m, self.wavelength_nm)

    @property
    def _sampled(self) -> SampledPsf:
        return SampledPsf(self.wavelength_nm, self.samples, self.spacing_um * 1e-6)

    def _reach_m(self, wavelength_nm: float) -> float:
        return encircled_radius(self._sampled.samples_at(wavelength_nm), self.spacing_um * 1e-6, _ENCLOSED)


def _frequency_axis(values: Array, name: str) -> Array:
    axis = number_array(name, values)
    if axis.ndim != 1 or axis.size < 2 or not np.isfinite(axis).all() or (np.diff(axis) <= 0).any():
        hint = "Sort the table"
        raise InputError(name, value=axis.tolist(), expected="2 or more increasing frequencies in cycles/mm", hint=hint)
    return axis


def _check_halves(fy: Array, fx: Array, values: NDArray[Any]) -> None:
    """Check that values at (fy, fx) and (-fy, -fx) are conjugate, or that the table holds one half plane."""
    if fy[0] == 0 and fx[0] == 0:
        raise InputError("frequency_per_mm", expected="symmetric about 0 if fx_per_mm begins at 0")
    for name, axis, half_plane in (("frequency_per_mm", fy, fx[0] == 0), ("fx_per_mm", fx, fy[0] == 0)):
        if axis[0] != 0 and not np.allclose(axis, -axis[::-1], rtol=1e-9, atol=0):
            expected = "symmetric about 0" + ("" if half_plane else ", or from 0")
            raise InputError(name, value=axis.tolist(), expected=expected)
    if fy[0] < 0 and fx[0] < 0 and np.abs(values - values[:, ::-1, ::-1].conj()).max() > _UNITY_TOLERANCE:
        expected = "conjugate at (fy, fx) and (-fy, -fx), because a PSF is real"
        raise InputError("values", expected=expected, hint="Check the order of the axes")


def _checked_sum(samples: Array, wavelength_nm: float, spacing_um: float) -> float:
    where = f"PSF at {wavelength_nm:g} nm"
    if not np.isfinite(samples).all():
        raise InputError("samples", where=where, expected="finite")
    total, peak = float(samples.sum()), float(samples.max())
    if not (total > 0 and peak > 0):
        raise InputError("samples", where=where, value=total, expected="of a sum above 0", hint="Check the sign")
    if samples.min() < -1e-3 * peak:
        hint = "Subtract less background, or set negative samples to 0"
        expected = f"above -0.1 % of the peak of {peak:g}"
        raise InputError("samples", where=where, value=samples.min(), expected=expected, hint=hint)
    nyquist = np.array([0.5 / (spacing_um * 1e-6), 0.0])
    modulation = np.abs(sampled_otf(samples, spacing_um * 1e-6, nyquist, nyquist[::-1])).max() / total
    if modulation > _COARSE_MODULATION:
        expected = (
            f"fine enough: the modulation at the Nyquist frequency is {modulation:.2f}, above {_COARSE_MODULATION}"
        )
        raise InputError("spacing_um", where=where, value=spacing_um, expected=expected, hint="Use a finer grid")
    return total


def _neighbors(grid: Array, wavelength_nm: float) -> tuple[int, int, float]:
    """Return the indices of the neighboring wavelengths, and the weight of the second."""
    high = int(np.clip(np.searchsorted(grid, wavelength_nm), 0, grid.size - 1))
    low = max(high - 1, 0) if grid[high] > wavelength_nm else high
    if low == high:
        return low, high, 0.0
    return low, high, float((wavelength_nm - grid[low]) / (grid[high] - grid[low]))


def _enclosing_radius(frequency_per_m: Array, otf: Array) -> float:
    """Return the radius R with 99.5 % of the energy, which is 2 pi R integral of otf(f) J1(2 pi R f) df."""
    from scipy.special import j1

    step = frequency_per_m[1]
    radius = np.geomspace(0.1 / frequency_per_m[-1], 0.2 / step, 240)
    turn = 2 * math.pi * radius
    enclosed = turn * np.trapezoid(otf * j1(turn[:, None] * frequency_per_m), dx=step, axis=1)
    enough = enclosed >= _ENCLOSED
    return float(radius[enough.argmax()] if enough.any() else radius[-1])
