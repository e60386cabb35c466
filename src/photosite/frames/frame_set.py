"""Stacks of frames: grouped by kind, exposure and gain setting, read when asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.values.cfa import MONOCHROME, Cfa
from photosite.values.exposure import check_exposure, format_exposure

Kind = Literal["dark", "light"]
KINDS: tuple[Kind, ...] = ("dark", "light")

ABSOLUTE_ZERO_C = -273.15


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
    kind, exposure_s, photons_per_pixel, gain_setting
        As in `FrameGroup`.
    source
        Where the frame is.
    temperature_c
        Temperature of the sensor, in degrees Celsius, where file or protocol says.
    """

    kind: Kind
    exposure_s: float
    source: FrameSource
    photons_per_pixel: float | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None


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
    gain_setting
        The camera's gain as it was set, ISO or in whatever unit files or protocol say; None where neither does.
    temperature_c
        Mean of the temperatures that its frames state, in degrees Celsius, or None. Temperatures do not make groups:
        they scatter from frame to frame.
    """

    kind: Kind
    exposure_s: float
    frames: tuple[FrameSource, ...]
    photons_per_pixel: float | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None

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
        Sorted: darks first, by exposure, then by photons, then by gain setting. Frames that have all four in common
        are one group.
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
    notes
        What was assumed or noticed when the frames were listed, for those who read what comes of them.
    white_level_dn
        The number at which the output saturates, as the files state it, or None.
    """

    groups: tuple[FrameGroup, ...]
    rows: int
    cols: int
    bits: int
    cfa: Cfa = MONOCHROME
    source: str = "memory"
    sensor: Sensor | None = None
    black_level_dn: float | None = None
    notes: tuple[str, ...] = ()
    white_level_dn: float | None = None

    def of_kind(self, kind: Kind) -> tuple[FrameGroup, ...]:
        """The groups of one kind, by exposure."""
        return tuple(group for group in self.groups if group.kind == kind)

    @property
    def frame_count(self) -> int:
        """Frames in all groups together."""
        return sum(len(group) for group in self.groups)

    @property
    def gain_settings(self) -> tuple[float | None, ...]:
        """The gain settings of the groups, each once, in rising order; None, for frames that state none, first."""
        return tuple(sorted({group.gain_setting for group in self.groups}, key=_none_first))

    def at_gain(self, setting: float | None) -> FrameSet:
        """The frames that were taken at one gain setting.

        Raises
        ------
        InputError
            If there are none.

        Examples
        --------
        >>> dn = np.full((2, 3), 64, np.uint16)
        >>> both = frame_set_from_arrays([("dark", 0.1, dn, None, 100.0), ("dark", 0.1, dn, None, 400.0)], bits=12)
        >>> both.gain_settings, both.at_gain(400).frame_count
        ((100.0, 400.0), 1)
        """
        groups = tuple(group for group in self.groups if group.gain_setting == setting)
        if not groups:
            raise InputError(f"no frames at gain setting {setting}; there are {gain_settings_text(self)}")
        if len(groups) == len(self.groups):
            return self
        return replace(self, groups=groups, source=f"{self.source} (gain {_gain_text(setting)})")


def gain_settings_text(frames: FrameSet) -> str:
    """The gain settings of a set in words: "100, 400"."""
    return ", ".join(map(_gain_text, frames.gain_settings))


def _gain_text(setting: float | None) -> str:
    return "not stated" if setting is None else f"{setting:g}"


def _none_first(value: float | None) -> tuple[bool, float]:
    return (False, 0.0) if value is None else (True, value)


def group_frames(listed: Iterable[ListedFrame]) -> tuple[FrameGroup, ...]:
    """Frames of one kind, exposure, photon count and gain setting put together, in the order of `FrameSet.groups`.

    Raises
    ------
    InputError
        If there are none, a kind is unknown, an exposure is not above 0, a photon count or gain setting is negative, or
        a temperature is not above absolute zero.
    """
    groups: dict[tuple[Kind, float, float | None, float | None], list[ListedFrame]] = {}
    for frame in listed:
        _check_setting(frame)
        key = (frame.kind, check_exposure(frame.exposure_s), frame.photons_per_pixel, frame.gain_setting)
        groups.setdefault(key, []).append(frame)
    if not groups:
        raise InputError("a frame set needs frames, and there are none")

    def order(key: tuple[Kind, float, float | None, float | None]) -> tuple[object, ...]:
        kind, exposure_s, photons, gain_setting = key
        return kind != "dark", exposure_s, _none_first(photons), _none_first(gain_setting)

    return tuple(
        FrameGroup(
            kind,
            exposure_s,
            tuple(frame.source for frame in groups[key]),
            photons,
            gain_setting,
            _mean([frame.temperature_c for frame in groups[key] if frame.temperature_c is not None]),
        )
        for key in sorted(groups, key=order)
        for kind, exposure_s, photons, gain_setting in (key,)
    )


def _check_setting(frame: ListedFrame) -> None:
    name = frame.source.name
    if frame.kind not in KINDS:
        raise InputError(f"{name}: a frame is 'dark' or 'light', not {frame.kind!r}")
    for what, value in (("photons per pixel", frame.photons_per_pixel), ("the gain setting", frame.gain_setting)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(f"{name}: {what} cannot be {value}")
    if (celsius := frame.temperature_c) is not None and not ABSOLUTE_ZERO_C < celsius < np.inf:
        raise InputError(f"{name}: the temperature cannot be {celsius} degrees Celsius")


def _mean(values: Sequence[float]) -> float | None:
    return math.fsum(values) / len(values) if values else None


def frame_set_from_arrays(
    frames: Sequence[tuple[Kind, float, NDArray[np.uint16], *tuple[float | None, ...]]],
    *,
    bits: int,
    cfa: Cfa = MONOCHROME,
    sensor: Sensor | None = None,
) -> FrameSet:
    """A frame set from arrays in memory.

    Parameters
    ----------
    frames
        (kind, exposure_s, dn) each, and as many as are known of (photons_per_pixel, gain_setting, temperature_c) after
        it; dn is (rows, cols) uint16. The arrays are not copied.
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
        2^bits - 1, or a setting cannot be.

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
        if not 3 <= len(entry) <= 6:
            raise InputError(f"frame {number}: is (kind, exposure_s, dn) and up to three settings more")
        kind, exposure_s, dn, *settings = entry
        name = f"frame {number} ({kind}, {format_exposure(exposure_s)} s)"
        if not isinstance(dn, np.ndarray) or dn.ndim != 2 or dn.size == 0 or dn.dtype != np.uint16:
            raise InputError(f"{name}: a frame is a (rows, cols) array of uint16")
        if (shape := shape or dn.shape) != dn.shape:
            raise InputError(f"{name}: is {dn.shape}, the frames before it {shape}; all must be of one size")
        if bits < 16 and (highest := int(dn.max())) >= 1 << bits:
            raise InputError(f"{name}: holds {highest} DN, which {bits} bits cannot")
        source = FrameSource(name, partial(_same, dn), thread_safe=True)
        listed.append(ListedFrame(kind, exposure_s, source, *settings))
    groups = group_frames(listed)
    rows, cols = shape or (0, 0)
    return FrameSet(groups, rows, cols, bits, cfa, sensor=sensor)


def _same(dn: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """What a frame in memory is read by; a function of the module, so that frame sets go to other processes."""
    return dn
