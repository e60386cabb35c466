"""The interfaces of optics: what a camera requires of a lens, and what a lens requires of its blur."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.optics.mapping import RadialMapping
from photosite.optics.point_spread import PointSpread
from photosite.optics.veiling_glare import VeilingGlare

if TYPE_CHECKING:
    from photosite.optics.diffraction import DiffractionLimited

Array = NDArray[np.float64]


class Optics(Protocol):
    """What a camera requires of its lens. Distances are from the lens to the object, in m."""

    def magnification(self, distance_m: float) -> float:
        """Return |m|, image size over object size."""

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
