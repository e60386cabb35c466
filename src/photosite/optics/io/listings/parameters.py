"""ISETPARMS.txt: assignments in Matlab's words, of which `photosite.optics.io.listings.ray_trace` makes a lens.

lensFile='EO54852.ZMX';     %Lens file name
psfSpacing=0.0002500;   % PSF GRID SPACING IN MM
wave=400:50:700;            % WAVELENGTH SAMPLES (NM)
imgHeightNum=13;             % Number of IMAGE HEIGHTS

CODE V's macro has the heights as a range, imgHeight=0:0.25:3, and no semicolons.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from photosite.errors import FileError
from photosite.optics.io.listings.text import NUMBER, number, read_text

_ASSIGNMENT = re.compile(r"""^\s*"?\s*([A-Za-z]\w*)\s*(\([^)]*\))?\s*=\s*(?:'([^']*)'?|([^;%"]*))""")
_OWN = re.compile(r"^\s*\"?\s*(?:baseLensFileName|psfSize|imgHeight(?:Num|Max)?|fnumber_eff)\s*=", re.MULTILINE)
_SAME_NM = 0.6
"""The macros round wavelengths to whole nanometres."""
_MOST_HEIGHTS = 10_000


@dataclass(frozen=True)
class Parameters:
    """What the file says, in its units.

    Parameters
    ----------
    program
        Whose macro wrote it, by how it says the heights: Zemax's have their number, CODE V's a range.
    base_name
        What the other files' names begin with; may have a folder of Windows before it.
    lens_file
        Of the design.
    focal_length_mm, f_number
        Effective focal length; over the entrance pupil's diameter.
    magnification
        0 for far objects, else below 0.
    object_distance_mm
        From the first surface.
    reference_nm
        The design's reference wavelength.
    wavelengths_nm
        First, step, last.
    heights, largest_height_mm
        How many ideal image heights, evenly from 0 to the largest.
    samples, spacing_mm
        Of point spreads, as asked for.
    """

    program: Literal["zemax", "codev"]
    base_name: str
    lens_file: str
    focal_length_mm: float
    f_number: float
    magnification: float
    object_distance_mm: float
    reference_nm: float
    wavelengths_nm: tuple[float, float, float]
    heights: int
    largest_height_mm: float
    samples: int
    spacing_mm: float


def is_parameters(path: Path) -> bool:
    """Whether this text file assigns what only ISETPARMS.txt does."""
    try:
        return _OWN.search("\n".join(read_text(path, "a text"))) is not None
    except FileError:
        return False


def read_parameters(path: Path) -> Parameters:
    """The parameters.

    Raises
    ------
    FileError
        If one is missing or is not what it should be; with the line.
    """
    told = _Told(path)
    if told.several_distances:
        raise FileError(path, "is of several object distances (the 3D macro); sets of one distance are read (the 2D)")
    heights, largest = told.heights()
    reference, waves = told.positive("refWave"), told.wavelengths()
    if not waves[0] - _SAME_NM <= reference <= waves[2] + _SAME_NM:
        raise told.error("refWave", f"in nm and one of those in wave, {waves[0]:g} to {waves[2]:g}")
    return Parameters(
        program="codev" if "imgHeight" in told.values else "zemax",
        base_name=told.text("baseLensFileName"),
        lens_file=told.text("lensFile") if "lensFile" in told.values else "",
        focal_length_mm=told.positive("efl"),
        f_number=told.positive("fnumber"),
        magnification=told.numbers("mag", 1)[0],
        object_distance_mm=told.positive("objDist"),
        reference_nm=reference,
        wavelengths_nm=waves,
        heights=heights,
        largest_height_mm=largest,
        samples=told.count("psfSize"),
        spacing_mm=told.positive("psfSpacing"),
    )


class _Told:
    """The file's assignments with their lines."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.values: dict[str, tuple[str, int]] = {}
        self.several_distances = False
        for index, line in enumerate(read_text(path, "ISETPARMS.txt")):
            if (match := _ASSIGNMENT.match(line)) is None:
                continue
            name, element, quoted, bare = match.groups()
            if element is not None:
                self.several_distances |= name == "objDist"
                continue
            self.values[name] = ((bare if quoted is None else quoted).strip(), index + 1)

    def text(self, name: str) -> str:
        if name not in self.values:
            raise FileError(self.path, f"does not set {name}; export the whole set again")
        return self.values[name][0]

    def error(self, name: str, expected: str) -> FileError:
        value, line = self.values[name]
        return FileError(self.path, f"{name} is {expected}, not '{value:.40}'", line)

    def numbers(self, name: str, count: int) -> list[float]:
        """A number, or that many with colons between."""
        parts = [part.strip() for part in self.text(name).split(":")]
        if len(parts) == count and all(re.fullmatch(NUMBER, part) for part in parts):
            values = [number(part) for part in parts]
            if all(map(math.isfinite, values)):
                return values
        raise self.error(name, "a number" if count == 1 else "first:step:last")

    def positive(self, name: str) -> float:
        value = self.numbers(name, 1)[0]
        if value <= 0:
            raise self.error(name, "above 0")
        return value

    def count(self, name: str) -> int:
        value = self.numbers(name, 1)[0]
        if value != int(value) or not 2 <= value <= _MOST_HEIGHTS:
            raise self.error(name, f"a whole number from 2 to {_MOST_HEIGHTS}")
        return int(value)

    def wavelengths(self) -> tuple[float, float, float]:
        if ":" not in self.text("wave"):
            alone = self.positive("wave")
            return alone, 0.0, alone
        first, step, last = self.numbers("wave", 3)
        if not 0 < first <= last:
            raise self.error("wave", "first:step:last in nm, increasing")
        return first, step, last

    def heights(self) -> tuple[int, float]:
        """How many, and the largest."""
        if "imgHeight" not in self.values:
            return self.count("imgHeightNum"), self.positive("imgHeightMax")
        first, step, last = self.numbers("imgHeight", 3)
        if first != 0 or not 0 < step <= last or last / step > _MOST_HEIGHTS:
            raise self.error("imgHeight", f"0:step:last in mm, at most {_MOST_HEIGHTS} heights")
        return round(last / step) + 1, last
