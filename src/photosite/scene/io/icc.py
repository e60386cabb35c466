"""ICC profiles (ICC.1:2022, and version 2) of red, green and blue: which known space their numbers are.

A profile is known by its own colorants and tone curves, whatever it is called. Those of tables (LUT) are not.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.colour_science import colour_science
from photosite.errors import FileError
from photosite.scene.picture_colors import SPACES, linear_srgb_of, primaries_to_xyz

Array = NDArray[np.float64]

_D50_XYZ = (0.9642, 1.0, 0.8249)
"""White of the profile connection space (ICC.1:2022, 7.2.16)."""
_COLORANTS = 2e-3
"""Each of X, Y and Z of each colorant may be off by this; the known spaces lie 0.05 apart or more."""
_CURVE = 1e-3
"""Light may be off by this of white's; a gamma of 2.2 is off sRGB's curve by 0.008."""
_TABLES = (b"A2B0", b"A2B1", b"A2B2", b"D2B0", b"D2B1", b"D2B2", b"D2B3")
_PARAMETERS = (1, 3, 4, 5, 7)
"""Of a parametric curve, by its kind (ICC.1:2022, 10.18)."""
_HDR = (16, 18)
"""Transfer characteristics of Rec. ITU-T H.273: PQ and HLG, of which the curves tell nothing."""
_STEPS = np.linspace(0.0, 1.0, 256)


@dataclass(frozen=True)
class RgbSpace:
    """What red, green and blue mean: a name of `photosite.scene.picture_colors.SPACES`, and whether they are light."""

    name: str
    linear: bool = False


SRGB = RgbSpace("sRGB")


class _DamagedError(ValueError):
    """A profile whose bytes make none."""


def space_of_profile(path: Path, profile: bytes) -> RgbSpace:
    """The space of a file's profile.

    Raises
    ------
    FileError
        If the profile is damaged, or of no known space.
    """
    known = ", ".join(dict.fromkeys(SPACES.values()))
    advice = f"known are {known}, encoded or linear: save the picture in one of them"
    try:
        tags = _tags(profile)
        name = f"the ICC profile '{_name(tags)}'"
        if profile[16:20] != b"RGB " or any(tag in tags for tag in _TABLES) or b"rXYZ" not in tags:
            raise FileError(path, f"has {name}, which is no matrix of red, green and blue with their curves; {advice}")
        if len(told := tags.get(b"cicp", b"")) >= 10 and told[9] in _HDR:
            raise FileError(path, f"has {name}, which is of an HDR picture; {advice}")
        colorants = np.stack([_xyz(tags, tag) for tag in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1)
        curves = [_curve(tags, tag) for tag in (b"rTRC", b"gTRC", b"bTRC")]
    except (_DamagedError, struct.error, IndexError) as error:
        raise FileError(path, f"has an ICC profile that cannot be read ({error}); save the picture as sRGB") from None
    space = next((s for s, own in _known_colorants().items() if np.abs(colorants - own).max() <= _COLORANTS), None)
    if space is None:
        raise FileError(path, f"has {name}, whose red, green and blue are of no known space; {advice}")
    for linear in (False, True):
        wanted = _STEPS if linear else _known_curve(space)
        if all(np.abs(curve - wanted).max() <= _CURVE for curve in curves):
            return RgbSpace(space, linear)
    raise FileError(path, f"has {name}, whose colours are those of {space} and whose tone curves are not; {advice}")


@lru_cache(maxsize=1)
def _known_colorants() -> dict[str, Array]:
    """By the space's name: (XYZ, 3) of its red, green and blue, adapted to D50."""
    spaces = colour_science().RGB_COLOURSPACES
    asked = {found: name for name, found in reversed(SPACES.items())}  # the shorter of two names
    return {
        name: primaries_to_xyz(spaces[found].primaries, spaces[found].whitepoint, _D50_XYZ)
        for found, name in asked.items()
    }


@lru_cache(maxsize=8)
def _known_curve(space: str) -> Array:
    grey = np.repeat(_STEPS[None, :, None], 3, axis=2)
    return linear_srgb_of(grey, space, linear=False)[0, :, 1]


def _tags(profile: bytes) -> dict[bytes, bytes]:
    """Content of each tag, by its signature."""
    if profile[36:40] != b"acsp" or len(profile) < 132:
        raise _DamagedError("no profile has such a head")
    (count,) = struct.unpack_from(">I", profile, 128)
    if 132 + 12 * count > len(profile):
        raise _DamagedError("it is cut off")
    tags = {}
    for number in range(count):
        tag, start, size = struct.unpack_from(">4sII", profile, 132 + 12 * number)
        if start + size > len(profile):
            raise _DamagedError("it is cut off")
        tags[tag] = profile[start : start + size]
    return tags


def _xyz(tags: dict[bytes, bytes], tag: bytes) -> Array:
    content = tags.get(tag, b"")
    if content[:4] != b"XYZ " or len(content) < 20:
        raise _DamagedError(f"no colour in its {tag.decode()}")
    return np.array(struct.unpack_from(">3i", content, 8)) / 65536.0


def _curve(tags: dict[bytes, bytes], tag: bytes) -> Array:
    """Light at even steps of the encoded value."""
    content = tags.get(tag, b"")
    if content[:4] == b"curv":
        (count,) = struct.unpack_from(">I", content, 8)
        if count == 0:
            return _STEPS
        if 12 + 2 * count > len(content):
            raise _DamagedError(f"its {tag.decode()} is cut off")
        values = np.frombuffer(content, ">u2", count, 12).astype(np.float64)
        if count == 1:
            return np.asarray(_STEPS ** (values[0] / 256.0), dtype=np.float64)
        return np.interp(_STEPS, np.linspace(0.0, 1.0, count), values / 65535.0)
    if content[:4] == b"para":
        (kind,) = struct.unpack_from(">H", content, 8)
        if kind >= len(_PARAMETERS):
            raise _DamagedError(f"its {tag.decode()} is a curve of an unknown kind {kind}")
        values = np.array(struct.unpack_from(f">{_PARAMETERS[kind]}i", content, 12)) / 65536.0
        return _parametric(kind, values)
    raise _DamagedError(f"no curve in its {tag.decode()}")


def _parametric(kind: int, values: Array) -> Array:
    """(a x + b)^g + e from x = d on, c x + f below it; what a kind does not have is 0, and a is 1."""
    g, a, b, c, d, e, f = [float(value) for value in values] + [0.0] * (7 - values.size)
    if kind == 0:
        a = 1.0
    elif kind in (1, 2):  # from where a x + b is 0; the second's c is added on both sides
        if a == 0:
            raise _DamagedError("a curve of no slope")
        d, e, f, c = -b / a, c, c, 0.0
    upper = np.clip(a * _STEPS + b, 0.0, None)
    with np.errstate(all="ignore"):
        light = np.where(d <= _STEPS, upper**g + e, c * _STEPS + f)
    return np.asarray(np.clip(np.nan_to_num(light, nan=np.inf), 0.0, 1.0), dtype=np.float64)


def _name(tags: dict[bytes, bytes]) -> str:
    """The profile's description, for messages."""
    content = tags.get(b"desc", b"")
    if content[:4] == b"mluc" and len(content) >= 28:
        size, start = struct.unpack_from(">II", content, 20)
        text = content[start : start + size].decode("utf-16-be", errors="replace")
    else:
        text = content[12 : 12 + int.from_bytes(content[8:12], "big")].decode("latin-1")
    shown = "".join(letter for letter in text if letter.isprintable()).strip()
    return shown[:60] or "without a name"
