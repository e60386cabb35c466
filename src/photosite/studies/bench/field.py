"""Cases of lenses that are not rotationally symmetric, or differ over the field, at the size of a Nikon D200.

The lens is made up: diffraction at f/8, a core, and flares that grow towards the frame's corners, as coma's do. Its
sum of five parts is its definition, not an approximation to anything.
"""

from __future__ import annotations

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
from photosite.optics.wavefront import Wavefront
from photosite.studies.bench.camera import COLS, EXPOSURE_S, LENS, ROWS, camera, scene, work_optics
from photosite.studies.bench.timing import Case, in_turn, peak_mb

Array = NDArray[np.float64]

_SPOTS_UM = ((1.0, 0.0, 0.0), (3.0, 8.0, 0.0), (3.0, 0.0, 8.0), (6.0, 0.0, 0.0), (4.0, 6.0, 6.0))
"""Of the core and the flares: standard deviation, and how far down and to the right."""


@dataclass(frozen=True)
class _Flares:
    """A blur of diffraction and five spots, everywhere that of the frame's corner or different over the field."""

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


@lru_cache(maxsize=4)
def _camera(kind: Literal["plane", "field"], rows: int, cols: int) -> Camera:
    return Camera(Lens(LENS, _Flares(kind)), camera(rows, cols).sensor)


def work_plane(rows: int, cols: int) -> None:
    """Mean electrons behind a spread that is not symmetric, for their memory."""
    _camera("plane", rows, cols).mean_electrons(scene(), EXPOSURE_S)


def work_field(rows: int, cols: int) -> None:
    """Mean electrons behind a spread that differs over the field, for their memory."""
    _camera("field", rows, cols).mean_electrons(scene(), EXPOSURE_S)


def plane_d200(quick: bool = False) -> Case:
    """A ColorChecker of 31 wavelengths behind an asymmetric spread, against one whose symmetry is known."""
    work_plane(ROWS, COLS)
    work_optics(ROWS, COLS)
    ours, theirs = in_turn(lambda: work_plane(ROWS, COLS), lambda: work_optics(ROWS, COLS), 1 if quick else 5)
    return Case(ours, theirs, peak_mb(work_plane, rows=ROWS, cols=COLS), ROWS * COLS / 1e6)


def field_varying_d200(quick: bool = False) -> Case:
    """The same behind a spread of five parts over the field, against the asymmetric one that is the same everywhere."""
    work_field(ROWS, COLS)
    work_plane(ROWS, COLS)
    ours, theirs = in_turn(lambda: work_field(ROWS, COLS), lambda: work_plane(ROWS, COLS), 1 if quick else 5)
    return Case(ours, theirs, peak_mb(work_field, rows=ROWS, cols=COLS), ROWS * COLS / 1e6)


@lru_cache(maxsize=4)
def _real_camera(kind: Literal["wavefront", "design", "colors"], rows: int, cols: int) -> Camera:
    """Astigmatism of 40 nm at f/2.8, or lens-design data of growing coma as 8 modes; `colors` 0.9 pixels apart."""
    from photosite.studies.gallery.lens_design import BASE, comatic_design

    sensor = camera(rows, cols).sensor
    pitch_um = sensor.pixel.width_um.value
    if kind == "wavefront":
        return Camera(Lens(BASE, Wavefront({5: 40.0})), sensor)
    one = comatic_design(np.hypot(rows, cols) / 2 * pitch_um * 1e-3)
    # The same at three wavelengths: what a design program gives for a lens corrected for colour.
    design = LensDesign(
        np.array([450.0, 550.0, 650.0]),
        np.repeat(one.psf, 3, axis=1),
        one.spacing_um,
        one.field_y,
        one.field_x,
        rank=8,
        detail_um=pitch_um,
        nodes=17,
    )
    if kind == "design":
        return Camera(Lens(BASE, design), sensor)
    apart = 0.45 / (np.hypot(rows, cols) / 2)
    colors = LateralColor.from_magnification(design.wavelength_nm, 1 + apart * np.array([1.0, 0.0, -1.0]))
    return Camera(Lens(BASE, design, lateral_color=colors), sensor)


def work_wavefront(rows: int, cols: int) -> None:
    """Mean electrons behind a wavefront that is not symmetric."""
    _real_camera("wavefront", rows, cols).mean_electrons(scene(), EXPOSURE_S)


def work_lens(rows: int, cols: int) -> None:
    """Mean electrons behind lens-design data."""
    _real_camera("design", rows, cols).mean_electrons(scene(), EXPOSURE_S)


def lens_d200(quick: bool = False) -> Case:
    """A ColorChecker behind lens-design data of 8 modes, against a wavefront; both after their first frame."""
    work_lens(ROWS, COLS)
    work_wavefront(ROWS, COLS)
    ours, theirs = in_turn(lambda: work_lens(ROWS, COLS), lambda: work_wavefront(ROWS, COLS), 1 if quick else 5)
    return Case(ours, theirs, peak_mb(work_lens, rows=ROWS, cols=COLS), ROWS * COLS / 1e6)


def work_colors(rows: int, cols: int) -> None:
    """Mean electrons behind lens-design data with lateral colour."""
    _real_camera("colors", rows, cols).mean_electrons(scene(), EXPOSURE_S)


def lateral_color_d200(quick: bool = False) -> Case:
    """The same with red and blue 0.9 pixels apart at the corner, against a wavefront; both after their first frame."""
    work_colors(ROWS, COLS)
    work_wavefront(ROWS, COLS)
    ours, theirs = in_turn(lambda: work_colors(ROWS, COLS), lambda: work_wavefront(ROWS, COLS), 1 if quick else 5)
    return Case(ours, theirs, peak_mb(work_colors, rows=ROWS, cols=COLS), ROWS * COLS / 1e6)
