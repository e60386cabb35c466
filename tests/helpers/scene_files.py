"""What tests of scenes and their files share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photosite.errors import FileError
from photosite.scene.io.formats import open_cube, read_scene
from photosite.scene.scene import Scene


def error_of(path: Path, **options: Any) -> FileError:
    """The error of reading a file: of this file, and one line."""
    with pytest.raises(FileError) as caught:
        read_scene(path, **options)
    assert caught.value.path == str(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 420
    return caught.value


def whole(path: Path, **options: Any) -> np.ndarray:
    """(rows, cols, bands): the values of a cube, read in blocks of 4 rows."""
    return np.concatenate([block.copy() for _, block in open_cube(path, **options).blocks(4)])


def radiance(scene: Scene) -> np.ndarray:
    """(rows, cols, wavelengths) photons/s/sr/m2/nm."""
    return np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), scene.basis)
