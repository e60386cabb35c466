"""Peak memory of commands: bytes per pixel beyond libraries and compiled code, a slope over the size of the frame."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.timing import peak_mb_of
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal

MEGAPIXELS = (5.0, 20.0, 50.0)
"""Sizes of the frames; `--quick` takes the first two."""

SENSORS = ("nikon-d200", "sony-imx571")
"""A Bayer mosaic of 12 bits, and a monochrome sensor of 16 bits."""

_COMMANDS = {
    "simulate": "simulate --sensor {sensor} --rows {rows} --cols {cols} -o {folder}/shot.dng",
    "simulate --preview": "simulate --sensor {sensor} --rows {rows} --cols {cols} -o {folder}/again.dng "
    "--preview {folder}/preview.png",
    "develop": "develop {folder}/shot.dng -o {folder}/picture.png",
    "calibrate": "calibrate {folder}/frames -o {folder}/plain.sensor.yaml",
    "calibrate --maps": "calibrate {folder}/frames --maps -o {folder}/maps.sensor.yaml",
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
    def line(self) -> tuple[float, float]:
        """Bytes per pixel, and megabytes that do not depend on the size: the straight line through the peaks.

        Examples
        --------
        >>> slope, constant = MemoryUse("simulate", "nikon-d200", (5.0, 20.0), (350.0, 500.0)).line
        >>> round(slope, 6), round(constant, 6)
        (10.0, 300.0)
        """
        slope, constant = np.polyfit(self.megapixels, self.peak_mb, 1)
        return float(slope), float(constant)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        slope, constant = self.line
        return {**asdict(self), "bytes_per_pixel": slope, "constant_mb": constant}


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
                    peaks[name].append(_peak_mb(name, sensor, (rows, cols), folder))
        uses += [MemoryUse(name, sensor, tuple(pixels), tuple(peaks[name])) for name in chosen]
    return uses


def _peak_mb(name: str, sensor: str, shape: tuple[int, int], folder: str) -> float:
    text = _COMMANDS[name].format(sensor=sensor, rows=shape[0], cols=shape[1], folder=Path(folder))
    return peak_mb_of(_CHILD.format(arguments=text.split()))
