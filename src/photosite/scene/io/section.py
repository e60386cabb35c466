"""The section `scene` of a camera file: a scene, or planes in depth, near to far.

scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2}
scene:
  - {source: leaf.png, alpha: leaf-mask.png, illuminant: D65, luminance_cd_m2: 100, distance_m: 1, width_m: 0.2}
  - {source: meadow.exr, distance_m: 20}
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import fspath
from pathlib import Path
from typing import Any

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import wavelength_grid
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import check_keys, line_of, optional_text
from photosite.scene.io.files import read_options
from photosite.scene.request import (
    FORMULAS,
    Place,
    PlaneRequest,
    PlanesRequest,
    SceneRequest,
    check_options,
    scene_request,
)
from photosite.scene.values import is_number

_NUMBERS = {
    "luminance_cd_m2": "mean_luminance_cd_m2",
    "distance_m": "distance_m",
    "width_m": "width_m",
    "tolerance": "tolerance",
}
"""Numbers of the section, and their names in a `SceneRequest`."""
_KEYS = ("source", "illuminant", "units", "wavelength_nm", "options", *_NUMBERS)


def parse_scene(file: Path, data: Mapping[str, Any]) -> SceneRequest | PlanesRequest:
    """What the section asks for.

    Parameters
    ----------
    file
        The camera file, for messages; names of other files are relative to it.
    data
        The camera file's fields; `data["scene"]` is the section.

    Raises
    ------
    FileError
        If it does not describe a scene; with the line.
    """
    told, line = data["scene"], line_of(data, "scene")
    if isinstance(told, list):
        if not told:
            raise FileError(file, "scene lists no planes; give one or more, near to far", line)
        lines = [line_of(told, index) or line for index in range(len(told))]
        planes = tuple(_plane(file, part, at) for part, at in zip(told, lines, strict=True))
        return PlanesRequest(planes, Place(file, line))
    if isinstance(told, str):
        told = {"source": told}
    return _one(file, told, line, _KEYS)


def _plane(file: Path, told: Any, line: int | None) -> PlaneRequest:
    request = _one(file, told, line, (*_KEYS, "alpha"))
    alpha = optional_text(file, told, "alpha")
    if alpha is not None and not (file.parent / alpha).exists():
        raise FileError(file, f"scene.alpha '{alpha}' is no file beside this one", line_of(told, "alpha") or line)
    return PlaneRequest(request, None if alpha is None else file.parent / alpha)


def _one(file: Path, told: Any, line: int | None, known: tuple[str, ...]) -> SceneRequest:
    if not isinstance(told, Mapping):
        raise FileError(file, f"scene is a formula's name, a file, or fields, not {told!r:.40}", line)
    check_keys(file, told, known, "scene")
    source = optional_text(file, told, "source") or SceneRequest().source
    with _at(file, told, "source", line):
        if source not in FORMULAS and not (file.parent / source).exists():
            hint = "" if Path(source).suffix else f"; {did_you_mean(source, FORMULAS)}"
            raise InputError(f"scene.source '{source}' is neither a formula nor a file beside this one{hint}")
    said: dict[str, Any] = {
        "units": optional_text(file, told, "units"),
        "illuminant": _illuminant(file, told, line),
        "place": Place(file, line_of(told, "source") or line),
    }
    for key, name in _NUMBERS.items():
        if (value := told.get(key)) is not None:
            if not is_number(value) or not (math.isfinite(value) and value > 0):
                raise FileError(file, f"scene.{key} is a number above 0, not {value!r:.40}", line_of(told, key) or line)
            said[name] = float(value)
    _check_of_files(file, told, source, line)
    if (grid := told.get("wavelength_nm")) is not None:
        if not isinstance(grid, list) or not all(map(is_number, grid)):
            raise FileError(file, "scene.wavelength_nm is a list of numbers", line_of(told, "wavelength_nm") or line)
        said["wavelength_nm"] = [float(value) for value in grid]
        with _at(file, told, "wavelength_nm", line):  # a file's bands may be said in the file's own order
            wavelength_grid(grid if source in FORMULAS else sorted(grid))
    said["options"] = _options(file, told, source, line)
    return scene_request(source, file.parent, **said)


@contextmanager
def _at(file: Path, told: Mapping[str, Any], key: str, line: int | None) -> Iterator[None]:
    """What is wrong with a value, or with the file that it names, is said with the line that it stands on."""
    try:
        yield
    except (InputError, FileError) as error:
        raise FileError(file, str(error), line_of(told, key) or line) from None


def _illuminant(file: Path, told: Mapping[str, Any], line: int | None) -> str | float | None:
    """The light, a lamp's file by its place beside the camera file."""
    wanted = told.get("illuminant")
    if wanted is None:
        return None
    if not isinstance(wanted, str) and not is_number(wanted):
        at = line_of(told, "illuminant") or line
        raise FileError(file, f"scene.illuminant is a name or a temperature in K, not {wanted!r:.40}", at)
    if isinstance(wanted, str) and wanted.strip().lower().endswith(".csv"):
        wanted = fspath(file.parent / wanted.strip())
    with _at(file, told, "illuminant", line):
        relative_energy(wanted, [560.0])
    return str(wanted) if isinstance(wanted, str) else float(wanted)


def _check_of_files(file: Path, told: Mapping[str, Any], source: str, line: int | None) -> None:
    """Whether what is said of how a file is read is said of a file, and can be."""
    for key in ("units", "tolerance"):
        if told.get(key) is not None:
            with _at(file, told, key, line):
                if source in FORMULAS:
                    raise InputError(f"scene.{key} is said of a scene's file; '{source}' is a formula")
                read_options({key: told[key]})


def _options(file: Path, told: Mapping[str, Any], source: str, line: int | None) -> dict[str, Any]:
    wanted = told.get("options") or {}
    if not isinstance(wanted, Mapping):
        raise FileError(file, f"scene.options are fields, not {wanted!r:.40}", line_of(told, "options") or line)
    named = {str(key): value for key, value in wanted.items()}
    for key, value in named.items():
        with _at(file, wanted, key, line_of(told, "options") or line):
            if source in FORMULAS:
                check_options(source, {key: value})
            else:
                read_options({key: value})
    return named
