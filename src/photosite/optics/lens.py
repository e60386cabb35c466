"""Lenses: how much light they pass to the sensor, how they blur it, and how it falls off towards the corners."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from os import PathLike
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import Spectrum, wavelength_grid
from photosite.errors import InputError
from photosite.optics.arguments import LOWEST_F_NUMBER, SHORTEST_FOCAL_MM, check_kind, check_numbers
from photosite.optics.spread import RadialMapping, RadialSpread, VeilingGlare

AIRY_REACH_PERIODS = 40.0
"""Radius that holds 99.5 % of an Airy pattern's light, in periods of the cutoff, lambda N."""
_SHORTEST_NM = 100.0


def camera_wavelengths(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Wavelengths as `wavelength_grid` checks them, and none below 100 nm, as those in um are.

    Raises
    ------
    InputError
        If they are no wavelengths of a camera's.
    """
    try:
        grid = wavelength_grid(wavelength_nm)
    except InputError:
        raise
    except (TypeError, ValueError):
        raise InputError(
            f"wavelengths are a list of positive numbers in nm, not {' '.join(repr(wavelength_nm).split()):.60}"
        ) from None
    if grid[0] < _SHORTEST_NM:
        raise InputError(f"a wavelength of {grid[0]:g} nm is none of a camera's: if that is in um, multiply by 1000")
    return grid


@dataclass(frozen=True)
class DiffractionLimited:
    """A thin lens without aberrations.

    Parameters
    ----------
    f_number
        N, marked on the lens.
    focal_length_mm
        f.
    transmittance
        Of the glass: one number, or a `Spectrum` of them, 0 to 1; outside it nothing passes.
    falloff
        "none", or "cos4" for the natural fall-off towards the corners.

    Raises
    ------
    InputError
        If the f-number is below 0.5 or the focal length below 0.2 mm, as those in m are, the transmittance is not
        between 0 and 1, or its wavelengths are below 100 nm.

    Notes
    -----
    On-axis irradiance: E = pi T L / (1 + 4 N^2 (1 + |m|)^2), |m| = f / (d - f) (Farrell et al. 2008; the 1 is the exact
    form for a uniform disc seen from the image). Diffraction: circular pupil at the working f-number
    N (1 + |m|), cutoff 1 / (lambda N (1 + |m|)) (Goodman, Introduction to Fourier Optics, section 6.4).

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
        check_numbers(self, "f_number", "focal_length_mm")
        passed = self.transmittance
        passed = passed.item() if isinstance(passed, np.ndarray) and passed.ndim == 0 else passed
        check_kind("DiffractionLimited", "transmittance", passed, (Real, Spectrum), "a number or a Spectrum")
        for name in ("f_number", "focal_length_mm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} must be above 0, not {value}")
        if self.f_number < LOWEST_F_NUMBER:
            raise InputError(f"f_number is {LOWEST_F_NUMBER} or more in air, not {self.f_number:g}")
        if self.focal_length_mm < SHORTEST_FOCAL_MM:
            raise InputError(
                f"focal_length_mm is {SHORTEST_FOCAL_MM} or more, not {self.focal_length_mm:g}: if that is in m, "
                "multiply by 1000"
            )
        values = self.transmittance.values if isinstance(self.transmittance, Spectrum) else self.transmittance
        if not ((np.asarray(values) >= 0) & (np.asarray(values) <= 1)).all():
            raise InputError(f"transmittance is a fraction, 0 to 1, not {values}")
        if isinstance(self.transmittance, Spectrum):
            camera_wavelengths(self.transmittance.wavelength_nm)
        if self.falloff not in ("none", "cos4"):
            raise InputError(f"falloff is 'none' or 'cos4', not '{self.falloff}'")

    def magnification(self, distance_m: float) -> float:
        """|m| = f / (d - f).

        Raises
        ------
        InputError
            If the object is not beyond the focal length.
        """
        focal_m = self.focal_length_mm * 1e-3
        if not distance_m > focal_m:
            raise InputError(
                f"an object at {distance_m} m has no image behind a lens of {focal_m} m focal length; "
                "move it farther away"
            )
        return 0.0 if math.isinf(distance_m) else focal_m / (distance_m - focal_m)

    def working_f_number(self, distance_m: float) -> float:
        """N_w = N (1 + |m|)."""
        return self.f_number * (1 + self.magnification(distance_m))

    def irradiance_per_radiance(self, wavelength_nm: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
        """(wavelengths,) sr: on-axis irradiance over radiance, transmittance included."""
        grid = wavelength_grid(wavelength_nm)
        passed = (
            self.transmittance.at(grid)
            if isinstance(self.transmittance, Spectrum)
            else np.full(grid.shape, float(self.transmittance))
        )
        return passed * (math.pi / (1 + 4 * self.working_f_number(distance_m) ** 2))

    def cutoff_per_m(self, wavelength_nm: float, distance_m: float) -> float:
        """Diffraction's cutoff frequency on the sensor, cycles/m."""
        return 1.0 / (wavelength_nm * 1e-9 * self.working_f_number(distance_m))

    def otf(self, frequency_per_m: NDArray[np.float64], wavelength_nm: float, distance_m: float) -> NDArray[np.float64]:
        """Transfer function of a circular pupil, (2/pi) (acos r - r sqrt(1 - r^2)), r = frequency over cutoff.

        Examples
        --------
        >>> lens = DiffractionLimited(f_number=8, focal_length_mm=50)
        >>> half = lens.cutoff_per_m(550.0, 1.2) / 2
        >>> lens.otf(np.array([0.0, half, 3 * half]), 550.0, 1.2).round(4)
        array([1.   , 0.391, 0.   ])
        """
        r = np.minimum(np.abs(frequency_per_m) / self.cutoff_per_m(wavelength_nm, distance_m), 1.0)
        transfer: NDArray[np.float64] = (2 / math.pi) * (np.arccos(r) - r * np.sqrt(1 - r * r))
        return transfer

    def relative_illumination(
        self, image_height_m: NDArray[np.float64], distance_m: float
    ) -> NDArray[np.float64] | None:
        """cos^4 of the field angle, the angle seen from the lens: tan = height / image distance."""
        if self.falloff == "none":
            return None
        image_distance_m = self.focal_length_mm * 1e-3 * (1 + self.magnification(distance_m))
        falloff: NDArray[np.float64] = 1.0 / (1.0 + (image_height_m / image_distance_m) ** 2) ** 2
        return falloff

    def spread(self, distance_m: float) -> RadialSpread:
        """Diffraction's point spread: 99.5 % of an Airy pattern's light lies within 40 periods of the cutoff."""
        return RadialSpread(
            otf=lambda frequency_per_m, wavelength_nm: self.otf(frequency_per_m, wavelength_nm, distance_m),
            cutoff_per_m=lambda wavelength_nm: self.cutoff_per_m(wavelength_nm, distance_m),
            reach_m=lambda wavelength_nm: AIRY_REACH_PERIODS / self.cutoff_per_m(wavelength_nm, distance_m),
        )

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """None: it has no distortion."""
        return None

    @property
    def veiling_glare(self) -> VeilingGlare | None:
        """None: it scatters nothing."""
        return None

    def save(self, path: str | PathLike[str], provenance: Mapping[str, str] | None = None) -> None:
        """Write the optics file (YAML) and the tables it names, all or nothing; `photosite.load_optics` reads it.

        Parameters
        ----------
        path, provenance
            As for `photosite.optics.io.write.write_optics`.

        Raises
        ------
        InputError
            If something of the lens has no place in such a file.
        FileError
            If it cannot be written.
        """
        from photosite.optics.io.write import write_optics

        write_optics(self, path, provenance)
