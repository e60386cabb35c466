"""The lens as a camera sees it: transmitted light, blur, focus, and what varies over the field."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from threading import Lock
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.checks import check_type
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor, RadialMapping, combined_mapping, image_height
from photosite.optics.illumination import IlluminationTable, VeilingGlare
from photosite.optics.plot import LensBlur
from photosite.optics.point_spread import PointSpread
from photosite.optics.wavefront import Wavefront
from photosite.values.saved import write

Array = NDArray[np.float64]

_PARTS: dict[str, tuple[type, str]] = {
    "illumination": (IlluminationTable, "IlluminationTable(FieldPoints(angle_deg=[0, 20]), [1, 0.8])"),
    "distortion": (Distortion, "Distortion.polynomial(-0.1)"),
    "lateral_color": (LateralColor, "LateralColor.from_magnification([450, 650], [1.0002, 1])"),
    "veiling_glare": (VeilingGlare, "VeilingGlare(0.02)"),
    "name": (str, "'my 50 mm'"),
}


@dataclass(frozen=True, eq=False)
class Lens(LensBlur):
    """A lens with any of: its own blur, a fixed focus, tables over the field, glare.

    Parameters
    ----------
    base
        f-number, focal length and transmittance. Its falloff must be "none" if `illumination` is given.
    blur
        `Wavefront`, `OtfTable`, `PsfTable` or `LensDesign`. None: diffraction, and defocus of objects out of focus.
    focus_distance_m
        Distance in focus; the sensor does not move. inf is allowed. None: every object is in focus.
    illumination
        Relative illumination: the whole falloff.
    distortion
        Real over ideal image heights.
    lateral_color
        Displacement of each wavelength's image.
    veiling_glare
        Scattered light.
    name
        Name of the lens.

    Raises
    ------
    InputError
        If a part has a wrong type, the focus is not beyond the focal length, or falloff and illumination are both
        given.

    Notes
    -----
    With the sensor at the image distance v of the plane in focus, an object at d has the magnification v / d along its
    chief ray, and its irradiance is that of the working f-number in focus, N v / f. For an object in focus both agree
    with `DiffractionLimited`.

    Examples
    --------
    >>> lens = Lens(DiffractionLimited(f_number=4, focal_length_mm=50), focus_distance_m=2.0)
    >>> round(lens.magnification(2.0), 6), round(lens.magnification(4.0), 6)
    (0.025641, 0.012821)
    """

    base: DiffractionLimited
    blur: Blur | None = None
    focus_distance_m: float | None = None
    illumination: IlluminationTable | None = None
    distortion: Distortion | None = None
    lateral_color: LateralColor | None = None
    veiling_glare: VeilingGlare | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        check_type("base", self.base, DiffractionLimited, "DiffractionLimited(2.8, 50)")
        for name, (kind, example) in _PARTS.items():
            if (part := getattr(self, name)) is not None:
                check_type(name, part, kind, example)
        blur = self.blur
        if blur is not None and (isinstance(blur, type) or not callable(getattr(blur, "point_spread", None))):
            expected = "a Wavefront, OtfTable, PsfTable, LensDesign, or an object with point_spread()"
            raise InputError("blur", value=blur, expected=expected)
        if self.focus_distance_m is not None:
            focal_m = self.base.focal_length_mm * 1e-3
            if isinstance(self.focus_distance_m, bool | str) or not self.focus_distance_m > focal_m:
                expected = f"above the focal length of {focal_m:g} m"
                raise InputError("focus_distance_m", value=self.focus_distance_m, expected=expected)
        if self.illumination is not None and self.base.falloff != "none":
            expected = "'none' with a table of relative illumination, which is the whole falloff"
            raise InputError("falloff", value=self.base.falloff, expected=expected)

    def _focused_m(self, distance_m: float) -> float:
        if not distance_m > 0:
            raise InputError("distance_m", value=distance_m, expected="above 0")
        return distance_m if self.focus_distance_m is None else self.focus_distance_m

    def image_distance_m(self, distance_m: float) -> float:
        """Return the distance from the lens to the sensor, `f (1 + |m|)` of the plane in focus."""
        return self.base.focal_length_mm * 1e-3 * (1 + self.base.magnification(self._focused_m(distance_m)))

    def magnification(self, distance_m: float) -> float:
        """Return `|m|`, image size over object size: image distance over object distance."""
        if self.focus_distance_m is None:
            return self.base.magnification(distance_m)
        return 0.0 if math.isinf(distance_m) else self.image_distance_m(distance_m) / distance_m

    def irradiance_per_radiance(self, wavelength_nm: Array, distance_m: float) -> Array:
        """Return on-axis irradiance over radiance, (wavelengths,) sr; with transmittance and pupil obstruction."""
        passed: float = getattr(self.blur, "throughput", 1.0)
        return passed * self.base.irradiance_per_radiance(wavelength_nm, self._focused_m(distance_m))

    def relative_illumination(self, image_height_m: Array, distance_m: float) -> Array | None:
        """Return irradiance over on-axis irradiance at image heights; None if it is 1 everywhere."""
        if self.illumination is None:
            return self.base.relative_illumination(image_height_m, self._focused_m(distance_m))
        heights = self.illumination.field.ideal_m(self.image_distance_m(distance_m))
        if self.illumination.field.angle_deg is not None and self.distortion is not None:
            mapping = combined_mapping(self.distortion, None, self.image_distance_m(distance_m))
            assert mapping is not None
            heights = image_height(mapping, float(mapping.wavelength_nm[0]))(heights)
        return self.illumination.at(image_height_m, heights)

    def point_spread(self, distance_m: float) -> PointSpread:
        """Return the PSF on the sensor; the same object again for recently used distances."""
        with _cache_lock:
            cached = _cache.setdefault(self, {})
        found = cached.get(distance_m) or self._point_spread(distance_m)
        with _cache_lock:
            cached.pop(distance_m, None)
            cached[distance_m] = found  # most recently used last
            if len(cached) > _CACHED_DISTANCES:
                del cached[next(iter(cached))]
        return found

    def _point_spread(self, distance_m: float) -> PointSpread:
        if self.blur is not None:
            return self.blur.point_spread(self.base, distance_m, self.focus_distance_m)
        if self._focused_m(distance_m) == distance_m:
            return self.base.point_spread(distance_m)
        return Wavefront().point_spread(self.base, distance_m, self.focus_distance_m)

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """Return distortion and lateral color as one mapping; None if the lens has neither."""
        return combined_mapping(self.distortion, self.lateral_color, self.image_distance_m(distance_m))

    def save(self, path: str | PathLike[str], provenance: Mapping[str, str] | None = None) -> None:
        """Write an optics file and the tables it names; see `photosite.optics.io.optics_file.write_optics`."""
        write(self, path, provenance)


_CACHED_DISTANCES = 8
_cache_lock = Lock()
_cache: WeakKeyDictionary[Lens, dict[float, PointSpread]] = WeakKeyDictionary()
"""PSFs by distance: a PSF computes its OTFs once, and a series of frames asks for them repeatedly. They are kept
outside the lens, because a lens can be pickled and their closures cannot."""


# The interfaces of optics: what a camera requires of a lens, and what a lens requires of its blur.


class Optics(Protocol):
    """What a camera requires of its lens. Distances are from the lens to the object, in m."""

    def magnification(self, distance_m: float) -> float:
        """Return `|m|`, image size over object size."""

    def irradiance_per_radiance(self, wavelength_nm: Array, distance_m: float) -> Array:
        """Return on-axis irradiance over radiance, (wavelengths,) sr, transmittance included."""

    def relative_illumination(self, image_height_m: Array, distance_m: float) -> Array | None:
        """Return irradiance over on-axis irradiance at image heights; None if it is 1 everywhere."""

    def point_spread(self, distance_m: float) -> PointSpread:
        """Return the point spread function on the sensor."""

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """Return distortion and lateral color; None for a lens that has neither."""

    @property
    def veiling_glare(self) -> VeilingGlare | None:
        """Light scattered over the sensor; None for a lens that scatters nothing."""


class Blur(Protocol):
    """The point spread function of a lens: a wavefront, a table, lens-design data, or a class of the user's own.

    A blur that blocks light, such as an obstructed pupil, also has the attribute `throughput`: transmitted light
    relative to an open circular pupil of the same f-number.
    """

    def point_spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> PointSpread:
        """Return the point spread function for an object at `distance_m`.

        The plane at `focus_distance_m` is in focus; None: the object. `base` has f-number and focal length.
        """
