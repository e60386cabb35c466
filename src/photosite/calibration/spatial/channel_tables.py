"""Gains and offsets of readout channels, from the periodic structure and the steps of mean frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.periodic_structure import PeriodicStructure, Taps
from photosite.engine.lazy_maps import ConstantMap, LazyMap, Map, row_strips
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.uncertain import Measured, Uncertain, Value

_FROM_FLATS, _FROM_DARKS = "measured from flat fields", "measured from dark frames"


def measured_channels(
    light: PeriodicStructure | None, dark: PeriodicStructure | None, taps: Sequence[Taps], gain: Value
) -> ReadoutChannels | None:
    """Return the readout channels, if their gains or offsets differ; the mean gain is 1, the mean offset 0.

    Columns or rows that alternate are one arrangement, halves or quadrants the other. A sensor file holds one of them:
    None if there are both.

    Parameters
    ----------
    light, dark
        Periodic structure of flat fields and of dark frames, if there is any.
    taps
        Steps between halves or quadrants.
    gain
        System gain, for the offsets in electrons.

    Examples
    --------
    >>> alternating = PeriodicStructure(np.array([[1.01, 0.99], [1.01, 0.99]]), 0.001, 0.0002)
    >>> measured_channels(alternating, None, (), Uncertain(0.5)).tables()[0].tolist()
    [[1.01, 0.99]]
    """
    if light is not None and (light.is_mosaic() or not light.by_lines):
        light = None
    if dark is not None and not dark.by_lines:
        dark = None
    if (light is None and dark is None) == (not taps):
        return None
    if not taps:
        gains = None if light is None else _table(light.channel_table, light.uncertainty, _FROM_FLATS)
        offsets = None
        if dark is not None and isinstance(gain, Uncertain):
            offsets = _table(dark.channel_table / gain.value, dark.uncertainty / gain.value, _FROM_DARKS)
        return _of(gains, offsets, "tile")
    gains = offsets = None
    for found in taps:
        spread = found.uncertainty / math.sqrt(2.0)  # of a level, from that of a step between two
        if not found.dark:
            gains = _table(1.0 + found.level, spread, _FROM_FLATS)
        elif isinstance(gain, Uncertain):
            offsets = _table(found.level / gain.value, spread / gain.value, _FROM_DARKS)
    return _of(gains, offsets, "blocks")


_Table = tuple[tuple[Measured, ...], ...]


def _table(values: NDArray[np.float64], uncertainty: float, source: str) -> _Table:
    return tuple(tuple(Measured(float(value), uncertainty, source) for value in row) for row in values)


def _of(gains: _Table | None, offsets: _Table | None, arrangement: str) -> ReadoutChannels | None:
    """Return the channels with both tables repeated to one size; None without either."""
    tables = [table for table in (gains, offsets) if table is not None]
    if not tables:
        return None
    rows, cols = (math.lcm(*sizes) for sizes in zip(*((len(t), len(t[0])) for t in tables), strict=True))

    def repeated(table: _Table | None) -> _Table | None:
        if table is None:
            return None
        return tuple(row * (cols // len(row)) for row in table) * (rows // len(table))

    gains, offsets = repeated(gains), repeated(offsets)
    if gains is not None and offsets is not None:  # a channel multiplies its offset by its gain
        offsets = tuple(
            tuple(
                Measured(offset.value / gain.value, offset.standard_uncertainty / gain.value, offset.source)
                for offset, gain in zip(*row, strict=True)
            )
            for row in zip(offsets, gains, strict=True)
        )
    return ReadoutChannels.model_validate({"arrangement": arrangement, "relative_gain": gains, "offset_e": offsets})


@dataclass(frozen=True, eq=False)
class _AlikeMap(LazyMap):
    """A mean frame as with readout channels that are alike; `groups` are those of its rows and columns."""

    mean: Map
    dark: Map | None
    tables: tuple[NDArray[np.float64], NDArray[np.float64]]
    groups: tuple[NDArray[np.int64], NDArray[np.int64]]

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of rows and columns."""
        return self.mean.shape

    def __getitem__(self, part: Any, /) -> NDArray[np.float64]:
        rows, cols = part if isinstance(part, tuple) else (part, slice(None))
        gain, offset = (table[np.ix_(self.groups[0][rows], self.groups[1][cols])] for table in self.tables)
        mean = self.mean[rows, cols]
        if self.dark is None:
            return np.asarray(mean - gain * offset)
        dark = self.dark[rows, cols]
        return np.asarray((mean - dark) / gain + dark - offset)


def without_channels(mean: Map, channels: ReadoutChannels | None, dark: Map | None = None) -> Map:
    """Return a mean frame as with readout channels that are alike; their offsets are in DN.

    Parameters
    ----------
    mean
        (rows, cols) mean dark frame, or mean flat field with the mean frame `dark`.
    channels
        The channels; None if they are alike.
    """
    if channels is None:
        return mean
    gain, offset = channels.tables()
    return _AlikeMap(mean, dark, (gain, offset), channels.groups(mean.shape[0], mean.shape[1]))


def alike_levels(dark: Map, channels: ReadoutChannels) -> Map:
    """Return a mean dark frame less the mean of each readout channel, with gains that are alike.

    The means are those of the frame, not the offsets of `channels`, which are 0 where they are within chance.
    """
    (rows, cols), gain = channels.groups(*dark.shape), channels.tables()[0]
    total, within = np.zeros(gain.shape), (cols[:, None] == np.arange(gain.shape[1])).astype(np.float64)
    for first, last in row_strips(dark):
        np.add.at(total, rows[first:last], dark[first:last] @ within)
    means = total / np.outer(np.bincount(rows), np.bincount(cols))
    return _AlikeMap(dark, ConstantMap(dark.shape), (gain, means / gain), (rows, cols))


def alike_slopes(slopes: Map, channels: ReadoutChannels | None) -> Map:
    """Return a map of slopes against exposure as with readout channels that are alike."""
    if channels is None or channels.relative_gain is None:
        return slopes
    gains = channels.model_copy(update={"offset_e": None})
    return without_channels(slopes, gains, ConstantMap(slopes.shape))


def alike_noise(channels: ReadoutChannels | None) -> float:
    """Return the factor of a mean variance of noise, equal in electrons, with readout channels that are alike."""
    return 1.0 if channels is None else 1.0 / float((channels.tables()[0] ** 2).mean())
