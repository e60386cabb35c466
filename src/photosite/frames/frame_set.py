"""Stacks of frames: grouped by kind and exposure, read when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.cfa import MONOCHROME, Cfa
from photosite.errors import InputError
from photosite.exposure import check_exposure, format_exposure
from photosite.sensor.model import Sensor

Kind = Literal["dark", "light"]
KINDS: tuple[Kind, ...] = ("dark", "light")


@dataclass(frozen=True)
class FrameSource:
    """Where one frame is, and how to get it.

    Parameters
    ----------
    name
        What to call the frame in messages and reports: its path, or a label for a frame in memory.
    read
        Returns the (rows, cols) uint16 digital numbers; called each time they are needed, nothing is kept.
    thread_safe
        Whether threads may call the `read` of several frames at once.
    """

    name: str
    read: Callable[[], NDArray[np.uint16]]
    thread_safe: bool = False


@dataclass(frozen=True)
class ListedFrame:
    """A frame and the setting it was taken under, before frames are grouped.

    Parameters
    ----------
    kind, exposure_s, photons_per_pixel
        As in `FrameGroup`.
    source
        Where the frame is.
    """

    kind: Kind
    exposure_s: float
    source: FrameSource
    photons_per_pixel: float | None = None


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
    black_level_dn
        The black level that the files or the protocol state, or None.
    """

    groups: tuple[FrameGroup, ...]
    rows: int
    cols: int
    bits: int
    cfa: Cfa = MONOCHROME
    source: str = "memory"
    sensor: Sensor | None = None
    black_level_dn: float | None = None

    def of_kind(self, kind: Kind) -> tuple[FrameGroup, ...]:
        """The groups of one kind, by exposure."""
        return tuple(group for group in self.groups if group.kind == kind)

    @property
    def frame_count(self) -> int:
        """Frames in all groups together."""
        return sum(len(group) for group in self.groups)


def group_frames(listed: Iterable[ListedFrame]) -> tuple[FrameGroup, ...]:
    """Frames of one kind, exposure and photon count put together, in the order of `FrameSet.groups`.

    Raises
    ------
    InputError
        If there are none, a kind is unknown, an exposure is not above 0, or a photon count is negative.
    """
    groups: dict[tuple[Kind, float, float | None], list[FrameSource]] = {}
    for frame in listed:
        if frame.kind not in KINDS:
            raise InputError(f"{frame.source.name}: a frame is 'dark' or 'light', not {frame.kind!r}")
        photons = frame.photons_per_pixel
        if photons is not None and not 0 <= photons < np.inf:
            raise InputError(f"{frame.source.name}: photons per pixel cannot be {photons}")
        key = (frame.kind, check_exposure(frame.exposure_s), photons)
        groups.setdefault(key, []).append(frame.source)
    if not groups:
        raise InputError("a frame set needs frames, and there are none")

    def order(key: tuple[Kind, float, float | None]) -> tuple[bool, float, float]:
        kind, exposure_s, photons = key
        return kind != "dark", exposure_s, -1.0 if photons is None else photons

    return tuple(
        FrameGroup(kind, exposure_s, tuple(groups[kind, exposure_s, photons]), photons)
        for kind, exposure_s, photons in sorted(groups, key=order)
    )


def frame_set_from_arrays(
    frames: Sequence[tuple[Kind, float, NDArray[np.uint16]] | tuple[Kind, float, NDArray[np.uint16], float]],
    *,
    bits: int,
    cfa: Cfa = MONOCHROME,
    sensor: Sensor | None = None,
) -> FrameSet:
    """A frame set from arrays in memory.

    Parameters
    ----------
    frames
        (kind, exposure_s, dn) or (kind, exposure_s, dn, photons_per_pixel) each; dn is (rows, cols) uint16. The arrays
        are not copied.
    bits
        Bits of the converter.
    cfa
        The colour filter array's tile.
    sensor
        What is known of the sensor beforehand.

    Raises
    ------
    InputError
        If there are no frames, their sizes differ, an array is not two-dimensional uint16 or holds numbers above
        2^bits - 1, or a kind, exposure or photon count cannot be.

    Examples
    --------
    >>> dark = np.full((2, 3), 64, np.uint16)
    >>> frames = frame_set_from_arrays([("light", 0.1, dark * 2), ("dark", 0.1, dark), ("dark", 0.1, dark)], bits=12)
    >>> [(group.kind, len(group)) for group in frames.groups]
    [('dark', 2), ('light', 1)]
    """
    if not 1 <= bits <= 16:
        raise InputError(f"a converter has 1 to 16 bits, not {bits}")
    listed = []
    shape: tuple[int, ...] | None = None
    for number, entry in enumerate(frames):
        kind, exposure_s, dn = entry[:3]
        name = f"frame {number} ({kind}, {format_exposure(exposure_s)} s)"
        if not isinstance(dn, np.ndarray) or dn.ndim != 2 or dn.size == 0 or dn.dtype != np.uint16:
            raise InputError(f"{name}: a frame is a (rows, cols) array of uint16")
        if (shape := shape or dn.shape) != dn.shape:
            raise InputError(f"{name}: is {dn.shape}, the frames before it {shape}; all must be of one size")
        if bits < 16 and (highest := int(dn.max())) >= 1 << bits:
            raise InputError(f"{name}: holds {highest} DN, which {bits} bits cannot")
        photons = entry[3] if len(entry) == 4 else None
        listed.append(ListedFrame(kind, exposure_s, FrameSource(name, partial(_same, dn), thread_safe=True), photons))
    groups = group_frames(listed)
    rows, cols = shape or (0, 0)
    return FrameSet(groups, rows, cols, bits, cfa, sensor=sensor)


def _same(dn: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """What a frame in memory is read by; a function of the module, so that frame sets go to other processes."""
    return dn
