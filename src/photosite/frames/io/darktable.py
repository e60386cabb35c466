"""Noise profiles in darktable's JSON (`data/noiseprofiles.json` of its sources).

A profile is variance a x + b, in the scale of darktable's pipeline: its profiling tool takes the noise from the
diagonal details of a 2 x 2 Haar transform of the demosaiced picture. White noise keeps 1/4 of its variance there, and
Bayer green 1/16, if each missing green is the mean of its two neighbors on a line. The denoiser uses green's numbers
and the white balance, so all three are green's. The format has no field for this factor; photosite states it in the
camera's comment and reads it from there. For files of other programs `darktable_scale` has the range of the factor.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError, in_file
from photosite.files.small_files import finite_number, read_json_object, valid_content, write_json_object
from photosite.frames.camera_names import full_name, one_camera
from photosite.frames.io.darktable_scale import ASSUMED_PIXELS, slope_and_offset
from photosite.sensor.noise_profile import NOT_IN_PROFILE, NoiseProfile
from photosite.values.shown import Shown
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


@dataclass(frozen=True)
class DarktableCamera(Shown):
    """A camera of a darktable file: green's a and b by ISO, as the file has them.

    Parameters
    ----------
    maker, model, comment
        As in the file.
    isos, a, b
        ISO speeds, increasing, and a and b of each: the mean where the file has several of one ISO.
    stated
        "mono" or "mosaic" in files from photosite, which state the scale of a and b; None in others.
    """

    maker: str
    model: str
    comment: str
    isos: tuple[float, ...]
    a: tuple[float, ...]
    b: tuple[float, ...]
    stated: str | None = None

    def profile(self, iso: float, *, mono: bool = False) -> NoiseProfile:
        """Return the noise profile at an ISO speed.

        Between two ISO speeds of the file, a and b are linear in ISO, as in darktable.

        Parameters
        ----------
        iso
            Within the range of the file's ISO speeds.
        mono
            Whether the camera has no color filters. Only files from photosite state this.

        Raises
        ------
        InputError
            If the ISO is outside the file's range, `mono` contradicts the file, or a is not one that a sensor has.
        """
        if not self.isos[0] <= iso <= self.isos[-1]:
            ends = " to ".join(f"{iso:g}" for iso in dict.fromkeys((self.isos[0], self.isos[-1])))
            expected = f"{ends}, the {'range' if len(self.isos) > 1 else 'only one'} of the profiles"
            raise InputError("iso", where=f"{self.maker} {self.model}".strip(), value=iso, expected=expected)
        self.check_mono(mono)
        chip = self.stated or ("mono" if mono else "mosaic")
        a, b = (float(np.interp(iso, self.isos, values)) for values in (self.a, self.b))
        notes = []
        if self.stated is not None:
            factor = HAAR_FACTOR[chip]
            slope, offset = Measured(a / factor), Measured(b / factor)
            notes.append(
                f"a and b are {factor:g} of the raw noise variance ({_CHIPS[chip]}), as the file's comment says"
            )
        else:
            slope, offset = slope_and_offset(a, b, "mono" if chip == "mono" else "bayer")
            spread = 1.96 * slope.standard_uncertainty / slope.value
            notes.append(
                f"gain to ±{100 * spread:.0f} % (95 %): the file does not state how the picture was demosaiced, nor "
                "the nonuniformity of the pixels"
            )
            notes.append(
                f"the uncertainty of the dark noise includes the sampling error of a frame of {ASSUMED_PIXELS / 1e6:g} "
                "megapixels"
            )
            if self.maker.lower().startswith("fuji") and chip != "mono":
                notes.append("for a Bayer mosaic: the scale for an X-Trans mosaic is not known")
        if iso not in self.isos:
            above = next(k for k, known in enumerate(self.isos) if known > iso)
            between = f"{self.isos[above - 1]:g} and {self.isos[above]:g}"
            notes.append(f"a and b at ISO {iso:g} are linear in ISO between {between}, as in darktable")
        channels = ("M",) if chip == "mono" else ("R", "G", "B")
        count = len(channels)
        return NoiseProfile(channels, (slope,) * count, (offset,) * count, iso, camera=self.model, notes=tuple(notes))

    def check_mono(self, mono: bool) -> None:
        """Raise `InputError` if a camera without color filters is asked for, and the file states a mosaic."""
        if mono and self.stated == "mosaic":
            expected = f"False: the file states that '{self.model}' has a color filter mosaic"
            raise InputError("mono", value=mono, expected=expected)


def read_darktable_cameras(path: str | PathLike[str]) -> tuple[DarktableCamera, ...]:
    """Read all cameras of a darktable file. Entries marked "skip" are omitted, and cameras without others.

    Raises
    ------
    FileError
        If the file is not a valid noise profile, or holds no cameras.
    """
    file = Path(path)
    return darktable_cameras(read_json_object(file), file)


def darktable_cameras(data: Mapping[str, Any], file: Path) -> tuple[DarktableCamera, ...]:
    """Return the cameras of a darktable file's content; raises as `read_darktable_cameras`."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    with valid_content(file, _WHAT):
        if data["version"] != 0:
            raise FileError(file, "version", value=data["version"], expected="0")
        for maker in data["noiseprofiles"]:
            for entry in maker["models"]:
                found.setdefault((str(maker.get("maker", "")), str(entry["model"])), []).append(entry)
        if not found:
            raise FileError(file, "the file holds no cameras")
        cameras = [_camera(*name, entries) for name, entries in found.items()]
    return tuple(camera for camera in cameras if camera.isos)


def _green(profile: Mapping[str, Any], name: str) -> float:
    entries = profile[name]
    if not isinstance(entries, list) or len(entries) != 3:
        raise ValueError(f"'{name}' must be a list of 3 numbers, for red, green and blue")
    return [finite_number(entry, name) for entry in entries][1]


@contextmanager
def _in_place(place: str) -> Iterator[None]:
    """Put the camera, and its ISO speed, in front of what is wrong with a profile."""
    try:
        yield
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{place}: {reason}") from None


def _camera(maker: str, model: str, entries: Sequence[Mapping[str, Any]]) -> DarktableCamera:
    comment = str(entries[0].get("comment") or "")
    values: dict[float, list[tuple[float, float]]] = {}
    place = f"{maker} {model}".strip()[:80]
    for profile in (profile for entry in entries for profile in entry["profiles"]):
        with _in_place(place):
            if profile.get("skip"):
                continue
            iso = finite_number(profile["iso"], "iso")
        with _in_place(f"{place}, ISO {iso:g}"):
            # darktable's denoiser takes green's numbers for all three.
            a, b = (_green(profile, name) for name in ("a", "b"))
        values.setdefault(iso, []).append((a, b))
    isos = tuple(sorted(values))
    means = [tuple(fmean(column) for column in zip(*values[iso], strict=True)) for iso in isos]
    return DarktableCamera(
        *(maker, model, comment, isos, tuple(a for a, _ in means), tuple(b for _, b in means)),
        _chip_in_comment(comment),
    )


def read_darktable(
    path: str | PathLike[str], model: str | None = None, iso: float | None = None, *, mono: bool = False
) -> tuple[NoiseProfile, ...]:
    """Read the noise profiles of one camera from a darktable file, by increasing ISO.

    The profiles have no levels, because the format has none. Entries marked "skip" are omitted.

    Parameters
    ----------
    path
        The file.
    model
        The camera, as in `ps.load_camera_profile`; None if the file holds only one.
    iso
        ISO speed, as in `DarktableCamera.profile`; None for all of the file.
    mono
        Whether the camera has no color filters. Only files from photosite state this.

    Raises
    ------
    FileError
        If the file is not a valid noise profile.
    InputError
        If the model is missing or unknown or stands for several, or has a mosaic although `mono` is set, or the ISO is
        out of range.
    """
    file = Path(path)
    cameras = read_darktable_cameras(file)
    if not cameras:
        raise FileError(file, "all profiles are marked as skipped")
    if model is None and len(cameras) > 1:
        problem = f"the file holds {len(cameras)} cameras"
        name = full_name(cameras[0].maker, cameras[0].model)
        raise InputError(problem, where=str(file), hint="Pass {model}", arguments={"model": name})
    if model is None:
        (camera,) = cameras
    else:
        names = [full_name(camera.maker, camera.model) for camera in cameras]
        camera = cameras[one_camera(model, names, "model", str(file))[0]]
    camera.check_mono(mono)
    with in_file(file):
        return tuple(camera.profile(each, mono=mono) for each in (camera.isos if iso is None else (iso,)))


def _chip_in_comment(comment: str) -> str | None:
    """Return "mono" or "mosaic" from photosite's comment, None if another program wrote the file."""
    match = _COMMENT_FACTOR.match(comment)
    if match is None:
        return None
    for chip, factor in HAAR_FACTOR.items():
        if float(match[1]) == factor:
            return chip
    raise ValueError(f"the comment states a factor of {match[1]}, which photosite never writes")
