"""Shooting protocols: which frames a measurement takes, at which exposure times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photosite.errors import InputError
from photosite.frames.frame_settings import KINDS, Kind
from photosite.values.exposure import check_exposure


@dataclass(frozen=True)
class Step:
    """Frames of one kind ("dark" or "light") at one exposure time, 1 or more."""

    kind: Kind
    exposure_s: float
    count: int

    def __post_init__(self) -> None:
        check_exposure(self.exposure_s)
        if self.kind not in KINDS:
            raise InputError("kind", value=self.kind, expected="'dark' or 'light'")
        if self.count < 1:
            raise InputError("count", value=self.count, expected="1 or more")


@dataclass(frozen=True)
class ShootingProtocol:
    """The frames of a measurement: a title, and one step or more in the order in which they are taken."""

    name: str
    steps: tuple[Step, ...]

    def __post_init__(self) -> None:
        if not self.steps:
            raise InputError("steps", value=self.steps, expected="one step or more")

    @property
    def frame_count(self) -> int:
        """Number of frames of all steps."""
        return sum(step.count for step in self.steps)

    @property
    def longest_light_s(self) -> float | None:
        """Longest exposure time of a light frame; None without light frames."""
        return max((step.exposure_s for step in self.steps if step.kind == "light"), default=None)


def series(kind: Kind, shortest_s: float, longest_s: float, exposures: int, count: int) -> tuple[Step, ...]:
    """Return steps at exposure times in equal ratios, both ends included, with `count` frames each.

    Raises
    ------
    InputError
        If an exposure time or count is invalid, or there are fewer than two exposures.

    Examples
    --------
    >>> [step.exposure_s for step in series("light", 0.01, 0.04, exposures=3, count=5)]
    [0.01, 0.02, 0.04]
    """
    if exposures < 2:
        raise InputError("exposures", value=exposures, expected="2 or more")
    check_exposure(shortest_s)
    check_exposure(longest_s)
    times = np.geomspace(shortest_s, longest_s, exposures)
    return tuple(Step(kind, float(f"{t:.12g}"), count) for t in times)


def paper_d200_protocol() -> ShootingProtocol:
    """Return the protocol that the 2008 paper used for the Nikon D200.

    190 dark frames from 1/8000 to 30 s (19 exposures of 10), 150 dark frames at 1/8000 s, and 65 flat fields from
    1/8000 to 1/25 s (13 exposures of 5). The paper (section 2) gives the counts and the ends of each range. Equal
    ratios between the ends are an assumption.

    Examples
    --------
    >>> protocol = paper_d200_protocol()
    >>> protocol.frame_count, len(protocol.steps)
    (405, 33)
    """
    return ShootingProtocol(
        "Farrell, Okincha and Parmar (2008), Nikon D200",
        (
            *series("dark", 1 / 8000, 30.0, exposures=19, count=10),
            Step("dark", 1 / 8000, 150),
            *series("light", 1 / 8000, 1 / 25, exposures=13, count=5),
        ),
    )


def paper_vendor_protocol() -> ShootingProtocol:
    """Return the protocol that the 2008 paper used for the vendor sensor.

    8 dark frames at 10 ms, and 10 dark frames and 10 flat fields from 1 to 300 ms (5 exposures of 2 each). Equal ratios
    and two frames per exposure are assumptions: ten single frames would not show the temporal noise of the flat fields,
    which system gain and PRNU need.

    Examples
    --------
    >>> protocol = paper_vendor_protocol()
    >>> protocol.frame_count, len(protocol.steps)
    (28, 11)
    """
    return ShootingProtocol(
        "Farrell, Okincha and Parmar (2008), vendor sensor",
        (
            Step("dark", 10e-3, 8),
            *series("dark", 1e-3, 300e-3, exposures=5, count=2),
            *series("light", 1e-3, 300e-3, exposures=5, count=2),
        ),
    )
