"""Scenes into ISET's files: basis form in MATLAB version 5, photons of every sample in version 7.3."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import InputError
from photosite.files.atomic import atomic_path
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene

_MOST_BYTES = 1 << 30
"""Of one variable of version 5, which ends at 2 GiB and is built in memory."""
_CHUNK_BYTES = 1 << 20


def write_basis_form(scene: Scene, path: Path) -> None:
    """mcCOEF and basis, as ISETCam's ieSaveMultiSpectralImage.m writes them: the scene itself, without loss.

    Without `illuminant` where the scene's light is not known; without `fov` where its width is not.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If the weights are too large for this version.
    """
    from scipy.io import savemat

    if scene.weights.nbytes > _MOST_BYTES:
        raise InputError(
            f"the scene's weights take {scene.weights.nbytes / 1e9:.1f} GB, too much for MATLAB's version 5; "
            "write version 7.3 (version='7.3') or photosite's own .h5"
        )
    content: dict[str, Any] = {
        "mcCOEF": np.moveaxis(scene.weights, 0, 2),
        "basis": {"basis": scene.basis.T, "wave": scene.wavelength_nm[:, None]},
        "comment": "written by photosite",
        **_about(scene),
    }
    if scene.reflectance is not None:
        content["illuminant"] = {
            "type": "illuminant",
            "name": scene.name,
            "data": {"photons": scene.light()[:, None]},
            "spectrum": {"wave": scene.wavelength_nm[:, None]},
        }
    with atomic_path(path) as temporary:
        savemat(temporary, content, appendmat=False, do_compression=True)


def _about(scene: Scene) -> dict[str, Any]:
    about: dict[str, Any] = {"dist": scene.distance_m, "name": scene.name}
    if scene.width_m is not None:
        about["fov"] = math.degrees(2 * math.atan(scene.width_m / 2 / scene.distance_m))
    return about


def write_photons_form(scene: Scene, path: Path) -> None:
    """photons and wave, of version 7.3: HDF5 behind 512 bytes, first axes last. In single precision, block by block.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    import h5py

    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    step = max(1, min(rows, _CHUNK_BYTES // (4 * cols * bands)))
    with atomic_path(path) as temporary:
        with h5py.File(temporary, "w", userblock_size=512) as file:
            data = file.create_dataset("photons", (bands, cols, rows), "<f4", chunks=(bands, cols, step))
            data.attrs["MATLAB_class"] = np.bytes_(b"single")
            for first, block in cube.blocks(step):
                data[:, :, first : first + len(block)] = block.transpose(2, 1, 0).astype(np.float32)
            _put(file, "wave", scene.wavelength_nm[None, :])
            for name, value in _about(scene).items():
                _put(file, name, value)
            if cube.light is not None:
                _put(file, "illuminant/type", "illuminant")
                _put(file, "illuminant/data/photons", cube.light[None, :])
                _put(file, "illuminant/spectrum/wave", scene.wavelength_nm[None, :])
        with temporary.open("r+b") as raw:
            head = f"MATLAB 7.3 MAT-file, Platform: photosite, Created on: {time.asctime()} HDF5 schema 1.00 ."
            raw.write(head.encode().ljust(116) + bytes(8) + b"\x00\x02IM")


def _put(file: Any, name: str, value: Any) -> None:
    if isinstance(value, str):
        codes = np.array([[ord(letter) for letter in value]], np.uint16).T if value else np.zeros((1, 1), np.uint16)
        data, kind = file.create_dataset(name, data=codes), b"char"
        data.attrs["MATLAB_int_decode"] = np.int32(2)
    else:
        data, kind = file.create_dataset(name, data=np.atleast_2d(np.asarray(value, np.float64))), b"double"
    data.attrs["MATLAB_class"] = np.bytes_(kind)
