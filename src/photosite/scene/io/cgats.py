"""Measured charts as CGATS text (CGATS.17, ISO 28178, IT8.7, Argyll's .ti3): tables of patches with spectra.

A field of a spectrum is called by its wavelength (`SPECTRAL_NM_380`, `SPECTRAL_NM380`, `SPECTRAL_380`, `SPEC_380`,
`nm380`, `R_380nm`), or wavelength and value alternate (`SPECTRAL_NM SPECTRAL_PCT`, or `SPECTRAL_DEC`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photosite.errors import FileError
from photosite.files.atomic import atomic_path
from photosite.scene.io.patch_table import (
    PatchTable,
    chart_scene,
    checked_names,
    number,
    patch_table,
    patches_across,
    read_text,
)
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.units import Units

_TOKEN = re.compile(r'"([^"]*)"|(\S+)')
_SPECTRAL = re.compile(r"(?:SPECTRAL_NM_?|SPECTRAL_|SPEC_|NM_?|R_?)(\d{3,4}(?:[._]\d+)?)(?:_?NM)?", re.IGNORECASE)
_PAIR = {"SPECTRAL_PCT": Units("reflectance", 0.01), "SPECTRAL_DEC": Units("reflectance")}
_NAMES = ("SAMPLE_NAME", "SAMPLENAME", "SAMPLE_LOC", "SAMPLE_ID", "SAMPLEID")


@dataclass(frozen=True)
class _Section:
    """A table: its keywords, fields, and sets with the lines they end on."""

    keywords: dict[str, str]
    fields: tuple[str, ...]
    sets: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]


def read(path: Path, options: ReadOptions) -> Scene:
    """The chart that a file's patches make.

    Raises
    ------
    FileError
        As `read_patches` and `photosite.scene.io.patch_table.chart_scene`.
    """
    return chart_scene(read_patches(path), options)


def read_patches(path: Path) -> PatchTable:
    """The first table with spectra.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileError
        If there is none, or the file is damaged; with the line where there is one.
    """
    sections = _sections(path, read_text(path))
    if not sections:
        raise FileError(path, "is no CGATS file: it has no BEGIN_DATA_FORMAT; expected tables of patches")
    for section in sections:
        if any(_SPECTRAL.fullmatch(field) for field in section.fields) or "SPECTRAL_NM" in section.fields:
            return _table(path, section)
    fields = ", ".join(sections[0].fields[:8])
    raise FileError(
        path,
        f"holds no spectra, only {fields}; a colour alone does not tell a reflectance: export it with spectral data",
    )


def _sections(path: Path, text: str) -> list[_Section]:
    """All tables of a file."""
    found: list[_Section] = []
    keywords: dict[str, str] = {}
    fields: list[str] = []
    tabs = False
    rows: list[tuple[int, list[str]]] = []
    state, begun = "head", 0
    for line_number, line in enumerate(text.split("\n"), start=1):
        tokens = _tokens(line, tabs and state == "data")
        first = tokens[0].upper() if tokens else ""
        if first in ("BEGIN_DATA_FORMAT", "BEGIN_DATA"):
            state, begun = ("format" if first == "BEGIN_DATA_FORMAT" else "data"), line_number
            fields, rows = ([] if state == "format" else fields), []
        elif first == "END_DATA_FORMAT":
            state = "head"
        elif first == "END_DATA":
            found.append(_section(path, keywords, fields, rows, begun))
            state = "head"
        elif not tokens:
            continue
        elif state == "format":
            tabs = tabs or "\t" in line.strip()
            fields += [token.upper() for token in tokens]
        elif state == "data":
            rows.append((line_number, tokens))
        elif len(tokens) > 1:
            keywords[first] = tokens[1]
    if state != "head":
        raise FileError(path, "is truncated: what begins here has no END line", begun)
    return found


def _tokens(line: str, by_tabs: bool) -> list[str]:
    """Words of a line, quotes taken off, up to a comment; between tabs where names hold unquoted blanks."""
    if by_tabs and "\t" in line:
        return [cell.strip().strip('"') for cell in line.strip("\r\n").rstrip("\t").split("\t")]
    words: list[str] = []
    for match in _TOKEN.finditer(line):
        if match[2] is not None and match[2].startswith("#"):
            break
        words.append(match[2] if match[1] is None else " ".join(match[1].split()))
    return words


def _section(
    path: Path, keywords: dict[str, str], fields: list[str], rows: list[tuple[int, list[str]]], begun: int
) -> _Section:
    if not fields:
        raise FileError(path, "data without BEGIN_DATA_FORMAT, the names of their fields", begun)
    said = keywords.get("NUMBER_OF_FIELDS")
    if said is not None and said != str(len(fields)):
        raise FileError(path, f"NUMBER_OF_FIELDS is {said[:20]}, and {len(fields)} fields are named", begun)
    wanted = keywords.get("NUMBER_OF_SETS")
    odd = next(((line, len(words)) for line, words in rows if len(words) != len(fields)), None)
    if odd is not None:
        words = [word for _, row in rows for word in row]
        if str(len(words) / len(fields)) != f"{wanted}.0":  # sets that run over lines are as many as the file says
            raise FileError(path, f"expected {len(fields)} values, one for each field, got {odd[1]}", odd[0])
        last = rows[-1][0]
        sets = [words[k : k + len(fields)] for k in range(0, len(words), len(fields))]
        return _Section(dict(keywords), tuple(fields), tuple(map(tuple, sets)), (last,) * len(sets))
    if wanted is not None and wanted != str(len(rows)):
        raise FileError(
            path, f"NUMBER_OF_SETS is {wanted[:20]}, and {len(rows)} are there; is the file complete?", begun
        )
    return _Section(
        dict(keywords), tuple(fields), tuple(tuple(words) for _, words in rows), tuple(line for line, _ in rows)
    )


def _table(path: Path, section: _Section) -> PatchTable:
    if not section.sets:
        raise FileError(path, "has spectral fields and no patches")
    if "SPECTRAL_NM" in section.fields:
        wavelengths, columns, said = _pairs(path, section)
        units: Units | None = said
    else:
        matches = [(k, match) for k, field in enumerate(section.fields) if (match := _SPECTRAL.fullmatch(field))]
        columns = [k for k, _ in matches]
        wavelengths = [float(match[1].replace("_", ".")) for _, match in matches]
        units = _norm(path, section.keywords)
    values = [
        [number(path, words[k], line, f"{section.fields[k]}", gaps=True) for k in columns]
        for words, line in zip(section.sets, section.lines, strict=True)
    ]
    across = section.keywords.get("LGOROWLENGTH", "")
    return PatchTable(
        path,
        _names(path, section),
        np.array(wavelengths),
        np.array(values),
        units,
        patches_across(across),
        section.keywords.get("DESCRIPTOR") or None,
    )


def _pairs(path: Path, section: _Section) -> tuple[list[float], list[int], Units]:
    """Wavelengths and columns of the values of a table in which the two alternate."""
    at = [k for k, field in enumerate(section.fields) if field == "SPECTRAL_NM"]
    kinds = {section.fields[k + 1] if k + 1 < len(section.fields) else "" for k in at}
    if len(kinds) != 1 or not kinds <= set(_PAIR):
        raise FileError(path, "SPECTRAL_NM without SPECTRAL_PCT or SPECTRAL_DEC, all of one kind, after it")
    wavelengths: list[float] = []
    for words, line in zip(section.sets, section.lines, strict=True):
        row = [number(path, words[k], line, "SPECTRAL_NM") for k in at]
        if wavelengths and row != wavelengths:
            raise FileError(path, "this patch has other wavelengths than the first; export all with the same", line)
        wavelengths = row
    return wavelengths, [k + 1 for k in at], _PAIR[kinds.pop()]


def _norm(path: Path, keywords: dict[str, str]) -> Units | None:
    """Argyll's scale; of what glows it is none of reflectance."""
    norm = keywords.get("SPECTRAL_NORM")
    if norm is None or keywords.get("DEVICE_CLASS", "").upper() not in ("OUTPUT", "INPUT"):
        return None
    value = number(path, norm, None, "SPECTRAL_NORM")
    if value <= 0:
        raise FileError(path, f"SPECTRAL_NORM is what a perfect white has, above 0, not {norm[:20]}")
    return Units("reflectance", 1 / value)


def _names(path: Path, section: _Section) -> tuple[str, ...]:
    """Of the first field with names that tells the patches apart."""
    present = [section.fields.index(field) for field in _NAMES if field in section.fields]
    for k in present:
        names = [words[k] for words in section.sets]
        if len(set(names)) == len(names) and all(names):
            return tuple(names)
    if present:
        return checked_names(path, [words[present[-1]] for words in section.sets], list(section.lines))
    return tuple(str(k) for k in range(1, len(section.sets) + 1))


def write(scene: Scene, path: Path) -> None:
    """Write the reflectances of a chart's patches.

    Raises
    ------
    FileError
        If the scene has no patches, its reflectance is not known, or the file cannot be written.
    """
    table = patch_table(scene, path)
    if table.units is None or table.units.quantity != "reflectance":
        raise FileError(path, "cannot be written: CGATS holds reflectances, and the scene's are not known; write .csv")
    fields = ["SAMPLE_ID", "SAMPLE_NAME", *(f"SPECTRAL_NM_{wavelength:g}" for wavelength in table.wavelength_nm)]
    lines = ["CGATS.17", 'ORIGINATOR "photosite"', f'DESCRIPTOR "{_plain(table.title or "")}"']
    lines += ['DEVICE_CLASS "INPUT"', 'SPECTRAL_NORM "1"', f'LGOROWLENGTH "{table.cols}"']
    lines += [f"NUMBER_OF_FIELDS {len(fields)}", "BEGIN_DATA_FORMAT", " ".join(fields), "END_DATA_FORMAT"]
    lines += [f"NUMBER_OF_SETS {len(table.names)}", "BEGIN_DATA"]
    for k, (name, row) in enumerate(zip(table.names, table.values, strict=True), start=1):
        lines.append(" ".join([str(k), f'"{_plain(name)}"', *(f"{value:.7g}" for value in row)]))
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join([*lines, "END_DATA", ""]), encoding="utf-8")


def _plain(text: str) -> str:
    return " ".join(text.replace('"', "'").split())
