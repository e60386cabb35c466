"""Noise profiles in libcamera tuning files of the Raspberry Pi (`rpi.noise`).

The file states the standard deviation as reference_constant + reference_slope sqrt(x), with x above black on a scale
of 16 bits at analog gain 1; both grow with sqrt(gain). The tuning tool fits this line, straight in sqrt(x), to
patches by least squares. Here the line is fitted to the known curve sqrt(K x + dark variance) over evenly spaced
sqrt(x) from black to white, and reading solves for the curve whose line the file holds.

libcamera reads tunings with a YAML parser, of which JSON is a part: comments and trailing commas are valid. Version 2
has a list of algorithms, version 1 has them at the top. An algorithm with `enabled: false` is not used. Numbers may be
texts. Checked against libcamera's `ipa/rpi/controller` (2026).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError
from photosite.files.small_files import (
    LARGEST_BYTES,
    finite_number,
    parse_json,
    read_small,
    valid_content,
    write_json_object,
)
from photosite.sensor.noise_profile import NOT_IN_PROFILE, NoiseProfile
from photosite.values.uncertain import Measured

_FULL_SCALE_DN16 = 65535
_LEAST_SLOPE = 1e-6
"""Far below that of any sensor, DN per root of a DN."""
_NODES = np.linspace(0.0, 1.0, 257)

LIBCAMERA_LOSS = (
    "the line in sqrt(signal) closest to the noise curve, for analog gain 1; not in the file: other gain settings, "
    f"channels, uncertainties, {NOT_IN_PROFILE}"
)


def write_libcamera(profile: NoiseProfile, path: str | PathLike[str], *, target: str = "bcm2835") -> None:
    """Write black level and noise as a part of a Raspberry Pi tuning file.

    Parameters
    ----------
    profile
        The profile at analog gain 1, with levels.
    path
        The file.
    target
        "bcm2835" (up to Pi 4) or "pisp" (Pi 5).

    Raises
    ------
    InputError
        If the profile has no levels, or its offset is negative.
    FileError
        If the file cannot be written.
    """
    if target not in ("bcm2835", "pisp"):
        raise InputError("target", value=target, expected="'bcm2835' or 'pisp'")
    gain_dn16, dark_dn16, black_dn16 = _on_16_bits(profile)
    constant, slope = _line(dark_dn16, gain_dn16, _FULL_SCALE_DN16 - black_dn16)
    content = {
        "version": 2.0,
        "target": target,
        "description": f"written by photosite; {LIBCAMERA_LOSS}",
        "algorithms": [
            {"rpi.black_level": {"black_level": black_dn16}},
            {"rpi.noise": {"reference_constant": constant, "reference_slope": slope}},
        ],
    }
    write_json_object(content, path)


def _on_16_bits(profile: NoiseProfile) -> tuple[float, float, float]:
    """Return gain (DN per electron), dark noise (DN) and black level on a scale of 16 bits."""
    gain, dark = profile.system_gain_dn_per_e.value, profile.dark_noise_dn.value
    scale = 65536.0 / 2.0 ** math.ceil(math.log2((profile.white_level_dn or 0.0) + 1.0))
    return gain * scale, dark * scale, (profile.black_level_dn or 0.0) * scale


def read_libcamera(path: str | PathLike[str]) -> NoiseProfile:
    """Read the noise profile of a Raspberry Pi tuning file, at analog gain 1, on a scale of 16 bits.

    Raises
    ------
    FileError
        If the file is not such a tuning, or `rpi.noise` is missing, disabled, or out of range.
    """
    file = Path(path)
    data = _tuning(file)
    with valid_content(file, "a Raspberry Pi tuning file with rpi.noise"):
        algorithms = _algorithms(data)
        noise = algorithms["rpi.noise"]
        constant, slope = (_number(noise[name], name) for name in ("reference_constant", "reference_slope"))
        black, black_note = _black_level(algorithms.get("rpi.black_level"))
        valid = abs(constant) <= _FULL_SCALE_DN16 and _LEAST_SLOPE <= slope <= _FULL_SCALE_DN16
        if not valid or not 0 <= black < _FULL_SCALE_DN16:
            values = f"reference_constant {constant:g}, reference_slope {slope:g}, black_level {black:g}"
            raise ValueError(f"{values} are out of range")
        span = _FULL_SCALE_DN16 - black
        dark_dn, gain = _curve(constant, slope, span)
    notes = [
        "levels, K and noise are on libcamera's scale of 16 bits (0 to 65535), whatever the converter's bit depth",
        "the curve whose straight line in sqrt(signal) the file holds, for photon noise and constant dark noise",
    ]
    if black_note:
        notes.append(black_note)
    if constant <= 0:
        why = "which the tuning tool writes for any negative fit" if constant == 0 else "which no dark noise gives"
        notes.append(f"reference_constant is {constant:g}, {why}: no dark noise")
    return NoiseProfile(
        ("M",),
        (Measured(gain / span),),
        (Measured(dark_dn**2 / span**2),),
        1.0,
        black,
        float(_FULL_SCALE_DN16),
        notes=tuple(notes),
    )


def _tuning(file: Path) -> Mapping[str, Any]:
    """Return the content of a JSON or YAML file that holds an object."""
    return _parsed(file, read_small(file, "a tuning file", LARGEST_BYTES))


@lru_cache(maxsize=1)
def _parsed(file: Path, content: bytes) -> Mapping[str, Any]:
    """Parse a file's content, once for `is_libcamera` and `read_libcamera`: YAML of published size takes seconds."""
    try:
        data = parse_json(content, file)
    except FileError as not_json:
        from photosite.files.yaml import parse_yaml

        try:
            data = parse_yaml(content.decode("utf-8"), file)
        except (FileError, UnicodeDecodeError):
            raise not_json from None
        if not isinstance(data, dict):
            raise not_json from None
    if not isinstance(data, dict):
        raise FileError(file, "the JSON file holds no object")
    return data


def _algorithms(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the enabled algorithms by name."""
    version = _number(data.get("version", 1.0), "version")
    if version >= 3.0:
        raise ValueError(f"version must be below 3, got {version:g}")
    listed = data["algorithms"] if version >= 2.0 or "algorithms" in data else [data]
    found: dict[str, Mapping[str, Any]] = {}
    for name, values in (item for entry in listed for item in entry.items()):
        if not name.startswith("rpi."):
            continue
        if name in found:
            raise ValueError(f"'{name}' is there twice")
        if str(values.get("enabled", True)).lower() == "false":
            if name == "rpi.noise":
                raise ValueError("rpi.noise is disabled (enabled: false)")
            continue
        found[name] = values
    return found


def _number(value: Any, name: str) -> float:
    """Return a finite number; libcamera reads texts such as "3.7" as numbers too."""
    try:
        return finite_number(float(value) if isinstance(value, str) else value, name)
    except ValueError:
        raise ValueError(f"'{name}' must be a finite number, got {str(value)[:40]}") from None


_DEFAULT_BLACK = 4096
"""libcamera's own default where rpi.black_level states none."""


def _black_level(stated: Mapping[str, Any] | None) -> tuple[float, str]:
    """Return the black level, and a note about an assumption; that of green where the channels differ."""
    if stated is None:
        return 0.0, "the file has no rpi.black_level: 0 is assumed"
    names = ("black_level", "black_level_r", "black_level_g", "black_level_b")
    levels = {name: _number(stated[name], name) for name in names if name in stated}
    common = levels.get("black_level", float(_DEFAULT_BLACK))
    red, green, blue = (levels.get(name, common) for name in names[1:])
    if not red == green == blue:
        return green, f"the black levels are {red:g}, {green:g} and {blue:g}: that of green is used"
    return green, "" if levels else f"rpi.black_level states no level: {_DEFAULT_BLACK} is assumed, as in libcamera"


def _line(dark_dn: float, gain: float, span: float) -> tuple[float, float]:
    """Fit sqrt(dark^2 + gain x) by constant + slope sqrt(x), for sqrt(x) evenly spaced from 0 to sqrt(span)."""
    root = math.sqrt(span) * _NODES
    slope, constant = np.polyfit(root, np.sqrt(dark_dn**2 + gain * root**2), 1)
    # Without dark noise, rounding can make the constant negative.
    return max(float(constant), 0.0), float(slope)


def _curve(constant: float, slope: float, span: float) -> tuple[float, float]:
    """Return the dark noise and gain whose `_line` has this constant and slope.

    With dark = r sqrt(gain span), the line's constant / slope / sqrt(span) depends on r alone and increases with it
    from 0. A negative constant has no such curve: the closest one without dark noise, sqrt(gain x), is returned.
    """
    if constant < 0:
        # Least squares of constant + slope u by g u over u from 0 to sqrt(span).
        root = slope + 1.5 * constant / math.sqrt(span)
        if root < _LEAST_SLOPE:
            raise ValueError(f"reference_constant {constant:g} makes the noise negative")
        return 0.0, root**2
    from scipy.optimize import brentq

    def ratio(r: float) -> float:
        c, s = _line(r, 1.0, 1.0)
        return c / s

    target = constant / slope / math.sqrt(span)
    if target == 0:
        r = 0.0
    else:
        top = 1.0
        while ratio(top) < target:
            top *= 2.0
        r = float(brentq(lambda x: ratio(x) - target, 0.0, top, xtol=1e-15, rtol=1e-14))
    _, unit = _line(r, 1.0, 1.0)
    gain = (slope / unit) ** 2
    return r * math.sqrt(gain * span), gain


def is_libcamera(path: str | PathLike[str]) -> bool:
    """Return whether a JSON or YAML file is a tuning file and not darktable's noise profile ("noiseprofiles").

    A tuning file has "algorithms", or in version 1 names such as "rpi.noise" at the top.
    """
    file = Path(path)
    data = _tuning(file)
    if "algorithms" in data or any(str(name).startswith("rpi.") for name in data):
        return True
    if "noiseprofiles" in data:
        return False
    problem = "the file is neither a darktable noise profile ('noiseprofiles') nor a tuning file ('algorithms')"
    raise FileError(file, problem)
