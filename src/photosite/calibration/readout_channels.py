"""Gains and offsets of readout channels, from the periodic structure and the steps of mean frames."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.fixed_pattern import FixedPatterns
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.uncertain import Measured, Uncertain, Value

_FROM_FLATS, _FROM_DARKS = "measured from flat fields", "measured from dark frames"


def measured_channels(patterns: FixedPatterns, gain: Value) -> ReadoutChannels | None:
    """Return the readout channels, if their gains or offsets differ; the mean gain is 1, the mean offset 0.

    Columns or rows that alternate are one arrangement, halves or quadrants the other. A sensor file holds one of them:
    None if there are both.
    """
    structure, taps = patterns.structure, patterns.taps
    if structure is not None and (structure.of_mosaic() or not structure.by_lines):
        structure = None
    if (structure is None) == (not taps):
        return None
    if structure is not None:
        axis = 0 if structure.by_lines == "columns" else 1
        relative = structure.relative.mean(axis=axis, keepdims=True)
        return ReadoutChannels(relative_gain=_table(relative, structure.uncertainty, _FROM_FLATS))
    gains = offsets = None
    for found in taps:
        spread = found.uncertainty / math.sqrt(2.0)  # of a level, from that of a step between two
        if not found.dark:
            gains = _table(1.0 + found.level, spread, _FROM_FLATS)
        elif isinstance(gain, Uncertain):
            offsets = _table(found.level / gain.value, spread / gain.value, _FROM_DARKS)
    if gains is None and offsets is None:
        return None
    return ReadoutChannels(arrangement="blocks", relative_gain=gains, offset_e=offsets)


def _table(values: NDArray[np.float64], uncertainty: float, source: str) -> tuple[tuple[Measured, ...], ...]:
    return tuple(tuple(Measured(float(value), uncertainty, source) for value in row) for row in values)
