"""Design sweeps: a measure of a camera over all combinations of values of its fields."""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import math
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.engine.workers import run_tasks
from photosite.errors import FileError, InputError, did_you_mean, message_of
from photosite.files.writing import FolderLock, atomic_path, sync
from photosite.metrics.registry import axis_label
from photosite.scene.scene import Scene
from photosite.studies.estimate_columns import estimate_columns, interval_columns, with_all_names
from photosite.studies.gray_surface import snr
from photosite.training.digest import described
from photosite.values.estimate import Estimate
from photosite.values.shown import Cell, ResultTable, Tabular, cell_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Measure = Callable[..., Mapping[str, float | Estimate] | float | Estimate]
"""(camera) or, with a scene, (camera, scene) -> a number or an estimate, or several by name."""

PIXEL_WIDTH = "pixel_width_um"
_OF_SCENE = ("illuminant", "mean_luminance_cd_m2", "distance_m", "width_m")
_BAR_AFTER_S = 2.0
_MOST_POINTS = 10_000_000


@dataclass(frozen=True, eq=False)
class Sweep(Tabular):
    """Result of `sweep`: a row for each combination of values.

    Parameters
    ----------
    fields, measured
        Names of the columns: the varied fields, and what was measured.
    rows
        The values of both, in this order. The last field varies fastest.
    notes
        Which estimates are missing, and why.

    Examples
    --------
    >>> table = Sweep(("f_number",), ("signal_e",), ((2.0, 400.0), (4.0, 100.0)))
    >>> table
    Sweep over f_number: 2 cameras
    f_number  signal_e
           2       400
           4       100
    >>> table["signal_e"]
    array([400., 100.])
    """

    fields: tuple[str, ...]
    measured: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the measured columns without those of uncertainties and intervals."""
        beside = {column for name in self.measured for column in interval_columns(name)}
        return tuple(name for name in self.measured if name not in beside)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column."""
        names = (*self.fields, *self.measured)
        if name not in names:
            raise InputError("name", value=name, expected="a column of the sweep", hint=did_you_mean(name, names))
        return np.array([row[names.index(name)] for row in self.rows])

    def to_dict(self) -> dict[str, list[Cell]]:
        """Return the columns as lists."""
        return self._table().to_dict()

    def save(self, path: str | PathLike[str]) -> None:
        """Write the table as CSV, with a line of names; numbers as Python writes them, none for NaN.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow((*self.fields, *self.measured))
            writer.writerows(["" if value != value else value for value in row] for row in self.rows)

    def plot(self, x: str | None = None, y: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw a measured column against a field, a line for each combination of the other fields.

        Estimates have bars of their 95 % intervals.

        Parameters
        ----------
        x, y
            Names of a field and of a measured column; by default the first field and the last measured value that any
            camera has.
        ax
            Matplotlib axes; None makes new ones.

        Raises
        ------
        InputError
            If there is no such column.
        """
        from photosite.report.plots import plot_lines

        shown = [name for name in self.values if np.isfinite(self[name]).any()] or self.values
        x, y = x or self.fields[0], y or shown[-1]
        for axis, name, names in (("x", x, self.fields), ("y", y, self.measured)):
            if name not in names:
                raise InputError(axis, value=name, expected=f"one of {', '.join(names)}")
        lines: dict[str, list[tuple[float, ...]]] = {}
        ends = [name for name in interval_columns(y)[1:] if name in self.measured]
        columns = [self[name].tolist() for name in (x, y, *ends)]
        for row, point in zip(self.rows, zip(*columns, strict=True), strict=True):
            settings = zip(self.fields, row, strict=False)
            label = ", ".join(f"{name} {cell_text(value)}" for name, value in settings if name != x)
            lines.setdefault(label, []).append(point)
        return plot_lines(lines, x, axis_label(y), ax)

    def _table(self) -> ResultTable:
        title = f"Sweep over {', '.join(self.fields)}: {len(self.rows)} cameras"
        return ResultTable(title, (*self.fields, *self.measured), self.rows)


def sweep(
    camera: Camera,
    values: Mapping[str, Iterable[Any]],
    measure: Measure = snr,
    *,
    scene: Scene | None = None,
    processes: int | None = 1,
    scheduler: str | None = None,
    checkpoint: str | PathLike[str] | None = None,
    progress: bool = True,
) -> Sweep:
    """Measure a camera for all combinations of values of its fields.

    Parameters
    ----------
    camera
        The camera to start from.
    values
        Field to values. Fields of the sensor, such as `read_noise_mv` or `rows`; of the lens, such as `f_number`, also
        of the parts of a `Lens`; of the camera; of the scene: `distance_m`, `width_m`, `illuminant` and
        `mean_luminance_cd_m2`, that of `Scene.with_mean_luminance`. `pixel_width_um` scales the pixel by
        `Sensor.with_pixel_width`, which keeps its noise in electrons; `gain_setting` is one of the sensor's. Fields are
        changed in the given order.
    measure
        Function of the camera, or of camera and scene if a scene is given. It returns a number, or several by name.
        An `Estimate` has columns for its standard uncertainty and its 95 % interval.
    scene
        The scene, whose fields can then be varied.
    processes
        Number of processes; None: one for each core. The result does not depend on it. With more than one, `measure`
        must be a function of a module, not of a notebook, and scripts need `if __name__ == "__main__":`.
    scheduler
        Address of a Dask scheduler, such as "tcp://10.0.0.1:8786", whose workers measure instead.
    checkpoint
        Folder for the results so far. An interrupted sweep resumes from it, with the same rows, when it is called again
        with the same arguments. The folder stays until the caller removes it.
    progress
        Whether a bar is shown on standard error after two seconds.

    Raises
    ------
    InputError
        If a field is unknown or in several parts of camera or lens, a value is invalid, there are no values, or
        `measure` cannot be sent to other processes or returns something else than numbers.
    FileError
        If the checkpoint folder holds something else, such as another sweep, or is in use.
    WorkerError
        If a camera ends its workers.

    Examples
    --------
    >>> import photosite as ps
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=2.8, focal_length_mm=4), ps.load_sensor("vendor-2.2um"))
    >>> table = ps.studies.sweep(camera, {"pixel_width_um": [1.1, 2.2], "f_number": [2, 4]}, measure=ps.studies.snr)
    >>> table["snr_db"].round(1)
    array([12.5,  1.1, 23.6, 12.9])
    """
    for name, entries in values.items():
        if isinstance(entries, str) or not isinstance(entries, Iterable):
            raise InputError(name, where="values", value=entries, expected="a list of values")
    choices = {name: list(entries) for name, entries in values.items()}
    if not choices or not all(choices.values()):
        raise InputError("values", value=values, expected="a field with its values, such as {'f_number': [2, 4]}")
    if (count := math.prod(map(len, choices.values()))) > _MOST_POINTS:
        raise InputError("values", value=f"{count} combinations", expected=f"at most {_MOST_POINTS} combinations")
    points = list(itertools.product(*choices.values()))
    task = _Task(camera, scene, tuple(choices), measure)
    task.changed(points[0])  # an unknown field is an error of the call, not of a worker
    alone = scheduler is None and processes == 1
    if not alone:
        _check_pickles(task)
    with nullcontext() if checkpoint is None else _Checkpoint(checkpoint, task, points) as saved:
        results = _computed(task, points, saved, {"processes": processes, "scheduler": scheduler}, progress)
    found, notes = _columns(results, list(map(task.name, points)))
    names = tuple(found[0])
    if odd := next((each for each in found if tuple(each) != names), None):
        raise InputError("measure", value=tuple(odd), expected=f"a function that always returns {', '.join(names)}")
    if both := set(names) & set(choices):
        raise InputError("measure", value=both.pop(), expected="a function whose names are not those of the fields")
    rows = tuple(
        (*map(_cell, point), *(each[name] for name in names)) for point, each in zip(points, found, strict=True)
    )
    return Sweep(tuple(choices), names, rows, notes)


def _columns(
    results: Sequence[Mapping[str, float | Estimate]], cameras: Sequence[str]
) -> tuple[list[dict[str, float]], tuple[str, ...]]:
    """Return results as numbers by column, and which estimates are missing of which of the named cameras."""
    estimates = with_all_names(
        [{name: each for name, each in found.items() if isinstance(each, Estimate)} for found in results]
    )
    columns = [
        {name: each for name, each in found.items() if not isinstance(each, Estimate)}
        | {column: number for name, each in own.items() for column, number in estimate_columns(name, each).items()}
        for found, own in zip(results, estimates, strict=True)
    ]
    notes = []
    for name in estimates[0]:
        reasons = {camera: own[name].reason for camera, own in zip(cameras, estimates, strict=True) if own[name].reason}
        if reasons:
            camera, reason = next(iter(reasons.items()))
            notes.append(f"{name}: missing for {len(reasons)} of {len(cameras)} cameras, first {camera}: {reason}")
    return columns, tuple(notes)


def check_point(camera: Camera, point: Mapping[str, Any], scene: Scene | None = None) -> None:
    """Raise `InputError` if the fields of a camera cannot have these values."""
    _Task(camera, scene, tuple(point), snr).changed(tuple(point.values()))


def _cell(value: Any) -> Cell:
    plain = value.item() if isinstance(value, np.generic) else value
    return plain if isinstance(plain, str | int | float | bool) or plain is None else str(plain)


@dataclass(frozen=True, eq=False)
class _Task:
    """What a process needs to measure any point of the sweep."""

    camera: Camera
    scene: Scene | None
    names: tuple[str, ...]
    measure: Measure

    def changed(self, point: Sequence[Any]) -> tuple[Camera, Scene | None]:
        camera, scene = self.camera, self.scene
        for name, value in zip(self.names, point, strict=True):
            try:
                camera, scene = _with(camera, scene, name, value)
            except InputError as error:
                raise error if error.what == _UNKNOWN else error.within(f"{name} = {value}") from None
        return camera, scene

    def name(self, point: Sequence[Any]) -> str:
        """Return a point's values as text."""
        return ", ".join(f"{name} = {value}" for name, value in zip(self.names, point, strict=True))

    def __call__(self, point: Sequence[Any]) -> dict[str, float | Estimate]:
        camera, scene = self.changed(point)
        try:
            found = self.measure(camera) if scene is None else self.measure(camera, scene)
        except InputError as error:
            raise error.within(self.name(point)) from None
        named = found if isinstance(found, Mapping) else {getattr(self.measure, "__name__", "value"): found}
        return {str(name): _number(name, value) for name, value in named.items()}


def _number(name: object, value: Any) -> float | Estimate:
    if isinstance(value, Estimate):
        return Estimate(value.shown_value, value.standard_uncertainty, value.reason, interval_95=value.interval_95)
    plain = value.item() if isinstance(value, np.generic | np.ndarray) and np.ndim(value) == 0 else value
    if isinstance(plain, bool) or not isinstance(plain, int | float):
        raise InputError("measure", where=str(name), value=value, expected="a function that returns numbers")
    return plain


_UNKNOWN = "field"


def _with(camera: Camera, scene: Scene | None, name: str, value: Any) -> tuple[Camera, Scene | None]:
    """Return camera and scene with a changed field."""
    if name == PIXEL_WIDTH:
        return replace(camera, sensor=camera.sensor.with_pixel_width(value)), scene
    if name == "gain_setting":
        return replace(camera, sensor=camera.sensor.at_gain_setting(value)), scene
    of_scene = _OF_SCENE if scene is not None else ()
    places = {
        "sensor": camera.sensor.field_names.count(name),
        "lens": _all_fields(camera.optics).count(name),
        "camera": ("integration", "cells_per_pixel").count(name),
        "scene": int(name in of_scene),
    }
    held = [part for part, count in places.items() for _ in range(count)]
    if len(held) != 1:
        known = (PIXEL_WIDTH, *camera.sensor.field_names, *_all_fields(camera.optics), "cells_per_pixel", *of_scene)
        expected = "a field of sensor, lens or scene"
        if held:
            expected = f"a field of one part only, not of several ({', '.join(dict.fromkeys(held))})"
        hint = "" if held else did_you_mean(name, known)
        if scene is None and name in _OF_SCENE:
            hint = "It is a field of a scene, and the sweep has none"
        raise InputError(_UNKNOWN, value=name, expected=expected, hint=hint)
    if held == ["sensor"]:
        return replace(camera, sensor=camera.sensor.with_(**{name: value})), scene
    if held == ["lens"]:
        return replace(camera, optics=_replaced(camera.optics, name, value)), scene
    if held == ["camera"]:
        return replace(camera, **{name: value}), scene
    assert scene is not None
    if name == "illuminant":
        return camera, scene.with_illuminant(value)
    if name == "mean_luminance_cd_m2":
        return camera, scene.with_mean_luminance(value)
    return camera, replace(scene, **{name: value})


def _all_fields(part: Any) -> tuple[str, ...]:
    """Return the fields of a lens and of its parts."""
    if not is_dataclass(part):
        return ()
    inner = (_all_fields(getattr(part, entry.name)) for entry in fields(part))
    return (*(entry.name for entry in fields(part)), *itertools.chain.from_iterable(inner))


def _replaced(part: Any, name: str, value: Any) -> Any:
    """Return a lens with a changed field, which it or one of its parts has."""
    if name in {entry.name for entry in fields(part)}:
        return replace(part, **{name: value})
    inner = next(entry.name for entry in fields(part) if name in _all_fields(getattr(part, entry.name)))
    return replace(part, **{inner: _replaced(getattr(part, inner), name, value)})


def _check_pickles(task: _Task) -> None:
    try:
        pickle.dumps(task)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        hint = "Define it in a module, or pass processes=1"
        expected = "a function that other processes can import"
        raise InputError("measure", value=task.measure, expected=expected, hint=hint) from error


def _computed(
    task: _Task, points: list[tuple[Any, ...]], saved: _Checkpoint | None, where: dict[str, Any], progress: bool
) -> list[dict[str, float | Estimate]]:
    from tqdm import tqdm

    found = {} if saved is None else dict(saved.found)
    missing = [index for index in range(len(points)) if index not in found]
    completed = run_tasks(task, [points[index] for index in missing], name=task.name, **where)
    bar = {"total": len(points), "initial": len(found), "unit": " cameras", "delay": _BAR_AFTER_S}
    for place, result in tqdm(completed, file=sys.stderr, leave=False, disable=not progress, **bar):
        found[missing[place]] = result
        if saved is not None:
            saved.add(missing[place], result)
    return [found[index] for index in range(len(points))]


_RESULTS = "results.jsonl"
_KEPT = "value", "standard_uncertainty", "reason", "interval_95"
"""Fields of estimates that are kept."""


def _to_json(estimate: Estimate) -> dict[str, Any]:
    return {name: getattr(estimate, name) for name in _KEPT}


def _from_json(content: Any) -> float | Estimate:
    if not isinstance(content, dict):
        return content  # type: ignore[no-any-return]  # a number
    ends = content["interval_95"]
    return Estimate(**content | {"interval_95": None if ends is None else (ends[0], ends[1])})


class _Checkpoint:
    """A folder with the results of a sweep so far: a line that identifies the sweep, then a line for each camera.

    Where a killed process or a power failure has left half a line or an invalid one, it and what follows are ignored.
    """

    def __init__(self, folder: str | PathLike[str], task: _Task, points: list[tuple[Any, ...]]) -> None:
        self._folder = Path(folder)
        self._is_new = not self._folder.exists()
        self._path = self._folder / _RESULTS
        self.found: dict[int, dict[str, float | Estimate]] = {}
        identity = {"photosite": version("photosite"), "sweep": described(task), "points": described(points)}
        head = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise FileError(folder, f"cannot be made: {message_of(error)}") from None
        self._lock = FolderLock(self._folder)
        try:
            self._file = self._opened(json.dumps({"sweep": head}))
        except BaseException:
            self._lock.release()
            raise

    def _opened(self, head: str) -> TextIO:
        others = [entry.name for entry in self._folder.iterdir() if not entry.name.startswith((".lock", _RESULTS))]
        if others:
            raise FileError(self._folder, f"the folder holds {others[0]}", hint="Use an empty folder")
        text = self._path.read_text(encoding="utf-8", errors="replace") if self._path.exists() else ""
        whole = [f"{line}\n" for line in text.split("\n")[:-1]]
        if whole and whole[0].strip() != head:
            hint = "Remove the folder, or use the camera, values and measure that it was begun with"
            raise FileError(self._folder, "holds the results of another sweep", hint=hint)
        valid = whole[:1]
        for line in whole[1:]:
            try:
                index, result = json.loads(line)
                self.found[int(index)] = {name: _from_json(each) for name, each in result.items()}
            except (ValueError, TypeError, AttributeError):
                break
            valid.append(line)
        file = self._path.open("r+" if text else "w", encoding="utf-8")
        file.truncate(sum(len(line.encode()) for line in valid))
        file.seek(0, os.SEEK_END)
        if not valid:
            file.write(head + "\n")
            file.flush()
            sync(self._path)
            sync(self._folder)
        return file

    def add(self, index: int, result: dict[str, float | Estimate]) -> None:
        """Keep the result of a camera."""
        self._is_new = False
        self._file.write(json.dumps([index, result], default=_to_json) + "\n")
        self._file.flush()

    def __enter__(self) -> _Checkpoint:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # `add` has raised it already
            self._file.close()
        if self._is_new:  # without results: an address without a scheduler, for example
            self._path.unlink(missing_ok=True)
        self._lock.release()
        if self._is_new:
            with suppress(OSError):
                self._folder.rmdir()
