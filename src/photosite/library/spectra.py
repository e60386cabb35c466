"""Spectral sensitivities of cameras in rawtoaces' JSON and in CSV."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.color.wavelength_units import NANOMETRES_PER, camera_unit, heading_unit
from photosite.errors import FileError, InputError
from photosite.files.small_files import finite_number, valid_content
from photosite.files.text_table import read_table, split_percent
from photosite.sensor.model import Sensor
from photosite.sensor.sections import Channel
from photosite.values.read_only import ReadOnly
from photosite.values.shown import Shown

_WHAT = "a table of spectral sensitivities"
_LARGEST_CSV = 1 << 20
_MOST_WAVELENGTHS = 10_000
_RANGE_IN_NAME = re.compile(r"(?P<camera>.+?)_(?P<first>\d{3,4})_(?P<last>\d{3,4})_(?P<step>\d{1,3})")


@dataclass(frozen=True, eq=False)
class SpectralSensitivity(Shown):
    """Relative spectral sensitivity of a camera's channels.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing.
    channels
        Per channel, (wavelengths,): response per energy of light, relative; the largest of all channels is near 1.
    """

    wavelength_nm: NDArray[np.float64]
    channels: Mapping[str, NDArray[np.float64]]

    def sensor(self, base: Sensor) -> Sensor:
        """Return a sensor with these channels in place of those of `base`.

        The quantum efficiency is the response per energy over the wavelength, because a photon has the energy h c /
        wavelength. It is scaled such that its largest value is that of `base`, and marked as assumed. A single channel
        is that of a `base` with one, whatever its name.

        Raises
        ------
        InputError
            If `base` has channels that the table lacks.
        """
        names = tuple(base.channels)
        own = dict(self.channels)
        if len(own) == len(names) == 1:
            own = dict(zip(names, own.values(), strict=True))
        if not set(names) <= own.keys():
            expected = f"{', '.join(names)}, the channels of the sensor '{base.name}'"
            what, hint = (
                "the headings of the spectral sensitivity",
                "Rename the columns of the table, or name its sensor",
            )
            raise InputError(what, value=list(own), expected=expected, hint=hint)
        per_photon = {name: np.maximum(own[name], 0.0) / self.wavelength_nm for name in names}
        peak = max(max(channel.quantum_efficiency) for channel in base.channels.values())
        scale = peak / max(float(values.max()) for values in per_photon.values())
        channels = {
            name: Channel(
                wavelength_nm=tuple(self.wavelength_nm.tolist()),
                quantum_efficiency=tuple(np.minimum(scale * values, 1.0).tolist()),
                source="relative spectral sensitivity, scaled to the largest quantum efficiency of the base sensor",
                assumed=True,
            )
            for name, values in per_photon.items()
        }
        return base.with_(channels=channels)


@dataclass(frozen=True)
class SpectralFile(Shown):
    """A camera's spectral sensitivity with the origin that its file states; "" where it states none."""

    maker: str
    model: str
    license: str
    provenance: str
    sensitivity: SpectralSensitivity


def rawtoaces_camera(data: Mapping[str, Any], path: Path) -> SpectralFile:
    """Return the camera of a rawtoaces JSON file's content: `header`, and `spectral_data` by wavelength.

    Raises
    ------
    FileError
        If the content is invalid, or the quantity is not a relative response.

    References
    ----------
    AcademySoftwareFoundation/rawtoaces-data, README, JSON schema for spectral datasets.
    """
    with valid_content(path, _WHAT):
        header, spectral = data["header"], data["spectral_data"]
        unit = spectral.get("units", spectral.get("quantity", "relative"))
        if unit != "relative":
            raise ValueError(f"its units are '{str(unit)[:40]}', not 'relative'")
        names = [str(name) for name in spectral["index"]["main"]]
        rows = spectral["data"]["main"]
        if not 2 <= len(rows) <= _MOST_WAVELENGTHS or len(set(names)) != len(names):
            raise ValueError("it needs 2 or more wavelengths and different channels")
        table = sorted((float(key), [finite_number(value, key) for value in values]) for key, values in rows.items())
        if (wrong := next((row for row in table if len(row[1]) != len(names)), None)) is not None:
            raise ValueError(f"the wavelength {wrong[0]:g} has {len(wrong[1])} values, for {len(names)} channels")
        wavelength_nm = np.array([key for key, _ in table])
        values = np.array([row for _, row in table])
        creator = header.get("laboratory") or header.get("document_creator")
        date = str(header.get("document_creation_date") or "")[:10]
        said = [f"measured by {creator}" if creator else "", date, str(header.get("description") or "")]
        texts = {name: str(header.get(name) or "") for name in ("manufacturer", "model", "license")}
        return SpectralFile(
            *(texts["manufacturer"], texts["model"], texts["license"], ", ".join(filter(None, said))),
            _sensitivity(wavelength_nm, names, values),
        )


def csv_camera(path: Path) -> SpectralFile:
    """Read a table of text with a column for each channel, as `photosite.files.text_table` reads tables.

    The first column is the wavelength, in nm unless its heading states another unit: wavelength, lambda or nm, with or
    without the unit (`wavelength_nm`, `Wavelength [um]`). A column `R (%)` or `R_percent` is in percent. Without a
    heading the channels are R, G and B, or M for one, and the first column may be missing where the name of the file
    ends in first and last wavelength and step, as that of rawtoaces' older file `Nikon_D200_380_780_5`. Comments
    such as `# camera: Nikon D200` state camera, maker, model and license; otherwise the camera is the name of the file.

    Raises
    ------
    FileError
        If the file is missing or is not such a table, with the line.
    """
    table = read_table(path, _WHAT, _LARGEST_CSV)
    named = _RANGE_IN_NAME.fullmatch(path.stem if path.suffix.lower() in (".csv", ".txt") else path.name)
    if len(table.rows) < 2:
        found = "is empty" if not table.rows else "needs 2 or more wavelengths"
        raise table.error(f"it {found}")
    unit = None
    if table.heading is not None:
        is_wavelength, unit = heading_unit(table.heading[0])
        if not is_wavelength:
            expected = "the wavelength, such as wavelength, wavelength_nm, wavelength (um), nm or lambda"
            what = "the heading of the first column"
            raise FileError(path, what, table.heading_line, value=table.heading[0], expected=expected)
        stated = [split_percent(cell) for cell in table.heading[1:]]
        names = [_channel(cell) for cell, _ in stated]
        if not names or len(set(names)) != len(names):
            what = "it needs one column or more for channels, each with another heading"
            raise table.error(what, table.heading_line)
        values = np.array(table.numbers(len(names) + 1))
        values[:, 1:] /= [100.0 if percent else 1.0 for _, percent in stated]
    else:
        values = np.array(table.numbers(_WITHOUT_HEADING if named is None else (3, *_WITHOUT_HEADING)))
        if named is not None and values.shape[1] == 3:
            first, last, step = (int(named[part]) for part in ("first", "last", "step"))
            grid = np.arange(first, last + 1, max(step, 1), dtype=np.float64)
            if len(grid) != len(values):
                what = f"it has {len(values)} rows, its name means {len(grid)} wavelengths"
                raise table.error(what)
            values = np.column_stack([grid, values])
        names = ["M"] if values.shape[1] == 2 else ["R", "G", "B"]
    if unit is None and (unit := camera_unit(values[:, 0])) is None:
        what = f"the first column is no wavelength in nm or um, {values[0, 0]:g}"
        raise table.error(what, table.lines[0], hint="Write a heading such as wavelength_nm,R,G,B")
    if (odd := np.flatnonzero(np.diff(values[:, 0]) <= 0)).size:
        what = f"the wavelengths must increase, {values[odd[0] + 1, 0]:g} does not"
        raise table.error(what, table.lines[odd[0] + 1])
    with valid_content(path, _WHAT):
        sensitivity = _sensitivity(values[:, 0] * NANOMETRES_PER[unit], names, values[:, 1:])
    said = dict(table.stated)
    stem = named["camera"].replace("-", "_") if named else path.stem
    maker, _, model = stem.partition("_")
    if named_in_comments := {"camera", "maker", "manufacturer", "model"} & said.keys():
        maker = said.pop("maker", said.pop("manufacturer", ""))
        model = said.pop("model", said.pop("camera", ""))
    license_ = said.pop("license", "")
    provenance = ", ".join(f"{name}: {text}" for name, text in said.items())
    return SpectralFile(
        maker, model if named_in_comments else model.replace("_", " "), license_, provenance, sensitivity
    )


_WITHOUT_HEADING = (2, 4)
"""Columns of tables without a heading: wavelength, and M or R, G and B."""


def _sensitivity(
    wavelength_nm: NDArray[np.float64], names: list[str], values: NDArray[np.float64]
) -> SpectralSensitivity:
    if len(wavelength_nm) < 2 or not (np.diff(wavelength_nm) > 0).all():
        raise ValueError("the wavelengths must be two or more, and increase")
    if not (wavelength_nm[0] >= 50.0 and wavelength_nm[-1] <= 20_000.0):
        raise ValueError("the wavelengths must be in nm")
    if not np.isfinite(values).all() or not (values.max(axis=0) > 0).all():
        raise ValueError("the values must be finite, and every channel needs one above 0")
    wavelength_nm.flags.writeable = values.flags.writeable = False
    return SpectralSensitivity(wavelength_nm, ReadOnly({name: values[:, k] for k, name in enumerate(names)}))


def _channel(heading: str) -> str:
    """Return R, G or B for a heading such as red or R, else the heading."""
    return {"red": "R", "green": "G", "blue": "B"}.get(
        heading.lower(), heading.upper() if len(heading) == 1 else heading
    )
