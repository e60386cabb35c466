"""What the camera view shows of a frame: the pixels in view, first approximate, then those of the exact frame.

A view shows single pixels of the frame, or a mosaic `step` times smaller whose values are means over `step` x `step`
pixels of their color. Pixels of the exact frame are read from a file where the frame was computed before
(`exact_frame`). Otherwise they are those of a preview: the light is sampled at these pixels, or averaged over the
blocks, and blurred with the mean spectrum, without distortion, glare and crosstalk. The preview of single pixels has
the frame's own noise, that of means the mean and the standard deviation that the frame's model gives.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from pydantic import Field

from photosite.app.places import Part, Places
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.state import Bench, CameraState, SensorState, bench
from photosite.camera.camera import Camera
from photosite.camera.mean_image import electrons_per_weight, pitch_m, placement
from photosite.develop.develop import develop, develop_rgba, save_picture
from photosite.engine.jit import compiled, prange, read_only
from photosite.engine.mosaic_means import block_start, mosaic_means
from photosite.errors import InputError
from photosite.frames.companding import decompanded
from photosite.frames.io.clean_mosaic import write_clean_mosaic
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.capture_snr import capture_budget
from photosite.optics.point_spread import RadialPsf
from photosite.scene.scene import Scene
from photosite.scene.scene_request import SceneRequest
from photosite.sensor.capture_readout import largest_light_e
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.model import Sensor
from photosite.studies.gray_surface import light_capacity_e, total_variance_e2
from photosite.values.cfa import channel_names, channel_sites

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

MOST_SHOWN = 1_200_000
"""Pixels of a view."""
HISTOGRAM_BINS = 128

_SHARP = 0.8
"""The preview leaves out a blur whose transfer is above this at half the sampling frequency of the view."""
_TABLE = 512
_MOST_PADDING = 96
_PADDING_STEP = 16
"""Paddings are multiples of this, so that a small change of the blur changes none."""

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
class Shown:
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


def view_bytes(state: CameraState, places: Places, view: View, folder: Path) -> bytes:
    """Return a view for the page.

    Returns
    -------
    bytes
        Length of the header as 4 bytes, little endian; the header, JSON in UTF-8, padded with spaces to a multiple of
        4; where `view.mean`, (rows, cols) mean electrons from light, float32; where `view.dn`, (rows, cols) digital
        numbers, float32 or uint16 as the header's `dn_type` says; where its `developed` is true, (rows, cols, 4) bytes
        of the developed picture: red, green, blue and 255.
    """
    started = time.perf_counter()
    with recorded_warnings() as texts:
        found = bench(state, places)
        shown = _shown(found, view, folder)
        picture = b""
        notes = [*shown.notes]
        if view.developed:
            try:
                picture = _developed(shown.raw, state.brightness).tobytes()
            except InputError as error:
                notes.append(f"not developed: {error}")
    notes += texts
    header = _header(found, shown, view, folder) | {"notes": notes, "developed": bool(picture), "mean": view.mean}
    dn = shown.dn if shown.dn.dtype == np.uint16 else shown.dn.astype(np.float32)
    header["dn_type"] = str(dn.dtype) if view.dn else None
    header["seconds"] = time.perf_counter() - started
    text = json.dumps(header, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    mean = shown.mean_e.tobytes() if view.mean else b""
    numbers = dn.tobytes() if view.dn else b""
    return b"".join((len(text).to_bytes(4, "little"), text, mean, numbers, picture))


_MARGIN = 12
"""Rows, whole tiles of most arrays, that parts of a picture overlap by when they are developed."""


def _developed(raw: RawFrame, brightness: float) -> NDArray[np.uint8]:
    """Return `develop` as 8-bit RGBA, in two threads where each pixel depends on its neighbors alone."""

    def part(frame: RawFrame) -> NDArray[np.uint8]:
        return develop_rgba(frame, brightness)

    rows, tile = raw.dn.shape[0], len(raw.cfa)
    local = raw.as_shot_neutral is not None or len(raw.channels) == 1
    if not local or rows < 8 * _MARGIN or _MARGIN % tile:
        return part(raw)
    middle = rows // 2 // tile * tile
    halves = [
        replace(raw, dn=raw.dn[span], captures={}) for span in (slice(middle + _MARGIN), slice(middle - _MARGIN, None))
    ]
    with ThreadPoolExecutor(2) as threads:
        top, bottom = threads.map(part, halves)
    return np.concatenate([top[:middle], bottom[_MARGIN:]])


def exact_frame(
    state: CameraState, places: Places, folder: Path, progress: Callable[[int, int, str], object] | None = None
) -> dict[str, Any]:
    """Compute the exact frame of a state, keep it in a folder for views, and return its facts."""
    found = bench(state, places)
    scene = scene_of(found)
    with recorded_warnings() as texts:
        rate = _kept(_mean_file(folder, state))
        if rate is None:
            rate = found.mean_image(scene, progress)
            _keep(_mean_file(folder, state), rate)
        mean = found.exposed(rate)
        if progress is not None:
            progress(0, 1, "noise")
        raw = found.frame(mean, scene)
        dn = raw.dn if state.capture.noise else found.camera.clean_dn(mean)
    _keep(_frame_file(folder, state), np.asarray(dn))
    return {
        "frame": state.frame_key,
        "rows": raw.shape[0],
        "cols": raw.shape[1],
        "mean_dn": float(dn.mean()),
        "max_dn": float(dn.max()),
        "saturated_fraction": float((dn >= raw.white_level_dn).mean()),
        "suggested_exposure_s": found.camera.auto_exposure_s(mean / state.capture.exposure_s) if rate.any() else None,
        "warnings": texts,
    }


def prepare_views() -> None:
    """Import and compile what views need, and make the scene of the first one."""
    with tempfile.TemporaryDirectory() as folder:
        view_bytes(CameraState(), Places(), View(height=64, width=96), Path(folder))


def prepare_frames() -> None:
    """Import and compile what exact frames need."""
    small = SensorState(changes={"rows": 64, "cols": 96})
    with tempfile.TemporaryDirectory() as folder:
        exact_frame(CameraState(sensor=small), Places(), Path(folder))


def digital_numbers(state: CameraState, folder: Path) -> NDArray[Any] | None:
    """Return the exact frame of a state, (rows, cols), if it was computed and is still kept."""
    return _kept(_frame_file(folder, state))


def saved_frame(
    state: CameraState,
    places: Places,
    folder: Path,
    suffix: str,
    progress: Callable[[int, int, str], object] | None = None,
) -> bytes:
    """Return the exact frame as a raw file, .dng or .tif, or its developed picture, .png.

    The noise-free frame is a .tif of 32-bit floats, as that of `photosite simulate --clean`.
    """
    if suffix == ".dng" and not state.capture.noise:
        raise InputError("a noise-free frame is not whole numbers", hint="Save it as TIFF")
    exact_frame(state, places, folder, progress)
    found, rate = bench(state, places), _kept(_mean_file(folder, state))
    if rate is None:
        raise InputError("the frame is not kept any more", hint="Wait for the exact frame")
    mean = found.exposed(rate)
    raw = found.frame(mean, scene_of(found))
    clean = None if state.capture.noise else found.camera.clean_dn(mean)
    with tempfile.TemporaryDirectory(dir=folder.parent) as temporary:
        path = Path(temporary, f"shot{suffix}")
        if suffix == ".png":
            save_picture(develop(raw if clean is None else _with_numbers(raw, clean), exposure=state.brightness), path)
        elif clean is not None:
            write_clean_mosaic(clean, raw, path)
        else:
            raw.save(path)
        return path.read_bytes()


def _mean_file(folder: Path, state: CameraState) -> Path:
    return folder / f"mean-{state.mean_key}.npy"


def _frame_file(folder: Path, state: CameraState) -> Path:
    return folder / f"frame-{state.frame_key}.npy"


def _kept(path: Path) -> NDArray[Any] | None:
    try:
        found: NDArray[Any] = np.load(path, mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return None
    os.utime(path)  # the files used least recently are deleted first
    return found


def _keep(path: Path, array: NDArray[Any]) -> None:
    temporary = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            np.save(file, array)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


# Scenes are kept by a worker process, because a chart of the camera's size takes longer than a picture.

_KEPT_SCENES = 3
_scenes: OrderedDict[tuple[Any, ...], Scene] = OrderedDict()


def _add(kept: OrderedDict[Any, Any], key: Any, value: Any, most: int = 16) -> None:
    """Add a value to those that are kept, and drop the oldest beyond `most`.

    Keys have the `id` of a sensor or a scene's weights. The value holds this object, so that no other one gets its id.
    """
    while len(kept) >= most:
        kept.popitem(last=False)
    kept[key] = value


def scene_of(found: Bench) -> Scene:
    """Return the scene of a state, made once."""
    return _made(found.request)


def _unit_scene(found: Bench) -> tuple[Scene, float]:
    """Return the scene at 1 cd/m2 where the state gives its luminance, and the factor of its light to that luminance.

    The image is linear in the luminance, so that a change of it needs neither a scene nor an image.
    """
    luminance_cd_m2 = found.request.options.get("mean_luminance_cd_m2")
    if luminance_cd_m2 is None:
        return scene_of(found), 1.0
    options = {**found.request.options, "mean_luminance_cd_m2": 1.0}
    return _made(replace(found.request, options=options)), float(luminance_cd_m2)


def _made(request: SceneRequest) -> Scene:
    changed = Path(request.source).stat().st_mtime_ns if request.is_file else 0
    key = (request.source, changed, tuple(sorted((name, str(value)) for name, value in request.options.items())))
    if key not in _scenes:
        scene = request.scene()
        for other in _scenes.values():  # a change of the light leaves the weights, so that their spectra are kept
            if np.array_equal(scene.weights, other.weights):
                scene = replace(scene, weights=other.weights)
                break
        _add(_scenes, key, scene, _KEPT_SCENES)
    _scenes.move_to_end(key)
    return _scenes[key]


def _pixels(first: int, count: int, step: int, tile: int, size: int) -> I64:
    """Return the first pixel of the frame in each pixel of a view along an axis, whole tiles of view pixels."""
    first = min(first, size - 1) // tile * tile
    count = max(min(count, size - first), 1)
    index = first + step * np.arange(-(-count // (step * tile)) * tile)
    return index[index + step // 2 < size]


def _shown(found: Bench, view: View, folder: Path) -> Shown:
    state, sensor = found.state, found.camera.sensor
    array, (scene, factor) = sensor.array, _unit_scene(found)
    tile = len(array.cfa), len(array.cfa[0])
    height, width = view.height, view.width
    if height * width > MOST_SHOWN:
        shrink = (MOST_SHOWN / (height * width)) ** 0.5
        height, width = int(height * shrink), int(width * shrink)
    step = max(-(-min(view.rows, array.rows) // height), -(-min(view.cols, array.cols) // width), 1)
    rows = _pixels(view.row, view.rows, step, tile[0], array.rows)
    cols = _pixels(view.col, view.cols, step, tile[1], array.cols)

    whole, rate = _kept(_frame_file(folder, state)), _kept(_mean_file(folder, state))
    notes: list[str] = []
    if rate is None:
        light, notes = _preview_rate(found, scene, rows, cols, step)
        mean_e = light * np.float32(factor * state.capture.exposure_s) * _relative_light(found, rows, step)
        if state.scene.motion is not None:
            notes = [*notes, "the preview is without motion"]
    else:
        mean_e = found.exposed(_reduced(rate, rows, cols, step, tile))
    of_view = _of_view(found, rows.size, cols.size, notes)
    contiguous = step == 1 and sensor.effects is None and sensor.captures is None and sensor.maps is None
    exact = whole is not None or (contiguous and rate is not None)
    if whole is not None:
        dn = _reduced(whole, rows, cols, step, tile)
        taken = _empty(of_view, scene, tile)
        pixels = (
            dn
            if step == 1
            else _picked(whole, *(_spread(axis, step, t) for axis, t in zip((rows, cols), tile, strict=True)))
        )
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
        of_few = _of_view(found, few.shape[0], few.shape[1], [])
        taken = of_few.frame(few, scene)
        if state.capture.noise:
            dn, pixels = _averaged_numbers(found, scene, mean_e, step), np.asarray(taken.dn)
        else:
            dn, pixels = of_view.camera.clean_dn(mean_e), of_few.camera.clean_dn(few)
    notes = [] if exact else notes
    return Shown(rows, cols, step, taken, _with_numbers(taken, dn), dn, mean_e, pixels, exact, tuple(notes))


def _of_view(found: Bench, rows: int, cols: int, notes: list[str]) -> Bench:
    """Return the bench with a sensor of another size."""
    return Bench(
        found.state, replace(found.camera, sensor=_of_size(found.camera.sensor, rows, cols, notes)), found.request
    )


def _spread(index: I64, step: int, tile: int) -> I64:
    """Return indices with the same first one, one tile in `step`."""
    number = np.arange(index.size // tile * tile or index.size)
    found: I64 = index[0] + number // tile * (tile * step) + number % tile
    return np.asarray(found[found <= index[-1]])


_LEVELS, _PER_LEVEL = 64, 512
"""Signals at which the mean and the noise of a pixel are estimated, and pixels of a row of each."""


def _averaged_numbers(found: Bench, scene: Scene, mean_e: F32, step: int) -> F32:
    """Return digital numbers of means over `step` x `step` pixels of a color, normally distributed.

    The mean and the standard deviation of a pixel are those of simulated pixels at some signals; noise of rows and
    columns is drawn apart, because the pixels of a block share it.
    """
    sensor, seed = found.camera.sensor, found.state.capture.seed
    top = 2.0 ** (np.ceil(4.0 * np.log2(max(float(mean_e.max()), 1.0))) / 4.0)  # few values, so that most are kept
    mean_dn, spread_dn = _pixels_at_levels(found, scene, top)
    dn = _with_noise(mean_e, top, mean_dn, spread_dn / step, _normal(seed, mean_e.shape))
    for mv, axis in zip(_line_noise_mv(sensor), (0, 1), strict=True):
        if mv:
            spread_dn = sensor.electrons(mv) * sensor.system_gain_dn_per_e / step**0.5
            line = np.random.default_rng([seed, axis]).normal(0.0, spread_dn, mean_e.shape[axis])
            dn += np.float32(np.expand_dims(line, 1 - axis))
    return dn


def _line_noise_mv(sensor: Sensor) -> tuple[float, float]:
    """Return the noise of rows and of columns."""
    return sensor.noise.row_noise_mv.value, sensor.noise.column_noise_mv.value


_at_levels: OrderedDict[tuple[Any, ...], tuple[Sensor, F64, F64]] = OrderedDict()


def _pixels_at_levels(found: Bench, scene: Scene, top: float) -> tuple[F64, F64]:
    """Return mean and standard deviation of digital numbers at squares of even steps from 0 to `top` electrons.

    Noise of rows and columns is left out.
    """
    sensor = found.camera.sensor
    key = (id(sensor), found.state.capture.model_dump_json(), top)
    if key not in _at_levels:
        levels = top * np.linspace(0.0, 1.0, _LEVELS) ** 2
        tile = len(sensor.array.cfa), len(sensor.array.cfa[0])
        sample = _of_view(found, _LEVELS * tile[0], _PER_LEVEL * tile[1], [])
        if any(lines_mv := _line_noise_mv(sensor)):
            alone_mv = max(sensor.noise.read_noise_mv.value**2 - lines_mv[0] ** 2 - lines_mv[1] ** 2, 0.0) ** 0.5
            alone = sample.camera.sensor.with_(row_noise_mv=0, column_noise_mv=0, read_noise_mv=alone_mv)
            sample = Bench(found.state, replace(sample.camera, sensor=alone), found.request)
        mosaic = np.repeat(levels.astype(np.float32), tile[0])[:, None] * np.ones(_PER_LEVEL * tile[1], np.float32)
        drawn = np.asarray(sample.frame(mosaic, scene).dn, np.float64).reshape(_LEVELS, -1)
        _add(_at_levels, key, (sensor, drawn.mean(axis=1), drawn.std(axis=1)))
    return _at_levels[key][1:]


@lru_cache(maxsize=2)
def _normal(seed: int, shape: tuple[int, int]) -> F32:
    return np.random.default_rng(seed).standard_normal(shape, np.float32)


@compiled(parallel=True)
def _with_noise(
    mean_e: F32, top: float, mean_dn: NDArray[np.float64], spread_dn: NDArray[np.float64], normal: F32
) -> F32:
    """Return mean digital numbers plus noise; both are given at the squares of even steps from 0 to `top`."""
    rows, cols = mean_e.shape
    out = np.empty((rows, cols), np.float32)
    last = mean_dn.size - 1
    for r in prange(rows):
        for c in range(cols):
            place = np.sqrt(max(mean_e[r, c], 0.0) / top) * last
            k = min(int(place), last - 1)
            share = place - k
            value = mean_dn[k] + share * (mean_dn[k + 1] - mean_dn[k])
            out[r, c] = value + (spread_dn[k] + share * (spread_dn[k + 1] - spread_dn[k])) * normal[r, c]
    return out


_rates: OrderedDict[tuple[Any, ...], tuple[F32, list[str]]] = OrderedDict()


def _preview_rate(found: Bench, scene: Scene, rows: I64, cols: I64, step: int) -> tuple[F32, list[str]]:
    """Return `approximate_rate`, that of the last state again where only luminance, exposure or noise changed."""
    of_any_luminance = found.state.scene.model_copy(update={"mean_luminance_cd_m2": None})
    state = found.state.model_copy(update={"scene": of_any_luminance})
    key = (
        state.mean_key,
        id(scene),
        step,
        int(rows[0]),
        rows.size,
        int(cols[0]),
        cols.size,
    )
    if key not in _rates:
        _rates.clear()
        _rates[key] = approximate_rate(found.camera, scene, rows, cols, step)
    rate, notes = _rates[key]
    return rate, [*notes]


def _relative_light(found: Bench, rows: I64, step: int) -> F32:
    """Return (rows, 1) light of a flickering lamp that reaches rows of a view, relative to its mean."""
    state, sensor = found.state, found.camera.sensor
    if state.scene.flicker is None:
        return np.ones((1, 1), np.float32)
    tile = len(sensor.array.cfa)
    of_block = rows[0] + block_start(np.arange(rows.size), step, tile)[:, None] + tile * np.arange(step)
    inside = (of_block >= 0) & (of_block < sensor.array.rows)
    start_s = sensor.row_start_s[np.where(inside, of_block, 0)]
    exposure_s = state.capture.exposure_s
    light = state.scene.flicker.flicker().integral_s(start_s, start_s + exposure_s) / exposure_s
    return np.asarray(light.mean(axis=1, keepdims=True, where=inside), np.float32)


def _empty(of_view: Bench, scene: Scene, tile: tuple[int, int]) -> RawFrame:
    """Return a small dark frame, with the metadata of a state."""
    small = _of_size(of_view.camera.sensor, 2 * tile[0], 2 * tile[1], [])
    camera = replace(of_view.camera, sensor=small)
    dark = np.zeros((2 * tile[0], 2 * tile[1]), np.float32)
    raw: RawFrame = Bench(of_view.state, camera, of_view.request).frame(dark, scene)
    return raw


def _with_numbers(raw: RawFrame, dn: NDArray[Any]) -> RawFrame:
    """Return a raw frame with other digital numbers, rounded to 16 bits where they are no whole numbers."""
    kind = raw.dn.dtype
    if dn.dtype.kind == "f" and raw.bits < 16 and decompanded(raw) is raw:
        scale = 1 << (16 - raw.bits)
        fine = np.rint(np.clip(dn, 0, (1 << raw.bits) - 1) * np.float32(scale)).astype(np.uint16)
        assert raw.white_level_dn is not None
        black_dn, white_dn = raw.black_level_dn * scale, raw.white_level_dn * scale
        return replace(raw, dn=fine, bits=16, black_level_dn=black_dn, white_level_dn=white_dn, captures={})
    dn = np.clip(dn, 0, None)
    return replace(raw, dn=np.rint(dn).astype(kind) if dn.dtype != kind else np.ascontiguousarray(dn), captures={})


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


_of_sizes: OrderedDict[tuple[int, int, int], tuple[Sensor, Sensor, list[str]]] = OrderedDict()


def _of_size(sensor: Sensor, rows: int, cols: int, notes: list[str]) -> Sensor:
    """Return the sensor with the view's number of pixels; effects that depend on places in the array are left out."""
    key = (id(sensor), rows, cols)
    if key not in _of_sizes:
        left_out: list[str] = []
        _add(_of_sizes, key, (sensor, _resized(sensor, rows, cols, left_out), left_out))
    _, found, left_out = _of_sizes[key]
    notes += left_out
    return found


def _resized(sensor: Sensor, rows: int, cols: int, notes: list[str]) -> Sensor:
    changes: dict[str, Any] = {"rows": rows, "cols": cols}
    if sensor.maps is not None:
        changes["maps"] = None
        notes.append("the preview draws the fixed pattern in place of the measured maps")
    if sensor.effects is None:
        return sensor.with_(**changes)
    placed = {name: None for name in _PLACED if getattr(sensor.effects, name) is not None}
    if placed:
        notes.append(f"the preview is without {', '.join(placed).replace('_', ' ')}")
    return sensor.with_(**placed, **changes)


_PLACED = ("glow", "optical_black", "readout_channels", "pixel_defects", "charge_transfer", "blooming")
"""Effects that depend on places in the array, or reach over many pixels."""


# The image of the preview.


def approximate_rate(camera: Camera, scene: Scene, rows: I64, cols: I64, step: int) -> tuple[F32, list[str]]:
    """Return approximate mean electrons per second of the pixels of a view, and what is left out.

    Parameters
    ----------
    camera, scene
        As for `Camera.mean_electrons`.
    rows, cols
        (h,), (w,) first pixels of the frame in each pixel of the view, `step` apart.
    step
        1 for single pixels; else the light is averaged over blocks as by `photosite.engine.mosaic_means`.

    Returns
    -------
    ndarray, list of str
        (h, w) float32, and notes.

    Examples
    --------
    >>> import photosite as ps
    >>> camera = ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200").with_(rows=64, cols=64))
    >>> scene = ps.charts.uniform("D65", 100)
    >>> whole = np.arange(64)
    >>> found, _ = approximate_rate(camera, scene, whole, whole, 1)
    >>> bool(np.allclose(found, camera.mean_electrons(scene, 1.0), rtol=1e-5))
    True
    """
    sensor, where = camera.sensor, placement(scene, camera)
    cfa, names = sensor.array.cfa, sensor.channel_names
    coupling = electrons_per_weight(scene, camera)
    per_map = coupling.sum(axis=2)
    scale = float(np.abs(per_map).max()) or 1.0  # an f-number changes this factor and the blur alone
    relative = (per_map / scale).round(7).astype(np.float32)
    pitch = pitch_m(sensor)
    notes: list[str] = []
    blur = _blur(camera, scene, coupling, step, notes)
    padding = 0 if blur is None else blur.padding
    sampled_rows = _samples(rows, padding, step, len(cfa), where.row_start, where.row_step, scene.shape[0])
    sampled_cols = _samples(cols, padding, step, len(cfa[0]), where.col_start, where.col_step, scene.shape[1])
    image_of = _channel_images(scene, relative, sampled_rows, sampled_cols)
    rate = np.empty((rows.size, cols.size), np.float32)
    for channel, name in enumerate(names):
        sites = [(slice(r, None, len(cfa)), slice(c, None, len(cfa[0]))) for r, c in channel_sites(cfa, name)]
        if blur is None:
            for site in sites:
                rate[site] = image_of(channel, site)
            continue
        image = blur.blurred(channel, image_of)[padding : padding + rows.size, padding : padding + cols.size]
        for site in sites:
            rate[site] = image[site]
    np.maximum(rate, np.float32(0), out=rate)
    rate *= np.float32(scale)
    y_m = (rows + 0.5 * step - sensor.array.rows / 2) * pitch[0]
    x_m = (cols + 0.5 * step - sensor.array.cols / 2) * pitch[1]
    if camera.optics.relative_illumination(np.zeros(1), scene.distance_m) is not None:
        falloff = camera.optics.relative_illumination(np.hypot(y_m[:, None], x_m), scene.distance_m)
        assert falloff is not None
        rate *= falloff.astype(np.float32)
    left_out = [
        *(["distortion"] if camera.optics.mapping(scene.distance_m) is not None else []),
        *(["veiling glare"] if camera.optics.veiling_glare is not None else []),
        *(["crosstalk and angular response"] if sensor.optical_stack is not None else []),
        *(["polarization"] if scene.polarization is not None else []),
    ]
    if left_out:
        notes.append(f"the preview is without {', '.join(left_out)}")
    return rate, notes


class _Samples(NamedTuple):
    """The first and last sample of the scene in parts of each pixel, (parts, pixels), and the last one's share."""

    first: I64
    last: I64
    share: F32

    def at(self, part: slice) -> _Samples:
        """Return those of some pixels."""
        return _Samples(self.first[:, part], self.last[:, part], self.share[:, part])

    @property
    def size(self) -> int:
        """Number of pixels."""
        return int(self.first.shape[1])


_MOST_PARTS = 16


def _samples(pixels: I64, padding: int, step: int, tile: int, start: float, per_pixel: float, size: int) -> _Samples:
    """Return the samples in single pixels or in blocks of a view, and in padding on both sides.

    A window has as many parts as samples, and a part at most two samples. Beyond the scene are those of its border.
    """
    wide = 1 if step == 1 else step * tile
    first_of_block = pixels[0] + block_start(np.arange(-padding, pixels.size + padding), step, tile)
    parts = min(max(int(np.ceil(per_pixel * wide - 1e-9)), 1), _MOST_PARTS)
    width = per_pixel * wide / parts
    # The pixels of a block are a tile apart, and so the block begins half a tile before the middle of the first.
    before = 0.0 if step == 1 else (tile - 1) / 2
    begin = start + per_pixel * (first_of_block - before) + width * np.arange(parts)[:, None]
    first, last = (np.floor(place).astype(np.int64) for place in (begin + 1e-9, begin + width - 1e-9))
    share = np.where(last > first, np.clip((begin + width - last) / width, 0.0, 1.0), 0.0)
    share[last > first + 1] = 0.5
    return _Samples(np.clip(first, 0, size - 1), np.clip(last, 0, size - 1), share.astype(np.float32))


def _sampled(maps: F32, rows: _Samples, cols: _Samples) -> F32:
    """Return (K, h, w) means of (K, rows, cols) maps over windows, from two samples of each part on each axis."""
    return _along(_along(maps, rows, 1), cols, 2)


def _along(maps: F32, samples: _Samples, axis: int) -> F32:
    total = np.zeros(0, np.float32)
    for first, last, share in zip(*samples, strict=True):
        values = np.take(maps, first, axis=axis)
        if share.any():
            following = np.take(maps, last, axis=axis)
            following -= values
            following *= share[:, None] if axis == 1 else share
            values += following
        total = values if total.size == 0 else np.add(total, values, out=total)
    if len(samples.first) > 1:
        total /= np.float32(len(samples.first))
    return total


_gathered: OrderedDict[tuple[Any, ...], tuple[Scene, F32]] = OrderedDict()


_WHOLE = slice(None), slice(None)


class _ChannelImages(NamedTuple):
    """The images of the channels in pixels of a view, computed when they are asked for, and what they depend on."""

    image: Callable[[int, tuple[slice, slice]], F32]
    shape: tuple[int, int]
    scene: Scene
    key: tuple[Any, ...]

    def __call__(self, channel: int, part: tuple[slice, slice]) -> F32:
        """Return the image of a channel in a part of the pixels."""
        return self.image(channel, part)


def _channel_images(scene: Scene, per_map: F32, rows: _Samples, cols: _Samples) -> _ChannelImages:
    """Return the images of the channels, for electrons per second and weight of each map."""
    maps, shape = scene.weights, (rows.size, cols.size)
    key = (id(maps), *(part.tobytes() for of_axis in (rows, cols) for part in of_axis))
    key_of_images = (*key, per_map.tobytes())
    if maps[0].size <= rows.size * cols.size:
        images = (per_map @ maps.reshape(len(maps), -1)).reshape(-1, *maps.shape[1:])

        def sampled(channel: int, part: tuple[slice, slice]) -> F32:
            found: F32 = _sampled(images[channel : channel + 1], rows.at(part[0]), cols.at(part[1]))[0]
            return found

        return _ChannelImages(sampled, shape, scene, key_of_images)
    if key not in _gathered:
        _add(_gathered, key, (scene, _sampled(maps, rows, cols)), _KEPT_SCENES)
    few = _gathered[key][1]

    def mixed(channel: int, part: tuple[slice, slice]) -> F32:
        return np.asarray(np.tensordot(per_map[channel], few[:, part[0], part[1]], axes=1), np.float32)

    return _ChannelImages(mixed, shape, scene, key_of_images)


@dataclass(frozen=True, eq=False)
class _Blur:
    """The blur of lens and photodetector for the mean spectrum.

    Parameters
    ----------
    table
        (channels, n) transfer of the lens at even steps of frequency from 0 to `longest`, in cycles per m.
    spacing, sides
        Of pixels of the view and of the photodetector, down and across, in m.
    padding
        Reach in pixels of the view.
    """

    table: F32
    longest: float
    spacing: tuple[float, float]
    sides: tuple[float, float]
    padding: int

    def blurred(self, channel: int, image_of: _ChannelImages) -> F32:
        """Return the blurred image of a channel."""
        shape = tuple(scipy.fft.next_fast_len(n, real=True) for n in image_of.shape)
        key = (channel, shape, self.spacing, self.sides, *image_of.key)
        if key not in _spectra:
            of_image = scipy.fft.rfft2(image_of(channel, _WHOLE), s=shape, workers=-1)
            for axis, (side, spacing) in enumerate(zip(self.sides, self.spacing, strict=True)):
                frequency = (np.fft.rfftfreq if axis else np.fft.fftfreq)(shape[axis], spacing)
                of_image *= np.expand_dims(np.sinc(frequency * side).astype(np.float32), 1 - axis)
            _add(_spectra, key, (image_of.scene, of_image), _KEPT_SPECTRA)
        spectrum = (
            _spectra[key][1] * self.table[channel][_places(shape, self.spacing, self.longest, self.table.shape[1])]
        )
        found: F32 = scipy.fft.irfft2(spectrum, s=shape, workers=-1, overwrite_x=True)
        return found  # what is beyond the padding does not reach the view


_KEPT_SPECTRA = 6
_spectra: OrderedDict[tuple[Any, ...], tuple[Scene, NDArray[np.complex64]]] = OrderedDict()
"""Spectra of the channels before the lens's blur, which a change of the f-number does not change."""


@lru_cache(maxsize=2)
def _places(shape: tuple[int, ...], spacing: tuple[float, float], longest: float, count: int) -> NDArray[np.int32]:
    """Return the places of a transform's frequencies in a table of `count` entries from 0 to `longest`."""
    fy = np.fft.fftfreq(shape[0], spacing[0]).astype(np.float32)
    fx = np.fft.rfftfreq(shape[1], spacing[1]).astype(np.float32)
    place = np.sqrt(fy[:, None] ** 2 + fx**2)
    place *= np.float32((count - 1) / longest)
    return np.asarray(place.astype(np.int32))


def _blur(camera: Camera, scene: Scene, coupling: NDArray[np.float64], step: int, notes: list[str]) -> _Blur | None:
    """Return the blur of a view, or None where it is too small to be seen."""
    spread, sensor = camera.optics.point_spread(scene.distance_m), camera.sensor
    if scene.shape == (1, 1):
        return None
    if not isinstance(spread, RadialPsf):
        notes.append("the preview is without the lens's blur")
        return None
    grid = scene.wavelength_nm
    pitch = pitch_m(sensor)
    spectrum = np.abs(np.einsum("ckw,k->cw", coupling, scene.weights.mean(axis=(1, 2), dtype=np.float64)))
    total = spectrum.sum(axis=1, keepdims=True)
    shares = np.divide(spectrum, total, out=np.full_like(spectrum, 1 / grid.size), where=total > 0)
    longest = float(np.hypot(0.5 / (step * pitch[0]), 0.5 / (step * pitch[1]))) * 1.001
    frequency = np.linspace(0.0, longest, _TABLE)
    few = np.unique(np.linspace(0, grid.size - 1, min(grid.size, 16)).round().astype(int))
    shares = shares[:, few] / shares[:, few].sum(axis=1, keepdims=True).clip(1e-30)
    table = shares @ np.stack([spread.otf(frequency, float(grid[w])) for w in few])
    half = np.searchsorted(frequency, 0.5 / (step * min(pitch)))
    if table[:, : min(half + 1, _TABLE)].min() > _SHARP:
        return None
    reach = max(spread.reach_m(float(grid[w])) for w in few)
    blocks = np.ceil((0.3 * reach / (step * min(pitch)) + 1) / _PADDING_STEP)
    side = float(np.sqrt(sensor.pixel.fill_factor.value))
    return _Blur(
        table.astype(np.float32),
        longest,
        spacing=(step * pitch[0], step * pitch[1]),
        sides=(pitch[0] * side, pitch[1] * side),
        padding=int(min(_PADDING_STEP * blocks, _MOST_PADDING)),
    )


# What the page writes beside the picture.


def _header(found: Bench, shown: Shown, view: View, folder: Path) -> dict[str, Any]:
    sensor, taken = found.camera.sensor, found.state.capture
    at = sensor if taken.temperature_c is None else sensor.at_temperature(taken.temperature_c)
    capacity = light_capacity_e(at, taken.exposure_s) if sensor.captures is None else float(shown.mean_e.max()) + 1.0
    array, taken_as = sensor.array, shown.taken
    assert taken_as.white_level_dn is not None
    return {
        "exact": shown.exact,
        "frame": found.state.frame_key,
        "step": shown.step,
        "row": int(shown.rows[0]),
        "col": int(shown.cols[0]),
        "rows": shown.rows.size,
        "cols": shown.cols.size,
        "frame_rows": array.rows,
        "frame_cols": array.cols,
        "cfa": [list(line) for line in array.cfa],
        "channels": list(channel_names(array.cfa)),
        "black_level_dn": taken_as.black_level_dn,
        "white_level_dn": taken_as.white_level_dn,
        "bits": taken_as.bits,
        "response": _response_table(sensor),
        "saturation_e": capacity,
        "sensor": sensor.name,
        "scene": _unit_scene(found)[0].name,
        "exposure_s": taken.exposure_s,
        "snr": _snr_table(at, taken.exposure_s, max(capacity, 1.0)),
        "histogram": _histogram(shown.pixels, taken_as.white_level_dn, array.cfa),
        "saturated_fraction": float((shown.pixels >= taken_as.white_level_dn).mean()),
        "regions": [_statistics(found, shown, region, folder) for region in view.regions],
    }


_RESPONSE_POINTS = 513
_BENDING = ("response_curve", "em_gain", "output")
"""Effects that change the digital number of a charge."""


def _response_table(sensor: Sensor) -> dict[str, list[float]]:
    """Return electrons from light, and the digital numbers that they have without noise: linear in between."""
    effects = sensor.effects
    bending = [] if effects is None else [name for name in _BENDING if getattr(effects, name) is not None]
    if sensor.captures is None and not bending:
        black_dn = sensor.output_levels_dn[0]
        return {"dn": [black_dn, black_dn + sensor.system_gain_dn_per_e], "electrons": [0.0, 1.0]}
    top_e = sensor.saturation_capacity_e if sensor.captures is None else largest_light_e(sensor)
    light = np.linspace(0.0, top_e, _RESPONSE_POINTS)
    tile = len(sensor.array.cfa), len(sensor.array.cfa[0])
    others = (
        {} if effects is None else {name: None for name, part in effects if part is not None and name not in bending}
    )
    small = _of_size(sensor.with_(**others), tile[0], tile[1] * _RESPONSE_POINTS, [])
    mosaic = np.repeat(np.repeat(light, tile[1])[None], tile[0], axis=0).astype(np.float32)
    dn, first = np.unique(clean_numbers(small, mosaic)[0, :: tile[1]], return_index=True)
    return {"dn": dn.tolist(), "electrons": light[first].tolist()}


def _electrons(dn: NDArray[np.float64], response: dict[str, list[float]]) -> NDArray[np.float64]:
    """Return the electrons of digital numbers; below the table, those of its first two entries' line."""
    numbers, electrons = response["dn"], response["electrons"]
    if len(numbers) < 2:
        return np.zeros_like(dn)
    ends = [(electrons[k + 1] - electrons[k]) / (numbers[k + 1] - numbers[k]) for k in (0, len(numbers) - 2)]
    beyond = np.minimum(dn - numbers[0], 0.0) * ends[0] + np.maximum(dn - numbers[-1], 0.0) * ends[1]
    return np.asarray(np.interp(dn, numbers, electrons) + beyond)


def _snr_table(sensor: Sensor, exposure_s: float, capacity_e: float) -> dict[str, list[float]]:
    """Return the ratio of signal to the noise of one frame, in dB, over electrons from light."""
    signal = np.geomspace(0.01, capacity_e, 96)
    if sensor.captures is not None:
        ratio = capture_budget(sensor, signal, exposure_s).combined_db
    else:
        ratio = 10.0 * np.log10(signal**2 / total_variance_e2(sensor, signal, exposure_s))
    kept = np.isfinite(ratio)
    return {"signal_e": signal[kept].tolist(), "snr_db": ratio[kept].tolist()}


def _histogram(pixels: NDArray[Any], white_dn: float, cfa: tuple[tuple[str, ...], ...]) -> dict[str, Any]:
    """Return counts of digital numbers by channel, in bins of equal width from 0 to the white level."""
    top = white_dn + 1.0
    counts: dict[str, list[int]] = {}
    scaled = (pixels * np.float32(HISTOGRAM_BINS / top)).astype(np.int32)
    for name in channel_names(cfa):
        total: Any = 0
        for r, c in channel_sites(cfa, name):
            part = scaled[r :: len(cfa), c :: len(cfa[0])].ravel()
            total = total + np.bincount(np.clip(part, 0, HISTOGRAM_BINS - 1), minlength=HISTOGRAM_BINS)
        counts[name] = np.asarray(total).tolist()
    return {"dn_per_bin": top / HISTOGRAM_BINS, "counts": counts}


def _statistics(found: Bench, shown: Shown, region: Rectangle, folder: Path) -> dict[str, Any]:
    """Return mean, standard deviation and SNR of each channel in a region of the frame."""
    sensor = found.camera.sensor
    r0, r1, c0, c1 = region
    cfa, response = sensor.array.cfa, _response_table(sensor)
    whole = _kept(_frame_file(folder, found.state))
    if whole is not None:
        rows, cols = np.arange(r0, min(r1, whole.shape[0])), np.arange(c0, min(c1, whole.shape[1]))
        dn = np.asarray(whole[r0:r1, c0:c1], np.float64)
    elif shown.step > 1:  # the spread of means is not that of pixels
        return {"region": list(region), "exact": False, "channels": dict.fromkeys(channel_names(cfa)), "waits": True}
    else:
        down, across = ((of >= low) & (of < high) for of, low, high in ((shown.rows, r0, r1), (shown.cols, c0, c1)))
        rows, cols = shown.rows[down], shown.cols[across]
        dn = shown.dn[down][:, across].astype(np.float64)
    channels: dict[str, Any] = {}
    for name in channel_names(cfa):
        sites = channel_sites(cfa, name)
        parts = [dn[np.ix_(rows % len(cfa) == r, cols % len(cfa[0]) == c)].ravel() for r, c in sites]
        values = np.concatenate(parts)
        if values.size < 2:
            channels[name] = None
            continue
        electrons = _electrons(values, response)
        signal, spread = float(electrons.mean()), float(electrons.std(ddof=1))
        ratio = 20.0 * np.log10(signal / spread) if signal > 0 and spread > 0 else None
        channels[name] = {
            "pixels": values.size,
            "mean_dn": float(values.mean()),
            "sd_dn": float(values.std(ddof=1)),
            "mean_e": signal,
            "snr_db": None if ratio is None else float(ratio),
        }
    return {"region": list(region), "exact": whole is not None or shown.exact, "channels": channels, "waits": False}
