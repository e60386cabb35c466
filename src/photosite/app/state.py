"""What the page shows, as one typed value: scene, lens, sensor and capture settings, and the camera that they make."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, Field
from pydantic.config import JsonDict, JsonValue
from pydantic_core import PydanticCustomError

from photosite.app.lens_state import LensState, lens
from photosite.app.places import UPLOAD, Part, Places, Text
from photosite.camera.camera import Camera
from photosite.camera.file import DEFAULT_EXPOSURE_S, DEFAULT_SENSOR, SetUp
from photosite.color.illuminants import illuminant as relative_energy
from photosite.errors import InputError
from photosite.scene.charts.chart import DEFAULT_LUMINANCE_CD_M2
from photosite.scene.dynamic_scene import DynamicScene
from photosite.scene.flicker import Flicker, PulseFlicker, SineFlicker, TableFlicker
from photosite.scene.motion import Motion
from photosite.scene.scene import Scene
from photosite.scene.scene_request import BUILT_IN_SCENES, DEFAULT_ILLUMINANT, DEFAULT_SCENE, SceneRequest
from photosite.sensor.binning import Binning
from photosite.sensor.gain_table import changed_at_setting
from photosite.sensor.io.sensor_file import load_sensor, preset_names
from photosite.sensor.model import Sensor

TOO_DEEP = "too_deep"
"""Type of the validation error of values that are nested too deep."""
MOST_PIXELS = 64_000_000
"""Pixels, and cells of the image, that the workbench computes a frame of."""

Numbers = Annotated[tuple[float, ...], Field(max_length=10_000)]
Value = bool | int | float | Text | Numbers | None


LIGHT = "CIE illuminant, blackbody such as 3200K, led 4000, or file:NAME or upload:ID of a CSV file."


def _only_of(*kinds: JsonValue) -> JsonDict:
    """Return what the schema states of a field that applies to some kinds."""
    return {"only": {"kind": list(kinds)}}


class FlickerState(Part):
    """Flicker of the light; fields of another kind are ignored."""

    kind: Literal["sine", "pulse", "table"] = Field(
        "sine", description="sine as of lamps on the mains, pulse as of LEDs, or a table over one period."
    )
    frequency_hz: float = Field(100.0, gt=0, le=1e9, description="Periods per second; twice that of the mains.")
    depth: float = Field(
        0.3, ge=0, le=1, description="Highest less lowest light over their sum.", json_schema_extra=_only_of("sine")
    )
    duty: float = Field(
        0.3, gt=0, le=1, description="Share of the period with light.", json_schema_extra=_only_of("pulse")
    )
    phase_deg: float = Field(
        0.0,
        description="Phase at time 0, at which the first row's exposure begins; a sine is brightest at 0.",
        json_schema_extra=_only_of("sine", "pulse"),
    )
    table: Annotated[tuple[float, ...], Field(min_length=1, max_length=10_000)] = Field(
        (0.5, 1.5), description="Relative light at even times over a period.", json_schema_extra=_only_of("table")
    )

    def flicker(self) -> Flicker:
        """Return the flicker."""
        if self.kind == "table":
            return TableFlicker(self.frequency_hz, self.table)
        if self.kind == "pulse":
            return PulseFlicker(self.frequency_hz, self.duty, self.phase_deg)
        return SineFlicker(self.frequency_hz, self.depth, self.phase_deg)


class MotionState(Part):
    """Motion of the image, as for `photosite.scenes.Motion`."""

    rows_per_s: float = Field(0.0, description="Velocity downwards.", json_schema_extra={"unit": "pixels/s"})
    cols_per_s: float = Field(0.0, description="Velocity to the right.", json_schema_extra={"unit": "pixels/s"})
    rotation_deg_per_s: float = Field(0.0, description="Rotation about the center of the frame, clockwise.")
    scale_per_s: float = Field(0.0, description="Relative growth: 0.1 for an image that is 10 % larger after 1 s.")

    def motion(self) -> Motion:
        """Return the motion."""
        return Motion(self.rows_per_s, self.cols_per_s, self.rotation_deg_per_s, self.scale_per_s)


class SceneState(Part):
    """The scene and its light."""

    source: Text = Field(
        DEFAULT_SCENE, description="A built-in scene, or file:NAME of the served folder, or upload:ID."
    )
    illuminant: Text | None = Field(
        DEFAULT_ILLUMINANT,
        description=f"{LIGHT} None: the file's own.",
    )
    mean_luminance_cd_m2: float | None = Field(
        DEFAULT_LUMINANCE_CD_M2, gt=0, le=1e9, description="Mean luminance. None: the file's own."
    )
    distance_m: float | None = Field(None, gt=0, description="Distance from lens to scene. None: 1.2 m.")
    width_m: float | None = Field(None, gt=0, description="Width of the scene. None: it fills the frame.")
    flicker: FlickerState | None = Field(
        None, description="Flicker of the light, which the rows of a rolling shutter see one after the other."
    )
    motion: MotionState | None = Field(None, description="Motion of the scene, or of the camera.")
    options: dict[Text, Value] = Field({}, max_length=20, description="The scene's own options, such as contrast.")

    @property
    def dynamic(self) -> bool:
        """Whether the scene changes during an exposure."""
        return self.flicker is not None or self.motion is not None


class BinningState(Part):
    """Blocks of pixels that are read as one, as for `Sensor.binned`."""

    factor: int = Field(2, ge=2, le=16, description="Rows and columns of a block, of one color.")
    kind: Binning = Field("charge", description="Electrons are added, or digital numbers added or averaged.")


_MOST_DEPTH = 32


def _not_deep(changes: dict[str, Any]) -> dict[str, Any]:
    """Refuse values in more levels than any field of a sensor has: code that calls itself fails on them."""
    level: list[Any] = [changes]
    for _ in range(_MOST_DEPTH):
        inner = [one.values() if isinstance(one, dict) else one for one in level if isinstance(one, (dict, list))]
        level = [value for values in inner for value in values]
    if any(isinstance(one, (dict, list)) for one in level):
        raise PydanticCustomError(TOO_DEEP, "must be nested at most {most} deep", {"most": _MOST_DEPTH})
    return changes


class SensorState(Part):
    """A preset or sensor file, its gain setting, changed fields, and binning."""

    source: Text = Field(DEFAULT_SENSOR, description="A preset, or file:NAME of the served folder, or upload:ID.")
    gain_setting: float | None = Field(None, description="One of the sensor's gain settings. None: its own.")
    changes: Annotated[dict[Text, Any], AfterValidator(_not_deep)] = Field(
        {}, max_length=80, description="Fields as for `Sensor.with_`, such as read_noise_e or telegraph_noise."
    )
    binning: BinningState | None = Field(None, description="Blocks of pixels of one color that are read as one.")

    @property
    def changed(self) -> bool:
        """Whether the sensor differs from that of its file at a gain setting."""
        return bool(self.changes) or self.binning is not None


class CaptureState(Part):
    """Exposure time, seed and temperature."""

    exposure_s: float = Field(DEFAULT_EXPOSURE_S, gt=0, le=1e5, description="Exposure time in s.")
    seed: int = Field(0, ge=0, lt=1 << 53, description="Key of the temporal noise.")
    temperature_c: float | None = Field(
        None, ge=-273.15, le=500, description="Sensor temperature. None: that of the sensor file."
    )
    cells_per_pixel: Literal[1, 3, 5] = Field(1, description="Cells per pixel on which the image is computed.")
    noise: bool = Field(True, description="False: the noise-free frame, `Camera.clean_dn`.")


class CameraState(Part):
    """The whole state of the camera view."""

    scene: SceneState = SceneState()
    lens: LensState = LensState()
    sensor: SensorState = SensorState()
    capture: CaptureState = CaptureState()
    brightness: float = Field(
        1.0, gt=0, le=1e6, description="Factor of the developed picture, as `develop(exposure=)`."
    )

    @property
    def mean_key(self) -> str:
        """Digest of all that the mean image depends on, or may depend on: that in 1 s, or of a changing scene."""
        taken: dict[str, Any] = {"cells_per_pixel": self.capture.cells_per_pixel}
        if self.scene.dynamic:
            taken["exposure_s"] = self.capture.exposure_s
        part = self.model_copy(update={"brightness": 1.0, "capture": CaptureState(**taken)})
        kept = {name: value for name, value in self.sensor.changes.items() if name not in _ONLY_READOUT}
        part = part.model_copy(update={"sensor": self.sensor.model_copy(update={"changes": kept})})
        return _digest(part)

    @property
    def frame_key(self) -> str:
        """Digest of all that the digital numbers depend on."""
        return _digest(self.model_copy(update={"brightness": 1.0}))


_ONLY_READOUT = frozenset(
    name + unit for name in ("read_noise", "row_noise", "column_noise", "dsnu") for unit in ("_e", "_mv", "_dn")
) | {
    *("prnu_percent", "dark_current_e_per_s", "dark_voltage_mv_per_s", "dark_current_dn_per_s", "dcnu_percent"),
    *("dark_current_temperature_c", "dark_doubling_c", "black_level_dn", "analog_gain", "bits", "serial"),
    *("conversion_gain_uv_per_e", "voltage_swing_v", "well_capacity_e", "full_well_e", "system_gain_dn_per_e"),
    *("system_gain_e_per_dn",),
}
"""Fields of a sensor that the mean electrons do not depend on."""


def _digest(part: BaseModel) -> str:
    return hashlib.sha256(part.model_dump_json().encode()).hexdigest()[:32]


@dataclass(frozen=True, eq=False)
class PreparedState:
    """The camera and the scene request of a state."""

    state: CameraState
    camera: Camera
    request: SceneRequest

    def scene(self) -> Scene:
        """Make the scene."""
        return self.request.scene()

    def seen(self, scene: Scene) -> Scene | DynamicScene:
        """Return a scene with the flicker and motion of the state."""
        flicker, motion = self.state.scene.flicker, self.state.scene.motion
        if not self.state.scene.dynamic:
            return scene
        return DynamicScene(
            scene, None if flicker is None else flicker.flicker(), None if motion is None else motion.motion()
        )

    def mean_image(self, scene: Scene, progress: Any = None) -> NDArray[np.float32]:
        """Return the mean electrons in 1 s; in the exposure time for a scene that changes."""
        exposure_s = self.state.capture.exposure_s if self.state.scene.dynamic else 1.0
        return self.camera.mean_electrons(self.seen(scene), exposure_s, progress=progress)

    def exposed(self, mean_image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean electrons in the exposure time, from those of `mean_image`."""
        return mean_image if self.state.scene.dynamic else mean_image * np.float32(self.state.capture.exposure_s)

    def frame(self, mean_electrons: NDArray[np.float32], scene: Scene, region: Any = None) -> Any:
        """Return the raw frame of mean electrons, as `Camera.capture` of the state does."""
        taken = self.state.capture
        return self.camera.expose(
            mean_electrons,
            taken.exposure_s,
            seed=taken.seed,
            region=region,
            temperature_c=taken.temperature_c,
            scene=scene,
        )


def prepared(state: CameraState, places: Places) -> PreparedState:
    """Return camera and scene of a state.

    Raises
    ------
    PhotositeError
        If a value is invalid, a file cannot be read, or the frame has too many pixels.
    """
    sensor = changed_sensor(state.sensor, places)
    cells = state.capture.cells_per_pixel
    if (count := sensor.array.rows * sensor.array.cols * cells**2) > MOST_PIXELS:
        hint = "Use fewer rows, columns or cells per pixel, or the command photosite simulate"
        raise InputError("pixels times cells", value=count, expected=f"at most {MOST_PIXELS}", hint=hint)
    request = scene_request(state.scene, places)
    optics = lens(state.lens, places)
    seen = SetUp(sensor=sensor, optics=optics, scene=request, cells_per_pixel=cells)
    drawn = seen.seen
    assert isinstance(drawn, SceneRequest)
    return PreparedState(state, seen.camera, drawn)


def changed_sensor(state: SensorState, places: Places) -> Sensor:
    """Return the sensor of a state: `changed_at_setting`, then binned."""
    path = places.path(state.source)
    if path is None and state.source not in preset_names():
        raise InputError("sensor", value=state.source, expected=f"one of {', '.join(preset_names())}, or a file")
    return _changed_sensor(state.model_dump_json(), path, 0 if path is None else path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _changed_sensor(text: str, path: Path | None, changed_ns: int) -> Sensor:
    """Return the sensor of a state in JSON, made again when its file changes."""
    state = SensorState.model_validate_json(text)
    sensor = _loaded(state.source, None, 0) if path is None else _loaded("", path, changed_ns)
    if path is not None and state.source.startswith(UPLOAD) and sensor.maps is not None:
        raise InputError("an uploaded sensor file cannot name maps", hint="Put both files into the served folder")
    if {"maps", "covariance"} & state.changes.keys():
        raise InputError("changes", value=sorted(state.changes), expected="without maps and covariance")
    sensor = changed_at_setting(sensor, state.gain_setting, state.changes)
    return sensor if state.binning is None else sensor.binned(state.binning.factor, state.binning.kind)


@lru_cache(maxsize=16)
def _loaded(name: str, path: Path | None, changed_ns: int) -> Sensor:
    """Return a sensor, read again when its file changes."""
    return load_sensor(name if path is None else path)


def light_name(name: str, places: Places) -> str:
    """Return what the library takes for the name of a light: a known illuminant, or the path of a CSV file.

    Raises
    ------
    InputError
        If there is no such illuminant, or the name is a path, which could be that of any file.
    """
    path = places.path(name)
    if (path is None and name.strip().lower().endswith(".csv")) or (path is not None and path.suffix.lower() != ".csv"):
        raise InputError("illuminant", value=name, expected="a known name, or file:NAME or upload:ID of a CSV file")
    if path is None:
        relative_energy(name, [560.0])
    return name if path is None else str(path)


def scene_request(state: SceneState, places: Places) -> SceneRequest:
    """Return the request of a state's scene, without values that leave the choice to the file."""
    path = places.path(state.source)
    if path is None and state.source not in BUILT_IN_SCENES:
        raise InputError("scene", value=state.source, expected=f"one of {', '.join(BUILT_IN_SCENES)}, or a file")
    names = ("illuminant", "mean_luminance_cd_m2", "distance_m", "width_m")
    if twice := [name for name in names if name in state.options]:
        raise InputError("options", value=twice[0], expected=f"without {', '.join(names)}, fields of the scene itself")
    options = {name: value for name in names if (value := getattr(state, name)) is not None}
    if (light := options.get("illuminant")) is not None:
        options["illuminant"] = light_name(light, places)
    return SceneRequest(state.source if path is None else str(path), options | state.options)
