"""A frame's file as it was listed, before it is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from photosite.errors import FileError
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.io.frame_header import FrameLocation
from photosite.sensor.model import Sensor
from photosite.values.cfa import Cfa


@dataclass(frozen=True)
class FrameFile:
    """A frame's file, and the settings that its listing states.

    Parameters
    ----------
    path
        The file. Without `location` it stands for all frames in the file.
    settings
        Settings from the protocol, the descriptor or the caller. They override the file's metadata.
    listed_in, line
        The protocol or descriptor and its line, for messages; None for a file found in a folder.
    names
        Names that may state settings: the file's, then its folder's. Empty for files that a listing names.
    location
        Which frame of the file.
    """

    path: Path
    settings: FrameSettings
    listed_in: Path | None = None
    line: int | None = None
    names: tuple[str, ...] = ()
    location: FrameLocation | None = None

    @property
    def name(self) -> str:
        """Name of the frame in messages: its file, and which frame of it."""
        return f"{self.path}{self.location.label}" if self.location else str(self.path)

    def error(self, what: str, **fields: Any) -> FileError:
        """Return an error at the listing's line, or about the file if no listing names it."""
        if self.listed_in is None:
            return FileError(self.name, what, **fields)
        return FileError(self.listed_in, what, self.line, where=self.name, **fields)


@dataclass(frozen=True)
class SetProperties:
    """Properties that all frames of a set share, from a protocol, a descriptor or the caller; None if not stated."""

    bits: int | None = None
    cfa: Cfa | None = None
    shape: tuple[int, int] | None = None
    black_level_dn: float | None = None
    sensor: Sensor | None = None
