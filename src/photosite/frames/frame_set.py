"""Stacks of frames: grouped by kind and exposure, read when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.cfa import MONOCHROME, Cfa
from photosite.sensor.model import Sensor

Kind = Literal["dark", "light"]


@dataclass(frozen=True)
class FrameSource:
    """Where one frame is, and how to get it.

    Parameters
    ----------
    name
        What to call the frame in messages and reports: its path, or a label for a frame in memory.
    read
        Returns the (rows, cols) uint16 digital numbers; called each time they are needed, nothing is kept.
    """

    name: str
    read: Callable[[], NDArray[np.uint16]]


@dataclass(frozen=True)
class FrameGroup:
    """Frames of one kind taken under one setting.

    Parameters
    ----------
    kind
        "dark" or "light".
    exposure_s
        Exposure time.
    frames
        The frames, in the order they were listed.
    photons_per_pixel
        Mean photons that fell on a pixel during the exposure, where the protocol says; 0 for darks where it does.
    """

    kind: Kind
    exposure_s: float
    frames: tuple[FrameSource, ...]
    photons_per_pixel: float | None = None

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[NDArray[np.uint16]]:
        """The frames' digital numbers, one after another."""
        return (source.read() for source in self.frames)


@dataclass(frozen=True)
class FrameSet:
    """All frames of a measurement.

    Parameters
    ----------
    groups
        Sorted: darks first, by exposure, then by photons. Frames of one kind, exposure and photon count are one group.
    rows, cols
        Size of every frame.
    bits
        Bits of the converter.
    cfa
        The colour filter array's tile.
    source
        What was opened: a folder, a descriptor, a protocol, or "memory".
    sensor
        What is known of the sensor beforehand (pixel size, voltage swing, nominal spectra), or None.
    """

    groups: tuple[FrameGroup, ...]
    rows: int
    cols: int
    bits: int
    cfa: Cfa = MONOCHROME
    source: str = "memory"
    sensor: Sensor | None = None

    def of_kind(self, kind: Kind) -> tuple[FrameGroup, ...]:
        """The groups of one kind, by exposure."""
        return tuple(group for group in self.groups if group.kind == kind)

    @property
    def frame_count(self) -> int:
        """Frames in all groups together."""
        return sum(len(group) for group in self.groups)


def frame_set_from_arrays(
    frames: Sequence[tuple[Kind, float, NDArray[np.uint16]]],
    *,
    bits: int,
    cfa: Cfa = MONOCHROME,
    sensor: Sensor | None = None,
) -> FrameSet:
    """A frame set from arrays in memory: (kind, exposure_s, dn) each. To be completed by frames/open.py's rules."""
    raise NotImplementedError
