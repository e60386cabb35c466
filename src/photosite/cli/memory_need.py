"""What commands need of memory, compared with what there is before they start.

The figures are those of `photosite bench --memory` (docs/validation/memory.md), rounded up.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from photosite.engine.memory import available_memory
from photosite.errors import PhotositeWarning

if TYPE_CHECKING:
    from collections.abc import Sequence

    from photosite.calibration.setting import MapsWanted
    from photosite.frames.frame_set import FrameSet
    from photosite.sensor.model import Sensor

PROCESS_BYTES = 400_000_000
"""Libraries and compiled code of a process."""

_SAID_FROM = 1 << 30
"""Need below which nothing is said."""


def simulate_bytes(sensor: Sensor, cells_per_pixel: int = 1, *, preview: bool = False) -> int:
    """Return the memory that `photosite simulate` takes at most, in bytes.

    Examples
    --------
    >>> import photosite as ps
    >>> round(simulate_bytes(ps.load_sensor("sony-a7r2")) / 1e9, 1)
    0.9
    """
    pixels = sensor.array.rows * sensor.array.cols
    frame = 80 if sensor.effects is not None or sensor.captures is not None else 12
    image = 8 + 5 * cells_per_pixel**2
    return PROCESS_BYTES + pixels * max(frame, image, 60 if preview else 0)


def shoot_bytes(sensor: Sensor) -> int:
    """Return the memory that `photosite shoot` takes at most, in bytes: frames wait to be written.

    Examples
    --------
    >>> import photosite as ps
    >>> round(shoot_bytes(ps.load_sensor("nikon-d200")) / 1e9, 2)
    0.65
    """
    frame = 80 if sensor.effects is not None or sensor.captures is not None else 25
    return PROCESS_BYTES + frame * sensor.array.rows * sensor.array.cols


def develop_bytes(pixels: int) -> int:
    """Return the memory that `photosite develop` takes at most, in bytes.

    Examples
    --------
    >>> develop_bytes(100_000_000) / 1e9
    5.2
    """
    return PROCESS_BYTES + 48 * pixels


def calibrate_bytes(sets: Sequence[FrameSet], processes: int | None = 1, *, maps: MapsWanted = False) -> int:
    """Return the memory that `photosite calibrate` takes at most, in bytes.

    Parameters
    ----------
    sets
        The frames, or those of each capture.
    processes
        Number of local processes; None for one.
    maps
        Whether the chip is mapped, and with the gains of its pixels.

    Examples
    --------
    >>> import numpy as np
    >>> from photosite.frames.frame_set import FrameSet
    >>> frames = FrameSet.from_arrays([("dark", 0.1, np.zeros((10, 10), np.uint16))] * 2, bits=12)
    >>> calibrate_bytes([frames]) < calibrate_bytes([frames], processes=4)
    True
    """
    from photosite.engine.lazy_maps import HELD_PIXELS

    pixels = max(frames.rows * frames.cols for frames in sets)
    of_held, of_large = (92, 44) if maps else (68, 28)
    each = (of_held if pixels <= HELD_PIXELS else of_large) * pixels
    if maps == "gain":  # sums for the gains, and squares of the flat fields
        each += 20 * pixels
    first = sets[0].groups[0].frames[0]
    if first.open_rows() is None:  # whole frames are read ahead, many of small ones, and added in batches
        each += max(10 * pixels, min(256 * pixels, 80 << 20))
    workers = processes or 1
    return PROCESS_BYTES + each + (workers > 1) * workers * (PROCESS_BYTES + 18 * pixels)


def sweep_bytes(sensor: Sensor, processes: int) -> int:
    """Return the memory that the processes of `photosite sweep` take at most, in bytes.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> sweep_bytes(sensor, 4) == 4 * simulate_bytes(sensor)
    True
    """
    return processes * simulate_bytes(sensor)


def dataset_bytes(pixels: int, processes: int) -> int:
    """Return the memory that the processes of `photosite dataset` take at most, in bytes, for crops of so many pixels.

    Examples
    --------
    >>> dataset_bytes(512 * 512, 4) / 1e9
    1.64194304
    """
    return processes * (PROCESS_BYTES + 40 * pixels)


def warn_if_short(what: str, need: int, hint: str) -> None:
    """Warn of a computation that needs more memory than there is.

    It is a warning, because the need is an estimate, and because swap space may help; no option is needed to go on.

    Parameters
    ----------
    what
        The computation, such as "the calibration of 100 megapixels".
    need
        Bytes.
    hint
        What needs less.
    """
    found = available_memory()
    if found is None or need <= max(found.size, _SAID_FROM):
        return
    limit = " within the limit of the container" if found.of_container else ""
    there = f"{found.size / 1e9:.1f} GB are available{limit}"
    warnings.warn(
        PhotositeWarning(f"{what} takes up to {need / 1e9:.1f} GB of memory; {there}, so it may be killed", hint=hint),
        stacklevel=2,
    )


def megapixels(rows: int, cols: int) -> str:
    """Return the size of a frame in words.

    Examples
    --------
    >>> megapixels(2592, 3872)
    '10 megapixels'
    """
    return f"{rows * cols / 1e6:.3g} megapixels"
