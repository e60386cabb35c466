"""Sweep files: a camera, values of its fields, and what to measure, in one YAML file.

photosite_sweep: 1
name: How small may a pixel be
camera: {sensor: google-pixel-4a, optics: {f_number: 2.8, focal_length_mm: 4}}     # or a camera file
values:
  pixel_width_um: [0.8, 1.0, 1.4, 2.0, 3.0]
  f_number: [1.8, 2.8, 4]
measure: {snr: {luminance_cd_m2: 5, exposure: 1/15}}     # or the name alone; sensor_figures, image_quality
scene: {source: macbeth, illuminant: A}                  # as in a camera file; without it, an even surface

File names are relative to the sweep file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from photosite.camera.camera import Camera
from photosite.camera.file import SetUp, load_camera, parse_camera, parse_illuminant, parse_scene
from photosite.errors import FileError, InputError, in_file
from photosite.files.yaml import check_version, line_of, read_yaml, validated
from photosite.metrics.registry import ValueName
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.scene.scene_request import PlanesRequest
from photosite.studies.gray_surface import snr
from photosite.studies.sensor_comparison import sensor_figures
from photosite.studies.simulated_charts import image_quality
from photosite.studies.sweep import Measure, check_point
from photosite.values.exposure import parse_exposure
from photosite.values.shown import Shown
from photosite.values.validated import PositiveNumber, Section

VERSION_KEY = "photosite_sweep"

_Exposure = Annotated[float, BeforeValidator(parse_exposure)]
_Light = str | PositiveNumber


class _Snr(Section):
    luminance_cd_m2: PositiveNumber = 100.0
    exposure: _Exposure = 1 / 60
    illuminant: _Light = "D65"

    def measure(self) -> Measure:
        return partial(snr, luminance_cd_m2=self.luminance_cd_m2, exposure_s=self.exposure, illuminant=self.illuminant)


class _SensorFigures(Section):
    exposure: _Exposure = 1 / 15
    illuminant: _Light = "3200K"

    def measure(self) -> Measure:
        return partial(sensor_figures, exposure_s=self.exposure, illuminant=self.illuminant)


class _ImageQuality(Section):
    values: list[str] = Field(min_length=1)
    frames: Annotated[int, Field(ge=0)] = 4
    luminance_cd_m2: PositiveNumber = 200.0
    exposure: _Exposure | None = None
    illuminant: _Light = "D65"

    @model_validator(mode="after")
    def _known(self) -> _ImageQuality:
        for name in self.values:
            ValueName.parse(name)
        return self

    def measure(self) -> Measure:
        return partial(
            image_quality,
            values=tuple(self.values),
            frames=self.frames,
            luminance_cd_m2=self.luminance_cd_m2,
            illuminant=self.illuminant,
            exposure_s=self.exposure,
        )


class _Measure(Section):
    snr: _Snr | None = None
    sensor_figures: _SensorFigures | None = None
    image_quality: _ImageQuality | None = None

    @property
    def chosen(self) -> _Snr | _SensorFigures | _ImageQuality:
        """The measure that is given."""
        found = self.snr or self.sensor_figures or self.image_quality
        assert found is not None
        return found

    @model_validator(mode="after")
    def _one(self) -> _Measure:
        if [self.snr, self.sensor_figures, self.image_quality].count(None) != 2:
            raise ValueError("one measure: snr, sensor_figures or image_quality")
        return self


def _named(value: Any) -> Any:
    return {value: {}} if isinstance(value, str) else value


class _SweepFile(Section):
    photosite_sweep: Literal[1]
    name: str | None = None
    camera: str | dict[str, Any]
    values: dict[str, Annotated[list[bool | int | float | str], Field(min_length=1)]] = Field(min_length=1)
    measure: Annotated[_Measure, BeforeValidator(_named)] = _Measure(snr=_Snr())
    scene: Any = None


@dataclass(frozen=True, eq=False)
class SweepRequest(Shown):
    """The arguments of a sweep, as a file states them.

    Parameters
    ----------
    camera, values, measure, scene
        As for `sweep`.
    name
        Name of the sweep.
    """

    camera: Camera
    values: Mapping[str, list[Any]]
    measure: Measure
    scene: Scene | None = None
    name: str | None = None


def load_sweep(path: str | PathLike[str]) -> SweepRequest:
    """Read a sweep from a YAML file with the fields listed at the top of this module.

    Raises
    ------
    FileError
        If the file, or a file that it names, is missing or invalid, or a value is outside its field's range.

    Examples
    --------
    >>> import tempfile
    >>> text = "photosite_sweep: 1\\ncamera: {sensor: vendor-2.2um}\\nvalues: {f_number: [2, 4]}\\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "a.sweep.yaml").write_text(text)
    ...     load_sweep(f"{folder}/a.sweep.yaml").values
    {'f_number': [2, 4]}
    """
    file = Path(path)
    data = read_yaml(file, "a sweep file")
    check_version(file, data, VERSION_KEY)
    content: _SweepFile = validated(_SweepFile, data, file)
    chosen = content.measure.chosen
    camera = _camera(file, data).camera
    scene = None
    if content.scene is not None:
        if content.measure.snr is None:
            named = "sensor_figures" if content.measure.sensor_figures is not None else "image_quality"
            raise FileError(file, f"{named} has no scene", line_of(data, "scene"), hint="Omit the scene")
        scene = _scene(file, data)
    settings = data.get("measure")
    section = next(iter(settings.values())) if isinstance(settings, Mapping) else None
    for name in ("luminance_cd_m2", "illuminant") if scene is not None else ():
        if name in chosen.model_fields_set:
            problem, hint = f"measure: {name} does not apply with a scene", "Omit it, or set it in the scene"
            raise FileError(file, problem, line_of(section, name), hint=hint)
    with in_file(file, (isinstance(section, Mapping) and line_of(section, "illuminant")) or line_of(data, "measure")):
        light = parse_illuminant(_plain(chosen.illuminant), file)
    values = {name: [_plain(value) for value in entries] for name, entries in content.values.items()}
    if content.measure.image_quality is not None and {"illuminant", "mean_luminance_cd_m2"} & values.keys():
        scene = charts.uniform(light, content.measure.image_quality.luminance_cd_m2)  # the light of the charts
    _check_values(file, data, camera, values, scene)
    return SweepRequest(camera, values, chosen.model_copy(update={"illuminant": light}).measure(), scene, content.name)


def _plain(value: Any) -> Any:
    """Return a number without what the YAML reader keeps of its spelling."""
    return next((kind(value) for kind in (bool, int, float) if isinstance(value, kind)), value)


def _camera(file: Path, data: Mapping[str, Any]) -> SetUp:
    if isinstance(data["camera"], Mapping):
        return parse_camera(file, data["camera"])
    try:
        return load_camera(file.parent / data["camera"])
    except FileError as error:
        raise error.in_file(file, line_of(data, "camera")) from None


def _scene(file: Path, data: Mapping[str, Any]) -> Scene:
    request = parse_scene(file, data)
    if isinstance(request, PlanesRequest):
        raise FileError(file, "scene", line_of(data, "scene"), value=data["scene"], expected="one scene, not planes")
    return request.scene()


def _check_values(
    file: Path, data: Mapping[str, Any], camera: Camera, values: Mapping[str, list[Any]], scene: Scene | None
) -> None:
    """Try each value of a field with the first values of the fields before it, so that an error has its line."""
    before: dict[str, Any] = {}
    for name, entries in values.items():
        for index, value in enumerate(entries):
            try:
                check_point(camera, {**before, name: value}, scene)
            except InputError as error:
                line = line_of(data["values"][name], index) or line_of(data["values"], name)
                raise error.in_file(file, line) from None
        before[name] = entries[0]
