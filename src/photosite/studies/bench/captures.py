"""Cases about captures at the size of a Nikon D200: optics, noise, both, and the command line.

The baselines are plain ways to do the same work: one transform pair per wavelength in SciPy, and NumPy's Generator for
the noise, in single precision and with two threads where possible.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.color.spectrum import integration_weights
from photosite.optics.diffraction import DiffractionLimited
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
