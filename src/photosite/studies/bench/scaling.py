"""Growth of time with pixels, wavelengths, frames and threads, and of memory with pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from photosite.engine.jit import ITEMS_PER_THREAD, threads_for
from photosite.scene import charts
from photosite.studies.bench.captures import EXPOSURE_S, camera, scene
from photosite.studies.bench.timing import best_seconds, peak_mb


@dataclass(frozen=True)
class Scaling:
    """Seconds at several sizes of one quantity.

    Parameters
    ----------
    what, unit
        Title, and unit of the sizes.
    sizes, seconds
        Measured points.
    """

    what: str
    unit: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Exponent of seconds = c sizes^exponent by least squares on logarithms: 1 is proportional, 0 independent."""
        return float(np.polyfit(np.log(self.sizes), np.log(self.seconds), 1)[0])

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "unit": self.unit,
            "sizes": list(self.sizes),
            "seconds": list(self.seconds),
            "exponent": self.exponent,
        }


def scaling() -> tuple[Scaling, ...]:
    """Measure captures of a ColorChecker by pixels, wavelengths, frames of a stream, and threads."""
    return (_by_pixels(), _by_wavelengths(), _by_frames(), _by_threads())


def _measured(what: str, unit: str, sizes: Sequence[float], work: Callable[[int], object]) -> Scaling:
    for index in range(len(sizes)):
        work(index)
    return Scaling(what, unit, tuple(sizes), tuple(best_seconds(partial(work, index)) for index in range(len(sizes))))


def _by_pixels() -> Scaling:
    shapes = [(648, 968), (1296, 1936), (2592, 3872), (5184, 7744)]
    return _measured(
        "capture, by pixels",
        "megapixels",
        [rows * cols / 1e6 for rows, cols in shapes],
        lambda i: camera(*shapes[i]).capture(scene(), EXPOSURE_S),
    )


def _by_wavelengths() -> Scaling:
    counts = [31, 61, 151, 301]
    return _measured(
        "mean electrons of a D200, by wavelengths",
        "wavelengths",
        counts,
        lambda i: camera().mean_electrons(scene(counts[i]), EXPOSURE_S),
    )


def _by_frames() -> Scaling:
    counts = [1, 4, 16]
    return _measured(
        "stream of a D200, by frames",
        "frames",
        counts,
        lambda i: [None for _ in camera().stream(scene(), EXPOSURE_S, frames=counts[i])],
    )


def _by_threads() -> Scaling:
    counts = [1, 2]

    def work(index: int) -> None:
        with threads_for(counts[index] * ITEMS_PER_THREAD):
            camera().capture(scene(), EXPOSURE_S)

    return _measured("capture of a D200, by threads", "threads", counts, work)


_MEMORY_SHAPES = ((2592, 3872), (5184, 7744), (10_320, 14_536))


@dataclass(frozen=True)
class Memory:
    """Peak memory of a stream of captures in fresh processes.

    Parameters
    ----------
    megapixels
        Sizes.
    bytes_per_pixel
        Peak memory beyond that of a capture of 100 x 150 pixels, which holds libraries and compiled code.
    """

    megapixels: tuple[float, ...]
    bytes_per_pixel: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {"megapixels": list(self.megapixels), "bytes_per_pixel": list(self.bytes_per_pixel)}


def work_stream(rows: int, cols: int) -> None:
    """Capture two frames of a ColorChecker."""
    for _ in camera(rows, cols).stream(charts.macbeth("A", 40), EXPOSURE_S, frames=2):
        pass


def memory() -> Memory:
    """Measure the peak memory of all sizes."""
    least = peak_mb(work_stream, rows=100, cols=150)
    sizes = [rows * cols / 1e6 for rows, cols in _MEMORY_SHAPES]
    beyond = [
        (peak_mb(work_stream, rows=rows, cols=cols) - least) / size
        for (rows, cols), size in zip(_MEMORY_SHAPES, sizes, strict=True)
    ]
    return Memory(tuple(sizes), tuple(beyond))
