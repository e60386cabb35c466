"""`photosite simulate` from process start to a DNG on disk, kernels cached."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from photosite.studies.bench.camera import COLS, ROWS, mean_per_wavelength, noise_by_numpy
from photosite.studies.bench.timing import Case, best_seconds, peak_mb_of


def simulate_in_a_process(folder: str) -> None:
    """The command, as a user gives it."""
    target = Path(folder) / "shot.dng"
    command = [sys.executable, "-m", "photosite", "simulate", "--output", str(target)]
    subprocess.run(command, check=True, capture_output=True)
    target.unlink()


def plainly_in_a_process(folder: str) -> None:
    """The plain way in a fresh process: transforms per wavelength, NumPy's draws, the array saved."""
    code = f"from photosite.studies.bench.command import plain; plain({folder!r})"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def plain(folder: str) -> None:
    """The plain way to the same frame."""
    np.save(Path(folder) / "shot.npy", noise_by_numpy(mean_per_wavelength(ROWS, COLS, 41)))


def cli_simulate(quick: bool = False) -> Case:
    """From process start to a D200's DNG, against the plain way in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        if not quick:  # a quick run has compiled the kernels before it comes here
            simulate_in_a_process(folder)
        ours = best_seconds(lambda: simulate_in_a_process(folder), 1 if quick else 4)
        theirs = best_seconds(lambda: plainly_in_a_process(folder), 1)
        target = str(Path(folder) / "shot.dng")
        call = f"sys.argv = ['photosite', 'simulate', '-o', {target!r}]; import photosite.cli.main as m; m.main()"
        return Case(ours, theirs, peak_mb_of(call), ROWS * COLS / 1e6)
