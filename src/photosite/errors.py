"""The exceptions, and which one applies when.

- `InputError`: a value handed to a function cannot be: an exposure of zero, an unknown preset, a spectrum whose
  lengths differ. The caller's argument is at fault. It is also a `ValueError`.
- `FileError`: a file is missing, truncated, of the wrong kind, or says something that cannot be. It carries the
  path and, where there is one, the line.
- `CalibrationError`: the files read well and the call was right, but these frames cannot support what was asked:
  clipped blacks, one exposure only, frames of mixed size.
- `PhotositeWarning`: the result stands, but its reader should know something: light outside the scene's
  wavelengths, a flat field that never reached saturation.

Every message names what is wrong and where, what was expected, what came, and how to mend it, in one line.
The command line prints that line and exits with 2. Anything else that escapes is a bug of photosite's.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from os import PathLike, fspath


class PhotositeError(Exception):
    """What every exception that photosite raises on purpose is."""


class InputError(PhotositeError, ValueError):
    """A value handed to a function cannot be."""


class FileError(PhotositeError):
    """A file cannot be read, or says what cannot be.

    Parameters
    ----------
    path
        The file.
    message
        What is wrong with it, and how to mend it.
    line
        The line it is on, counted from 1, where there is one.
    """

    def __init__(self, path: str | PathLike[str], message: str, line: int | None = None) -> None:
        self.path = fspath(path)
        self.line = line
        self.message = message
        place = self.path if line is None else f"{self.path}:{line}"
        super().__init__(f"{place}: {message}")


class CalibrationError(PhotositeError):
    """These frames cannot support what was asked of them."""


class PhotositeWarning(UserWarning):
    """The result stands, but its reader should know something."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of an error line about an unknown name: the likeliest one meant, or all there are.

    Examples
    --------
    >>> did_you_mean("fil_factor", ["fill_factor", "width_um"])
    "did you mean 'fill_factor'?"
    >>> did_you_mean("zzz", ["fill_factor", "width_um"])
    'known are: fill_factor, width_um'
    """
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    return f"did you mean '{close[0]}'?" if close else "known are: " + ", ".join(names)
