"""Cases about stacks of frames: exact sums against NumPy and against reading, and a calibration against reading."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.setting import calibrate_setting
from photosite.engine.frame_sums import FrameSums
from photosite.frames.open import open_frames
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.captures import COLS, MEGAPIXELS, ROWS
from photosite.studies.bench.timing import Case, in_turn, peak_mb
from photosite.studies.protocol import ShootingProtocol, Step, paper_d200_protocol, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal


def stack(frames: int) -> NDArray[np.uint16]:
    """Return (frames, rows, cols) of a D200's size, 12-bit values around a quarter of the range."""
    one = np.random.default_rng(1).normal(1000.0, 30.0, (ROWS, COLS)).astype(np.uint16)
    return np.stack([np.roll(one, k, axis=1) for k in range(frames)])


def empty_sums() -> FrameSums:
    """Return empty sums over a mosaic of three channels."""
    return FrameSums((ROWS, COLS), np.array([[0, 1], [1, 2]]), white=4095)


def maps(pixels: NDArray[np.uint16], total: FrameSums, out: NDArray[np.float64]) -> None:
    """Compute mean and variance over the frames from exact sums."""
    total.clear().add(pixels)
    total.mean(out[0])
    total.variance(out[1])


def maps_by_numpy(pixels: NDArray[np.uint16], out: NDArray[np.float64]) -> None:
    """Compute mean and variance over the frames with NumPy."""
    pixels.mean(axis=0, out=out[0])
    pixels.var(axis=0, ddof=1, out=out[1])


def work_maps(frames: int) -> None:
    """Compute the maps of a stack, for the peak memory."""
    maps(stack(frames), empty_sums(), np.zeros((2, ROWS, COLS)))


def accumulate_d200(quick: bool = False) -> Case:
    """Mean and variance maps of a stack, against NumPy's `mean` and `var`."""
    pixels, total, out = stack(16 if quick else 64), empty_sums(), np.zeros((2, ROWS, COLS))
    ours, theirs = in_turn(lambda: maps(pixels, total, out), lambda: maps_by_numpy(pixels, out), 2 if quick else 4)
    return Case(ours, theirs, peak_mb(work_maps, frames=len(pixels)), pixels.size / 1e6)


def accumulate_against_reading(quick: bool = False) -> Case:
    """Exact sums of a stack, against reading it from memory: the maximum of its 64-bit words."""
    pixels = stack(16 if quick else 64)
    words, total = pixels.reshape(-1).view(np.uint64), empty_sums()
    ours, theirs = in_turn(lambda: total.add(pixels), lambda: words.max(), 5 if quick else 15)
    return Case(ours, theirs, peak_mb(work_maps, frames=len(pixels)), pixels.size / 1e6)


def benchmark_protocol(repeats: int) -> ShootingProtocol:
    """Return a protocol of 16 frames per repeat."""
    dark = series("dark", 1 / 1000, 1 / 25, exposures=4, count=repeats)
    light = series("light", 1 / 1000, 1 / 25, exposures=9, count=repeats)
    return ShootingProtocol("benchmark", (Step("dark", 1 / 8000, 3 * repeats), *dark, *light))


def write_frames(folder: str, protocol: ShootingProtocol) -> None:
    """Write frames of a virtual D200."""
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS))
    virtual_lab(sensor, protocol, seed=1).write(folder)


def work_calibrate(folder: str) -> None:
    """Calibrate from files."""
    calibrate_setting(open_frames(folder))


def work_read(folder: str) -> None:
    """Read the files one after the other into the same memory, the fastest way to read from Python."""
    buffer = bytearray()
    for path in sorted(Path(folder).rglob("*.tif")):
        with path.open("rb", buffering=0) as file:
            size = path.stat().st_size
            if size != len(buffer):
                buffer = bytearray(size)
            file.readinto(buffer)


def calibrate_protocol(quick: bool = False) -> Case:
    """Calibration of 64 uncompressed TIFF frames (quick: 16), against reading their files."""
    return _calibration(benchmark_protocol(1 if quick else 4), 1 if quick else 5)


def calibrate_protocol_405(quick: bool = False) -> Case:
    """The same for the 405 frames of the 2008 paper, 8 GB on disk and in the page cache (quick: one run)."""
    return _calibration(paper_d200_protocol(), 1 if quick else 3)


def _calibration(protocol: ShootingProtocol, repeats: int) -> Case:
    with tempfile.TemporaryDirectory() as temporary:
        folder = f"{temporary}/frames"
        write_frames(folder, protocol)
        work_read(folder)  # fills the page cache
        work_calibrate(folder)  # compiles the kernels
        ours, theirs = in_turn(lambda: work_calibrate(folder), lambda: work_read(folder), repeats)
        return Case(ours, theirs, peak_mb(work_calibrate, folder=folder), protocol.frame_count * MEGAPIXELS)
