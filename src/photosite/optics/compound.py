"""A lens as a whole: how much light it passes, how it blurs, where it is focused, what it does over the field.

`Lens` joins parts that may each be missing to what a camera asks of any lens (`photosite.optics.spread.Optics`). What
blurs is a `Blur`: a wavefront, tables of transfer functions or point spreads, or lens-design data.
"""

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
from photosite.optics.arguments import check_kind, check_numbers
from photosite.optics.distortion import Distortion, LateralColor, combined_mapping
from photosite.optics.illumination import IlluminationTable
from photosite.optics.lens import DiffractionLimited
from photosite.optics.mapping import image_height
from photosite.optics.spread import RadialMapping, Spread, VeilingGlare

Array = NDArray[np.float64]


class Blur(Protocol):
    """What makes a point's image: anything that knows its own point spread.

    One that stops light, as an obscured pupil does, has the attribute `throughput` too: the light that passes over that
    of an open circle of the f-number.
    """

    def spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> Spread:
        """The point spread of an object.

        Parameters
        ----------
        base
            f-number and focal length.
        distance_m
            From the lens to the object.
        focus_distance_m
            Of the object plane that is in focus; None: the object is.
        """
        ...


_PARTS: dict[str, tuple[type, str]] = {
    "illumination": (IlluminationTable, "an IlluminationTable"),
    "distortion": (
        Distortion,
        "a Distortion, as Distortion.polynomial(-0.1) or Distortion.from_percent",
    ),
    "lateral_color": (LateralColor, "a LateralColor"),
    "veiling_glare": (VeilingGlare, "a VeilingGlare, as VeilingGlare(0.02)"),
    "name": (str, "a text"),
}


@dataclass(frozen=True, eq=False)
class Lens:
    """A lens with any of: its own blur, a fixed focus, tables over the field, glare.

    Parameters
    ----------
    base
        f-number, focal length and transmittance; with falloff "cos4" where there is no table.
    blur
        Its point spreads; None: diffraction, and defocus where the object is not in focus.
    focus_distance_m
        Where it is focused; the sensor stays there. None: on each object, whatever its distance. inf is allowed.
    illumination
        Relative illumination: all of the fall-off.
    distortion
        Real over ideal image heights.
    lateral_color
        How far wavelengths' images lie apart.
    veiling_glare
        What it scatters over the sensor.
    name
        What to call it.

    Raises
    ------
    InputError
        If a part is of another kind than is asked for, the focus is not beyond the focal length, or both cos4 and a
        table of illumination are given.

    Notes
    -----
    With the sensor at the image distance v of the focused plane, an object at d has the magnification v / d along its
    chief ray, through the middle of the lens; the irradiance is that of the focused working f-number, N v / f. For an
    object in focus both are those of `DiffractionLimited`.

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
        check_kind(
            "Lens", "base", self.base, DiffractionLimited, "a DiffractionLimited, as DiffractionLimited(2.8, 50)"
        )
        for name, (kind, expected) in _PARTS.items():
            if (part := getattr(self, name)) is not None:
                check_kind("Lens", name, part, kind, expected)
        if self.blur is not None and (isinstance(self.blur, type) or not callable(getattr(self.blur, "spread", None))):
            check_kind("Lens", "blur", self.blur, (), "a Wavefront, OtfTable, PsfTable or LensDesign, or has spread()")
        if self.focus_distance_m is not None:
            check_numbers(self, "focus_distance_m")
            self.base.magnification(self.focus_distance_m)  # refuses what has no image
        if self.illumination is not None and self.base.falloff != "none":
            raise InputError(
                "a table of relative illumination is all of the fall-off: leave out the table or falloff 'cos4'"
            )

    def _focused_m(self, distance_m: float) -> float:
        """Distance of the plane in focus."""
        if not distance_m > 0:
            raise InputError(f"an object's distance must be above 0 m, not {distance_m}")
        return distance_m if self.focus_distance_m is None else self.focus_distance_m

    def image_distance_m(self, distance_m: float) -> float:
        """From the lens to the sensor, f (1 + |m|) of the plane in focus."""
        return self.base.focal_length_mm * 1e-3 * (1 + self.base.magnification(self._focused_m(distance_m)))

    def magnification(self, distance_m: float) -> float:
        """|m|, image size over object size: image distance over object distance."""
        if self.focus_distance_m is None:
            return self.base.magnification(distance_m)
        return 0.0 if math.isinf(distance_m) else self.image_distance_m(distance_m) / distance_m

    def irradiance_per_radiance(self, wavelength_nm: Array, distance_m: float) -> Array:
        """(wavelengths,) sr: on-axis irradiance over radiance; transmittance and an obscured pupil included."""
        passed: float = getattr(self.blur, "throughput", 1.0)
        return passed * self.base.irradiance_per_radiance(wavelength_nm, self._focused_m(distance_m))

    def relative_illumination(self, image_height_m: Array, distance_m: float) -> Array | None:
        """Irradiance over that on axis at distances from the axis on the sensor; None where it is 1 everywhere."""
        if self.illumination is None:
            return self.base.relative_illumination(image_height_m, self._focused_m(distance_m))
        heights = self.illumination.field.ideal_m(self.image_distance_m(distance_m))
        if self.illumination.field.angle_deg is not None and self.distortion is not None:
            alone = combined_mapping(self.distortion, None, self.image_distance_m(distance_m))
            assert alone is not None
            heights = image_height(alone, float(alone.wavelength_nm[0]))(heights)
        return self.illumination.at(image_height_m, heights)

    def spread(self, distance_m: float) -> Spread:
        """How the light of a point is spread; the same object again for the distances last asked for."""
        with _keeping:
            kept = _spreads.setdefault(self, {})
        found = kept.get(distance_m) or self._spread(distance_m)
        with _keeping:
            kept.pop(distance_m, None)
            kept[distance_m] = found  # the last asked for stands last
            if len(kept) > _MOST_KEPT:
                del kept[next(iter(kept))]
        return found

    def _spread(self, distance_m: float) -> Spread:
        if self.blur is not None:
            return self.blur.spread(self.base, distance_m, self.focus_distance_m)
        if self._focused_m(distance_m) == distance_m:
            return self.base.spread(distance_m)
        from photosite.optics.wavefront import Wavefront

        return Wavefront().spread(self.base, distance_m, self.focus_distance_m)

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """Where points fall, by distortion and lateral colour; None where there is neither."""
        return combined_mapping(self.distortion, self.lateral_color, self.image_distance_m(distance_m))

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


_MOST_KEPT = 8
_keeping = Lock()
_spreads: WeakKeyDictionary[Lens, dict[float, Spread]] = WeakKeyDictionary()
"""By distance: a spread computes its transfer functions once, and a series of frames asks for them again and again.
Beside the lenses, not in them: what it holds cannot be copied to other processes, and lenses can."""
