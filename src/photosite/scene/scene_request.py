"""A scene as the command line and the camera file ask for it: a built-in scene or a file, with options."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import SkipValidation

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError, PhotositeError, PythonSpelling, did_you_mean
from photosite.scene import charts
from photosite.scene.charts.chart import DEFAULT_LUMINANCE_CD_M2, LitChart
from photosite.scene.io.formats import read_scene
from photosite.scene.io.picture import read_alpha
from photosite.scene.options import Luminance, ReadOptions
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene
from photosite.values.read_only import ReadOnly
from photosite.values.shown import Shown
from photosite.values.validated import PositiveNumber, Validated

BUILT_IN_SCENES = (
    *("macbeth", "color-checker-sg", "uniform", "slanted-edge", "edge-star", "siemens-star", "sinusoid"),
    *("frequency-sweep", "zone-plate", "dead-leaves", "point-grid", "checkerboard", "ramp", "hdr-patches"),
    *("flare-traps", "slanted-squares", "gray-steps", "light-source", "led-bar"),
)
"""Each is the function of `photosite.scene.charts` of that name."""

DEFAULT_ILLUMINANT = "A"
"""Light of the built-in scenes where none is given: the 2008 paper's."""

OF_ANY_SIZE = ("slanted-edge", "slanted-squares", "edge-star", "siemens-star", "ramp")
"""Built-in scenes that only get finer with more samples."""

MOST_SAMPLES = 100_000_000
"""Of a built-in scene that is drawn as finely as a camera's cells."""

DEFAULT_SCENE = "macbeth"
"""The 2008 paper's chart."""

FIELDS = {"illuminant": "illuminant", "luminance_cd_m2": "mean_luminance_cd_m2"} | {
    name: name for name in ("distance_m", "width_m", "wavelength_nm", "units", "tolerance")
}
"""Fields of a camera file's section `scene`, and the arguments of the library that they set."""
_FIELD_OF = {argument: name for name, argument in FIELDS.items()}


class LightAndPlace(Validated):
    """The light on a built-in scene, and its place; see `photosite.scene.charts.chart.Chart.under`."""

    illuminant: Annotated[str | float | Spectrum, SkipValidation] = DEFAULT_ILLUMINANT
    mean_luminance_cd_m2: Luminance = DEFAULT_LUMINANCE_CD_M2
    wavelength_nm: Any = None
    distance_m: PositiveNumber | None = None
    width_m: PositiveNumber | None = None


def chart_function(name: str) -> LitChart[...]:
    """Return the function that makes a built-in scene."""
    function: LitChart[...] = getattr(charts, name.replace("-", "_"))
    return function


def chart_options(name: str) -> dict[str, Any]:
    """Return a built-in scene's own options with their defaults.

    Examples
    --------
    >>> chart_options("slanted-edge")
    {'angle_deg': 5.0, 'contrast': 4.0, 'rows': 400, 'cols': 400}
    """
    return {option: field.default for option, field in chart_function(name).options.model_fields.items()}


def check_built_in(name: str, **options: Any) -> dict[str, Any]:
    """Return the arguments of a built-in scene, its light included, once they are valid."""
    shared = {option: value for option, value in options.items() if option in LightAndPlace.model_fields}
    light = LightAndPlace(**shared)
    own = chart_function(name).options(**{option: options[option] for option in options.keys() - shared.keys()})
    defaults = {"illuminant": light.illuminant, "mean_luminance_cd_m2": light.mean_luminance_cd_m2}
    return {**defaults, **light.given(), **own.given()}


def built_in_scene(name: str, **options: Any) -> Scene:
    """Return a built-in scene, by default under the 2008 paper's light.

    Examples
    --------
    >>> built_in_scene("slanted-edge", contrast=10, rows=20, cols=30).shape
    (20, 30)
    """
    return chart_function(name)(**check_built_in(name, **options))


class CameraFileSpelling:
    """Arguments as the section `scene` of a camera file writes them.

    Examples
    --------
    >>> CameraFileSpelling().argument("mean_luminance_cd_m2", 100)
    'luminance_cd_m2: 100'
    >>> CameraFileSpelling().argument("sort_bands", True)
    'options: {sort_bands: true}'
    """

    def name(self, field: str) -> str:
        """Return the name of the field."""
        return _FIELD_OF.get(field, field)

    def argument(self, field: str, value: Any) -> str:
        """Return the field with its value."""
        if field not in ReadOptions.model_fields:
            return PythonSpelling().argument(field, value)
        if isinstance(value, bool):
            value = str(value).lower()
        elif isinstance(value, tuple):
            value = list(value)
        return f"{_FIELD_OF[field]}: {value}" if field in _FIELD_OF else f"options: {{{field}: {value}}}"


@dataclass(frozen=True)
class Place(Shown):
    """The line of a camera file that asks for a scene, for errors that appear when the scene is made."""

    file: Path
    line: int | None = None

    @contextmanager
    def errors(self, line: int | None = None) -> Iterator[None]:
        """Raise errors from inside as errors of the file, written with its fields."""
        try:
            yield
        except PhotositeError as error:
            raise error.in_file(self.file, line or self.line, CameraFileSpelling()).within("scene") from None


def _errors_at(place: Place | None) -> AbstractContextManager[None]:
    return nullcontext() if place is None else place.errors()


@dataclass(frozen=True, eq=False)
class SceneRequest(Shown):
    """A scene that is asked for, validated before it is made.

    Parameters
    ----------
    source
        The name of a built-in scene (`BUILT_IN_SCENES`), or a file that `photosite.read_scene` reads.
    options
        Of a built-in scene: its own options, and its light and place as in `photosite.scene.charts.macbeth`; by default
        CIE A and 40 cd/m2. Of a file: the fields of `photosite.scene.options.ReadOptions`.
    place
        Where it was asked for, for messages; None for a request by a caller.

    Raises
    ------
    InputError
        If there is neither such a built-in scene nor such a file, or an option is unknown or invalid.

    Examples
    --------
    >>> SceneRequest("slanted-edge", {"contrast": 10, "rows": 20, "cols": 30}).scene().shape
    (20, 30)
    >>> SceneRequest("slantededge")
    Traceback (most recent call last):
    photosite.errors.InputError: no scene 'slantededge': it is neither a built-in scene nor a file. Did you mean \
'slanted-edge'?
    """

    source: str = DEFAULT_SCENE
    options: Mapping[str, Any] = field(default_factory=lambda: ReadOnly({}))
    place: Place | None = None

    def __post_init__(self) -> None:
        if not self.is_file:
            for name in (name for name in ("units", "tolerance") if name in self.options):
                what = f"an option of scene files does not apply to the built-in scene '{self.source}'"
                raise InputError(what, hint=f"Omit {{{name}}}", arguments={name: self.options[name]})
            check_built_in(self.source, **self.options)
            return
        path = Path(self.source)
        if not os.path.exists(path) and path.name == self.source and not path.suffix:
            what = f"no scene '{self.source}': it is neither a built-in scene nor a file"
            raise InputError(what, hint=did_you_mean(self.source, BUILT_IN_SCENES))
        ReadOptions(**self.options)

    @property
    def is_file(self) -> bool:
        """Whether the source is a file, not a built-in scene."""
        return self.source not in BUILT_IN_SCENES

    @property
    def distance_m(self) -> float | None:
        """Distance from the lens, where it is given."""
        return self.options.get("distance_m")

    @property
    def light(self) -> Any:
        """The illuminant, where it is given; by default a built-in scene's is CIE A."""
        return self.options.get("illuminant", None if self.is_file else DEFAULT_ILLUMINANT)

    def instead(self, source: str) -> SceneRequest:
        """Return another scene at this one's distance; a built-in one in the same light too."""
        kept = ["distance_m", *(("illuminant", "mean_luminance_cd_m2") if source in BUILT_IN_SCENES else ())]
        return SceneRequest(source, {name: self.options[name] for name in kept if name in self.options})

    def drawn_for(self, frame: tuple[int, int], samples_per_m: float) -> SceneRequest:
        """Return the same scene with at least one sample per cell of a camera, where it can have any size.

        A scene without a width fills the frame's (rows, cols) cells; `samples_per_m` are cells across a meter of it.

        Examples
        --------
        >>> SceneRequest("slanted-edge").drawn_for((2592, 3872), 7186.0).options
        {'rows': 2592, 'cols': 3872}
        >>> dict(SceneRequest("zone-plate").drawn_for((2592, 3872), 7186.0).options)
        {}
        """
        if self.source not in OF_ANY_SIZE or {"rows", "cols"} & set(self.options):
            return self
        rows, cols = frame
        default = chart_options(self.source)
        if (width_m := self.options.get("width_m")) is not None:
            cols = max(math.ceil(width_m * samples_per_m), 1)
            rows = max(math.ceil(cols * default["rows"] / default["cols"]), 1)
            if self.source == "slanted-edge":  # the same at every height, so no more rows than the frame's are needed
                rows = min(rows, frame[0])
        if rows <= default["rows"] and cols <= default["cols"]:  # the default is fine enough
            return self
        coarser = math.ceil(math.sqrt(max(rows * cols / MOST_SAMPLES, 1.0)))
        return replace(self, options={**self.options, "rows": -(-rows // coarser), "cols": -(-cols // coarser)})

    def scene(self) -> Scene:
        """Make the scene. Errors of a request from a camera file are a `FileError` with its line."""
        with _errors_at(self.place):
            if self.is_file:
                return read_scene(self.source, **self.options)
            return built_in_scene(self.source, **self.options)


@dataclass(frozen=True, eq=False)
class PlaneRequest(Shown):
    """A plane of a scene in depth: a scene, and a picture of its opacity, a pixel a sample; None is opaque."""

    request: SceneRequest
    alpha: Path | None = None

    def drawn_for(self, frame: tuple[int, int], samples_per_m: Callable[[SceneRequest], float]) -> PlaneRequest:
        """Return the same plane drawn for the camera, unless a picture of opacity fixes its size."""
        if self.alpha is not None:
            return self
        return replace(self, request=self.request.drawn_for(frame, samples_per_m(self.request)))

    def plane(self) -> Plane:
        """Make the plane."""
        scene = self.request.scene()
        if self.alpha is None:
            return Plane(scene)
        try:
            return Plane(scene, read_alpha(self.alpha))
        except InputError as error:
            raise error.in_file(self.alpha) from None


@dataclass(frozen=True, eq=False)
class PlanesRequest(Shown):
    """A scene in depth: planes, near to far."""

    planes: tuple[PlaneRequest, ...]
    place: Place | None = None

    def drawn_for(self, frame: tuple[int, int], samples_per_m: Callable[[SceneRequest], float]) -> PlanesRequest:
        """Return the same planes, each drawn for the camera."""
        return replace(self, planes=tuple(part.drawn_for(frame, samples_per_m) for part in self.planes))

    def scene(self) -> Planes:
        """Make the planes."""
        planes = tuple(part.plane() for part in self.planes)
        with _errors_at(self.place):
            return Planes(planes)

    @property
    def light(self) -> Any:
        """The light of all planes, where it is the same."""
        lights = {part.request.light for part in self.planes}
        return lights.pop() if len(lights) == 1 else None


def merged_options(options: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return both; raise `InputError` if one option is given twice with different values."""
    for name in options.keys() & more.keys():
        one, two = (tuple(value) if isinstance(value, list) else value for value in (options[name], more[name]))
        if one != two:
            raise InputError(name, value=two, expected=f"given once; it is also {one!r:.40}")
    return {**options, **more}
