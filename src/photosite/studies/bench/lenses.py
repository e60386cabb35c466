"""Cases about lenses whose blur is not symmetric or varies over the field, at the size of a Nikon D200."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import LateralColor
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import FieldPsf, PlanePsf, PointSpread
from photosite.optics.sampled_psf import sample_positions
from photosite.optics.wavefront import Wavefront
from photosite.studies.bench.captures import COLS, EXPOSURE_S, LENS, MEGAPIXELS, ROWS, camera, scene
from photosite.studies.bench.timing import Case, in_turn, peak_mb

Array = NDArray[np.float64]

_SPOTS_UM = ((1.0, 0.0, 0.0), (3.0, 8.0, 0.0), (3.0, 0.0, 8.0), (6.0, 0.0, 0.0), (4.0, 6.0, 6.0))
"""Core and flares of a synthetic lens: standard deviation, and offset down and to the right."""

BASE = DiffractionLimited(f_number=2.8, focal_length_mm=50)
WAVELENGTH_NM, SPACING_UM, SAMPLES = 550.0, 0.55, 61
_COMA_WAVES, _CURVATURE_WAVES = 0.8, 0.3
"""At the rim of the pupil and the edge of the field; coma grows with image height, curvature with its square."""
_PUPIL = 96


@dataclass(frozen=True)
class _Flares:
    """Diffraction and five spots: that of the corner everywhere, or varying over the field as their weighted sum."""

    kind: Literal["plane", "field"]

    def point_spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> PointSpread:
        y_m, x_m = np.linspace(-8e-3, 8e-3, 9), np.linspace(-12e-3, 12e-3, 13)
        y, x = (y_m / 8e-3)[:, None], (x_m / 12e-3)[None, :]
        flares = [0.1 * (1 + y) + 0 * x, 0.1 * (1 + x) + 0 * y, 0.2 * (x**2 + y**2), 0.1 * (1 + x * y)]
        weights = np.stack([1 - sum(flares), *flares])
        modes = [np.eye(len(weights))[r] for r in range(len(weights))]
        if self.kind == "plane":
            return _mixed_spots(base, distance_m, weights[:, -1, -1])
        return FieldPsf(y_m, x_m, weights, tuple(_mixed_spots(base, distance_m, mode) for mode in modes))


def _mixed_spots(base: DiffractionLimited, distance_m: float, shares: Array) -> PlanePsf:
    diffraction = base.point_spread(distance_m)

    def otf(fy: Array, fx: Array, wavelength_nm: float) -> NDArray[np.complex128]:
        square = fy**2 + fx**2
        total = np.zeros(square.shape, np.complex128)
        for share, (sigma, down, right) in zip(shares, _SPOTS_UM, strict=True):
            if share:
                turns = fy * (down * 1e-6) + fx * (right * 1e-6)
                total += share * np.exp(-2 * (np.pi * sigma * 1e-6) ** 2 * square - 2j * np.pi * turns)
        return total * diffraction.otf(np.sqrt(square), wavelength_nm)

    return PlanePsf(otf, diffraction.cutoff_per_m, lambda wavelength_nm: diffraction.reach_m(wavelength_nm) + 25e-6)


def comatic_psf(height: float, azimuth_rad: float) -> Array:
    """Return a (61, 61) point spread with coma and field curvature, by the Fourier integral over the pupil.

    `height` is the image height relative to the edge of the field, `azimuth_rad` the direction of the point, from right
    (x) towards down (y). The tail of the coma points outwards. The coma is Zernike's, about the best image point.
    """
    rim = (np.arange(_PUPIL) + 0.5) * (2 / _PUPIL) - 1
    v, u = rim[:, None], rim[None, :]
    along = u * math.cos(azimuth_rad) + v * math.sin(azimuth_rad)
    r2 = u**2 + v**2
    waves = _COMA_WAVES * height * (r2 - 2 / 3) * along + _CURVATURE_WAVES * height**2 * r2
    field = np.where(r2 <= 1, np.exp(2j * math.pi * waves), 0)
    # The path over the pupil to a point at x is u x / (2 N): a wavefront that rises with u moves the image to +x.
    x_um = sample_positions(SAMPLES, SPACING_UM)[:, None]
    kernel = np.exp(-2j * math.pi * x_um * rim / (2 * BASE.f_number * WAVELENGTH_NM * 1e-3))
    psf = np.abs(kernel @ field @ kernel.T) ** 2
    return np.asarray(psf / psf.sum())


def comatic_design(
    edge_mm: float, *, heights: int = 9, nodes: int = 17, rank: int | None = None, detail_um: float | None = None
) -> LensDesign:
    """Return lens-design data of growing coma: point spreads along one radius of the field, the axis included."""
    share = np.linspace(0, 1, heights)
    psf = np.stack([comatic_psf(h, 0.0) for h in share])[:, None]
    field = (np.zeros(heights), share * edge_mm)
    return LensDesign(np.array([WAVELENGTH_NM]), psf, SPACING_UM, *field, rank=rank, detail_um=detail_um, nodes=nodes)


Kind = Literal["symmetric", "plane", "field", "wavefront", "design", "colors"]
"""Symmetric, asymmetric and varying blur; astigmatism of 40 nm, lens-design data without and with lateral color."""


@lru_cache(maxsize=4)
def _camera(kind: Kind) -> Camera:
    sensor = camera().sensor
    if kind == "symmetric":
        return camera()
    if kind in ("plane", "field"):
        return Camera(Lens(LENS, _Flares(kind)), sensor)
    if kind == "wavefront":
        return Camera(Lens(BASE, Wavefront({5: 40.0})), sensor)
    pitch_um, corner = sensor.pixel.width_um.value, np.hypot(ROWS, COLS) / 2
    one = comatic_design(corner * pitch_um * 1e-3)
    # The same point spreads at three wavelengths, as for a lens corrected for color.
    bands_nm, psf = np.array([450.0, 550.0, 650.0]), np.repeat(one.psf, 3, axis=1)
    field = (one.field_y, one.field_x)
    design = LensDesign(bands_nm, psf, one.spacing_um, *field, rank=8, detail_um=pitch_um, nodes=17)
    if kind == "design":
        return Camera(Lens(BASE, design), sensor)
    # Red and blue are 0.9 pixels apart at the corner.
    magnification = 1 + 0.45 / corner * np.array([1.0, 0.0, -1.0])
    colors = LateralColor.from_magnification(design.wavelength_nm, magnification)
    return Camera(Lens(BASE, design, lateral_color=colors), sensor)


def work(kind: Kind) -> None:
    """Compute mean electrons behind a lens of some kind."""
    _camera(kind).mean_electrons(scene(), EXPOSURE_S)


def _case(kind: Kind, baseline: Kind, quick: bool) -> Case:
    for each in (kind, baseline):
        work(each)
    ours, theirs = in_turn(lambda: work(kind), lambda: work(baseline), 1 if quick else 5)
    return Case(ours, theirs, peak_mb(work, kind=kind), MEGAPIXELS)


def plane_d200(quick: bool = False) -> Case:
    """A ColorChecker of 31 wavelengths behind an asymmetric point spread, against a symmetric one."""
    return _case("plane", "symmetric", quick)


def field_varying_d200(quick: bool = False) -> Case:
    """The same behind five point spreads mixed over the field, against the asymmetric one everywhere."""
    return _case("field", "plane", quick)


def lens_d200(quick: bool = False) -> Case:
    """A ColorChecker behind lens-design data of 8 modes, against a wavefront, both after a first frame."""
    return _case("design", "wavefront", quick)


def lateral_color_d200(quick: bool = False) -> Case:
    """The same with red and blue 0.9 pixels apart at the corner, against a wavefront, both after a first frame."""
    return _case("colors", "wavefront", quick)
