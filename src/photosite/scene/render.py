"""Scenes rendered by Mitsuba 3, band by band.

Mitsuba's spectral radiance is W/sr/m2/nm: the unit of its `blackbody`, and of emitters with spectra in that unit.
Mitsuba's default film converts spectra to color; here a film records the radiance of each pixel in each band.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike, fspath
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from photosite.color.spectrum import wavelength_grid
from photosite.errors import FileError, InputError, PhotositeWarning, did_you_mean
from photosite.scene.cube import ArrayCube
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import reduce_cube
from photosite.scene.weights import Progress
from photosite.values.validated import PositiveNumber, Validated

__all__ = ["example_scene", "render_mitsuba"]
__dir__ = __all__.copy

SceneSource = str | PathLike[str] | Mapping[str, Any]
Shape = tuple[int | None, int | None]

RENDER_WAVELENGTH_NM: NDArray[np.float64] = np.arange(400.0, 701.0, 10.0)
RENDER_WAVELENGTH_NM.flags.writeable = False

EXAMPLE = Path(__file__).parent / "examples" / "still_life.xml"
"""Painted objects on a table under a lamp of 3200 K, in meters and W/sr/m2/nm."""

_LANES = 4
"""Wavelengths per path in Mitsuba, a quarter of the film's range apart."""
_EDGE = 1 / 2000
"""Width of a band's edge relative to the band: a path near an edge counts partly for both bands."""
_FILM_KEEPS = {"width", "height", "crop_offset_x", "crop_offset_y", "crop_width", "crop_height"}
_FILM_KNOWS = _FILM_KEEPS | {"file_format", "pixel_format", "component_format", "sample_border", "compensate", "banner"}
"""Properties of Mitsuba's films; any other is a misspelling, unless it is an object (a filter, a response)."""
_NO_SCALE = {"d65", "srgb_d65", "envmap", "sunsky", "sky", "sun"}


Variant = Literal["scalar_spectral", "llvm_ad_spectral", "cuda_ad_spectral"]
"""Variants of Mitsuba that render spectra. The first needs Mitsuba alone; the others need LLVM or an NVIDIA GPU."""
Count = Annotated[int, Field(ge=1)]


class RenderArguments(TypedDict, total=False):
    """The fields of `RenderOptions` as keyword arguments."""

    wavelength_nm: ArrayLike
    spp: int
    seed: int
    rows: int | None
    cols: int | None
    sensor: int
    variant: Variant
    parameters: Mapping[str, object]
    unit_m: float
    distance_m: float | None
    mean_luminance_cd_m2: float | None
    tolerance: float


class RenderOptions(Validated):
    """How a scene is rendered.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,) centers of the bands, in equal steps. A band is as wide as the step, 10 nm where there is only
        one; its value is the mean radiance over it.
    spp
        Paths per pixel and group of four bands.
    seed
        Of the paths. All groups use the same seed, so that noise changes the brightness of a sample, not its hue.
    rows, cols
        Of the picture; None: those of the scene's film.
    sensor
        Index of the camera in the scene.
    variant
        Of Mitsuba.
    parameters
        Values of a scene file's `$names`.
    unit_m
        Meters in a unit of the scene.
    distance_m
        From the lens to the scene. None: the focus distance of the scene's camera; else the distance of the object in
        the center of the picture; else 1.2 m.
    mean_luminance_cd_m2
        Mean luminance to scale the scene to, for lights without an absolute scale (RGB, D65, environment pictures).
    tolerance
        Largest RMS error of the radiance, relative to its RMS, of the reduction to few basis spectra.
    """

    wavelength_nm: Any = RENDER_WAVELENGTH_NM
    spp: Count = 64
    seed: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    rows: Count | None = None
    cols: Count | None = None
    sensor: int = 0
    variant: Variant = "scalar_spectral"
    parameters: Any = None
    unit_m: PositiveNumber = 1.0
    distance_m: Any = None
    mean_luminance_cd_m2: Any = None
    tolerance: Any = 1e-3


def render_mitsuba(
    scene: SceneSource, *, progress: Progress | None = None, **options: Unpack[RenderArguments]
) -> Scene:
    """Render a scene with Mitsuba 3.

    Parameters
    ----------
    scene
        A scene file (XML), or a dictionary as `mitsuba.load_dict` takes it.
    progress
        Called with the bands done.
    **options
        Fields of `RenderOptions`.

    Returns
    -------
    Scene
        Its width is that of the camera's field of view at the distance.

    Raises
    ------
    InputError
        If the extra `render` is not installed, or a parameter is invalid.
    FileError
        If the scene file is missing or Mitsuba rejects it, or the rendering has values that are NaN or infinite.

    Notes
    -----
    Film: `specfilm` with a box filter, a sample being the mean over its own square, and one box-shaped response per
    band, whose integral over the radiance is divided by its width. Four adjacent bands make one rendering:
    Mitsuba spaces the four wavelengths of a path by a quarter of the range, so that every path has exactly one in each
    band. W. Jakob and others, Mitsuba 3, version 3.6 or later.

    Examples
    --------
    >>> wall = {
    ...     "type": "scene",
    ...     "integrator": {"type": "path"},
    ...     "sensor": {"type": "perspective", "fov": 30, "film": {"type": "hdrfilm", "width": 6, "height": 4}},
    ...     "light": {"type": "constant", "radiance": {"type": "uniform", "value": 2.0}},
    ... }
    >>> scene = render_mitsuba(wall, wavelength_nm=[450, 550, 650], spp=1)
    >>> from photosite.color.spectrum import energy_from_photons
    >>> scene.shape, energy_from_photons(scene.radiance(0, 0), scene.wavelength_nm).round(3)
    ((4, 6), array([2., 2., 2.]))
    """
    how = RenderOptions(**dict[str, Any](options))
    reading = ReadOptions(
        distance_m=how.distance_m, mean_luminance_cd_m2=how.mean_luminance_cd_m2, tolerance=how.tolerance
    )
    grid, width_nm = _bands(how.wavelength_nm)
    source = _Source(scene, how)
    with _mitsuba(how.variant) as mitsuba, source.errors():
        groups = []
        for first in range(0, grid.size, _LANES):
            groups.append(source.rendered(mitsuba, grid[first : first + _LANES], width_nm))
            if progress is not None:
                progress(min(first + _LANES, grid.size), grid.size, "bands")
        values = np.concatenate(groups, axis=2)
        distance, width_at_1 = source.view
        no_scale = sorted(source.plugins & _NO_SCALE)
    if no_scale and how.mean_luminance_cd_m2 is None:
        warnings.warn(
            PhotositeWarning(
                f"light of '{', '.join(no_scale)}' has no absolute scale; its values are read as W/sr/m2/nm",
                where=source.name,
                hint="Pass the luminance of the scene: {mean_luminance_cd_m2}",
                arguments={"mean_luminance_cd_m2": 100},
            ),
            stacklevel=2,
        )
    distance = how.distance_m or (distance * how.unit_m if distance else None)
    cube = ArrayCube(
        name=source.name,
        shape=(values.shape[0], values.shape[1], grid.size),
        wavelength_nm=grid,
        quantity="energy radiance",
        distance_m=distance,
        width_m=None if distance is None or width_at_1 is None else width_at_1 * distance,
        title=Path(source.name).stem,
        values=values,
    )
    return reduce_cube(cube, reading).scene


def example_scene(
    *, rows: int = 160, cols: int = 240, spp: int = 64, seed: int = 0, progress: Progress | None = None
) -> Scene:
    """Render the built-in example, with arguments of `render_mitsuba`: painted objects under a lamp of 3200 K.

    Examples
    --------
    >>> example_scene(rows=4, cols=6, spp=1).shape
    (4, 6)
    """
    return render_mitsuba(EXAMPLE, rows=rows, cols=cols, spp=spp, seed=seed, progress=progress)


def _bands(wavelength_nm: ArrayLike) -> tuple[NDArray[np.float64], float]:
    grid = wavelength_grid(wavelength_nm)
    if grid.size == 1:
        return grid, 10.0
    step = np.diff(grid)
    if not np.allclose(step, step[0], rtol=1e-6):
        raise InputError("wavelength_nm", expected="in equal steps, such as 400, 410, ...")
    return grid, float(step.mean())


@contextmanager
def _mitsuba(variant: str) -> Iterator[Any]:
    """Mitsuba in a variant that renders spectra; the previous variant is restored afterwards."""
    try:
        import mitsuba
    except ImportError:
        hint = "Run pip install '.[render]' in the clone"
        raise InputError("the extra 'render' is not installed", hint=hint) from None
    if variant not in mitsuba.variants():
        known = ", ".join(mitsuba.variants())
        raise InputError("variant", value=variant, expected=f"a variant of the installed Mitsuba ({known})")
    before = mitsuba.variant()
    try:
        mitsuba.set_variant(variant)
    except (ImportError, RuntimeError) as error:
        raise InputError(f"the variant '{variant}' of Mitsuba does not start: {_line(error)}") from None
    level = mitsuba.log_level()
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    try:
        yield mitsuba
    finally:
        mitsuba.set_log_level(level)
        if before is not None:
            mitsuba.set_variant(before)


class _Source:
    """The description of a scene, rendered a few bands at a time."""

    def __init__(self, scene: SceneSource, how: RenderOptions) -> None:
        self._scene = dict(scene) if isinstance(scene, Mapping) else fspath(scene)
        self._parameters = {name: str(value) for name, value in (how.parameters or {}).items()}
        self._how = how
        self.name = "rendering" if isinstance(self._scene, dict) else self._scene
        self.plugins: set[str] = set()
        self.view: tuple[float | None, float | None] = None, None
        if isinstance(self._scene, dict):
            if self._parameters:
                raise InputError("parameters apply to scene files", hint="Write the values into the dictionary")
            if self._scene.get("type") != "scene":
                raise InputError("scene", expected="a dictionary with the entry 'type': 'scene'")
        elif not os.path.isfile(self._scene):
            raise FileError(self._scene, "cannot be read: there is no such file")

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Raise Mitsuba's errors about the scene as one line."""
        try:
            yield
        except RuntimeError as error:
            if isinstance(self._scene, dict):
                raise InputError(f"Mitsuba rejects the scene: {_line(error)}") from None
            raise FileError(self._scene, f"Mitsuba rejects the scene: {_line(error)}") from None

    def rendered(self, mitsuba: Any, centers_nm: NDArray[np.float64], width_nm: float) -> NDArray[np.float32]:
        """(rows, cols, bands) mean radiance over each band."""
        names = [f"band{k}" for k in range(_LANES)]
        loaded = self._loaded(mitsuba, names, float(centers_nm[0]), width_nm)
        if not loaded.sensors():
            raise InputError("the scene has no camera", where=self.name, hint="Add a sensor")
        if not loaded.emitters():
            raise InputError("the scene has no light", where=self.name, hint="Add an emitter")
        camera = loaded.sensors()[0]
        self.view = _view(mitsuba, loaded, camera)
        # As emission, RGB values and single numbers become multiples of D65.
        if any("D65Spectrum" in str(emitter) for emitter in loaded.emitters()):
            self.plugins.add("d65")
        mitsuba.render(loaded, sensor=camera, spp=self._how.spp, seed=self._how.seed)
        bitmap = camera.film().bitmap()
        channels = [field.name for field in bitmap.struct_()]
        values = np.array(bitmap, dtype=np.float32)[:, :, [channels.index(name) for name in names[: centers_nm.size]]]
        if not np.isfinite(values).all():
            raise FileError(self.name, "renders to NaN or infinity", hint="Check for degenerate shapes or materials")
        return values / np.float32(width_nm)

    def _loaded(self, mitsuba: Any, names: list[str], first_nm: float, width_nm: float) -> Any:
        """The scene with one camera, whose film has a response per band."""
        parser = mitsuba.parser
        config = parser.ParserConfig(mitsuba.variant())
        if isinstance(self._scene, dict):
            state = parser.parse_dict(config, self._scene)
        else:
            resolver = mitsuba.file_resolver()
            resolver.prepend(str(Path(self._scene).resolve().parent))
            state = parser.parse_file(config, self._scene, **self._parameters)
        parser.transform_all(config, state)
        self.plugins = {node.props.plugin_name() for node in state.nodes}
        sensors = _nodes(mitsuba, state, "Sensor")
        if not 0 <= self._how.sensor < max(len(sensors), 1):
            expected = f"from 0 to {len(sensors) - 1}, one of the scene's cameras"
            raise InputError("sensor", where=self.name, value=self._how.sensor, expected=expected)
        for film in _nodes(mitsuba, state, "Film"):
            self._check_film(mitsuba, film.props)
            _as_spectral(mitsuba, film.props, names, first_nm, width_nm, (self._how.rows, self._how.cols))
        loaded = parser.instantiate(config, state)
        return loaded[0] if isinstance(loaded, list) else loaded

    def _check_film(self, mitsuba: Any, film: Any) -> None:
        """Refuse misspelled properties: the film is replaced before Mitsuba can check them."""
        kinds = mitsuba.Properties.Type
        for name in set(film.keys()) - _FILM_KNOWS:
            if film.type(name) not in (kinds.Object, kinds.Reference, kinds.ResolvedReference):
                hint = did_you_mean(name, sorted(_FILM_KNOWS))
                raise InputError(f"the film has no property '{name}'", where=self.name, hint=hint)


def _nodes(mitsuba: Any, state: Any, kind: str) -> list[Any]:
    return [node for node in state.nodes if node.type == getattr(mitsuba.ObjectType, kind)]


def _as_spectral(mitsuba: Any, film: Any, names: list[str], first_nm: float, width_nm: float, shape: Shape) -> None:
    """Turn a film into one that integrates radiance over bands, pixel by pixel."""
    for name in list(film.keys()):
        if name not in _FILM_KEEPS or (name.startswith("crop") and shape != (None, None)):
            del film[name]
    film.set_plugin_name("specfilm")
    for name, size in zip(("height", "width"), shape, strict=True):
        if size is not None:
            film[name] = size
    film["component_format"] = "float32"
    film["filter"] = mitsuba.load_dict({"type": "box"})
    for k, name in enumerate(names):
        film[name] = mitsuba.load_dict(_response(k, first_nm - width_nm / 2, width_nm))


def _response(k: int, begin_nm: float, width_nm: float) -> dict[str, str]:
    """1 in the k-th of four bands, 0 in the others; their sum is 1 everywhere, and each has a band's area."""
    low, high, half = begin_nm + k * width_nm, begin_nm + (k + 1) * width_nm, width_nm * _EDGE / 2
    rise = [(low, 1)] if k == 0 else [(low - half, 0), (low + half, 1)]
    fall = [(high, 1)] if k == _LANES - 1 else [(high - half, 1), (high + half, 0)]
    nodes = rise + fall
    return {
        "type": "irregular",
        "wavelengths": ", ".join(f"{wavelength:.9g}" for wavelength, _ in nodes),
        "values": ", ".join(str(value) for _, value in nodes),
    }


def _view(mitsuba: Any, scene: Any, camera: Any) -> tuple[float | None, float | None]:
    """Distance along the axis, and the width of the field at a distance of 1, in scene units; None where unknown."""
    found = mitsuba.traverse(camera)
    span = None
    if "x_fov" in found:
        part = _number(found["film.crop_size"]) / _number(found["film.size"])  # the field of view is of all columns
        span = 2 * math.tan(math.radians(_number(found["x_fov"])) / 2) * part
    if "focus_distance" in found:
        return _number(found["focus_distance"]), span
    ray, _ = camera.sample_ray(0.0, 0.5, mitsuba.ScalarPoint2f(0.5, 0.5), mitsuba.ScalarPoint2f(0.5, 0.5))
    hit = scene.ray_intersect(ray)
    if not np.isfinite(_number(hit.t)):
        return None, span
    # The ray starts at the near clipping plane, and the center of a cropped film is off the axis.
    to_world = np.array(camera.world_transform().matrix, dtype=np.float64).reshape(4, 4)
    depth = (np.array(hit.p, dtype=np.float64).ravel() - to_world[:3, 3]) @ to_world[:3, 2]
    return float(depth), span


def _number(value: Any) -> float:
    """The first number of a scalar, a point, or an array of one, in any variant."""
    return float(np.asarray(value).ravel()[0])


def _line(error: BaseException) -> str:
    """The end of a message of several lines, where Mitsuba gives the cause, as one line."""
    lines = [line.strip(" -─╰╭│") for line in str(error).splitlines() if line.strip()]
    return " ".join(" ".join(lines).split())[-220:]
