"""The section `scene` of a camera file: a scene, or planes in depth, near to far.

scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2}
scene:
  - {source: leaf.png, alpha: leaf-mask.png, illuminant: D65, luminance_cd_m2: 100, distance_m: 1, width_m: 0.2}
  - {source: meadow.exr, distance_m: 20}
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError
from photosite.scene.request import PlaneRequest, PlanesRequest, SceneRequest, check_options, scene_request
from photosite.yaml_file import check_keys, line_of, optional_text

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
        return PlanesRequest(tuple(_plane(file, part, at) for part, at in zip(told, lines, strict=True)))
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
    said: dict[str, Any] = {"units": optional_text(file, told, "units")}
    illuminant = told.get("illuminant")
    if illuminant is not None and not isinstance(illuminant, str) and not _is_number(illuminant):
        raise FileError(file, f"scene.illuminant is a name or a temperature in K, not {illuminant!r:.40}", line)
    said["illuminant"] = illuminant
    for key, name in _NUMBERS.items():
        if (value := told.get(key)) is not None:
            if not _is_number(value) or not value > 0:
                raise FileError(file, f"scene.{key} is a number above 0, not {value!r:.40}", line_of(told, key) or line)
            said[name] = float(value)
    if (grid := told.get("wavelength_nm")) is not None:
        if not isinstance(grid, list) or not all(map(_is_number, grid)):
            raise FileError(file, "scene.wavelength_nm is a list of numbers", line_of(told, "wavelength_nm") or line)
        said["wavelength_nm"] = [float(value) for value in grid]
    options = told.get("options") or {}
    if not isinstance(options, Mapping):
        raise FileError(file, f"scene.options are fields, not {options!r:.40}", line_of(told, "options") or line)
    said["options"] = {str(key): value for key, value in options.items()}
    source = optional_text(file, told, "source") or SceneRequest().source
    request = scene_request(source, file.parent, **said)
    try:
        if not request.is_file:
            check_options(request.source, request.options)
        elif not Path(request.source).exists():
            raise InputError(f"scene.source '{source}' is neither a formula nor a file beside this one")
    except InputError as error:
        raise FileError(file, str(error), line_of(told, "source") or line) from None
    return request


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
