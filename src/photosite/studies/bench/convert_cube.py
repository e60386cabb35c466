"""Case about a spectral cube: an ENVI file of 200 bands to a scene file, against reading the file.

`python -m photosite.studies.bench.convert_cube --megapixels 100` measures a large cube and prints one JSON object. A
file of 5 megapixels is read repeatedly; `--whole` writes and reads one file of the full size.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photosite.scene.cube import Block, SpectralCube
from photosite.scene.io.formats import convert_scene, open_cube
from photosite.scene.io.hdf5 import reduce_to_own
from photosite.scene.scene_cube import Reduction, reduce_cube
from photosite.studies.bench.timing import Case, in_turn, peak_mb

BANDS = 200
COLS = 10_000
_MATERIALS = 12
_COUNTS = 4000


def write_cube(path: Path, rows: int, cols: int = COLS) -> None:
    """Write an ENVI file (BSQ, 16 bits) of 12 materials in smoothly varying shares."""
    rng = np.random.default_rng(5)
    grid = np.linspace(400, 1000, BANDS)
    centres, widths = rng.uniform(400, 1000, _MATERIALS), rng.uniform(30, 200, _MATERIALS)
    spectra = np.exp(-(((grid - centres[:, None]) / widths[:, None]) ** 2)).astype(np.float32)
    phase = rng.uniform(0, 2 * np.pi, (2, _MATERIALS))
    x = np.arange(cols) * (rng.integers(3, 40, _MATERIALS)[:, None] * 2 * np.pi / cols) + phase[0][:, None]
    with path.with_suffix(".img").open("wb") as file:
        for first in range(0, rows, 10):
            count = min(10, rows - first)
            y = (first + np.arange(count)) * 0.03 * np.arange(1, _MATERIALS + 1)[:, None] + phase[1][:, None]
            shares = ((1 + np.sin(y))[:, :, None] * (1 + np.sin(x))[:, None, :]).astype(np.float32)
            shares *= rng.uniform(0.8, 1.2, (1, count, cols)).astype(np.float32)
            block = spectra.T @ shares.reshape(_MATERIALS, -1) * np.float32(_COUNTS / (4 * _MATERIALS))
            for band, values in enumerate(np.rint(block).astype("<u2")):
                file.seek(2 * (band * rows + first) * cols)
                file.write(values.data)
    wavelengths = ", ".join(f"{value:.3f}" for value in grid)
    path.write_text(
        f"ENVI\nsamples = {cols}\nlines = {rows}\nbands = {BANDS}\nheader offset = 0\ndata type = 12\n"
        f"interleave = bsq\nbyte order = 0\nwavelength units = Nanometers\nwavelength = {{{wavelengths}}}\n"
        "data units = mW/sr/m2/um\n",
        encoding="ascii",
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class RepeatedCube(SpectralCube):
    """A cube repeated several times, one copy below the other."""

    cube: SpectralCube

    def blocks(self, rows: int) -> Iterator[Block]:
        """Yield blocks as `SpectralCube` does."""
        for above in range(0, self.shape[0], self.cube.shape[0]):
            for first, block in self.cube.blocks(rows):
                yield above + first, block


def repeated(path: Path, times: int) -> RepeatedCube:
    """Return the cube of a file, repeated."""
    cube = open_cube(path)
    rows, cols, bands = cube.shape
    shape = (times * rows, cols, bands)
    return RepeatedCube(
        name=cube.name, shape=shape, wavelength_nm=cube.wavelength_nm, quantity=cube.quantity, cube=cube
    )


def work_convert(path: str, output: str, times: int = 1) -> Reduction:
    """Convert the repeated cube to a scene file."""
    if times == 1:
        return convert_scene(path, output)
    return reduce_to_own(lambda store: reduce_cube(repeated(Path(path), times), store=store), Path(output))


def work_read(path: str) -> None:
    """Read the bytes of the cube into the same memory."""
    buffer = bytearray(32 << 20)
    with Path(path).with_suffix(".img").open("rb", buffering=0) as file:
        while file.readinto(buffer):
            pass


def convert_cube(quick: bool = False) -> Case:
    """A cube of 2 megapixels (quick: a quarter) and 200 bands to a scene file, against reading its file once."""
    rows = 50 if quick else 200
    with tempfile.TemporaryDirectory() as folder:
        source, target = f"{folder}/cube.hdr", f"{folder}/scene.h5"
        write_cube(Path(source), rows)
        work_read(source)
        ours, theirs = in_turn(lambda: work_convert(source, target), lambda: work_read(source), 1 if quick else 3)
        return Case(ours, theirs, peak_mb(work_convert, path=source, output=target), rows * COLS / 1e6)


def main() -> None:
    """Measure a large cube."""
    from photosite.studies.bench import convert_cube as here  # so that a fresh process finds the functions by this name

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=int, default=100, help="Size of the cube, in steps of 5.")
    parser.add_argument("--whole", action="store_true", help="Write the whole cube, 0.4 GB per megapixel.")
    parser.add_argument("--folder", help="Folder for the cube and the scene: 2 GB and 5 GB at 100 megapixels.")
    chosen = parser.parse_args()
    times = max(1, chosen.megapixels // 5)
    rows, times = (500 * times, 1) if chosen.whole else (500, times)
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        source, target = f"{folder}/cube.hdr", f"{folder}/scene.h5"
        write_cube(Path(source), rows)
        begun = time.perf_counter()
        for _ in range(times):
            work_read(source)
        read_s = time.perf_counter() - begun
        note = f"{folder}/note.json"
        peak = peak_mb(here.work_and_note, path=source, output=target, times=times, note=note)
        found = {
            "megapixels": times * rows * COLS / 1e6,
            "bands": BANDS,
            "cube_gb": times * Path(source).with_suffix(".img").stat().st_size / 1e9,
            "scene_gb": Path(target).stat().st_size / 1e9,
            **json.loads(Path(note).read_text(encoding="ascii")),
            "seconds_of_one_plain_read": read_s,
            "peak_mb": peak,
            "peak_mb_of_opening": peak_mb(here.work_open, path=target),
        }
    print(json.dumps(found, indent=1))


def work_and_note(path: str, output: str, times: int, note: str) -> None:
    """Convert, and write the result as JSON; runs in a fresh process."""
    begun = time.perf_counter()
    done = work_convert(path, output, times)
    result = {
        "components": done.components,
        "relative_error": done.scene.relative_error,
        "seconds": time.perf_counter() - begun,
    }
    Path(note).write_text(json.dumps(result), encoding="ascii")


def work_open(path: str) -> None:
    """Open the scene file and compute its mean luminance."""
    from photosite.scene.io.formats import read_scene

    read_scene(path).mean_luminance_cd_m2()


if __name__ == "__main__":
    main()
