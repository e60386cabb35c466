"""Cases about sensors with effects, with several captures, and about clips, at the size of a Nikon D200.

The baselines are photosite's own: the noise of a frame, or a capture, of the sensor without effects at rest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

from photosite.camera.camera import Camera
from photosite.scene.dynamic_scene import DynamicScene
from photosite.scene.motion import Motion
from photosite.sensor.effects.model import Effects
from photosite.studies.bench.captures import EXPOSURE_S, MEGAPIXELS, camera, scene, work
from photosite.studies.bench.timing import Case, in_turn, peak_mb

Kind = Literal["em", "curve", "captures"]
"""Every effect with electron multiplication; with a response curve, which excludes it; three captures."""

_EVERY: dict[str, Any] = {
    **{name: field.examples[0] for name, field in Effects.model_fields.items() if field.examples},
    "row_noise_mv": 0.1,
    "column_noise_mv": 0.1,
    "dark_voltage_mv_per_s": 5.0,
    "dcnu_percent": 20,
}
_CAPTURES = {
    "parts": [
        {"name": "high"},
        {"name": "low", "charge": "shared", "charge_of": "high", "relative_gain": 0.25, "read_noise_e": 20},
        {"name": "small", "relative_sensitivity": 0.02, "read_noise_e": 5, "well_capacity_e": 8000},
    ],
    "combination": {"dn_per_e": 4, "bits": 24, "black_level_dn": 16},
}
SENSORS: dict[Kind, dict[str, Any]] = {
    "em": {**_EVERY, "em_gain": {"gain": 1.2, "stages": 500, "clock_induced_charge_e": 0.002}, "response_curve": None},
    "curve": {**_EVERY, "em_gain": None},
    "captures": {"well_capacity_e": 60000, "captures": _CAPTURES},
}
"""What differs from the sensor without effects."""
FPS = 30


@lru_cache(maxsize=3)
def _camera(kind: Kind) -> Camera:
    return Camera(camera().optics, camera().sensor.with_(**SENSORS[kind]))


def work_effects(kind: Kind) -> None:
    """Expose a frame."""
    _camera(kind).expose(camera().mean_electrons(scene(), EXPOSURE_S), EXPOSURE_S, seed=1)


def _case(kind: Kind, quick: bool) -> Case:
    mean, one = camera().mean_electrons(scene(), EXPOSURE_S), _camera(kind)
    for each in (one, camera()):
        each.expose(mean, EXPOSURE_S, seed=1)  # compiles the kernels, draws the chip
    ours, theirs = in_turn(
        lambda: one.expose(mean, EXPOSURE_S, seed=1),
        lambda: camera().expose(mean, EXPOSURE_S, seed=1),
        3 if quick else 9,
    )
    return Case(ours, theirs, peak_mb(work_effects, kind=kind), MEGAPIXELS)


def effects_em_d200(quick: bool = False) -> Case:
    """Noise of a frame with every effect but a response curve, against the base model's."""
    return _case("em", quick)


def effects_curve_d200(quick: bool = False) -> Case:
    """Noise of a frame with every effect but electron multiplication, against the base model's."""
    return _case("curve", quick)


def captures_d200(quick: bool = False) -> Case:
    """Three captures of two photodiodes and their combination, against one capture's noise."""
    return _case("captures", quick)


def work_clip(frames: int) -> None:
    """Record a clip of a ColorChecker that moves and turns in front of a rolling shutter."""
    one = camera()
    rolling = Camera(one.optics, one.sensor.with_(line_time_us=10))
    moving = DynamicScene(scene(), motion=Motion(cols_per_s=200, rotation_deg_per_s=5))
    for _ in rolling.record(moving, frames=frames, fps=FPS, exposure_s=1 / 60, seed=1):
        pass


def moving_d200(quick: bool = False) -> Case:
    """A frame of a clip of 30 (quick: 5) of a moving scene, against a capture of the scene at rest."""
    frames = 5 if quick else 30
    work_clip(1)
    work("capture")
    ours, theirs = in_turn(lambda: work_clip(frames), lambda: work("capture"), 1 if quick else 2)
    return Case(ours / frames, theirs, peak_mb(work_clip, frames=2), MEGAPIXELS)
