"""Measurement protocols as data: which frames a calibration asks for, whoever takes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photosite.errors import InputError
from photosite.frames.frame_settings import KINDS, Kind
from photosite.values.exposure import check_exposure


@dataclass(frozen=True)
class Step:
    """Some frames under one setting.

    Parameters
    ----------
    kind
        "dark" or "light".
    exposure_s
        Exposure time.
    count
        How many frames.

    Raises
    ------
    InputError
        If the kind is unknown, or the exposure or the count is not above 0.
    """

    kind: Kind
    exposure_s: float
    count: int

    def __post_init__(self) -> None:
        check_exposure(self.exposure_s)
        if self.kind not in KINDS:
            raise InputError(f"a frame is 'dark' or 'light', not {self.kind!r}")
        if self.count < 1:
            raise InputError(f"a step of a protocol has 1 frame or more, not {self.count}")


@dataclass(frozen=True)
class ShootingProtocol:
    """What to shoot, in this order.

    Parameters
    ----------
    name
        What the measurement is called.
    steps
        Its steps, one or more.

    Raises
    ------
    InputError
        If there are no steps.
    """

    name: str
    steps: tuple[Step, ...]

    def __post_init__(self) -> None:
        if not self.steps:
            raise InputError("a protocol has one step or more, and this one has none")

    @property
    def frame_count(self) -> int:
        """Frames of all steps together."""
        return sum(step.count for step in self.steps)

    @property
    def longest_light_s(self) -> float | None:
        """The longest exposure to light, or None where there is none."""
        return max((step.exposure_s for step in self.steps if step.kind == "light"), default=None)


def series(kind: Kind, shortest_s: float, longest_s: float, exposures: int, count: int) -> tuple[Step, ...]:
    """Exposures in equal ratios from the shortest to the longest, both included, `count` frames at each.

    Raises
    ------
    InputError
        If an exposure or a count cannot be, or there are fewer than two exposures.

    Examples
    --------
    >>> [step.exposure_s for step in series("light", 0.01, 0.04, exposures=3, count=5)]
    [0.01, 0.02, 0.04]
    """
    if exposures < 2:
        raise InputError(f"a series has 2 exposures or more, not {exposures}")
    check_exposure(shortest_s)
    check_exposure(longest_s)
    times = np.geomspace(shortest_s, longest_s, exposures)
    return tuple(Step(kind, float(f"{t:.12g}"), count) for t in times)


def paper_d200_protocol() -> ShootingProtocol:
    """The protocol of the 2008 paper's Nikon D200.

    190 dark frames from 1/8000 to 30 s (19 exposures of 10), 150 dark frames at 1/8000 s, and 65 frames of a uniform
    field from 1/8000 to 1/25 s (13 exposures of 5).

    Notes
    -----
    Farrell, Okincha and Parmar, Proc. SPIE 6817 (2008), section 2. The paper gives the counts and the ends of each
    range; that the exposures between them lie in equal ratios is an assumption.

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
    """The protocol of the 2008 paper's vendor sensor.

    8 dark frames at 10 ms, 10 dark frames and 10 frames of a uniform field from 1 to 300 ms (5 exposures of 2 each).

    Notes
    -----
    Farrell, Okincha and Parmar, Proc. SPIE 6817 (2008), section 2. The paper gives the counts and the ends of each
    range. That the exposures lie in equal ratios, and that each has two frames, is an assumption: ten single frames
    would tell no temporal noise of the flats, hence no gain, and no PRNU that is parted from that noise.

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
