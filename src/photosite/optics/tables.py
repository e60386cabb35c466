"""Blurs that were measured, or computed elsewhere: tables of transfer functions and of point spreads by wavelength.

A table is what it is on the sensor, at the working distance and focus it was made for: it is not scaled with
magnification, f-number or focus. Between its wavelengths it is linear in wavelength, beyond them that of the nearest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_numbers
from photosite.optics.lens import DiffractionLimited, camera_wavelengths
from photosite.optics.radial_table import numbers
from photosite.optics.sampled import check_spacing, light_radius, transfer
from photosite.optics.spread import PlaneSpread, RadialSpread

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_ONE = 1e-3
"""How far from 1 a transfer function at 0, or the sum of a point spread, may be."""
_ENDED = 0.02
"""Modulation with which a table may end and be taken as 0 beyond."""
_SHARE = 0.995


@dataclass(frozen=True, eq=False)
class OtfTable:
    """Transfer functions over frequency, for one wavelength or more.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    frequency_per_mm
        (n,) increasing from 0, cycles/mm on the sensor; with `fx_per_mm`: frequencies down the rows, from negative to
        positive or from 0.
    values
        (L, n), real: MTF, or transfer functions that change sign; with `fx_per_mm` (L, n, m), complex.
    fx_per_mm
        (m,) increasing, frequencies along the columns, where the lens is not rotationally symmetric. One of the two
        axes may begin at 0: the other half plane is the conjugate.
    beyond
        What lies beyond the last frequency: "zero" where the table has come down to 2 %; "diffraction": from its last
        value it falls as a lens without aberrations does. 2-D tables: "zero" only.

    Raises
    ------
    InputError
        If shapes do not fit, an axis does not increase, a value is above 1 or not 1 at 0, the two halves of a 2-D table
        are not each other's conjugates, or the table ends too high.

    Notes
    -----
    Between frequencies, radial tables are monotone cubics (Fritsch and Carlson 1980), which pass no peak that the table
    does not have; 2-D ones are cubic splines.

    Examples
    --------
    >>> table = OtfTable([550.0], [0.0, 50.0, 100.0], [[1.0, 0.5, 0.0]])
    >>> table.spread(DiffractionLimited(8, 50), 1.2).otf(np.array([0.0, 5e4, 2e5]), 600.0)
    array([1. , 0.5, 0. ])
    """

    wavelength_nm: Array
    frequency_per_mm: Array
    values: Complex | Array
    fx_per_mm: Array | None = None
    beyond: Literal["zero", "diffraction"] = "zero"

    def __post_init__(self) -> None:
        grid = camera_wavelengths(self.wavelength_nm)
        fy = _axis(self.frequency_per_mm, "frequency_per_mm")
        fx = None if self.fx_per_mm is None else _axis(self.fx_per_mm, "fx_per_mm")
        if np.iscomplexobj(self.values) and fx is None:
            raise InputError("values of a radial table are real: MTF, or transfer functions that change sign")
        if not np.iscomplexobj(self.values):
            numbers("values", self.values)  # refuses what is none
        values: NDArray[Any] = np.array(self.values, dtype=np.float64 if fx is None else np.complex128)
        shape = (grid.size, fy.size) if fx is None else (grid.size, fy.size, fx.size)
        if values.shape != shape:
            names = "(wavelengths, frequencies)" if fx is None else "(wavelengths, fy, fx)"
            raise InputError(f"values of a table of transfer functions are {names}, {shape} here, not {values.shape}")
        if self.beyond not in ("zero", "diffraction") or (fx is not None and self.beyond != "zero"):
            raise InputError(f"beyond a table lies 'zero', or for radial ones 'diffraction', not '{self.beyond}'")
        if not np.isfinite(values).all():
            raise InputError("a table of transfer functions must be finite; some values are NaN or infinite")
        if fx is None and fy[0] != 0:
            raise InputError(f"frequencies begin at 0, where a transfer function is 1; these begin at {fy[0]:g} per mm")
        self._check_values(grid, fy, fx, values)
        for name, value in (("wavelength_nm", grid), ("frequency_per_mm", fy), ("values", values), ("fx_per_mm", fx)):
            object.__setattr__(self, name, value)

    def _check_values(self, grid: Array, fy: Array, fx: Array | None, values: NDArray[Any]) -> None:
        largest = np.abs(values).reshape(grid.size, -1).max(axis=1)
        if (largest > 1 + _ONE).any():
            k = int(largest.argmax())
            raise InputError(
                f"a transfer function is never above 1: {largest[k]:g} at {grid[k]:g} nm; if the table is in percent, "
                "divide it by 100"
            )
        if fx is None:
            at_zero = values[:, 0]
        else:
            if 0.0 not in fy or 0.0 not in fx:
                raise InputError("a 2-D table of transfer functions needs frequency 0 on both axes, where it is 1")
            at_zero = values[:, int(np.searchsorted(fy, 0.0)), int(np.searchsorted(fx, 0.0))]
            _check_halves(fy, fx, values)
        if (np.abs(at_zero - 1) > _ONE).any():
            k = int(np.abs(at_zero - 1).argmax())
            raise InputError(
                f"a transfer function is 1 at frequency 0: {at_zero[k]:g} at {grid[k]:g} nm; divide each wavelength's "
                "values by the one at 0"
            )
        edges = [values[:, -1]] if fx is None else [values[:, -1], values[:, :, -1]]
        edges += [] if fx is None else [part for f, part in ((fy, values[:, 0]), (fx, values[:, :, 0])) if f[0] < 0]
        highest = max(float(np.abs(edge).max()) for edge in edges)
        if self.beyond == "zero" and highest > _ENDED:
            mend = "" if fx is not None else ", or say beyond='diffraction'"
            raise InputError(
                f"this table ends while its modulation is still {highest:.3g}, at {fy[-1]:g} per mm: continue it down "
                f"to {_ENDED}{mend}"
            )

    def spread(
        self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> RadialSpread | PlaneSpread:
        """The point spread on the sensor; distances only matter to the diffraction beyond a table's end."""
        if self.fx_per_mm is not None:
            return self._plane_spread()
        last_per_m = float(self.frequency_per_mm[-1]) * 1e3
        focused = distance_m if focus_distance_m is None else focus_distance_m
        curves = self._curves()

        def cutoff_per_m(wavelength_nm: float) -> float:
            if self.beyond == "zero":
                return last_per_m
            return max(last_per_m, base.cutoff_per_m(wavelength_nm, focused))

        def otf(frequency_per_m: Array, wavelength_nm: float) -> Array:
            f = np.abs(np.asarray(frequency_per_m, np.float64))
            inside = _mixed(curves(np.minimum(f, last_per_m) * 1e-3), self.wavelength_nm, wavelength_nm)
            if self.beyond == "zero":
                return np.where(f <= last_per_m, inside, 0.0)
            end = float(base.otf(np.array([last_per_m]), wavelength_nm, focused)[0])
            tail = base.otf(f, wavelength_nm, focused) / end if end > 0 else np.zeros(f.shape)
            return np.where(f <= last_per_m, inside, inside * tail)

        def reach_m(wavelength_nm: float) -> float:
            f = np.linspace(0.0, cutoff_per_m(wavelength_nm), 2001)
            return _reach(f, otf(f, wavelength_nm))

        return RadialSpread(otf, cutoff_per_m, reach_m)

    def _curves(self) -> Callable[[Array], Array]:
        """Cubics through the table, normalised to 1 at 0: frequencies per mm -> (L, ...)."""
        from scipy.interpolate import PchipInterpolator

        values = self.values / self.values[:, :1]
        curves: Callable[[Array], Array] = PchipInterpolator(self.frequency_per_mm, values, axis=1)
        return curves

    def _plane_spread(self) -> PlaneSpread:
        from scipy.interpolate import RectBivariateSpline

        assert self.fx_per_mm is not None
        fy, fx = self.frequency_per_mm, self.fx_per_mm
        zero = int(np.searchsorted(fy, 0.0)), int(np.searchsorted(fx, 0.0))
        order = min(3, fy.size - 1), min(3, fx.size - 1)
        splines = []
        for values in self.values / self.values[:, zero[0], zero[1]][:, None, None]:
            parts = (np.ascontiguousarray(part) for part in (values.real, values.imag))
            splines.append([RectBivariateSpline(fy, fx, part, kx=order[0], ky=order[1]) for part in parts])
        half_rows, half_cols = fy[0] == 0, fx[0] == 0

        def one(index: int, y: Array, x: Array) -> Complex:
            flip = np.where(((x < 0) & half_cols) | ((y < 0) & half_rows), -1.0, 1.0)
            inside = (flip * y >= fy[0]) & (flip * y <= fy[-1]) & (flip * x >= fx[0]) & (flip * x <= fx[-1])
            real, imag = (spline.ev(flip * y, flip * x) for spline in splines[index])
            result: Complex = np.where(inside, real + 1j * flip * imag, 0.0)
            return result

        def otf(fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> Complex:
            y, x = np.broadcast_arrays(np.asarray(fy_per_m) * 1e-3, np.asarray(fx_per_m) * 1e-3)
            low, high, share = _between(self.wavelength_nm, wavelength_nm)
            first = one(low, y, x)
            return first if share == 0 else (1 - share) * first + share * one(high, y, x)

        corner_per_m = 1e3 * math.hypot(np.abs(fy).max(), np.abs(fx).max())

        def reach_m(wavelength_nm: float) -> float:
            # Light within a radius depends on the transfer function's mean over directions alone.
            f = np.linspace(0.0, corner_per_m, 801)
            angle = np.arange(0.0, math.pi, math.pi / 36)[:, None]
            mean = otf(f * np.sin(angle), f * np.cos(angle), wavelength_nm).real.mean(axis=0)
            return _reach(f, mean)

        return PlaneSpread(otf, lambda _: corner_per_m, reach_m, self.wavelength_nm)


@dataclass(frozen=True, eq=False)
class PsfTable:
    """Point spreads as samples, for one wavelength or more.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    samples
        (L, n, n): values of the point spread at evenly spaced points, not means over cells; first row on top. The
        image's place is the sample (n // 2, n // 2), the middle one where n is odd; a centroid elsewhere is kept, the
        image is then shifted. Each wavelength sums to 1.
    spacing_um
        Between samples, on the sensor.
    normalise
        Divide each wavelength by its sum, whatever it is.

    Raises
    ------
    InputError
        If shapes do not fit, a spacing is missing, samples are negative by more than 0.1 % of the peak, do not sum to 1
        within 0.001, or are too coarse to say what lies between them.

    Notes
    -----
    Samples stand for the band-limited function through them: its transfer function is their Fourier sum up to half the
    sampling frequency, and 0 beyond. Where that is still above 0.05, finer samples are asked for; those of a lens
    without aberrations are fine enough at half a period of its cutoff, lambda N / 2.

    Examples
    --------
    >>> x = np.arange(-8, 9) * 0.5
    >>> gauss = np.exp(-(x[:, None] ** 2 + x**2) / 2)
    >>> table = PsfTable([550.0], [gauss / gauss.sum()], spacing_um=0.5)
    >>> table.spread(DiffractionLimited(8, 50), 1.2).otf(np.array([0.0]), np.array([1e5]), 500.0).real.round(4)
    array([0.8209])
    """

    wavelength_nm: Array
    samples: Array
    spacing_um: float
    normalise: bool = False

    def __post_init__(self) -> None:
        grid = camera_wavelengths(self.wavelength_nm)
        check_numbers(self, *(["spacing_um"] if self.spacing_um is not None else []))
        samples = numbers("samples", self.samples)
        if not samples.size:
            raise InputError("a point spread has samples; these are none")
        if samples.ndim != 3 or samples.shape[0] != grid.size or samples.shape[1] != samples.shape[2]:
            raise InputError(
                f"samples of point spreads are (wavelengths, n, n), square, with {grid.size} wavelengths here, not "
                f"{samples.shape}"
            )
        check_spacing(self.spacing_um)
        sums = np.array([_checked_sum(s, w, self.spacing_um) for s, w in zip(samples, grid, strict=True)])
        for k in np.flatnonzero(np.abs(sums - 1) > _ONE):
            if not self.normalise:
                raise InputError(
                    f"the point spread at {grid[k]:g} nm sums to {sums[k]:.6g}, not to 1: divide it by its sum, or say "
                    "normalise=True"
                )
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "samples", samples / sums[:, None, None])

    def spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None) -> PlaneSpread:
        """The point spread on the sensor, whatever the lens and the distances."""
        spacing_m = self.spacing_um * 1e-6

        def otf(fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> Complex:
            low, high, share = _between(self.wavelength_nm, wavelength_nm)
            mixed = (1 - share) * self.samples[low] + share * self.samples[high]
            return transfer(mixed, spacing_m, fy_per_m, fx_per_m)

        def reach_m(wavelength_nm: float) -> float:
            low, high, share = _between(self.wavelength_nm, wavelength_nm)
            return light_radius((1 - share) * self.samples[low] + share * self.samples[high], spacing_m, _SHARE)

        corner_per_m = math.sqrt(2) * 0.5 / spacing_m
        return PlaneSpread(otf, lambda _: corner_per_m, reach_m, self.wavelength_nm)


def _axis(values: Array, name: str) -> Array:
    axis = numbers(name, values)
    if axis.ndim != 1 or axis.size < 2 or not np.isfinite(axis).all() or (np.diff(axis) <= 0).any():
        raise InputError(f"{name} is a list of 2 or more finite frequencies in cycles/mm, increasing; sort the table")
    return axis


def _check_halves(fy: Array, fx: Array, values: NDArray[Any]) -> None:
    """What lies at (fy, fx) and at (-fy, -fx) are conjugates; a table may also hold one half plane alone."""
    if fy[0] == 0 and fx[0] == 0:
        raise InputError("a 2-D table that begins at 0 on both axes says nothing of a quarter: give negative fy too")
    for name, axis, whole in (("frequency_per_mm", fy, fx[0] == 0), ("fx_per_mm", fx, fy[0] == 0)):
        if axis[0] != 0 and not np.allclose(axis, -axis[::-1], rtol=1e-9, atol=0):
            raise InputError(
                f"{name} of a 2-D table is symmetric about 0, or begins there"
                if not whole
                else f"{name} of a half-plane table is symmetric about 0"
            )
    if fy[0] < 0 and fx[0] < 0 and np.abs(values - values[:, ::-1, ::-1].conj()).max() > _ONE:
        raise InputError(
            "values of a 2-D table at (-fy, -fx) are the conjugates of those at (fy, fx), as a point spread is real; "
            "these are not: check the order of its axes"
        )


def _checked_sum(samples: Array, wavelength_nm: float, spacing_um: float) -> float:
    if not np.isfinite(samples).all():
        raise InputError(f"the point spread at {wavelength_nm:g} nm holds NaN or infinite samples")
    total, peak = float(samples.sum()), float(samples.max())
    if not (total > 0 and peak > 0):
        raise InputError(
            f"the point spread at {wavelength_nm:g} nm holds no light: its samples sum to {total:g}, the largest is "
            f"{peak:g}; check its sign"
        )
    if samples.min() < -1e-3 * peak:
        raise InputError(
            f"the point spread at {wavelength_nm:g} nm is negative somewhere, {samples.min():g} where its peak is "
            f"{peak:g}: take off less background, or set what is below 0 to 0"
        )
    fine = 0.5 / (spacing_um * 1e-6)
    at_limit = np.abs(transfer(samples, spacing_um * 1e-6, np.array([fine, 0.0]), np.array([0.0, fine]))).max() / total
    if at_limit > 0.05:
        raise InputError(
            f"samples {spacing_um:g} um apart are too coarse for the point spread at {wavelength_nm:g} nm: at half "
            f"their frequency it still has a modulation of {at_limit:.2f}, not 0.05 or less; give it on a finer grid"
        )
    return total


def _between(grid: Array, wavelength_nm: float) -> tuple[int, int, float]:
    """Indices of the neighbours, and the share of the second."""
    high = int(np.clip(np.searchsorted(grid, wavelength_nm), 0, grid.size - 1))
    low = max(high - 1, 0) if grid[high] > wavelength_nm else high
    if low == high:
        return low, high, 0.0
    return low, high, float((wavelength_nm - grid[low]) / (grid[high] - grid[low]))


def _mixed(values: Array, grid: Array, wavelength_nm: float) -> Array:
    low, high, share = _between(grid, wavelength_nm)
    result: Array = (1 - share) * values[low] + share * values[high]
    return result


def _reach(frequency_per_m: Array, otf: Array) -> float:
    """Radius that holds 99.5 % of the light, which is within R: 2 pi R integral of otf(f) J1(2 pi R f) df."""
    from scipy.special import j1

    step = frequency_per_m[1]
    radius = np.geomspace(0.1 / frequency_per_m[-1], 0.2 / step, 240)
    turn = 2 * math.pi * radius
    held = turn * np.trapezoid(otf * j1(turn[:, None] * frequency_per_m), dx=step, axis=1)
    enough = held >= _SHARE
    return float(radius[enough.argmax()] if enough.any() else radius[-1])
