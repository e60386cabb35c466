"""Settings in the names of files and folders.

| part of a name | setting |
|---|---|
| dark, darks, bias, `d_012` | a dark frame |
| light, lights, flat, flats, bright, `b_012` | a light frame |
| `10ms`, `0.04s`, `250us`, `exp40000ns`, `1-8000s` (1/8000 s) | exposure time |
| `iso400`, `gain_2.5`, `gain12dB` | gain setting |
| `20C`, `_-10C`, `temp_21.5degC` | sensor temperature in degrees Celsius |

Parts are separated by spaces, underscores, hyphens and similar characters.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

from photosite.errors import FileError
from photosite.frames.frame_settings import FrameSettings, Kind

Value = TypeVar("Value")

_KIND_WORDS: dict[str, Kind] = {
    **dict.fromkeys(("dark", "darks", "bias"), "dark"),
    **dict.fromkeys(("light", "lights", "flat", "flats", "bright"), "light"),
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


def settings_from_names(path: Path, names: Iterable[str]) -> FrameSettings:
    """Return the settings that names state; the first name that states a setting decides.

    Parameters
    ----------
    path
        The file, for messages.
    names
        From the most specific to the least: dataset, file without its suffix, folder.

    Examples
    --------
    >>> found = settings_from_names(Path("x"), ["flat_10ms_001", "iso400"])
    >>> found.kind, found.exposure_s, found.gain_setting
    ('light', 0.01, 400.0)
    """
    every = list(names)
    return FrameSettings(
        kind=_first(path, every, kinds_in_name, "both dark and light"),
        exposure_s=_first(path, every, _exposures, "two exposure times"),
        gain_setting=_first(path, every, lambda name: _numbers(_GAIN, name), "two gain settings"),
        temperature_c=_first(path, every, lambda name: _numbers(_TEMPERATURE, name), "two temperatures"),
    )


def kinds_in_name(name: str) -> set[Kind]:
    """Return the kinds that words of a name state.

    Examples
    --------
    >>> kinds_in_name("Flat Field 2"), kinds_in_name("d_003_snap_1"), kinds_in_name("darkroom")
    ({'light'}, {'dark'}, set())
    """
    lower = name.lower()
    found = {_KIND_WORDS[word] for word in re.findall("[a-z]+", lower) if word in _KIND_WORDS}
    if not found and (emva := _EMVA_KIND.match(lower)):
        found = {_EMVA_KINDS[emva[1]]}
    return found


def _first(path: Path, names: Iterable[str], find: Callable[[str], set[Value]], many: str) -> Value | None:
    for name in names:
        values = find(name)
        if len(values) > 1:
            raise FileError(path, f"the name '{name}' states {many}", hint="Rename it, or list it in a protocol.yaml")
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
            found.add(float(seconds))  # ambiguous: run-1-30s is 1/30 s, or run 1 at 30 s
    return found


def _numbers(pattern: re.Pattern[str], name: str) -> set[float]:
    return {float(number) for number in pattern.findall(name.lower())}
