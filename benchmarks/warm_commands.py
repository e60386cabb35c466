"""Time of whole commands with compiled kernels in the cache, and what they spend it on.

    python benchmarks/warm_commands.py [--frames DESCRIPTOR] [--against SRC] [--repeats 5] [--only NAME]

Each command runs as a process of its own: once to fill the caches, then `--repeats` times in turn with the tree of
`--against` (a `src` folder), if given. Wall and processor time are medians. One more run of each command measures its
parts: importing modules, loading compiled kernels, reading and writing files; computation is the rest. `--frames` is a
set of frames for `photosite calibrate`.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

INPUTS = {
    "lens.optics.yaml": "photosite_optics: 1\nf_number: 8\nfocal_length_mm: 50\n"
    "blur: {kind: wavefront, zernike: {8: 50}, unit: nm}\n",
    "pixels.sweep.yaml": "photosite_sweep: 1\n"
    "camera: {sensor: google-pixel-4a, optics: {f_number: 2.8, focal_length_mm: 4}}\n"
    "values:\n  pixel_width_um: [0.8, 1.0, 1.4, 2.0, 3.0]\n  f_number: [1.8, 2.8, 4]\n"
    "measure: {snr: {luminance_cd_m2: 5, exposure: 1/15}}\n",
}
MADE = (
    "simulate -o shot.dng",
    "simulate --seed 2 -o other.dng",
    "simulate --scene slanted-edge --cells 3 --exposure auto -o edge.dng",
    "sensors export nikon-d200 -o own.sensor.yaml",
    "shoot --rows 648 --cols 968 -o stack",
    "export nikon-d200 libcamera -o tuning.json",
)
"""Commands that make inputs of others."""

MADE_ANEW = ("pairs", "shot")
"""Folders that a run has to make anew: shoot does not replace frames, and dataset keeps complete pairs."""

COMMANDS = {
    "--help": "--help",
    "sensors list": "sensors list",
    "sensors show": "sensors show nikon-d200",
    "sensors check": "sensors check own.sensor.yaml",
    "sensors compare": "sensors compare nikon-d200 sony-imx571",
    "scenes list": "scenes list",
    "scenes show": "scenes show macbeth",
    "optics check": "optics check lens.optics.yaml",
    "explain": "explain",
    "simulate": "simulate -o shot.dng --force",
    "simulate, preview": "simulate -o shot.dng --preview shot.png --force",
    "develop": "develop shot.dng -o developed.png --force",
    "mtf": "mtf edge.dng",
    "measure, ColorChecker": "measure shot.dng --chart macbeth",
    "measure, edge": "measure edge.dng --chart slanted-edge",
    "validate": "validate shot.dng other.dng",
    "plan": "plan --rows 1000 --cols 1500 --want prnu_percent=2%",
    "shoot": "shoot --rows 648 --cols 968 -o shot",
    "export": "export nikon-d200 libcamera -o tuning.json --force",
    "import": "import tuning.json",
    "sweep": "sweep pixels.sweep.yaml -o pixels.csv --force",
    "dataset": "dataset macbeth --crop 256x256 --crops 16 -o pairs",
    "calibrate, 405 frames of 648 x 968 pixels": "calibrate stack",
}
FILES = {
    "photosite.frames.io.formats": ("read_raw", "write_raw", "read_headers", "read_frame"),
    "photosite.develop.develop": ("save_picture",),
}
"""Functions that read and write files, in the thread that calls them."""


class Parts:
    """Time of the parts of this process: of nested parts, only the inner one counts."""

    def __init__(self) -> None:
        self.seconds = {"imports": 0.0, "kernels": 0.0, "files": 0.0}
        self._running: list[str] = []
        self._since = 0.0

    def _lap(self) -> None:
        now = time.perf_counter()
        if self._running:
            self.seconds[self._running[-1]] += now - self._since
        self._since = now

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, with its time added to a part."""
        import threading

        def run(*arguments: Any, **named: Any) -> Any:
            if threading.current_thread() is not threading.main_thread():
                return function(*arguments, **named)
            self._lap()
            self._running.append(part)
            try:
                return function(*arguments, **named)
            finally:
                self._lap()
                self._running.pop()

        return run


def trace(path: str, arguments: list[str]) -> None:
    """Run a command in this process and write the time of its parts."""
    start = time.perf_counter()
    parts = Parts()
    bootstrap = sys.modules["_frozen_importlib"]
    load = bootstrap._find_and_load

    def find_and_load(name: str, import_: Any) -> Any:
        known = name in sys.modules
        module = load(name, import_)
        if not known:
            _instrument(name, parts)
        return module

    bootstrap._find_and_load = parts.timed("imports", find_and_load)
    from photosite.cli.main import run

    status = run(arguments)
    whole = time.perf_counter() - start
    rest = whole - sum(parts.seconds.values())
    Path(path).write_text(json.dumps(parts.seconds | {"computation": rest, "modules": len(sys.modules)}))
    sys.exit(status)


def _instrument(name: str, parts: Parts) -> None:
    module = sys.modules.get(name)
    if name == "photosite.engine.kernel_cache":
        cache = module.KernelCache  # type: ignore[union-attr]
        cache.load_overload = parts.timed("kernels", cache.load_overload)
    for target in FILES.get(name, ()):
        *owner, attribute = target.split(".")
        holder = getattr(module, owner[0]) if owner else module
        if hasattr(holder, attribute):
            setattr(holder, attribute, parts.timed("files", getattr(holder, attribute)))


def _environment(source: Path) -> dict[str, str]:
    """Return the environment of a process: modules are compiled once, as in an installed package."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPATH": str(source)}


def timed_run(source: Path, arguments: list[str], folder: Path) -> tuple[float, float]:
    """Return wall and processor time of a command as a process."""
    environment = _environment(source)
    for name in MADE_ANEW:
        shutil.rmtree(folder / name, ignore_errors=True)
    start = time.perf_counter()
    with open(os.devnull, "w") as nowhere:
        process = subprocess.Popen(
            [sys.executable, "-m", "photosite", *arguments], cwd=folder, env=environment, stdout=nowhere, stderr=nowhere
        )
        _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    if status:
        raise SystemExit(f"photosite {' '.join(arguments)} ended with {os.waitstatus_to_exitcode(status)}")
    return wall, usage.ru_utime + usage.ru_stime


def measured_parts(source: Path, arguments: list[str], folder: Path) -> dict[str, float]:
    """Return the time of the parts of one run."""
    environment = _environment(source)
    for name in MADE_ANEW:
        shutil.rmtree(folder / name, ignore_errors=True)
    command = [sys.executable, __file__, "--trace", "parts.json", *arguments]
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    found: dict[str, float] = json.loads((folder / "parts.json").read_text())
    return found


def main() -> None:
    """Run the measurement and print its table."""
    if sys.argv[1:2] == ["--trace"]:
        trace(sys.argv[2], sys.argv[3:])
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", action="append", default=[])
    options = parser.parse_args()
    own = Path(__file__).resolve().parents[1] / "src"
    trees = [options.against.resolve(), own] if options.against else [own]
    commands = {name: line.split() for name, line in COMMANDS.items()}
    if options.frames:
        commands["calibrate"] = ["calibrate", str(options.frames.resolve())]
    if options.only:
        commands = {name: line for name, line in commands.items() if name in options.only}
    columns = "".join(f" wall, {tree} | processor |" for tree in (("before", "now") if options.against else ("now",)))
    print(f"| command |{columns} imports | kernels | files | computation | modules |")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for name, text in INPUTS.items():
            (folder / name).write_text(text)
        for line in MADE:
            timed_run(own, line.split(), folder)
        for command, line in commands.items():
            for tree in trees:
                timed_run(tree, line, folder)
            runs = [[timed_run(tree, line, folder) for tree in trees] for _ in range(options.repeats)]
            cells = []
            for of_tree in zip(*runs, strict=True):
                cells += [f"{statistics.median(times):.2f}" for times in zip(*of_tree, strict=True)]
            parts = measured_parts(own, line, folder)
            cells += [f"{parts[part]:.2f}" for part in ("imports", "kernels", "files", "computation")]
            print(f"| {command} | {' | '.join(cells)} | {parts['modules']} |", flush=True)


if __name__ == "__main__":
    main()
