"""Measured charts as CxF3 (Color Exchange Format, ISO 17972-1): XML of named samples with spectra.

Read are the objects with a reflectance or transmittance spectrum. Wavelengths begin at `StartWL` of the spectrum, else
at that of its color specification, which states the increment; without one it is 10 nm. Objects of several kinds, such
as the measurement conditions M0 and M1, are different measurements of the same samples, of which `variable` names one.
Document type declarations are refused, and with them all entities.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.small_files import read_small
from photosite.scene.io.patch_table import LARGEST_BYTES, PatchTable, checked_names, number
from photosite.scene.units import Units

_SPECTRA = ("ReflectanceSpectrum", "TransmittanceSpectrum", "TransmissionSpectrum")
_INCREMENT_NM = 10.0
_DEEPEST = 64
_BRIGHTEST = 1.3
"""Values above are percent, or ask for the units."""


@dataclass
class _Element:
    """An element with its line; names are without namespaces."""

    name: str
    attributes: Mapping[str, str]
    line: int
    children: list[_Element] = field(default_factory=list)
    parts: list[str] = field(default_factory=list)

    def all(self, *names: str) -> Iterator[_Element]:
        """Yield the elements of some names at any depth."""
        for child in self.children:
            if child.name in names:
                yield child
            yield from child.all(*names)


def read_patches(path: Path, variable: str | None = None) -> PatchTable:
    """Read the spectra of the objects of one kind, `variable`; errors have the line where it is known."""
    root = _parsed(path)
    if root.name != "CxF":
        raise FileError(path, f"is not CxF3: its first element is <{root.name[:40]}>", root.line)
    found = [(each, spectrum) for each in root.all("Object") for spectrum in each.all(*_SPECTRA)]
    if not found:
        raise FileError(path, "has no object with a reflectance spectrum", hint="Export it with spectral data")
    kinds = list(dict.fromkeys(each.attributes.get("ObjectType", "") for each, _ in found))
    chosen = kinds[0] if variable is None else variable
    if chosen not in kinds or (variable is None and len(kinds) > 1):
        what, known = f"has spectra of {len(kinds)} kinds of objects", ", ".join(kinds)
        if variable is not None:
            raise FileError(path, "variable", value=variable, expected=f"a kind of objects with spectra ({known})")
        raise FileError(path, f"{what}: {known}", hint="Pass {variable}", arguments={"variable": kinds[0]})
    found = [(each, spectrum) for each, spectrum in found if each.attributes.get("ObjectType", "") == chosen]
    grids = {
        str(each.attributes.get("Id")): next(each.all("WavelengthRange"), None)
        for each in root.all("ColorSpecification")
    }
    wavelengths, values = None, []
    for _, spectrum in found:
        grid, row = _spectrum(path, spectrum, grids)
        wavelengths = grid if wavelengths is None else wavelengths
        if not np.array_equal(grid, wavelengths):
            what = f"{grid[0]:g} to {grid[-1]:g} nm in {len(grid)} steps"
            raise FileError(path, "wavelengths", spectrum.line, value=what, expected="those of the first spectrum")
        values.append(row)
    assert wavelengths is not None
    names = [each.attributes.get("Name") or each.attributes.get("Id", "") for each, _ in found]
    unique = checked_names(path, [" ".join(name.split()) for name in names], [each.line for each, _ in found])
    table, order, cols = np.array(values), *_places([each for each, _ in found])
    units = Units("reflectance") if np.nanmax(table) <= _BRIGHTEST else None
    return PatchTable(path, tuple(unique[k] for k in order), wavelengths, table[order], units, cols)


def _spectrum(
    path: Path, spectrum: _Element, grids: Mapping[str, _Element | None]
) -> tuple[NDArray[np.float64], list[float]]:
    """Return the wavelengths and the values of a spectrum."""
    shared = grids.get(spectrum.attributes.get("ColorSpecification", ""))
    stated = {**({} if shared is None else shared.attributes), **spectrum.attributes}
    line = spectrum.line
    if "StartWL" not in stated:
        raise FileError(path, "a spectrum states no first wavelength (StartWL)", line)
    first = number(path, stated["StartWL"], line, "StartWL")
    step = number(path, stated.get("Increment", f"{_INCREMENT_NM}"), line, "Increment")
    row = [number(path, word, line, "a value of a spectrum") for word in "".join(spectrum.parts).split()]
    if step <= 0 or first <= 0 or not row:
        expected = "a first wavelength and an increment above 0, and values"
        raise FileError(
            path, "spectrum", line, value=f"{first:g} nm, {step:g} nm, {len(row)} values", expected=expected
        )
    return np.asarray(first + step * np.arange(len(row))), row


def _places(objects: list[_Element]) -> tuple[list[int], int | None]:
    """Return the order of the objects row by row, and their number in a row, where all state a location."""
    found = []
    for each in objects:
        tags = {tag.attributes.get("Name"): tag.attributes.get("Value", "") for tag in each.all("Tag")}
        place = tuple(tags.get(name, "") for name in ("Page", "Row", "Column"))
        found.append(tuple(int(text) if text.isascii() and text.isdigit() else -1 for text in place))
    pages, rows, cols = (set(numbers) for numbers in zip(*found, strict=True))
    if -1 in rows | cols or len(set(found)) < len(found) or len(found) != len(pages) * len(rows) * len(cols):
        return list(range(len(objects))), None
    return sorted(range(len(objects)), key=found.__getitem__), len(cols)


def _parsed(path: Path) -> _Element:
    """Return the first element of an XML file without a document type."""
    content = read_small(path, "a chart's table", LARGEST_BYTES)
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    stack = [_Element("", {}, 0)]

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(stack) > _DEEPEST:
            raise FileError(path, f"has elements in more than {_DEEPEST} others", parser.CurrentLineNumber)
        element = _Element(name.rpartition(" ")[2], attributes, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop()

    def text(characters: str) -> None:
        stack[-1].parts.append(characters)

    def refuse(*_: object) -> None:
        hint = "Remove the DOCTYPE"
        raise FileError(
            path, "has a document type declaration, which CxF3 has not", parser.CurrentLineNumber, hint=hint
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = text, refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise FileError(path, f"is no valid XML: {reason}", error.lineno) from None
    except (LookupError, ValueError) as error:  # an unknown encoding
        raise FileError(path, f"is no valid XML: {error}", 1) from None
    return stack[0].children[0]
