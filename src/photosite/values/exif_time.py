"""The time of a photograph in Exif, with the digits of its seconds."""

from __future__ import annotations

import re
from datetime import datetime

DATE_TIME, DATE_TIME_ORIGINAL = 306, 36867
SUBSEC_TIME, SUBSEC_TIME_ORIGINAL = 37520, 37521
OFFSET_TIME, OFFSET_TIME_ORIGINAL = 36880, 36881
"""Tags of the last change and of the exposure: date and time, digits of the second, time zone (CIPA DC-008, 4.6.6)."""
TIMES = (
    (DATE_TIME_ORIGINAL, SUBSEC_TIME_ORIGINAL, OFFSET_TIME_ORIGINAL),
    (DATE_TIME, SUBSEC_TIME, OFFSET_TIME),
)
"""Tags of a time, in the order in which they are looked for."""
_MOST_DIGITS = 6
_ZONE = re.compile(r"[+-]\d\d:\d\d")


def iso_time(date_time: str | None, digits: str | None = None, zone: str | None = None) -> str | None:
    """Return an Exif time in ISO 8601, with as many digits of the second as are stated; None where it is none.

    Examples
    --------
    >>> iso_time("2026:11:28 12:00:01", "04", "-05:00"), iso_time("0000:00:00 00:00:00")
    ('2026-11-28T12:00:01.04-05:00', None)
    """
    try:
        found = datetime.strptime((date_time or "").strip(), "%Y:%m:%d %H:%M:%S").isoformat()
    except ValueError:
        return None
    part = (digits or "").strip()[:_MOST_DIGITS]
    if part.isascii() and part.isdecimal():
        found += f".{part}"
    return found + zone.strip() if zone is not None and _ZONE.fullmatch(zone.strip()) else found
