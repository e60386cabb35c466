"""Camera files: sensor, optics, scene and exposure of a set-up in one YAML file.

photosite_camera: 1
name: D200 with its 50 mm
sensor: nikon-d200                  # a preset, or a sensor file
optics: planar50.optics.yaml        # an optics file, or its fields: {f_number: 8, focal_length_mm: 50}
scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2}    # or a list of planes in depth
exposure: 1/3
integration: trapezoid
cells_per_pixel: 1

File names are relative to the camera file. Missing fields have the values of the 2008 paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from photosite.camera.camera import Camera
from photosite.color.spectrum import Rule
from photosite.errors import FileError, InputError
from photosite.files.yaml import check_keys, check_version, line_of, optional_text, read_yaml
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.protocols import Optics
from photosite.scene.io.section import parse_scene
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.scene.scene_request import PlanesRequest, SceneRequest
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.values.exposure import parse_exposure

VERSION_KEY = "photosite_camera"
DEFAULT_SENSOR = "nikon-d200"
DEFAULT_F_NUMBER = 8.0
DEFAULT_FOCAL_LENGTH_MM = 50.0
DEFAULT_EXPOSURE_S = 1 / 3
"""The 2008 paper's set-up; `photosite.scene.built_in` has the defaults of its scene."""

_KEYS = (VERSION_KEY, "name", "sensor", "optics", "scene", "exposure", "integration", "cells_per_pixel")


@dataclass(frozen=True, eq=False)
class SetUp:
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
    check_keys(file, data, _KEYS, "a camera file")
    given: dict[str, Any] = {"name": optional_text(file, data, "name")}
    for key, read in (("sensor", _sensor), ("optics", _optics), ("scene", parse_scene), ("exposure", _exposure)):
        if data.get(key) is not None:
            given["exposure_s" if key == "exposure" else key] = read(file, data)
    given |= {key: data[key] for key in ("integration", "cells_per_pixel") if data.get(key) is not None}
    set_up = SetUp(**given)
    try:
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
