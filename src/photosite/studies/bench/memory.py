"""Peak memory of commands: bytes per pixel beyond libraries and compiled code."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.timing import peak_mb_of
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal

MEGAPIXELS = (0.1, 20.0, 50.0)
"""Sizes of the frames. The first has little but libraries and compiled code; `--quick` takes the first two."""

SENSORS = ("nikon-d200", "sony-imx571")
"""A Bayer mosaic of 12 bits, and a monochrome sensor of 16 bits."""

_COMMANDS = {
    "simulate": "simulate --force --sensor {sensor} --rows {rows} --cols {cols} -o {folder}/shot.dng",
    "simulate --preview": "simulate --force --sensor {sensor} --rows {rows} --cols {cols} -o {folder}/again.dng "
    "--preview {folder}/preview.png",
    "develop": "develop --force {folder}/shot.dng -o {folder}/picture.png",
    "calibrate": "calibrate --force {folder}/frames -o {folder}/plain.sensor.yaml",
    "calibrate --maps": "calibrate --force {folder}/frames --maps -o {folder}/maps.sensor.yaml",
}
"""Commands, in an order in which each finds its input."""

_CHILD = "import sys; sys.argv[1:] = {arguments!r}; from photosite.cli.main import main; main()"


@dataclass(frozen=True)
class MemoryUse:
    """Peak resident memory of a command at several sizes of the frame.

    Parameters
    ----------
    command, sensor
        The command, and the preset of the sensor.
    megapixels, peak_mb
        (n,) sizes, and the peaks of fresh processes in 10^6 bytes.
    """

    command: str
    sensor: str
    megapixels: tuple[float, ...]
    peak_mb: tuple[float, ...]

    @property
    def bytes_per_pixel(self) -> tuple[float, ...]:
        """(n - 1,) peak of each size beyond that of the first, per pixel beyond those of the first.

        Examples
        --------
        >>> MemoryUse("simulate", "nikon-d200", (0.0, 20.0), (300.0, 500.0)).bytes_per_pixel
        (10.0,)
        """
        sizes, peaks = self.megapixels, self.peak_mb
        others = zip(sizes[1:], peaks[1:], strict=True)
        return tuple((peak - peaks[0]) / (size - sizes[0]) for size, peak in others)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {**asdict(self), "bytes_per_pixel": self.bytes_per_pixel}


def memory_protocol() -> ShootingProtocol:
    """Return a protocol of 20 frames: dark frames at three exposure times, flat fields at six."""
    dark = (Step("dark", 1 / 8000, 4), *series("dark", 1 / 1000, 1 / 25, exposures=2, count=2))
    return ShootingProtocol("memory", (*dark, *series("light", 1 / 1000, 1 / 25, exposures=6, count=2)))


def shape_of(megapixels: float) -> tuple[int, int]:
    """Return rows and columns of a frame of 2:3, multiples of 12.

    Examples
    --------
    >>> shape_of(20.0)
    (3648, 5484)
    """
    rows = 12 * max(round((megapixels * 1e6 / 1.5) ** 0.5 / 12), 1)
    return rows, 12 * max(round(megapixels * 1e6 / rows / 12), 1)


def measure_memory(
    commands: Sequence[str], sizes: Sequence[float], report: Callable[[str], object], sensors: Sequence[str] = SENSORS
) -> list[MemoryUse]:
    """Measure commands at all sizes.

    Parameters
    ----------
    commands
        Names in the table of commands, in its order; all if empty.
    sizes
        Megapixels.
    report
        Called with what is measured.
    sensors
        Presets.

    Raises
    ------
    PhotositeError
        If a command fails.
    """
    chosen = [name for name in _COMMANDS if name in commands or not commands]
    uses = []
    for sensor in sensors:
        peaks: dict[str, list[float]] = {name: [] for name in chosen}
        pixels = []
        for size in sizes:
            rows, cols = shape_of(size)
            pixels.append(rows * cols / 1e6)
            with tempfile.TemporaryDirectory() as folder:
                if any(name.startswith("calibrate") for name in chosen):
                    chip = with_pedestal(load_sensor(sensor).with_(rows=rows, cols=cols))
                    virtual_lab(chip, memory_protocol(), seed=1).write(f"{folder}/frames")
                if "develop" in chosen and "simulate" not in chosen:
                    _peak_mb("simulate", sensor, (rows, cols), folder)
                for name in chosen:
                    report(f"{name}, {sensor}, {pixels[-1]:.1f} megapixels")
                    if not peaks[name]:
                        _peak_mb(name, sensor, (rows, cols), folder)  # compiles the kernels
                    peaks[name].append(_peak_mb(name, sensor, (rows, cols), folder))
        uses += [MemoryUse(name, sensor, tuple(pixels), tuple(peaks[name])) for name in chosen]
    return uses


def _peak_mb(name: str, sensor: str, shape: tuple[int, int], folder: str) -> float:
    text = _COMMANDS[name].format(sensor=sensor, rows=shape[0], cols=shape[1], folder=Path(folder))
    return peak_mb_of(_CHILD.format(arguments=text.split()))
