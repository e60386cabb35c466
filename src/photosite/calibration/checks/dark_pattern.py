"""Dark frames without a fixed pattern: a dark frame was subtracted in the camera."""

from __future__ import annotations

from photosite.calibration.measurements import Measurements
from photosite.values.uncertain import Uncertain

LEAST_PATTERN = 0.05
"""DSNU over read noise below which a dark frame was probably subtracted; sensors have 0.1 and more."""


def missing_pattern_warning(m: Measurements) -> str | None:
    """Return a warning where dark frames have no fixed pattern, as after a dark frame was subtracted in the camera."""
    dsnu, read = m.dsnu_variance, m.read_variance
    if not isinstance(dsnu, Uncertain) or not isinstance(read, Uncertain) or read.value <= 0.0 or m.dark_method:
        return None
    if dsnu.interval_95[1] > LEAST_PATTERN**2 * read.value:
        return None
    return (
        f"the dark frames have no fixed pattern: DSNU is below {100 * LEAST_PATTERN:.0f} % of the read noise, as after "
        f"a dark frame was subtracted in the camera; DSNU and dark current are then those that are left, and the read "
        f"noise contains that of the subtracted frame (1.41 times the sensor's for a single one)"
    )
