"""What another simulator wrote: patch values in CSV or MATLAB files, mosaics in MATLAB or raw files."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.mat import load_mat
from photosite.files.small import read_small
from photosite.frames.io.read import SUFFIXES, read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.validation.compare import UNITS, PatchValues, Unit
from photosite.validation.set_up import NAMES_DOWN_COLUMNS
from photosite.values.cfa import MONOCHROME, Cfa, channel_names, channel_sites
from photosite.values.region import Patch

_LARGEST_BYTES = 1 << 22
_MOST_CHANNELS = 4
"""An array with more columns is a mosaic, not patches by channels."""

_COLUMN = re.compile(r"(?P<channel>.+?)(?P<error>_standard_error)?_(?P<unit>e|dn)")


@dataclass(frozen=True)
class Mosaic:
    """A mosaic in electrons.

    Parameters
    ----------
    electrons
        (rows, cols).
    cfa
        The colour filter array's tile.
    """

    electrons: NDArray[np.float64]
    cfa: Cfa

    def patch_values(self, regions: Sequence[Patch]) -> PatchValues:
        """Mean of each patch and channel, with its standard error from the scatter over the pixels.

        Raises
        ------
        InputError
            If a region reaches beyond the mosaic or holds fewer than two pixels of a channel.

        Examples
        --------
        >>> from photosite.values.region import Region
        >>> even = Mosaic(np.full((8, 8), 7.0), (("R", "G"), ("G", "B")))
        >>> even.patch_values([Region("all", 0, 8, 0, 8)]).mean.tolist()
        [[7.0, 7.0, 7.0]]
        """
        channels = channel_names(self.cfa)
        cells = np.array([[self._cell(region, channel) for channel in channels] for region in regions])
        names = tuple(region.name for region in regions)
        return PatchValues(names, channels, "e", cells[..., 0], cells[..., 1], np.zeros(cells.shape[:2], np.bool_))

    def _cell(self, region: Patch, channel: str) -> tuple[float, float]:
        rows, cols = self.electrons.shape
        if region.r1 > rows or region.c1 > cols:
            raise InputError(f"patch '{region.name}' reaches beyond the mosaic of {rows} x {cols} pixels")
        inside = np.zeros((region.r1 - region.r0, region.c1 - region.c0), np.bool_)
        height, width = len(self.cfa), len(self.cfa[0])
        for r, c in channel_sites(self.cfa, channel):
            inside[(r - region.r0) % height :: height, (c - region.c0) % width :: width] = True
        values = self.electrons[region.r0 : region.r1, region.c0 : region.c1][inside & region.inside()]
        if values.size < 2:
            raise InputError(f"patch '{region.name}' holds {values.size} pixels of channel {channel}; two are needed")
        return float(values.mean()), float(values.std(ddof=1)) / math.sqrt(values.size)


@dataclass(frozen=True)
class Reading:
    """How a file is read that does not say it itself.

    Parameters
    ----------
    cfa, bits, black_level_dn
        Of mosaics that do not say.
    unit
        Of MATLAB arrays and raw files: "e" or "dn". None is DN for raw files; a MATLAB array must be told.
    variable
        Of a MATLAB file, with dots for fields: "sensor.data.volts". None takes the only numeric array.
    """

    cfa: Cfa
    bits: int
    black_level_dn: float = 0.0
    unit: Unit | None = None
    variable: str | None = None


Content = PatchValues | Mosaic | list[RawFrame]


def read_other(path: str | PathLike[str], reading: Reading) -> Content:
    """Patch values or a mosaic, by the file's ending.

    Parameters
    ----------
    path
        .csv, .mat, or a raw frame or folder of frames that photosite reads (TIFF, DNG, ...).
    reading
        What the file may not say.

    Raises
    ------
    FileError
        If the file cannot be read, or says what cannot be.
    """
    file = Path(path)
    ending = file.suffix.lower()
    if ending == ".csv":
        return read_csv(file)
    if ending == ".mat":
        return read_mat(file, reading)
    return _frames(file, reading)


def read_csv(path: str | PathLike[str]) -> PatchValues:
    """Patch values from a CSV file.

    Parameters
    ----------
    path
        Text in UTF-8. The heading is `patch` and a column per channel, named with its unit: `R_e,G_e,B_e` in electrons
        or `R_dn,...` in DN above black; `R_standard_error_e` and so on where the values have noise. What follows a # at
        the beginning of a line is a note.

    Raises
    ------
    FileError
        If the file cannot be read or holds something else; with the line.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "other.csv")
    ...     _ = file.write_text("patch,R_e,G_e\\nwhite,3000,4000\\nblack,100,120\\n")
    ...     values = read_csv(file)
    >>> values.names, values.channels, values.unit, values.mean.tolist()
    (('white', 'black'), ('R', 'G'), 'e', [[3000.0, 4000.0], [100.0, 120.0]])
    """
    file = Path(path)
    rows = [(number, row) for number, row in _rows(file) if any(row) and not row[0].startswith("#")]
    if not rows:
        raise FileError(file, "is empty; expected a heading, patch,R_e,G_e,B_e say, and a line per patch")
    (line, heading), body = rows[0], rows[1:]
    columns, unit = _columns(file, heading, line)
    if not body:
        raise FileError(file, "has a heading and no patches")
    table = np.array([_numbers(file, number, row, len(heading)) for number, row in body])
    channels = tuple(channel for channel, is_error in columns if not is_error)
    mean = table[:, [columns.index((channel, False)) for channel in channels]]
    error = np.zeros_like(mean)
    for k, channel in enumerate(channels):
        if (channel, True) in columns:
            error[:, k] = table[:, columns.index((channel, True))]
    try:
        return PatchValues(tuple(row[0] for _, row in body), channels, unit, mean, error, np.zeros_like(mean, np.bool_))
    except InputError as problem:
        raise FileError(file, str(problem)) from None


def _rows(file: Path) -> list[tuple[int, list[str]]]:
    content = read_small(file, "a table of patch values", _LARGEST_BYTES)
    try:
        reader = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""))
        return [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(file, f"is no CSV in UTF-8: {error}") from None


def _columns(file: Path, heading: Sequence[str], line: int) -> tuple[list[tuple[str, bool]], Unit]:
    """(channel, whether its standard error) of each column but the first, and the unit of all."""
    if heading[0].lower() != "patch":
        raise FileError(file, f"the first column must be headed 'patch', not '{heading[0]:.40}'", line)
    columns, units = [], set()
    for name in heading[1:]:
        found = _COLUMN.fullmatch(name)
        if not found:
            raise FileError(
                file, f"column '{name:.40}' must be a channel with its unit: R_e for electrons, R_dn for DN", line
            )
        columns.append((found["channel"], bool(found["error"])))
        units.add(found["unit"])
    if twice := [name for name in dict.fromkeys(heading) if list(heading).count(name) > 1]:
        raise FileError(file, f"column '{twice[0]}' is there twice", line)
    if orphans := [channel for channel, is_error in columns if is_error and (channel, False) not in columns]:
        raise FileError(file, f"channel {orphans[0]} has a standard error and no values", line)
    if len(units) != 1:
        raise FileError(file, "expected columns of one unit, all in _e or all in _dn", line)
    return columns, "e" if units == {"e"} else "dn"


def _numbers(file: Path, line: int, row: Sequence[str], width: int) -> list[float]:
    if len(row) != width or not row[0]:
        raise FileError(file, f"expected a patch's name and {width - 1} numbers, got {len(row)} cells", line)
    try:
        values = [float(cell) for cell in row[1:]]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise FileError(
            file, f"patch '{row[0]:.40}' needs {width - 1} finite numbers, not {','.join(row[1:])!r:.60}", line
        )
    return values


def read_mat(path: str | PathLike[str], reading: Reading) -> Content:
    """Patch values or a mosaic from a MATLAB file of version 4 to 7.2.

    An array of one to four columns is patches by channels; a wider one is a mosaic. Patch names come from the cell
    array `patch_names` beside it; 24 rows without are the ColorChecker in ISETCam's order, down the columns. Three
    columns are R, G and B and one is M; for others the cell array `channel_names` says.

    Raises
    ------
    FileError
        If the file cannot be read, is of version 7.3, the variable is not there or not told, or its values cannot be.
    """
    file = Path(path)
    if reading.unit is None:
        raise FileError(
            file, "a MATLAB file does not say its unit; tell it (--unit e for electrons, dn for DN above black)"
        )
    name, values, beside = _variable(file, reading.variable)
    if values.shape[1] > _MOST_CHANNELS:
        return _mosaic(file, name, values, reading)
    rows, cols = values.shape
    names = _texts(beside, "patch_names") or (NAMES_DOWN_COLUMNS if rows == len(NAMES_DOWN_COLUMNS) else None)
    channels = _texts(beside, "channel_names") or {1: ("M",), 3: ("R", "G", "B")}.get(cols)
    for wanted, what, told in ((rows, "patch_names", names), (cols, "channel_names", channels)):
        if told is None or len(told) != wanted:
            raise FileError(
                file, f"'{name}' is {rows} x {cols}; a cell array '{what}' beside it must hold {wanted} names"
            )
    try:
        return PatchValues.exact(names or (), channels or (), reading.unit, values)
    except InputError as problem:
        raise FileError(file, f"'{name}': {problem}") from None


def _mosaic(file: Path, name: str, values: NDArray[np.float64], reading: Reading) -> Mosaic | list[RawFrame]:
    if not np.isfinite(values).all():
        raise FileError(file, f"'{name}' holds numbers that are not finite")
    if reading.unit == "e":
        return Mosaic(values, reading.cfa)
    top = 2**reading.bits - 1
    if (values != np.round(values)).any() or values.min() < 0 or values.max() > top:
        raise FileError(
            file, f"'{name}' is no mosaic of {reading.bits} bits: digital numbers are whole and from 0 to {top}"
        )
    dn = values.astype(np.uint16)
    return [RawFrame(dn, bits=reading.bits, cfa=reading.cfa, black_level_dn=reading.black_level_dn)]


def _variable(file: Path, wanted: str | None) -> tuple[str, NDArray[np.float64], dict[str, Any]]:
    """The array asked for, or the only one there is; its name; and all variables of the file."""
    content = load_mat(file)
    arrays = {
        name: value
        for name, value in content.items()
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1
    }
    if wanted is None:
        if len(arrays) != 1:
            listed = ", ".join(f"'{name}'" for name in content) or "none"
            raise FileError(
                file, f"expected one numeric array, found {len(arrays)}; name it (--variable); there are: {listed}"
            )
        wanted = next(iter(arrays))
    value: Any = content
    for part in wanted.split("."):
        fields = value if isinstance(value, dict) else {}
        if part not in fields:
            raise FileError(file, f"has no variable '{wanted}'; {did_you_mean(part, fields)}")
        value = fields[part]
    if not (isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2 and value.size):
        shape = f"of shape {value.shape} and type {value.dtype}" if isinstance(value, np.ndarray) else "something else"
        raise FileError(
            file, f"'{wanted}' must be a real matrix, patches by channels or rows by columns; it is {shape}"
        )
    return wanted, value.astype(np.float64), content


def _texts(content: dict[str, Any], name: str) -> tuple[str, ...] | None:
    """The texts of a cell array, or None where there is none."""
    cells = content.get(name)
    return tuple(map(str, cells)) if isinstance(cells, list) else None


def _frames(path: Path, reading: Reading) -> Content:
    files = [path]
    if path.is_dir():
        files = sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
        if not files:
            raise FileError(path, "holds no raw frames")
    frames = [_filtered(read_raw(file), file, reading) for file in files]
    if reading.unit != "e":
        return frames
    if len(frames) > 1:
        raise FileError(path, f"mosaics in {UNITS['e']} are compared one at a time, not {len(frames)} together")
    return Mosaic(frames[0].dn.astype(np.float64), frames[0].cfa)


def _filtered(frame: RawFrame, file: Path, reading: Reading) -> RawFrame:
    """The frame; where its file says nothing of filters, with filters, bits and black level as told."""
    if frame.cfa != MONOCHROME or reading.cfa == MONOCHROME:
        return frame
    if reading.unit == "e":
        return replace(frame, cfa=reading.cfa)
    top = int(frame.dn.max())
    if top > 2**reading.bits - 1:
        raise FileError(file, f"holds the number {top}, which {reading.bits} bits do not; say how many (--bits)")
    black_dn = frame.black_level_dn or reading.black_level_dn
    return RawFrame(frame.dn, reading.bits, reading.cfa, black_dn, exposure_s=frame.exposure_s)
