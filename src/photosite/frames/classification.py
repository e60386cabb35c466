"""Classification of frames as dark or light by their signal level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.frame_set import FrameSource
from photosite.frames.frame_settings import FrameSettings, Kind

DARK_SPREADS, LIGHT_SPREADS = 1.0, 5.0
"""Limits above the darkest frame, in units of its pixel spread: dark up to the first, light above the second."""

DARKEST_SHARE = 0.25
"""Largest level of a dark frame, as a share of the converter's range."""

_LEAST_SPREAD_DN = 12**-0.5
"""Standard deviation of rounding to whole numbers."""

_NORMAL_MAD = 1.4826
"""Ratio of standard deviation to median absolute deviation of a normal distribution."""

_HINT = "Pass {dark} and {light}, name the files after their kind, or write a protocol.yaml"
_ARGUMENTS = {"dark": "dark*", "light": "flat*"}


def classify_by_level(
    frames: Sequence[tuple[FrameSource, FrameSettings]], bits: int
) -> tuple[list[FrameSettings], PhotositeWarning | None]:
    """Complete the kind of frames by their mean level, with a warning if any were classified.

    Frames without a kind are read once. The reference of each gain setting is its first frame known to be dark, or else
    its darkest frame. A frame at most `DARK_SPREADS` of the reference's pixel spread above the reference is dark, one
    more than `LIGHT_SPREADS` above is light; between the two is an error.
    """
    complete = [settings for _, settings in frames]
    levels: dict[int, float] = {}
    for gain in dict.fromkeys(settings.gain_setting for settings in complete if settings.kind is None):
        same_gain = [n for n, settings in enumerate(complete) if settings.gain_setting == gain]
        unknown = [n for n in same_gain if complete[n].kind is None]
        levels |= {n: float(frames[n][0].read().mean()) for n in unknown}
        dark = next((n for n in same_gain if complete[n].kind == "dark"), min(unknown, key=levels.__getitem__))
        reference, spread = _level_and_spread(frames[dark][0])
        if reference > DARKEST_SHARE * (1 << bits):
            problem = f"the darkest frame has a mean of {reference:.1f} DN, too high for a dark frame"
            raise FileError(frames[dark][0].name, problem, hint=_HINT, arguments=_ARGUMENTS)
        for n in unknown:
            kind = _kind(frames[n][0].name, levels[n] - reference, spread, reference)
            complete[n] = replace(complete[n], kind=kind)
    return complete, _warning(complete, levels)


def _level_and_spread(source: FrameSource) -> tuple[float, float]:
    """Return the mean, and the standard deviation over pixels, robust to hot pixels."""
    dn = source.read().astype(np.float64)
    spread = _NORMAL_MAD * float(np.median(np.abs(dn - np.median(dn))))
    return float(dn.mean()), max(spread, _LEAST_SPREAD_DN)


def _kind(name: str, above: float, spread: float, reference: float) -> Kind:
    if above <= DARK_SPREADS * spread:
        return "dark"
    if above > LIGHT_SPREADS * spread:
        return "light"
    problem = (
        f"the frame can be dark or light: its mean is {above:.2f} DN above that of the darkest frame, "
        f"{reference:.2f} DN, with a pixel spread of {spread:.2f} DN"
    )
    raise FileError(name, problem, hint=_HINT, arguments=_ARGUMENTS)


def _warning(settings: Sequence[FrameSettings], levels: dict[int, float]) -> PhotositeWarning | None:
    if not levels:
        return None
    parts = []
    for kind in ("dark", "light"):
        own = [level for n, level in levels.items() if settings[n].kind == kind]
        if own:
            parts.append(f"{len(own)} {kind} (mean {min(own):.1f} to {max(own):.1f} DN)")
    return PhotositeWarning(
        f"neither files nor names state the kind, so frames were classified by level: {' and '.join(parts)}",
        hint="If this is wrong, pass {dark} and {light} or write a protocol.yaml",
        arguments=_ARGUMENTS,
    )
