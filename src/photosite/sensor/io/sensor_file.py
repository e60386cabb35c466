"""Sensor files: YAML, the presets, and the maps beside them in HDF5."""

from __future__ import annotations

import hashlib
import math
import os
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, replace
from functools import lru_cache
from importlib import resources
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, did_you_mean, message_of
from photosite.files.hdf5 import check_own_data, create_hdf5
from photosite.files.small_files import check_stored_file, reading
from photosite.files.writing import FolderLock, atomic_path, is_temporary, sync
from photosite.files.yaml import check_version, dump_yaml, parse_yaml, read_text, rewrite_yaml, validated
from photosite.sensor.chip import MAP_UNITS, Blinking, DefectKind, Defects, MeasuredChip
from photosite.sensor.file_units import (
    AMPLIFIER,
    CONVERSION,
    DN_PER_E,
    E_PER_DN,
    IN_ELECTRONS,
    SETTING_VALUES,
    SWING,
    UNITS,
    in_file_units,
    model_fields_of,
    stated_names,
)
from photosite.sensor.model import Sensor, Written
from photosite.sensor.quantity import Covariance, as_file_value
from photosite.sensor.sections import SECTIONS, Maps
from photosite.values.uncertain import Measured

_SUFFIX = ".sensor.yaml"

_NOISE_IN_VOLTS_OR_DN = {
    name for own, electrons in IN_ELECTRONS.items() for name in (own, *UNITS[own]) if name != electrons
}


def preset_names() -> tuple[str, ...]:
    """Return the names of the built-in sensors.

    Examples
    --------
    >>> preset_names()
    ('dual-gain-phone', 'google-pixel-4a', 'nikon-d200', 'raspberry-pi-hq', 'sony-a7r2', 'sony-imx174', 'sony-imx571',
    'split-pixel-automotive', 'vendor-1.4um', 'vendor-2.2um')
    """
    folder = resources.files("photosite.sensor") / "presets"
    return tuple(sorted(f.name.removesuffix(_SUFFIX) for f in folder.iterdir() if f.name.endswith(_SUFFIX)))


def load_sensor(name_or_path: str | PathLike[str]) -> Sensor:
    """Load a sensor from a preset or a sensor file.

    Parameters
    ----------
    name_or_path
        A preset's name, or the path of a YAML file. A name with the suffix .yaml or .yml or with a separator is a path.

    Raises
    ------
    InputError
        If there is no such preset.
    FileError
        If the file is missing, is not YAML, or is not a valid sensor file; with the line.

    Examples
    --------
    >>> load_sensor("nikon-d200").pixel.width_um.value
    6.05
    """
    text = fspath(name_or_path)
    path = Path(text)
    is_path = not isinstance(name_or_path, str) or path.suffix in (".yaml", ".yml") or path.name != text
    if text and (is_path or os.path.exists(path)):
        return parse_sensor(read_text(path, "a sensor file"), path)
    names = preset_names()
    if text not in names:
        expected = "a preset or a file with the suffix .yaml"
        similar = did_you_mean(text, names)
        hint = f"Presets are {', '.join(names)}"
        hint = f"{similar} {hint}" if similar.endswith("?") else hint
        raise InputError("sensor", value=text, expected=expected, hint=hint)
    return _load_preset(text)


@lru_cache(maxsize=16)
def _load_preset(name: str) -> Sensor:
    file = resources.files("photosite.sensor") / "presets" / f"{name}{_SUFFIX}"
    sensor = parse_sensor(file.read_text(encoding="utf-8"), f"{name}{_SUFFIX}")
    sensor._written = replace(sensor._written, is_preset=True)
    return sensor


def parse_sensor(content: str, path: str | PathLike[str]) -> Sensor:
    """Return the sensor of a sensor file's text; a `FileError` names the path and the line."""
    sensor = _parsed(content, fspath(path))
    if sensor.maps is None:
        return sensor.model_copy()
    # An absolute path, so that the sensor can be saved elsewhere.
    full = Path(path).absolute().parent / sensor.maps.file
    return sensor.model_copy(update={"maps": Maps(file=fspath(full), sha256=sensor.maps.sha256)})


@lru_cache(maxsize=16)
def _parsed(content: str, path: str) -> Sensor:
    data = parse_yaml(content, path)
    check_version(path, data, "photosite_sensor")
    sensor: Sensor = validated(Sensor, data, path)
    sensor._written = Written(content)
    return sensor


def write_sensor(sensor: Sensor, path: str | PathLike[str], chip: MeasuredChip | None = None) -> None:
    """Write a sensor file, with the maps of a measured chip beside it.

    Whenever the program or the machine stops, the sensor file that was there and its maps can be loaded, or the new
    one with its maps: new maps are first written under a name of their own, which the sensor file's digest finds.

    Parameters
    ----------
    sensor
        The sensor; its maps are copied unless they are in the same folder.
    path
        The sensor file.
    chip
        A measured chip, in place of the sensor's maps.

    Raises
    ------
    FileError
        If it cannot be written, its maps are missing or changed, its maps would replace those of another sensor file,
        or another process has held the file for a minute.
    """
    path = Path(path)
    source = sensor.maps
    if chip is None and source is not None and Path(source.file).parent.resolve() == path.parent.resolve():
        _ = _found_maps(source)
        sensor = sensor.model_copy(update={"maps": Maps(file=Path(source.file).name, sha256=source.sha256)})
        source = None
    if chip is None and source is None:
        _write_text(sensor, path)
        return
    check_maps_are_free(path)
    target = maps_path(path)
    new = _new_maps(target)
    lock = FolderLock(path.parent, f".{path.name}.lock", wait_s=_WAIT_S)
    try:
        _complete(path, target)
        try:
            if chip is not None:
                digest = write_maps(chip, new).sha256
            else:
                assert source is not None
                digest = source.sha256
                with atomic_path(new) as temporary:
                    shutil.copyfile(_found_maps(source), temporary)
            _write_text(sensor.model_copy(update={"maps": Maps(file=target.name, sha256=digest)}), path)
        except BaseException:
            with suppress(OSError, FileError):
                _complete(path, target)  # where the sensor file has been replaced all the same
                new.unlink(missing_ok=True)
            raise
        _put_in_place(new, target)
    finally:
        lock.release()


def check_maps_are_free(path: Path) -> None:
    """Check that no other sensor file in the folder uses the maps that a sensor file with maps replaces.

    Raises
    ------
    FileError
        If one does: its maps would be lost.
    """
    target = maps_path(path)
    if not target.exists():
        return
    for other in sorted(path.parent.iterdir()):
        if other.name == path.name or is_temporary(other.name) or other.suffix.lower() not in (".yaml", ".yml"):
            continue
        if _has_maps(other, target):
            hint = f"Choose another name, or remove {other.name} if it is no longer needed"
            raise FileError(target, f"holds the maps of {other.name}, too, and would be replaced", hint=hint)


def _has_maps(path: Path, maps: Path) -> bool:
    """Return whether a file is a sensor file with these maps."""
    try:
        text = read_text(path, "a sensor file")
        found = parse_sensor(text, path).maps if maps.name in text else None
    except (FileError, OSError):
        return False
    return found is not None and os.path.realpath(found.file) == os.path.realpath(maps)


_WAIT_S = 60.0
"""Time to wait for another process that writes the same sensor file."""


def _write_text(sensor: Sensor, path: Path) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(dump_sensor(sensor), encoding="utf-8")


def _new_maps(target: Path) -> Path:
    """Return where new maps are until their sensor file has been written."""
    return target.with_name(f"{target.name}.new")


def _complete(path: Path, target: Path) -> None:
    """Give new maps their name, where a run was ended after it had written their sensor file."""
    new = _new_maps(target)
    if not new.exists():
        return
    try:
        maps = parse_sensor(read_text(path, "a sensor file"), path).maps
        belongs = maps is not None and file_sha256(new) == maps.sha256
    except (FileError, OSError):
        return
    if belongs:
        _put_in_place(new, target)


def _put_in_place(new: Path, target: Path) -> None:
    try:
        os.replace(new, target)
        sync(target.parent)
    except OSError as error:
        raise FileError(target, f"cannot be written: {message_of(error)}") from None


def dump_sensor(sensor: Sensor) -> str:
    """Return a sensor file's text; `parse_sensor` returns the same sensor.

    A sensor that was read from a file keeps its comments, and its values keep their units.
    """
    text = sensor._written.text
    if not text:
        return dump_yaml(_fields(sensor, {}))
    before = parse_sensor(text, "the file that the sensor was read from")
    if sensor == before:
        return text
    data = parse_yaml(text, "")
    if not sensor._written.with_comments:
        text = dump_yaml(data)
    return rewrite_yaml(text, _fields(before, data), _fields(sensor, data))


def _fields(sensor: Sensor, file: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a sensor file in the units of a file, given by its content."""
    content = sensor.model_dump(mode="json", exclude_none=True)
    if not sensor.gain_settings:
        del content["gain_settings"]
    if sensor.gain_setting_is_iso:
        del content["gain_setting_is_iso"]
    names = {str(name) for section in SECTIONS for name in file.get(section, ())}
    if not any(name in other.model_fields for _, other in SECTIONS.values() for name in names):
        for entry in content.get("gain_settings", ()):
            _keep_differences(entry, {name: value for section in SECTIONS for name, value in content[section].items()})
        return content
    places = {name: section for section, kinds in SECTIONS.items() for kind in kinds for name in kind.model_fields}
    measured = [(name, value) for section in SECTIONS for name, value in getattr(sensor, section)]
    values = {name: value for name, value in measured if isinstance(value, Measured)}
    for name in values:
        del content[places[name]][name]
    bits = sensor.readout.bits
    stated, covariance = in_file_units(values, sensor.covariance, bits, stated_names(names, values))
    for name, value in stated.items():
        content[places[name]][name] = as_file_value(value)
    for entry, setting in zip(content.get("gain_settings", ()), sensor.gain_settings, strict=True):
        own = {name: getattr(setting, name) for name in SETTING_VALUES}
        units = {name for name in names if {*model_fields_of(name)} <= {*SETTING_VALUES}} - {SWING}
        own_and_swing = {**own, SWING: values[SWING]}
        written = {AMPLIFIER, *stated_names(units, own_and_swing)} - {SWING}
        converted, entry_covariance = in_file_units(own_and_swing, setting.covariance, bits, sorted(written))
        for name in own:
            del entry[name]
        entry |= {name: as_file_value(value) for name, value in converted.items()}
        entry.pop("covariance", None)
        if entry_covariance is not None:
            entry["covariance"] = entry_covariance.model_dump(mode="json")
        _keep_differences(entry, {name: as_file_value(value) for name, value in stated.items()})
    shared = {} if covariance is None else {"covariance": covariance.model_dump(mode="json")}
    return {key: value for key, value in content.items() if key != "covariance"} | shared


def _keep_differences(entry: dict[str, Any], top: Mapping[str, Any]) -> None:
    """Remove the values of a gain setting that are those of the top of the file.

    Where the gain differs, all gains are kept, and the values in volts or DN, which are other electrons there.
    """
    gains = {CONVERSION, AMPLIFIER, DN_PER_E, E_PER_DN} & entry.keys()
    by_gain = gains | {name for name in entry if name in _NOISE_IN_VOLTS_OR_DN}
    kept = by_gain if any(entry[name] != top.get(name) for name in gains) else set()
    same = {name for name in entry if name in top and entry[name] == top[name]} - kept
    for name in same:
        del entry[name]
    if "covariance" in entry:
        shared = Covariance(**entry.pop("covariance")).without(same)
        if shared is not None:
            entry["covariance"] = shared.model_dump(mode="json")


MAPS_FORMAT = 1
MAPS_SUFFIX = ".maps.h5"
MOST_PIXELS = 1 << 28
"""Largest map that is read; eight maps of this size are 8 GiB."""

_NUMBERS = ("black_level_dn", "reference_exposure_s", "row_noise_dn", "column_noise_dn")
_LISTS: dict[str, type[Defects] | type[Blinking]] = {"defects": Defects, "blinking": Blinking}
_COLUMN_TYPES: dict[str, type[np.generic]] = {
    "row": np.int64,
    "col": np.int64,
    "kind": np.uint8,
    **dict.fromkeys(("value", "deviation", "amplitude_dn", "high_fraction", "noise_dn"), np.float64),
}


def write_maps(chip: MeasuredChip, path: str | PathLike[str]) -> Maps:
    """Write the maps of a chip to an HDF5 file; raise `FileError` if it cannot be written.

    The file has a dataset with a unit for each map, the groups `defects` and `blinking` with a dataset per column, and
    the chip's numbers as attributes.
    """
    with atomic_path(path) as temporary:
        with create_hdf5(temporary) as file:
            file.attrs["photosite_maps"] = MAPS_FORMAT
            if chip.read_noise_freedom is not None:
                file.attrs["read_noise_freedom"] = chip.read_noise_freedom
            for name in _NUMBERS:
                file.attrs[name] = getattr(chip, name)
            if chip.system_gain_dn_per_e is not None:
                file.attrs["system_gain_dn_per_e"] = chip.system_gain_dn_per_e
            for name, values in chip.maps().items():
                file.create_dataset(name, data=values).attrs["unit"] = MAP_UNITS[name]
            for name, kind in _LISTS.items():
                group = file.create_group(name)
                for entry in fields(kind):
                    group.create_dataset(entry.name, data=getattr(getattr(chip, name), entry.name))
            file["defects/kind"].attrs["meaning"] = ", ".join(f"{k.value} {k.name.lower()}" for k in DefectKind)
        digest = file_sha256(temporary)
    return Maps(file=os.fspath(Path(path).absolute()), sha256=digest)


def maps_path(sensor_path: str | PathLike[str]) -> Path:
    """Return the path of a sensor file's maps, mine.maps.h5 beside mine.sensor.yaml."""
    path = Path(sensor_path)
    return path.with_name(path.name.removesuffix(path.suffix).removesuffix(".sensor") + MAPS_SUFFIX)


def load_measured_chip(sensor: Sensor) -> MeasuredChip | None:
    """Return the measured chip of a sensor's maps, cached; None if its fixed pattern is drawn from the serial number.

    Raises
    ------
    FileError
        If the maps are missing, invalid, or not the file that the sensor file names.
    """
    return None if sensor.maps is None else _load(sensor.maps.file, sensor.maps.sha256)


# A chip of 10 megapixels is 280 MB: two are cached.
@lru_cache(maxsize=2)
def _load(file: str, sha256: str) -> MeasuredChip:
    return read_maps(_found_maps(Maps(file=file, sha256=sha256)))


def read_maps(path: str | PathLike[str]) -> MeasuredChip:
    """Read the chip in a file of maps; raise `FileError` if it is missing or invalid."""
    import h5py

    check_stored_file(path)
    try:
        with h5py.File(path, "r") as file:
            check_own_data(path, file)
            return _chip(file)
    except InputError as error:
        raise error.in_file(path) from None
    except FileError:
        raise
    except Exception as error:  # h5py passes on OSError, KeyError, RuntimeError, SystemError ...
        raise FileError(path, f"the file cannot be read as HDF5 maps: {message_of(error)}") from None


def file_sha256(path: str | PathLike[str]) -> str:
    """Return the SHA-256 of a file's bytes."""
    with reading(path), open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _found_maps(maps: Maps) -> Path:
    """Return the file of maps with the sensor file's digest."""
    new = _new_maps(Path(maps.file))
    with suppress(OSError, ValueError, FileError):  # only where a run was ended between two renames, or is between them
        if new.exists() and file_sha256(new) == maps.sha256:
            return new
    _check_digest(maps)
    return Path(maps.file)


def _check_digest(maps: Maps) -> None:
    if not os.path.exists(maps.file):  # False for an invalid name
        hint = "Keep it where the sensor file names it"
        raise FileError(maps.file, "there is no such file of maps", hint=hint)
    digest = file_sha256(maps.file)
    if digest != maps.sha256:
        expected = f"{maps.sha256[:12]}..., the file that the sensor file names"
        hint = "Restore that file, or calibrate again"
        raise FileError(maps.file, "sha256", value=f"{digest[:12]}...", expected=expected, hint=hint)


def _chip(file: Any) -> MeasuredChip:
    version = file.attrs.get("photosite_maps")
    if version != MAPS_FORMAT:
        raise InputError("photosite_maps", value=version, expected=f"{MAPS_FORMAT}, the version of the format")
    arguments: dict[str, Any] = {name: _number(file, name) for name in _NUMBERS}
    if "read_noise_freedom" in file.attrs:
        freedom = _number(file, "read_noise_freedom")
        if freedom < 1:
            raise InputError("read_noise_freedom", value=freedom, expected="1 or above")
        arguments["read_noise_freedom"] = int(freedom)
    gain = _number(file, "system_gain_dn_per_e") if "system_gain_dn_per_e" in file.attrs else None
    for name in MAP_UNITS:
        arguments[name] = _values(file, name, 2, np.float32) if name in file else None
    for name in ("offset_dn", "read_noise_dn"):
        if arguments[name] is None:
            raise InputError(f"the map {name} is missing")
    for name, kind in _LISTS.items():
        columns = [_values(file, f"{name}/{entry.name}", 1, _COLUMN_TYPES[entry.name]) for entry in fields(kind)]
        if len({len(column) for column in columns}) > 1:
            raise InputError(f"the columns of {name} differ in length")
        arguments[name] = kind(*columns)
    return MeasuredChip(system_gain_dn_per_e=gain, **arguments)


def _number(file: Any, name: str) -> float:
    value = file.attrs.get(name)
    number = value is not None and np.ndim(value) == 0 and np.issubdtype(np.asarray(value).dtype, np.number)
    if not (number and math.isfinite(value)):
        raise InputError(name, value=value, expected="a finite number")
    return float(value)


def _values(file: Any, name: str, dimensions: int, kind: type[np.generic]) -> NDArray[Any]:
    import h5py

    found = file.get(name)
    if not isinstance(found, h5py.Dataset) or found.ndim != dimensions or not np.issubdtype(found.dtype, np.number):
        raise InputError(name, expected=f"a dataset of numbers with {dimensions} dimension(s)")
    if found.size > MOST_PIXELS:
        raise InputError(f"{name}.shape", value=found.shape, expected=f"at most {MOST_PIXELS} numbers")
    values = np.asarray(found[()]).astype(kind, copy=False)
    values.flags.writeable = False
    return values
