"""Units of spectral images as files state them and users write them."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.scene.options import ReadOptions

Quantity = Literal["photon radiance", "energy radiance", "reflectance", "relative"]
"""In photons/s/sr/m2/nm; in W/sr/m2/nm; as a fraction of the light; as energy radiance up to an unknown factor."""

_PREFIX = {"": 1.0, "m": 1e-3, "u": 1e-6, "n": 1e-9, "k": 1e3, "milli": 1e-3, "micro": 1e-6, "nano": 1e-9}
_SECONDS, _STERADIANS = ("s", "sec", "second"), ("sr", "steradian", "str", "ster")
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_NANOMETRES = {"nm": 1.0, "um": 1e3, "micron": 1e3, "microns": 1e3, "m": 1e9}
_PHOTONS = ("photon", "photons", "quanta", "ph", "q")
_PLAIN = re.compile(r"(?:spectral )?(radiance|reflectance) ?[\[(](.+)[\])]", re.IGNORECASE)
"""A quantity followed by its unit in brackets."""
_SCALED = re.compile(r"reflectance ?/ ?(\d+(?:\.\d+)?(?:e\+?\d+)?)", re.IGNORECASE)
_BRIGHT, _BRIGHT_FRACTION, _BRIGHTEST = 2.0, 0.01, 10.0
"""Reflectance factors above 2 are glints, fluorescence or errors, rarely 1 % of a picture, rarely above 10."""
_OTHER_SCALE, _NO_REFLECTANCE = 0.25, 1000.0
"""With that fraction above 2, the scale is another. No glint reaches 1000, and one would dominate the scene."""
_LONGEST = 200
_LONGEST_STATED = 80
_KNOWN = "photons/s/sr/m2/nm, W/sr/m2/nm, uW/sr/cm2/nm, reflectance, percent or relative"


@dataclass(frozen=True)
class Units:
    """Quantity of a file's values, and the factor from a value to the unit of the quantity.

    Examples
    --------
    >>> parse_units("uW cm-2 sr-1 nm-1")
    Units(quantity='energy radiance', scale=0.01)
    >>> parse_units("photons/(s m^2 sr nm)").quantity
    'photon radiance'
    """

    quantity: Quantity
    scale: float = 1.0


def parse_units(text: str) -> Units:
    """Return the units that a text names.

    Parameters
    ----------
    text
        "reflectance", "percent", "reflectance/10000" (10000 is a perfect white), "relative", "photons", or a radiance,
        such as "Radiance (W/m2/sr/um)": a power or photons per second, per sr, per area and per wavelength, in any
        order, with / or with negative exponents.

    Raises
    ------
    InputError
        If a part is missing or unknown.
    """
    plain = " ".join(text.replace("µ", "u").replace("μ", "u").split()).strip()
    if len(plain) > _LONGEST:
        raise _unknown(f"{plain[:40]}...", f"more than {_LONGEST} characters")
    match plain.lower():
        case "photons" | "photon radiance" | "quanta":
            return Units("photon radiance")
        case "reflectance" | "reflectivity" | "fraction":
            return Units("reflectance")
        case "percent" | "%" | "percent reflectance" | "reflectance percent" | "reflectance (%)" | "% reflectance":
            return Units("reflectance", 0.01)
        case "relative":
            return Units("relative")
    if (scaled := _SCALED.fullmatch(plain)) and 1e-30 < (white := float(scaled[1])) < 1e30:
        return Units("reflectance", 1 / white)
    if quantity := _PLAIN.fullmatch(plain):
        units = parse_units(quantity[2])
        if units.quantity.endswith(quantity[1].lower()):
            return units
    scale, found = 1.0, set()
    for name, power in _factors(plain):
        kind, factor = _meaning(name, power, text)
        if kind in found:
            raise _unknown(text, f"'{name}' repeats the {kind}")
        found.add(kind)
        scale *= factor
    missing = {"steradian", "area", "wavelength"} - found
    if "photons" in found:
        missing |= {"second"} - found
    elif "power" not in found:
        missing.add("power or photons")
    if missing:
        raise _unknown(text, f"{' and '.join(sorted(missing))} missing")
    return Units("photon radiance" if "photons" in found else "energy radiance", scale)


def _factors(text: str) -> list[tuple[str, int]]:
    """(unit, exponent) of a product, `a/b/c`, `a/(b c)` or `a b-1 c-1`."""
    found: list[tuple[str, int]] = []
    sign, inside = 1, False
    for token in re.findall(r"[A-Za-z]+(?:\^?-?\d+)?|\^?[-\d]+|[()/]|\S", text.replace("**", "^").replace("·", " ")):
        if token == "/":
            sign = -1
        elif token in "()*.":
            inside = token == "(" or (inside and token in "*.")
            sign = 1 if token == ")" else sign
        elif (match := re.fullmatch(r"([A-Za-z]+)\^?(-?\d+)?", token)) is not None:
            found.append((match[1], sign * int(match[2] or 1)))
            sign = sign if inside else 1
        elif token != "1":
            raise _unknown(text, f"'{token}' is not a unit")
    return found


def _meaning(name: str, power: int, text: str) -> tuple[str, float]:
    low = name.lower()
    if low in _PHOTONS and power == 1:
        return "photons", 1.0
    if power == 1 and (match := re.fullmatch(r"(m|u|n|k|milli|micro|nano|)(W|w|watts?|Watts?)", name)):
        return "power", _PREFIX[match[1]]
    if low in _SECONDS and power == -1:
        return "second", 1.0
    if low in _STERADIANS and power == -1:
        return "steradian", 1.0
    if low in _METRES and power == -2:
        return "area", _METRES[low] ** -2
    if low in _NANOMETRES and power == -1:
        return "wavelength", 1 / _NANOMETRES[low]
    if power > 0 and low in (*_METRES, *_NANOMETRES, *_SECONDS, *_STERADIANS) and "/" in text:
        raise _unknown(text, f"'{name}' could be in the numerator or the denominator; write W/m2/sr/nm or W/(m2 sr nm)")
    raise _unknown(text, f"'{name}{'' if power == 1 else power}' does not fit")


def _unknown(text: str, why: str) -> InputError:
    return InputError("units", value=text, expected=f"known units ({why})", hint=f"Known are {_KNOWN}")


def bright_count(values: NDArray[np.float64]) -> int:
    """Return how many reflectances are above those of surfaces."""
    return int(np.count_nonzero(values > _BRIGHT))


def check_reflectances(name: str | PathLike[str], largest: float, bright: int, count: int) -> None:
    """Reject reflectances on another scale (more than a quarter above 2) and outliers (above 1000); warn above 10.

    Parameters
    ----------
    name
        The file, for the message.
    largest
        Largest value.
    bright, count
        Number of values above 2 (`bright_count`), and of all values. A fraction above 1 % is a warning, too.
    """
    held = f"holds reflectances up to {largest:g}, where a perfect white has 1"
    if bright > _OTHER_SCALE * count:
        hint = "Pass the scale, {units} or reflectance/10000, or 'relative' if they are not reflectances"
        raise FileError(name, held, hint=hint, arguments={"units": "percent"})
    if largest > _NO_REFLECTANCE:
        hint = "Correct the outliers, or omit their bands: {band_range_nm}"
        raise FileError(name, held, hint=hint, arguments={"band_range_nm": (400, 780)})
    if largest > _BRIGHTEST or bright > _BRIGHT_FRACTION * count:
        what = f"{held}; {bright} of {count} values are above {_BRIGHT:g}: glints, fluorescence or errors"
        hint = "They are used as they are; correct the file if they are errors"
        warnings.warn(PhotositeWarning(what, where=str(name), hint=hint), stacklevel=2)


def file_units(path: Path, options: ReadOptions, stated: Any) -> Units:
    """Return the units of a file's values; the caller's override those that the file states, if any."""
    if options.units is not None:
        return override_units(path, options.units, stated)
    if stated is None:
        or_else = ", 'photons/s/sr/m2/nm', 'reflectance' or 'relative'"
        options.require(path, "does not state the units of its values", or_else, units="W/sr/m2/nm")
    try:
        return parse_units(str(stated)[:_LONGEST_STATED])
    except InputError as error:
        raise error.in_file(path) from None


def override_units(path: Path, given: str, stated: Any, own: Units | None = None) -> Units:
    """Return the caller's units; warn where the file states others: `own`, or else those of the text `stated`."""
    units = parse_units(given)
    if own is None:
        try:
            own = None if stated is None else parse_units(str(stated)[:_LONGEST_STATED])
        except InputError:  # unknown units cannot contradict
            own = None
    if own is not None and (own.quantity != units.quantity or not math.isclose(own.scale, units.scale, rel_tol=1e-9)):
        what = f"the file states the units '{stated!s:.40}'; units='{given}' overrides them"
        warnings.warn(PhotositeWarning(what, where=str(path)), stacklevel=2)
    return units
