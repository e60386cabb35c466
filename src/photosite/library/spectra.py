"""Spectral sensitivities of cameras in rawtoaces' JSON and in CSV."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.small_files import finite_number, read_small, valid_content
from photosite.sensor.model import Sensor
from photosite.sensor.sections import Channel
from photosite.values.read_only import ReadOnly
from photosite.values.shown import Shown

_WHAT = "a table of spectral sensitivities"
_LARGEST_CSV = 1 << 20
_MOST_WAVELENGTHS = 10_000
_RANGE_IN_NAME = re.compile(r"(?P<camera>.+?)_(?P<first>\d{3,4})_(?P<last>\d{3,4})_(?P<step>\d{1,3})")
_WAVELENGTH_HEADING = re.compile(r"(wavelengths?|lambda|λ)( (in )?nm)?|nm")


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
        wavelength. It is scaled such that its largest value is that of `base`, and marked as assumed.

        Raises
        ------
        InputError
            If `base` has channels that the table lacks.
        """
        per_photon = {name: np.maximum(values, 0.0) / self.wavelength_nm for name, values in self.channels.items()}
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
            if name in base.channels
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
    """Read a CSV file with a column for each channel; the name of the file is the camera's.

    With a heading, the first column is the wavelength in nm, headed wavelength, lambda or nm, with or without the unit
    (`wavelength_nm`, `Wavelength (nm)`). Without one, the columns are R, G and B, and the name ends in first and last
    wavelength and step, as that of rawtoaces' older file `Nikon_D200_380_780_5`.

    Raises
    ------
    FileError
        If the file is missing or is not such a table.
    """
    try:
        lines = read_small(path, _WHAT, _LARGEST_CSV).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileError(path, f"is not {_WHAT}: it is not text in UTF-8") from None
    numbers = [k for k, line in enumerate(lines, 1) if line.strip()]
    cells = [[cell.strip().strip('"') for cell in re.split(r"[,;\t]", lines[k - 1])] for k in numbers]
    named = _RANGE_IN_NAME.fullmatch(path.stem if path.suffix.lower() in (".csv", ".txt") else path.name)
    camera = named["camera"] if named else path.stem
    maker, _, model = camera.replace("-", "_").partition("_") if named else camera.partition("_")
    with valid_content(path, _WHAT):
        if not cells:
            raise ValueError("it is empty")
        has_heading = not _is_number(cells[0][0])
        if has_heading:
            _check_wavelength_heading(cells[0][0], path, numbers[0])
            names, rows = [_channel(cell) for cell in cells[0][1:]], cells[1:]
        elif named is not None:
            names, rows = ["R", "G", "B"], cells
        else:
            raise ValueError("it has no heading, and its name does not end in first_last_step wavelengths in nm")
        width = len(names) + has_heading
        if not names or len(set(names)) != len(names):
            raise ValueError("it needs one column or more for channels, each with another heading")
        if len(rows) < 2:
            raise ValueError("it needs 2 or more wavelengths")
        for line, row in zip(numbers[has_heading:], rows, strict=True):
            _check_row(row, width, path, line)
        table = np.array([[float(cell) for cell in row] for row in rows], dtype=np.float64)
        if has_heading:
            wavelength_nm, values = table[:, 0], table[:, 1:]
        elif named is not None:
            first, last, step = (int(named[part]) for part in ("first", "last", "step"))
            wavelength_nm, values = np.arange(first, last + 1, max(step, 1), dtype=np.float64), table
            if len(wavelength_nm) != len(values):
                raise ValueError(f"it has {len(values)} rows, and its name means {len(wavelength_nm)} wavelengths")
        return SpectralFile(maker, model.replace("_", " "), "", "", _sensitivity(wavelength_nm, names, values))


def _check_wavelength_heading(heading: str, path: Path, line: int) -> None:
    if not _WAVELENGTH_HEADING.fullmatch(" ".join(re.split(r"[\s_()\[\]/-]+", heading.lower())).strip()):
        expected = "the wavelength in nm: wavelength, wavelength_nm, wavelength (nm), nm or lambda"
        raise FileError(path, "the heading of the first column", line, value=heading, expected=expected)


def _check_row(row: list[str], width: int, path: Path, line: int) -> None:
    problem = None
    if len(row) != width:
        problem = f"the row has {len(row)} cells, not {width}"
    elif (wrong := next((cell for cell in row if not _is_number(cell)), None)) is not None:
        problem = f"a cell is not a finite number: {wrong[:40]!r}"
    if problem is not None:
        raise FileError(path, f"the file is not {_WHAT}: {problem}", line)


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


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _channel(heading: str) -> str:
    """Return R, G or B for a heading such as red or R, else the heading."""
    return {"red": "R", "green": "G", "blue": "B"}.get(
        heading.lower(), heading.upper() if len(heading) == 1 else heading
    )
