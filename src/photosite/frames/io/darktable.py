"""Noise profiles in darktable's JSON (`data/noiseprofiles.json` of its sources).

A profile is variance a x + b, in the scale of darktable's pipeline: its profiling tool takes the noise from the
diagonal details of a 2 x 2 Haar transform of the demosaiced picture. White noise keeps 1/4 of its variance there, and
Bayer green 1/16, if each missing green is the mean of its two neighbors on a line. The denoiser uses green's numbers
and the white balance, so all three are green's. The format has no field for this factor; photosite states it in the
camera's comment and reads it from there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.small_files import finite_number, read_json_object, valid_content, write_json_object
from photosite.sensor.noise_profile import NOT_IN_PROFILE, NoiseProfile
from photosite.values.uncertain import Measured

HAAR_FACTOR = {"mosaic": 1 / 16, "mono": 1 / 4}
"""Part of a raw pixel's noise variance that is in darktable's numbers."""

_COMMENT = "written by photosite: a and b are {factor:g} of the raw noise variance ({chip})"
_COMMENT_FACTOR = re.compile(r"written by photosite: a and b are ([0-9.]+) of the raw noise variance \(")
_CHIPS = {"mosaic": "color filter mosaic", "mono": "no color filters"}

_WHAT = "a valid darktable noise profile"

DARKTABLE_LOSS = (
    f"a and b are {HAAR_FACTOR['mosaic']:g} (mono: {HAAR_FACTOR['mono']:g}) of the raw slope and offset, as darktable "
    f"measures noise; green is used for all channels; not in the file: levels, uncertainties, {NOT_IN_PROFILE}"
)


def write_darktable(
    profiles: Sequence[NoiseProfile], path: str | PathLike[str], *, maker: str = "photosite", model: str | None = None
) -> None:
    """Write noise profiles for darktable: JSON, one entry for each gain setting.

    Parameters
    ----------
    profiles
        One for each setting; each must state its gain setting, which darktable uses as ISO.
    path
        The file.
    maker, model
        The camera as its raw files name it, by which darktable finds the profile. Default model: the profile's camera.

    Raises
    ------
    InputError
        If there are no profiles, one does not state its gain setting, or mosaic and monochrome profiles are mixed.
    FileError
        If the file cannot be written.
    """
    chips = {"mono" if len(profile.channels) == 1 else "mosaic" for profile in profiles}
    if len(chips) != 1:
        raise InputError("profiles", expected="one or more, either all of a mosaic or all monochrome")
    (chip,) = chips
    name = model or profiles[0].camera or "unnamed camera"
    factor = HAAR_FACTOR[chip]
    entries = []
    for profile in profiles:
        iso = profile.gain_setting
        if iso is None:
            raise InputError(
                "the noise profile does not state its gain setting, by which darktable finds it",
                hint="Pass {gain_setting}",
                arguments={"gain_setting": 100},
            )
        green = profile.channels.index("G") if "G" in profile.channels else 0
        entries.append(
            {
                "name": f"{name} iso {iso:g}",
                "iso": int(iso) if iso == int(iso) else iso,
                "a": [factor * profile.slope[green].value] * 3,
                "b": [factor * profile.offset[green].value] * 3,
            }
        )
    comment = f"{_COMMENT.format(factor=factor, chip=_CHIPS[chip])}; {DARKTABLE_LOSS}"
    models = [{"comment": comment, "model": name, "profiles": entries}]
    write_json_object({"version": 0, "noiseprofiles": [{"maker": maker, "models": models}]}, path)


def read_darktable(
    path: str | PathLike[str], model: str | None = None, *, mono: bool = False
) -> tuple[NoiseProfile, ...]:
    """Read the noise profiles of one camera from a darktable file, by increasing ISO.

    The profiles have no levels, because the format has none. Entries marked "skip" are omitted.

    Parameters
    ----------
    path
        The file.
    model
        The camera; None if the file holds only one.
    mono
        Whether the camera has no color filters. Only files from photosite state this.

    Raises
    ------
    FileError
        If the file is not a valid noise profile.
    InputError
        If the model is missing, unknown, or has a mosaic although `mono` is set.
    """
    file = Path(path)
    data = read_json_object(file)
    models: dict[str, list[tuple[Any, str | None]]] = {}
    with valid_content(file, _WHAT):
        if data["version"] != 0:
            raise FileError(file, "version", value=data["version"], expected="0")
        for maker in data["noiseprofiles"]:
            for entry in maker["models"]:
                chip = _chip_in_comment(entry.get("comment"))
                models.setdefault(str(entry["model"]), []).extend((p, chip) for p in entry["profiles"])
    if not models:
        raise FileError(file, "the file holds no cameras")
    model = _choose_model(file, models, model, mono)
    with valid_content(file, _WHAT):
        found = [_read_entry(entry, model, mono, chip) for entry, chip in models[model] if not entry.get("skip")]
    if not found:
        raise FileError(file, f"all profiles of '{model}' are marked as skipped")
    return tuple(sorted(found, key=lambda profile: profile.gain_setting or 0.0))


def _choose_model(file: Path, models: Mapping[str, Any], model: str | None, mono: bool) -> str:
    if model is None and len(models) > 1:
        first = next(iter(models))
        problem = f"the file holds {len(models)} cameras"
        raise InputError(problem, where=str(file), hint="Pass {model}", arguments={"model": first})
    if model is None:
        (model,) = models
    if model not in models:
        hint = did_you_mean(model, models)
        raise InputError("model", where=str(file), value=model, expected="a camera in the file", hint=hint)
    if mono and any(chip == "mosaic" for _, chip in models[model]):
        expected = f"False: the file states that '{model}' has a color filter mosaic"
        raise InputError("mono", where=str(file), value=mono, expected=expected)
    return model


def _chip_in_comment(comment: Any) -> str | None:
    """Return "mono" or "mosaic" from photosite's comment, None if another program wrote the file."""
    match = _COMMENT_FACTOR.match(comment) if isinstance(comment, str) else None
    if match is None:
        return None
    for chip, factor in HAAR_FACTOR.items():
        if float(match[1]) == factor:
            return chip
    raise ValueError(f"the comment states a factor of {match[1]}, which photosite never writes")


def _read_entry(entry: Mapping[str, Any], model: str, mono: bool, stated: str | None) -> NoiseProfile:
    chip = stated or ("mono" if mono else "mosaic")
    factor = HAAR_FACTOR[chip]
    slope, offset = finite_number(entry["a"][1], "a"), finite_number(entry["b"][1], "b")
    channels = ("M",) if chip == "mono" else ("R", "G", "B")
    note = f"green's numbers are taken as {factor:g} of the raw noise variance; the factor depends on the demosaicing, "
    note += "and gain and noise may be wrong by a factor of two"
    if stated is not None:
        note = f"a and b are {factor:g} of the raw noise variance ({_CHIPS[chip]}), as the file's comment states"
    return NoiseProfile(
        channels,
        (Measured(slope / factor),) * len(channels),
        (Measured(offset / factor),) * len(channels),
        finite_number(entry["iso"], "iso"),
        camera=model,
        notes=(note,),
    )
