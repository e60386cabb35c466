"""Cases about scenes as fine as the pixels behind a lens with lateral color, and about the first frame of a lens."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Literal

import numpy as np

from photosite.camera.camera import Camera
from photosite.files.cache import CACHE_VARIABLE
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import LateralColor
from photosite.optics.lens import Lens
from photosite.optics.pupil import Pupil
from photosite.optics.wavefront import Wavefront
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.studies.bench.captures import EXPOSURE_S, LENS, MEGAPIXELS, camera, new_camera, scene
from photosite.studies.bench.timing import Case, best_seconds, in_turn, peak_mb

_ROWS, _COLS = 1000, 1500
_APART_PIXELS = 0.7
"""Distance of the images at 450 and 650 nm at the corner."""

FirstKind = Literal["design", "colors", "wavefront", "blades"]
"""Lens-design data without and with lateral color, astigmatism of 40 nm, six blades out of focus."""
FIRST_KINDS: tuple[FirstKind, ...] = ("design", "colors", "wavefront", "blades")


@lru_cache(maxsize=4)
def fine_scene(spectra: int) -> Scene:
    """Return random samples, one a pixel, of smooth spectra from 400 to 700 nm."""
    grid = np.linspace(400, 700, 31)
    peaks = np.linspace(400, 700, spectra + 2)[1:-1]
    basis = 1e13 * np.exp(-(((grid - peaks[:, None]) / 60) ** 2) / 2)
    weights = np.random.default_rng(1).random((spectra, _ROWS, _COLS), dtype=np.float32)
    return Scene(weights=weights, basis=basis, wavelength_nm=grid, distance_m=2.0)


@lru_cache(maxsize=2)
def fine_camera(colors: bool) -> Camera:
    """Return a camera with a pixel for each sample, at f/8, with or without lateral color."""
    plain = camera(_ROWS, _COLS)
    if not colors:
        return plain
    scale = 1 + _APART_PIXELS / np.hypot(_ROWS, _COLS) * np.array([1.0, 0.0, -1.0])
    return Camera(Lens(LENS, lateral_color=LateralColor.from_magnification([450, 550, 650], scale)), plain.sensor)


def work_fine(spectra: int, colors: bool = True) -> None:
    """Compute mean electrons of a scene as fine as the pixels."""
    fine_camera(colors).mean_electrons(fine_scene(spectra), EXPOSURE_S)


def fine_color(spectra: int, quick: bool = False) -> Case:
    """Lateral color with samples as fine as pixels, against the same without, both after a first frame."""
    for colors in (True, False):
        work_fine(spectra, colors)
    ours, theirs = in_turn(lambda: work_fine(spectra), lambda: work_fine(spectra, False), 3 if quick else 9)
    return Case(ours, theirs, peak_mb(work_fine, spectra=spectra), _ROWS * _COLS / 1e6)


# The first frame of a lens.


def _first_frame(kind: FirstKind) -> tuple[Camera, Scene]:
    """Return a camera with a lens that nothing is known of yet, and a scene."""
    if kind != "blades":
        return new_camera(kind), scene()
    blades = Wavefront(pupil=Pupil(blades=6))
    lens = Lens(DiffractionLimited(f_number=2.8, focal_length_mm=50), blades, focus_distance_m=2.0)
    near = charts.macbeth("A", 40, wavelength_nm=np.linspace(400, 700, 31), distance_m=1.2)
    return Camera(lens, camera().sensor), near


def work_first(kind: FirstKind) -> None:
    """Compute the first frame of a lens."""
    one, chart = _first_frame(kind)
    one.mean_electrons(chart, EXPOSURE_S)


@contextmanager
def _cache(folder: str) -> Iterator[None]:
    """Use a folder as the cache on disk; "off" is none."""
    before = os.environ.get(CACHE_VARIABLE)
    os.environ[CACHE_VARIABLE] = folder
    try:
        yield
    finally:
        del os.environ[CACHE_VARIABLE]
        if before is not None:
            os.environ[CACHE_VARIABLE] = before


def first_frame(kind: FirstKind, quick: bool = False) -> Case:
    """The first frame of a lens without a cache on disk, against the next frame."""
    one, chart = _first_frame(kind)
    one.mean_electrons(chart, EXPOSURE_S)  # compiles the kernels
    with _cache("off"):
        ours = best_seconds(lambda: work_first(kind), 1 if quick else 3)
        theirs = best_seconds(lambda: one.mean_electrons(chart, EXPOSURE_S), 1 if quick else 3)
        return Case(ours, theirs, peak_mb(work_first, kind=kind), MEGAPIXELS)


def first_frame_cached(kind: FirstKind, quick: bool = False) -> Case:
    """The first frame of a lens whose transfers are on disk, against one whose transfers are not."""
    with tempfile.TemporaryDirectory() as folder, _cache(folder):
        work_first(kind)
        ours = best_seconds(lambda: work_first(kind), 1 if quick else 3)
        with _cache("off"):
            theirs = best_seconds(lambda: work_first(kind), 1 if quick else 3)
        return Case(ours, theirs, peak_mb(work_first, kind=kind), MEGAPIXELS)
