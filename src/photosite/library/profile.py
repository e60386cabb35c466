"""A camera of the library: what its files contain at one gain setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from os import PathLike
from typing import Any

from photosite.errors import InputError
from photosite.frames.camera_names import one_camera
from photosite.frames.io.darktable import DarktableCamera
from photosite.library.entry import LoadedEntry
from photosite.library.sources import LOOKED_FOR, CameraSource, Profiles, entries_below, find_cameras, given_places
from photosite.library.spectra import SpectralFile, SpectralSensitivity
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import NoiseProfile, sensor_noise_profile
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95

MISSING_IN_PROFILE = {
    "pixel size": "a noise profile is of numbers, not of areas",
    "well capacity": "the profile ends at the white level, which may lie below the well",
    "bit depth and black level": "the format has no field for them; give the black and the white level",
    "PRNU": "its effect is in the profile's noise and cannot be separated",
    "dark current": "a profile is of one exposure time, which it does not state",
    "read noise and DSNU": "one frame does not separate them",
}
"""What a noise profile does not contain, each with the reason."""

_MOST_PATHS = 8
_NO_NOISE = "none of the files has a noise profile of the camera"
_NO_SPECTRA = "none of the files has the spectral sensitivity of the camera"
_RELATIVE = "the spectral sensitivity is relative"


@dataclass(frozen=True)
class CameraProfile(Shown):
    """What the library has on a camera.

    Parameters
    ----------
    name
        The camera.
    iso
        ISO speed or gain setting of the noise; None for a camera with a spectral sensitivity only.
    noise
        The noise profile, or None.
    spectra
        The spectral sensitivity, or None.
    measured
        The measured sensor of a contributed entry, or None.
    sources
        The files, with license and provenance.
    missing
        What the files do not contain, each with the reason.
    notes
        Assumptions and interpolations.
    """

    name: str
    iso: float | None
    noise: NoiseProfile | None
    spectra: SpectralSensitivity | None
    measured: Sensor | None
    sources: tuple[CameraSource, ...]
    missing: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def electrons_at_white_95(self) -> tuple[float, float]:
        """95 % interval of the electrons of a pixel at the white level: 1 / slope of the noise profile.

        Raises
        ------
        InputError
            If there is no noise profile.
        """
        slope = self._noise().slope[0]
        reach = COVERAGE_95 * slope.standard_uncertainty
        return 1.0 / (slope.value + reach), 1.0 / (slope.value - reach)

    def sensor(self, base: str | PathLike[str] | Sensor) -> Sensor:
        """Return a sensor for simulation: noise and spectral sensitivity of the files, all else of `base`.

        A contributed camera is complete, and `base` is not used.

        Parameters
        ----------
        base
            A sensor, a preset or a sensor file: geometry, volts, well, PRNU, dark current, levels.

        Raises
        ------
        InputError
            If the offset is less than the variance of rounding, or a channel is missing.
        """
        if self.measured is not None:
            return self.measured
        from photosite.sensor.io.sensor_file import load_sensor

        made = base if isinstance(base, Sensor) else load_sensor(base)
        if self.spectra is not None:
            made = self.spectra.sensor(made)
        if self.noise is not None:
            made = self.noise.sensor(made)
        return made.with_(name=self.name)

    def _noise(self) -> NoiseProfile:
        if self.noise is None:
            raise InputError("the camera has no noise profile", where=self.name)
        return self.noise


def load_camera_profile(
    name: str,
    iso: float | None = None,
    *,
    profiles: Profiles = None,
    mono: bool = False,
    black_level_dn: float | None = None,
    white_level_dn: float | None = None,
) -> CameraProfile:
    """Load a camera of the library by name: noise at an ISO speed, and spectral sensitivity.

    Parameters
    ----------
    name
        Maker and model. Case, punctuation and the maker's company name do not matter; the model alone serves where one
        camera has it.
    iso
        ISO speed, or gain setting of a contributed camera. Between two ISO speeds of a noise profile, a and b are
        linear in ISO, as in darktable. Default: the only one that there is.
    profiles
        Files and folders. Default: those of the environment variable PHOTOSITE_PROFILES, darktable and rawtoaces. Where
        several hold different data of one kind on the camera, pass the one file, or the folder of the one entry. A
        contributed entry is preferred to files of other programs.
    mono
        Whether the camera has no color filters, for noise profiles that do not state it.
    black_level_dn, white_level_dn
        Levels of the camera's raw files, which a noise profile does not state.

    Raises
    ------
    InputError
        If no camera or several match, several files of one kind or several entries hold different data on it, the ISO
        is missing or outside the profile, only one level is given, or levels or `mono` are given for a camera without a
        noise profile, or for a contributed one.
    FileError
        If a file is missing or invalid.

    Examples
    --------
    >>> import json, tempfile
    >>> from pathlib import Path
    >>> entries = [{"name": "", "iso": iso, "a": [iso * 1e-7] * 3, "b": [1e-7] * 3} for iso in (800, 6400)]
    >>> models = [{"comment": "", "model": "X-1", "profiles": entries}]
    >>> folder = tempfile.TemporaryDirectory()
    >>> file = Path(folder.name) / "noiseprofiles.json"
    >>> _ = file.write_text(json.dumps({"version": 0, "noiseprofiles": [{"maker": "Acme", "models": models}]}))
    >>> camera = load_camera_profile("acme x-1", iso=6400, profiles=file)
    >>> camera.name, [round(electrons) for electrons in camera.electrons_at_white_95]
    ('Acme X-1', [69, 130])
    """
    if iso is not None and (isinstance(iso, bool) or not isinstance(iso, Real)):
        raise InputError("iso", value=iso, expected="a number")
    if not isinstance(name, str):
        raise InputError("name", value=name, expected="the name of a camera")
    _check_levels(black_level_dn, white_level_dn)
    profile_arguments = {"mono": mono or None, "black_level_dn": black_level_dn, "white_level_dn": white_level_dn}
    found = _matched(name, find_cameras(profiles), profiles)
    contributed = [source for source in found if source.kind == "contributed"]
    if contributed:
        _check_omitted(profile_arguments, "a contributed camera states it")
        return _contributed(
            _only_one(_having_setting(contributed, iso)), iso, [one for one in found if one.kind != "contributed"]
        )
    by_kind = {kind: [source for source in found if source.kind == kind] for kind in {one.kind for one in found}}
    parts = {kind: _only_one(sources) for kind, sources in sorted(by_kind.items())}
    noise = None
    if (profiled := parts.get("noise profile")) is not None:
        assert isinstance(profiled.content, DarktableCamera)
        noise = profiled.content.profile(_setting(profiled, iso), mono=mono)
        if black_level_dn is not None and white_level_dn is not None:
            noise = noise.at_levels(black_level_dn, white_level_dn)
    elif iso is not None:
        expected = "omitted: no noise profile of the camera was found"
        raise InputError("iso", value=iso, expected=expected, where=found[0].name)
    else:
        _check_omitted(profile_arguments, "it completes a noise profile, and none of the camera was found")
    spectra, relative = None, None
    if (table := parts.get("spectral sensitivity")) is not None:
        assert isinstance(table.content, SpectralFile)
        spectra, relative = table.content.sensitivity, _RELATIVE
    missing = {**(MISSING_IN_PROFILE if noise is not None else {"noise": _NO_NOISE})}
    if noise is not None and noise.white_level_dn is not None:
        del missing["bit depth and black level"]
    missing["quantum efficiency"] = relative or _NO_SPECTRA
    used = tuple(source for source in (profiled, table) if source is not None)
    notes = noise.notes if noise is not None else ()
    return CameraProfile(
        used[0].name, None if noise is None else noise.gain_setting, noise, spectra, None, used, missing, notes
    )


def _check_omitted(given: Mapping[str, Any], why: str) -> None:
    for name, value in given.items():
        if value is not None:
            raise InputError(name, value=value, expected=f"omitted: {why}")


def _check_levels(black_dn: float | None, white_dn: float | None) -> None:
    if black_dn is not None and white_dn is not None:
        if not black_dn < white_dn:
            raise InputError("white_level_dn", value=white_dn, expected=f"above the black level, {black_dn:g}")
    elif black_dn is not None:
        raise InputError("white_level_dn", expected="given with the black level")
    elif white_dn is not None:
        raise InputError("black_level_dn", expected="given with the white level")


def _matched(name: str, sources: Sequence[CameraSource], profiles: Profiles) -> list[CameraSource]:
    if not sources and profiles is not None:
        places = given_places(profiles)
        hint, arguments = "Pass {profiles} or another such file", {"profiles": "noiseprofiles.json"}
        if entries := entries_below(places):
            hint, arguments = "Pass the folder of an entry: {profiles}", {"profiles": str(entries[0])}
        listed = ", ".join(map(str, places)) or "the empty list of profiles"
        raise InputError(f"no cameras in {listed}: {LOOKED_FOR}", hint=hint, arguments=arguments)
    if not sources:
        hint = "Pass {profiles}, or install darktable or rawtoaces' data; docs/howto/cameras.md lists the places"
        arguments = {"profiles": "noiseprofiles.json"}
        raise InputError("no files with cameras were found", hint=hint, arguments=arguments)
    names = [source.name for source in sources]
    return [sources[k] for k in one_camera(name, names, "name")]


def _setting(source: CameraSource, iso: float | None) -> float:
    """Return the ISO speed that was asked for, or the only one."""
    if iso is not None:
        return iso
    if len(source.isos) == 1:
        return source.isos[0]
    listed = ", ".join(f"{known:g}" for known in source.isos)
    raise InputError("iso", where=source.name, expected=f"given: the profiles have {listed}")


def _only_one(sources: Sequence[CameraSource]) -> CameraSource:
    """Return the first of sources of one kind, which must hold the same data."""
    first = sources[0]
    if len({source.digest for source in sources}) == 1:
        return first
    paths = list(dict.fromkeys(str(source.path) for source in sources))
    listed = ", ".join(paths[:_MOST_PATHS]) + (
        f" and {len(paths) - _MOST_PATHS} others" if len(paths) > _MOST_PATHS else ""
    )
    what = "entry" if first.kind == "contributed" else f"file with a {first.kind}"
    expected = f"one {what} of the camera: {len(sources)} with different data were found"
    if len(paths) == 1:
        hint = f"Remove all but one of them from a copy of {listed}, and pass it"
        raise InputError("profiles", where=first.name, expected=expected, hint=hint)
    hint = f"They are {listed}".replace("{", "{{").replace("}", "}}") + ". Pass only the one to use, such as {profiles}"
    raise InputError("profiles", where=first.name, expected=expected, hint=hint, arguments={"profiles": paths[0]})


def _having_setting(sources: Sequence[CameraSource], iso: float | None) -> list[CameraSource]:
    having = [source for source in sources if iso is None or iso in source.isos]
    if not having:
        known = sorted({setting for source in sources for setting in source.isos})
        expected = f"one of the measured settings, {', '.join(f'{each:g}' for each in known) or 'which are not stated'}"
        raise InputError("iso", where=sources[0].name, value=iso, expected=expected)
    return having


def _contributed(source: CameraSource, iso: float | None, others: Sequence[CameraSource]) -> CameraProfile:
    """Return the profile of a contributed camera, at a measured gain setting; `others` are not used."""
    assert isinstance(source.content, LoadedEntry)
    sensor = source.content.sensor
    if iso is not None and sensor.gain_settings:
        sensor = sensor.at_gain_setting(iso)
    noise = sensor_noise_profile(sensor, gain_setting=sensor.gain_setting)
    missing = {"the chip's own pattern": "maps and serial number are removed from contributed entries"}
    unused = ", ".join(dict.fromkeys(str(other.path) for other in others))
    notes = (f"the contributed entry is used, and not {unused}",) if unused else ()
    return CameraProfile(source.name, sensor.gain_setting, noise, None, sensor, (source,), missing, notes)
