"""Camera files: sensor, optics, scene and exposure of a set-up in one YAML file.

photosite_camera: 1
name: D200 with its 50 mm
sensor: nikon-d200                  # a preset, or a sensor file
optics: planar50.optics.yaml        # an optics file, or its fields: {f_number: 8, focal_length_mm: 50}
scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2}    # or a list of planes in depth
exposure: 1/3
integration: trapezoid
cells_per_pixel: 1
gain_setting: 400                   # of a sensor file with several

File names are relative to the camera file. Missing fields have the values of the 2008 paper.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from photosite.camera.camera import Camera
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, wavelength_grid
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import check_keys, check_version, line_of, optional_text, read_yaml
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Optics
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.scene.scene_request import (
    BUILT_IN_SCENES,
    DEFAULT_SCENE,
    FIELDS,
    Place,
    PlaneRequest,
    PlanesRequest,
    SceneRequest,
    merged_options,
)
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.values.exposure import parse_exposure
from photosite.values.shown import Shown

VERSION_KEY = "photosite_camera"
DEFAULT_SENSOR = "nikon-d200"
DEFAULT_F_NUMBER = 8.0
DEFAULT_FOCAL_LENGTH_MM = 50.0
DEFAULT_EXPOSURE_S = 1 / 3
"""The 2008 paper's set-up; `photosite.scene.scene_request` has the defaults of its scene."""

_KEYS = (VERSION_KEY, "name", "sensor", "optics", "scene", "exposure", "integration", "cells_per_pixel", "gain_setting")

_SCENE_KEYS = ("source", "options", *FIELDS)


@dataclass(frozen=True, eq=False)
class SetUp(Shown):
    """A camera with its usual scene and exposure time.

    Parameters
    ----------
    sensor, optics, integration, cells_per_pixel
        As for `Camera`.
    scene, exposure_s, name
        The scene, the exposure time, and the name of the set-up.

    Examples
    --------
    >>> paper = SetUp()
    >>> paper.sensor.name, paper.scene.source
    ('Nikon D200', 'macbeth')
    """

    sensor: Sensor = field(default_factory=lambda: load_sensor(DEFAULT_SENSOR))
    optics: Optics = field(default_factory=lambda: DiffractionLimited(DEFAULT_F_NUMBER, DEFAULT_FOCAL_LENGTH_MM))
    scene: SceneRequest | PlanesRequest = field(default_factory=SceneRequest)
    exposure_s: float = DEFAULT_EXPOSURE_S
    integration: Rule = "trapezoid"
    cells_per_pixel: int = 1
    name: str | None = None

    @property
    def camera(self) -> Camera:
        """The camera of this set-up."""
        return Camera(self.optics, self.sensor, self.integration, self.cells_per_pixel)

    @property
    def seen(self) -> SceneRequest | PlanesRequest:
        """The scene, with built-in edges drawn as finely as the camera's cells, without visible steps."""
        array, cells = self.sensor.array, self.cells_per_pixel
        frame = array.rows * cells, array.cols * cells
        cell_m = self.sensor.pixel.width_um.value * 1e-6 / cells

        def samples_per_m(request: SceneRequest) -> float:
            distance_m = DEFAULT_DISTANCE_M if request.distance_m is None else request.distance_m
            return self.optics.magnification(distance_m) / cell_m

        if isinstance(self.scene, PlanesRequest):
            return self.scene.drawn_for(frame, samples_per_m)
        return self.scene.drawn_for(frame, samples_per_m(self.scene)) if not self.scene.is_file else self.scene


def load_camera(path: str | PathLike[str]) -> SetUp:
    """Read a set-up from a camera file, a YAML file with the fields listed at the top of this module.

    Raises
    ------
    FileError
        If the file, or a file that it names, is missing or invalid.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "mine.camera.yaml").write_text("photosite_camera: 1\\noptics: {f_number: 4}\\n")
    ...     load_camera(f"{folder}/mine.camera.yaml").optics.f_number
    Traceback (most recent call last):
    photosite.errors.FileError: ...mine.camera.yaml:2: optics: field 'focal_length_mm' is missing
    """
    file = Path(path)
    data = read_yaml(file, "a camera file")
    check_version(file, data, VERSION_KEY)
    return parse_camera(file, data)


def parse_camera(file: Path, data: Mapping[str, Any]) -> SetUp:
    """Return a set-up from the fields of a camera file, or of a section in another file; errors have the line."""
    check_keys(file, data, _KEYS, "a camera file")
    given: dict[str, Any] = {"name": optional_text(file, data, "name")}
    for key, read in (("sensor", _sensor), ("optics", _optics), ("scene", parse_scene), ("exposure", _exposure)):
        if data.get(key) is not None:
            given["exposure_s" if key == "exposure" else key] = read(file, data)
    given |= {key: data[key] for key in ("integration", "cells_per_pixel") if data.get(key) is not None}
    set_up = SetUp(**given)
    try:
        if (setting := data.get("gain_setting")) is not None:
            set_up = replace(set_up, sensor=set_up.sensor.at_gain_setting(setting))
        _ = set_up.camera
    except InputError as error:
        raise error.in_file(file, line_of(data, error.what)) from None
    return set_up


def _sensor(file: Path, data: Mapping[str, Any]) -> Sensor:
    name = optional_text(file, data, "sensor") or ""
    is_file = Path(name).suffix in (".yaml", ".yml") or Path(name).name != name
    try:
        return load_sensor(file.parent / name if is_file else name)
    except (InputError, FileError) as error:
        raise _of_file(error, "sensor", file, data) from None


def _optics(file: Path, data: Mapping[str, Any]) -> Optics:
    from photosite.optics.io.formats import load_optics, parse_optics

    value = data["optics"]
    if isinstance(value, str):
        try:
            return load_optics(file.parent / value)
        except FileError as error:
            raise _of_file(error, "optics", file, data) from None
    if not isinstance(value, Mapping):
        expected = "an optics file, or its fields"
        raise FileError(file, "optics", line_of(data, "optics"), value=value, expected=expected)
    return parse_optics(value, file, section="optics")


def _exposure(file: Path, data: Mapping[str, Any]) -> float:
    try:
        return parse_exposure(fspath(str(data["exposure"])))
    except InputError as error:
        raise _of_file(error, "exposure", file, data) from None


def _of_file(error: InputError | FileError, key: str, file: Path, data: Mapping[str, Any]) -> FileError:
    """Return an error in a field's value, or in the file that it names, as one of the camera file."""
    if isinstance(error, FileError):
        return FileError(file, str(error), line_of(data, key), where=key)
    return (error if error.what == key else error.within(key)).in_file(file, line_of(data, key))


# The section `scene` of a camera file: a scene, or planes in depth, near to far.
#
# scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2}
# scene:
#   - {source: leaf.png, alpha: leaf-mask.png, illuminant: D65, luminance_cd_m2: 100, distance_m: 1, width_m: 0.2}
#   - {source: meadow.exr, distance_m: 20}


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
    return _scene(file, section, line, _SCENE_KEYS)


def _plane(file: Path, section: Any, line: int | None) -> PlaneRequest:
    request = _scene(file, section, line, (*_SCENE_KEYS, "alpha"))
    alpha = optional_text(file, section, "alpha")
    if alpha is not None and not os.path.exists(file.parent / alpha):
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
        if not os.path.exists(path):
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


def parse_illuminant(value: Any, file: Path) -> str | float:
    """Return the illuminant that a file states; the name of a CSV file is relative to that file.

    Raises
    ------
    InputError
        If there is no such illuminant.
    """
    if isinstance(value, str) and value.strip().lower().endswith(".csv"):
        value = fspath(file.parent / value.strip())
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError("illuminant", value=value, expected="a name, or a temperature in K")
    relative_energy(value, [560.0])
    return value


def _checked(source: str, argument: str, value: Any, file: Path) -> Any:
    """The value of an argument, once a request accepts it."""
    if argument == "illuminant":
        value = parse_illuminant(value, file)
    if isinstance(value, list):
        value = list(value)
    SceneRequest(source, {argument: value})
    if argument == "wavelength_nm":  # those of a file's bands can be in any order
        wavelength_grid(value if source in BUILT_IN_SCENES else sorted(value))
    return value
