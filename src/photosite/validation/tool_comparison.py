"""Comparison of another simulator's patches or mosaics with photosite's simulation or a second file.

Patch values are read from CSV and MATLAB files, mosaics from MATLAB and raw files.
"""

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

from photosite.color.spectrum import Spectrum, energy_from_photons
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.mat import load_mat
from photosite.files.small_files import read_small
from photosite.frames.io.formats import raw_files, read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.color_checker import chart_regions
from photosite.metrics.measure import measure
from photosite.metrics.patches import patch_statistics
from photosite.metrics.registry import ValueName, measurement
from photosite.validation.frame_validation import MOST_SIMULATED
from photosite.validation.patch_values import UNITS, PatchComparison, PatchValues, Unit, compare_values
from photosite.validation.quality_comparison import QualityComparison, compare_quality
from photosite.validation.result import Validation
from photosite.validation.set_up import NAMES_DOWN_COLUMNS, SetUp
from photosite.validation.validate import validate
from photosite.values.cfa import MONOCHROME, Cfa, channel_mask, channel_names, shifted, tile_text
from photosite.values.region import Patch

_LARGEST_BYTES = 1 << 22
_MOST_CHANNELS = 4  # an array with more columns is a mosaic, not patches by channels
_COLUMN = re.compile(r"(?P<channel>.+?)(?P<error>_standard_error)?_(?P<unit>e|dn)")


@dataclass(frozen=True)
class Mosaic:
    """A mosaic in electrons, (rows, cols), and the tile of its color filter array."""

    electrons: NDArray[np.float64]
    cfa: Cfa

    def patch_values(self, regions: Sequence[Patch]) -> PatchValues:
        """Return the mean of each patch and channel, with its standard error from the scatter over pixels.

        Raises
        ------
        InputError
            If a region is not inside the mosaic or has fewer than two pixels of a channel.

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
            raise InputError(f"patch '{region.name}'", expected=f"inside the mosaic of {rows} x {cols} pixels")
        patch = self.electrons[region.r0 : region.r1, region.c0 : region.c1]
        values = patch[region.inside() & channel_mask(shifted(self.cfa, region.r0, region.c0), channel, patch.shape)]
        if values.size < 2:
            what = f"pixels of channel {channel} in patch '{region.name}'"
            raise InputError(what, value=values.size, expected="two or more")
        return float(values.mean()), float(values.std(ddof=1)) / math.sqrt(values.size)


@dataclass(frozen=True)
class ReadOptions:
    """Properties of files that do not contain them.

    Parameters
    ----------
    cfa, bits, black_level_dn
        Of mosaics without this information.
    unit
        Unit of MATLAB arrays and raw files, "e" or "dn". None means DN for raw files; MATLAB arrays need a unit.
    variable
        Array of a MATLAB file, with dots for fields: "sensor.data.volts". None selects the only numeric array.
    """

    cfa: Cfa
    bits: int
    black_level_dn: float = 0.0
    unit: Unit | None = None
    variable: str | None = None


Content = PatchValues | Mosaic | list[RawFrame]


def read_tool_file(path: str | PathLike[str], options: ReadOptions) -> Content:
    """Read patch values or a mosaic from a .csv or .mat file, a raw frame (TIFF, DNG, ...) or a folder of raw frames.

    Raises
    ------
    FileError
        If the file cannot be read or has invalid content.
    """
    file = Path(path)
    match file.suffix.lower():
        case ".csv":
            return read_csv(file)
        case ".mat":
            return read_mat(file, options)
    return _frames(file, options)


def read_csv(path: str | PathLike[str]) -> PatchValues:
    """Read patch values from a CSV file.

    Parameters
    ----------
    path
        UTF-8 text. The heading is `patch` and one column for each channel, named with its unit: `R_e,G_e,B_e` in
        electrons or `R_dn,...` in DN above black. `R_standard_error_e` and so on give standard errors. Lines that start
        with # are comments.

    Raises
    ------
    FileError
        If the file cannot be read or has invalid content, with the line.

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
        hint = "Write a heading, such as patch,R_e,G_e,B_e, and one line for each patch"
        raise FileError(file, "is empty", hint=hint)
    (line, heading), body = rows[0], rows[1:]
    columns, unit = _columns(file, heading, line)
    if not body:
        raise FileError(file, "has a heading but no patches")
    table = np.array([_numbers(file, number, row, len(heading)) for number, row in body])
    channels = tuple(channel for channel, is_error in columns if not is_error)
    mean = table[:, [columns.index((channel, False)) for channel in channels]]
    error = np.zeros_like(mean)
    for k, channel in enumerate(channels):
        if (channel, True) in columns:
            error[:, k] = table[:, columns.index((channel, True))]
    try:
        return PatchValues(tuple(row[0] for _, row in body), channels, unit, mean, error, np.zeros_like(mean, np.bool_))
    except InputError as error:
        raise error.in_file(file) from None


def _rows(file: Path) -> list[tuple[int, list[str]]]:
    content = read_small(file, "a table of patch values", _LARGEST_BYTES)
    try:
        reader = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""))
        return [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(file, f"is not UTF-8 CSV: {error}") from None


def _columns(file: Path, heading: Sequence[str], line: int) -> tuple[list[tuple[str, bool]], Unit]:
    """Return (channel, is standard error) of each column after the first, and the common unit."""
    if heading[0].lower() != "patch":
        raise FileError(file, "heading of the first column", line, value=heading[0], expected="'patch'")
    columns, units = [], set()
    for name in heading[1:]:
        found = _COLUMN.fullmatch(name)
        if not found:
            expected = "a channel with its unit: R_e for electrons, R_dn for DN"
            raise FileError(file, "column", line, value=name, expected=expected)
        columns.append((found["channel"], bool(found["error"])))
        units.add(found["unit"])
    if twice := [name for name in heading if list(heading).count(name) > 1]:
        raise FileError(file, "columns", line, value=twice[0], expected="without repeats")
    if orphans := [channel for channel, is_error in columns if is_error and (channel, False) not in columns]:
        raise FileError(file, f"channel {orphans[0]} has a standard error but no values", line)
    if len(units) != 1:
        raise FileError(file, "columns", line, expected="in one unit, all _e or all _dn")
    return columns, "e" if units == {"e"} else "dn"


def _numbers(file: Path, line: int, row: Sequence[str], width: int) -> list[float]:
    if len(row) != width or not row[0]:
        raise FileError(file, "cells", line, value=len(row), expected=f"a patch name and {width - 1} numbers")
    try:
        values = [float(cell) for cell in row[1:]]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        expected = f"{width - 1} finite numbers"
        raise FileError(file, f"patch '{row[0]:.40}'", line, value=",".join(row[1:]), expected=expected)
    return values


def read_mat(path: str | PathLike[str], options: ReadOptions) -> Content:
    """Read patch values or a mosaic from a MATLAB file of version 4 to 7.2.

    An array of one to four columns is patches by channels; a wider array is a mosaic. Patch names come from the cell
    array `patch_names`; without it, 24 rows are the ColorChecker in ISETCam's order, down the columns. Three columns
    are R, G and B, and one column is M; other numbers need the cell array `channel_names`.

    Raises
    ------
    FileError
        If the file cannot be read or is of version 7.3, the variable or unit is missing, or values are invalid.
    """
    file = Path(path)
    if options.unit is None:
        hint = "Pass {unit} for electrons or 'dn' for DN above black"
        raise FileError(file, "the unit of a MATLAB file is unknown", hint=hint, arguments={"unit": "e"})
    name, values, beside = _variable(file, options.variable)
    if values.shape[1] > _MOST_CHANNELS:
        return _mosaic(file, name, values, options)
    rows, cols = values.shape
    names = _texts(beside, "patch_names") or (NAMES_DOWN_COLUMNS if rows == len(NAMES_DOWN_COLUMNS) else None)
    channels = _texts(beside, "channel_names") or {1: ("M",), 3: ("R", "G", "B")}.get(cols)
    for count, what, given in ((rows, "patch_names", names), (cols, "channel_names", channels)):
        if given is None or len(given) != count:
            raise FileError(file, f"cell array '{what}'", expected=f"{count} names for '{name}' of {rows} x {cols}")
    try:
        return PatchValues.exact(names or (), channels or (), options.unit, values)
    except InputError as error:
        raise error.within(f"'{name}'").in_file(file) from None


def _mosaic(file: Path, name: str, values: NDArray[np.float64], options: ReadOptions) -> Mosaic | list[RawFrame]:
    if not np.isfinite(values).all():
        raise FileError(file, f"'{name}'", expected="finite")
    if options.unit == "e":
        return Mosaic(values, options.cfa)
    top = 2**options.bits - 1
    if (values != np.round(values)).any() or values.min() < 0 or values.max() > top:
        raise FileError(file, f"'{name}'", expected=f"integers from 0 to {top}, for {options.bits} bits")
    dn = values.astype(np.uint16)
    return [RawFrame(dn, bits=options.bits, cfa=options.cfa, black_level_dn=options.black_level_dn)]


def _variable(file: Path, wanted: str | None) -> tuple[str, NDArray[np.float64], dict[str, Any]]:
    """Return the name and values of the selected array, and all variables of the file."""
    content = load_mat(file)
    arrays = {
        name: value
        for name, value in content.items()
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1
    }
    if wanted is None:
        if len(arrays) != 1:
            listed = ", ".join(f"'{name}'" for name in content) or "none"
            expected = f"1 unless one is selected; variables: {listed}"
            example: dict[str, Any] = {"hint": "Pass {variable}", "arguments": {"variable": next(iter(arrays), "NAME")}}
            raise FileError(file, "number of numeric arrays", value=len(arrays), expected=expected, **example)
        wanted = next(iter(arrays))
    value: Any = content
    for part in wanted.split("."):
        fields = value if isinstance(value, dict) else {}
        if part not in fields:
            raise FileError(file, "variable", value=wanted, expected="in the file", hint=did_you_mean(part, fields))
        value = fields[part]
    if not (isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2 and value.size):
        found = (value.shape, str(value.dtype)) if isinstance(value, np.ndarray) else type(value).__name__
        expected = "a real matrix, patches by channels or rows by columns"
        raise FileError(file, f"'{wanted}'", value=found, expected=expected)
    return wanted, value.astype(np.float64), content


def _texts(content: dict[str, Any], name: str) -> tuple[str, ...] | None:
    """Return the strings of a cell array, or None if it is missing."""
    cells = content.get(name)
    return tuple(map(str, cells)) if isinstance(cells, list) else None


def _frames(path: Path, options: ReadOptions) -> Content:
    frames = [_with_options(read_raw(file), file, options) for file in raw_files(path)]
    if options.unit != "e":
        return frames
    if len(frames) > 1:
        raise FileError(path, f"mosaics in {UNITS['e']}", value=len(frames), expected="one at a time")
    return Mosaic(frames[0].dn.astype(np.float64), frames[0].cfa)


def _with_options(frame: RawFrame, file: Path, options: ReadOptions) -> RawFrame:
    """Return the frame, with the CFA, bit depth and black level of `options` if its file has no CFA."""
    if frame.cfa != MONOCHROME or options.cfa == MONOCHROME:
        return frame
    if options.unit == "e":
        return replace(frame, cfa=options.cfa)
    top, highest = int(frame.dn.max()), 2**options.bits - 1
    if top > highest:
        expected = f"at most {highest}, for {options.bits} bits"
        example: dict[str, Any] = {"hint": "Pass {bits}", "arguments": {"bits": max(16, top.bit_length())}}
        raise FileError(file, "largest value", value=top, expected=expected, **example)
    black_dn = frame.black_level_dn or options.black_level_dn
    return RawFrame(frame.dn, options.bits, options.cfa, black_dn, exposure_s=frame.exposure_s)


def compare(
    other: Content,
    reference: Content | SetUp,
    *,
    chart: str = "macbeth",
    tolerance_percent: float = 0.1,
    level: float = 0.05,
    seed: int = 0,
) -> PatchComparison | Validation:
    """Compare the output of another simulator with a reference.

    Raw frames are compared by `photosite.validation.validate.validate`, noise included. Patch values and mosaics in
    electrons are compared by their means.

    Parameters
    ----------
    other
        Patch values, a mosaic in electrons, or raw frames, from `photosite.validation.tool_comparison.read_tool_file`.
    reference
        The same of a second tool, or a set-up. A set-up is simulated in the form of `other`: patches without noise,
        mean electrons of a mosaic, or raw frames with noise.
    chart
        Chart that fills mosaics.
    tolerance_percent
        Relative tolerance of means, and of the noise of raw frames, in percent.
    level
        False-alarm rate of the verdict where there is noise.
    seed
        Seed of the noise of simulated raw frames.

    Returns
    -------
    PatchComparison or Validation
        `Validation` where both are raw frames, with `other` as measured.

    Examples
    --------
    >>> import photosite as ps
    >>> camera = ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200"))
    >>> set_up = SetUp.from_chart(camera, ps.charts.macbeth("A", 40), 1 / 3)
    >>> theirs = set_up.patch_values("e")
    >>> brighter = replace(theirs, mean=1.02 * theirs.mean)
    >>> compare(theirs, set_up).agrees, compare(brighter, set_up).agrees
    (True, False)
    """
    made = _simulated(other, reference, seed) if isinstance(reference, SetUp) else reference
    if isinstance(other, list) and isinstance(made, list):
        return validate(other, made, chart, level=level, tolerance_percent=tolerance_percent)
    values, base = _values(other, chart), _values(made, chart)
    if isinstance(reference, SetUp) and isinstance(other, Mosaic):
        # Another tool clips a mosaic at the well capacity; photosite's mean is not clipped.
        well_e = reference.camera.sensor.pixel.well_capacity_e.value
        base = replace(base, saturated=base.mean >= well_e)
    return compare_values(values, base, tolerance_percent=tolerance_percent, level=level)


def compare_tool_quality(
    other: Content,
    reference: Content | SetUp,
    values: Sequence[str],
    *,
    tolerance_percent: float = 0.1,
    level: float = 0.05,
    seed: int = 0,
) -> QualityComparison:
    """Compare values of image quality of another simulator's ColorChecker with those of a reference.

    Parameters
    ----------
    other, reference, tolerance_percent, level, seed
        As for `compare`, mosaics only.
    values
        Names such as "noise.snr_18_db.G"; without a part, they stand for all parts.

    Raises
    ------
    InputError
        If a name is unknown or measured on other charts, or a side is not a mosaic.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=64)
    >>> camera = ps.Camera(ps.DiffractionLimited(8, 50), sensor)
    >>> set_up = SetUp.from_chart(camera, ps.charts.macbeth("A", 40), 1 / 3)
    >>> theirs = set_up.frames((264, 392), seed=5, count=2)
    >>> [each.name for each in compare_tool_quality(theirs, set_up, ["noise.snr_18_db.G"]).values]
    ['noise.snr_18_db.G']
    """
    names = [ValueName.parse(value) for value in values]
    for name in names:
        if "macbeth" not in (known := measurement(name.measurement).charts):
            expected = "measured on macbeth"
            raise InputError("values", value=str(name), expected=expected, hint=f"It is measured on {', '.join(known)}")
    made = _simulated(other, reference, seed) if isinstance(reference, SetUp) else reference
    seen = reference.chart if isinstance(reference, SetUp) else None
    light: dict[str, Any] = {}
    if seen is not None:
        energy = energy_from_photons(seen.light(), seen.wavelength_nm)
        light = {"illuminant": Spectrum(seen.wavelength_nm, energy), "luminance_cd_m2": seen.mean_luminance_cd_m2()}
    found = []
    for content in (other, made):
        if isinstance(content, PatchValues):
            raise InputError("values", value=values[0], expected="those of mosaics; patch values show no others")
        mosaic = isinstance(content, Mosaic)
        image = ChartImage((content.electrons,), "electrons", content.cfa) if isinstance(content, Mosaic) else content
        sensor = reference.camera.sensor if isinstance(reference, SetUp) and not mosaic else None
        ids = dict.fromkeys(name.measurement for name in names)
        found.append(measure(image, "macbeth", only=list(ids), sensor=sensor, **light).only(names))
    return compare_quality(*found, level=level, tolerance_percent=tolerance_percent)


def _simulated(other: Content, set_up: SetUp, seed: int) -> Content:
    if isinstance(other, PatchValues):
        return set_up.patch_values(other.unit)
    tile = set_up.camera.sensor.array.cfa
    cfa = other.cfa if isinstance(other, Mosaic) else other[0].cfa
    if cfa != tile:
        raise InputError("cfa", value=tile_text(cfa), expected=f"that of the set-up, {tile_text(tile)}")
    if isinstance(other, Mosaic):
        rows, cols = other.electrons.shape
        return Mosaic(set_up.mean_electrons((rows, cols)).astype(float), tile)
    return list(set_up.frames(other[0].shape, seed=seed, count=min(len(other), MOST_SIMULATED)))


def _values(content: Content, chart: str) -> PatchValues:
    if isinstance(content, PatchValues):
        return content
    if isinstance(content, Mosaic):
        rows, cols = content.electrons.shape
        return content.patch_values(chart_regions(chart, rows, cols))
    return PatchValues.from_statistics(patch_statistics(content, chart_regions(chart, *content[0].shape)))
