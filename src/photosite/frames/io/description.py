"""The description that photosite writes into its frames: one line of JSON with everything but the pixels.

DNG has tags for levels, mosaic and color; TIFF and PNG have none. All three carry the same description, so that a
frame is read back exactly as it was saved.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.frames.io.frame_header import FrameHeader
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from

MARK = "photosite_frame"
"""The description's first key; its value is the version of the format."""


def describe_frame(frame: RawFrame) -> str:
    """Return the description of a frame: one line of ASCII JSON."""
    check_metadata(frame)
    content = {
        MARK: 1,
        "bits": frame.bits,
        "cfa": [list(row) for row in frame.cfa],
        "black_level_dn": frame.black_level_dn,
        "white_level_dn": frame.white_level_dn,
        "exposure_s": frame.exposure_s,
        "color_matrix": None if frame.color_matrix is None else np.asarray(frame.color_matrix).tolist(),
        "noise_profile": None if frame.noise_profile is None else np.asarray(frame.noise_profile).tolist(),
        "metadata": dict(frame.metadata),
    }
    try:
        return json.dumps(content, allow_nan=False, default=lambda number: number.item())
    except ValueError:
        raise InputError("the frame has numbers that are not finite and cannot be saved") from None


def check_metadata(frame: RawFrame) -> None:
    """Raise `InputError` for metadata that are not strings and finite numbers with names."""
    for name, value in frame.metadata.items():
        number = isinstance(value, int | float | np.integer | np.floating)
        if not isinstance(name, str) or not (isinstance(value, str) or (number and np.isfinite(value))):
            raise InputError(f"metadata[{name!r}]", value=value, expected="a string or a finite number")


def is_description(text: str) -> bool:
    """Return whether a text is photosite's description of a frame."""
    return text.startswith(f'{{"{MARK}"')


def parse_description(path: Path, text: str, rows: int, cols: int, stored_bits: int) -> FrameHeader | None:
    """Return the header of a description, or None if another program wrote the text."""
    if not is_description(text):
        return None
    try:
        content = json.loads(text)
        if content[MARK] != 1:
            raise FileError(path, MARK, value=content[MARK], expected="1, the format version that is supported")
        return FrameHeader(
            rows,
            cols,
            stored_bits,
            bits=int(content["bits"]),
            cfa=cfa_from(content["cfa"]),
            black_level_dn=float(content["black_level_dn"]),
            white_level_dn=float(content["white_level_dn"]),
            exposure_s=None if content["exposure_s"] is None else float(content["exposure_s"]),
            color_matrix=_table(content["color_matrix"]),
            noise_profile=_table(content["noise_profile"]),
            metadata=dict(content["metadata"]),
        )
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(path, f"the description of the frame is damaged ({error})") from None


def _table(rows: Any) -> NDArray[np.float64] | None:
    return None if rows is None else np.asarray(rows, dtype=np.float64)
