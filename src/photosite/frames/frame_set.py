"""Frame sets: frames grouped by kind, exposure, light and gain setting, read when they are needed."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import InputError
from photosite.frames.frame_settings import FrameSettings, Kind
from photosite.frames.raw_frame import MOST_BITS, Numbers, check_bits
from photosite.frames.stored_rows import PartRows, StoredRows
from photosite.sensor.model import Sensor
from photosite.values.cfa import MONOCHROME, Cfa, shifted, tile_text
from photosite.values.diagnostic import Diagnosed, Diagnostic, DiagnosticKind
from photosite.values.exposure import check_exposure, format_exposure
from photosite.values.region import Border, Region
from photosite.values.shown import ResultTable, Shown, Tabular, clipped


@dataclass(frozen=True)
class FrameSource(Shown):
    """How to read one frame.

    Parameters
    ----------
    name
        Name of the frame in messages and reports: its path, or a label for a frame in memory.
    read
        Returns the (rows, cols) digital numbers, uint16, or uint32 above 16 bits; each call reads the file again.
    thread_safe
        Whether several threads may call the `read` of different frames at the same time.
    path
        The file that `read` reads; None for a frame in memory.
    whole
        Returns the frame with the border of `FrameSet.border`; None without a border.
    """

    name: str
    read: Callable[[], Numbers]
    thread_safe: bool = False
    path: Path | None = None
    whole: Callable[[], Numbers] | None = None

    def open_rows(self) -> StoredRows | None:
        """Open the frame to read some rows at a time; None where only `read` reads it.

        A `read` of files offers this by a method of the same name.
        """
        opened: Callable[[], StoredRows | None] | None = getattr(self.read, "open_rows", None)
        return None if opened is None else opened()


@dataclass(frozen=True)
class FrameGroup(Shown):
    """Frames of one kind taken with the same settings, in the order in which they were listed.

    Parameters
    ----------
    kind, exposure_s, photons_per_pixel, gain_setting, level
        As in `FrameSettings`; the photons of dark frames of a descriptor are 0. The level is None where light of one
        exposure time is one level.
    frames
        The frames.
    temperature_c
        Mean of the temperatures that the frames state. Temperatures vary from frame to frame, so they do not define
        groups.
    temperatures_c
        Temperature of each frame, None where it is not stated; empty where no frame states one.
    """

    kind: Kind
    exposure_s: float
    frames: tuple[FrameSource, ...]
    photons_per_pixel: float | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None
    temperatures_c: tuple[float | None, ...] = ()
    level: str | None = None

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Numbers]:
        """Iterate over the frames' digital numbers."""
        return (source.read() for source in self.frames)


@dataclass(frozen=True)
class FrameSet(Diagnosed, Tabular):
    """All frames of a measurement.

    Parameters
    ----------
    groups
        Dark frames first, then by exposure, photons and gain setting. Frames that agree in all four form one group.
    rows, cols
        Size of every frame.
    bits
        Bit depth of the converter.
    cfa
        Tile of the color filter array.
    source
        What was opened: a folder, a descriptor, a protocol, or "memory".
    sensor
        Known properties of the sensor (pixel size, voltage swing, nominal spectra), or None.
    black_level_dn
        The black level that files or protocol state, or None.
    diagnostics
        Assumptions and problems found when the frames were listed.
    white_level_dn
        The saturation level that the files state, or None.
    border
        Lines without light around the frames, which only `FrameSource.whole` reads: rows at the top and at the bottom,
        columns at the left and at the right. None without them.
    amplifiers
        The parts of a frame that amplifiers of their own read, as files state them; empty where there is one.
    conditions
        The conditions by which the frames differ from others of the measurement, such as the filter.

    Examples
    --------
    >>> dark = np.full((2, 3), 64, np.uint16)
    >>> frames = FrameSet.from_arrays([("light", 0.1, dark * 2), ("dark", 0.1, dark), ("dark", 0.1, dark)], bits=12)
    >>> [(group.kind, len(group)) for group in frames.groups]
    [('dark', 2), ('light', 1)]
    """

    groups: tuple[FrameGroup, ...]
    rows: int
    cols: int
    bits: int
    cfa: Cfa = MONOCHROME
    source: str = "memory"
    sensor: Sensor | None = None
    black_level_dn: float | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    white_level_dn: float | None = None
    border: Border | None = None
    amplifiers: tuple[Region, ...] = ()
    conditions: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_arrays(
        cls,
        frames: Sequence[tuple[Kind, float, Numbers, *tuple[float | None, ...]]],
        *,
        bits: int,
        cfa: Cfa = MONOCHROME,
        sensor: Sensor | None = None,
    ) -> FrameSet:
        """Return the frame set of arrays in memory, which are not copied.

        Parameters
        ----------
        frames
            (kind, exposure_s, dn[, photons_per_pixel[, gain_setting[, temperature_c]]]) each; dn is (rows, cols)
            uint16, or uint32 above 16 bits.
        bits, cfa, sensor
            As in `FrameSet`.

        Raises
        ------
        InputError
            If there are no frames, their sizes differ, an array is not two-dimensional uint16 (uint32 above 16 bits) or
            has values above 2^bits - 1, or a setting is invalid.
        """
        check_bits(bits, MOST_BITS)
        kind_of_numbers = np.uint16 if bits <= 16 else np.uint32
        listed = []
        shape: tuple[int, ...] | None = None
        for number, entry in enumerate(frames):
            if not 3 <= len(entry) <= 6:
                raise InputError(
                    f"frames[{number}]", value=len(entry), expected="3 to 6 values: kind, exposure_s, dn, ..."
                )
            kind, exposure_s, dn, *others = entry
            name = f"frame {number} ({kind}, {format_exposure(exposure_s)} s)"
            if not isinstance(dn, np.ndarray) or dn.ndim != 2 or dn.size == 0 or dn.dtype != kind_of_numbers:
                raise InputError("dn", where=name, expected=f"a (rows, cols) array of {kind_of_numbers.__name__}")
            if (shape := shape or dn.shape) != dn.shape:
                raise InputError("dn.shape", where=name, value=dn.shape, expected=f"{shape}, as for the other frames")
            if bits != 16 and (highest := int(dn.max())) >= 1 << bits:
                raise InputError(
                    "dn", where=name, value=highest, expected=f"at most {(1 << bits) - 1}, for {bits} bits"
                )
            source = FrameSource(name, partial(_identity, dn), thread_safe=True)
            photons, gain_setting, temperature_c = (*others, None, None, None)[:3]
            listed.append((source, FrameSettings(kind, exposure_s, photons, gain_setting, temperature_c)))
        groups = group_frames(listed)
        rows, cols = shape or (0, 0)
        return cls(groups, rows, cols, bits, cfa, sensor=sensor)

    def of_kind(self, kind: Kind) -> tuple[FrameGroup, ...]:
        """Return the groups of one kind, by exposure."""
        return tuple(group for group in self.groups if group.kind == kind)

    def to_dict(self) -> dict[str, Any]:
        """Return the properties of the set, and its groups as columns."""
        names = ("source", "rows", "cols", "bits", "black_level_dn", "white_level_dn")
        own = {name: getattr(self, name) for name in names}
        return {
            **own,
            "cfa": [list(row) for row in self.cfa],
            "notes": list(self.warnings),
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "groups": self._table().to_dict(),
        }

    def _table(self) -> ResultTable:
        size = f"{self.rows} x {self.cols} pixels, {self.bits} bits"
        title = f"FrameSet of {clipped(self.source, 40)}: {self.frame_count} frames of {size}, {tile_text(self.cfa)}"
        names = ("kind", "exposure_s", "photons_per_pixel", "gain_setting", "temperature_c")
        rows = [(*(getattr(group, name) for name in names), len(group)) for group in self.groups]
        return ResultTable(title, (*names, "frames"), rows)

    @property
    def frame_count(self) -> int:
        """Number of frames in all groups."""
        return sum(len(group) for group in self.groups)

    @property
    def gain_settings(self) -> tuple[float | None, ...]:
        """The different gain settings in increasing order; None, for frames without one, comes first."""
        return tuple(sorted({group.gain_setting for group in self.groups}, key=_none_first))

    def at_gain(self, setting: float | None) -> FrameSet:
        """Return the frames taken at one gain setting; `InputError` if no frame has it.

        Examples
        --------
        >>> dn = np.full((2, 3), 64, np.uint16)
        >>> both = FrameSet.from_arrays([("dark", 0.1, dn, None, 100.0), ("dark", 0.1, dn, None, 400.0)], bits=12)
        >>> both.gain_settings, both.at_gain(400).frame_count
        ((100.0, 400.0), 1)
        """
        groups = tuple(group for group in self.groups if group.gain_setting == setting)
        if not groups:
            raise InputError("gain_setting", value=setting, expected=f"one of the frames': {gain_settings_text(self)}")
        if len(groups) == len(self.groups):
            return self
        return replace(self, groups=groups, source=f"{self.source} (gain {_gain_text(setting)})")


def without_border(frames: FrameSet, border: Border) -> FrameSet:
    """Return the frames without the lines at their edges that receive no light.

    Raises
    ------
    InputError
        If no lines with light are left.

    Examples
    --------
    >>> dn = np.arange(12, dtype=np.uint16).reshape(3, 4)
    >>> inside = without_border(FrameSet.from_arrays([("dark", 0.1, dn)], bits=12), (0, 1, 2, 0))
    >>> inside.groups[0].frames[0].read(), inside.rows, inside.cols
    (array([[2, 3],
           [6, 7]], dtype=uint16), 2, 2)
    """
    top, bottom, left, right = border
    rows, cols = frames.rows - top - bottom, frames.cols - left - right
    if min(*border, rows - 1, cols - 1) < 0:
        raise InputError("border", value=border, expected=f"fewer lines than the frames' {frames.rows} x {frames.cols}")
    inside = slice(top, top + rows), slice(left, left + cols)

    def within(source: FrameSource) -> FrameSource:
        return replace(source, read=_PartRead(source, inside), whole=source.whole or source.read)

    groups = tuple(replace(group, frames=tuple(map(within, group.frames))) for group in frames.groups)
    above, below, before, behind = frames.border or (0, 0, 0, 0)
    whole = top + above, bottom + below, left + before, right + behind
    amplifiers = tuple(
        Region(each.name, max(each.r0 - top, 0), r1, max(each.c0 - left, 0), c1)
        for each in frames.amplifiers
        for r1, c1 in [(min(each.r1 - top, rows), min(each.c1 - left, cols))]
        if r1 > max(each.r0 - top, 0) and c1 > max(each.c0 - left, 0)
    )
    cfa = shifted(frames.cfa, top, left)
    return replace(frames, groups=groups, rows=rows, cols=cols, cfa=cfa, border=whole, amplifiers=amplifiers)


def of_amplifier(frames: FrameSet, part: Region) -> FrameSet:
    """Return the frames of one of `FrameSet.amplifiers`, without all others.

    Examples
    --------
    >>> dn = np.arange(12, dtype=np.uint16).reshape(3, 4)
    >>> frames = FrameSet.from_arrays([("dark", 0.1, dn)], bits=12)
    >>> of_amplifier(frames, Region("B", 0, 3, 2, 4)).groups[0].frames[0].read().tolist()
    [[2, 3], [6, 7], [10, 11]]
    """
    whole = (part.r0, frames.rows - part.r1, part.c0, frames.cols - part.c1)
    inside = without_border(replace(frames, border=None, amplifiers=()), whole)
    groups = tuple(
        replace(group, frames=tuple(replace(source, whole=None) for source in group.frames)) for group in inside.groups
    )
    return replace(inside, groups=groups, border=None, source=f"{frames.source} ({part.name})")


@dataclass(frozen=True, eq=False)
class _PartRead:
    """`FrameSource.read` of a part of a frame."""

    source: FrameSource
    inside: tuple[slice, slice]

    def __call__(self) -> Numbers:
        part: Numbers = self.source.read()[self.inside]
        return part.copy()

    def open_rows(self) -> StoredRows | None:
        stored = self.source.open_rows()
        return None if stored is None else PartRows(stored, self.inside)


def gain_settings_text(frames: FrameSet) -> str:
    """Return the gain settings of a set as text: "100, 400"."""
    return ", ".join(map(_gain_text, frames.gain_settings))


def _gain_text(setting: float | None) -> str:
    return "not stated" if setting is None else f"{setting:g}"


def _none_first(value: float | None) -> tuple[bool, float]:
    return (False, 0.0) if value is None else (True, value)


_GroupKey = tuple[Kind, float, float | None, float | None, str | None]


def group_frames(frames: Iterable[tuple[FrameSource, FrameSettings]]) -> tuple[FrameGroup, ...]:
    """Group frames by kind, exposure, photons and gain setting, in the order of `FrameSet.groups`.

    Flat fields of unknown photons and one exposure time are also grouped by the name of their level, if each name has
    two frames or more: a name of a single frame is not that of a level.
    """
    groups: dict[_GroupKey, list[tuple[FrameSource, FrameSettings]]] = {}
    for source, settings in frames:
        try:
            valid = settings.validated()
            if valid.kind is None:
                raise InputError("kind", value=None, expected="'dark' or 'light'")
            exposure_s = valid.exposure_s if valid.exposure_s is not None else check_exposure(None)
        except InputError as error:
            raise error.within(source.name) from None
        key: _GroupKey = (valid.kind, exposure_s, valid.photons_per_pixel, valid.gain_setting, None)
        groups.setdefault(key, []).append((source, valid))
    for key in list(groups):
        kind, exposure_s, photons, gain_setting, _ = key
        names = [settings.level for _, settings in groups[key]]
        if kind == "light" and photons is None and all(1 < names.count(name) < len(names) for name in set(names)):
            for source, settings in groups.pop(key):
                own = (kind, exposure_s, photons, gain_setting, settings.level)
                groups.setdefault(own, []).append((source, settings))
    if not groups:
        raise InputError("a frame set needs at least one frame")

    def order(group: _GroupKey) -> tuple[object, ...]:
        kind, exposure_s, photons, gain_setting, level = group
        return kind != "dark", exposure_s, _none_first(photons), _none_first(gain_setting), level or ""

    result = []
    for key in sorted(groups, key=order):
        kind, exposure_s, photons, gain_setting, level = key
        stated = tuple(settings.temperature_c for _, settings in groups[key])
        temperatures = [celsius for celsius in stated if celsius is not None]
        mean_c = math.fsum(temperatures) / len(temperatures) if temperatures else None
        sources = tuple(source for source, _ in groups[key])
        each_c = stated if temperatures else ()
        result.append(FrameGroup(kind, exposure_s, sources, photons, gain_setting, mean_c, each_c, level))
    return tuple(result)


STEADY_TEMPERATURE_C = 2.0
"""Range of temperatures in a set above which a warning is given: dark current then changes by a fifth."""

TEMPERATURE_VARIED = DiagnosticKind(
    "temperature-varied",
    "warning",
    "The sensor's temperature varied from frame to frame.",
    "The dark current, which doubles about every 7 degrees Celsius, is that of a mean temperature.",
    "Keep the temperature steady, or measure each temperature by itself: photosite temperature.",
    ("dark_*",),
    size="range of the temperatures, degrees Celsius",
)
"""Beginning of that warning."""


def split_by_temperature(frames: FrameSet) -> tuple[FrameSet, ...]:
    """Return a set for each temperature, from the coldest: frames whose temperatures are less than 2 deg C apart.

    Raises
    ------
    InputError
        If some frames state their temperature and others do not.

    Examples
    --------
    >>> dn = np.zeros((2, 2), np.uint16)
    >>> series = [("dark", 1.0, dn, None, None, celsius) for celsius in (20.0, -10.2, -9.9)]
    >>> [one.groups[0].temperature_c for one in split_by_temperature(FrameSet.from_arrays(series, bits=12))]
    [-10.05, 20.0]
    """
    listed = [
        (source, group, celsius)
        for group in frames.groups
        for source, celsius in zip(group.frames, group.temperatures_c or (None,) * len(group), strict=True)
    ]
    stated = sorted({celsius for _, _, celsius in listed if celsius is not None})
    if not stated:
        return (frames,)
    if unknown := [source.name for source, _, celsius in listed if celsius is None]:
        raise InputError("temperature_c", where=unknown[0], value=None, expected="stated, as by the other frames")
    starts = [stated[0], *(b for a, b in pairwise(stated) if b - a >= STEADY_TEMPERATURE_C)]
    parts: list[list[tuple[FrameSource, FrameSettings]]] = [[] for _ in starts]
    for source, group, celsius in listed:
        settings = FrameSettings(
            group.kind, group.exposure_s, group.photons_per_pixel, group.gain_setting, celsius, group.level
        )
        parts[bisect_right(starts, celsius or 0.0) - 1].append((source, settings))
    steady = tuple(entry for entry in frames.diagnostics if entry.id != TEMPERATURE_VARIED.id)
    sources = [f"{frames.source} (from {celsius:g} °C)" if len(starts) > 1 else frames.source for celsius in starts]
    return tuple(
        replace(frames, groups=group_frames(part), diagnostics=steady, source=source)
        for part, source in zip(parts, sources, strict=True)
    )


def _identity(dn: Numbers) -> Numbers:
    """Return a frame in memory; a module-level function, so that frame sets can be pickled."""
    return dn
