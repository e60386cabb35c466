"""White level of a channel: the number at which its flat fields are clipped, which may lie below full scale."""

from __future__ import annotations

from collections.abc import Sequence

from photosite.calibration.reduction.codes import Counts, of_channel

LEAST_SHARE, LEAST_COUNT = 0.004, 10
"""Share and number of a group's samples at the white level that show it."""

PILED = 4.0
"""Counts at the white level over those of each of the three numbers below.

Clipping collects the upper tail of the noise, so that this holds from 12 DN of noise at `LEAST_SHARE`, and from 3 DN
where half of the samples are clipped. At the end of a smooth tail 10 counts above 2 occur once in 10^9 cases."""

ABOVE = 0.001
"""Share of samples above the white level that defective pixels may have."""


def find_white_level(lights: Sequence[Counts], channel: int, full_scale: int) -> int:
    """Return the number at which a channel's flat fields are clipped; the full scale if none shows a lower one.

    Examples
    --------
    >>> import numpy as np
    >>> from photosite.calibration.reduction.codes import count_codes
    >>> rng = np.random.default_rng(1)
    >>> numbers = np.minimum(np.rint(rng.normal(2990.0, 15.0, (8, 64, 64))), 3000).astype(np.uint16)
    >>> counts = count_codes(list(numbers), np.zeros((64, 64), np.int64))
    >>> find_white_level([counts], 0, 4095)
    3000
    """
    found = 0
    for counts in lights:
        codes, numbers = of_channel(counts, channel)
        if not len(codes):
            continue
        total = int(numbers.sum())
        above = total - numbers.cumsum()  # samples above each code
        at = int((above < LEAST_SHARE * total).argmax())
        most = max(LEAST_COUNT, PILED * float(numbers[max(at - 3, 0) : at].max(initial=0)))
        if numbers[at] >= most and above[at] <= ABOVE * total:
            found = max(found, int(codes[at]))
    if found and all(share_above(counts, channel, found) <= ABOVE for counts in lights):
        return min(found, full_scale)
    return full_scale


def share_above(counts: Counts, channel: int, code: int) -> float:
    """Return the share of a channel's samples above a number."""
    codes, numbers = of_channel(counts, channel)
    return float(numbers[codes > code].sum() / max(numbers.sum(), 1))
