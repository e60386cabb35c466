"""The diffraction-limited thin lens: transmitted light, Airy pattern, natural falloff."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from os import PathLike
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import Spectrum, wavelength_grid
from photosite.errors import InputError
from photosite.optics.checks import LOWEST_F_NUMBER, SHORTEST_FOCAL_MM, camera_wavelengths, check_number
from photosite.optics.distortion import RadialMapping
from photosite.optics.illumination import VeilingGlare
from photosite.optics.plot import LensBlur
from photosite.optics.point_spread import RadialPsf
from photosite.values.saved import write

Array = NDArray[np.float64]

AIRY_REACH_PERIODS = 40.0
"""Radius that encloses 99.5 % of the energy of an Airy pattern, in periods of the cutoff, lambda N."""


@dataclass(frozen=True)
class DiffractionLimited(LensBlur):
    """A thin lens without aberrations.

    Parameters
    ----------
    f_number
        f-number N, as marked on the lens.
    focal_length_mm
        Focal length f.
    transmittance
        Transmittance of the glass, 0 to 1: one number, or a `Spectrum`, beyond which nothing is transmitted.
    falloff
        "none", or "cos4" for the natural falloff towards the corners.

    Raises
    ------
    InputError
        If the f-number is below 0.5, the focal length below 0.2 mm (as one given in m), the transmittance not between 0
        and 1, or one of its wavelengths below 100 nm.

    Notes
    -----
    On-axis irradiance: `E = pi T L / (1 + 4 N^2 (1 + |m|)^2)`, `|m| = f / (d - f)` (Farrell et al. 2008; the 1 makes
    it exact for a uniform disc seen from the image). Diffraction: circular pupil at the working f-number `N (1 + |m|)`,
    cutoff `1 / (lambda N (1 + |m|))` (Goodman, Introduction to Fourier Optics, section 6.4).

    Examples
    --------
    >>> lens = DiffractionLimited(f_number=8, focal_length_mm=50)
    >>> float(lens.irradiance_per_radiance(np.array([550.0]), 1.2)[0].round(7))
    0.0112302
    """

    f_number: float
    focal_length_mm: float
    transmittance: float | Spectrum = 1.0
    falloff: Literal["none", "cos4"] = "none"

    def __post_init__(self) -> None:
        low = LOWEST_F_NUMBER
        check_number("f_number", self.f_number, f"{low} or more, the limit in air", at_least=low)
        low, hint = SHORTEST_FOCAL_MM, "If the value is in m, multiply it by 1000"
        check_number("focal_length_mm", self.focal_length_mm, f"{low} or more", at_least=low, hint=hint)
        fraction = "a fraction from 0 to 1, or a Spectrum of them"
        if isinstance(self.transmittance, Spectrum):
            values = self.transmittance.values
            if not ((values >= 0) & (values <= 1)).all():
                raise InputError("transmittance", value=values.tolist(), expected=fraction)
            camera_wavelengths(self.transmittance.wavelength_nm)
        else:
            check_number("transmittance", self.transmittance, fraction, at_least=0, at_most=1)
        if self.falloff not in ("none", "cos4"):
            raise InputError("falloff", value=self.falloff, expected="'none' or 'cos4'")

    def magnification(self, distance_m: float) -> float:
        """Return `|m| = f / (d - f)`; raise `InputError` for an object within the focal length."""
        focal_m = self.focal_length_mm * 1e-3
        if isinstance(distance_m, bool | str) or not distance_m > focal_m:
            expected = f"above the focal length of {focal_m} m"
            raise InputError("distance_m", value=distance_m, expected=expected, hint="Move the object farther away")
        return 0.0 if math.isinf(distance_m) else focal_m / (distance_m - focal_m)

    def working_f_number(self, distance_m: float) -> float:
        """Return `N_w = N (1 + |m|)`."""
        return self.f_number * (1 + self.magnification(distance_m))

    def irradiance_per_radiance(self, wavelength_nm: Array, distance_m: float) -> Array:
        """Return on-axis irradiance over radiance, (wavelengths,) sr, transmittance included."""
        grid = wavelength_grid(wavelength_nm)
        glass = self.transmittance
        passed = glass.at(grid) if isinstance(glass, Spectrum) else np.full(grid.shape, float(glass))
        return passed * (math.pi / (1 + 4 * self.working_f_number(distance_m) ** 2))

    def cutoff_per_m(self, wavelength_nm: float, distance_m: float) -> float:
        """Return the cutoff frequency of diffraction on the sensor, cycles/m."""
        return 1.0 / (wavelength_nm * 1e-9 * self.working_f_number(distance_m))

    def otf(self, frequency_per_m: Array, wavelength_nm: float, distance_m: float) -> Array:
        """Return the OTF of a circular pupil, (2/pi) (acos r - r sqrt(1 - r^2)), r = frequency over cutoff.

        Examples
        --------
        >>> lens = DiffractionLimited(f_number=8, focal_length_mm=50)
        >>> half = lens.cutoff_per_m(550.0, 1.2) / 2
        >>> lens.otf(np.array([0.0, half, 3 * half]), 550.0, 1.2).round(4)
        array([1.   , 0.391, 0.   ])
        """
        r = np.minimum(np.abs(frequency_per_m) / self.cutoff_per_m(wavelength_nm, distance_m), 1.0)
        result: Array = (2 / math.pi) * (np.arccos(r) - r * np.sqrt(1 - r * r))
        return result

    def otf_derivative(self, frequency_per_m: Array, wavelength_nm: float, distance_m: float) -> Array:
        """Return the derivative of the OTF by the working f-number, -(4/pi) r sqrt(1 - r^2) / N_w.

        Examples
        --------
        >>> lens = DiffractionLimited(f_number=8, focal_length_mm=50)
        >>> half = lens.cutoff_per_m(550.0, np.inf) / 2
        >>> lens.otf_derivative(np.array([0.0, half, 3 * half]), 550.0, np.inf).round(4) + 0.0
        array([ 0.    , -0.0689,  0.    ])
        """
        r = np.minimum(np.abs(frequency_per_m) / self.cutoff_per_m(wavelength_nm, distance_m), 1.0)
        return np.asarray((-4 / math.pi / self.working_f_number(distance_m)) * r * np.sqrt(1 - r * r))

    def relative_illumination(self, image_height_m: Array, distance_m: float) -> Array | None:
        """Return cos^4 of the field angle, tan = height / image distance; None without falloff."""
        if self.falloff == "none":
            return None
        image_distance_m = self.focal_length_mm * 1e-3 * (1 + self.magnification(distance_m))
        return 1.0 / (1.0 + (image_height_m / image_distance_m) ** 2) ** 2

    def point_spread(self, distance_m: float) -> RadialPsf:
        """Return the Airy pattern at the working f-number."""
        return _airy_pattern(self, distance_m)

    def _reach_m(self, wavelength_nm: float, distance_m: float) -> float:
        return AIRY_REACH_PERIODS / self.cutoff_per_m(wavelength_nm, distance_m)

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """Return None: the lens has no distortion."""
        return None

    @property
    def veiling_glare(self) -> VeilingGlare | None:
        """None: the lens scatters nothing."""
        return None

    def save(self, path: str | PathLike[str], provenance: Mapping[str, str] | None = None) -> None:
        """Write an optics file; see `photosite.optics.io.optics_file.write_optics`."""
        write(self, path, provenance)


# Kept, because the transfers of a scene are cached with the spread.
@lru_cache(maxsize=4)
def _airy_pattern(lens: DiffractionLimited, distance_m: float) -> RadialPsf:
    return RadialPsf(
        otf=partial(lens.otf, distance_m=distance_m),
        cutoff_per_m=partial(lens.cutoff_per_m, distance_m=distance_m),
        reach_m=partial(lens._reach_m, distance_m=distance_m),
    )
