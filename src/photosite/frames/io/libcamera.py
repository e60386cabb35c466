"""Noise profiles in libcamera tuning files of the Raspberry Pi (`rpi.noise`).

The file states the standard deviation as reference_constant + reference_slope sqrt(x), with x above black on a scale
of 16 bits at analog gain 1; both grow with sqrt(gain). The tuning tool fits this line, straight in sqrt(x), to
patches by least squares. Here the line is fitted to the known curve sqrt(K x + dark variance) over evenly spaced
sqrt(x) from black to white, and reading solves for the curve whose line the file holds.
"""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError
from photosite.files.small_files import finite_number, read_json_object, valid_content, write_json_object
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
    """Read the noise profile of a Raspberry Pi tuning file, at analog gain 1, on a scale of 16 bits."""
    file = Path(path)
    data = read_json_object(file)
    with valid_content(file, "a Raspberry Pi tuning file with rpi.noise"):
        algorithms: dict[str, Any] = {}
        for entry in data["algorithms"]:
            algorithms |= entry
        noise = algorithms["rpi.noise"]
        constant = finite_number(noise["reference_constant"], "reference_constant")
        slope = finite_number(noise["reference_slope"], "reference_slope")
        stated = algorithms.get("rpi.black_level", {}).get("black_level")
        black = 0.0 if stated is None else finite_number(stated, "black_level")
        valid = 0 <= constant <= _FULL_SCALE_DN16 and _LEAST_SLOPE <= slope <= _FULL_SCALE_DN16
        if not valid or not 0 <= black < _FULL_SCALE_DN16:
            values = f"reference_constant {constant:g}, reference_slope {slope:g}, black_level {black:g}"
            raise ValueError(f"{values} are out of range")
        span = _FULL_SCALE_DN16 - black
        dark_dn, gain = _curve(constant, slope, span)
    notes = [
        "levels, K and noise are on libcamera's scale of 16 bits (0 to 65535), whatever the converter's bit depth",
        "the curve whose straight line in sqrt(signal) the file holds, for photon noise and constant dark noise",
    ]
    if stated is None:
        notes.append("the file has no rpi.black_level: 0 is assumed")
    if constant == 0:
        notes.append("reference_constant is 0, which the tuning tool writes for any negative fit: no dark noise")
    return NoiseProfile(
        ("M",),
        (Measured(gain / span),),
        (Measured(dark_dn**2 / span**2),),
        1.0,
        black,
        float(_FULL_SCALE_DN16),
        notes=tuple(notes),
    )


def _line(dark_dn: float, gain: float, span: float) -> tuple[float, float]:
    """Fit sqrt(dark^2 + gain x) by constant + slope sqrt(x), for sqrt(x) evenly spaced from 0 to sqrt(span)."""
    root = math.sqrt(span) * _NODES
    slope, constant = np.polyfit(root, np.sqrt(dark_dn**2 + gain * root**2), 1)
    # Without dark noise, rounding can make the constant negative.
    return max(float(constant), 0.0), float(slope)


def _curve(constant: float, slope: float, span: float) -> tuple[float, float]:
    """Return the dark noise and gain whose `_line` has this constant and slope.

    With dark = r sqrt(gain span), the line's constant / slope / sqrt(span) depends on r alone and increases with it.
    """
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
    """Return whether a JSON file is a tuning file (it has "algorithms") and not darktable's ("noiseprofiles")."""
    file = Path(path)
    data = read_json_object(file)
    if "algorithms" in data:
        return True
    if "noiseprofiles" in data:
        return False
    problem = "the file is neither a darktable noise profile ('noiseprofiles') nor a tuning file ('algorithms')"
    raise FileError(file, problem)
