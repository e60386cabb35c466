"""A lens described by its wavefront: Zernike coefficients, focus, and the shape of its pupil."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.annular import LARGEST_ANNULAR_SLOPE, AnnularOtf, Waves, aberration_free_otf, defocused_otf
from photosite.optics.checks import camera_wavelengths, check_number, check_type
from photosite.optics.diffraction import AIRY_REACH_PERIODS, DiffractionLimited
from photosite.optics.point_spread import PlanePsf, RadialPsf
from photosite.optics.pupil import LARGEST_SLOPE, Pupil, PupilAutocorrelation, SampledOtf, cells_for, largest_slope
from photosite.optics.zernike import Index, Norm, Term, zernike_terms
from photosite.values.read_only import ReadOnly
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_DEFOCUS: Term = (2, 0)
_RIM_OVER_RMS = 2 * math.sqrt(3.0)
"""W r^2 has an RMS, without its mean, of W / sqrt(12)."""
_CACHED_WAVELENGTHS = 64
_CACHED_CELLS = 1 << 22
"""Cells of the pupil, 16 bytes each, of all cached OTFs of a plane. A camera samples these one wavelength after the
other, at most four in parallel; but radial ones at all wavelengths again for each range of frequencies."""


@dataclass(frozen=True, eq=False)
class Wavefront(Shown):
    """Aberrations of a lens over its pupil, the same over the whole field: a `Blur`.

    Parameters
    ----------
    coefficients
        Zernike coefficients, in nm or waves; empty for none.
    index, norm
        Meaning of the coefficients' keys and values, see `zernike_terms`. By default Noll's index and RMS.
    unit
        "nm" of optical path, or "waves" at `reference_nm`.
    reference_nm
        Wavelength of the unit "waves".
    pupil
        The pupil.
    defocus_um
        Distance of the focus behind the sensor; negative in front of it.
    chromatic_focus
        Focus shift by wavelength, um along the axis, added to `defocus_um`; linear between entries, the nearest one
        beyond. None: no longitudinal chromatic aberration.

    Notes
    -----
    The pupil function is A exp(2 pi i W / lambda), the PSF the squared modulus of its Fourier transform (Goodman,
    Introduction to Fourier Optics, section 6.4). A positive tilt along x moves the image to positive x. A positive
    defocus is that of an object nearer than the plane in focus. Zernike's angle goes from right towards up of the
    upright image. The wavefront is an optical path: in waves it goes as 1 / lambda. The theory is scalar: N should not
    be below about 1.4.

    A defocus of d m at the working f-number N_w is W = d / (8 N_w^2) at the rim. An object at `distance_m`, for a lens
    focused at `focus_distance_m`, has W = D^2 / 8 (1 / distance - 1 / focus distance), D = f / N, which is exact for a
    thin lens.

    Examples
    --------
    >>> lens = DiffractionLimited(f_number=2.8, focal_length_mm=50)
    >>> coma = Wavefront({8: 50.0})
    >>> otf = coma.point_spread(lens, 2.0).otf
    >>> values = otf(np.array([0.0, 0.0]), np.array([0.0, 1e5]), 550.0)
    >>> values.real.round(2), values.imag.round(2) + 0.0
    (array([1.  , 0.59]), array([ 0.  , -0.07]))
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
        check_type("coefficients", self.coefficients, Mapping, "{8: 50.0}")
        check_type("pupil", self.pupil, Pupil, "Pupil(blades=7)")
        check_number("defocus_um", self.defocus_um)
        if self.unit not in ("nm", "waves"):
            raise InputError("unit", value=self.unit, expected="'nm' or 'waves'")
        if self.unit == "waves":
            check_number("reference_nm", self.reference_nm, "above 0 for unit 'waves'", above=0)
        elif self.reference_nm is not None:
            raise InputError("reference_nm", value=self.reference_nm, expected="omitted for unit 'nm'")
        if self.chromatic_focus is not None:
            check_type("chromatic_focus", self.chromatic_focus, Spectrum, "Spectrum([450, 650], [-10, 12])")
            camera_wavelengths(self.chromatic_focus.wavelength_nm)
        object.__setattr__(self, "coefficients", ReadOnly(self.coefficients))
        _ = self.terms_nm

    @cached_property
    def terms_nm(self) -> Mapping[Term, float]:
        """RMS of each term over the full circle, in nm, by (n, m); without piston, which has no effect."""
        scale = 1.0 if self.reference_nm is None else self.reference_nm
        terms = zernike_terms(self.coefficients, self.index, self.norm)
        return ReadOnly({t: value * scale for t, value in terms.items() if value != 0 and t != (0, 0)})

    @property
    def rotationally_symmetric(self) -> bool:
        """Whether pupil and wavefront are rotationally symmetric."""
        return self.pupil.rotationally_symmetric and all(m == 0 for _, m in self.terms_nm)

    @property
    def throughput(self) -> float:
        """Light that the pupil transmits, relative to an open circle."""
        return self.pupil.area

    def waves(
        self, wavelength_nm: float, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> Waves:
        """Return the wavefront in waves, RMS by (n, m), with defocus."""
        rim_m = self._focus_shift_m(wavelength_nm) / (8 * _working_f_number(base, distance_m, focus_distance_m) ** 2)
        if focus_distance_m is not None:
            diameter_m = base.focal_length_mm * 1e-3 / base.f_number
            rim_m += diameter_m**2 / 8 * (1 / distance_m - 1 / focus_distance_m)
        terms = {t: value / wavelength_nm for t, value in self.terms_nm.items()}
        defocus = terms.get(_DEFOCUS, 0.0) + rim_m * 1e9 / wavelength_nm / _RIM_OVER_RMS
        if defocus or _DEFOCUS in terms:
            terms[_DEFOCUS] = defocus
        return terms

    def point_spread(
        self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> RadialPsf | PlanePsf:
        """Return the PSF on the sensor, a `RadialPsf` if pupil and wavefront are rotationally symmetric.

        Parameters
        ----------
        base
            f-number and focal length.
        distance_m, focus_distance_m
            Distance of the object, and of the plane in focus; None: the object's.
        """
        otf = _WavefrontOtf(self, base, distance_m, focus_distance_m)
        if self.rotationally_symmetric:
            return RadialPsf(otf.radial, otf.cutoff_per_m, otf.reach_m)
        return PlanePsf(otf.plane, otf.cutoff_per_m, otf.reach_m)

    def _focus_shift_m(self, wavelength_nm: float) -> float:
        chromatic = self.chromatic_focus
        shift = 0.0 if chromatic is None else float(np.interp(wavelength_nm, chromatic.wavelength_nm, chromatic.values))
        return (self.defocus_um + shift) * 1e-6


def _working_f_number(base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> float:
    """Return N_w for the sensor at the image of the plane in focus."""
    if not distance_m > 0:
        raise InputError("distance_m", value=distance_m, expected="above 0")
    return base.working_f_number(distance_m if focus_distance_m is None else focus_distance_m)


@dataclass(frozen=True, eq=False)
class _Monochromatic:
    pupil: Pupil
    waves: Waves

    @cached_property
    def slope(self) -> float:
        return largest_slope(self.pupil, self.waves)

    @cached_property
    def stretch(self) -> float:
        """Factor on the wavelength that keeps the slope within what can be sampled.

        Beyond that slope the image is that of geometrical rays, and the same rays at a longer wavelength blur as much.
        """
        return max(1.0, self.slope / LARGEST_SLOPE)


class _WavefrontOtf:
    """OTFs of a wavefront for one object distance, by wavelength."""

    def __init__(
        self, wavefront: Wavefront, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None
    ) -> None:
        self._wavefront = wavefront
        self._pupil = wavefront.pupil
        self._geometry = base, distance_m, focus_distance_m
        self._working_f_number = _working_f_number(base, distance_m, focus_distance_m)
        self._annular = AnnularOtf(wavefront.pupil.obscuration)
        self._autocorrelations: dict[tuple[int, tuple[Term, ...]], PupilAutocorrelation] = {}
        self._by_wavelength: dict[float, _Monochromatic] = {}
        self._sampled: dict[float, SampledOtf] = {}
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:  # without the lock and the caches
        return _WavefrontOtf, (self._wavefront, *self._geometry)

    def cutoff_per_m(self, wavelength_nm: float) -> float:
        return 1.0 / (wavelength_nm * 1e-9 * self._working_f_number)

    def reach_m(self, wavelength_nm: float) -> float:
        periods = AIRY_REACH_PERIODS * self._pupil.edge_ratio + 2 * self._at(wavelength_nm).slope
        return periods / self.cutoff_per_m(wavelength_nm)

    def plane(self, fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> NDArray[np.complex128]:
        scale = self._at(wavelength_nm).stretch / self.cutoff_per_m(wavelength_nm)
        return self._sampled_otf(wavelength_nm)(np.asarray(fy_per_m) * -scale, np.asarray(fx_per_m) * scale)

    def radial(self, frequency_per_m: Array, wavelength_nm: float) -> Array:
        s = np.abs(np.asarray(frequency_per_m, np.float64)) / self.cutoff_per_m(wavelength_nm)
        at = self._at(wavelength_nm)
        if not at.waves:
            return aberration_free_otf(s, self._pupil.obscuration)
        if set(at.waves) == {_DEFOCUS} and not self._pupil.obscuration:
            return defocused_otf(s, at.waves[_DEFOCUS] * _RIM_OVER_RMS)
        if at.slope <= LARGEST_ANNULAR_SLOPE:
            return self._annular.at(s, at.waves, at.slope)
        return self.plane(np.zeros(1), np.asarray(frequency_per_m, np.float64), wavelength_nm).real

    def _at(self, wavelength_nm: float) -> _Monochromatic:
        with self._lock:
            if wavelength_nm not in self._by_wavelength:
                _drop_oldest(self._by_wavelength)
                waves = self._wavefront.waves(wavelength_nm, *self._geometry)
                self._by_wavelength[wavelength_nm] = _Monochromatic(self._pupil, waves)
            return self._by_wavelength[wavelength_nm]

    def _sampled_otf(self, wavelength_nm: float) -> SampledOtf:
        if (known := self._sampled.get(wavelength_nm)) is not None:
            return known
        at = self._at(wavelength_nm)
        key = count, terms = cells_for(at.slope / at.stretch), tuple(at.waves)
        with self._lock:
            if key not in self._autocorrelations:
                self._autocorrelations[key] = PupilAutocorrelation(self._pupil, terms, count)
        found = self._autocorrelations[key].otf({t: w / at.stretch for t, w in at.waves.items()})
        with self._lock:
            _drop_oldest(self._sampled)
            self._sampled[wavelength_nm] = found
            if not self._wavefront.rotationally_symmetric:
                while sum(one.count**2 for one in self._sampled.values()) > _CACHED_CELLS:
                    del self._sampled[next(iter(self._sampled))]
        return found


def _drop_oldest(cache: dict[float, Any]) -> None:
    if len(cache) >= _CACHED_WAVELENGTHS:
        del cache[next(iter(cache))]
