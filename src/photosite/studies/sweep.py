"""Design sweeps: a measure of a camera over all combinations of values of its fields."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.errors import InputError, did_you_mean
from photosite.scene.scene import Scene
from photosite.studies.gray_surface import snr
from photosite.values.shown import Cell, ResultTable, Tabular, cell_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Measure = Callable[..., Mapping[str, float] | float]
"""(camera) or, with a scene, (camera, scene) -> a number, or several by name."""

PIXEL_WIDTH = "pixel_width_um"
_LIGHT = ("illuminant", "mean_luminance_cd_m2")
_BAR_AFTER_S = 2.0


@dataclass(frozen=True, eq=False)
class Sweep(Tabular):
    """Result of `sweep`: a row for each combination of values.

    Parameters
    ----------
    fields, measured
        Names of the columns: the varied fields, and what was measured.
    rows
        The values of both, in this order. The last field varies fastest.

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

    def plot(self, x: str | None = None, y: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw a measured column against a field, a line for each combination of the other fields.

        Parameters
        ----------
        x, y
            Names of a field and of a measured column; the first ones by default.
        ax
            Matplotlib axes; None makes new ones.

        Raises
        ------
        InputError
            If there is no such column.
        """
        from photosite.report.plots import plot_lines

        x, y = x or self.fields[0], y or self.measured[-1]
        lines: dict[str, list[tuple[float, float]]] = {}
        for row, point in zip(self.rows, zip(self[x].tolist(), self[y].tolist(), strict=True), strict=True):
            settings = zip(self.fields, row, strict=False)
            label = ", ".join(f"{name} {cell_text(value)}" for name, value in settings if name != x)
            lines.setdefault(label, []).append(point)
        return plot_lines(lines, x, y, ax)

    def _table(self) -> ResultTable:
        title = f"Sweep over {', '.join(self.fields)}: {len(self.rows)} cameras"
        return ResultTable(title, (*self.fields, *self.measured), self.rows)


def sweep(
    camera: Camera,
    values: Mapping[str, Iterable[Any]],
    measure: Measure = snr,
    *,
    scene: Scene | None = None,
    workers: int | None = 1,
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
        `mean_luminance_cd_m2`, that of `Scene.with_nominal_luminance`. `pixel_width_um` scales the pixel by
        `Sensor.with_pixel_width`, which keeps its noise in electrons; `gain_setting` is one of the sensor's. Fields are
        changed in the given order.
    measure
        Function of the camera, or of camera and scene if a scene is given. It returns a number, or several by name.
    scene
        The scene, whose fields can then be varied.
    workers
        Number of processes; None: one for each core. The result does not depend on it. With more than one, `measure`
        must be a function of a module, not of a notebook, and scripts need `if __name__ == "__main__":`.
    progress
        Whether a bar is shown on standard error after two seconds.

    Raises
    ------
    InputError
        If a field is unknown or in several parts of camera or lens, a value is invalid, there are no values, or
        `measure` cannot be sent to other processes or returns something else than numbers.

    Examples
    --------
    >>> import photosite as ps
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=2.8, focal_length_mm=4), ps.load_sensor("vendor-2.2um"))
    >>> table = ps.sweep(camera, {"pixel_width_um": [1.1, 2.2], "f_number": [2, 4]}, measure=ps.snr)
    >>> table["snr_db"].round(1)
    array([12.5,  1.1, 23.6, 12.9])
    """
    for name, entries in values.items():
        if isinstance(entries, str) or not isinstance(entries, Iterable):
            raise InputError(name, where="values", value=entries, expected="a list of values")
    choices = {name: list(entries) for name, entries in values.items()}
    if not choices or not all(choices.values()):
        raise InputError("values", value=values, expected="a field with its values, such as {'f_number': [2, 4]}")
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise InputError("workers", value=workers, expected="1 or more, or None for the number of cores")
    points = list(itertools.product(*choices.values()))
    task = _Task(camera, scene, tuple(choices), measure)
    task.changed(points[0])  # an unknown field is an error of the call, not of a worker
    results = _computed(task, points, min(workers or os.cpu_count() or 1, len(points)), progress)
    names = tuple(results[0])
    if odd := next((found for found in results if tuple(found) != names), None):
        raise InputError("measure", value=tuple(odd), expected=f"a function that always returns {', '.join(names)}")
    if both := set(names) & set(choices):
        raise InputError("measure", value=both.pop(), expected="a function whose names are not those of the fields")
    rows = tuple(
        (*map(_cell, point), *(found[name] for name in names)) for point, found in zip(points, results, strict=True)
    )
    return Sweep(tuple(choices), names, rows)


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

    def __call__(self, point: Sequence[Any]) -> dict[str, float]:
        camera, scene = self.changed(point)
        found = self.measure(camera) if scene is None else self.measure(camera, scene)
        named = found if isinstance(found, Mapping) else {getattr(self.measure, "__name__", "value"): found}
        return {str(name): _number(name, value) for name, value in named.items()}


def _number(name: object, value: Any) -> float:
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
    of_scene = {*_LIGHT, "distance_m", "width_m"} if scene is not None else set()
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
        raise InputError(_UNKNOWN, value=name, expected=expected, hint="" if held else did_you_mean(name, known))
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
        return camera, scene.with_nominal_luminance(value)
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


def _computed(task: _Task, points: list[tuple[Any, ...]], workers: int, progress: bool) -> list[dict[str, float]]:
    from tqdm import tqdm

    bar = {"total": len(points), "unit": " cameras", "delay": _BAR_AFTER_S, "leave": False, "disable": not progress}
    if workers == 1:
        return list(tqdm(map(task, points), file=sys.stderr, **bar))
    try:
        pickle.dumps(task)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        hint = "Define it in a module, or pass workers=1"
        expected = "a function that other processes can import"
        raise InputError("measure", value=task.measure, expected=expected, hint=hint) from error
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, initializer=_keep, initargs=(task,)) as pool:
        return list(tqdm(pool.map(_at, points), file=sys.stderr, **bar))


_kept: list[_Task] = []
"""The task of a worker process, sent once."""


def _keep(task: _Task) -> None:
    _kept[:] = [task]


def _at(point: Sequence[Any]) -> dict[str, float]:
    return _kept[0](point)
