"""What a view shows of a frame: the pixels in view, first those of a preview, then those of the exact frame.

A view shows single pixels of the frame, or a mosaic `step` times smaller whose values are means over `step` x `step`
pixels of their color. Pixels of the exact frame are read from a file where the frame was computed before. Otherwise
they are those of a preview: that of single pixels has the frame's own noise, that of means the mean and the standard
deviation that the frame's model gives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.app.exact_frame import kept_frame, kept_mean, with_numbers
from photosite.app.kept_scenes import unit_scene
from photosite.app.places import Part
from photosite.app.preview_light import preview_rate, relative_light
from photosite.app.preview_noise import averaged_numbers
from photosite.app.preview_sensor import of_size, with_sensor_size
from photosite.app.state import PreparedState
from photosite.engine.jit import read_only
from photosite.engine.mosaic_means import mosaic_means
from photosite.frames.raw_frame import RawFrame
from photosite.scene.scene import Scene

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

MOST_SHOWN = 1_200_000
"""Pixels of a view."""


Rectangle = tuple[int, int, int, int]
Index = Annotated[int, Field(ge=0, le=1 << 20)]


class View(Part):
    """The part of the frame in view, in pixels of the sensor, and the size of the canvas."""

    row: Index = 0
    col: Index = 0
    rows: Annotated[int, Field(ge=1, le=1 << 20)] = 1 << 20
    cols: Annotated[int, Field(ge=1, le=1 << 20)] = 1 << 20
    height: Annotated[int, Field(ge=16, le=4096)] = 600
    width: Annotated[int, Field(ge=16, le=4096)] = 900
    regions: Annotated[tuple[tuple[Index, Index, Index, Index], ...], Field(max_length=8)] = ()
    developed: bool = True
    mean: bool = True
    dn: bool = True


@dataclass(frozen=True, eq=False)
class ViewPixels:
    """What a view shows.

    Parameters
    ----------
    rows, cols, step
        First row and column of the frame in each pixel of the view, and their distance.
    taken, raw
        A frame with the metadata, and the pixels of the view as a frame, with 16 bits where they are means.
    dn, mean_e
        (rows, cols) digital numbers and mean electrons from light, of single pixels or means.
    pixels
        (p, q) digital numbers of single pixels in view, whole tiles; `dn` where it has single pixels.
    exact, notes
        Whether they are those of the exact frame; what a preview leaves out.
    """

    rows: I64
    cols: I64
    step: int
    taken: RawFrame
    raw: RawFrame
    dn: NDArray[Any]
    mean_e: F32
    pixels: NDArray[Any]
    exact: bool
    notes: tuple[str, ...]


def _pixels(first: int, count: int, step: int, tile: int, size: int) -> I64:
    """Return the first pixel of the frame in each pixel of a view along an axis, at least a tile of them where it fits.

    The center of each is inside the frame, so that a view cannot start further than a tile of its pixels from the end.
    """
    last = size - 1 - step // 2 - (tile - 1) * step
    first = max(min(first, last), 0) // tile * tile
    count = max(min(count, size - first), 1)
    index = first + step * np.arange(-(-count // (step * tile)) * tile)
    return index[index + step // 2 < size]


def view_pixels(found: PreparedState, view: View, folder: Path) -> ViewPixels:
    """Return the pixels in view: those of the exact frame where it is kept in the folder, else those of a preview."""
    state, sensor = found.state, found.camera.sensor
    array, (scene, factor) = sensor.array, unit_scene(found)
    tile = len(array.cfa), len(array.cfa[0])
    height, width = view.height, view.width
    if height * width > MOST_SHOWN:
        shrink = (MOST_SHOWN / (height * width)) ** 0.5
        height, width = int(height * shrink), int(width * shrink)
    step = max(-(-min(view.rows, array.rows) // height), -(-min(view.cols, array.cols) // width), 1)
    rows = _pixels(view.row, view.rows, step, tile[0], array.rows)
    cols = _pixels(view.col, view.cols, step, tile[1], array.cols)

    whole, rate = kept_frame(state, folder), kept_mean(state, folder)
    notes: list[str] = []
    if rate is None:
        light, notes = preview_rate(found, scene, rows, cols, step)
        mean_e = light * np.float32(factor * state.capture.exposure_s) * relative_light(found, rows, step)
        if state.scene.motion is not None:
            notes = [*notes, "the preview is without motion"]
    else:
        mean_e = found.exposed(_reduced(rate, rows, cols, step, tile))
    of_view = with_sensor_size(found, rows.size, cols.size, notes)
    contiguous = step == 1 and sensor.effects is None and sensor.captures is None and sensor.maps is None
    exact = whole is not None or (contiguous and rate is not None)
    if whole is not None:
        dn = _reduced(whole, rows, cols, step, tile)
        taken = _empty(of_view, scene, tile)
        spread = (_spread(axis, step, t) for axis, t in zip((rows, cols), tile, strict=True))
        pixels = dn if step == 1 else _picked(whole, *spread)
    elif step == 1:
        if contiguous:
            region = int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1
            taken = found.frame(mean_e, scene, region)
        else:
            taken = of_view.frame(mean_e, scene)
        dn = np.asarray(taken.dn) if state.capture.noise else of_view.camera.clean_dn(mean_e)
        pixels = dn
    else:
        few = _picked(
            mean_e, *(_spread(np.arange(axis.size), 3, t) // 3 for axis, t in zip((rows, cols), tile, strict=True))
        )
        of_few = with_sensor_size(found, few.shape[0], few.shape[1], [])
        taken = of_few.frame(few, scene)
        if state.capture.noise:
            dn, pixels = averaged_numbers(found, scene, mean_e, step), np.asarray(taken.dn)
        else:
            dn, pixels = of_view.camera.clean_dn(mean_e), of_few.camera.clean_dn(few)
    notes = [] if exact else notes
    return ViewPixels(rows, cols, step, taken, with_numbers(taken, dn), dn, mean_e, pixels, exact, tuple(notes))


def _spread(index: I64, step: int, tile: int) -> I64:
    """Return indices with the same first one, one tile in `step`."""
    number = np.arange(index.size // tile * tile or index.size)
    found: I64 = index[0] + number // tile * (tile * step) + number % tile
    return np.asarray(found[found <= index[-1]])


def _empty(of_view: PreparedState, scene: Scene, tile: tuple[int, int]) -> RawFrame:
    """Return a small dark frame, with the metadata of a state."""
    small = of_size(of_view.camera.sensor, 2 * tile[0], 2 * tile[1], [])
    camera = replace(of_view.camera, sensor=small)
    dark = np.zeros((2 * tile[0], 2 * tile[1]), np.float32)
    raw: RawFrame = PreparedState(of_view.state, camera, of_view.request).frame(dark, scene)
    return raw


def _reduced(whole: NDArray[Any], rows: I64, cols: I64, step: int, tile: tuple[int, int]) -> NDArray[Any]:
    """Return the pixels of a view of a whole frame, or their means."""
    if step == 1:
        return _picked(whole, rows, cols)
    first, shape = (int(rows[0]), int(cols[0])), (rows.size, cols.size)
    return mosaic_means(read_only(np.asarray(whole)), first, shape, tile, step)


def _picked(whole: NDArray[Any], rows: I64, cols: I64) -> NDArray[Any]:
    """Return the values at rows and columns, contiguous in memory."""
    if rows[-1] - rows[0] + 1 == rows.size and cols[-1] - cols[0] + 1 == cols.size:
        return np.ascontiguousarray(whole[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1])
    return np.ascontiguousarray(whole[rows][:, cols])
