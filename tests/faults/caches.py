"""Two processes that fill one empty cache, and a later one that uses it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import photosite as ps
from photosite.files.cache import CACHE_VARIABLE

SHOT = "simulate --sensor nikon-d200 --rows 24 --cols 32 --optics {lens} -o {name} --force"
"""Uses compiled kernels, the modes of a lens design and transfer functions."""


def write_lens(path: Path) -> None:
    """Write an optics file with a lens design of two field points."""
    axis = np.arange(-10, 11) * 0.5
    r2 = axis[:, None] ** 2 + axis**2
    psf = np.stack([np.exp(-r2 / 2), np.exp(-r2 / 4)])[:, None]
    blur = ps.optics.LensDesign(np.array([550.0]), psf, 0.5, np.zeros(2), np.array([0.0, 8.0]))
    ps.Lens(ps.DiffractionLimited(2.8, 50), blur=blur).save(path)


def _start(place: Path, arrays: Path, kernels: Path | None, name: str) -> subprocess.Popen[str]:
    environment = os.environ | {CACHE_VARIABLE: str(arrays), "SOURCE_DATE_EPOCH": "1700000000"}
    if kernels is not None:
        environment["XDG_CACHE_HOME"] = str(kernels)
    arguments = SHOT.format(lens=place / "lens.optics.yaml", name=place / name).split()
    command = [sys.executable, "-m", "photosite", *arguments]
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def _ended(process: subprocess.Popen[str], name: str) -> list[str]:
    _, err = process.communicate()
    return [f"{name}: exit status {process.returncode}: {err[-1500:]}"] if process.returncode else []


def _entries(*folders: Path | None) -> dict[str, int]:
    """Return the numbers (inodes) of the files in caches: a file that is written anew has another one."""
    files = [file for folder in folders if folder for file in folder.rglob("*") if file.is_file()]
    return {str(file): file.stat().st_ino for file in files}


def race(place: Path, *, kernels: bool) -> list[str]:
    """Return what is wrong with two processes that fill one cache at once, and with the process after them.

    With `kernels`, they also share an empty cache of compiled kernels; otherwise they use the user's.
    """
    place.mkdir(parents=True, exist_ok=True)
    write_lens(place / "lens.optics.yaml")
    shared = place / "shared arrays", place / "shared kernels" if kernels else None
    wrong = _ended(_start(place, place / "own arrays", None, "own.tif"), "alone")
    both = [_start(place, *shared, f"{number}.tif") for number in range(2)]
    for number, process in enumerate(both):
        wrong += _ended(process, f"process {number}")
    before = _entries(*shared)
    wrong += _ended(_start(place, *shared, "next.tif"), "the next run")
    if wrong:
        return wrong
    for name in ("0.tif", "1.tif", "next.tif"):
        if (place / name).read_bytes() != (place / "own.tif").read_bytes():
            wrong.append(f"{name} differs from that of an undisturbed run")
    for kind in ("modes-", "transfers-", *([".nbc"] if kernels else [])):
        if not any(kind in name for name in before):
            wrong.append(f"the caches have no file '{kind}'")
    if _entries(*shared) != before:
        wrong.append(f"the next run wrote to the caches: {sorted(_entries(*shared).items() ^ before.items())[:4]}")
    return wrong
