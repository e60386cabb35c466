"""Signals of a spectral measurement: digital numbers of the bands above dark, and their covariance."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, CLIPPED_FRACTION, Level
from photosite.calibration.spectral.bands import Band, SpectralFrames
from photosite.calibration.withheld import UNUSABLE_SPECTRAL_FRAMES
from photosite.engine.frame_sums import FrameSums
from photosite.errors import FileError
from photosite.frames.frame_set import FrameSource
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names, shifted
from photosite.values.region import Region

_Pairs = list[tuple[tuple[Level, ...], tuple[Level, ...]]]
"""Levels of each band's light frames and dark frames, by channel."""

_NEAR_FULL = 3.0
"""Standard deviations of a pixel by which a mean must stay below the well capacity."""


@dataclass(frozen=True, eq=False)
class SpectralSignals:
    """Signals by channel (in the order of the sensor's channels) and band.

    Parameters
    ----------
    signal_dn, covariance_dn2
        (channels, bands) mean above the dark, and its covariance (channels, bands, bands): frame noise, flicker, and
        dark frames that bands share.
    reasons
        Why a channel cannot use a band, by channel and band; empty if it can.
    flicker, sha256
        Relative standard deviation of the light between frames, 0 if not distinguishable from a steady light; digest of
        each frame's digital numbers, sorted.
    """

    signal_dn: NDArray[np.float64]
    covariance_dn2: NDArray[np.float64]
    reasons: tuple[tuple[str, ...], ...]
    flicker: float
    sha256: tuple[str, ...]


class _Reader:
    """Reads groups of frames into levels, one per channel. Counts and hashes the frames."""

    def __init__(self, frames: SpectralFrames, progress: Callable[[int, int], None] | None) -> None:
        self._frames = frames
        self._progress = progress
        self._region = region = frames.region or Region("frame", 0, frames.rows, 0, frames.cols)
        names = channel_names(frames.cfa)
        tile = shifted(frames.cfa, region.r0, region.c0)
        self._labels = np.array([[names.index(name) for name in row] for row in tile], np.int64)
        self.sha256: list[str] = []

    def levels(self, sources: tuple[FrameSource, ...]) -> tuple[Level, ...]:
        region = self._region
        sums = FrameSums(region.shape, self._labels, white=(1 << self._frames.bits) - 1)
        seen: dict[str, str] = {}
        for source in sources:
            dn = source.read()
            if dn.shape != (self._frames.rows, self._frames.cols):
                expected = f"{self._frames.rows, self._frames.cols}, as for the other frames"
                raise FileError(source.name, "the frame's shape", value=dn.shape, expected=expected)
            digest = hashlib.sha256(np.ascontiguousarray(dn, dtype="<u2").data).hexdigest()
            if digest in seen:
                what = f"the frame equals {seen[digest]} in every pixel"
                raise FileError(source.name, what, hint="Remove one of them")
            seen[digest] = source.name
            self.sha256.append(digest)
            sums.add(np.ascontiguousarray(dn[region.r0 : region.r1, region.c0 : region.c1]))
            if self._progress is not None:
                self._progress(len(self.sha256), self._frames.frame_count)
        return tuple(Level.of(totals) for totals in sums.label_totals())


def read_signals(
    frames: SpectralFrames, sensor: Sensor, progress: Callable[[int, int], None] | None = None
) -> SpectralSignals:
    """Read a spectral measurement's frames; errors as for `calibrate_spectral`."""
    reader = _Reader(frames, progress)
    darks = {exposure_s: reader.levels(sources) for exposure_s, sources in sorted(frames.darks.items())}
    _check_darks(frames, darks)
    lights = [reader.levels(band.frames) for band in frames.bands]
    black_shift2 = _black_shift2(darks)
    channels = range(len(channel_names(frames.cfa)))
    paired = [(levels, darks[band.exposure_s]) for band, levels in zip(frames.bands, lights, strict=True)]
    flicker2 = _flicker2(paired, black_shift2)
    signal = np.array([[light[c].mean - dark[c].mean for light, dark in paired] for c in channels])
    covariance = np.stack([_covariance(frames.bands, paired, c, flicker2, black_shift2) for c in channels])
    reasons = tuple(tuple(_reason(light[c], dark[c], sensor) for light, dark in paired) for c in channels)
    return SpectralSignals(signal, covariance, reasons, math.sqrt(flicker2), tuple(sorted(reader.sha256)))


def _check_darks(frames: SpectralFrames, darks: dict[float, tuple[Level, ...]]) -> None:
    for exposure_s, levels in darks.items():
        for level, name in zip(levels, channel_names(frames.cfa), strict=True):
            if level.pixels < 2:
                where = f"{frames.source}: channel {name}"
                raise UNUSABLE_SPECTRAL_FRAMES.error(
                    "pixels in the region", where=where, value=level.pixels, expected="at least 2"
                )
            if level.low_fraction > CLIPPED_DARK_FRACTION:
                raise UNUSABLE_SPECTRAL_FRAMES.error(
                    f"{100 * level.low_fraction:.3g} % of the dark values at {exposure_s:g} s are clipped at 0, which "
                    "makes the measured signal too small",
                    where=frames.source,
                    hint="Raise the camera's black level",
                )


def _excess(level: Level) -> tuple[float, float]:
    """Return the variance of the frame means beyond the pixels' noise, and the weight of that estimate."""
    explained = level.variance / level.pixels
    return math.copysign(level.frame_shift**2, level.frame_shift), (level.frames - 1) / (2 * explained**2)


def _black_shift2(darks: dict[float, tuple[Level, ...]]) -> float:
    """Return the variance of the black level between frames, DN^2; 0 if not distinguishable from a constant level."""
    found = [_excess(level) for levels in darks.values() for level in levels if level.repeated and level.variance > 0]
    total = sum(weight for _, weight in found)
    return max(sum(value * weight for value, weight in found) / total, 0.0) if total else 0.0


def _flicker2(paired: _Pairs, black_shift2: float) -> float:
    """Return the relative variance of the light between frames, fitted by least squares; 0 if it is negative."""
    above = below = 0.0
    for light, dark in paired:
        for level, black in zip(light, dark, strict=True):
            if not level.repeated or not level.variance > 0 or level.clipped:
                continue
            square = (level.mean - black.mean) ** 2
            value, weight = _excess(level)
            above += weight * square * (value - black_shift2)
            below += weight * square**2
    return max(above / below, 0.0) if below else 0.0


def _mean_variance(level: Level) -> float:
    """Return the sampling variance of a mean. A single frame uses the spread over pixels, which is larger."""
    return level.mean_variance if level.repeated else level.spatial_variance / level.pixels


def _covariance(
    bands: tuple[Band, ...], paired: _Pairs, channel: int, flicker2: float, black_shift2: float
) -> NDArray[np.float64]:
    """Return the covariance (bands, bands), DN^2. Bands of one exposure time share their dark frames."""
    result = np.zeros((len(bands), len(bands)))
    for row, (light, dark) in enumerate(paired):
        level, black = light[channel], dark[channel]
        signal = level.mean - black.mean
        result[row, row] += _mean_variance(level) + (flicker2 * signal**2 + black_shift2) / level.frames
        shared = _mean_variance(black) + black_shift2 / black.frames
        for col, other in enumerate(bands):
            if other.exposure_s == bands[row].exposure_s:
                result[row, col] += shared
    return result


def _reason(light: Level, dark: Level, sensor: Sensor) -> str:
    """Return why a channel cannot use a band; empty if it can."""
    if light.high_fraction > CLIPPED_FRACTION:
        return f"{100 * light.high_fraction:.3g} % of its pixels are saturated; use a shorter exposure time"
    well = sensor.pixel.well_capacity_e
    spread_dn = math.sqrt(max(light.spatial_variance, 0.0))
    full_dn = well.value * sensor.system_gain_dn_per_e
    if not well.assumed and light.mean - dark.mean + _NEAR_FULL * spread_dn > full_dn:
        return f"its signal of {light.mean - dark.mean:.4g} DN reaches the well capacity; use a shorter exposure time"
    return ""
