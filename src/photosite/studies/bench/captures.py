"""Cases about captures at the size of a Nikon D200: optics, noise, both, the command line, and lenses.

The baselines are plain ways to do the same work: one transform pair per wavelength in SciPy, and NumPy's Generator for
the noise, in single precision and with two threads where possible.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.color.spectrum import integration_weights
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import LateralColor
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import FieldPsf, PlanePsf, PointSpread, sample_positions
from photosite.optics.wavefront import Wavefront
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.chip import draw_chip
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.timing import Case, best_seconds, in_turn, peak_mb, peak_mb_of
from photosite.values.cfa import channel_sites

EXPOSURE_S = 1 / 3
ROWS, COLS = 2592, 3872
MEGAPIXELS = ROWS * COLS / 1e6
LENS = DiffractionLimited(f_number=8, focal_length_mm=50)

Array = NDArray[np.float64]

_SPOTS_UM = ((1.0, 0.0, 0.0), (3.0, 8.0, 0.0), (3.0, 0.0, 8.0), (6.0, 0.0, 0.0), (4.0, 6.0, 6.0))
"""Core and flares of a synthetic lens: standard deviation, and offset down and to the right."""

BASE = DiffractionLimited(f_number=2.8, focal_length_mm=50)
WAVELENGTH_NM, SPACING_UM, SAMPLES = 550.0, 0.55, 61
_COMA_WAVES, _CURVATURE_WAVES = 0.8, 0.3
"""At the rim of the pupil and the edge of the field; coma grows with image height, curvature with its square."""
_PUPIL = 96


@lru_cache(maxsize=4)
def camera(rows: int = ROWS, cols: int = COLS) -> Camera:
    """Return a D200 with a raised black level, at f/8."""
    return Camera(LENS, load_sensor("nikon-d200").with_(rows=rows, cols=cols, black_level_dn=32))


@lru_cache(maxsize=8)
def scene(wavelengths: int = 31) -> Scene:
    """Return a ColorChecker from 400 to 700 nm."""
    return charts.macbeth("A", 40, wavelength_nm=np.linspace(400, 700, wavelengths))


def mean_per_wavelength(rows: int, cols: int, wavelengths: int = 31) -> NDArray[np.float32]:
    """Return mean electrons by the plain way: one transform pair per wavelength on the pixel grid."""
    chart, lens, sensor = scene(wavelengths), LENS, camera().sensor
    row = np.minimum((np.arange(rows) * chart.shape[0]) // rows, chart.shape[0] - 1)
    col = np.minimum((np.arange(cols) * chart.shape[1]) // cols, chart.shape[1] - 1)
    pitch_m = sensor.pixel.width_um.value * 1e-6
    side_m = pitch_m * math.sqrt(sensor.pixel.fill_factor.value)
    size = [scipy.fft.next_fast_len(n + 64, real=True) for n in (rows, cols)]
    fy, fx = np.fft.fftfreq(size[0], pitch_m)[:, None], np.fft.rfftfreq(size[1], pitch_m)[None, :]
    frequency = np.hypot(fy, fx)
    aperture = (np.sinc(fy * side_m) * np.sinc(fx * side_m)).astype(np.float32)
    step = integration_weights(chart.wavelength_nm)
    irradiance = lens.irradiance_per_radiance(chart.wavelength_nm, chart.distance_m)
    mosaic = np.zeros((rows, cols), np.float32)
    for k, wavelength in enumerate(chart.wavelength_nm):
        small = np.tensordot(chart.basis[:, k].astype(np.float32), chart.weights, axes=1)
        laid = np.pad(small[row][:, col], ((0, size[0] - rows), (0, size[1] - cols)), mode="edge")
        spectrum = scipy.fft.rfft2(laid, workers=-1)
        spectrum *= lens.otf(frequency, wavelength, chart.distance_m).astype(np.float32) * aperture
        blurred = scipy.fft.irfft2(spectrum, s=size, workers=-1, overwrite_x=True)[:rows, :cols]
        for name in sensor.channel_names:
            efficiency = sensor.channels[name].quantum_efficiency_at([wavelength])[0]
            gain = np.float32(efficiency * irradiance[k] * step[k] * side_m**2 * EXPOSURE_S)
            for r, c in channel_sites(sensor.array.cfa, name):
                mosaic[r::2, c::2] += gain * blurred[r::2, c::2]
    return mosaic


def noise_by_numpy(mean: NDArray[np.float32], seed: int = 1) -> NDArray[np.uint16]:
    """Return a frame by the plain way: NumPy's Poisson and normal draws, then well, gain and converter."""
    sensor, rng = camera(*mean.shape).sensor, np.random.default_rng(seed)
    response, offset = _plain_chip(*mean.shape)
    electrons = rng.poisson(mean * response).astype(np.float32)
    np.minimum(electrons, np.float32(sensor.pixel.well_capacity_e.value), out=electrons)
    electrons += offset
    electrons += rng.standard_normal(mean.shape, np.float32) * np.float32(sensor.electrons(0.52))
    electrons *= np.float32(sensor.system_gain_dn_per_e)
    electrons += np.float32(sensor.readout.black_level_dn.value)
    return np.clip(np.rint(electrons), 0, sensor.white_level_dn).astype(np.uint16)


@lru_cache(maxsize=1)
def _plain_chip(rows: int, cols: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    chip = draw_chip(camera(rows, cols).sensor)
    return 1 + chip.prnu.map(), chip.offset_e.map()


def work(what: Literal["capture", "optics", "noise"], rows: int = ROWS, cols: int = COLS) -> None:
    """Capture a frame, compute its mean electrons, or expose a uniform field."""
    if what == "capture":
        camera(rows, cols).capture(scene(), EXPOSURE_S, seed=1)
    elif what == "optics":
        camera(rows, cols).mean_electrons(scene(), EXPOSURE_S)
    else:
        camera(rows, cols).expose(np.full((rows, cols), 5000, np.float32), EXPOSURE_S, seed=1)


@lru_cache(maxsize=1)
def _plain_optics_once() -> tuple[float, NDArray[np.float32]]:
    """Return seconds and result of the plain optics, measured once for all cases of a quick run."""
    start = time.perf_counter()
    mosaic = mean_per_wavelength(ROWS, COLS)
    return time.perf_counter() - start, mosaic


def optics_d200(quick: bool = False) -> Case:
    """Mean electrons of a ColorChecker of 31 wavelengths, against one transform pair per wavelength."""
    work("optics")  # compiles the kernels
    if quick:
        ours, theirs = best_seconds(lambda: work("optics")), _plain_optics_once()[0]
    else:
        ours, theirs = in_turn(lambda: work("optics"), lambda: mean_per_wavelength(ROWS, COLS))
    return Case(ours, theirs, peak_mb(work, what="optics"), MEGAPIXELS)


def noise_d200(quick: bool = False) -> Case:
    """Noise of a frame of the ColorChecker, against NumPy's draws of the same physics."""
    mean = camera().mean_electrons(scene(), EXPOSURE_S)
    camera().expose(mean, EXPOSURE_S, seed=1)
    _plain_chip(*mean.shape)
    ours, theirs = in_turn(
        lambda: camera().expose(mean, EXPOSURE_S, seed=1), lambda: noise_by_numpy(mean), repeats=3 if quick else 7
    )
    return Case(ours, theirs, peak_mb(work, what="noise"), MEGAPIXELS)


def capture_d200(quick: bool = False) -> Case:
    """A whole capture, 31 wavelengths, diffraction, noise and 12 bits, against both plain ways together."""
    work("capture")
    _plain_chip(ROWS, COLS)
    if quick:
        optics_s, mean = _plain_optics_once()
        ours = best_seconds(lambda: work("capture"))
        theirs = optics_s + best_seconds(lambda: noise_by_numpy(mean), 1)
    else:
        ours, theirs = in_turn(lambda: work("capture"), lambda: noise_by_numpy(mean_per_wavelength(ROWS, COLS)))
    return Case(ours, theirs, peak_mb(work, what="capture"), MEGAPIXELS)


def work_command(folder: str) -> None:
    """Run `photosite simulate` in a fresh process."""
    target = Path(folder) / "shot.dng"
    command = [sys.executable, "-m", "photosite", "simulate", "-o", str(target)]
    subprocess.run(command, check=True, capture_output=True)
    target.unlink()


def plain_capture(folder: str) -> None:
    """Save a frame by the plain ways."""
    np.save(Path(folder) / "shot.npy", noise_by_numpy(mean_per_wavelength(ROWS, COLS, 41)))


def cli_simulate(quick: bool = False) -> Case:
    """`photosite simulate` from process start to the DNG, against the plain ways in a process of their own."""
    with tempfile.TemporaryDirectory() as folder:
        if not quick:  # a quick run has already compiled the kernels
            work_command(folder)
        ours = best_seconds(lambda: work_command(folder), 1 if quick else 4)
        code = f"from {__name__} import plain_capture; plain_capture({folder!r})"
        theirs = best_seconds(lambda: subprocess.run([sys.executable, "-c", code], check=True, capture_output=True), 1)
        target = str(Path(folder) / "shot.dng")
        call = f"sys.argv = ['photosite', 'simulate', '-o', {target!r}]; import photosite.cli.main as m; m.main()"
        return Case(ours, theirs, peak_mb_of(call), MEGAPIXELS)


# Lenses whose blur is not symmetric or varies over the field.


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
    return new_camera(kind)


def new_camera(kind: Kind) -> Camera:
    """Return a D200 behind a lens of some kind, of which nothing is computed yet."""
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


def work_lens(kind: Kind) -> None:
    """Compute mean electrons behind a lens of some kind."""
    _camera(kind).mean_electrons(scene(), EXPOSURE_S)


def _case(kind: Kind, baseline: Kind, quick: bool) -> Case:
    for each in (kind, baseline):
        work_lens(each)
    ours, theirs = in_turn(lambda: work_lens(kind), lambda: work_lens(baseline), 1 if quick else 5)
    return Case(ours, theirs, peak_mb(work_lens, kind=kind), MEGAPIXELS)


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
