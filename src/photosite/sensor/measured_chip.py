"""A chip as its frames showed it: what every pixel does, which pixels are defective, and what its lines add."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

if TYPE_CHECKING:
    from photosite.sensor.model import Maps

FloatMap = NDArray[np.float32]


class DefectKind(IntEnum):
    """What is wrong with a pixel. The number is what a file of maps keeps."""

    HOT = 1
    """Its dark current lies far above that of its channel; the value is in DN/s."""
    OFFSET = 2
    """Its dark level lies far off that of its channel; the value is in DN. Where darks have one exposure, hot pixels
    are here."""
    DEAD = 3
    """It gives less than half of its channel's response to light; the value is its relative response."""
    RESPONSE = 4
    """Its response to light lies far off that of its channel; the value is its relative response."""
    BLINKING = 5
    """It jumps between two levels (random telegraph noise); the value is the distance between them in DN."""
    NOISY = 6
    """Its noise lies far above that of its channel, and shows no two levels; the value is in DN."""


@dataclass(frozen=True, eq=False)
class Defects:
    """Defective pixels, a line each; a pixel may be on several.

    Parameters
    ----------
    row, col
        (n,) place on the chip.
    kind
        (n,) uint8, a `DefectKind`.
    value
        (n,) what was measured; the kind says of what and in which unit.
    deviation
        (n,) how far off the channel's median that is, in standard deviations of the channel's map; for BLINKING the
        distance between the levels in units of the noise within them, for NOISY the noise in units of the channel's.
    """

    row: NDArray[np.int64]
    col: NDArray[np.int64]
    kind: NDArray[np.uint8]
    value: NDArray[np.float64]
    deviation: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.row)

    def of(self, kind: DefectKind) -> Defects:
        """Those of one kind."""
        return self.where(self.kind == kind)

    def where(self, chosen: NDArray[np.bool_]) -> Defects:
        """Those for which (n,) `chosen` is true."""
        return Defects(*(getattr(self, entry.name)[chosen] for entry in fields(self)))

    def counts(self) -> Mapping[str, int]:
        """How many there are of each kind, by its name in small letters.

        Examples
        --------
        >>> one = np.array([1])
        >>> Defects(one, one, np.array([DefectKind.HOT], np.uint8), one * 1.0, one * 9.0).counts()["hot"]
        1
        """
        return {kind.name.lower(): int(np.count_nonzero(self.kind == kind)) for kind in DefectKind}


@dataclass(frozen=True, eq=False)
class Blinking:
    """Pixels that jump between two levels, with what a simulation needs of them.

    Parameters
    ----------
    row, col
        (n,) place on the chip.
    amplitude_dn
        (n,) distance between the levels.
    high_fraction
        (n,) share of the frames in the upper one.
    noise_dn
        (n,) temporal standard deviation within a level, rounding and shot noise of the dark current off.
    """

    row: NDArray[np.int64]
    col: NDArray[np.int64]
    amplitude_dn: NDArray[np.float64]
    high_fraction: NDArray[np.float64]
    noise_dn: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.row)


def no_defects() -> Defects:
    """An empty list."""
    none, whole = np.zeros(0), np.zeros(0, np.int64)
    return Defects(whole, whole, np.zeros(0, np.uint8), none, none)


def no_blinking() -> Blinking:
    """An empty list."""
    none, whole = np.zeros(0), np.zeros(0, np.int64)
    return Blinking(whole, whole, none, none, none)


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredChip:
    """The maps of one chip, (rows, cols) float32 each, in digital numbers as they were measured.

    Nothing in them is smoothed, cut off or moved towards the others: a map's spread is the chip's and that of its
    measurement, and `..._uncertainty` is the latter.

    Parameters
    ----------
    offset_dn, offset_uncertainty_dn
        Dark level at an exposure of 0 less the black level, and its standard uncertainty. Where the darks have one
        exposure, the level is that of `reference_exposure_s`.
    read_noise_dn
        Temporal standard deviation, rounding and shot noise of the dark current taken off; where the variance came out
        negative, minus the root of its size.
    read_noise_freedom
        Degrees of freedom of each pixel's temporal variance: over normal noise, that estimate times them over the true
        variance follows chi-square.
    dark_rate_dn_per_s, dark_rate_uncertainty_dn_per_s
        Dark current; None where the darks have one exposure.
    prnu, prnu_uncertainty
        Relative deviation of the response to light from its channel's mean, of the chip and of what lit it: fall-off
        of the light and of the lens are in it. None without light frames.
    row_noise_dn, column_noise_dn
        Temporal noise that a row or a column shares; as negative as its variance came out. It is part of
        `read_noise_dn`.
    black_level_dn
        What `offset_dn` is counted from.
    system_gain_dn_per_e
        DN per electron of these maps, or None where it is not known.
    reference_exposure_s
        Exposure of the darks behind `read_noise_dn`.
    defects, blinking
        Pixels that are not like the others.

    Raises
    ------
    InputError
        If the maps differ in size or type, or hold what is not finite.
    """

    offset_dn: FloatMap
    offset_uncertainty_dn: FloatMap
    read_noise_dn: FloatMap
    read_noise_freedom: int
    dark_rate_dn_per_s: FloatMap | None = None
    dark_rate_uncertainty_dn_per_s: FloatMap | None = None
    prnu: FloatMap | None = None
    prnu_uncertainty: FloatMap | None = None
    row_noise_dn: float = 0.0
    column_noise_dn: float = 0.0
    black_level_dn: float
    system_gain_dn_per_e: float | None
    reference_exposure_s: float
    defects: Defects
    blinking: Blinking

    def __post_init__(self) -> None:
        for name, values in self.maps().items():
            if values.shape != self.offset_dn.shape or values.ndim != 2 or values.dtype != np.float32:
                raise InputError(
                    f"{name} is {values.shape} of {values.dtype}; the maps of a chip are {self.offset_dn.shape} float32"
                )
            # The sum of a map is finite where all of it is, and needs no second one of its size.
            if not np.isfinite(values.sum(dtype=np.float64)):
                raise InputError(f"{name} holds numbers that are not finite")
        if self.system_gain_dn_per_e is not None and not 0 < self.system_gain_dn_per_e < np.inf:
            raise InputError(f"system_gain_dn_per_e is above 0, not {self.system_gain_dn_per_e}")
        for what, listed in (("defects", self.defects), ("blinking", self.blinking)):
            for name, places, size in (("row", listed.row, self.shape[0]), ("col", listed.col, self.shape[1])):
                if len(places) and not (places.min() >= 0 and places.max() < size):
                    raise InputError(f"{what}: a {name} is from 0 to {size - 1}, not {places.min()} to {places.max()}")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        rows, cols = self.offset_dn.shape
        return rows, cols

    def maps(self) -> dict[str, FloatMap]:
        """The maps that there are, by name."""
        found = {name: getattr(self, name) for name in MAP_UNITS}
        return {name: values for name, values in found.items() if values is not None}

    def save(self, path: str | PathLike[str]) -> Maps:
        """Write the maps to an HDF5 file, whole or not at all.

        Returns
        -------
        Maps
            Name and SHA-256 of the file, for a sensor file: `sensor.with_(maps=chip.save("mine.maps.h5"))`.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        from photosite.sensor.io.maps_file import write_maps

        return write_maps(self, path)


MAP_UNITS = {
    "offset_dn": "DN",
    "offset_uncertainty_dn": "DN",
    "read_noise_dn": "DN",
    "dark_rate_dn_per_s": "DN/s",
    "dark_rate_uncertainty_dn_per_s": "DN/s",
    "prnu": "1",
    "prnu_uncertainty": "1",
}
"""The maps of a `MeasuredChip` and their units, as the file names them."""
