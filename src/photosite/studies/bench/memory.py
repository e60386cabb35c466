"""Memory that a capture takes, by the size of the sensor, up to 150 megapixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene import charts
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.timing import peak_mb

_SHAPES = ((2592, 3872), (5184, 7744), (10_320, 14_536))
_FRAMES = 2


@dataclass(frozen=True)
class Memory:
    """Peak memory of a stream of captures in fresh processes.

    Parameters
    ----------
    megapixels
        The sizes.
    bytes_per_pixel
        What each took beyond a capture of 100 x 150 pixels, which is the libraries' and the compiled code's.
    """

    megapixels: tuple[float, ...]
    bytes_per_pixel: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """The figures for JSON."""
        return {"megapixels": list(self.megapixels), "bytes_per_pixel": list(self.bytes_per_pixel)}


def work_stream(rows: int, cols: int) -> None:
    """A few captures of a ColorChecker by a D200 of another size."""
    sensor = load_sensor("nikon-d200").with_(rows=rows, cols=cols, black_level_dn=32)
    camera = Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    for _ in camera.stream(charts.macbeth("A", 40), 1 / 3, frames=_FRAMES):
        pass


def memory() -> Memory:
    """Measure all sizes."""
    least = peak_mb(work_stream, rows=100, cols=150)
    sizes = [rows * cols / 1e6 for rows, cols in _SHAPES]
    beyond = [
        (peak_mb(work_stream, rows=rows, cols=cols) - least) / size
        for (rows, cols), size in zip(_SHAPES, sizes, strict=True)
    ]
    return Memory(tuple(sizes), tuple(beyond))
