"""The section `scene` of a camera file: a scene, or planes in depth, near to far.

scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2}
scene:
  - {source: leaf.png, alpha: leaf-mask.png, illuminant: D65, luminance_cd_m2: 100, distance_m: 1, width_m: 0.2}
  - {source: meadow.exr, distance_m: 20}
"""

from __future__ import annotations

from collections.abc import Mapping
from os import fspath
from pathlib import Path
from typing import Any

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import wavelength_grid
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import check_keys, line_of, optional_text
from photosite.scene.built_in import BUILT_IN_SCENES
from photosite.scene.scene_request import (
    DEFAULT_SCENE,
    FIELDS,
    Place,
    PlaneRequest,
    PlanesRequest,
    SceneRequest,
    merged_options,
)

_KEYS = ("source", "options", *FIELDS)


def parse_scene(file: Path, data: Mapping[str, Any]) -> SceneRequest | PlanesRequest:
    """Return the scene, or the planes, that the section `data["scene"]` asks for.

    Names of files in it are relative to the camera file. Errors have the line.
    """
    section, line = data["scene"], line_of(data, "scene")
    if isinstance(section, list):
        if not section:
            raise FileError(file, "scene", line, value=section, expected="a list of one or more planes, near to far")
        lines = [line_of(section, index) or line for index in range(len(section))]
        planes = tuple(_plane(file, part, at) for part, at in zip(section, lines, strict=True))
        return PlanesRequest(planes, Place(file, line))
    if isinstance(section, str):
        section = {"source": section}
    return _scene(file, section, line, _KEYS)


def _plane(file: Path, section: Any, line: int | None) -> PlaneRequest:
    request = _scene(file, section, line, (*_KEYS, "alpha"))
    alpha = optional_text(file, section, "alpha")
    if alpha is not None and not (file.parent / alpha).exists():
        at = line_of(section, "alpha") or line
        raise FileError(file, "alpha", at, where="scene", value=alpha, expected="a file, relative to this one")
    return PlaneRequest(request, None if alpha is None else file.parent / alpha)


def _scene(file: Path, section: Any, line: int | None, known: tuple[str, ...]) -> SceneRequest:
    if not isinstance(section, Mapping):
        raise FileError(file, "scene", line, value=section, expected="the name of a built-in scene, a file, or fields")
    check_keys(file, section, known, "scene")
    source = optional_text(file, section, "source") or DEFAULT_SCENE
    at = line_of(section, "source") or line
    place = Place(file, at)
    if source not in BUILT_IN_SCENES:
        path = file.parent / source
        if not path.exists():
            hint = None if Path(source).suffix else did_you_mean(source, BUILT_IN_SCENES)
            expected = "a built-in scene, or a file relative to this one"
            raise FileError(file, "source", at, where="scene", value=source, expected=expected, hint=hint)
        source = fspath(path)
    own = section.get("options") or {}
    if not isinstance(own, Mapping):
        line = line_of(section, "options") or line
        raise FileError(file, "options", line, where="scene", value=own, expected="a mapping of options")
    options: dict[str, Any] = {}
    # One by one, so that an error has the line of its option.
    for key, argument in FIELDS.items():
        if (value := section.get(key)) is not None:
            with place.errors(line_of(section, key)):
                options[argument] = _checked(source, argument, value, file)
    for key, value in own.items():
        with place.errors(line_of(own, key) or line_of(section, "options")):
            options = merged_options(options, {str(key): _checked(source, str(key), value, file)})
    return SceneRequest(source, options, place)


def _checked(source: str, argument: str, value: Any, file: Path) -> Any:
    """The value of an argument, once a request accepts it."""
    if argument == "illuminant":
        if isinstance(value, str) and value.strip().lower().endswith(".csv"):
            value = fspath(file.parent / value.strip())
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise InputError("illuminant", value=value, expected="a name, or a temperature in K")
        relative_energy(value, [560.0])
    if isinstance(value, list):
        value = list(value)
    SceneRequest(source, {argument: value})
    if argument == "wavelength_nm":  # those of a file's bands can be in any order
        wavelength_grid(value if source in BUILT_IN_SCENES else sorted(value))
    return value
