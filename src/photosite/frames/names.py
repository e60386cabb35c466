"""What the names of files and folders say of the frames in them.

| in a name | says |
|---|---|
| dark, darks, bias, `d_012` | a dark frame |
| light, lights, flat, flats, bright, `b_012` | a light frame |
| `10ms`, `0.04s`, `250us`, `exp40000ns`, `1-8000s` (1/8000 s) | the exposure time |
| `iso400`, `gain_2.5`, `gain12dB` | the gain setting |
| `20C`, `_-10C`, `temp_21.5degC` | the sensor's temperature in degrees Celsius |

A word stands alone: between the ends of the name, spaces, underscores, hyphens and the like.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

from photosite.errors import FileError
from photosite.frames.frame_set import Kind

Value = TypeVar("Value")

_KIND_WORDS: dict[str, Kind] = {
    "dark": "dark",
    "darks": "dark",
    "bias": "dark",
    "light": "light",
    "lights": "light",
    "flat": "light",
    "flats": "light",
    "bright": "light",
}
_EMVA_KINDS: dict[str, Kind] = {"d": "dark", "b": "light"}

_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_END = r"(?![a-z0-9])"
_SECONDS = {"s": 1, "sec": 1, "ms": 10**3, "us": 10**6, "µs": 10**6, "μs": 10**6, "ns": 10**9}
_EMVA_KIND = re.compile(r"^([bd])_\d+" + _END)
_EXPOSURE = re.compile(
    rf"(?<![a-z0-9.])(?:(?:exposure|exp|t)[_=]?)?(1-(?=\d+s))?({_NUMBER})_?({'|'.join(_SECONDS)}){_END}"
)
_GAIN = re.compile(rf"(?<![a-z0-9])(?:iso|gain)[-_= ]?({_NUMBER})(?:db)?(?![a-z0-9]|\.\d)")
_TEMPERATURE = re.compile(rf"(?:^|[_ ])(?:temp|t)?[_=]?(-?{_NUMBER})_?(?:degc|c){_END}")


@dataclass(frozen=True)
class NamedSettings:
    """The settings that a frame's names tell; None where they tell nothing."""

    kind: Kind | None = None
    exposure_s: float | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None


def settings_in_names(path: Path, names: Iterable[str]) -> NamedSettings:
    """What names say, the first that speaks of a setting being the one heard.

    Parameters
    ----------
    path
        The file, for messages.
    names
        From the nearest to the farthest: the dataset's, the file's without its ending, the folder's.

    Raises
    ------
    FileError
        If one name says two kinds, exposures, gains or temperatures.

    Examples
    --------
    >>> settings_in_names(Path("x"), ["flat_10ms_001", "iso400"])
    NamedSettings(kind='light', exposure_s=0.01, gain_setting=400.0, temperature_c=None)
    >>> settings_in_names(Path("x"), ["dark_1-8000s_001"])
    NamedSettings(kind='dark', exposure_s=0.000125, gain_setting=None, temperature_c=None)
    """
    every = list(names)
    return NamedSettings(
        _first(path, every, kinds_named, "both dark and light"),
        _first(path, every, _exposures, "two exposure times"),
        _first(path, every, lambda name: _numbers(_GAIN, name), "two gain settings"),
        _first(path, every, lambda name: _numbers(_TEMPERATURE, name), "two temperatures"),
    )


def kinds_named(name: str) -> set[Kind]:
    """The kinds that words of a name tell.

    Examples
    --------
    >>> kinds_named("Flat Field 2"), kinds_named("d_003_snap_1"), kinds_named("darkroom")
    ({'light'}, {'dark'}, set())
    """
    lower = name.lower()
    found = {_KIND_WORDS[word] for word in re.findall("[a-z]+", lower) if word in _KIND_WORDS}
    if not found and (emva := _EMVA_KIND.match(lower)):
        found = {_EMVA_KINDS[emva[1]]}
    return found


def _first(path: Path, names: Iterable[str], told: Callable[[str], set[Value]], many: str) -> Value | None:
    for name in names:
        values = told(name)
        if len(values) > 1:
            raise FileError(path, f"says {many} in its name, '{name}'; rename it, or list it in a protocol.yaml")
        if values:
            return values.pop()
    return None


def _exposures(name: str) -> set[float]:
    found = set()
    for match in _EXPOSURE.finditer(name.lower()):
        reciprocal, number, unit = match.groups()
        seconds = Fraction(number) / _SECONDS[unit]
        if not seconds:
            continue
        found.add(float(1 / seconds if reciprocal else seconds))
        if reciprocal and name[: match.start()].endswith("-"):
            found.add(float(seconds))  # run-1-30s: 1/30 s, or run 1 at 30 s?
    return found


def _numbers(pattern: re.Pattern[str], name: str) -> set[float]:
    return {float(number) for number in pattern.findall(name.lower())}
