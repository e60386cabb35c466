"""Frame rate and jitter from the times that frames state."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import datetime

import numpy as np
from scipy.special import chdtri

from photosite.metrics.measurement import Quantity
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Source, Uncertain

_FRACTION = re.compile(r"\.(\d+)")
"""Digits of the seconds; a time zone may follow."""
_LEAST_FRAMES = 5
_BY_CHANCE = 0.01
"""Probability that the rounding of constant times scatters more."""
_ROUNDED = Missing("the times differ by less than their last digit")

STAMP_QUANTITIES = {
    "frame_rate_hz": Quantity("frame rate", "Hz", "By the times that the frames state."),
    "stamp_jitter_ms": Quantity(
        "jitter of time stamps", "ms", "Standard deviation of the stated times about a constant rate."
    ),
}


def stamp_values(stamps: Sequence[str]) -> dict[str, Estimate]:
    """Return frame rate and jitter by the stated times of frames in their order (ISO 8601); empty without times.

    The variance of the rounding, which is uniform over the last digit, is subtracted from that of the jitter.

    Examples
    --------
    >>> stamps = [f"2026-11-28T12:00:00.{ms:03d}" for ms in (0, 41, 79, 122, 160, 198, 241)]
    >>> found = stamp_values(stamps)
    >>> round(found["frame_rate_hz"].value, 1), round(found["stamp_jitter_ms"].value, 1)
    (25.0, 1.5)
    """
    try:
        times = [datetime.fromisoformat(stamp) for stamp in stamps]
        seconds = np.array([(time - times[0]).total_seconds() for time in times])
    except (ValueError, TypeError):  # no times, or some with a time zone and some without
        return {}
    if len(stamps) < _LEAST_FRAMES or not np.ptp(seconds):
        return {}
    number = np.arange(len(stamps)) - 0.5 * (len(stamps) - 1)
    square = float(number @ number)
    period = float(number @ seconds) / square
    rest = seconds - seconds.mean() - period * number
    freedom = len(stamps) - 2
    variance = float(rest @ rest) / freedom
    if period <= 0.0:
        return dict.fromkeys(STAMP_QUANTITIES, Estimate.of(Missing("the times of the frames do not increase"), ""))
    rate = Estimate.of(1.0 / Uncertain.of(period, math.sqrt(variance / square), Source.student(freedom)), "")
    rounding = _digit_s(stamps) ** 2 / 12.0
    if variance * freedom <= float(chdtri(freedom, _BY_CHANCE)) * rounding:
        return {"frame_rate_hz": rate, "stamp_jitter_ms": Estimate.of(_ROUNDED, "")}
    jitter = Uncertain.of_variance(variance, variance * math.sqrt(2.0 / freedom)) - rounding
    return {"frame_rate_hz": rate, "stamp_jitter_ms": Estimate.of_variance(jitter * 1e6, "")}


def _digit_s(stamps: Sequence[str]) -> float:
    """Return the last digit of the most exact time."""
    return 10.0 ** -max(len(match[1]) if (match := _FRACTION.search(stamp)) else 0 for stamp in stamps)
