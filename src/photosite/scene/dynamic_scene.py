"""Scenes that change with time: the flicker of their light, and their motion."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.errors import InputError
from photosite.scene.flicker import Flicker
from photosite.scene.motion import Motion
from photosite.scene.planes import Planes
from photosite.scene.scene import Scene
from photosite.values.shown import Shown


@dataclass(frozen=True, eq=False)
class DynamicScene(Shown):
    """A scene that changes with time: its light, its place in the image, or both.

    Parameters
    ----------
    scene
        The scene, or planes in depth, in the mean light.
    flicker
        Flicker of all its light.
    motion
        Motion of the image of a flat scene. Beyond its borders a scene repeats its border samples.

    Raises
    ------
    InputError
        If a part has another type, or planes in depth have a motion.

    Examples
    --------
    >>> import photosite as ps
    >>> lamp = ps.scenes.SineFlicker(100.0, depth=0.3)
    >>> wall = DynamicScene(ps.charts.uniform("FL11", 100), flicker=lamp)
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=250, cols=4, line_time_us=40)
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=4, focal_length_mm=50), sensor)
    >>> mean = camera.mean_electrons(wall, 1 / 1000)[::2, 0]   # the readout takes 10 ms: one band
    >>> round(float((mean.max() - mean.min()) / (mean.max() + mean.min())), 3)   # 0.3 sinc(0.1)
    0.295
    """

    scene: Scene | Planes
    flicker: Flicker | None = None
    motion: Motion | None = None

    def __post_init__(self) -> None:
        for name, kinds, expected in (
            ("scene", Scene | Planes, "a Scene or Planes"),
            ("flicker", Flicker | None, "a flicker, such as SineFlicker(100, depth=0.2)"),
            ("motion", Motion | None, "a motion, such as Motion(cols_per_s=100)"),
        ):
            if not isinstance(getattr(self, name), kinds):
                raise InputError(name, value=getattr(self, name), expected=expected)
        if self.motion is not None and isinstance(self.scene, Planes):
            hint = "Record a function of time that returns the planes at each time"
            raise InputError("motion applies to a flat scene, not to planes in depth", hint=hint)
