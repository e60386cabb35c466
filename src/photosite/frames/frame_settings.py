"""The settings of a frame: dark or light, exposure time, light, gain setting and temperature.

Names of files and folders may state them:

| part of a name | setting |
|---|---|
| dark, darks, bias, `d_012` | a dark frame |
| light, lights, flat, flats, bright, `b_012` | a light frame |
| `10ms`, `0.04s`, `0,04s`, `250us`, `exp40000ns`, `1-8000s` (1/8000 s), `exp0.001` (in s) | exposure time |
| `iso400`, `gain_2.5`, `gain12dB` | gain setting |
| `20C`, `_-10C`, `temp_21.5degC` | sensor temperature in degrees Celsius |

Parts are separated by spaces, underscores, hyphens and similar characters. A comma between digits is a decimal comma.
Names that can be read in two ways are refused: `1_8000s` (1/8000 s, or number 1 at 8000 s), `1,500ms` (1.5 ms or
1500 ms), `gain_2,10ms` (gain 2 at 10 ms, or 2.1 ms).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any, Literal

from photosite.errors import FileError, InputError
from photosite.values.exposure import PER_SECOND, parse_exposure
from photosite.values.limits import check_magnitude

Kind = Literal["dark", "light"]
KINDS: tuple[Kind, ...] = ("dark", "light")

ABSOLUTE_ZERO_C = -273.15

_CONDITIONS = {
    "exposure_s": (0.0, "a number of seconds above 0; 0 for dark frames, or with photons_per_pixel"),
    "photons_per_pixel": (0.0, "a finite number, 0 or above"),
    "gain_setting": (0.0, "a finite number, 0 or above"),
    "temperature_c": (ABSOLUTE_ZERO_C, f"a finite number above {ABSOLUTE_ZERO_C:g}"),
}
"""Lowest value, and the condition in words."""


@dataclass(frozen=True)
class FrameSettings:
    """Settings of one frame; None where a source does not state the setting.

    Parameters
    ----------
    kind
        "dark" or "light".
    exposure_s
        Exposure time. 0 is that of bias frames; of light frames, whose photons must then be known, it means unknown.
    photons_per_pixel
        Mean number of photons per pixel during the exposure.
    gain_setting
        The camera's gain setting: ISO, or any other unit if all files use the same.
    temperature_c
        Temperature of the sensor, in degrees Celsius.
    level
        Name of the light level that the listing tells from others: entry of a protocol, folder or name.

    Examples
    --------
    >>> found = FrameSettings("dark").or_else(FrameSettings("light", exposure_s=0.01, gain_setting=100))
    >>> found.kind, found.exposure_s, found.gain_setting
    ('dark', 0.01, 100)
    """

    kind: Kind | None = None
    exposure_s: float | None = None
    photons_per_pixel: float | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None
    level: str | None = None

    def or_else(self, other: FrameSettings) -> FrameSettings:
        """Return these settings, with those that are missing taken from another source."""
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))
        return FrameSettings(*(second if first is None else first for first, second in pairs))

    def validated(self) -> FrameSettings:
        """Return these settings with floats for all numbers."""
        if self.kind is not None and self.kind not in KINDS:
            raise InputError("kind", value=self.kind, expected="'dark' or 'light'")
        numbers = {}
        for name, (lowest, condition) in _CONDITIONS.items():
            value = getattr(self, name)
            if value is None:
                continue
            number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
            lowest_is_valid = name != "temperature_c" and (name != "exposure_s" or self._zero_exposure)
            if not lowest <= number < math.inf or (number == lowest and not lowest_is_valid):
                raise InputError(name, value=value, expected=condition)
            check_magnitude(name, number)
            numbers[name] = number
        return FrameSettings(self.kind, **numbers, level=self.level)

    @property
    def _zero_exposure(self) -> bool:
        """Whether the exposure time may be 0: descriptors label light of known photons so."""
        return self.kind == "dark" or self.photons_per_pixel is not None


_KIND_WORDS: dict[str, Kind] = {
    **dict.fromkeys(("dark", "darks", "bias", "darkflat", "darkflats", "flatdark", "flatdarks"), "dark"),
    **dict.fromkeys(("light", "lights", "flat", "flats", "bright"), "light"),
}
_FLAT_WORD = re.compile(r"(?:dome|sky|twilight|twi|lamp|panel|d|s|t)flats?")
_EMVA_KINDS: dict[str, Kind] = {"d": "dark", "b": "light"}

_NUMBER = r"\d+(?:[.,]\d+)*(?:e[+-]?\d{1,2})?"
_END = r"(?![a-z0-9])"
_EMVA_KIND = re.compile(r"^([bd])_\d+" + _END)
_EXPOSURE = re.compile(
    rf"(?<![a-z0-9.])(?:(?:exposure|exp|t)[_=]?)?(1-(?=\d+s))?({_NUMBER})_?({'|'.join(PER_SECOND)}){_END}"
)
_EXPOSURE_WITHOUT_UNIT = re.compile(
    rf"(?<![a-z0-9])(?:exposure|exp)[_=]?(\d+[.,]\d+(?:e[+-]?\d{{1,2}})?)(?![.,]\d|_?(?:{'|'.join(PER_SECOND)}){_END}){_END}"
)
"""The decimal point tells a time from a number such as exp001."""
_GAIN = re.compile(rf"(?<![a-z0-9])(?:iso|gain)[-_= ]?({_NUMBER})(?:db)?(?![a-z0-9]|[.,]\d)")
_TEMPERATURE = re.compile(rf"(?:^|[_ ])(?:temp|t)?[_=]?(-?{_NUMBER})_?(?:degc|c){_END}")

_ONE_BEFORE = re.compile(r"(?<![0-9.,])1[_ ]$")
"""The end of a name before a whole number of seconds that may be the denominator of a fraction."""
_DIGITS_BEFORE = re.compile(r"(\d+),$")
_GAIN_BEFORE = re.compile(r"(?:iso|gain)[-_= ]?$")
_THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")

_UNKNOWN = FrameSettings()


def settings_from_names(path: Path, names: Iterable[str], known: FrameSettings = _UNKNOWN) -> FrameSettings:
    """Return the settings that names state; the first name that states a setting decides.

    Parameters
    ----------
    path
        The file, for messages.
    names
        From the most specific to the least: dataset, file without its suffix, folder.
    known
        Settings that the listing or the metadata state; these are not searched for in the names.

    Raises
    ------
    FileError
        If a name states two values of a setting, or can be read in two ways.

    Examples
    --------
    >>> found = settings_from_names(Path("x"), ["flat_10ms_001", "iso400"])
    >>> found.kind, found.exposure_s, found.gain_setting
    ('light', 0.01, 400.0)
    """
    every = list(names)
    found = {field: _first(path, every, *how) for field, how in _SEARCHES.items() if getattr(known, field) is None}
    return FrameSettings(**found)


def kinds_in_name(name: str) -> set[Kind]:
    """Return the kinds that words of a name state.

    Examples
    --------
    >>> kinds_in_name("Flat Field 2"), kinds_in_name("d_003_snap_1"), kinds_in_name("darkroom")
    ({'light'}, {'dark'}, set())
    >>> kinds_in_name("DarkFlat_0001"), kinds_in_name("SKYFLAT")
    ({'dark'}, {'light'})
    """
    lower = name.lower()
    words = re.findall("[a-z]+", lower)
    found = {_KIND_WORDS[word] for word in words if word in _KIND_WORDS}
    if any(_FLAT_WORD.fullmatch(word) for word in words):
        found.add("light")
    if not found and (emva := _EMVA_KIND.match(lower)):
        found = {_EMVA_KINDS[emva[1]]}
    return found


def exposure_by_pattern(path: Path, names: Iterable[str], pattern: str) -> float:
    """Return the exposure time in seconds that a regular expression finds in a file's names.

    Parameters
    ----------
    path
        The file, for messages.
    names
        Texts to search, the first match counts.
    pattern
        Regular expression with one group, which is a time as in `photosite.values.exposure.parse_exposure` or 1-60 for
        1/60 s. A group named after a unit holds a number in that unit: `(?P<us>[0-9]+)`.

    Raises
    ------
    InputError
        If the pattern is not a regular expression with one group.
    FileError
        If the names do not match, or the group is no time.

    Examples
    --------
    >>> exposure_by_pattern(Path("x"), ["shot_0250_us.tif"], r"shot_(?P<us>[0-9]+)")
    0.00025
    """
    try:
        compiled = re.compile(pattern)
    except re.error as error:
        raise InputError("exposure_from_name", value=pattern, expected=f"a regular expression ({error})") from None
    units = tuple(compiled.groupindex)
    if compiled.groups != 1 or not set(units) <= PER_SECOND.keys():
        expected = "a regular expression with one group, without a name or named after a unit: (?P<ms>[0-9]+)"
        raise InputError("exposure_from_name", value=pattern, expected=expected)
    found = next((match[1] for name in names if (match := compiled.search(name)) and match[1]), None)
    if found is None:
        raise FileError(path, f"the name does not match the pattern '{pattern}' of exposure times")
    try:
        return parse_exposure("".join((re.sub(r"(?<=\d)-(?=\d)", "/", found), *units)))
    except InputError as error:
        raise error.in_file(path) from None


def _first(path: Path, names: Iterable[str], find: Callable[[str], set[Any]], many: str, hint: str) -> Any:
    for name in names:
        values = find(name)
        if len(values) > 1:
            raise FileError(path, f"the name '{name}' states {many}", hint=hint)
        if values:
            return values.pop()
    return None


def _exposures(name: str) -> set[float]:
    """Return the exposure times that a name can mean."""
    found = set()
    for match in _EXPOSURE.finditer(name.lower()):
        reciprocal, number, unit = match.groups()
        before = name.lower()[: match.start(1 if reciprocal else 2)]
        values = _readings(number)
        if "," in number and _GAIN_BEFORE.search(before):
            values |= _readings(number.rpartition(",")[2])  # gain_2,10ms
        if (digits := _DIGITS_BEFORE.search(before)) is not None:
            values |= _readings(f"{digits[1]},{number}")  # dark0,5s
        seconds = {value / PER_SECOND[unit] for value in values if value}
        if reciprocal:
            # run-1-30s: 1/30 s, or run 1 at 30 s
            seconds = {1 / value for value in seconds} | (seconds if before.endswith("-") else set())
        elif unit in ("s", "sec") and number.isdigit() and _ONE_BEFORE.search(before):
            seconds |= {1 / value for value in seconds}  # 1_8000s
        found |= set(map(float, seconds))
    stated = _EXPOSURE_WITHOUT_UNIT.findall(name.lower())
    return found | {float(value) for number in stated for value in _readings(number) if value}


def _numbers(pattern: re.Pattern[str], name: str) -> set[float]:
    return {float(value) for number in pattern.findall(name.lower()) for value in _readings(number)}


def _readings(number: str) -> set[Fraction]:
    """Return the numbers that a text can mean: its comma is decimal, or separates thousands."""
    found = set()
    if number.count(",") + number.count(".") <= 1:
        found.add(Fraction(number.replace(",", ".")))
    if _THOUSANDS.fullmatch(number):
        found.add(Fraction(number.replace(",", "")))
    return found


_LISTED = "or list it in a protocol.yaml"
_SEARCHES: dict[str, tuple[Callable[[str], set[Any]], str, str]] = {
    "kind": (kinds_in_name, "both dark and light", f"Rename it, {_LISTED}"),
    "exposure_s": (
        _exposures,
        "two exposure times",
        f"Write 1-8000s for 1/8000 s, 0.5s for half a second, 8000s_1 for number 1 at 8000 s, {_LISTED}",
    ),
    "gain_setting": (partial(_numbers, _GAIN), "two gain settings", f"Write gain_2.5_10ms, {_LISTED}"),
    "temperature_c": (partial(_numbers, _TEMPERATURE), "two temperatures", f"Write 21.5C, {_LISTED}"),
}
"""By setting: how its values are found in a name, and the problem and hint where there are two."""
