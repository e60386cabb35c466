"""What the camera view shows of a frame: the pixels in view, first approximate, then those of the exact frame.

A view shows single pixels of the frame, one in `step` blocks of the color filter array along each axis, and averages
nothing. Pixels of the exact frame are read from a file where the frame was computed before (`exact_frame`). Otherwise
they are those of a preview: the image is sampled at these pixels and blurred with the mean spectrum, without
distortion, glare and crosstalk, and the noise has the frame's statistics. The preview of single pixels has the frame's
own noise.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
import warnings
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

from photosite.app.state import Bench, CameraState, Part, Places, bench
from photosite.camera.camera import Camera
from photosite.camera.mean_image import electrons_per_weight, pitch_m, placement
from photosite.develop.develop import develop, save_picture
from photosite.errors import InputError, PhotositeWarning
from photosite.frames.io.clean_mosaic import write_clean_mosaic
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.capture_snr import capture_budget
from photosite.optics.point_spread import RadialPsf
from photosite.scene.scene import Scene
from photosite.sensor.capture_readout import largest_light_e
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.model import Sensor
from photosite.studies.gray_surface import light_capacity_e, total_variance_e2
from photosite.values.cfa import channel_names, channel_sites

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

MOST_SHOWN = 1_200_000
"""Pixels of a view."""
HISTOGRAM_BINS = 128

_SHARP = 0.8
"""The preview leaves out a blur whose transfer is above this at half the sampling frequency of the view."""
_TABLE = 512
_MOST_PADDING = 96

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


@dataclass(frozen=True, eq=False)
class Shown:
    """The pixels of a view: rows and columns of the frame, digital numbers and mean electrons from light."""

    rows: I64
    cols: I64
    step: int
    raw: RawFrame
    dn: F32
    mean_e: F32
    exact: bool
    notes: tuple[str, ...]


def view_bytes(state: CameraState, places: Places, view: View, folder: Path) -> bytes:
    """Return a view for the page.

    Returns
    -------
    bytes
        Length of the header as 4 bytes, little endian; the header, JSON in UTF-8, padded with spaces to a multiple of
        4; where `view.mean`, (rows, cols) mean electrons from light, float32; (rows, cols) digital numbers, float32 or
        uint16 as the header's `dn_type` says; where its `developed` is true, (rows, cols, 4) bytes of the developed
        picture: red, green, blue and 255.
    """
    started = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PhotositeWarning)
        found = bench(state, places)
        shown = _shown(found, view, folder)
        picture = b""
        notes = [*shown.notes]
        if view.developed:
            try:
                picture = _developed(shown.raw, state.brightness).tobytes()
            except InputError as error:
                notes.append(f"not developed: {error}")
    notes += dict.fromkeys(str(w.message) for w in caught if isinstance(w.message, PhotositeWarning))
    header = _header(found, shown, view, folder) | {"notes": notes, "developed": bool(picture), "mean": view.mean}
    whole = state.capture.noise and shown.raw.dn.dtype == np.uint16
    dn = shown.raw.dn if whole else shown.dn
    header["dn_type"] = str(dn.dtype)
    header["seconds"] = time.perf_counter() - started
    text = json.dumps(header, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    mean = shown.mean_e.tobytes() if view.mean else b""
    return b"".join((len(text).to_bytes(4, "little"), text, mean, dn.tobytes(), picture))


_MARGIN = 12
"""Rows, whole tiles of most arrays, that parts of a picture overlap by when they are developed."""


def _developed(raw: RawFrame, brightness: float) -> NDArray[np.uint8]:
    """Return `develop` as 8-bit RGBA, in two threads where each pixel depends on its neighbors alone."""

    def part(frame: RawFrame) -> NDArray[np.uint8]:
        linear = develop(frame, exposure=brightness)
        linear *= np.float32(255)
        linear += np.float32(0.5)
        out = np.full((*linear.shape[:2], 4), 255, np.uint8)
        out[..., :3] = linear
        return out

    rows, tile = raw.dn.shape[0], len(raw.cfa)
    local = raw.as_shot_neutral is not None or len(raw.channels) == 1
    if not local or rows < 8 * _MARGIN or _MARGIN % tile:
        return part(raw)
    middle = rows // 2 // tile * tile
    halves = [replace(raw, dn=raw.dn[: middle + _MARGIN]), replace(raw, dn=raw.dn[middle - _MARGIN :])]
    with ThreadPoolExecutor(2) as threads:
        top, bottom = threads.map(part, halves)
    return np.concatenate([top[:middle], bottom[_MARGIN:]])


def exact_frame(
    state: CameraState, places: Places, folder: Path, progress: Callable[[int, int, str], object] | None = None
) -> dict[str, Any]:
    """Compute the exact frame of a state, keep it in a folder for views, and return its facts."""
    found = bench(state, places)
    scene = scene_of(found)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PhotositeWarning)
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
        "warnings": list(dict.fromkeys(str(w.message) for w in caught if isinstance(w.message, PhotositeWarning))),
    }


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


def scene_of(found: Bench) -> Scene:
    """Return the scene of a state, made once."""
    request = found.request
    changed = Path(request.source).stat().st_mtime_ns if request.is_file else 0
    key = (request.source, changed, tuple(sorted((name, str(value)) for name, value in request.options.items())))
    if key not in _scenes:
        while len(_scenes) >= _KEPT_SCENES:
            _scenes.popitem(last=False)
        _scenes[key] = found.scene()
    _scenes.move_to_end(key)
    return _scenes[key]


def _indices(first: int, count: int, shown: int, tile: int, size: int) -> tuple[I64, int]:
    """Return the pixels along an axis, whole tiles in steps of tiles, and the step."""
    first = min(first, size - 1) // tile * tile
    count = max(min(count, size - first), 1)
    step = max(-(-count // max(shown, 1)), 1)
    number = np.arange(-(-count // (tile * step)) * tile)
    index = first + number // tile * (tile * step) + number % tile
    return index[index < size], step


def _shown(found: Bench, view: View, folder: Path) -> Shown:
    state, sensor = found.state, found.camera.sensor
    array, scene = sensor.array, scene_of(found)
    tile = len(array.cfa), len(array.cfa[0])
    height, width = view.height, view.width
    if height * width > MOST_SHOWN:
        shrink = (MOST_SHOWN / (height * width)) ** 0.5
        height, width = int(height * shrink), int(width * shrink)
    steps = [_indices(view.row, view.rows, height, tile[0], array.rows)[1]]
    steps.append(_indices(view.col, view.cols, width, tile[1], array.cols)[1])
    step = max(steps)  # the same on both axes
    rows, _ = _indices(view.row, view.rows, -(-min(view.rows, array.rows) // step), tile[0], array.rows)
    cols, _ = _indices(view.col, view.cols, -(-min(view.cols, array.cols) // step), tile[1], array.cols)
    step = max(int(rows[tile[0]] - rows[0]) // tile[0] if rows.size > tile[0] else 1, 1)

    whole, rate = _kept(_frame_file(folder, state)), _kept(_mean_file(folder, state))
    notes: list[str] = []
    if rate is None:
        light, notes = approximate_rate(found.camera, scene, rows, cols, step)
        mean_e = light * np.float32(state.capture.exposure_s) * _relative_light(found, rows)
        if state.scene.motion is not None:
            notes.append("the preview is without motion")
    else:
        mean_e = found.exposed(_picked(rate, rows, cols))
    of_view = Bench(state, replace(found.camera, sensor=_of_size(sensor, rows.size, cols.size, notes)), found.request)
    contiguous = step == 1 and sensor.effects is None and sensor.captures is None and sensor.maps is None
    exact = whole is not None or (contiguous and rate is not None)
    if whole is not None:
        dn = _picked(whole, rows, cols)
        raw = _template(of_view, scene, tile, dn)
    else:
        if contiguous:
            region = int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1
            raw = found.frame(mean_e, scene, region)
        else:
            raw = of_view.frame(mean_e, scene)
        dn = np.asarray(raw.dn)
        if not state.capture.noise:
            dn = of_view.camera.clean_dn(mean_e)
            raw = _with_numbers(raw, dn)
    return Shown(rows, cols, step, raw, dn.astype(np.float32), mean_e, exact, tuple(notes) if not exact else ())


def _relative_light(found: Bench, rows: I64) -> F32:
    """Return (rows, 1) light of a flickering lamp that reaches rows of the frame, relative to its mean."""
    state = found.state
    if state.scene.flicker is None:
        return np.ones((1, 1), np.float32)
    start_s, exposure_s = found.camera.sensor.row_start_s[rows], state.capture.exposure_s
    light = state.scene.flicker.flicker().integral_s(start_s, start_s + exposure_s) / exposure_s
    return light.astype(np.float32)[:, None]


def _template(of_view: Bench, scene: Scene, tile: tuple[int, int], dn: NDArray[Any]) -> RawFrame:
    """Return a raw frame with the metadata of a state and given digital numbers."""
    small = _of_size(of_view.camera.sensor, 2 * tile[0], 2 * tile[1], [])
    camera = replace(of_view.camera, sensor=small)
    raw = Bench(of_view.state, camera, of_view.request).frame(np.zeros((2 * tile[0], 2 * tile[1]), np.float32), scene)
    return _with_numbers(raw, dn)


def _with_numbers(raw: RawFrame, dn: NDArray[Any]) -> RawFrame:
    """Return a raw frame with other digital numbers, rounded."""
    kind = raw.dn.dtype
    return replace(raw, dn=np.rint(dn).astype(kind) if dn.dtype != kind else np.ascontiguousarray(dn), captures={})


def _picked(whole: NDArray[Any], rows: I64, cols: I64) -> NDArray[Any]:
    """Return the values at rows and columns, contiguous in memory."""
    if rows[-1] - rows[0] + 1 == rows.size and cols[-1] - cols[0] + 1 == cols.size:
        return np.ascontiguousarray(whole[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1])
    return np.ascontiguousarray(whole[rows][:, cols])


def _of_size(sensor: Sensor, rows: int, cols: int, notes: list[str]) -> Sensor:
    """Return the sensor with the view's number of pixels; effects that depend on places in the array are left out."""
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
    """Return approximate mean electrons per second at some pixels of the frame, and what is left out.

    Parameters
    ----------
    camera, scene
        As for `Camera.mean_electrons`.
    rows, cols
        (h,), (w,) pixels of the frame: whole tiles of the color filter array, the same distance apart.
    step
        Distance of the tiles, in tiles.

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
    per_map = coupling.sum(axis=2).astype(np.float32)
    pitch = pitch_m(sensor)
    notes: list[str] = []
    transfer, padding = _transfer(camera, scene, coupling, step, notes)
    sampled_rows = _samples(rows, padding, step, where.row_start, where.row_step, scene.shape[0])
    sampled_cols = _samples(cols, padding, step, where.col_start, where.col_step, scene.shape[1])
    image_of = _channel_images(scene, per_map, sampled_rows, sampled_cols)
    rate = np.empty((rows.size, cols.size), np.float32)
    for channel, name in enumerate(names):
        sites = [(slice(r, None, len(cfa)), slice(c, None, len(cfa[0]))) for r, c in channel_sites(cfa, name)]
        if transfer is None:
            for site in sites:
                rate[site] = image_of(channel, site)
            continue
        image = transfer(image_of(channel, _WHOLE), channel)[
            padding : padding + rows.size, padding : padding + cols.size
        ]
        for site in sites:
            rate[site] = image[site]
    np.maximum(rate, np.float32(0), out=rate)
    y_m = (rows + 0.5 - sensor.array.rows / 2) * pitch[0]
    x_m = (cols + 0.5 - sensor.array.cols / 2) * pitch[1]
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
    """The first and last sample of the scene in each pixel, and the last one's share."""

    first: I64
    last: I64
    share: F32

    def at(self, part: slice) -> _Samples:
        """Return those of some pixels."""
        return _Samples(self.first[part], self.last[part], self.share[part])


def _samples(pixels: I64, padding: int, step: int, start: float, per_pixel: float, size: int) -> _Samples:
    """Return the samples in pixels and in padding on both sides; beyond the scene, those of its border."""
    if padding:
        extra = np.arange(1, padding + 1) * step
        pixels = np.concatenate([pixels[0] - extra[::-1], pixels, pixels[-1] + extra])
    begin = start + per_pixel * pixels
    first, last = (np.floor(place).astype(np.int64) for place in (begin + 1e-9, begin + per_pixel - 1e-9))
    share = np.where(last > first, np.clip((begin + per_pixel - last) / per_pixel, 0.0, 1.0), 0.0)
    share[last > first + 1] = 0.5
    return _Samples(np.clip(first, 0, size - 1), np.clip(last, 0, size - 1), share.astype(np.float32))


def _sampled(maps: F32, rows: _Samples, cols: _Samples) -> F32:
    """Return (K, h, w) means of (K, rows, cols) maps over pixels, from two samples on each axis."""
    lines = np.take(maps, rows.first, axis=1)
    if rows.share.any():
        lines += (np.take(maps, rows.last, axis=1) - lines) * rows.share[:, None]
    values = np.take(lines, cols.first, axis=2)
    if cols.share.any():
        following = np.take(lines, cols.last, axis=2)
        following -= values
        following *= cols.share
        values += following
    return values


_gathered: OrderedDict[tuple[Any, ...], tuple[Scene, F32]] = OrderedDict()


_WHOLE = slice(None), slice(None)

_OfChannel = Callable[[int, tuple[slice, slice]], F32]


def _channel_images(scene: Scene, per_map: F32, rows: _Samples, cols: _Samples) -> _OfChannel:
    """Return a function of a channel and a part of the pixels, which returns its electrons per second there."""
    maps = scene.weights
    if maps[0].size <= rows.first.size * cols.first.size:
        images = (per_map @ maps.reshape(len(maps), -1)).reshape(-1, *maps.shape[1:])

        def sampled(channel: int, part: tuple[slice, slice]) -> F32:
            found: F32 = _sampled(images[channel : channel + 1], rows.at(part[0]), cols.at(part[1]))[0]
            return found

        return sampled
    key = (id(scene), *(part.tobytes() for of_axis in (rows, cols) for part in of_axis))
    if key not in _gathered:
        while len(_gathered) >= _KEPT_SCENES:
            _gathered.popitem(last=False)
        _gathered[key] = scene, _sampled(maps, rows, cols)  # with the scene, so that its id stays its own
    few = _gathered[key][1]

    def mixed(channel: int, part: tuple[slice, slice]) -> F32:
        return np.asarray(np.tensordot(per_map[channel], few[:, part[0], part[1]], axes=1), np.float32)

    return mixed


_Transfer = Callable[[F32, int], F32]


def _transfer(
    camera: Camera, scene: Scene, coupling: NDArray[np.float64], step: int, notes: list[str]
) -> tuple[_Transfer | None, int]:
    """Return the blur of lens and photodetector for the mean spectrum, and its reach in pixels of the view.

    None where the blur is too small to be seen.
    """
    spread, sensor = camera.optics.point_spread(scene.distance_m), camera.sensor
    if scene.shape == (1, 1):
        return None, 0
    if not isinstance(spread, RadialPsf):
        notes.append("the preview is without the lens's blur")
        return None, 0
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
        return None, 0
    reach = max(spread.reach_m(float(grid[w])) for w in few)
    padding = int(min(np.ceil(0.3 * reach / (step * min(pitch))) + 1, _MOST_PADDING))
    side = float(np.sqrt(sensor.pixel.fill_factor.value))

    spacing = step * pitch[0], step * pitch[1]

    def blurred(image: F32, channel: int) -> F32:
        shape = tuple(scipy.fft.next_fast_len(n, real=True) for n in image.shape)
        response = _response(table[channel].tobytes(), longest, shape, spacing, (pitch[0] * side, pitch[1] * side))
        spectrum = scipy.fft.rfft2(image, s=shape, workers=-1)  # what is beyond the padding does not reach the view
        spectrum *= response
        found: F32 = scipy.fft.irfft2(spectrum, s=shape, workers=-1, overwrite_x=True)
        return found[: image.shape[0], : image.shape[1]]

    return blurred, padding


@lru_cache(maxsize=8)
def _response(
    table: bytes, longest: float, shape: tuple[int, ...], spacing: tuple[float, float], sides: tuple[float, float]
) -> F32:
    """Return the transfer of lens and photodetector at the frequencies of a transform.

    `table` holds the lens's at frequencies from 0 to `longest`, `sides` are those of the photodetector in m.
    """
    fy = np.fft.fftfreq(shape[0], spacing[0]).astype(np.float32)
    fx = np.fft.rfftfreq(shape[1], spacing[1]).astype(np.float32)
    place = np.sqrt(fy[:, None] ** 2 + fx**2)
    place *= np.float32((_TABLE - 1) / longest)
    found: F32 = np.frombuffer(table).astype(np.float32)[place.astype(np.int32)]
    found *= np.sinc(fy * np.float32(sides[0])).astype(np.float32)[:, None]
    found *= np.sinc(fx * np.float32(sides[1])).astype(np.float32)
    return found


# What the page writes beside the picture.


def _header(found: Bench, shown: Shown, view: View, folder: Path) -> dict[str, Any]:
    sensor, taken = found.camera.sensor, found.state.capture
    at = sensor if taken.temperature_c is None else sensor.at_temperature(taken.temperature_c)
    capacity = light_capacity_e(at, taken.exposure_s) if sensor.captures is None else float(shown.mean_e.max()) + 1.0
    array, raw = sensor.array, shown.raw
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
        "black_level_dn": raw.black_level_dn,
        "white_level_dn": raw.white_level_dn,
        "bits": raw.bits,
        "response": _response_table(sensor),
        "saturation_e": capacity,
        "sensor": sensor.name,
        "scene": scene_of(found).name,
        "exposure_s": taken.exposure_s,
        "snr": _snr_table(at, taken.exposure_s, max(capacity, 1.0)),
        "histogram": _histogram(shown, array.cfa),
        "saturated_fraction": float((shown.dn >= raw.white_level_dn).mean()),
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


def _histogram(shown: Shown, cfa: tuple[tuple[str, ...], ...]) -> dict[str, Any]:
    """Return counts of digital numbers by channel, in bins of equal width from 0 to the white level."""
    top = shown.raw.white_level_dn + 1.0
    counts: dict[str, list[int]] = {}
    scaled = (shown.dn * np.float32(HISTOGRAM_BINS / top)).astype(np.int32)
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
    return {"region": list(region), "exact": whole is not None or shown.exact, "channels": channels}
