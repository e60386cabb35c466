"""The noise of a preview whose pixels are means: normally distributed, as the simulated pixels at some signals."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.app.kept_scenes import add_kept
from photosite.app.preview_sensor import with_sensor_size
from photosite.app.state import PreparedState
from photosite.engine.jit import compiled
from photosite.engine.threads import parallel_for
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


_LEVELS, _PER_LEVEL = 64, 512
"""Signals at which the mean and the noise of a pixel are estimated, and pixels of a row of each."""


def averaged_numbers(found: PreparedState, scene: Scene, mean_e: F32, step: int) -> F32:
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


def _pixels_at_levels(found: PreparedState, scene: Scene, top: float) -> tuple[F64, F64]:
    """Return mean and standard deviation of digital numbers at squares of even steps from 0 to `top` electrons.

    Noise of rows and columns is left out.
    """
    sensor = found.camera.sensor
    key = (id(sensor), found.state.capture.model_dump_json(), top)
    if key not in _at_levels:
        levels = top * np.linspace(0.0, 1.0, _LEVELS) ** 2
        tile = len(sensor.array.cfa), len(sensor.array.cfa[0])
        sample = with_sensor_size(found, _LEVELS * tile[0], _PER_LEVEL * tile[1], [])
        if any(lines_mv := _line_noise_mv(sensor)):
            alone_mv = max(sensor.noise.read_noise_mv.value**2 - lines_mv[0] ** 2 - lines_mv[1] ** 2, 0.0) ** 0.5
            alone = sample.camera.sensor.with_(row_noise_mv=0, column_noise_mv=0, read_noise_mv=alone_mv)
            sample = PreparedState(found.state, replace(sample.camera, sensor=alone), found.request)
        mosaic = np.repeat(levels.astype(np.float32), tile[0])[:, None] * np.ones(_PER_LEVEL * tile[1], np.float32)
        drawn = np.asarray(sample.frame(mosaic, scene).dn, np.float64).reshape(_LEVELS, -1)
        add_kept(_at_levels, key, (sensor, drawn.mean(axis=1), drawn.std(axis=1)))
    return _at_levels[key][1:]


@lru_cache(maxsize=2)
def _normal(seed: int, shape: tuple[int, int]) -> F32:
    return np.random.default_rng(seed).standard_normal(shape, np.float32)


def _with_noise(
    mean_e: F32, top: float, mean_dn: NDArray[np.float64], spread_dn: NDArray[np.float64], normal: F32
) -> F32:
    """Return mean digital numbers plus noise; both are given at the squares of even steps from 0 to `top`."""
    out = np.empty(mean_e.shape, np.float32)
    parallel_for(_add_noise, len(out), mean_e, top, mean_dn, spread_dn, normal, out)
    return out


@compiled()
def _add_noise(
    start: int,
    stop: int,
    mean_e: F32,
    top: float,
    mean_dn: NDArray[np.float64],
    spread_dn: NDArray[np.float64],
    normal: F32,
    out: F32,
) -> None:
    cols = mean_e.shape[1]
    last = mean_dn.size - 1
    for r in range(start, stop):
        for c in range(cols):
            place = np.sqrt(max(mean_e[r, c], 0.0) / top) * last
            k = min(int(place), last - 1)
            share = place - k
            value = mean_dn[k] + share * (mean_dn[k + 1] - mean_dn[k])
            out[r, c] = value + (spread_dn[k] + share * (spread_dn[k + 1] - spread_dn[k])) * normal[r, c]
