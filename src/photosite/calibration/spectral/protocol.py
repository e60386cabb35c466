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

from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from photosite.calibration.spectral.bands import Band, Passband, Photodiode, SpectralFrames, triangular_passband
from photosite.color.spectrum import load_spectrum
from photosite.errors import FileError, InputError
from photosite.files.yaml import check_version, line_at, line_of, read_yaml, validated
from photosite.frames.frame_file import FrameFile, SetProperties
from photosite.frames.frame_set import FrameSource
from photosite.frames.frame_settings import FrameSettings, Kind
from photosite.frames.from_files import frame_sets_from_files
from photosite.frames.io.protocol import matching_files
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.quantity import NotNegative, Positive
from photosite.values.cfa import Cfa, cfa_from
from photosite.values.exposure import parse_exposure
from photosite.values.region import Region
from photosite.values.uncertain import Measured
from photosite.values.validated import Section

Files = Annotated[
    tuple[Annotated[str, Field(min_length=1)], ...],
    BeforeValidator(lambda raw: [raw] if isinstance(raw, str) else raw),
    Field(min_length=1),
]
"""Paths and patterns; one may stand without a list."""

_Model = TypeVar("_Model", bound="SpectralProtocol")


def _region(raw: Any) -> Region:
    whole = isinstance(raw, Sequence) and all(isinstance(n, int) and not isinstance(n, bool) for n in raw)
    if not whole or len(raw) != 4:
        expected = "[first row, row after the last, first column, column after the last]"
        raise InputError("region", value=raw, expected=expected)
    return Region("region", *map(int, raw))


class FrameEntry(Section):
    """Frames of one exposure time in a spectral protocol."""

    exposure: Annotated[float, PlainValidator(parse_exposure)]
    files: Files

    def paths(self, protocol: Path, line: int | None) -> list[Path]:
        """Return the files, with patterns resolved; `line` is that of the entry, for errors."""
        return [path for pattern in self.files for path in matching_files(protocol, pattern, line)]


class SpectralProtocol(Section):
    """Fields that the protocols of bands and of charts share."""

    photosite_spectral: Literal[1]
    name: str | None = None
    sensor: str | None = None
    bits: Annotated[int, Field(strict=True, ge=1, le=16)] | None = None
    cfa: Annotated[Cfa, PlainValidator(cfa_from)] | None = None


class _Photodiode(Section):
    area_mm2: Positive
    responsivity: str

    def read(self, folder: Path) -> Photodiode:
        table = load_spectrum(folder / self.responsivity)
        return Photodiode(table.spectrum, table.standard_uncertainty, self.area_mm2)


class _Band(FrameEntry):
    centre_nm: Positive | None = None
    bandwidth_nm: NotNegative | None = None
    passband: str | None = None
    irradiance_w_m2: Positive | None = None
    photocurrent_a: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.irradiance_w_m2 is None) == (self.photocurrent_a is None):
            raise InputError("the reading", expected="exactly one of irradiance_w_m2 and photocurrent_a")
        light = {name for name in ("centre_nm", "bandwidth_nm", "passband") if getattr(self, name) is not None}
        if light not in ({"centre_nm", "bandwidth_nm"}, {"passband"}):
            raise InputError("the band", expected="'centre_nm' and 'bandwidth_nm', or a 'passband' (CSV file)")
        return self

    def band(self, frames: tuple[FrameSource, ...], diode: Photodiode | None, folder: Path) -> Band:
        uncertainty_nm = 0.0
        if self.centre_nm is not None and self.bandwidth_nm is not None:
            passband = triangular_passband(self.centre_nm.value, self.bandwidth_nm.value)
            uncertainty_nm = self.centre_nm.standard_uncertainty
        else:
            passband = Passband.of_energy(load_spectrum(folder / str(self.passband)).spectrum)
        name = f"{passband.centre_nm:g} nm"
        if self.irradiance_w_m2 is not None:
            return Band(name, passband, self.exposure, frames, self.irradiance_w_m2, None, uncertainty_nm)
        if diode is None:
            hint = "A reading in amperes needs the photodiode's area and responsivity"
            raise InputError("photodiode", where=name, value=None, expected="given", hint=hint)
        reading = self.photocurrent_a
        assert reading is not None  # checked above
        return Band(name, passband, self.exposure, frames, reading, diode, uncertainty_nm)


class _Bands(SpectralProtocol):
    region: Annotated[Region, PlainValidator(_region)] | None = None
    photodiode: _Photodiode | None = None
    scale_uncertainty_percent: NotNegative = Measured(0.0)
    exposure_uncertainty_percent: NotNegative = Measured(0.0)
    darks: tuple[FrameEntry, ...] = Field(min_length=1)
    bands: tuple[_Band, ...] = Field(min_length=1)


def read_spectral_protocol(file: Path, model: type[_Model]) -> tuple[_Model, Any]:
    """Return the content of a spectral protocol, and its YAML for line numbers.

    Raises
    ------
    FileError
        If the file cannot be read or its content is invalid; with the line.
    """
    data = read_yaml(file, "a spectral protocol")
    check_version(file, data, "photosite_spectral")
    return validated(model, data, file), data


def open_spectral(path: str | PathLike[str]) -> SpectralFrames:
    """Open the measurement of a spectral protocol, without reading pixels.

    Parameters
    ----------
    path
        Spectral protocol (YAML); the module docstring shows its content.

    Raises
    ------
    FileError
        If the protocol is invalid, or a file is missing, truncated, listed twice or different from the others.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.raw_frame import RawFrame
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name, level in (("dark", 64), ("550", 900)):
    ...         RawFrame(np.full((4, 6), level, np.uint16), bits=12).save(f"{folder}/{name}.png")
    ...     _ = Path(folder, "bands.yaml").write_text(
    ...         "photosite_spectral: 1\\n"
    ...         "darks: [{exposure: 1/50, files: dark.png}]\\n"
    ...         "bands: [{centre_nm: 550, bandwidth_nm: 10, exposure: 1/50, files: 550.png, irradiance_w_m2: 0.01}]\\n"
    ...     )
    ...     frames = open_spectral(f"{folder}/bands.yaml")
    >>> [band.name for band in frames.bands], frames.rows, frames.cols
    (['550 nm'], 4, 6)
    """
    file = Path(path)
    protocol, data = read_spectral_protocol(file, _Bands)
    files: list[list[FrameFile]] = []
    kinds: tuple[tuple[Kind, str, Sequence[FrameEntry]], ...]
    kinds = (("dark", "darks", protocol.darks), ("light", "bands", protocol.bands))
    for kind, key, entries in kinds:
        for number, entry in enumerate(entries):
            line = line_at(data, (key, number))
            settings = FrameSettings(kind, entry.exposure)
            files.append([FrameFile(found, settings, file, line) for found in entry.paths(file, line)])
    (together,) = frame_sets_from_files(
        [one for entry in files for one in entry],
        str(file),
        SetProperties(protocol.bits, protocol.cfa),
        together=("filter",),  # a monochromator may state its filters
    )
    if len(together.gain_settings) > 1:
        raise FileError(file, "gain settings of the frames", value=together.gain_settings, expected="all the same")
    sources = _by_entry(files, [source for group in together.groups for source in group.frames])
    if (region := protocol.region) is not None and (region.r1 > together.rows or region.c1 > together.cols):
        inside, value = f"inside the frames of {together.rows} x {together.cols}", list(data["region"])
        raise FileError(file, "region", line_of(data, "region"), value=value, expected=inside)
    darks: dict[float, tuple[FrameSource, ...]] = {}
    for entry, frames in zip(protocol.darks, sources, strict=False):  # those of the bands follow
        darks[entry.exposure] = darks.get(entry.exposure, ()) + frames
    line = line_of(data, "photodiode")
    try:
        diode = None if protocol.photodiode is None else protocol.photodiode.read(file.parent)
        bands = []
        for number, (band, frames) in enumerate(zip(protocol.bands, sources[len(protocol.darks) :], strict=True)):
            line = line_at(data, ("bands", number))
            bands.append(band.band(frames, diode, file.parent))
        line = None
        return SpectralFrames(
            bands=tuple(bands),
            darks=darks,
            rows=together.rows,
            cols=together.cols,
            bits=together.bits,
            cfa=together.cfa,
            sensor=None if protocol.sensor is None else load_sensor(file.parent / protocol.sensor),
            region=region,
            scale_uncertainty_percent=protocol.scale_uncertainty_percent.value,
            exposure_uncertainty_percent=protocol.exposure_uncertainty_percent.value,
            source=str(file),
        )
    except InputError as error:
        raise error.in_file(file, line) from None


def _by_entry(files: Sequence[Sequence[FrameFile]], sources: Iterable[FrameSource]) -> list[tuple[FrameSource, ...]]:
    """Return the frames of each entry; a file may hold several."""
    paths = {one.name for entry in files for one in entry}
    held: dict[str, list[FrameSource]] = {path: [] for path in paths}
    for source in sources:
        # The name of a frame in a file of several is the path with a label.
        path = source.name if source.name in paths else max(filter(source.name.startswith, paths), key=len)
        held[path].append(source)
    return [tuple(source for one in entry for source in held[one.name]) for entry in files]
