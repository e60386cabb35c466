"""Read, develop and calibrate the raw frames in a folder: `python tests/raws/raw_folder.py FOLDER`, or make test-raws.

Every raw file below the folder is read and developed, and every folder that is a measurement (dark frames and flat
fields) is calibrated, in a process of its own with a time limit. Frames and folders that photosite refuses are listed
with the reason. A crash, a hang or an exception that is not photosite's is an error: the exit status is then 1.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as TooLong
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from photosite.errors import PhotositeError

LIMIT_S = 300.0
"""Time limit of a file or a measurement."""

FEWEST_FRAMES = 4
"""Frames of a folder that is calibrated: two dark frames and two flat fields."""


@dataclass(frozen=True)
class Row:
    """A line of the table: what was tried, the result or the reason, and the time."""

    path: str
    status: str  # ok, refused or error
    result: str
    taken_s: float = 0.0


def read_and_develop(path: Path) -> str:
    """Return what a raw file holds."""
    import numpy as np

    import photosite as ps

    frame = ps.read_raw(path)
    exposure = "-" if frame.exposure_s is None else f"{frame.exposure_s:.4g} s"
    levels = f"black {frame.black_level_dn:g} white {frame.white_level_dn:g}"
    name, iso = frame.metadata.get("camera", "-"), frame.metadata.get("iso", "-")
    size = f"{frame.shape[0]} x {frame.shape[1]}, {frame.bits} bits, {len(frame.channels)} channels"
    picture = ps.develop(frame)
    if not np.isfinite(picture).all():
        raise ValueError("the developed picture is not finite")
    return f"{name}, ISO {iso}, {exposure}, {size}, {levels}, median {np.median(frame.dn):g} DN"


def calibrate_folder(path: Path) -> str:
    """Return gain and read noise of a measurement; several gain settings are calibrated each."""
    import photosite as ps

    frames = ps.open_frames(path)
    settings = frames.gain_settings or (None,)
    found = []
    for setting in settings:
        result = ps.calibrate(frames if setting is None else frames.at_gain(setting))
        values = (("gain", result.system_gain_dn_per_e, "DN/e-"), ("read noise", result.read_noise_dn, "DN"))
        texts = [
            f"{name} {estimate.value:.4g} {unit}" if estimate.value is not None else f"no {name}: {estimate.reason}"
            for name, estimate, unit in values
        ]
        found.append(("" if setting is None else f"ISO {setting:g}: ") + ", ".join(texts))
    return f"{frames.frame_count} frames; " + "; ".join(found)


def attempt(work: Callable[[Path], str], path: Path) -> tuple[str, str]:
    """Return status and result; for the process of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return "ok", work(path)
        except PhotositeError as error:
            return "refused", str(error)
        except Exception as error:
            return "error", f"{type(error).__name__}: {error}"


class Worker:
    """A process that tries one file after another; it is replaced after a crash or a hang."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    def row(self, name: str, work: Callable[[Path], str], path: Path) -> Row:
        """Try a file."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
        begun = time.monotonic()
        try:
            status, result = self._pool.submit(attempt, work, path).result(LIMIT_S)
        except BrokenProcessPool:
            status, result = "error", "the process died"
        except TooLong:
            status, result = "error", f"more than {LIMIT_S:g} s"
        if result in ("the process died", f"more than {LIMIT_S:g} s"):
            self.end()
        return Row(name, status, " ".join(result.split()), time.monotonic() - begun)

    def end(self) -> None:
        """End the process."""
        if self._pool is not None:
            for process in list((self._pool._processes or {}).values()):
                process.kill()
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


def raw_files(folder: Path) -> list[Path]:
    """Return the raw files below a folder, without hidden ones."""
    from photosite.frames.io.format_table import is_frame_name

    found = (p for p in folder.rglob("*") if is_frame_name(p) and p.is_file())
    return sorted(p for p in found if not any(part.startswith(".") for part in p.relative_to(folder).parts))


def measurements(folder: Path, files: Sequence[Path]) -> list[Path]:
    """Return the folders that may be measurements: with a protocol or a descriptor, or several raw files."""
    listed = {p.parent for pattern in ("protocol.y*ml", "*EMVA*.txt") for p in folder.rglob(pattern)}
    counts = {place: sum(file.parent == place for file in files) for place in {file.parent for file in files}}
    several = {place for place, count in counts.items() if count >= FEWEST_FRAMES}
    below = {place for place in several if any(above in listed for above in place.parents)}
    return sorted(listed | (several - below))


def check(folder: Path, most_files: int | None = None) -> list[Row]:
    """Return the rows of all files and measurements; print each as it is done."""
    files, rows, worker = raw_files(folder), [], Worker()
    works = [(path, read_and_develop) for path in files[:most_files]]
    works += [(path, calibrate_folder) for path in measurements(folder, files)]
    try:
        for path, work in works:
            name = str(path.relative_to(folder)) + ("/" if path.is_dir() else "")
            rows.append(worker.row(name, work, path))
            print(f"{rows[-1].status:8} {rows[-1].taken_s:6.1f} s  {ascii(name)[1:-1]}: {rows[-1].result}", flush=True)
    finally:
        worker.end()
    return rows


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--files", type=int, help="read at most so many files; default all")
    chosen = parser.parse_args()
    if not chosen.folder.is_dir():
        parser.error(f"{chosen.folder}: there is no such folder")
    rows = check(chosen.folder, chosen.files)
    counts = ", ".join(f"{sum(row.status == status for row in rows)} {status}" for status in ("ok", "refused", "error"))
    print(f"{len(rows)} tried: {counts}")
    return 1 if not rows or any(row.status == "error" for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
