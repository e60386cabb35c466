"""Noise profiles in the files of raw developers and camera stacks: darktable's and libcamera's JSON.

Both hold two numbers for a setting and say less than they seem to; what each loses is said where it is written
(`photosite.sensor.noise_profile.LOST`) and in the file's own note. DNG's tag is in `photosite.frames.io.dng_profile`.

darktable (`data/noiseprofiles.json` of its sources). Variance a x + b, in its pipeline's own scale: its profiling tool
takes the noise from the diagonal details of a 2 x 2 Haar transform of the demosaiced picture. White noise keeps 1/4 of
its variance there, and Bayer green 1/16, where each missing one is the mean of its two neighbours on a line. Its
denoiser goes by green's numbers and the white balance, so all three are green's. The file has no word for the share;
photosite's own say it in the camera's comment, from where it is read back.

libcamera, Raspberry Pi (`rpi.noise` of a tuning file). Standard deviation reference_constant + reference_slope
sqrt(x), x above black on a scale of 16 bits at analogue gain 1; both grow with sqrt(gain). The tuning tool fits that
line, straight in sqrt(x), to patches by least squares. Here it is fitted to the known curve sqrt(K x + dark variance)
over evenly spaced sqrt(x) from black to white, and reading solves for the curve whose line the file holds.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.atomic import atomic_path
from photosite.sensor.noise_profile import LOST, NoiseProfile
from photosite.values.measured import Measured

HAAR_SHARE = {"mosaic": 1 / 16, "mono": 1 / 4}
"""Share of a raw pixel's noise variance that is in darktable's numbers."""

_OWN_COMMENT = "written by photosite: a and b are {share:g} of the raw noise variance ({chip})"
_OWN_SHARE = re.compile(r"written by photosite: a and b are ([0-9.]+) of the raw noise variance \(")
_CHIPS = {"mosaic": "colour filter mosaic", "mono": "no colour filters"}

_FULL_SCALE_DN16 = 65535
_NODES = np.linspace(0.0, 1.0, 257)

DARKTABLE_LOSS = (
    f"a and b are {HAAR_SHARE['mosaic']:g} (mono: {HAAR_SHARE['mono']:g}) of the raw slope and offset, for darktable's "
    f"own measure of noise; green stands for all channels; lost: black and white level, uncertainties, {LOST}"
)
LIBCAMERA_LOSS = (
    f"the line in sqrt(signal) nearest to the true curve, for analogue gain 1; lost: other gain settings, channels, "
    f"uncertainties, {LOST}"
)


def write_darktable(
    profiles: Sequence[NoiseProfile], path: str | PathLike[str], *, maker: str = "photosite", model: str | None = None
) -> None:
    """Write a darktable-style noise profile: JSON, one entry for each gain setting.

    Parameters
    ----------
    profiles
        One for each setting; each must know its setting, which darktable takes for ISO.
    path
        The file.
    maker, model
        The camera as its raw files name it, by which darktable finds the profile; the profile's own name if None.

    Raises
    ------
    InputError
        If there are none, one does not say its gain setting, or some are of a mosaic and some are not.
    FileError
        If the file cannot be written.
    """
    if not profiles:
        raise InputError("a noise profile file needs a profile, and there is none")
    name = model or profiles[0].camera or "unnamed camera"
    chips = {"mono" if len(profile.channels) == 1 else "mosaic" for profile in profiles}
    if len(chips) > 1:
        raise InputError("the noise profiles of one camera are all of a colour filter mosaic, or none is")
    (chip,) = chips
    share = HAAR_SHARE[chip]
    entries = []
    for profile in profiles:
        if profile.gain_setting is None:
            raise InputError(
                "darktable looks profiles up by ISO, and this one does not say its gain setting; state it with "
                "--gain-setting ISO (in Python: gain_setting)"
            )
        green = _green(profile)
        iso = profile.gain_setting
        entries.append(
            {
                "name": f"{name} iso {iso:g}",
                "iso": int(iso) if iso == int(iso) else iso,
                "a": [share * profile.slope[green].value] * 3,
                "b": [share * profile.offset[green].value] * 3,
            }
        )
    comment = f"{_OWN_COMMENT.format(share=share, chip=_CHIPS[chip])}; {DARKTABLE_LOSS}"
    models = [{"comment": comment, "model": name, "profiles": entries}]
    _write_json({"version": 0, "noiseprofiles": [{"maker": maker, "models": models}]}, path)


def read_darktable(
    path: str | PathLike[str], model: str | None = None, *, mono: bool = False
) -> tuple[NoiseProfile, ...]:
    """The noise profiles of one camera in a darktable-style file, by rising ISO.

    Parameters
    ----------
    path
        The file.
    model
        Which camera, as the file names it; None if it holds one only.
    mono
        Whether the camera has no colour filters. The file does not say, but where photosite wrote it.

    Returns
    -------
    tuple of NoiseProfile
        Without levels, which the file does not hold. Entries marked "skip" are left out.

    Raises
    ------
    FileError
        If the file is no such profile, or a number in it cannot be.
    InputError
        If the model is not in the file, or must be named, or is said to have no colour filters and the file's comment
        says that it has.
    """
    place = Path(path)
    data = _read_json(place)
    models: dict[str, list[tuple[Any, str | None]]] = {}
    try:
        if data["version"] != 0:
            raise FileError(place, f"is a noise profile of version {data['version']}; version 0 is read")
        for maker in data["noiseprofiles"]:
            for entry in maker["models"]:
                chip = _own_chip(entry.get("comment"))
                models.setdefault(str(entry["model"]), []).extend((p, chip) for p in entry["profiles"])
        if not models:
            raise FileError(place, "holds no cameras")
        if model is None and len(models) == 1:
            (model,) = models
        if model is None:
            raise InputError(f"{place} holds {len(models)} cameras; name one with model, {next(iter(models))!r} say")
        if model not in models:
            raise InputError(f"{place} has no camera '{model}'; {did_you_mean(model, models)}")
        if mono and any(chip == "mosaic" for _, chip in models[model]):
            raise InputError(f"{place} says that '{model}' has a colour filter mosaic, so it is not mono")
        found = [_darktable_entry(entry, model, mono, chip) for entry, chip in models[model] if not entry.get("skip")]
    except (KeyError, TypeError, AttributeError, IndexError, ValueError) as error:
        if isinstance(error, InputError) and str(error).startswith(str(place)):
            raise
        raise FileError(place, f"is no darktable noise profile: {_reason(error)}") from None
    if not found:
        raise FileError(place, f"holds no profiles of '{model}' that are not to be skipped")
    return tuple(sorted(found, key=lambda profile: profile.gain_setting or 0.0))


def _own_chip(comment: Any) -> str | None:
    """ "mono" or "mosaic" as photosite's own comment says it, None where another program wrote the file."""
    said = _OWN_SHARE.match(comment) if isinstance(comment, str) else None
    if said is None:
        return None
    for chip, share in HAAR_SHARE.items():
        if float(said[1]) == share:
            return chip
    raise ValueError(f"its comment says that a and b are {said[1]} of the raw noise variance, which photosite's never")


def _darktable_entry(entry: Mapping[str, Any], model: str, mono: bool, own: str | None) -> NoiseProfile:
    chip = own or ("mono" if mono else "mosaic")
    share = HAAR_SHARE[chip]
    slope, offset = _number(entry["a"][1], "a"), _number(entry["b"][1], "b")
    channels = ("M",) if chip == "mono" else ("R", "G", "B")
    note = f"green's numbers, taken as {share:g} of the raw noise variance; the share depends on the demosaicing, and "
    note += "gain and noise may be off by a factor of two"
    if own is not None:
        note = f"{share:g} of the raw noise variance of a chip with {_CHIPS[chip]}, as the file's own comment says"
    return NoiseProfile(
        channels,
        (Measured(slope / share),) * len(channels),
        (Measured(offset / share),) * len(channels),
        _number(entry["iso"], "iso"),
        camera=model,
        notes=(note,),
    )


def write_libcamera(profile: NoiseProfile, path: str | PathLike[str], *, target: str = "bcm2835") -> None:
    """Write black level and noise as a libcamera tuning file of the Raspberry Pi: a part of one, to be merged.

    Parameters
    ----------
    profile
        Of the setting that is analogue gain 1; its levels must be known.
    path
        The file.
    target
        "bcm2835" (up to Pi 4) or "pisp" (Pi 5).

    Raises
    ------
    InputError
        If the levels are not known, or the offset is negative.
    FileError
        If the file cannot be written.
    """
    if target not in ("bcm2835", "pisp"):
        raise InputError(f"a tuning file's target is 'bcm2835' or 'pisp', not {target!r}")
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
    _write_json(content, path)


def _on_16_bits(profile: NoiseProfile) -> tuple[float, float, float]:
    """Gain (DN per electron), noise in the dark (DN) and black level, as numbers of 16 bits."""
    gain, dark = profile.system_gain_dn_per_e.value, profile.dark_noise_dn.value
    scale = 65536.0 / 2.0 ** math.ceil(math.log2((profile.white_level_dn or 0.0) + 1.0))
    return gain * scale, dark * scale, (profile.black_level_dn or 0.0) * scale


def read_libcamera(path: str | PathLike[str]) -> NoiseProfile:
    """The noise profile in a libcamera tuning file of the Raspberry Pi, at analogue gain 1, in numbers of 16 bits.

    Raises
    ------
    FileError
        If the file is no tuning file, or holds no noise profile, or none that can be: a slope not above 0, or a
        constant below 0.
    """
    place = Path(path)
    data = _read_json(place)
    try:
        algorithms: dict[str, Any] = {}
        for entry in data["algorithms"]:
            algorithms |= entry
        noise = algorithms["rpi.noise"]
        constant = _number(noise["reference_constant"], "reference_constant")
        slope = _number(noise["reference_slope"], "reference_slope")
        stated = algorithms.get("rpi.black_level", {}).get("black_level")
        black = 0.0 if stated is None else _number(stated, "black_level")
        if constant < 0 or slope <= 0 or not 0 <= black < _FULL_SCALE_DN16:
            raise ValueError(
                f"reference_constant {constant:g}, reference_slope {slope:g}, black_level {black:g} cannot be"
            )
        span = _FULL_SCALE_DN16 - black
        dark_dn, gain = _curve(constant, slope, span)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise FileError(place, f"is no Raspberry Pi tuning file with rpi.noise: {_reason(error)}") from None
    notes = [
        "levels, K and noise are numbers of 16 bits (0 to 65535), as libcamera counts, whatever the converter's bits",
        "the curve whose straight line in sqrt(signal) the file holds: photon noise and one noise in the dark assumed",
    ]
    if stated is None:
        notes.append("no rpi.black_level in the file: taken as 0")
    if constant == 0:
        notes.append("reference_constant is 0, which the tuning tool writes for any that came out below: no dark noise")
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
    """Least squares of sqrt(dark^2 + gain x) by constant + slope sqrt(x), sqrt(x) evenly from 0 to sqrt(span)."""
    root = math.sqrt(span) * _NODES
    slope, constant = np.polyfit(root, np.sqrt(dark_dn**2 + gain * root**2), 1)
    return max(float(constant), 0.0), float(
        slope
    )  # rounding alone makes the constant of a curve without dark noise < 0


def _curve(constant: float, slope: float, span: float) -> tuple[float, float]:
    """Dark noise and gain whose `_line` has this constant and slope.

    With dark = r sqrt(gain span) the line's constant / slope / sqrt(span) depends on r alone, and grows with it.
    """
    from scipy.optimize import brentq

    def ratio(r: float) -> float:
        c, s = _line(r, 1.0, 1.0)
        return c / s

    wanted = constant / slope / math.sqrt(span)
    if wanted == 0:
        r = 0.0
    else:
        top = 1.0
        while ratio(top) < wanted:
            top *= 2.0
            if top > 1e6:
                raise ValueError(f"reference_constant {constant:g} leaves no photon noise beside it")
        r = float(brentq(lambda x: ratio(x) - wanted, 0.0, top, xtol=1e-15, rtol=1e-14))
    _, unit = _line(r, 1.0, 1.0)
    gain = (slope / unit) ** 2
    return r * math.sqrt(gain * span), gain


def looks_like_libcamera(path: str | PathLike[str]) -> bool:
    """Whether a JSON file is a tuning file (it has "algorithms") rather than darktable's ("noiseprofiles").

    Raises
    ------
    FileError
        If it is neither.
    """
    place = Path(path)
    data = _read_json(place)
    if "algorithms" in data:
        return True
    if "noiseprofiles" in data:
        return False
    raise FileError(place, "is neither a darktable noise profile ('noiseprofiles') nor a tuning file ('algorithms')")


def at_setting(profiles: Sequence[NoiseProfile], setting: float | None) -> NoiseProfile:
    """The profile of a gain setting; None where there is one only.

    Raises
    ------
    InputError
        If there is none of that setting, or several and none was named.
    """
    settings = ", ".join("not stated" if p.gain_setting is None else f"{p.gain_setting:g}" for p in profiles)
    if setting is None:
        if len(profiles) != 1:
            raise InputError(f"there are {len(profiles)} noise profiles; name a gain setting of {settings}")
        return profiles[0]
    for profile in profiles:
        if profile.gain_setting == setting:
            return profile
    raise InputError(f"there is no noise profile of gain setting {setting:g}; there are {settings}")


def _green(profile: NoiseProfile) -> int:
    return profile.channels.index("G") if "G" in profile.channels else 0


def _number(value: Any, name: str) -> float:
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"'{name}' is a finite number, not {str(value)[:40]}")
    return number


def _reason(error: Exception) -> str:
    return f"it lacks {error}" if isinstance(error, KeyError) else str(error)


def _read_json(path: Path) -> Mapping[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileError(path, "there is no such file") from None
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    # A ValueError of its own is a whole number of thousands of digits.
    except (ValueError, RecursionError) as error:
        line = error.lineno if isinstance(error, json.JSONDecodeError) else None
        raise FileError(path, f"is not JSON: {error.__class__.__name__}", line) from None
    if not isinstance(data, dict):
        raise FileError(path, "is JSON, but not an object with a noise profile in it")
    return data


def _write_json(content: Mapping[str, Any], path: str | PathLike[str]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
