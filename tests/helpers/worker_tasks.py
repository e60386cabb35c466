"""Functions for worker processes, which import them by name."""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from photosite.engine.threads import thread_count

if TYPE_CHECKING:
    import photosite as ps


def first_come(path: Path) -> bool:
    """Return whether no process was here before."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return False
    return True


def double(number: int) -> int:
    """Return twice a number, the sooner the larger it is."""
    time.sleep(0.02 / (1 + number))
    return 2 * number


def double_after_death(folder: str, number: int) -> int:
    """Return twice a number; the first worker that has the number 2 is killed in the middle of it."""
    if number == 2 and first_come(Path(folder) / "died"):
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def deadly(number: int) -> int:
    """End every worker that has the number 1."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def failing(number: int) -> int:
    """Raise an error for the number 3."""
    if number == 3:
        raise ArithmeticError("three")
    return number


def limits(_: Any) -> tuple[int, str | None]:
    """Return the number of threads, and the limit for BLAS."""
    return thread_count(), os.environ.get("OPENBLAS_NUM_THREADS")


def sleeping(number: int) -> int:
    """Wait for a minute."""
    time.sleep(60)
    return number


def noted(folder: str, camera: ps.Camera) -> dict[str, float]:
    """Measure a camera and note that; the process is killed at the fifth while `folder` has a file `deadly`."""
    notes = Path(folder) / "notes"
    if (Path(folder) / "deadly").exists() and len(list(notes.iterdir())) == 4:
        os.kill(os.getpid(), signal.SIGKILL)
    width_um, number = camera.sensor.pixel.width_um.value, camera.optics.f_number
    (notes / f"{number}-{width_um}").touch()
    return {"third": width_um / number / 3, "nothing": float("nan")}


def noted_sweep(folder: str, camera: ps.Camera, values: dict[str, list[float]]) -> None:
    """Sweep in this process with results kept in a folder `kept`."""
    from photosite.studies.sweep import sweep

    sweep(camera, values, partial(noted, folder), checkpoint=f"{folder}/kept")
