"""Mean electrons of exposures that begin at a time: rows of a rolling shutter, light that changes, and motion.

Row r is exposed from a_r = start + (start of row r after the frame's) to b_r = a_r + exposure. In light w(t) of mean 1,
a pixel that sees L(x) at time 0 collects the integral of w(t) L(place at rest of the pixel at t) from a_r to b_r. It
sees one place of a static scene, so that L times the integral of w is left.

A moving scene is imaged once, at rest, on the cells of a field that is larger than the frame, channel by channel. A
frame is then resampled from it, row by row (`engine.moving_rows`). What stays with the camera comes after: relative
illumination, veiling glare, angular response and crosstalk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.camera.mean_image import electron_rate, fine_images, finish_moving_mosaic, planes_electron_rate
from photosite.camera.optical_stack import warn_of_transmittance_range
from photosite.camera.parts import CameraParts
from photosite.camera.sampled_otf import Progress
from photosite.engine.moving_rows import Cells, in_phases, sampled_rows, translated_rows
from photosite.engine.threads import threads_for
from photosite.errors import InputError
from photosite.optics.point_spread import FieldPsf
from photosite.scene.dynamic_scene import DynamicScene
from photosite.scene.flicker import Flicker
from photosite.scene.motion import Motion
from photosite.scene.planes import Planes
from photosite.scene.scene import Scene

Array = NDArray[np.float64]
Mosaic = NDArray[np.float32]
Span = tuple[float, float]
"""Begin and end, in s."""

AnyScene = Scene | Planes | DynamicScene
"""What a camera takes frames of."""

NODES_PER_CELL = 0.6
"""Nodes of Gauss's rule, besides two, per cell of the longest path that is not a translation, in even light.

The integral along a straight path of a wave of up to 0.3 cycles per cell then errs by at most 1e-3 of its amplitude.
"""
LIGHT_STEP_CELLS = 0.25
"""Longest step in light that changes; the light of a step is exact, and counts as even or as that of its middle."""
_MOST_STEPS = 4096
_MOST_SAMPLES = 1 << 29
_REACH = 3
"""Pixels beyond the places that the pixels see: those of the interpolation, and one for rounding."""


def exposures(row_start_s: Array, start_s: float, exposure_s: float, part_s: Span | None) -> tuple[Array, Array]:
    """Return (rows,) begin and end of the exposures of a frame, or of what lies between two times."""
    begin_s = start_s + row_start_s
    end_s = begin_s + exposure_s
    return (begin_s, end_s) if part_s is None else (np.clip(begin_s, *part_s), np.clip(end_s, *part_s))


@dataclass(frozen=True, eq=False)
class StaticImage:
    """The image of a scene that does not move."""

    rate: Mosaic  # (rows, cols) electrons per second, in the mean light
    row_start_s: Array  # (rows,) start of each row's exposure after the frame's
    flicker: Flicker | None = None

    def electrons(
        self, start_s: float, exposure_s: float, *, part_s: Span | None = None, out: Mosaic | None = None
    ) -> Mosaic:
        """Return (rows, cols) mean electrons, in `out` if given; raise `InputError` if they exceed 32-bit floats.

        `part_s` are two times, between which alone there is light.
        """
        with np.errstate(over="raise"):
            try:
                if self.flicker is None and part_s is None:
                    return np.multiply(self.rate, np.float32(exposure_s), out=out)
                begin_s, end_s = exposures(self.row_start_s, start_s, exposure_s, part_s)
                of_rows = end_s - begin_s if self.flicker is None else self.flicker.integral_s(begin_s, end_s)
                return np.multiply(self.rate, of_rows.astype(np.float32)[:, None], out=out)
            except FloatingPointError:
                expected = "short enough for its electrons to be 32-bit floats"
                raise InputError("exposure_s", value=exposure_s, expected=expected) from None


@dataclass(frozen=True, eq=False)
class MovingImage:
    """The image of a flat scene in affine motion."""

    camera: CameraParts
    scene: Scene
    motion: Motion
    flicker: Flicker | None
    cells: Cells  # the scene at rest

    def electrons(
        self, start_s: float, exposure_s: float, *, part_s: Span | None = None, out: Mosaic | None = None
    ) -> Mosaic:
        """Return (rows, cols) mean electrons as `StaticImage.electrons`."""
        sensor = self.camera.sensor
        rows, cols = sensor.array.rows, sensor.array.cols
        begin_s, end_s = (each[:, None] for each in exposures(sensor.row_start_s, start_s, exposure_s, part_s))
        length_s = end_s - begin_s
        mosaic = np.empty((rows, cols), np.float32) if out is None else out
        n, path = self.cells.per_pixel, self._longest_path(begin_s, end_s)
        if self.flicker is not None:
            steps = min(max(math.ceil(path / LIGHT_STEP_CELLS), 1), _MOST_STEPS)
            edges_s = begin_s + length_s * np.linspace(0.0, 1.0, steps + 1)
            middle_s = 0.5 * (edges_s[:, :-1] + edges_s[:, 1:])
            light_s = self.flicker.integral_s(edges_s[:, :-1], edges_s[:, 1:])
        elif self.motion.is_translation:
            edges_s, light_s = np.hstack([begin_s, end_s]), length_s
        else:
            nodes, weights = np.polynomial.legendre.leggauss(min(2 + math.ceil(NODES_PER_CELL * path), _MOST_STEPS))
            middle_s = begin_s + length_s * (0.5 + 0.5 * nodes)
            light_s = 0.5 * length_s * weights
        with threads_for(rows * cols):
            if self.motion.is_translation:
                y, x = self.motion.at_rest(0.0, 0.0, edges_s)
                translated_rows(self.cells, n * y, n * x, light_s, mosaic)
            else:
                sampled_rows(self.cells, self._places(middle_s), light_s, mosaic)
        return finish_moving_mosaic(mosaic, self.camera, self.scene)

    def _longest_path(self, begin_s: Array, end_s: Array) -> float:
        """Return the longest path of a pixel in an exposure, in cells: that of a corner, at its start or its end."""
        array = self.camera.sensor.array
        longest_s = float((end_s - begin_s).max())
        moments = np.array([[begin_s.min()], [end_s.max() - longest_s]]) + np.array([0.0, 0.5, 1.0]) * longest_s
        corners = [(0.5 * s * array.rows, 0.5 * t * array.cols) for s in (-1, 1) for t in (-1, 1)]
        paths = np.array([self.motion.at_rest(r, c, moments) for r, c in corners])
        steps = np.hypot(*np.moveaxis(np.diff(paths, axis=-1), 1, 0))
        return self.cells.per_pixel * float(steps.sum(axis=-1).max())

    def _places(self, time_s: Array) -> Array:
        """Return (rows, steps, 4): the cell that the first pixel of each row sees, and the way to that of the next."""
        array, n = self.camera.sensor.array, self.cells.per_pixel
        middle_row, middle_col = 0.5 * array.rows, 0.5 * array.cols
        row: Array = (np.arange(array.rows, dtype=np.float64) + (0.5 - middle_row))[:, None]
        first = self.motion.at_rest(row, 0.5 - middle_col, time_s)
        second = self.motion.at_rest(row, 1.5 - middle_col, time_s)
        origin = (self.cells.first_row + n * (middle_row - 0.5), self.cells.first_col + n * (middle_col - 0.5))
        start = [o + n * at for o, at in zip(origin, first, strict=True)]
        along = [n * (after - at) for at, after in zip(first, second, strict=True)]
        return np.stack([*start, *along], axis=-1)


@dataclass(frozen=True, eq=False)
class StackedImage:
    """The images of the layers of stacked channels, whose readings lie side by side in a row."""

    layers: tuple[StaticImage | MovingImage, ...]

    def electrons(
        self, start_s: float, exposure_s: float, *, part_s: Span | None = None, out: Mosaic | None = None
    ) -> Mosaic:
        """Return (rows, cols) mean electrons as `StaticImage.electrons`."""
        planes = [layer.electrons(start_s, exposure_s, part_s=part_s) for layer in self.layers]
        rows, cols = planes[0].shape
        shape = rows, cols * len(planes)
        return np.stack(planes, axis=2, out=None if out is None else out.reshape(rows, cols, -1)).reshape(shape)


AnyImage = StaticImage | MovingImage | StackedImage


def exposure_image(
    scene: AnyScene, camera: CameraParts, start_s: float, longest_s: float, progress: Progress | None = None
) -> AnyImage:
    """Return the image of a scene for a frame that starts at a time, or for all frames until `longest_s` later."""
    end_s = start_s + float(camera.sensor.row_start_s.max()) + longest_s
    return image_over_time(scene, camera, (start_s, end_s), progress)


def image_over_time(scene: AnyScene, camera: CameraParts, times_s: Span, progress: Progress | None = None) -> AnyImage:
    """Return the image of a scene from which all exposures between two times follow."""
    if camera.sensor.array.stacked:
        sensors = [camera.sensor.layer(name) for name in camera.sensor.channel_names]
        return StackedImage(
            tuple(_image_of_mosaic(scene, replace(camera, sensor=sensor), times_s, progress) for sensor in sensors)
        )
    return _image_of_mosaic(scene, camera, times_s, progress)


def _image_of_mosaic(
    scene: AnyScene, camera: CameraParts, times_s: Span, progress: Progress | None
) -> StaticImage | MovingImage:
    warn_of_transmittance_range(camera.optics, camera.sensor)
    still = scene if not isinstance(scene, DynamicScene) else scene.scene
    flicker = scene.flicker if isinstance(scene, DynamicScene) else None
    motion = scene.motion if isinstance(scene, DynamicScene) else None
    if motion is None or isinstance(still, Planes) or still.shape == (1, 1):
        if isinstance(still, Planes):
            rate = planes_electron_rate(still, camera, progress)
        else:
            rate = electron_rate(still, camera, progress)
        return StaticImage(rate, camera.sensor.row_start_s, flicker)
    _check_lens(still, camera)
    margin = _margin(camera, motion, times_s)
    images = fine_images(still, camera, margin, progress)
    n, (tile, names) = camera.cells_per_pixel, (camera.sensor.array.cfa, camera.sensor.channel_names)
    channels = np.array([[names.index(name) for name in row] for row in tile])
    phases = n * len(tile[0]) if motion.is_translation else 1
    cells = Cells(in_phases(images, phases), n, n * margin[0] + n // 2, n * margin[1] + n // 2, channels)
    return MovingImage(camera, still, motion, flicker, cells)


def _check_lens(scene: Scene, camera: CameraParts) -> None:
    """Reject lenses whose image of a scene in motion is not the image at rest in motion."""
    distance_m = scene.distance_m
    varies = isinstance(camera.optics.point_spread(distance_m), FieldPsf)
    if varies or camera.optics.mapping(distance_m) is not None:
        what = (
            "blur varies over the field" if varies else "distortion or lateral color changes the image with its place"
        )
        hint = "Record a function of time that returns the scene at each time"
        raise InputError(f"motion does not apply to a lens whose {what}", hint=hint)


def _margin(camera: CameraParts, motion: Motion, times_s: Span) -> tuple[int, int]:
    """Return the pixels (rows, cols) beyond the frame's borders that its pixels see between two times."""
    array, n = camera.sensor.array, camera.cells_per_pixel
    turn_deg = abs(motion.rotation_deg_per_s) * (times_s[1] - times_s[0])
    times = np.linspace(*times_s, 3 + min(math.ceil(turn_deg), 4096))
    half = 0.5 * array.rows, 0.5 * array.cols
    corners = [motion.at_rest(s * half[0], t * half[1], times) for s in (-1, 1) for t in (-1, 1)]
    farthest = np.abs(np.array(corners)).max(axis=(0, 2))
    rows, cols = (_REACH + math.ceil(far - own) for far, own in zip(farthest, half, strict=True))
    margin = max(rows, _REACH), max(cols, _REACH)
    samples = len(camera.sensor.channel_names) * n**2 * (array.rows + 2 * margin[0]) * (array.cols + 2 * margin[1])
    if samples > _MOST_SAMPLES:
        expected = f"such that the frames see at most {_MOST_SAMPLES:,} cells of the scene"
        raise InputError("motion", value=f"{samples:,} cells", expected=expected, hint="Record fewer frames")
    return margin
