"""Spectral protocols: YAML files that list the frames of each band of light, and describe the light.

photosite_spectral: 1
name: monochromator, 10 nm
sensor: mine.sensor.yaml                  # supplies gain and pixel size; relative to the protocol
bits: 12                                  # if the files do not state it; likewise cfa
region: [200, 1000, 300, 1600]            # evenly lit rows and columns; default: the whole frame
photodiode: {area_mm2: {value: 100, standard_uncertainty: 0.2}, responsivity: diode.csv}   # for readings in amperes
scale_uncertainty_percent: 0.5            # common to all readings: the photodiode's calibration
exposure_uncertainty_percent: 0.1         # of each exposure time: the shutter
darks:
  - {exposure: 1/50, files: dark/*.tif}
bands:
  - {centre_nm: 400, bandwidth_nm: 10, exposure: 1/50, files: 400/*.tif, irradiance_w_m2: 0.012}
  - {passband: f450.csv, exposure: 1/50, files: f450/*.tif, photocurrent_a: {value: 1e-8, standard_uncertainty: 2e-11}}

A quantity is a number or {value, standard_uncertainty}. The CSV file of a passband holds wavelength (nm) and relative
spectral energy; that of a responsivity holds wavelength (nm), A/W and an optional third column with the standard
uncertainty. Subtract the photodiode's dark reading from its readings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.calibration.spectral.bands import Band, Passband, Photodiode, SpectralFrames, triangular_passband
from photosite.color.spectrum_file import read_spectrum
from photosite.errors import FileError, InputError
from photosite.files.yaml import check_keys, line_of, optional_text, read_yaml
from photosite.frames.frame_file import FrameFile, SetProperties
from photosite.frames.frame_set import FrameSource
from photosite.frames.frame_settings import FrameSettings, Kind
from photosite.frames.from_files import frame_set_from_files
from photosite.frames.io.protocol import matching_files, stated_bits, stated_cfa
from photosite.sensor.io.sensor_file import load_sensor
from photosite.values.exposure import parse_exposure
from photosite.values.measured import Measured
from photosite.values.region import Region

VERSION_KEY = "photosite_spectral"

_KEYS = (
    VERSION_KEY,
    "name",
    "sensor",
    "bits",
    "cfa",
    "region",
    "photodiode",
    "scale_uncertainty_percent",
    "exposure_uncertainty_percent",
    "darks",
    "bands",
)
_DARK_KEYS = ("exposure", "files")
_READINGS = ("irradiance_w_m2", "photocurrent_a")
_BAND_KEYS = (*_DARK_KEYS, "centre_nm", "bandwidth_nm", "passband", *_READINGS)
_DIODE_KEYS = ("area_mm2", "responsivity")
_QUANTITY_KEYS = ("value", "standard_uncertainty")


@dataclass(frozen=True)
class ProtocolEntry:
    """One entry of a spectral protocol, or the whole protocol: its file, content and line.

    Its methods raise a `FileError` with the line.
    """

    file: Path
    data: Mapping[Any, Any]
    line: int | None

    def line_of(self, key: str | None) -> int | None:
        """Return the line of a key, or of the entry."""
        return (line_of(self.data, key) if key else None) or self.line

    def error(self, what: str, key: str | None = None, **fields: Any) -> FileError:
        """Return an error about the entry, or about one of its keys. `fields` as for `FileError`."""
        return FileError(self.file, what, self.line_of(key), **fields)

    def invalid(self, key: str, expected: str) -> FileError:
        """Return an error about the value of a key."""
        return self.error(key, key, value=self.data.get(key), expected=expected)

    def quantity(self, key: str) -> Measured:
        """Return a number, or a number with its standard uncertainty."""
        raw = self.data.get(key)
        value, uncertainty = raw, 0.0
        if isinstance(raw, Mapping):
            check_keys(self.file, raw, _QUANTITY_KEYS, f"'{key}'")
            value, uncertainty = raw.get("value"), raw.get("standard_uncertainty", 0.0)
        for number in (value, uncertainty):
            if isinstance(number, bool) or not isinstance(number, int | float) or not _finite(number):
                raise self.invalid(key, "a number or {value, standard_uncertainty}")
        try:
            return Measured(float(value), float(uncertainty))  # type: ignore[arg-type]
        except InputError as error:
            raise error.within(key).in_file(self.file, self.line_of(key)) from None

    def positive(self, key: str) -> Measured:
        """Return a quantity above 0."""
        quantity = self.quantity(key)
        if not quantity.value > 0:
            raise self.invalid(key, "above 0")
        return quantity

    def percent(self, key: str) -> float:
        """Return a number of 0 or more; 0 if the key is missing."""
        if self.data.get(key) is None:
            return 0.0
        value = self.quantity(key).value
        if value < 0:
            raise self.invalid(key, "0 or more")
        return value

    def exposure_s(self) -> float:
        """Return the exposure time."""
        exposure = self.data.get("exposure")
        try:
            if isinstance(exposure, bool) or not isinstance(exposure, str | int | float):
                raise InputError("exposure", value=exposure, expected="a time in seconds, such as 0.005 or 1/8000")
            return parse_exposure(exposure)
        except InputError as error:
            raise error.in_file(self.file, self.line_of("exposure")) from None

    def files(self) -> list[Path]:
        """Return the frames' files, with patterns resolved."""
        files = self.data.get("files")
        patterns = [files] if isinstance(files, str) else files
        if not isinstance(patterns, Sequence) or not patterns or not all(isinstance(p, str) and p for p in patterns):
            raise self.invalid("files", "a path, a pattern or a list of these")
        return [path for pattern in patterns for path in matching_files(self.file, str(pattern), self.line)]


def _finite(number: float) -> bool:
    try:
        return math.isfinite(float(number))
    except OverflowError:  # a whole number of 400 digits
        return False


def open_spectral(path: str | PathLike[str]) -> SpectralFrames:
    """Open a spectral measurement, without reading pixels.

    Parameters
    ----------
    path
        Spectral protocol (YAML); the module docstring shows its content.

    Returns
    -------
    SpectralFrames
        All files exist and have the same format.

    Raises
    ------
    FileError
        If the protocol is invalid, or a file is missing, truncated, listed twice or different from the others.
    """
    file = Path(path)
    data = read_yaml(file, "a spectral protocol")
    if not isinstance(data, Mapping) or data.get(VERSION_KEY) != 1 or isinstance(data.get(VERSION_KEY), bool):
        found = data.get(VERSION_KEY) if isinstance(data, Mapping) else None
        expected = "1, the version of the file format"
        raise FileError(file, VERSION_KEY, line_of(data, VERSION_KEY), value=found, expected=expected)
    check_keys(file, data, _KEYS, "a spectral protocol")
    top = ProtocolEntry(file, data, None)
    darks = protocol_entries(top, "darks", _DARK_KEYS)
    bands = protocol_entries(top, "bands", _BAND_KEYS)
    listed = [(entry, "dark") for entry in darks] + [(entry, "light") for entry in bands]
    sources = _opened(top, listed)
    sensor_name = optional_text(file, data, "sensor")
    diode = _photodiode(top)
    made = tuple(_band(entry, sources[id(entry)], diode) for entry in bands)
    by_exposure: dict[float, tuple[FrameSource, ...]] = {}
    for entry in darks:
        exposure_s = entry.exposure_s()
        by_exposure[exposure_s] = by_exposure.get(exposure_s, ()) + sources[id(entry)].frames
    any_source = sources[id(listed[0][0])]
    region = _region(top, any_source.shape)
    try:
        return SpectralFrames(
            bands=made,
            darks=by_exposure,
            rows=any_source.shape[0],
            cols=any_source.shape[1],
            bits=any_source.bits,
            cfa=any_source.cfa,
            sensor=None if sensor_name is None else load_sensor(file.parent / sensor_name),
            photodiode=diode,
            region=region,
            scale_uncertainty_percent=top.percent("scale_uncertainty_percent"),
            exposure_uncertainty_percent=top.percent("exposure_uncertainty_percent"),
            source=str(file),
        )
    except InputError as error:
        raise error.in_file(file) from None


@dataclass(frozen=True)
class _Opened:
    """An entry's frames, and the format common to all frames."""

    frames: tuple[FrameSource, ...]
    shape: tuple[int, int]
    bits: int
    cfa: tuple[tuple[str, ...], ...]


def protocol_entries(top: ProtocolEntry, key: str, keys: Sequence[str]) -> list[ProtocolEntry]:
    """Return the entries of a list, each with valid keys only.

    Raises
    ------
    FileError
        If the value is not such a list; with the line.
    """
    listed = top.data.get(key)
    if not isinstance(listed, Sequence) or isinstance(listed, str) or not listed:
        raise top.invalid(key, f"a list of {{{', '.join(keys)}}}")
    entries = []
    for number, data in enumerate(listed):
        line = line_of(listed, number)
        if not isinstance(data, Mapping):
            expected = f"{{{', '.join(keys)}}}"
            raise FileError(top.file, f"an entry of '{key}'", line, value=data, expected=expected)
        check_keys(top.file, data, keys, f"an entry of '{key}'")
        entries.append(ProtocolEntry(top.file, data, line))
    return entries


def _opened(top: ProtocolEntry, listed: Sequence[tuple[ProtocolEntry, str]]) -> dict[int, _Opened]:
    """Open the frames of all entries, keyed by the identity of the entry, and check them against each other."""
    paths = {id(entry): entry.files() for entry, _ in listed}
    kinds: dict[str, Kind] = {"dark": "dark", "light": "light"}
    files = [
        FrameFile(path, FrameSettings(kinds[kind], entry.exposure_s()), top.file, entry.line)
        for entry, kind in listed
        for path in paths[id(entry)]
    ]
    properties = SetProperties(stated_bits(top.file, top.data), stated_cfa(top.file, top.data))
    frames = frame_set_from_files(files, str(top.file), properties)
    if len(frames.gain_settings) > 1:
        raise top.error("gain settings of the frames", value=frames.gain_settings, expected="all the same")
    by_name = {source.name: source for group in frames.groups for source in group.frames}
    shape = (frames.rows, frames.cols)
    return {
        key: _Opened(tuple(by_name[str(path)] for path in found), shape, frames.bits, frames.cfa)
        for key, found in paths.items()
    }


def _band(entry: ProtocolEntry, opened: _Opened, diode: Photodiode | None) -> Band:
    readings = [key for key in _READINGS if entry.data.get(key) is not None]
    if len(readings) != 1:
        raise entry.error("the reading", value=readings, expected=f"exactly one of {' and '.join(_READINGS)}")
    passband, uncertainty_nm = _passband(entry)
    try:
        return Band(
            name=f"{passband.centre_nm:g} nm",
            passband=passband,
            centre_uncertainty_nm=uncertainty_nm,
            exposure_s=entry.exposure_s(),
            frames=opened.frames,
            reading=entry.positive(readings[0]),
            photodiode=diode if readings[0] == "photocurrent_a" else None,
            in_amperes=readings[0] == "photocurrent_a",
        )
    except InputError as error:
        raise error.in_file(entry.file, entry.line) from None


def _passband(entry: ProtocolEntry) -> tuple[Passband, float]:
    """Return the band's spectrum, and the standard uncertainty of its wavelength."""
    by_centre, by_file = entry.data.get("centre_nm") is not None, entry.data.get("passband") is not None
    if by_centre == by_file or (by_file and entry.data.get("bandwidth_nm") is not None):
        raise entry.error("the band", expected="'centre_nm' and 'bandwidth_nm', or a 'passband' (CSV file)")
    try:
        if by_centre:
            centre, width = entry.positive("centre_nm"), entry.quantity("bandwidth_nm")
            return triangular_passband(centre.value, width.value), centre.standard_uncertainty
        name = optional_text(entry.file, entry.data, "passband") or ""
        spectrum = read_spectrum(entry.file.parent / name).spectrum
        return Passband.of_energy(spectrum), 0.0
    except InputError as error:
        raise error.in_file(entry.file, entry.line) from None


def _photodiode(top: ProtocolEntry) -> Photodiode | None:
    data = top.data.get("photodiode")
    if data is None:
        return None
    if not isinstance(data, Mapping):
        raise top.invalid("photodiode", f"{{{', '.join(_DIODE_KEYS)}}}")
    check_keys(top.file, data, _DIODE_KEYS, "'photodiode'")
    entry = ProtocolEntry(top.file, data, line_of(top.data, "photodiode"))
    name = optional_text(top.file, data, "responsivity")
    if name is None:
        raise entry.error("'responsivity' is missing", hint="Name a CSV file with wavelength (nm) and A/W")
    table = read_spectrum(top.file.parent / name)
    responsivity, uncertainty = table.spectrum, table.standard_uncertainty
    try:
        return Photodiode(responsivity, uncertainty, entry.positive("area_mm2"))
    except InputError as error:
        raise error.in_file(entry.file, entry.line) from None


def _region(top: ProtocolEntry, shape: tuple[int, int]) -> Region | None:
    raw = top.data.get("region")
    if raw is None:
        return None
    expected = "[first row, row after the last, first column, column after the last]"
    if (
        not isinstance(raw, Sequence)
        or len(raw) != 4
        or any(isinstance(n, bool) or not isinstance(n, int) for n in raw)
    ):
        raise top.invalid("region", expected)
    try:
        region = Region("region", *map(int, raw))
    except InputError as error:
        raise error.in_file(top.file, top.line_of("region")) from None
    if region.r1 > shape[0] or region.c1 > shape[1]:
        raise top.invalid("region", f"inside the frames of {shape[0]} x {shape[1]}")
    return region
