"""The exact frame of a state: computed, kept in a folder for views, and saved."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.app.kept_scenes import scene_of
from photosite.app.places import Places
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.state import CameraState, SensorState, prepared
from photosite.develop.develop import develop, save_picture
from photosite.errors import InputError
from photosite.frames.companding import decompanded
from photosite.frames.io.clean_mosaic import write_clean_mosaic
from photosite.frames.raw_frame import RawFrame


def exact_frame(
    state: CameraState, places: Places, folder: Path, progress: Callable[[int, int, str], object] | None = None
) -> dict[str, Any]:
    """Compute the exact frame of a state, keep it in a folder for views, and return its facts."""
    found = prepared(state, places)
    scene = scene_of(found)
    with recorded_warnings() as texts:
        rate = kept_mean(state, folder)
        if rate is None:
            rate = found.mean_image(scene, progress)
            _keep(_mean_file(folder, state), rate)
        mean = found.exposed(rate)
        if progress is not None:
            progress(0, 1, "noise")
        raw = found.frame(mean, scene)
        dn = raw.dn if state.capture.noise else found.camera.clean_dn(mean)
    _keep(_frame_file(folder, state), np.asarray(dn))
    return {
        "frame": state.frame_key,
        "rows": raw.shape[0],
        "cols": raw.shape[1],
        "mean_dn": float(dn.mean()),
        "max_dn": float(dn.max()),
        "saturated_fraction": float((dn >= raw.white_level_dn).mean()),
        "suggested_exposure_s": found.camera.auto_exposure_s(mean / state.capture.exposure_s) if rate.any() else None,
        "warnings": texts,
    }


def prepare_frames() -> None:
    """Import and compile what exact frames need."""
    small = SensorState(changes={"rows": 64, "cols": 96})
    with tempfile.TemporaryDirectory() as folder:
        exact_frame(CameraState(sensor=small), Places(), Path(folder))


def saved_frame(
    state: CameraState,
    places: Places,
    folder: Path,
    suffix: str,
    progress: Callable[[int, int, str], object] | None = None,
) -> bytes:
    """Return the exact frame as a raw file, .dng or .tif, or its developed picture, .png.

    The noise-free frame is a .tif of 32-bit floats, as that of `photosite simulate --clean`.
    """
    if suffix == ".dng" and not state.capture.noise:
        raise InputError("a noise-free frame is not whole numbers", hint="Save it as TIFF")
    exact_frame(state, places, folder, progress)
    found, rate = prepared(state, places), kept_mean(state, folder)
    if rate is None:
        raise InputError("the frame is not kept any more", hint="Wait for the exact frame")
    mean = found.exposed(rate)
    raw = found.frame(mean, scene_of(found))
    clean = None if state.capture.noise else found.camera.clean_dn(mean)
    with tempfile.TemporaryDirectory(dir=folder.parent) as temporary:
        path = Path(temporary, f"shot{suffix}")
        if suffix == ".png":
            save_picture(develop(raw if clean is None else with_numbers(raw, clean), exposure=state.brightness), path)
        elif clean is not None:
            write_clean_mosaic(clean, raw, path)
        else:
            raw.save(path)
        return path.read_bytes()


def kept_mean(state: CameraState, folder: Path) -> NDArray[Any] | None:
    """Return the exact mean electrons per second from light, (rows, cols), if they were computed and are still kept."""
    return _kept(_mean_file(folder, state))


def kept_frame(state: CameraState, folder: Path) -> NDArray[Any] | None:
    """Return the digital numbers of the exact frame, (rows, cols), if it was computed and is still kept."""
    return _kept(_frame_file(folder, state))


def _mean_file(folder: Path, state: CameraState) -> Path:
    return folder / f"mean-{state.mean_key}.npy"


def _frame_file(folder: Path, state: CameraState) -> Path:
    return folder / f"frame-{state.frame_key}.npy"


def _kept(path: Path) -> NDArray[Any] | None:
    try:
        found: NDArray[Any] = np.load(path, mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return None
    os.utime(path)  # the files used least recently are deleted first
    return found


def _keep(path: Path, array: NDArray[Any]) -> None:
    temporary = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            np.save(file, array)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def with_numbers(raw: RawFrame, dn: NDArray[Any]) -> RawFrame:
    """Return a raw frame with other digital numbers, rounded to 16 bits where they are no whole numbers."""
    kind = raw.dn.dtype
    if dn.dtype.kind == "f" and raw.bits < 16 and decompanded(raw) is raw:
        scale = 1 << (16 - raw.bits)
        fine = np.rint(np.clip(dn, 0, (1 << raw.bits) - 1) * np.float32(scale)).astype(np.uint16)
        assert raw.white_level_dn is not None
        black_dn, white_dn = raw.black_level_dn * scale, raw.white_level_dn * scale
        return replace(raw, dn=fine, bits=16, black_level_dn=black_dn, white_level_dn=white_dn, captures={})
    dn = np.clip(dn, 0, None)
    return replace(raw, dn=np.rint(dn).astype(kind) if dn.dtype != kind else np.ascontiguousarray(dn), captures={})
