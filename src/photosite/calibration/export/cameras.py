"""Calibration of many cameras, a folder of frames each, on several processes or machines."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from photosite.calibration.calibrate import AnyCalibration, calibrate, calibration_kind
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.result import Calibration
from photosite.calibration.setting import MapsWanted
from photosite.engine.workers import run_tasks
from photosite.errors import FileError, InputError, PhotositeError, message_of, printable
from photosite.files.writing import FolderLock, atomic_path, remove_abandoned
from photosite.frames.open import open_settings
from photosite.sensor.model import Sensor

ERROR = "error"
"""The key of a result that has the reason why a camera could not be calibrated, in place of its parameters."""

_RESULT, _SENSOR = ".json", ".sensor.yaml"


def calibrate_cameras(
    paths: Sequence[str | PathLike[str]],
    folder: str | PathLike[str],
    sensor: Sensor | None = None,
    *,
    maps: MapsWanted = False,
    processes: int | None = 1,
    scheduler: str | None = None,
    progress: Callable[[int, int], object] | None = None,
    **reading: Any,
) -> dict[str, dict[str, Any]]:
    """Calibrate several cameras and write the results of each to a folder.

    `NAME.json` has what `to_dict` of the result of `calibrate` returns, and `NAME.sensor.yaml` is the sensor file where
    a sensor is known and the frames show all that the file needs; NAME is that of the camera's folder or file. The
    results appear whole or not at all. A call with the same folder calibrates the cameras that it lacks, and those that
    failed.

    Parameters
    ----------
    paths
        What `open_frames` opens for each camera.
    folder
        Folder of the results; it is made if it is missing.
    sensor
        The sensor as known before, as for `calibrate`.
    maps
        Also measure maps of each chip, for a single gain setting.
    processes, scheduler
        Number of local processes (None: one for each core), or address of a Dask scheduler, whose workers must see the
        frames and the folder under the same names. The results are the same.
    progress
        Called with (cameras done, cameras in total).
    **reading
        Options of `open_settings`.

    Returns
    -------
    dict
        By name, the content of the JSON file. A camera that cannot be calibrated has only `error`, the reason.

    Raises
    ------
    InputError
        If two cameras have the same name, or there is no scheduler.
    FileError
        If the folder or a result cannot be written, or the folder is in use.
    WorkerError
        If a camera ends its workers.
    """
    names = [_name(Path(path).absolute()) for path in paths]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError("paths", value=twice, expected="folders with different names")
    place = Path(folder)
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made: {message_of(error)}") from None
    lock = FolderLock(place)
    try:
        remove_abandoned(place)
        found = {name: _result(place / f"{name}{_RESULT}") for name in names}
        missing = [(name, str(path)) for name, path in zip(names, paths, strict=True) if ERROR in found[name]]
        done = run_tasks(
            _Camera(place, sensor, maps, reading), missing, processes=processes, scheduler=scheduler, name=" ".join
        )
        for number, (index, result) in enumerate(done, len(names) - len(missing) + 1):
            found[missing[index][0]] = result
            if progress is not None:
                progress(number, len(names))
    finally:
        lock.release()
    return found


def _name(path: Path) -> str:
    """Return the name of the folder or file that frames are in; a protocol or descriptor lies beside them."""
    if path.suffix.lower() in (".yaml", ".yml", ".txt"):
        return path.parent.name
    return path.stem if path.is_file() else path.name


def _result(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {ERROR: "not calibrated"}
    return found if isinstance(found, dict) else {ERROR: "not calibrated"}


@dataclass(frozen=True)
class _Camera:
    """Calibrates a camera and writes its results."""

    folder: Path
    sensor: Sensor | None
    maps: MapsWanted
    reading: Mapping[str, Any]

    def __call__(self, task: tuple[str, str]) -> dict[str, Any]:
        name, path = task
        disk_error: FileError | None = None
        try:
            found, has_sensor = self._calibrated(name, path)
            result = found.to_dict()
            if has_sensor and isinstance(found, Calibration | GainSeries):
                try:
                    found.save(self.folder / f"{name}{_SENSOR}")
                except FileError as error:
                    disk_error = error
        except PhotositeError as error:
            result = {ERROR: str(error)}
        if disk_error is not None:  # not the camera's: it ends the command, and the camera is calibrated again
            raise disk_error
        text = json.dumps(result, indent=1, allow_nan=False, default=_plain)
        with atomic_path(self.folder / f"{name}{_RESULT}") as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
        content: dict[str, Any] = json.loads(text)
        return content

    def _calibrated(self, name: str, path: str) -> tuple[AnyCalibration, bool]:
        """Return what was found, and whether the properties of the sensor are known."""
        settings = open_settings(path, sensor=self.sensor, **self.reading)
        frames = settings[0] if len(settings) == 1 else settings
        sensor = self.sensor or settings[0].sensor
        if sensor is not None:
            sensor = sensor.with_(name=printable(name))
        maps = self.maps if calibration_kind(frames, sensor) == "setting" else False
        return calibrate(frames, sensor, maps=maps), sensor is not None


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")
