"""Measured charts as CGATS text (CGATS.17, ISO 28178, IT8.7, Argyll's .ti3): tables of patches with spectra.

Fields of a spectrum are named by wavelength (`SPECTRAL_NM_380`, `SPECTRAL_NM380`, `SPECTRAL_380`, `SPEC_380`, `nm380`,
`R_380nm`, `S_380`, `380`), or wavelength and value alternate (`SPECTRAL_NM SPECTRAL_PCT`, or `SPECTRAL_DEC`). An ICC
profile may hold such a text, the measurements that it was made from, in its tag `targ`.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photosite.errors import FileError
from photosite.files.small_files import read_small
from photosite.files.writing import atomic_path
from photosite.scene.io.patch_table import (
    LARGEST_BYTES,
    PatchTable,
    checked_names,
    decoded_text,
    number,
    patch_table,
    patches_across,
)
from photosite.scene.scene import Scene
from photosite.scene.units import Units

_TOKEN = re.compile(r'"([^"]*)"|(\S+)')
_SPECTRAL = re.compile(
    r"(?:SPECTRAL_NM_?|SPECTRAL_?|SPEC_?|NM_?|REFL_?|LAMBDA_?|WL_?|R_?|S_?)?(\d{3,4}(?:[._]\d+)?)(?:_?NM)?",
    re.IGNORECASE,
)
_PAIR = {"SPECTRAL_PCT": Units("reflectance", 0.01), "SPECTRAL_DEC": Units("reflectance")}
_NAMES = ("SAMPLE_NAME", "SAMPLENAME", "SAMPLE_LOC", "SAMPLE_ID", "SAMPLEID")


@dataclass(frozen=True)
class _Section:
    """A table: its keywords, fields, and sets with the line on which each ends."""

    keywords: dict[str, str]
    fields: list[str]
    sets: list[list[str]]
    lines: list[int]


def read_patches(path: Path) -> PatchTable:
    """Read the first table with spectra; errors have the line where it is known."""
    content = read_small(path, "a chart's table", LARGEST_BYTES)
    sections = _sections(path, decoded_text(_target(path, content) if content[36:40] == b"acsp" else content))
    if not sections:
        raise FileError(path, "is not a CGATS file: it has no BEGIN_DATA_FORMAT")
    for section in sections:
        if any(_SPECTRAL.fullmatch(field) for field in section.fields) or "SPECTRAL_NM" in section.fields:
            return _table(path, section)
    fields = ", ".join(sections[0].fields[:8])
    raise FileError(path, f"has no spectra, only {fields}", hint="Export it with spectral data")


def _target(path: Path, profile: bytes) -> bytes:
    """Return the text of an ICC profile's tag `targ`: ICC.1, 7.3 and 10.24."""
    count = int.from_bytes(profile[128:132], "big")
    for at in range(132, min(132 + 12 * count, len(profile) - 11), 12):
        name, offset, size = struct.unpack(">4sII", profile[at : at + 12])
        if name == b"targ" and profile[offset : offset + 4] == b"text":
            return profile[offset + 8 : offset + size].rstrip(b"\0")
    raise FileError(path, "is an ICC profile without the measurements that it was made from (tag targ)")


def _sections(path: Path, text: str) -> list[_Section]:
    """Parse all tables of a file."""
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
        raise FileError(path, "is truncated: the section that begins here has no END line", begun)
    return found


def _tokens(line: str, by_tabs: bool) -> list[str]:
    """Return the words of a line without quotes, up to a comment; split at tabs where names have unquoted blanks."""
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
        raise FileError(path, "the data have no BEGIN_DATA_FORMAT with the names of their fields", begun)
    stated = keywords.get("NUMBER_OF_FIELDS")
    if stated is not None and stated != str(len(fields)):
        raise FileError(path, "NUMBER_OF_FIELDS", begun, value=stated[:20], expected=f"{len(fields)}, as named")
    wanted = keywords.get("NUMBER_OF_SETS")
    odd = next(((line, len(words)) for line, words in rows if len(words) != len(fields)), None)
    if odd is not None:
        words = [word for _, row in rows for word in row]
        if str(len(words) / len(fields)) != f"{wanted}.0":  # sets over several lines match the stated number
            expected = f"{len(fields)}, one for each field"
            raise FileError(path, "number of values", odd[0], value=odd[1], expected=expected)
        last = rows[-1][0]
        sets = [words[k : k + len(fields)] for k in range(0, len(words), len(fields))]
        return _Section(dict(keywords), fields, sets, [last] * len(sets))
    if wanted is not None and wanted != str(len(rows)):
        expected, hint = f"{len(rows)}, as present", "Check that the file is complete"
        raise FileError(path, "NUMBER_OF_SETS", begun, value=wanted[:20], expected=expected, hint=hint)
    return _Section(dict(keywords), fields, [words for _, words in rows], [line for line, _ in rows])


def _table(path: Path, section: _Section) -> PatchTable:
    if not section.sets:
        raise FileError(path, "has no patches")
    if "SPECTRAL_NM" in section.fields:
        units: Units | None
        wavelengths, columns, units = _pairs(path, section)
    else:
        matches = [(k, match) for k, field in enumerate(section.fields) if (match := _SPECTRAL.fullmatch(field))]
        columns = [k for k, _ in matches]
        wavelengths = [float(match[1].replace("_", ".")) for _, match in matches]
        units = _norm(path, section.keywords)
    values = [
        [number(path, words[k], line, section.fields[k], gaps=True) for k in columns]
        for words, line in zip(section.sets, section.lines, strict=True)
    ]
    across, title = section.keywords.get("LGOROWLENGTH", ""), section.keywords.get("DESCRIPTOR") or None
    names, grid = _names(path, section), np.array(wavelengths)
    return PatchTable(path, names, grid, np.array(values), units, patches_across(across), title)


def _pairs(path: Path, section: _Section) -> tuple[list[float], list[int], Units]:
    """Return wavelengths, columns of values, and units of a table in which the two alternate."""
    at = [k for k, field in enumerate(section.fields) if field == "SPECTRAL_NM"]
    kinds = {section.fields[k + 1] if k + 1 < len(section.fields) else "" for k in at}
    if len(kinds) != 1 or not kinds <= set(_PAIR):
        raise FileError(path, "SPECTRAL_NM must be followed by SPECTRAL_PCT or SPECTRAL_DEC, always the same")
    wavelengths: list[float] = []
    for words, line in zip(section.sets, section.lines, strict=True):
        row = [number(path, words[k], line, "SPECTRAL_NM") for k in at]
        if wavelengths and row != wavelengths:
            raise FileError(path, "this patch has other wavelengths than the first", line, hint="Export all alike")
        wavelengths = row
    return wavelengths, [k + 1 for k in at], _PAIR[kinds.pop()]


def _norm(path: Path, keywords: dict[str, str]) -> Units | None:
    """Return Argyll's scale of reflectances; not defined for measurements of displays."""
    norm = keywords.get("SPECTRAL_NORM")
    if norm is None or keywords.get("DEVICE_CLASS", "").upper() not in ("OUTPUT", "INPUT"):
        return None
    value = number(path, norm, None, "SPECTRAL_NORM")
    if value <= 0:
        raise FileError(path, "SPECTRAL_NORM", value=value, expected="above 0")
    return Units("reflectance", 1 / value)


def _names(path: Path, section: _Section) -> tuple[str, ...]:
    """Return the names in the first field in which they are unique."""
    present = [section.fields.index(field) for field in _NAMES if field in section.fields]
    for k in present:
        names = [words[k] for words in section.sets]
        if len(set(names)) == len(names) and all(names):
            return tuple(names)
    if present:
        return checked_names(path, [words[present[-1]] for words in section.sets], section.lines)
    return tuple(str(k) for k in range(1, len(section.sets) + 1))


def write(scene: Scene, path: Path) -> None:
    """Write the reflectances of a chart's patches."""
    table = patch_table(scene, path)
    if table.units is None or table.units.quantity != "reflectance":
        what = "cannot be written: CGATS needs reflectances, and the scene's are unknown"
        raise FileError(path, what, hint="Write .csv")
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
