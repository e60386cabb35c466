"""The calibration's case: frames of a D200's size in uncompressed TIFF, against reading the files and doing nothing."""

from __future__ import annotations

import tempfile
from pathlib import Path

from photosite.calibration.calibrate import calibrate
from photosite.frames.open import open_frames
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.camera import COLS, ROWS
from photosite.studies.bench.timing import Case, in_turn, peak_mb
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal


def protocol(repeats: int = 4) -> ShootingProtocol:
    """Four dark exposures and nine of light, to saturation, `repeats` frames each; four times as many of one dark.

    With 4 it has 64 frames, with 25 it has 400.
    """
    dark = series("dark", 1 / 1000, 1 / 25, exposures=4, count=repeats)
    light = series("light", 1 / 1000, 1 / 25, exposures=9, count=repeats)
    return ShootingProtocol("benchmark", (Step("dark", 1 / 8000, 3 * repeats), *dark, *light))


def write_frames(folder: Path, repeats: int = 4) -> None:
    """Shoot the protocol with a virtual D200."""
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS))
    virtual_lab(sensor, protocol(repeats), seed=1).write(folder)


def work_calibrate(folder: str) -> None:
    """From files to parameters."""
    calibrate(open_frames(folder))


def work_read(folder: str) -> None:
    """The files' bytes, one file after another into the same memory: nothing reads faster from Python.

    `Path.read_bytes` takes as long, or six times as long where the system gives each file new memory.
    """
    room = bytearray()
    for path in sorted(Path(folder).rglob("*.tif")):
        with path.open("rb", buffering=0) as file:
            size = path.stat().st_size
            if size != len(room):
                room = bytearray(size)
            file.readinto(room)


def measured(folder: Path, quick: bool = False) -> Case:
    """The case over frames that are there."""
    place = str(folder)
    work_read(place)  # the page cache is warm, the kernels compiled
    work_calibrate(place)
    ours, theirs = in_turn(lambda: work_calibrate(place), lambda: work_read(place), 1 if quick else 5)
    frames = open_frames(folder)
    return Case(ours, theirs, peak_mb(work_calibrate, folder=place), frames.frame_count * ROWS * COLS / 1e6)


def calibrate_protocol(quick: bool = False, repeats: int | None = None) -> Case:
    """64 frames (`quick`: 16; or 16 times `repeats`) calibrated, against reading their files and doing nothing."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "frames"
        write_frames(place, repeats or (1 if quick else 4))
        return measured(place, quick)
