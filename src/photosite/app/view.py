"""A view for the page: its header, the mean electrons, the digital numbers and the developed picture."""

from __future__ import annotations

import json
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.app.places import Places
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.state import CameraState, prepared
from photosite.app.view_header import view_header
from photosite.app.view_pixels import View, view_pixels
from photosite.develop.develop import develop_rgba
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame


def view_bytes(state: CameraState, places: Places, view: View, folder: Path) -> bytes:
    """Return a view for the page.

    Returns
    -------
    bytes
        Length of the header as 4 bytes, little endian; the header, JSON in UTF-8, padded with spaces to a multiple of
        4; where `view.mean`, (rows, cols) mean electrons from light, float32; where `view.dn`, (rows, cols) digital
        numbers, float32 or uint16 as the header's `dn_type` says; where its `developed` is true, (rows, cols, 4) bytes
        of the developed picture: red, green, blue and 255.
    """
    started = time.perf_counter()
    with recorded_warnings() as texts:
        found = prepared(state, places)
        shown = view_pixels(found, view, folder)
        picture = b""
        notes = [*shown.notes]
        if view.developed:
            try:
                picture = _developed(shown.raw, state.brightness).tobytes()
            except InputError as error:
                notes.append(f"not developed: {error}")
    notes += texts
    header = view_header(found, shown, view, folder) | {"notes": notes, "developed": bool(picture), "mean": view.mean}
    dn = shown.dn if shown.dn.dtype == np.uint16 else shown.dn.astype(np.float32)
    header["dn_type"] = str(dn.dtype) if view.dn else None
    header["seconds"] = time.perf_counter() - started
    text = json.dumps(header, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    mean = shown.mean_e.tobytes() if view.mean else b""
    numbers = dn.tobytes() if view.dn else b""
    return b"".join((len(text).to_bytes(4, "little"), text, mean, numbers, picture))


_MARGIN = 12
"""Rows, whole tiles of most arrays, that parts of a picture overlap by when they are developed."""


def _developed(raw: RawFrame, brightness: float) -> NDArray[np.uint8]:
    """Return `develop` as 8-bit RGBA, in two threads where each pixel depends on its neighbors alone."""

    def part(frame: RawFrame) -> NDArray[np.uint8]:
        return develop_rgba(frame, brightness)

    rows, tile = raw.dn.shape[0], len(raw.cfa)
    local = raw.as_shot_neutral is not None or len(raw.channels) == 1
    if not local or rows < 8 * _MARGIN or _MARGIN % tile:
        return part(raw)
    middle = rows // 2 // tile * tile
    halves = [
        replace(raw, dn=raw.dn[span], captures={}) for span in (slice(middle + _MARGIN), slice(middle - _MARGIN, None))
    ]
    with ThreadPoolExecutor(2) as threads:
        top, bottom = threads.map(part, halves)
    return np.concatenate([top[:middle], bottom[_MARGIN:]])


def prepare_views() -> None:
    """Import and compile what views need, and make the scene of the first one."""
    with tempfile.TemporaryDirectory() as folder:
        view_bytes(CameraState(), Places(), View(height=64, width=96), Path(folder))
