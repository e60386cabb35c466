"""A scene as people ask for one: a formula's name with its options, or a file, with a light and a place.

The command line and the camera file both speak of scenes this way.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from photosite.errors import FileError, InputError, did_you_mean
from photosite.scene.scene import Scene
from photosite.scene.values import check_flag, check_luminance, check_number

if TYPE_CHECKING:
    from photosite.scene.planes import Plane, Planes

FORMULAS = (
    "macbeth",
    "color-checker-sg",
    "uniform",
    "slanted-edge",
    "edge-star",
    "siemens-star",
    "sinusoid",
    "frequency-sweep",
    "zone-plate",
    "dead-leaves",
    "point-grid",
    "checkerboard",
    "ramp",
    "hdr-patches",
)
"""Scenes by formula, as one asks for them; each is the function of `photosite.scene.charts` of that name."""

OF_ANY_SIZE = ("slanted-edge", "edge-star", "siemens-star", "ramp")
"""Formulas that look the same whatever their samples, and the finer the more there are."""

MOST_SAMPLES = 100_000_000
"""Of a formula drawn as finely as a camera sees it."""

DEFAULT_SCENE = "macbeth"
DEFAULT_ILLUMINANT = "A"
DEFAULT_LUMINANCE_CD_M2 = 40.0
"""The 2008 paper's chart and light. Files have their own light, where they say so."""

_SHARED = ("illuminant", "mean_luminance_cd_m2", "wavelength_nm", "distance_m", "width_m", "rule")
"""What a request says in fields of its own, not among a formula's options."""


@dataclass(frozen=True)
class Place:
    """Where a request was written, for errors that come up when its scene is made."""

    file: Path
    line: int | None = None


_IN_CAMERA_FILE = (
    (r"\bwavelength_nm=\[\.\.\.\]", "wavelength_nm: [400, 410, ...]"),
    (r"\b(units|illuminant)='([^']*)'", r"\1: \2"),
    (r"\bmean_luminance_cd_m2=([\d.]+)", r"luminance_cd_m2: \1"),
    (r"\band mean_luminance_cd_m2\b", "and luminance_cd_m2"),
    (r"\bband_range_nm=\(([^)]*)\)", r"options: {band_range_nm: [\1]}"),
    (r"\bsort_bands=True", "options: {sort_bands: true}"),
    (r"\bvariable='\.\.\.'", "options: {variable: NAME}"),
    (r"\b(no_data|negative|interleave|method|out_of_gamut)='([\w-]+)'", r"options: {\1: \2}"),
    (r"\bpatch_cols=(\d+)", r"options: {patch_cols: \1}"),
)
"""What an error advises in words of Python, and the same in a camera file's section."""


def in_camera_file(message: str) -> str:
    """A message whose advice is fields of a camera file's section `scene`.

    Examples
    --------
    >>> in_camera_file("say the light on them (illuminant='D65', mean_luminance_cd_m2=100)")
    'say the light on them (illuminant: D65, luminance_cd_m2: 100)'
    >>> in_camera_file("say that they be sorted (sort_bands=True)")
    'say that they be sorted (options: {sort_bands: true})'
    """
    for pattern, said in _IN_CAMERA_FILE:
        message = re.sub(pattern, said, message)
    return message


@contextmanager
def _said_at(place: Place | None) -> Iterator[None]:
    """Errors name the place of the request, where it has one, and advise in its words."""
    try:
        yield
    except (InputError, FileError) as error:
        if place is None:
            raise
        raise FileError(place.file, f"scene: {in_camera_file(str(error))}", place.line) from None


@dataclass(frozen=True, eq=False)
class SceneRequest:
    """What scene is wanted. None is left to the formula or the file.

    Parameters
    ----------
    source
        A formula's name (`FORMULAS`), or a file that `photosite.scene.io.files.read_scene` reads.
    illuminant
        As for `photosite.color.illuminants.illuminant`. For a formula None is CIE A, the paper's light. A file of
        reflectances or
        of a picture is lit by it; one of radiances whose reflectances are not known refuses it.
    mean_luminance_cd_m2
        None: 40 cd/m2 for a formula, what a file says for a file.
    distance_m
        From the lens.
    width_m
        At that distance; None lets the scene fill the sensor, unless its file says how wide it is.
    wavelength_nm
        (wavelengths,) of the scene.
    units, tolerance
        As for `read_scene`; files only.
    options
        A formula's own options, such as `contrast` of slanted-edge; of a file those of
        `photosite.scene.options.ReadOptions`, such as `no_data`.
    place
        Where it was written, for messages; None where it was not.
    """

    source: str = DEFAULT_SCENE
    illuminant: str | float | None = None
    mean_luminance_cd_m2: float | None = None
    distance_m: float | None = None
    width_m: float | None = None
    wavelength_nm: ArrayLike | None = None
    units: str | None = None
    tolerance: float | None = None
    options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    place: Place | None = None

    @property
    def is_file(self) -> bool:
        """Whether the source is a file, not a formula."""
        return self.source not in FORMULAS

    @property
    def light(self) -> str | float | None:
        """The illuminant, where it is said; a formula's is CIE A where it is not."""
        return DEFAULT_ILLUMINANT if self.illuminant is None and not self.is_file else self.illuminant

    def instead(self, source: str) -> SceneRequest:
        """Another scene in this one's place: as far away, and a formula's in the same light."""
        if source not in FORMULAS:
            return SceneRequest(source, distance_m=self.distance_m)
        return SceneRequest(source, self.illuminant, self.mean_luminance_cd_m2, self.distance_m)

    def drawn_for(self, frame: tuple[int, int], samples_per_m: float) -> SceneRequest:
        """The same scene; a formula of any size, whose size is not said, has a sample for each cell at least.

        Parameters
        ----------
        frame
            (rows, cols) of cells that a scene without a width fills.
        samples_per_m
            Cells across one metre of the scene.

        Examples
        --------
        >>> SceneRequest("slanted-edge").drawn_for((2592, 3872), 7186.0).options
        {'rows': 2592, 'cols': 3872}
        >>> SceneRequest("zone-plate").drawn_for((2592, 3872), 7186.0).options
        {}
        """
        if self.source not in OF_ANY_SIZE or {"rows", "cols"} & set(self.options):
            return replace(self, options=dict(self.options))
        rows, cols = frame
        default = formula_options(self.source)
        if self.width_m is not None:
            cols = max(math.ceil(self.width_m * samples_per_m), 1)
            rows = max(math.ceil(cols * default["rows"] / default["cols"]), 1)
            if self.source == "slanted-edge":  # the same above and below; the camera sees no more than its frame
                rows = min(rows, frame[0])
        if rows <= default["rows"] and cols <= default["cols"]:  # fine enough as it is
            return replace(self, options=dict(self.options))
        coarser = math.ceil(math.sqrt(max(rows * cols / MOST_SAMPLES, 1.0)))
        size = {"rows": -(-rows // coarser), "cols": -(-cols // coarser)}
        return replace(self, options={**self.options, **size})

    def scene(self) -> Scene:
        """The scene itself.

        Raises
        ------
        InputError
            If there is neither such a formula nor such a file, an option is not the formula's, or a value cannot be.
        FileError
            If the file cannot be read as a scene, or, of a request that was written in a file, anything is wrong.

        Examples
        --------
        >>> SceneRequest("slanted-edge", options={"contrast": 10, "rows": 20, "cols": 30}).scene().shape
        (20, 30)
        >>> SceneRequest("slantededge").scene()
        Traceback (most recent call last):
        photosite.errors.InputError: no scene 'slantededge': it is no file, and no formula; did you mean 'slanted-edge'?
        """
        with _said_at(self.place):
            return self._of_file() if self.is_file else self._of_formula()

    def _of_formula(self) -> Scene:
        make = formula(self.source)
        for name in ("units", "tolerance"):
            if getattr(self, name) is not None:
                raise InputError(f"{name} is said of a scene's file; '{self.source}' is a formula")
        check_options(self.source, self.options)
        if self.mean_luminance_cd_m2 is not None:
            check_luminance("mean_luminance_cd_m2", self.mean_luminance_cd_m2)
        wanted: dict[str, Any] = {
            "illuminant": self.light,
            "mean_luminance_cd_m2": (
                DEFAULT_LUMINANCE_CD_M2 if self.mean_luminance_cd_m2 is None else self.mean_luminance_cd_m2
            ),
            "wavelength_nm": self.wavelength_nm,
            "distance_m": self.distance_m,
            "width_m": self.width_m,
        }
        takes = inspect.signature(make).parameters
        for name in ("illuminant", "width_m"):
            if name not in takes and getattr(self, name) is not None:
                raise InputError(f"the scene '{self.source}' takes no {name}")
        shared = {name: value for name, value in wanted.items() if name in takes and value is not None}
        try:
            return make(**shared, **self.options)
        except (TypeError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"the scene '{self.source}' cannot be made of these options: {error}") from None

    def _of_file(self) -> Scene:
        path = Path(self.source)
        if not path.exists() and path.name == self.source and not path.suffix:
            raise InputError(
                f"no scene '{self.source}': it is no file, and no formula; {did_you_mean(self.source, FORMULAS)}"
            )
        said: dict[str, Any] = {
            "illuminant": self.illuminant,
            "mean_luminance_cd_m2": self.mean_luminance_cd_m2,
            "distance_m": self.distance_m,
            "width_m": self.width_m,
            "wavelength_nm": self.wavelength_nm,
            "units": self.units,
            "tolerance": self.tolerance,
        }
        from photosite.scene.io.files import read_scene

        given = {name: value for name, value in said.items() if value is not None}
        for name in given:
            if name in self.options and not np.array_equal(self.options[name], given[name]):
                raise InputError(
                    f"{name} is said twice, {given[name]!s:.40} and {self.options[name]!s:.40}; say it once"
                )
        return read_scene(path, **{**self.options, **given})


@dataclass(frozen=True, eq=False)
class PlaneRequest:
    """A plane of a scene in depth.

    Parameters
    ----------
    request
        Its light.
    alpha
        A picture of where it is opaque, of as many pixels as the scene has samples; None: everywhere.
    """

    request: SceneRequest
    alpha: Path | None = None

    def drawn_for(self, frame: tuple[int, int], samples_per_m: Callable[[SceneRequest], float]) -> PlaneRequest:
        """The same plane drawn for the camera, unless a picture of opacity has its size."""
        if self.alpha is not None:
            return self
        return replace(self, request=self.request.drawn_for(frame, samples_per_m(self.request)))

    def plane(self) -> Plane:
        """The plane itself.

        Raises
        ------
        InputError
            As `SceneRequest.scene`.
        FileError
            If the picture of alpha cannot be read, or is of another size than the scene.
        """
        from photosite.scene.io.alpha import read_alpha
        from photosite.scene.planes import Plane

        scene = self.request.scene()
        if self.alpha is None:
            return Plane(scene)
        try:
            return Plane(scene, read_alpha(self.alpha))
        except InputError as error:
            raise FileError(self.alpha, str(error)) from None


@dataclass(frozen=True, eq=False)
class PlanesRequest:
    """A scene in depth: planes, near to far."""

    planes: tuple[PlaneRequest, ...]
    place: Place | None = None

    def drawn_for(self, frame: tuple[int, int], samples_per_m: Callable[[SceneRequest], float]) -> PlanesRequest:
        """The same planes, each drawn for the camera."""
        return replace(self, planes=tuple(part.drawn_for(frame, samples_per_m) for part in self.planes))

    def scene(self) -> Planes:
        """The planes themselves.

        Raises
        ------
        InputError
            As `PlaneRequest.plane`, or if they do not stand in order.
        FileError
            As `PlaneRequest.plane`.
        """
        from photosite.scene.planes import Planes

        planes = tuple(part.plane() for part in self.planes)
        with _said_at(self.place):
            return Planes(planes)

    @property
    def light(self) -> str | float | None:
        """The light of all planes, where it is said and the same."""
        lights = {part.request.light for part in self.planes}
        return lights.pop() if len(lights) == 1 else None


def formula(name: str) -> Callable[..., Scene]:
    """The function that makes a formula's scene."""
    from photosite.scene import charts

    made: Callable[..., Scene] = getattr(charts, name.replace("-", "_"))
    return made


def formula_options(name: str) -> dict[str, Any]:
    """A formula's own options with their defaults.

    Examples
    --------
    >>> formula_options("slanted-edge")
    {'angle_deg': 5.0, 'contrast': 4.0, 'rows': 400, 'cols': 400}
    """
    parameters = inspect.signature(formula(name)).parameters.values()
    return {entry.name: entry.default for entry in parameters if entry.name not in _SHARED}


def check_options(name: str, options: Mapping[str, Any]) -> None:
    """Whether a formula has these options, and whether they are numbers, text, true or false where its own are.

    Raises
    ------
    InputError
        If it lacks one, or one is of another kind.
    """
    known = formula_options(name)
    for option, value in options.items():
        if option not in known:
            hint = did_you_mean(option, known) if known else "it has none"
            raise InputError(f"the scene '{name}' has no option '{option}'; {hint}")
        default, called = known[option], f"the scene '{name}': {option}"
        if isinstance(default, bool):
            check_flag(called, value)
        elif isinstance(default, str):
            if not isinstance(value, str):
                raise InputError(f"{called} is text, such as '{default}', not {value!r:.40}")
        elif value is not None or default is not None:
            if value is None:
                raise InputError(f"{called} is a number, not nothing")
            check_number(called, value, whole=isinstance(default, int))


def scene_request(source: str | PathLike[str], folder: Path | None = None, **said: Any) -> SceneRequest:
    """A request whose source, where it is a file, is named from a folder: a camera file's, say."""
    text = fspath(source)
    if text in FORMULAS or folder is None:
        return SceneRequest(text, **said)
    return SceneRequest(fspath(folder / text), **said)
