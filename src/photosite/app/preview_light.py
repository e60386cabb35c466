"""The light of a preview: approximate mean electrons of the pixels in view.

The light is sampled at these pixels, or averaged over blocks, and blurred with the mean spectrum, without distortion,
glare and crosstalk.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.app.kept_scenes import KEPT_SCENES, add_kept
from photosite.app.state import PreparedState
from photosite.camera.camera import Camera
from photosite.camera.mean_image import electrons_per_weight, pitch_m, placement
from photosite.engine.mosaic_means import block_start
from photosite.optics.point_spread import RadialPsf
from photosite.scene.scene import Scene
from photosite.values.cfa import channel_sites

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

_SHARP = 0.8
"""The preview leaves out a blur whose transfer is above this at half the sampling frequency of the view."""
_TABLE = 512
_MOST_PADDING = 96
_PADDING_STEP = 16
"""Paddings are multiples of this, so that a small change of the blur changes none."""


_rates: OrderedDict[tuple[Any, ...], tuple[F32, list[str]]] = OrderedDict()


def preview_rate(found: PreparedState, scene: Scene, rows: I64, cols: I64, step: int) -> tuple[F32, list[str]]:
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


def relative_light(found: PreparedState, rows: I64, step: int) -> F32:
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
        add_kept(_gathered, key, (scene, _sampled(maps, rows, cols)), KEPT_SCENES)
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
            add_kept(_spectra, key, (image_of.scene, of_image), _KEPT_SPECTRA)
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
