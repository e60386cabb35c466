"""Dark or light, told by the level of the frames where nothing says it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photosite.errors import FileError
from photosite.frames.frame_set import FrameSource, Kind

DARK_SPREADS, LIGHT_SPREADS = 1.0, 5.0
"""Above the darkest frame, in units of its pixels' spread: up to here a frame is dark, from here on light."""

DARKEST_SHARE = 0.25
"""Share of the converter's range above which the darkest frame is no dark one."""

_LEAST_SPREAD_DN = 12**-0.5
"""Of whole numbers."""

_NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class Candidate:
    """A frame of one gain setting whose kind may not be known."""

    source: FrameSource
    gain_setting: float | None
    kind: Kind | None


def told_by_level(frames: Sequence[Candidate], bits: int) -> tuple[list[Kind], tuple[str, ...]]:
    """The kind of every frame; those that are not known are read once and told by their level.

    The reference of a gain setting is its first frame known to be dark, or else its darkest. A frame no more than
    `DARK_SPREADS` of the reference's pixel spread above it is dark, one more than `LIGHT_SPREADS` above it light.

    Returns
    -------
    list of str, tuple of str
        The kinds, and what is to be said aloud of how they were told.

    Raises
    ------
    FileError
        If a frame is between the two, the darkest frame is too bright to be dark, or one cannot be read.
    """
    kinds = [frame.kind for frame in frames]
    levels: dict[int, float] = {}
    for gain in dict.fromkeys(frame.gain_setting for frame in frames if frame.kind is None):
        here = [n for n, frame in enumerate(frames) if frame.gain_setting == gain]
        unknown = [n for n in here if frames[n].kind is None]
        levels |= {n: float(frames[n].source.read().mean()) for n in unknown}
        dark = next((n for n in here if frames[n].kind == "dark"), min(unknown, key=levels.__getitem__))
        level, spread = _level_and_spread(frames[dark].source)
        if level > DARKEST_SHARE * (1 << bits):
            reads = f"reads {level:.1f} DN on average, too much for a dark frame, and it is the darkest"
            raise FileError(frames[dark].source.name, f"{reads}; {_MEND}")
        for n in unknown:
            kinds[n] = _kind(frames[n].source.name, levels[n] - level, spread, level)
    told: list[Kind] = ["dark" if kind == "dark" else "light" for kind in kinds]
    return told, _said(told, levels)


_MEND = "say which frames are dark and which are light: --dark and --light patterns, names, or a protocol.yaml"


def _level_and_spread(source: FrameSource) -> tuple[float, float]:
    """Mean, and standard deviation over pixels as hot ones do not change it."""
    dn = source.read().astype(np.float64)
    spread = _NORMAL_MAD * float(np.median(np.abs(dn - np.median(dn))))
    return float(dn.mean()), max(spread, _LEAST_SPREAD_DN)


def _kind(name: str, above: float, spread: float, level: float) -> Kind:
    if above <= DARK_SPREADS * spread:
        return "dark"
    if above > LIGHT_SPREADS * spread:
        return "light"
    found = f"{above:.2f} DN above the darkest frames' {level:.2f} DN, whose pixels spread by {spread:.2f} DN"
    raise FileError(name, f"dark or light? Neither file nor name says, and it reads {found}; {_MEND}")


def _said(kinds: Sequence[Kind], levels: dict[int, float]) -> tuple[str, ...]:
    if not levels:
        return ()
    parts = []
    for kind in ("dark", "light"):
        own = [level for n, level in levels.items() if kinds[n] == kind]
        if own:
            parts.append(f"{len(own)} as {kind} (mean {min(own):.1f} to {max(own):.1f} DN)")
    return (
        f"dark or light was told by level, as neither files nor names say it: {' and '.join(parts)} were taken; "
        f"--dark and --light patterns or a protocol say otherwise",
    )
