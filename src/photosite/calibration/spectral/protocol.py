"""Spectral protocols: a YAML file that says which frames were taken under which band of light, and what the light was.

photosite_spectral: 1
name: monochromator, 10 nm
sensor: mine.sensor.yaml                  # where gain and pixel size come from; relative to the protocol
bits: 12                                  # where the files do not say; likewise cfa
region: [200, 1000, 300, 1600]            # rows and columns that were lit evenly; the whole frame without it
photodiode: {area_mm2: {value: 100, standard_uncertainty: 0.2}, responsivity: diode.csv}   # for readings in amperes
scale_uncertainty_percent: 0.5            # of all readings alike: the photodiode's calibration
exposure_uncertainty_percent: 0.1         # of each exposure setting: the shutter
darks:
  - {exposure: 1/50, files: dark/*.tif}
bands:
  - {centre_nm: 400, bandwidth_nm: 10, exposure: 1/50, files: 400/*.tif, irradiance_w_m2: 0.012}
  - {passband: f450.csv, exposure: 1/50, files: f450/*.tif, photocurrent_a: {value: 1e-8, standard_uncertainty: 2e-11}}

Any quantity is a number or {value, standard_uncertainty}. A passband's CSV holds wavelength (nm) and relative spectral
energy; a responsivity's holds wavelength (nm), A/W and, if it has a third column, its standard uncertainty. A reading
is the light's: what the photodiode reads in the dark is taken off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.calibration.spectral.frames import Band, Photodiode, SpectralFrames
from photosite.calibration.spectral.passband import Passband, triangular_passband
from photosite.color.spectrum_file import read_spectrum
from photosite.errors import FileError, InputError
from photosite.files.yaml import check_keys, line_of, optional_text, read_yaml
from photosite.frames.frame_set import FrameSource, Kind
from photosite.frames.io.protocol import matching_files, stated_bits, stated_cfa
from photosite.frames.listing import Expected, FileEntry, frame_set_of_files
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
    """One entry of a spectral protocol, or the whole of it: its file, itself, and its line.

    What its methods find wrong is a `FileError` with the line.
    """

    file: Path
    data: Mapping[Any, Any]
    line: int | None

    def error(self, message: str, key: str | None = None) -> FileError:
        """An error about the entry, or about one key of it."""
        return FileError(self.file, message, (line_of(self.data, key) if key else None) or self.line)

    def quantity(self, key: str) -> Measured:
        """A number, or a number with its standard uncertainty."""
        raw = self.data.get(key)
        value, uncertainty = raw, 0.0
        if isinstance(raw, Mapping):
            check_keys(self.file, raw, _QUANTITY_KEYS, f"'{key}'")
            value, uncertainty = raw.get("value"), raw.get("standard_uncertainty", 0.0)
        for number in (value, uncertainty):
            if isinstance(number, bool) or not isinstance(number, int | float) or not _finite(number):
                raise self.error(f"'{key}' is a number or {{value, standard_uncertainty}}, not {raw!r:.80}", key)
        try:
            return Measured(float(value), float(uncertainty))  # type: ignore[arg-type]
        except InputError as error:
            raise self.error(f"'{key}': {error}", key) from None

    def positive(self, key: str) -> Measured:
        """A quantity above 0."""
        quantity = self.quantity(key)
        if not quantity.value > 0:
            raise self.error(f"'{key}' is above 0, not {quantity.value:g}", key)
        return quantity

    def percent(self, key: str) -> float:
        """A number, 0 or above; 0 where there is none."""
        if self.data.get(key) is None:
            return 0.0
        value = self.quantity(key).value
        if value < 0:
            raise self.error(f"'{key}' is 0 or above, not {value:g}", key)
        return value

    def exposure_s(self) -> float:
        """The exposure time."""
        exposure = self.data.get("exposure")
        try:
            if isinstance(exposure, bool) or not isinstance(exposure, str | int | float):
                raise InputError(f"an exposure time is seconds, such as 0.005 or 1/8000, not {exposure!r:.80}")
            return parse_exposure(exposure)
        except InputError as error:
            raise self.error(str(error), "exposure") from None

    def files(self) -> list[Path]:
        """The frames' files, patterns resolved."""
        files = self.data.get("files")
        patterns = [files] if isinstance(files, str) else files
        if not isinstance(patterns, Sequence) or not patterns or not all(isinstance(p, str) and p for p in patterns):
            raise self.error(f"'files' is a path, a pattern or a list of them, not {files!r:.80}", "files")
        return [path for pattern in patterns for path in matching_files(self.file, str(pattern), self.line)]


def _finite(number: float) -> bool:
    try:
        return math.isfinite(float(number))
    except OverflowError:  # a whole number of 400 digits
        return False


def open_spectral(path: str | PathLike[str]) -> SpectralFrames:
    """The frames of a spectral measurement, read when asked for.

    Parameters
    ----------
    path
        A spectral protocol (YAML); what it may say stands at the top of this module.

    Returns
    -------
    SpectralFrames
        All files are known to be there and alike. No pixels were read.

    Raises
    ------
    FileError
        If the protocol cannot be read or says what cannot be, or a file is missing, truncated, listed twice or unlike
        the others; with the line.
    """
    file = Path(path)
    data = read_yaml(file, "a spectral protocol")
    if not isinstance(data, Mapping) or data.get(VERSION_KEY) != 1 or isinstance(data.get(VERSION_KEY), bool):
        said = data.get(VERSION_KEY) if isinstance(data, Mapping) else None
        message = f"expected '{VERSION_KEY}: 1' (the file format's version), got {said!r:.80}"
        raise FileError(file, message, line_of(data, VERSION_KEY))
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
        raise FileError(file, str(error)) from None


@dataclass(frozen=True)
class _Opened:
    """An entry's frames, and what they share with all others."""

    frames: tuple[FrameSource, ...]
    shape: tuple[int, int]
    bits: int
    cfa: tuple[tuple[str, ...], ...]


def protocol_entries(top: ProtocolEntry, key: str, keys: Sequence[str]) -> list[ProtocolEntry]:
    """The entries of a list under a key, each with known keys only.

    Raises
    ------
    FileError
        If it is no such list; with the line.
    """
    listed = top.data.get(key)
    if not isinstance(listed, Sequence) or isinstance(listed, str) or not listed:
        raise top.error(f"'{key}' is a list of {{{', '.join(keys)}}}", key)
    entries = []
    for number, data in enumerate(listed):
        line = line_of(listed, number)
        if not isinstance(data, Mapping):
            raise FileError(top.file, f"an entry of '{key}' is {{{', '.join(keys)}}}, not {data!r:.80}", line)
        check_keys(top.file, data, keys, f"an entry of '{key}'")
        entries.append(ProtocolEntry(top.file, data, line))
    return entries


def _opened(top: ProtocolEntry, listed: Sequence[tuple[ProtocolEntry, str]]) -> dict[int, _Opened]:
    """The frames of every entry, by its identity; all are checked against each other."""
    paths = {id(entry): entry.files() for entry, _ in listed}
    kinds: dict[str, Kind] = {"dark": "dark", "light": "light"}
    files = [
        FileEntry(path, kinds[kind], entry.exposure_s(), listed_in=top.file, line=entry.line)
        for entry, kind in listed
        for path in paths[id(entry)]
    ]
    expected = Expected(stated_bits(top.file, top.data), stated_cfa(top.file, top.data))
    frames = frame_set_of_files(files, str(top.file), expected)
    if len(frames.gain_settings) > 1:
        raise top.error(f"frames have gain settings {frames.gain_settings}; all frames of a measurement have one")
    by_name = {source.name: source for group in frames.groups for source in group.frames}
    shape = (frames.rows, frames.cols)
    return {
        key: _Opened(tuple(by_name[str(path)] for path in found), shape, frames.bits, frames.cfa)
        for key, found in paths.items()
    }


def _band(entry: ProtocolEntry, opened: _Opened, diode: Photodiode | None) -> Band:
    readings = [key for key in _READINGS if entry.data.get(key) is not None]
    if len(readings) != 1:
        raise entry.error(f"a band has one reading, {' or '.join(_READINGS)}, not {len(readings)}")
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
        raise entry.error(str(error)) from None


def _passband(entry: ProtocolEntry) -> tuple[Passband, float]:
    """The band, and the standard uncertainty of its wavelength."""
    by_centre, by_file = entry.data.get("centre_nm") is not None, entry.data.get("passband") is not None
    if by_centre == by_file or (by_file and entry.data.get("bandwidth_nm") is not None):
        raise entry.error("a band has 'centre_nm' and 'bandwidth_nm', or a 'passband' (a CSV file)")
    try:
        if by_centre:
            centre, width = entry.positive("centre_nm"), entry.quantity("bandwidth_nm")
            return triangular_passband(centre.value, width.value), centre.standard_uncertainty
        name = optional_text(entry.file, entry.data, "passband") or ""
        spectrum = read_spectrum(entry.file.parent / name).spectrum
        return Passband.of_energy(spectrum), 0.0
    except InputError as error:
        raise entry.error(str(error)) from None


def _photodiode(top: ProtocolEntry) -> Photodiode | None:
    data = top.data.get("photodiode")
    if data is None:
        return None
    if not isinstance(data, Mapping):
        raise top.error(f"'photodiode' is {{{', '.join(_DIODE_KEYS)}}}, not {data!r:.80}", "photodiode")
    check_keys(top.file, data, _DIODE_KEYS, "'photodiode'")
    entry = ProtocolEntry(top.file, data, line_of(top.data, "photodiode"))
    name = optional_text(top.file, data, "responsivity")
    if name is None:
        raise entry.error("'photodiode' lacks 'responsivity', a CSV file of wavelength_nm and A/W")
    table = read_spectrum(top.file.parent / name)
    responsivity, uncertainty = table.spectrum, table.standard_uncertainty
    try:
        return Photodiode(responsivity, uncertainty, entry.positive("area_mm2"))
    except InputError as error:
        raise entry.error(str(error)) from None


def _region(top: ProtocolEntry, shape: tuple[int, int]) -> Region | None:
    raw = top.data.get("region")
    if raw is None:
        return None
    wanted = "'region' is [first row, row after the last, first column, column after the last]"
    if (
        not isinstance(raw, Sequence)
        or len(raw) != 4
        or any(isinstance(n, bool) or not isinstance(n, int) for n in raw)
    ):
        raise top.error(f"{wanted}, not {raw!r:.80}", "region")
    try:
        region = Region("region", *map(int, raw))
    except InputError as error:
        raise top.error(f"{wanted}: {error}", "region") from None
    if region.r1 > shape[0] or region.c1 > shape[1]:
        raise top.error(f"'region' reaches beyond the frames of {shape[0]} x {shape[1]}", "region")
    return region
