"""Rectangles of a stored image, as files, protocols and options state them, and the lines around the one with light."""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike

from photosite.errors import FileError, InputError
from photosite.values.region import Border

_RANGE = re.compile(r"(\d+)\s*:\s*(\d+)")

REGION_FORM = "'[x1:x2,y1:y2]' counted from 1, or 'row:row,col:col' counted from 0 without the last ones"


@dataclass(frozen=True)
class Section:
    """Rows top to bottom and columns left to right, counted from 0; bottom and right are the ones after the last.

    `flipped` is whether the rows, and the columns, are in reversed order, as in CCDSEC of some amplifiers.
    """

    top: int
    bottom: int
    left: int
    right: int
    flipped: tuple[bool, bool] = (False, False)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.bottom - self.top, self.right - self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of the section in an image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def overlap(self, other: Section) -> Section | None:
        """Return the common part, or None."""
        top, bottom = max(self.top, other.top), min(self.bottom, other.bottom)
        left, right = max(self.left, other.left), min(self.right, other.right)
        return Section(top, bottom, left, right) if top < bottom and left < right else None

    def border(self, shape: tuple[int, int]) -> Border:
        """Return the lines around the section in an image of (rows, cols)."""
        return self.top, shape[0] - self.bottom, self.left, shape[1] - self.right

    def __str__(self) -> str:
        rows, cols = ((self.top + 1, self.bottom), (self.left + 1, self.right))
        y, x = (f"{b}:{a}" if flip else f"{a}:{b}" for (a, b), flip in zip((rows, cols), self.flipped, strict=True))
        return f"[{x},{y}]"


def parse_section(text: str, shape: tuple[int, int] | None = None) -> Section:
    """Return a section in IRAF's notation: [first:last column, first:last row] counted from 1, the last ones included.

    An asterisk is all columns or rows of an image of (rows, cols), a single number one of them.

    Raises
    ------
    InputError
        If the text is no section, or one outside the image.

    Examples
    --------
    >>> parse_section("[9:79,5:58]").border((60, 80))
    (4, 2, 8, 1)
    >>> parse_section("[2048:1,*]", (100, 2048))
    Section(top=0, bottom=100, left=0, right=2048, flipped=(False, True))
    """
    within = "" if shape is None else f" within {shape[1]} columns and {shape[0]} rows"
    error = InputError("section", value=text, expected=f"[a:b,c:d]{within}")
    parts = text.strip().removeprefix("[").removesuffix("]").split(",")
    if len(parts) != 2 or not (text.strip().startswith("[") and text.strip().endswith("]")):
        raise error
    ends = []
    for part, size in zip(parts, (None, None) if shape is None else shape[::-1], strict=True):
        part = part.strip()
        if part in ("*", "-*") and size is not None:
            first, last = (1, size) if part == "*" else (size, 1)
        elif part.isdecimal():
            first = last = int(part)
        elif found := _RANGE.fullmatch(part):
            first, last = map(int, found.groups())
        else:
            raise error
        if min(first, last) < 1 or (size is not None and max(first, last) > size):
            raise error
        ends.append((first, last))
    (x1, x2), (y1, y2) = ends
    flipped = y2 < y1, x2 < x1
    return Section(min(y1, y2) - 1, max(y1, y2), min(x1, x2) - 1, max(x1, x2), flipped)


def parse_region(text: str) -> Section:
    """Return the region of an option or protocol: IRAF's notation, or row:row,col:col counted from 0 as in NumPy.

    Raises
    ------
    InputError
        If the text has neither form, or the region is empty.

    Examples
    --------
    >>> parse_region("[1:200,1:160]") == parse_region("0:160,0:200")
    True
    """
    error = InputError("region", value=text, expected=REGION_FORM, hint="[1:200,1:160] and 0:160,0:200 are the same")
    if text.strip().startswith("["):
        try:
            found = parse_section(text)
        except InputError:
            raise error from None
        if any(found.flipped):
            raise error
        return found
    parts = [_RANGE.fullmatch(part.strip()) for part in text.split(",")]
    if len(parts) != 2 or None in parts:
        raise error
    (top, bottom), (left, right) = (map(int, part.groups()) for part in parts if part is not None)
    if top >= bottom or left >= right:
        raise error
    return Section(top, bottom, left, right)


def section_with_light(
    shape: tuple[int, int], data: Section | None, trim: Section | None, bias: Section | None
) -> Section:
    """Return the part of an image of (rows, cols) that receives light.

    It is the common part of DATASEC and TRIMSEC, without the overscan of BIASSEC, which must lie at an edge of it.

    Raises
    ------
    InputError
        If nothing is left, or BIASSEC lies inside the others.

    Examples
    --------
    >>> print(section_with_light((160, 232), None, None, parse_section("[201:232,1:160]")))
    [1:200,1:160]
    """
    found: Section | None = Section(0, shape[0], 0, shape[1])
    for part in (data, trim):
        if part is not None and found is not None:
            found = found.overlap(part)
    if found is None:
        raise InputError("DATASEC and TRIMSEC have no pixel in common")
    shared = None if bias is None else found.overlap(bias)
    if shared is None:
        return found
    whole_rows, whole_cols = shared.shape[1] == found.shape[1], shared.shape[0] == found.shape[0]
    top, bottom, left, right = found.top, found.bottom, found.left, found.right
    if whole_rows and not whole_cols and top == shared.top:
        top = shared.bottom
    elif whole_rows and not whole_cols and bottom == shared.bottom:
        bottom = shared.top
    elif whole_cols and not whole_rows and left == shared.left:
        left = shared.right
    elif whole_cols and not whole_rows and right == shared.right:
        right = shared.left
    else:
        expected = f"at an edge of {found}, the lines with light"
        if not whole_cols or whole_rows:
            raise InputError("BIASSEC", value=str(bias), expected=expected)
        hint = "If amplifiers on both sides share it, take each side by itself: {region}"
        side = f"{top}:{bottom},{left}:{shared.left}"
        raise InputError("BIASSEC", value=str(bias), expected=expected, hint=hint, arguments={"region": side})
    return Section(top, bottom, left, right)


def lines_around(region: Section, shape: tuple[int, int], border: Border | None, where: str | PathLike[str]) -> Border:
    """Return the lines of a frame around a region of the stored image, which has a border around the frame.

    Raises
    ------
    FileError
        If the region has lines outside the frame.
    """
    top, bottom, left, right = border or (0, 0, 0, 0)
    light = Section(top, top + shape[0], left, left + shape[1])
    if region.overlap(light) != Section(region.top, region.bottom, region.left, region.right):
        stored = f"the stored image has {shape[0] + top + bottom} rows and {shape[1] + left + right} columns"
        lit = f", of which the file states that {light} receive light" if border else ""
        raise FileError(where, "region", value=str(region), expected=f"within {light}: {stored}{lit}")
    return region.top - top, light.bottom - region.bottom, region.left - left, light.right - region.right
