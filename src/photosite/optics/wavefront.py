"""A lens described by its wavefront: Zernike coefficients, focus, and the shape of its opening."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.arguments import check_kind, check_numbers
from photosite.optics.autocorrelation import LARGEST_SLOPE, PupilTransfer, Waves, cells_for, largest_slope
from photosite.optics.lens import AIRY_REACH_PERIODS, DiffractionLimited, camera_wavelengths
from photosite.optics.pupil import Pupil
from photosite.optics.ring import bare_transfer, defocus_transfer, ring_geometry
from photosite.optics.spread import PlaneSpread, RadialSpread
from photosite.optics.zernike import Index, Norm, Term, zernike_terms

Array = NDArray[np.float64]

_DEFOCUS: Term = (2, 0)
_RIM_OVER_RMS = 2 * math.sqrt(3.0)
"""W r^2 has an RMS, without its mean, of W / sqrt(12)."""
_RING_SLOPE = 12.0
"""Waves per radius up to which quadrature over a ring is quicker than transforms."""
_KEPT = 64


@dataclass(frozen=True, eq=False)
class Wavefront:
    """Aberrations of a lens over its pupil, the same all over the field.

    Parameters
    ----------
    coefficients
        Zernike coefficients, in nm or waves; empty: none.
    index, norm
        What the coefficients' keys and values are, see `zernike_terms`: Noll's index and RMS if not said.
    unit
        "nm" of optical path, or "waves" at `reference_nm`.
    reference_nm
        Wavelength of "waves".
    pupil
        The opening.
    defocus_um
        How far behind the sensor the image comes to focus; negative: before it.
    chromatic_focus
        The same for each wavelength, added to `defocus_um`: um along the axis; linear between entries, beyond them that
        of the nearest. None: all wavelengths come to focus together.

    Raises
    ------
    InputError
        If a coefficient or unit cannot be; see also `zernike_terms`.

    Notes
    -----
    The pupil function is A exp(2 pi i W / lambda), the point spread the squared modulus of its Fourier transform
    (Goodman, Introduction to Fourier Optics, section 6.4): a positive tilt along x moves the image to positive x, and a
    positive defocus is that of an object nearer than the lens is focused. Zernike's angle goes from right towards up as
    one sees the picture. The wavefront is an optical path: in waves it goes as 1 / lambda. The transfer function keeps
    to the scalar theory: N is not below 1.4 or so.

    Defocus of d m at the working f-number N_w is W = d / (8 N_w^2) at the rim; an object at `distance_m` seen by a lens
    that is focused at `focus_distance_m` has W = D^2 / 8 (1 / distance - 1 / focus distance), D = f / N, which is
    exact for a thin lens.

    Examples
    --------
    >>> lens = DiffractionLimited(f_number=2.8, focal_length_mm=50)
    >>> coma = Wavefront({8: 50.0})
    >>> otf = coma.spread(lens, 2.0).otf
    >>> otf(np.array([0.0, 0.0]), np.array([0.0, 1e5]), 550.0).round(2)
    array([1.  -0.j  , 0.59-0.07j])
    """

    coefficients: Mapping[int | Term, float] = field(default_factory=dict)
    index: Index = "noll"
    unit: str = "nm"
    reference_nm: float | None = None
    norm: Norm | None = None
    pupil: Pupil = field(default_factory=Pupil)
    defocus_um: float = 0.0
    chromatic_focus: Spectrum | None = None

    def __post_init__(self) -> None:
        check_kind("Wavefront", "coefficients", self.coefficients, Mapping, "values by term, as {8: 50.0}")
        check_kind("Wavefront", "pupil", self.pupil, Pupil, "a Pupil, as Pupil(blades=7)")
        check_numbers(self, "defocus_um", *(["reference_nm"] if self.reference_nm is not None else []))
        if self.chromatic_focus is not None:
            check_kind("Wavefront", "chromatic_focus", self.chromatic_focus, Spectrum, "a Spectrum of shifts in um")
        if self.unit not in ("nm", "waves"):
            raise InputError(f"a wavefront's unit is 'nm' or 'waves', not '{self.unit}'")
        if (self.unit == "waves") != (self.reference_nm is not None):
            raise InputError(
                "coefficients in waves need reference_nm, the wavelength they were measured at"
                if self.unit == "waves"
                else "reference_nm belongs to unit 'waves'; a wavefront in nm has none"
            )
        if self.reference_nm is not None and not (math.isfinite(self.reference_nm) and self.reference_nm > 0):
            raise InputError(f"reference_nm must be above 0 nm, not {self.reference_nm}")
        if not math.isfinite(self.defocus_um):
            raise InputError(f"defocus_um must be a finite number, not {self.defocus_um}")
        if self.chromatic_focus is not None:
            camera_wavelengths(self.chromatic_focus.wavelength_nm)
        object.__setattr__(self, "coefficients", MappingProxyType(dict(self.coefficients)))
        _ = self.terms_nm

    @cached_property
    def terms_nm(self) -> Mapping[Term, float]:
        """RMS of each term over the full circle, in nm, by (n, m); piston, which nobody sees, is left out."""
        scale = 1.0 if self.reference_nm is None else self.reference_nm
        terms = zernike_terms(self.coefficients, self.index, self.norm)
        return MappingProxyType({t: value * scale for t, value in terms.items() if value != 0 and t != (0, 0)})

    @property
    def throughput(self) -> float:
        """Light the opening passes, relative to the open circle of the f-number."""
        return self.pupil.area

    def waves(
        self, wavelength_nm: float, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> Waves:
        """The wavefront in waves, RMS by (n, m), focus included."""
        rim_m = self._shift_m(wavelength_nm) / (8 * _working(base, distance_m, focus_distance_m) ** 2)
        if focus_distance_m is not None:
            diameter_m = base.focal_length_mm * 1e-3 / base.f_number
            rim_m += diameter_m**2 / 8 * (1 / distance_m - 1 / focus_distance_m)
        terms = {t: value / wavelength_nm for t, value in self.terms_nm.items()}
        defocus = terms.get(_DEFOCUS, 0.0) + rim_m * 1e9 / wavelength_nm / _RIM_OVER_RMS
        if defocus or _DEFOCUS in terms:
            terms[_DEFOCUS] = defocus
        return terms

    def spread(
        self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> RadialSpread | PlaneSpread:
        """The point spread on the sensor.

        Parameters
        ----------
        base
            The lens's f-number and focal length.
        distance_m
            Of the object.
        focus_distance_m
            At which the lens is focused; None: at the object.

        Returns
        -------
        RadialSpread or PlaneSpread
            The first if pupil and wavefront are rotationally symmetric. Each wavelength's transfer function is computed
            when first asked for, and kept.
        """
        number = _working(base, distance_m, focus_distance_m)

        @lru_cache(maxsize=_KEPT)
        def waves(wavelength_nm: float) -> Waves:
            return self.waves(wavelength_nm, base, distance_m, focus_distance_m)

        @lru_cache(maxsize=_KEPT)
        def slope(wavelength_nm: float) -> float:
            return largest_slope(self.pupil, waves(wavelength_nm))

        def cutoff_per_m(wavelength_nm: float) -> float:
            return 1.0 / (wavelength_nm * 1e-9 * number)

        def reach_m(wavelength_nm: float) -> float:
            periods = AIRY_REACH_PERIODS * self.pupil.edge_ratio + 2 * slope(wavelength_nm)
            return periods / cutoff_per_m(wavelength_nm)

        # A table for each, so that those of other distances are not kept with this one.
        transforms: dict[int, PupilTransfer] = {}

        @lru_cache(maxsize=_KEPT)
        def plane(wavelength_nm: float) -> tuple[Callable[[Array, Array], NDArray[np.complex128]], float]:
            # Beyond some slope the image is that of rays: the same rays at a longer wavelength blur as much.
            stretch = max(1.0, slope(wavelength_nm) / LARGEST_SLOPE)
            now = waves(wavelength_nm)
            count = cells_for(slope(wavelength_nm) / stretch)
            if count not in transforms:
                transforms[count] = PupilTransfer(self.pupil, tuple(now), count)
            return transforms[count].at({t: w / stretch for t, w in now.items()}), stretch

        def plane_otf(fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> NDArray[np.complex128]:
            transfer, stretch = plane(wavelength_nm)
            scale = stretch / cutoff_per_m(wavelength_nm)
            return transfer(np.asarray(fy_per_m) * -scale, np.asarray(fx_per_m) * scale)

        if not self._symmetric:
            return PlaneSpread(plane_otf, cutoff_per_m, reach_m)
        ring = _Ring(self.pupil.obscuration)

        def radial_otf(frequency_per_m: Array, wavelength_nm: float) -> Array:
            s = np.abs(np.asarray(frequency_per_m, np.float64)) / cutoff_per_m(wavelength_nm)
            now = waves(wavelength_nm)
            if not now:
                return bare_transfer(s, self.pupil.obscuration)
            if set(now) == {_DEFOCUS} and not self.pupil.obscuration:
                return defocus_transfer(s, now[_DEFOCUS] * _RIM_OVER_RMS)
            if slope(wavelength_nm) <= _RING_SLOPE:
                return ring.transfer(s, now, slope(wavelength_nm))
            return plane_otf(np.zeros(1), np.asarray(frequency_per_m, np.float64), wavelength_nm).real

        return RadialSpread(radial_otf, cutoff_per_m, reach_m)

    @property
    def _symmetric(self) -> bool:
        return self.pupil.rotationally_symmetric and all(m == 0 for _, m in self.terms_nm)

    def _shift_m(self, wavelength_nm: float) -> float:
        chromatic = self.chromatic_focus
        shift = 0.0 if chromatic is None else float(np.interp(wavelength_nm, chromatic.wavelength_nm, chromatic.values))
        return (self.defocus_um + shift) * 1e-6


def _working(base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> float:
    """N_w of the sensor's place, which is where the image of the focused distance lies."""
    if not distance_m > 0:
        raise InputError(f"an object's distance must be above 0 m, not {distance_m}")
    return base.working_f_number(distance_m if focus_distance_m is None else focus_distance_m)


class _Ring:
    """Tables of radial transfer functions; the geometry of the quadrature is shared by all wavelengths."""

    def __init__(self, obscuration: float) -> None:
        self._obscuration = obscuration
        self._geometry: dict[tuple[tuple[Term, ...], float], tuple[Array, Array, Array]] = {}
        self._splines: dict[tuple[tuple[Term, float], ...], Callable[[Array], Array]] = {}

    def transfer(self, s: Array, waves: Waves, slope: float) -> Array:
        key = tuple(waves.items())
        if key not in self._splines:
            self._splines[key] = self._spline(waves, slope)
        return bare_transfer(s, self._obscuration) + self._splines[key](np.minimum(s, 1.0))

    def _spline(self, waves: Waves, slope: float) -> Callable[[Array], Array]:
        """What the wavefront changes."""
        from scipy.interpolate import CubicSpline

        level = next(n for n in (1.0, 2.0, 3.0, 4.5, 6.0, 9.0, _RING_SLOPE) if slope <= n)
        shape = (tuple(waves), level)
        if shape not in self._geometry:
            s = np.linspace(0.0, 1.0, (321 if self._obscuration else 161) + math.ceil(16 * level))
            nodes = 10 + math.ceil(1.3 * level)
            self._geometry[shape] = (s, *ring_geometry(s, tuple(waves), self._obscuration, nodes))
        s, difference, weight = self._geometry[shape]
        phase = 2 * math.pi * np.tensordot(np.array(list(waves.values())), difference, 1)
        # cos(p) - 1 = -2 sin(p / 2)^2: nothing is lost where the change is small.
        change = -2 * (weight * np.sin(phase / 2) ** 2).sum(axis=1)
        result: Callable[[Array], Array] = CubicSpline(s, change)
        return result
