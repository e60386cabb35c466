"""Read, develop and calibrate the raw frames in a folder: `python tests/raws/raw_folder.py FOLDER`, or make test-raws.

Every raw file below the folder is read and developed, and every folder that is a measurement (dark frames and flat
fields) is calibrated, in a process of its own with a time limit. A crash, a hang or an exception that is not
photosite's is an error: the exit status is then 1.

At the end is a table to send to photosite's developers: camera, format, size, levels, the noise of dark frames, and
what was refused and why. It has no names of files and folders, no serial numbers and no pictures.
"""

from __future__ import annotations

import argparse
import platform
import re
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as TooLong
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from photosite.errors import PhotositeError

LIMIT_S = 300.0
"""Time limit of a file or a measurement."""

FEWEST_FRAMES = 4
"""Frames of a folder that is calibrated: two dark frames and two flat fields."""


HEADINGS = ("format", "camera", "gain setting", "rows x cols", "bits", "mosaic", "black", "white", "dark noise, DN")


@dataclass(frozen=True)
class Row:
    """What was tried, the result or the reason, the cells of `HEADINGS` that are known, and the time."""

    path: str
    status: str  # ok, refused or error
    result: str
    cells: tuple[str, ...] = ()
    taken_s: float = 0.0


def read_and_develop(path: Path) -> tuple[str, tuple[str, ...]]:
    """Return what a raw file holds: a line, and the cells of `HEADINGS`."""
    import numpy as np

    import photosite as ps
    from photosite.values.cfa import tile_text

    frame = ps.read_raw(path)
    exposure = "-" if frame.exposure_s is None else f"{frame.exposure_s:.4g} s"
    stated = frame.metadata
    noise = dark_noise(frame, path)
    picture = ps.develop(frame) if noise is None else ps.develop(frame, exposure=1.0)
    if not np.isfinite(picture).all():
        raise ValueError("the developed picture is not finite")
    cells = (
        format_name(path),
        str(stated.get("camera") or stated.get("model") or "-"),
        str(stated.get("gain_setting", stated.get("iso", "-"))),
        f"{frame.shape[0]} x {frame.shape[1]}",
        str(frame.bits),
        tile_text(frame.cfa),
        f"{frame.black_level_dn:g}",
        f"{frame.white_level_dn:g}",
        noise or "-",
    )
    return f"{', '.join(cells[1:8])}, {exposure}, median {np.median(frame.dn):g} DN", cells


def format_name(path: Path) -> str:
    """Return the format of a file with its suffix, or its suffix where it is not known."""
    from photosite.frames.io.formats import detect_format

    try:
        return f"{detect_format(path).name} ({path.suffix.lower()})"
    except PhotositeError:
        return path.suffix.lower()


def dark_noise(frame: Any, path: Path) -> str | None:
    """Return the noise of a dark frame with its fixed pattern, without its outliers; None of other frames."""
    import numpy as np

    from photosite.frames.frame_settings import kinds_in_name

    kinds = {frame.metadata["kind"]} if "kind" in frame.metadata else kinds_in_name(path.stem)
    if kinds != {"dark"}:
        return None
    rows, cols = len(frame.cfa), len(frame.cfa[0])
    planes = [frame.dn[r::rows, c::cols].astype(np.float64) for r in range(rows) for c in range(cols)]
    deviations = np.concatenate([(plane - np.median(plane)).ravel() for plane in planes])
    kept = deviations[np.abs(deviations) <= 6.0 * 1.4826 * max(float(np.median(np.abs(deviations))), 1.0)]
    clipped = float((frame.dn == 0).mean())
    return f"{kept.std():.3g}" + (f" ({clipped:.0%} are 0)" if clipped > 0.005 else "")


def calibrate_folder(path: Path) -> tuple[str, tuple[str, ...]]:
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
    return f"{frames.frame_count} frames; " + "; ".join(found), ()


Work = Callable[[Path], tuple[str, tuple[str, ...]]]


def attempt(work: Work, path: Path) -> tuple[str, str, tuple[str, ...]]:
    """Return status, result and cells; for the process of its own."""
    cells = () if path.is_dir() else (format_name(path),)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return "ok", *work(path)
        except PhotositeError as error:
            return "refused", str(error), cells
        except Exception as error:
            return "error", f"{type(error).__name__}: {error}", cells


class Worker:
    """A process that tries one file after another; it is replaced after a crash or a hang."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    def row(self, name: str, work: Work, path: Path) -> Row:
        """Try a file."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
        begun = time.monotonic()
        try:
            status, result, cells = self._pool.submit(attempt, work, path).result(LIMIT_S)
        except BrokenProcessPool:
            status, result, cells = "error", "the process died", (path.suffix.lower(),)
        except TooLong:
            status, result, cells = "error", f"more than {LIMIT_S:g} s", (path.suffix.lower(),)
        if result in ("the process died", f"more than {LIMIT_S:g} s"):
            self.end()
        return Row(name, status, " ".join(result.split()), cells, time.monotonic() - begun)

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
    works: list[tuple[Path, Work]] = [(path, read_and_develop) for path in files[:most_files]]
    works += [(path, calibrate_folder) for path in measurements(folder, files)]
    try:
        for path, work in works:
            name = str(path.relative_to(folder)) + ("/" if path.is_dir() else "")
            rows.append(worker.row(name, work, path))
            print(f"{rows[-1].status:8} {rows[-1].taken_s:6.1f} s  {ascii(name)[1:-1]}: {rows[-1].result}", flush=True)
    finally:
        worker.end()
    return rows


def table(rows: Sequence[Row], folder: Path) -> str:
    """Return the table to send, in Markdown: a line for all files that are alike, then the measurements."""
    alike: dict[tuple[str, ...], list[str]] = {}
    sets = []
    for row in rows:
        result = "read and developed" if row.status == "ok" else f"{row.status}: {without_names(row, folder)}"
        if row.path.endswith("/"):
            sets.append(f"- {result if row.status != 'ok' else row.result}")
        else:
            cells = (*row.cells, *("-" for _ in HEADINGS[len(row.cells) :]))
            alike.setdefault((*cells[:-1], result), []).append(cells[-1])
    lines = [("files", *HEADINGS, "result"), ("---",) * (len(HEADINGS) + 2)]
    for (*same, result), noise in alike.items():
        found = sorted(set(noise) - {"-"}, key=lambda text: float(text.split()[0])) or ["-"]
        lines.append((str(len(noise)), *same, " to ".join(dict.fromkeys((found[0], found[-1]))), result))
    shown = "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)
    return "\n\n".join([shown, *(["Measurements:\n\n" + "\n".join(sets)] if sets else [])])


def without_names(row: Row, folder: Path) -> str:
    """Return the reason without the names of files and folders."""
    name = row.path.rstrip("/")
    parts = [str(folder / name), name, str(folder.resolve() / name), Path(name).name, str(folder)]
    text = row.result
    for part in sorted({part for part in parts if len(part) > 1}, key=len, reverse=True):
        text = text.replace(part, "...")
    return re.sub(r"(?<![\w.])/?(?:[\w.~ -]+/)+[\w.~-]+", "...", text).removeprefix("...: ")


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
    print(f"{len(rows)} tried: {counts}\n\nphotosite {version('photosite')}, {platform.platform()}, to send:\n")
    print(table(rows, chosen.folder))
    return 1 if not rows or any(row.status == "error" for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
