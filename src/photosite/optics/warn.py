"""Warnings about a lens, with the line of whoever asked: the first that is not photosite's own."""

from __future__ import annotations

import sys
import warnings
from types import FrameType

from photosite.errors import PhotositeWarning


def warn_user(message: str) -> None:
    """Give a `PhotositeWarning` for the line outside the package from which it was called, however deep within.

    Parameters
    ----------
    message
        What to say.

    Warns
    -----
    PhotositeWarning
        With that message.
    """
    level = 2
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == "photosite":
        frame = frame.f_back
        level += 1
    warnings.warn(message, PhotositeWarning, stacklevel=level)
