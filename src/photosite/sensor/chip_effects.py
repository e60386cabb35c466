"""Effects of `photosite.sensor.effects` that belong to the pixels of a drawn chip: defects, hot and blinking pixels.

Which pixels have an effect, and its size there, is drawn from the serial; a larger fraction contains the pixels of a
smaller one. What changes from frame to frame depends on the seed and the frame number alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import read_only
from photosite.engine.pixel_draws import chosen_pixels, single_deviate, telegraph_states
from photosite.engine.pixel_model import DEVIATE_STEP, Exposure, line_deviates
from photosite.engine.random_numbers import DEFECTS, DRIFT, HOT_PIXELS, LINE_PATTERN, TELEGRAPH, key_from_seed
from photosite.sensor.chip import Blinking, read_noise_deviates, serial_seed
from photosite.sensor.effects.black_level_drift import BlackLevelDrift
from photosite.sensor.effects.glow import Glow
from photosite.sensor.effects.hot_pixels import HotPixels
from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.effects.pixel_defects import PixelDefects
from photosite.sensor.effects.read_noise_spread import ReadNoiseSpread
from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.sensor.model import Sensor
from photosite.sensor.shot import Part
from photosite.values.region import Border

FloatMap = NDArray[np.float32]
_Floats = NDArray[np.float64]
_Numbers = NDArray[np.int64]
_SINGLE, _COLUMNS, _CLUSTERS = range(3)


@lru_cache(maxsize=16)
def _chosen(serial: str, pixels: int, fraction: float, use: int, series: int = 0) -> tuple[_Numbers, _Floats]:
    """Return the pixels that the serial chooses, and three uniform numbers of each."""
    numbers, values = chosen_pixels(pixels, fraction, np.uint32(use), series, *key_from_seed(serial_seed(serial)))
    numbers.flags.writeable = values.flags.writeable = False
    return numbers, values


def _of_chip(sensor: Sensor, fraction: float, use: np.uint32) -> tuple[_Numbers, _Floats]:
    return _chosen(sensor.serial, sensor.array.rows * sensor.array.cols, fraction, int(use))


def _within(numbers: _Numbers, cols: int, part: Part) -> tuple[NDArray[np.bool_], tuple[_Numbers, _Numbers]]:
    """Return which pixels are in a rectangle, and the row and column of these in it."""
    row, col = numbers // cols - part[0].start, numbers % cols - part[1].start
    inside = (row >= 0) & (row < part[0].stop - part[0].start) & (col >= 0) & (col < part[1].stop - part[1].start)
    return inside, (row[inside], col[inside])


def whole(values: FloatMap, part: Part) -> FloatMap:
    """Return a map with a value for each pixel of the rectangle: itself, or a copy if it is shared or one value."""
    shape = part[0].stop - part[0].start, part[1].stop - part[1].start
    if values.shape == shape and values.flags.writeable:
        return values
    return np.array(np.broadcast_to(values, shape))


def _normal(uniform: _Floats) -> _Floats:
    from scipy.special import ndtri

    return np.asarray(ndtri(uniform))


def add_hot_pixels(rate: FloatMap, hot: HotPixels, sensor: Sensor, part: Part) -> None:
    """Add the dark current of hot pixels to the map of a rectangle."""
    numbers, values = _of_chip(sensor, hot.fraction.value, HOT_PIXELS)
    inside, place = _within(numbers, sensor.array.cols, part)
    rate[place] += (hot.median_e_per_s.value * np.exp(hot.log_spread.value * _normal(values[0, inside]))).astype(
        np.float32
    )


@lru_cache(maxsize=2)
def _glow_map(glow: Glow, rows: int, cols: int) -> FloatMap:
    return read_only(glow.map(rows, cols))


def add_glow(rate: FloatMap, glow: Glow, sensor: Sensor, part: Part) -> None:
    """Add the glow to the dark current of a rectangle."""
    rate += _glow_map(glow, sensor.array.rows, sensor.array.cols)[part]


def fixed_lines(pattern: LinePattern, serial: str, part: Part) -> tuple[_Floats, _Floats, _Floats]:
    """Return the offsets of the rows and of the columns of a rectangle in electrons, and the columns' relative gains.

    An effect of size 0 has one value for all lines, except for the gains.
    """
    key = key_from_seed(serial_seed(serial))

    def drawn(lines: slice, word: int, spread: float) -> _Floats:
        count = lines.stop - lines.start
        return spread * line_deviates(lines.start, count, LINE_PATTERN, word, np.uint32(0), *key)

    row_e, column_e = (
        drawn(lines, word, size.value) if size.value else np.zeros(1)
        for word, (lines, size) in enumerate(zip(part, (pattern.row_offset_e, pattern.column_offset_e), strict=True))
    )
    gain = 1.0 + drawn(part[1], 2, pattern.column_gain_percent.value / 100.0)
    return row_e, column_e, np.maximum(gain, 0.0)


def dead_pixels(defects: PixelDefects, sensor: Sensor) -> _Numbers:
    """Return the numbers of the pixels without response to light that are drawn from the serial."""
    rows, cols = sensor.array.rows, sensor.array.cols
    single = _of_chip(sensor, defects.dead_fraction, DEFECTS)[0]
    # The columns with the smallest numbers: as many different ones as wanted
    ranks = _chosen(sensor.serial, cols, 1.0, int(DEFECTS), _COLUMNS)[1][0]
    columns = np.argsort(ranks)[: defects.dead_columns]
    lines = (np.arange(rows)[:, None] * cols + columns).ravel()
    _, at = _chosen(sensor.serial, defects.clusters, 1.0, int(DEFECTS), _CLUSTERS)
    center = (at[:2] * np.array([[rows], [cols]])).astype(np.int64)
    reach = math.isqrt(defects.cluster_pixels) + 1
    step = np.stack(np.meshgrid(*2 * [np.arange(-reach, reach + 1)], indexing="ij")).reshape(2, -1)
    step = step[:, np.argsort((step**2).sum(axis=0), kind="stable")[: defects.cluster_pixels]]
    row, col = (center[:, :, None] + step[:, None]).reshape(2, -1)
    on_chip = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    return np.unique(np.concatenate([single, lines, (row * cols + col)[on_chip]]))


def set_dead_pixels(prnu: FloatMap, defects: PixelDefects, sensor: Sensor, part: Part) -> None:
    """Set the relative deviation of the response of dead pixels in the map of a rectangle."""
    prnu[_within(dead_pixels(defects, sensor), sensor.array.cols, part)[1]] = -1.0
    for rectangle, value in _listed(defects, "dead", part):
        prnu[rectangle] = (value or 0.0) - 1.0


def border_parts(border: Border, sensor: Sensor, part: Part) -> list[Part]:
    """Return the rectangles within a rectangle that together are its fraction of the border of the array."""
    top, bottom, left, right = border
    ends = ((top, sensor.array.rows - bottom), (left, sensor.array.cols - right))
    lines = [
        (slice(0, max(first - side.start, 0)), slice(max(last - side.start, 0), None))
        for (first, last), side in zip(ends, part, strict=True)
    ]
    return [(rows, slice(None)) for rows in lines[0]] + [(slice(None), cols) for cols in lines[1]]


def add_listed_hot(rate: FloatMap, defects: PixelDefects, part: Part) -> None:
    """Add the dark current of the listed hot pixels to the map of a rectangle."""
    for place, value in _listed(defects, "hot", part):
        rate[place] += np.float32(value or 0.0)


def stuck_pixels(defects: PixelDefects, sensor: Sensor) -> tuple[_Numbers, _Floats]:
    """Return the numbers of stuck pixels that are drawn from the serial, and their digital numbers."""
    # Those that the dead pixels leave over: the next numbers of the same draw
    fraction = min(defects.dead_fraction + defects.stuck_fraction, 1.0)
    numbers, values = _of_chip(sensor, fraction, DEFECTS)
    stuck = ~np.isin(numbers, _of_chip(sensor, defects.dead_fraction, DEFECTS)[0])
    return numbers[stuck], np.floor(values[0, stuck] * (sensor.white_level_dn + 1.0))


def stuck_numbers(
    defects: PixelDefects, sensor: Sensor, part: Part, output_dn: NDArray[np.uint16]
) -> tuple[_Numbers, NDArray[np.uint16]]:
    """Return the stuck pixels of a rectangle, each once, and their numbers behind a table of more than one entry.

    Returns (n, 2) rows and columns in the rectangle, and (n,) digital numbers.
    """
    numbers, values = stuck_pixels(defects, sensor)
    inside, place = _within(numbers, sensor.array.cols, part)
    output = output_dn if output_dn.size > 1 else np.arange(65536, dtype=np.uint16)
    places, of_places = [np.stack(place, axis=1)], [output[values[inside].astype(np.uint16)]]
    for (rows, cols), value in _listed(defects, "stuck", part):
        of_lines = np.meshgrid(*(np.arange(lines.start, lines.stop) for lines in (rows, cols)), indexing="ij")
        places.append(np.stack(of_lines, axis=-1).reshape(-1, 2))
        of_places.append(np.full(len(places[-1]), output[int(sensor.white_level_dn if value is None else value)]))
    # Listed ones replace drawn ones.
    last_first, found = np.concatenate(places)[::-1], np.concatenate(of_places)[::-1]
    once = np.unique(last_first @ [part[1].stop - part[1].start, 1], return_index=True)[1]
    return read_only(last_first[once]), read_only(found[once])


def _listed(defects: PixelDefects, kind: str, part: Part) -> Iterator[tuple[Part, float | None]]:
    """Yield the listed defects of a kind in a rectangle, as rows and columns of it, with their values."""
    for one in defects.listed:
        if one.kind == kind:
            row, col = (
                slice(max(first - side.start, 0), max(min(last + 1, side.stop) - side.start, 0))
                for (first, last), side in zip((one.rows, one.cols), part, strict=True)
            )
            yield (row, col), one.value


def noise_ratio(spread: ReadNoiseSpread, sensor: Sensor, part: Part) -> FloatMap:
    """Return the read noise of the pixels of a rectangle over its root mean square."""
    deviates = read_noise_deviates(sensor.serial, sensor.array.rows, sensor.array.cols)[part]
    return spread.relative(deviates * np.float32(DEVIATE_STEP)).astype(np.float32)


def telegraph_pixels(noise: TelegraphNoise, sensor: Sensor) -> tuple[_Numbers, _Floats, _Floats]:
    """Return numbers (n,), distances of the levels in electrons, and fractions of time in the upper one."""
    numbers, values = _of_chip(sensor, noise.fraction, TELEGRAPH)
    amplitude_e = np.full(len(numbers), noise.amplitude_e)
    if noise.amplitudes == "exponential":
        amplitude_e *= -np.log(values[0])
    high = values[1].copy() if noise.high_fraction is None else np.full(len(numbers), noise.high_fraction)
    return numbers, amplitude_e, high


def add_telegraph_noise(
    offset_e: FloatMap, noise: TelegraphNoise, sensor: Sensor, part: Part, exposure: Exposure
) -> None:
    """Add the states of blinking pixels in one frame to the offsets of a rectangle; their mean over frames is 0."""
    numbers, amplitude_e, high = telegraph_pixels(noise, sensor)
    inside, place = _within(numbers, sensor.array.cols, part)
    keep = math.exp(-1.0 / noise.correlation_frames) if noise.correlation_frames else 0.0
    offset_e[place] += _shift(numbers[inside], amplitude_e[inside], high[inside], keep, exposure)


def add_measured_blinking(
    offset_e: FloatMap, blinking: Blinking, gain: _Floats, cols: int, part: Part, exposure: Exposure
) -> tuple[NDArray[np.bool_], tuple[_Numbers, _Numbers]]:
    """Add the states of a measured chip's blinking pixels; return which are in the rectangle, and where.

    `gain` is that of each of them.
    """
    numbers = blinking.row * cols + blinking.col
    inside, place = _within(numbers, cols, part)
    amplitude_e = blinking.amplitude_dn[inside] / gain[inside]
    offset_e[place] += _shift(numbers[inside], amplitude_e, blinking.high_fraction[inside], 0.0, exposure)
    return inside, place


def _shift(numbers: _Numbers, amplitude_e: _Floats, high: _Floats, keep: float, exposure: Exposure) -> FloatMap:
    high = np.ascontiguousarray(high)
    states = telegraph_states(np.ascontiguousarray(numbers), high, keep, exposure.frame, exposure.k0, exposure.k1)
    return (amplitude_e * (states - high)).astype(np.float32)


def drift_e(drift: BlackLevelDrift, exposure: Exposure) -> float:
    """Return the black level's deviation in one frame, electrons.

    A sum of steps that are held for 1, 2, 4, ... frames has a spectrum of about 1/f between the shortest and the
    longest (M. Gardner, "White and brown music, fractal curves and one-over-f fluctuations", Scientific American 238
    (1978) 16, who gives R. Voss as the source). Each step starts at a frame that is drawn from the seed.
    """
    total = 0.0
    for octave in range(drift.octaves):
        start = abs(single_deviate(octave, 0, DRIFT, exposure.k0, exposure.k1))
        shift = int(start % 1.0 * 2.0**octave)
        held = (int(exposure.frame) + shift >> octave) + 1
        total += single_deviate(octave, held & 0xFFFFFFFF, DRIFT, exposure.k0, exposure.k1)
    return total * drift.standard_deviation_e / math.sqrt(drift.octaves)
