"""Units of a file's values: stated by the file, or given by the caller."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.scene.options import ReadOptions
from photosite.scene.units import Units, parse_units

_LONGEST = 80


def file_units(path: Path, options: ReadOptions, stated: Any) -> Units:
    """Return the units of a file's values; the caller's override the file's.

    Parameters
    ----------
    path
        The file.
    options
        The caller's options.
    stated
        The file's statement, or None.

    Raises
    ------
    FileError
        If neither gives units, or the file's are unknown.
    """
    if options.units is not None:
        return override_units(path, options.units, stated)
    if stated is None:
        raise FileError(
            path,
            "does not state the units of its values",
            hint="Pass {units}, 'photons/s/sr/m2/nm', 'reflectance' or 'relative'",
            arguments={"units": "W/sr/m2/nm"},
        )
    try:
        return parse_units(str(stated)[:_LONGEST])
    except InputError as error:
        raise error.in_file(path) from None


def override_units(path: Path, given: str, stated: Any, own: Units | None = None) -> Units:
    """Return the caller's units; warn where the file states others.

    Parameters
    ----------
    path
        The file.
    given
        The caller's units.
    stated
        The file's statement, for the warning; None where there is none.
    own
        The file's units, where `stated` alone does not tell them.

    Raises
    ------
    InputError
        If the caller's units are unknown.
    """
    units = parse_units(given)
    if own is None:
        try:
            own = None if stated is None else parse_units(str(stated)[:_LONGEST])
        except InputError:  # unknown units cannot contradict
            own = None
    if own is not None and (own.quantity != units.quantity or not math.isclose(own.scale, units.scale, rel_tol=1e-9)):
        what = f"the file states the units '{stated!s:.40}'; units='{given}' overrides them"
        warnings.warn(PhotositeWarning(what, where=str(path)), stacklevel=2)
    return units
