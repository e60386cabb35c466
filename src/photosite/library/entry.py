"""Contributed cameras: a measured sensor with its EMVA 1288 table, a license and digests, and indexes of them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import model_validator

from photosite.errors import FileError, InputError, in_file
from photosite.files.small_files import parse_json, read_small
from photosite.files.yaml import LARGEST_BYTES, check_version, line_of, parse_yaml, validated
from photosite.sensor.io.sensor_file import load_sensor, parse_sensor, preset_names
from photosite.sensor.model import Sensor
from photosite.sensor.quantity import NO_UNIT, about
from photosite.values.shown import Shown
from photosite.values.validated import NonNegativeNumber, Number, Section

ENTRY_NAME, INDEX_NAME = "entry.yaml", "cameras.yaml"
SENSOR_NAME, TABLE_NAME = "sensor.yaml", "emva1288.json"

License = Literal[
    "CC0-1.0",
    "CC-BY-4.0",
    "CC-BY-SA-4.0",
    "PDDL-1.0",
    "ODC-By-1.0",
    "ODbL-1.0",
    "Apache-2.0",
    "MIT",
]
"""SPDX identifiers of licenses that allow others to use and pass on data."""

LICENSES: tuple[str, ...] = get_args(License)

_SHA256 = "^[0-9a-f]{64}$"
_MONTH = r"^20\d\d-(0[1-9]|1[0-2])$"
_FOLDER = "^[a-z0-9]+([._-][a-z0-9]+)*$"
_MOST_ENTRIES = 10_000

Digests = dict[str, str]


def _digests(names: tuple[str, ...], digests: Mapping[str, str]) -> None:
    if set(digests) != set(names):
        raise InputError("sha256", value=sorted(digests), expected=f"a digest for each of {', '.join(names)}")
    for name, digest in digests.items():
        if not re.fullmatch(_SHA256, digest):
            raise InputError(name, value=digest, expected="64 hexadecimal digits")


class Entry(Section):
    """The file entry.yaml of a contributed camera."""

    photosite_entry: Literal[1] = about("Version of the file format.", NO_UNIT, 1)
    camera: str = about(
        "Maker and model of the camera or sensor.",
        NO_UNIT,
        "Nikon D200",
        min_length=2,
        max_length=80,
        pattern=r"^\S.*\S$",
    )
    license: License = about("License of the entry, an SPDX identifier.", NO_UNIT, "CC0-1.0")
    attribution: str | None = about(
        "Whom to name, if the contributor wants to be named.",
        NO_UNIT,
        "Optics lab, X University",
        default=None,
        max_length=200,
    )
    created: str = about("Month of the calibration.", NO_UNIT, "2026-11", pattern=_MONTH)
    software: str = about("The program that wrote the entry.", NO_UNIT, "photosite 0.1.0", max_length=40)
    frames: int = about("Number of frames that were used.", "1", 405, ge=1, strict=True)
    gain_settings: tuple[NonNegativeNumber, ...] = about(
        "Gain settings of the sensor file; empty if the frames do not state one.", "1", [100, 400], default=()
    )
    sha256: Digests = about("SHA-256 of the other two files.", NO_UNIT, {SENSOR_NAME: "0" * 64, TABLE_NAME: "0" * 64})

    @model_validator(mode="after")
    def _check(self) -> Entry:
        _digests((SENSOR_NAME, TABLE_NAME), self.sha256)
        return self


class IndexEntry(Section):
    """A contributed camera in an index."""

    folder: str = about(
        "Folder of the entry, beside the index.", NO_UNIT, "nikon-d200-iso100-0a1b2c3d", pattern=_FOLDER, max_length=120
    )
    camera: str = about("As in the entry.", NO_UNIT, "Nikon D200", max_length=80)
    license: License = about("As in the entry.", NO_UNIT, "CC0-1.0")
    created: str = about("As in the entry.", NO_UNIT, "2026-11", pattern=_MONTH)
    gain_settings: tuple[NonNegativeNumber, ...] = about("As in the entry.", "1", [100, 400], default=())
    sha256: Digests = about(
        "SHA-256 of all files of the entry.",
        NO_UNIT,
        dict.fromkeys((ENTRY_NAME, SENSOR_NAME, TABLE_NAME), "0" * 64),
    )

    @model_validator(mode="after")
    def _check(self) -> IndexEntry:
        _digests((ENTRY_NAME, SENSOR_NAME, TABLE_NAME), self.sha256)
        return self


class CameraIndex(Section):
    """The file cameras.yaml: an index of contributed cameras."""

    photosite_camera_index: Literal[1] = about("Version of the file format.", NO_UNIT, 1)
    cameras: tuple[IndexEntry, ...] = about("The entries.", NO_UNIT, [], max_length=_MOST_ENTRIES)

    @model_validator(mode="after")
    def _check(self) -> CameraIndex:
        folders = [entry.folder for entry in self.cameras]
        if len(set(folders)) != len(folders):
            raise InputError("cameras", value=len(folders), expected="entries in different folders")
        return self


class EmvaFigure(Section):
    """A figure of EMVA 1288."""

    value: Number | None = about("The value; null if it could not be estimated.", "that of `unit`", 0.28)
    standard_uncertainty: NonNegativeNumber | None = about(
        "Standard uncertainty.", "that of `unit`", 0.001, default=None
    )
    signed_value: Number | None = about("Signed root of a negative variance.", "that of `unit`", -0.1, default=None)
    interval_95: tuple[Number, Number] | None = about("95 % interval.", "that of `unit`", [0.27, 0.29], default=None)
    upper_limit_95: Number | None = about(
        "Upper limit of a value that is not above 0.", "that of `unit`", 0.1, default=None
    )
    reason: str | None = about("Why there is no value.", NO_UNIT, "needs photons", default=None, max_length=1000)
    method: str | None = about("How it was estimated.", NO_UNIT, "photon transfer", default=None, max_length=1000)
    unit: str = about("Unit.", NO_UNIT, "DN/e⁻", max_length=40)


class EmvaSetting(Section):
    """The figures at one gain setting."""

    gain_setting: NonNegativeNumber | None = about("Gain setting, null if unknown.", "1", 100, default=None)
    model: Literal["linear", "general"] = about("Camera model of EMVA 1288 R4.0.", NO_UNIT, "general")
    figures: dict[str, EmvaFigure] = about("By the symbols of the standard.", NO_UNIT, {}, max_length=200)


class EmvaTable(Section):
    """The file emva1288.json."""

    photosite_emva1288: Literal[1] = about("Version of the file format.", NO_UNIT, 1)
    settings: tuple[EmvaSetting, ...] = about("One for each gain setting.", NO_UNIT, [], min_length=1, max_length=1000)


SCHEMAS: dict[str, type[Section]] = {"entry": Entry, "index": CameraIndex, "table": EmvaTable}
"""The formats, whose JSON Schemas `photosite cameras schema` prints."""


@dataclass(frozen=True)
class LoadedEntry(Shown):
    """An entry whose files agree with its digests.

    Parameters
    ----------
    folder, entry
        Its folder, and the content of entry.yaml.
    sensor
        The measured sensor.
    table
        The EMVA 1288 figures by gain setting.
    """

    folder: Path
    entry: Entry
    sensor: Sensor
    table: EmvaTable


def entry_in_folder(folder: Path, digests: Mapping[str, str] | None = None) -> LoadedEntry:
    """Read the entry in a folder, checked against its own digests and those of an index.

    Raises
    ------
    FileError
        If a file is missing, changed or invalid.
    """
    texts = {}
    for name in (ENTRY_NAME, SENSOR_NAME, TABLE_NAME):
        path = folder / name
        if path.is_symlink():
            raise FileError(path, "is a link, and an entry holds its own files")
        texts[name] = read_small(path, "a file of a contributed camera", LARGEST_BYTES)
    if digests is not None:
        _compare(folder, texts, digests, "the index")
    path = folder / ENTRY_NAME
    data = parse_yaml(_text(texts[ENTRY_NAME], path), path)
    check_version(path, data, "photosite_entry")
    entry: Entry = validated(Entry, data, path)
    _compare(folder, texts, entry.sha256, ENTRY_NAME)
    sensor = parse_sensor(_text(texts[SENSOR_NAME], folder / SENSOR_NAME), folder / SENSOR_NAME)
    if sensor.maps is not None:
        raise FileError(folder / SENSOR_NAME, "names maps of a chip, which an entry does not hold")
    table = _table(texts[TABLE_NAME], folder / TABLE_NAME)
    if sensor.name != entry.camera:
        raise FileError(
            folder / SENSOR_NAME, "name", value=sensor.name, expected=f"'{entry.camera}', as in {ENTRY_NAME}"
        )
    if sensor.provenance.license != entry.license:
        expected = f"{entry.license}, as in {ENTRY_NAME}"
        raise FileError(folder / SENSOR_NAME, "license", value=sensor.provenance.license, expected=expected)
    return LoadedEntry(folder, entry, sensor, table)


def index_file(path: Path) -> CameraIndex:
    """Read an index without its entries; raise `FileError` if it is missing or invalid."""
    data = parse_yaml(_text(read_small(path, "an index of cameras", LARGEST_BYTES), path), path)
    check_version(path, data, "photosite_camera_index")
    index: CameraIndex = validated(CameraIndex, data, path)
    return index


def read_index(path: Path) -> tuple[LoadedEntry, ...]:
    """Read an index and its entries, checked against their digests.

    Raises
    ------
    FileError
        If a file is missing, changed or invalid; with the line of the index where an entry differs from it.
    """
    data = parse_yaml(_text(read_small(path, "an index of cameras", LARGEST_BYTES), path), path)
    found = []
    for k, stated in enumerate(index_file(path).cameras):
        loaded = entry_in_folder(path.parent / stated.folder, stated.sha256)
        for name in ("camera", "license", "created", "gain_settings"):
            if getattr(stated, name) != (own := getattr(loaded.entry, name)):
                expected = f"{own!r}, as in {stated.folder}/{ENTRY_NAME}"
                raise FileError(path, name, line_of(data["cameras"], k), value=getattr(stated, name), expected=expected)
        found.append(loaded)
    return tuple(found)


def sha256_of(content: bytes) -> str:
    """Return the SHA-256 of bytes, hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _compare(folder: Path, texts: Mapping[str, bytes], digests: Mapping[str, str], stated_by: str) -> None:
    for name, digest in digests.items():
        if (own := sha256_of(texts[name])) != digest:
            expected = f"{digest[:12]}..., as {stated_by} states: the file has changed"
            raise FileError(folder / name, "sha256", value=f"{own[:12]}...", expected=expected)


def _table(content: bytes, path: Path) -> EmvaTable:
    table: EmvaTable = validated(EmvaTable, parse_json(content, path), path)
    return table


def _text(content: bytes, path: Path) -> str:
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise FileError(path, "is not text in UTF-8") from None


# Checks beyond the format


def check_entry(loaded: LoadedEntry) -> None:
    """Check that an entry's numbers are plausible and that its texts hold no personal data.

    Raises
    ------
    FileError
        For the first problem.
    """
    for path, texts in (
        (loaded.folder / ENTRY_NAME, loaded.entry.model_dump(mode="json", exclude={"attribution"})),
        (loaded.folder / SENSOR_NAME, loaded.sensor.model_dump(mode="json", exclude_none=True)),
        (loaded.folder / TABLE_NAME, loaded.table.model_dump(mode="json", exclude_none=True)),
    ):
        with in_file(path):
            check_no_personal_data(texts)
    with in_file(loaded.folder / SENSOR_NAME):
        _check_plausible(loaded.sensor)
    with in_file(loaded.folder / TABLE_NAME):
        _check_table(loaded)


_PERSONAL = {
    "a path": re.compile(r"(?:^|[\s\"'(=,;])(?:~|\.{0,2}(?:/[\w.~+-]+))(?:/[\w.~+-]+)+|\b[A-Za-z]:\\|\\\\\w|file:/"),
    "an e-mail address": re.compile(r"[\w.+-]+@[\w-]+\.\w+"),
    "an address of a machine": re.compile(r"\b\d{1,3}(?:\.\d{1,3}){3}\b|\b(?:[0-9a-f]{2}:){5}[0-9a-f]{2}\b", re.I),
    "a day": re.compile(r"\b(?:19|20)\d\d-[01]\d-[0-3]\d"),
    "a serial number": re.compile(r"\b(?:serial(?: number| no\.?)?|s/n)\W{0,3}\w*\d", re.I),
}
"""What an entry's texts must not hold."""


def check_no_personal_data(
    content: Any, forbidden: Mapping[str, str] | None = None, hint: str = "Remove it from the sensor file"
) -> None:
    """Raise `InputError` for the first text with a path, address, day or serial number.

    Parameters
    ----------
    content
        Mappings and lists with texts.
    forbidden
        Other words that must not occur, each with what it is, such as the name of this machine.
    hint
        What to do.
    """
    words = {
        what: re.compile(rf"(?<!\w){re.escape(word)}(?!\w)", re.I) for word, what in (forbidden or {}).items() if word
    }
    for place, text in _texts(content):
        if place == "serial" and text != "0":
            raise InputError("serial", value=text, expected="'0': the chip's number is removed")
        for what, pattern in (*_PERSONAL.items(), *words.items()):
            if (match := pattern.search(text)) and text not in published_texts():
                expected = f"a text without {what}"
                raise InputError(place, value=match[0].strip(), expected=expected, hint=hint)


@cache
def published_texts() -> frozenset[str]:
    """Return the sources in the presets, which are public."""
    presets = (load_sensor(name).model_dump(mode="json", exclude_none=True) for name in preset_names())
    return frozenset(text for preset in presets for place, text in _texts(preset) if place.endswith("source"))


def _texts(content: Any, place: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(content, str):
        yield place, content
    elif isinstance(content, Mapping):
        for key, value in content.items():
            inner = f"{place}.{key}" if place else str(key)
            yield f"a key of {place or 'the file'}", str(key)
            yield from _texts(value, inner)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _texts(value, place)


_PLAUSIBLE = {
    "system_gain_dn_per_e": (1e-4, 1e4),
    "read_noise_e": (0.01, 3000.0),
    "well_capacity_e": (10.0, 1e8),
    "width_um": (0.3, 200.0),
    "height_um": (0.3, 200.0),
    "prnu_percent": (0.0, 10.0),
}
"""Ranges that are wider than those of any sensor on the market."""

_AGREEMENT = 0.3
"""Largest relative difference of the gain in the table and in the sensor file."""


def _check_plausible(sensor: Sensor) -> None:
    values = {
        "system_gain_dn_per_e": sensor.system_gain_dn_per_e,
        "read_noise_e": sensor.electrons(sensor.noise.read_noise_mv.value),
        "well_capacity_e": sensor.pixel.well_capacity_e.value,
        "width_um": sensor.pixel.width_um.value,
        "height_um": sensor.pixel.height_um.value,
        "prnu_percent": sensor.noise.prnu_percent.value,
    }
    for name, value in values.items():
        low, high = _PLAUSIBLE[name]
        if not low <= value <= high:
            raise InputError(name, value=value, expected=f"plausible: {low:g} to {high:g}")


def _check_table(loaded: LoadedEntry) -> None:
    sensor = loaded.sensor
    settings = [entry.gain_setting for entry in loaded.table.settings]
    if loaded.entry.gain_settings and settings != list(loaded.entry.gain_settings):
        raise InputError("settings", value=settings, expected=f"those of {ENTRY_NAME}, {loaded.entry.gain_settings}")
    for entry in loaded.table.settings:
        at = sensor
        if entry.gain_setting is not None and sensor.gain_settings:
            at = sensor.at_gain_setting(entry.gain_setting)
        gain = entry.figures.get("K")
        stated = at.system_gain_dn_per_e
        if gain is not None and gain.value is not None and abs(gain.value / stated - 1.0) > _AGREEMENT:
            raise InputError("K", value=gain.value, expected=f"within 30 % of the sensor file's, {stated:.4g} DN/e-")
