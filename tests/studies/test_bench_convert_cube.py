"""The benchmark of a spectral cube: repeated cubes, and memory that does not grow with the cube."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from photosite.scene.io.formats import open_cube, read_scene
from photosite.studies.bench.convert_cube import BANDS, repeated, work_convert
from photosite.studies.bench.convert_cube import write_cube as write
from photosite.studies.bench.timing import peak_mb


@pytest.mark.slow
def test_memory_does_not_grow_with_the_cube(tmp_path: Path) -> None:
    source, target = tmp_path / "cube.hdr", tmp_path / "scene.h5"
    write(source, 40, cols=1000)
    # Threads of the linear algebra may take a buffer of 30 MB each; the cube grows by much more than that.
    grown_mb = 14 * 40 * 1000 * BANDS * 2 / 1e6  # as 2-byte integers; in double precision 4 times as much
    few, many = (peak_mb(work_convert, path=str(source), output=str(target), times=times) for times in (2, 16))
    assert many - few < grown_mb / 3
    scene = read_scene(target)
    assert scene.shape == (640, 1000)
    assert scene.relative_error < 1e-3
    assert np.array_equal(scene.weights[:, :40], scene.weights[:, 600:])


def test_blocks_of_a_repeated_cube(tmp_path: Path) -> None:
    write(tmp_path / "cube.hdr", 12, cols=30)
    once = np.concatenate([block.copy() for _, block in open_cube(tmp_path / "cube.hdr").blocks(5)])
    blocks = [(first, block.copy()) for first, block in repeated(tmp_path / "cube.hdr", 2).blocks(5)]
    assert [first for first, _ in blocks] == [0, 5, 10, 12, 17, 22]
    assert np.array_equal(np.concatenate([block for _, block in blocks]), np.tile(once, (2, 1, 1)))
