"""A frame set written as an EMVA 1288 descriptor with its frames: what the reference implementation reads."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Literal

from photosite.errors import InputError
from photosite.files.atomic import atomic_folder
from photosite.frames.frame_set import FrameSet, gain_settings_text
from photosite.frames.raw_frame import RawFrame

DESCRIPTOR_NAME = "EMVA1288_Data.txt"

EMVA_FRAMES_LOSS = (
    "lost: colour filter array, black level, gain setting, temperature and the sensor file; a descriptor has no words "
    "for them"
)

_NS_PER_S = 1e9


def write_descriptor(
    frames: FrameSet,
    folder: str | PathLike[str],
    *,
    suffix: Literal[".png", ".tif"] = ".png",
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a measurement as an EMVA 1288 descriptor and 16-bit frames, whole or not at all.

    Parameters
    ----------
    frames
        The measurement, of one gain setting; its light frames must state their photons per pixel.
    folder
        A folder that does not exist or is empty; gets EMVA1288_Data.txt and images/.
    suffix
        Format of the frames.
    progress
        Called with (frames written, frames to write).

    Returns
    -------
    Path
        The descriptor.

    Raises
    ------
    InputError
        If a light level does not state its photons, or there are several gain settings.
    FileError
        If the folder cannot be written, or a frame cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.frame_set import frame_set_from_arrays
    >>> dark = np.full((2, 3), 64, np.uint16)
    >>> frames = frame_set_from_arrays([("dark", 0.1, dark, 0.0), ("light", 0.1, 2 * dark, 500.0)], bits=12)
    >>> with tempfile.TemporaryDirectory() as place:
    ...     print(write_descriptor(frames, f"{place}/set").read_text())
    v 4.0
    n 12 3 2
    d 100000000.0
    i images\\d0_0000.png
    b 100000000.0 500.0
    i images\\b1_0000.png
    """
    if len(frames.gain_settings) > 1:
        raise InputError(
            f"{frames.source}: an EMVA descriptor is of one gain setting, and there are {gain_settings_text(frames)}; "
            f"take one with FrameSet.at_gain"
        )
    for group in frames.of_kind("light"):
        if group.photons_per_pixel is None:
            raise InputError(
                f"{frames.source}: an EMVA descriptor states the photons per pixel, and the light frames at "
                f"{group.exposure_s:g} s do not; say photons_per_pixel in the protocol"
            )
    lines = ["v 4.0", f"n {frames.bits} {frames.cols} {frames.rows}"]
    done = 0
    with atomic_folder(folder) as place:
        (place / "images").mkdir()
        for number, group in enumerate(frames.groups):
            exposure_ns = _nanoseconds(group.exposure_s)
            letter = "d" if group.kind == "dark" else "b"
            photons = "" if group.kind == "dark" else f" {group.photons_per_pixel!r}"
            lines.append(f"{letter} {exposure_ns!r}{photons}")
            for index, dn in enumerate(group):
                name = f"{letter}{number}_{index:04d}{suffix}"
                RawFrame(dn, bits=frames.bits, cfa=frames.cfa, exposure_s=group.exposure_s).save(
                    place / "images" / name
                )
                lines.append(f"i images\\{name}")
                done += 1
                if progress is not None:
                    progress(done, frames.frame_count)
        (place / DESCRIPTOR_NAME).write_text("\n".join(lines) + "\n", encoding="ascii")
    return Path(folder) / DESCRIPTOR_NAME


def _nanoseconds(exposure_s: float) -> float:
    """A number of nanoseconds that reads back as the same seconds to the last bit, where there is one."""
    exact = exposure_s * _NS_PER_S
    return next((ns for ns in (round(exact, 3), exact) if ns / _NS_PER_S == exposure_s), exact)
