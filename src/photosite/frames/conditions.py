"""What separates settings of a measurement beside kind, exposure, light and gain: read mode, binning, filter, ..."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, Protocol, TypeVar

from photosite.errors import InputError, did_you_mean
from photosite.frames.frame_settings import ABSOLUTE_ZERO_C, FrameSettings

CONDITIONS: Mapping[str, str] = {
    "camera": "name of the camera",
    "serial_number": "serial number of the camera",
    "part": "amplifier or chip of a file of several",
    "read_mode": "mode of the readout",
    "offset_setting": "the camera's setting of the black level",
    "binning": "columns x rows that are read as one pixel",
    "subframe": "part of the chip that was read, as columns x rows + first column + first row",
    "set_temperature_c": "temperature that the cooler is set to, degrees Celsius",
    "filter": "filter in front of the camera; dark frames go with each",
}
"""Names in `RawFrame.metadata`, protocols and selections, with their meaning."""

Where = str | Sequence[str] | Mapping[str, Any]
"""A selection of frames: "filter=R", "filter=R,binning=2x2", several such texts, or a mapping."""

_OTHERS = ("gain_setting", "unit")
"""Names that select frames and do not separate settings: gain settings are a series, units of a file repeats."""


class OfFrame(Protocol):
    """A frame with the conditions under which it was taken."""

    @property
    def conditions(self) -> Mapping[str, str]:
        """Names and values of `CONDITIONS` that are stated."""

    @property
    def settings(self) -> FrameSettings:
        """Its settings."""

    @property
    def unit(self) -> str:
        """Its number, or numbers, in a file of several frames; empty in a file of one."""


T = TypeVar("T", bound=OfFrame)

NOT_STATED = "not stated"
"""Value of a condition that a frame does not state, where others do."""


def stated_conditions(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the conditions that metadata state, as text.

    Examples
    --------
    >>> stated_conditions({"set_temperature_c": -10.0, "filter": " R ", "seed": 3})
    {'set_temperature_c': '-10', 'filter': 'R'}
    """
    found = {name: metadata[name] for name in CONDITIONS if metadata.get(name) is not None}
    if "camera" not in found and metadata.get("model"):
        found = {"camera": metadata["model"], **found}
    texts = {
        name: _canonical(name, f"{value:g}" if isinstance(value, int | float) else str(value).strip())
        for name, value in found.items()
    }
    if "set_temperature_c" in found and not cooled(found["set_temperature_c"]):
        del texts["set_temperature_c"]
    return {name: text for name, text in texts.items() if text}


def _canonical(name: str, value: str) -> str:
    """Return a binning as 2x2, where it is 2 or 2 X 2; other values as they are."""
    found = re.fullmatch(r"(\d+)(?:\s*[xX×*]\s*(\d+))?", value) if name == "binning" else None
    return value if found is None else f"{int(found[1])}x{int(found[2] or found[1])}"


def cooled(set_temperature_c: Any) -> bool:
    """Return whether a set-point is one, and not what programs write for a camera without a cooler."""
    return not isinstance(set_temperature_c, int | float) or ABSOLUTE_ZERO_C < set_temperature_c < 1000


def parse_where(where: Where) -> dict[str, str]:
    """Return the names and values of a selection; names are of any case, and a binning of 2 is 2x2.

    Raises
    ------
    InputError
        If a text is not NAME=VALUE, no condition has the name, or one is given twice.

    Examples
    --------
    >>> parse_where("filter=R,binning=2x2")
    {'filter': 'R', 'binning': '2x2'}
    """
    if isinstance(where, Mapping):
        pairs = [(str(name), f"{value:g}" if isinstance(value, float) else str(value)) for name, value in where.items()]
    else:
        texts = [where] if isinstance(where, str) else where
        parts = [part for text in texts for part in re.split(r",(?=\s*\w+\s*=)", text)]
        if wrong := next((part for part in parts if "=" not in part), None):
            raise InputError("where", value=wrong, expected="NAME=VALUE, such as filter=R")
        pairs = [(name.strip(), value.strip()) for name, _, value in (part.partition("=") for part in parts)]
    found: dict[str, str] = {}
    for stated, value in pairs:
        name = stated.lower().replace("-", "_")
        if name not in (*CONDITIONS, *_OTHERS):
            hint = did_you_mean(name, (*CONDITIONS, *_OTHERS))
            raise InputError("where", value=stated, expected="the name of a condition", hint=hint)
        if name in found:
            raise InputError("where", value=f"{name}={found[name]},{name}={value}", expected="each name once")
        found[name] = _canonical(name, value)
    return found


def selected(frames: Sequence[T], where: Mapping[str, str]) -> list[T]:
    """Return the frames that a selection names; dark frames without a filter, or with another, go with each filter.

    Raises
    ------
    InputError
        If no frame has a value, with the values that frames have.
    """
    for name, wanted in where.items():
        values = {id(frame): _value(frame, name) for frame in frames}
        chosen = [f for f in frames if _same(values[id(f)], wanted)]
        if not chosen:
            known = ", ".join(dict.fromkeys(values.values()))
            raise InputError("where", value=f"{name}={wanted}", expected=f"a {name} that frames have ({known})")
        if name == "filter":
            kept = {id(frame) for frame in chosen}
            chosen = [f for f in frames if id(f) in kept or f.settings.kind == "dark"]
        frames = chosen
    return list(frames)


def _value(frame: OfFrame, name: str) -> str:
    if name == "gain_setting":
        return NOT_STATED if frame.settings.gain_setting is None else f"{frame.settings.gain_setting:g}"
    return frame.unit if name == "unit" else frame.conditions.get(name, NOT_STATED)


def _same(value: str, wanted: str) -> bool:
    try:
        return float(value) == float(wanted)
    except ValueError:
        return value.casefold() == wanted.casefold()


def separated(frames: Sequence[T], together: Collection[str] = ()) -> list[tuple[dict[str, str], list[T]]]:
    """Return the frames of each setting, with the conditions by which it differs from the others.

    Parameters
    ----------
    frames
        Frames of a measurement.
    together
        Names of conditions that do not separate settings.

    Returns
    -------
    list
        A condition separates frames if two frames or more state different values. Frames that do not state it are a
        setting of their own, "not stated". Dark frames go with the light frames of each filter.
    """
    names = [name for name in CONDITIONS if name not in together and len(_stated(frames, name)) > 1]
    if not names:
        return [({}, list(frames))]

    def key(frame: OfFrame) -> tuple[str, ...]:
        return tuple(frame.conditions.get(name, NOT_STATED) for name in names)

    found = {values: list(same) for values, same in groupby(sorted(frames, key=key), key)}
    if "filter" in names:
        place = names.index("filter")
        darks = [frame for frame in frames if frame.settings.kind == "dark"]
        lit = {values for values, same in found.items() if any(frame.settings.kind != "dark" for frame in same)}

        def others(values: tuple[str, ...]) -> tuple[str, ...]:
            return values[:place] + values[place + 1 :]

        shared = {others(values) for values in lit}
        found = {values: same for values, same in found.items() if values in lit or others(values) not in shared}
        for values in lit:
            own = {id(frame) for frame in found[values]}
            found[values] += [f for f in darks if id(f) not in own and others(key(f)) == others(values)]
    order = {id(frame): number for number, frame in enumerate(frames)}
    return [
        (dict(zip(names, values, strict=True)), sorted(same, key=lambda frame: order[id(frame)]))
        for values, same in found.items()
    ]


def _stated(frames: Iterable[OfFrame], name: str) -> set[str]:
    """Return the values of a condition; a dark frame states no filter."""
    known = (f for f in frames if name != "filter" or f.settings.kind != "dark")
    return {frame.conditions[name] for frame in known if name in frame.conditions}


def label(conditions: Mapping[str, str]) -> str:
    """Return the conditions of a setting as `parse_where` reads them.

    Examples
    --------
    >>> label({"filter": "R", "binning": "2x2"})
    'filter=R,binning=2x2'
    """
    return ",".join(f"{name}={value}" for name, value in conditions.items())
