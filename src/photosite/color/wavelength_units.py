"""Units of wavelengths as files write them, in headings and in fields of their own."""

from __future__ import annotations

import re
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

NANOMETRES_PER = MappingProxyType({"nm": 1.0, "um": 1e3, "m": 1e9, "angstrom": 0.1, "mm": 1e6})
"""Nanometers in each unit."""

_UNIT_NAMES = {
    **dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre", "nanometres"), "nm"),
    **dict.fromkeys(("um", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"), "um"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("angstrom", "angstroms", "a", "å"), "angstrom"),
    **dict.fromkeys(("mm", "millimeter", "millimeters"), "mm"),
}
_HEADING = re.compile(r"(?:wave ?lengths?|wave|wvl|wl|lambda|λ)(?: (?:in )?(\S+))?|(\S+)")
_CAMERA_NM = 200.0, 2600.0
"""Wavelengths of cameras; numbers in this range are nanometers, and a thousandth of it micrometers."""


def unit_name(text: str) -> str | None:
    """Return a unit of `NANOMETRES_PER` by one of its names; None if it is unknown.

    Examples
    --------
    >>> unit_name("Micrometers"), unit_name("µm"), unit_name("GHz")
    ('um', 'um', None)
    """
    return _UNIT_NAMES.get(text.strip().lower().replace("µ", "u").replace("μ", "u"))


def heading_unit(heading: str) -> tuple[bool, str | None]:
    """Return whether a column's heading is that of wavelengths, and the unit that it states.

    Examples
    --------
    >>> heading_unit("Wavelength [µm]"), heading_unit("lambda"), heading_unit("nm"), heading_unit("red")
    ((True, 'um'), (True, None), (True, 'nm'), (False, None))
    """
    match = _HEADING.fullmatch(" ".join(re.split(r"[\s_,()\[\]/.-]+", heading.lower())).strip())
    if match is None:
        return False, None
    if match[2] is not None:  # the unit alone
        unit = unit_name(match[2]) if match[2] in ("nm", "um", "µm", "μm") else None
        return unit is not None, unit
    unit = None if match[1] is None else unit_name(match[1])
    return match[1] is None or unit is not None, unit


def camera_unit(values: NDArray[np.float64]) -> str | None:
    """Return the only unit that puts wavelengths into the range of cameras: nm or um, or None.

    Examples
    --------
    >>> camera_unit(np.array([0.4, 0.7])), camera_unit(np.array([400.0, 700.0])), camera_unit(np.array([1.0, 31.0]))
    ('um', 'nm', None)
    """
    low, high = _CAMERA_NM
    for unit in ("nm", "um"):
        nm = values * NANOMETRES_PER[unit]
        if nm.size and np.isfinite(nm).all() and nm.min() >= low and nm.max() <= high:
            return unit
    return None
