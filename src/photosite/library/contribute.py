"""Write a calibration as an anonymised entry that another laboratory can load."""

from __future__ import annotations

import getpass
import json
import os
import re
import socket
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.result import Calibration
from photosite.errors import FileError, InputError, did_you_mean, in_file
from photosite.files.writing import FolderLock, atomic_folder, atomic_path, date_of_files
from photosite.files.yaml import dump_yaml
from photosite.frames.camera_names import name_words
from photosite.library.entry import (
    ENTRY_NAME,
    INDEX_NAME,
    LICENSES,
    SENSOR_NAME,
    TABLE_NAME,
    CameraIndex,
    Entry,
    IndexEntry,
    LoadedEntry,
    check_entry,
    check_no_personal_data,
    entry_in_folder,
    index_file,
    published_texts,
    read_index,
    sha256_of,
)
from photosite.library.sources import entries_below
from photosite.sensor.io.sensor_file import dump_sensor
from photosite.sensor.model import Sensor

STATED = "stated by the contributor, not measured here"
"""Source of the values that the contributor's sensor file stated before the measurement."""

_COMMON_NAMES = {"root", "user", "admin", "localhost", "home", "build", "runner", "ubuntu"}
"""Names of users and machines that identify nobody, and are words of texts."""


def check_license(license_id: str | None) -> str:
    """Return an SPDX identifier of `LICENSES`.

    Raises
    ------
    InputError
        If it is missing or not one of them.

    Examples
    --------
    >>> check_license("CC0-1.0")
    'CC0-1.0'
    """
    if license_id is None:
        hint = "CC0-1.0 waives all rights, CC-BY-4.0 asks to be named"
        raise InputError("license_id", expected=f"given: one of {', '.join(LICENSES)}", hint=hint)
    if license_id not in LICENSES:
        expected = "the SPDX identifier of a license for open data"
        raise InputError("license_id", value=license_id, expected=expected, hint=did_you_mean(license_id, LICENSES))
    return license_id


def contribute(
    result: Calibration | GainSeries,
    folder: Path,
    *,
    license_id: str | None,
    camera: str | None = None,
    attribution: str | None = None,
) -> LoadedEntry:
    """Write an entry into a folder of contributed cameras, and list it in the folder's index.

    The entry holds the measured sensor, the figures of EMVA 1288 and digests. Without comments, paths, days, serial
    number, maps of the chip and notes; values that the frames did not give have no source. The index and each entry
    appear whole or not at all.

    Parameters
    ----------
    result
        The calibration, with a base sensor.
    folder
        Made where it does not exist.
    license_id
        One of `LICENSES`.
    camera
        Maker and model. Default: the name of the base sensor.
    attribution
        Name to give as the source; none if None.

    Raises
    ------
    InputError
        If the license is missing or unknown, the name is missing, or a text holds personal data.
    CalibrationError
        If the calibration has no base sensor.
    FileError
        If the folder cannot be written, or holds an invalid index.
    """
    license_id = check_license(license_id)
    steps = (
        [(step.setting, step.calibration) for step in result.steps if step.calibration.system_gain_dn_per_e.value]
        if isinstance(result, GainSeries)
        else [(result.gain_setting, result)]
    )
    measured = result.sensor
    base = steps[0][1].base
    assert base is not None  # `sensor` has raised
    camera = " ".join((camera or base.name).split())
    check_no_personal_data({"camera": camera}, _names_of_this_machine(), hint="Choose another name")
    created = date_of_files().strftime("%Y-%m")
    digests = sorted({digest for _, step in steps for digest in step.frames_sha256})
    sensor = _anonymous(measured, base, camera, license_id, created, digests)
    count = sum(step.frame_count for _, step in steps)
    settings = [setting for setting, _ in steps if setting is not None]
    table = {
        "photosite_emva1288": 1,
        "settings": [
            {"gain_setting": setting, "model": step.model, "figures": step.to_dict()["emva1288"]}
            for setting, step in steps
        ],
    }
    texts = {
        SENSOR_NAME: dump_sensor(sensor).encode(),
        TABLE_NAME: (json.dumps(table, indent=1, allow_nan=False) + "\n").encode(),
    }
    fields = {
        "photosite_entry": 1,
        "camera": camera,
        "license": license_id,
        **({} if attribution is None else {"attribution": attribution}),
        "created": created,
        "software": f"photosite {_version()}",
        "frames": count,
        "gain_settings": settings,
        "sha256": {name: sha256_of(text) for name, text in texts.items()},
    }
    with in_file(ENTRY_NAME):
        check_no_personal_data([sensor.model_dump(mode="json"), table, camera], _names_of_this_machine())
    texts[ENTRY_NAME] = dump_yaml(fields).encode()
    name = _folder_name(camera, settings, sha256_of(texts[ENTRY_NAME]))
    folder.mkdir(exist_ok=True)
    lock = FolderLock(folder)
    try:
        return _write(folder, name, texts)
    finally:
        lock.release()


def _write(folder: Path, name: str, texts: Mapping[str, bytes]) -> LoadedEntry:
    """Write the entry, check it as a reader would, then add it to the index."""
    index = folder / INDEX_NAME
    listed = index_file(index).cameras if index.exists() else ()
    target = folder / name
    if not (target / ENTRY_NAME).exists():  # else of an earlier run that ended before the index was written
        with atomic_folder(target) as temporary:
            for file, text in texts.items():
                (temporary / file).write_bytes(text)
            check_entry(entry_in_folder(temporary))
    loaded = entry_in_folder(target)
    digests = {file: sha256_of((target / file).read_bytes()) for file in (ENTRY_NAME, SENSOR_NAME, TABLE_NAME)}
    entry: Entry = loaded.entry
    new = IndexEntry(
        folder=name,
        camera=entry.camera,
        license=entry.license,
        created=entry.created,
        gain_settings=entry.gain_settings,
        sha256=digests,
    )
    entries = sorted((*(other for other in listed if other.folder != name), new), key=lambda one: one.folder)
    content = CameraIndex(photosite_camera_index=1, cameras=tuple(entries)).model_dump(mode="json")
    with atomic_path(index) as temporary:
        temporary.write_text(dump_yaml(content, width=1 << 20), encoding="utf-8")
    return loaded


def validate_cameras(path: Path) -> tuple[LoadedEntry, ...]:
    """Check an index, or the entry in a folder: format, digests, license, plausible numbers, no personal data.

    Parameters
    ----------
    path
        An index, a folder with one, or the folder or file of an entry.

    Raises
    ------
    FileError
        For the first problem.
    """
    if path.is_dir() and (path / INDEX_NAME).is_file():
        path = path / INDEX_NAME
    if path.is_dir() or path.name == ENTRY_NAME:
        folder = path if path.is_dir() else path.parent
        if not (folder / ENTRY_NAME).is_file():
            below = entries_below([folder])
            hint = (
                f"Pass the folder of an entry, such as {below[0]}"
                if below
                else "Pass an index, a folder with one, or the folder of an entry"
            )
            raise FileError(folder, f"holds neither {INDEX_NAME} nor {ENTRY_NAME}", hint=hint)
        found: tuple[LoadedEntry, ...] = (entry_in_folder(folder),)
    else:
        found = read_index(path)
    for loaded in found:
        check_entry(loaded)
    return found


def _anonymous(sensor: Sensor, base: Sensor, camera: str, license_id: str, created: str, digests: list[str]) -> Sensor:
    """Return the sensor without what tells the chip, the place, the day or the person."""
    content = sensor.model_dump(mode="json", exclude_none=True)
    content.pop("maps", None)
    content |= {"name": camera, "serial": "0"}
    # The texts of a preset are published, those of a user's file are not.
    own = set(_sources(base.model_dump(mode="json"))) - published_texts()
    _replace_sources(content, own)
    count = len(digests)
    content["provenance"] = {
        "source": f"measured from {count} frames with photosite; other values as their sources state",
        "license": license_id,
        "created": created,
        "frames_sha256": digests,
    }
    return Sensor.model_validate(content)


def _sources(content: Any) -> list[str]:
    """Return all texts under the key `source`."""
    if isinstance(content, Mapping):
        own = [value for key, value in content.items() if key == "source" and isinstance(value, str)]
        return own + [text for value in content.values() for text in _sources(value)]
    return [text for value in content for text in _sources(value)] if isinstance(content, list | tuple) else []


def _replace_sources(content: Any, texts: set[str]) -> None:
    """Replace these texts under the key `source`."""
    if isinstance(content, dict):
        if content.get("source") in texts:
            content["source"] = STATED
        for value in content.values():
            _replace_sources(value, texts)
    elif isinstance(content, list):
        for value in content:
            _replace_sources(value, texts)


def _names_of_this_machine() -> dict[str, str]:
    """Return the names of the machine, the user and the home folder, each with what it is."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # no such user in the system's list
        user = ""
    names = {
        socket.gethostname().split(".")[0]: "the name of this machine",
        user: "the name of the user",
        os.path.basename(os.path.expanduser("~")): "the name of the home folder",
    }
    return {name: what for name, what in names.items() if len(name) > 2 and name.lower() not in _COMMON_NAMES}


def _folder_name(camera: str, settings: list[float], digest: str) -> str:
    """Return a name of letters, digits and hyphens: camera, lowest and highest gain setting, digest."""
    limits = sorted({settings[0], settings[-1]}) if settings else []
    parts = [*name_words(camera), *(f"{setting:g}" for setting in limits), digest[:8]]
    plain = [re.sub(r"[^a-z0-9]+", "-", part.lower().encode("ascii", "ignore").decode()).strip("-") for part in parts]
    return "-".join(part for part in plain if part)[-120:].lstrip("-")


def _version() -> str:
    try:
        return version("photosite")
    except PackageNotFoundError:
        return "of unknown version"
