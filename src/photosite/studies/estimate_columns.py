"""Estimates of several cameras as columns of numbers: each value with its uncertainty and its 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from photosite.values.estimate import Estimate

NO_PART = "the camera has no such part"


def interval_columns(name: str) -> tuple[str, str, str]:
    """Return the names of the columns beside a value: standard uncertainty and the ends of the 95 % interval.

    Examples
    --------
    >>> interval_columns("edge-sfr.mtf50.G")
    ('u(edge-sfr.mtf50.G)', 'low(edge-sfr.mtf50.G)', 'high(edge-sfr.mtf50.G)')
    """
    return f"u({name})", f"low({name})", f"high({name})"


def estimate_columns(name: str, estimate: Estimate) -> dict[str, float]:
    """Return an estimate as numbers by column; NaN where there is none.

    Examples
    --------
    >>> estimate_columns("gain", Estimate(2.0, 0.1, interval_95=(1.8, 2.3)))
    {'gain': 2.0, 'u(gain)': 0.1, 'low(gain)': 1.8, 'high(gain)': 2.3}
    """
    found = (estimate.shown_value, estimate.standard_uncertainty, *(estimate.interval_95 or (None, None)))
    return {
        column: math.nan if number is None else number
        for column, number in zip((name, *interval_columns(name)), found, strict=True)
    }


def with_all_names(found: Sequence[Mapping[str, Estimate]]) -> list[dict[str, Estimate]]:
    """Return the estimates of several cameras, each with the names of all; what a camera does not have has a reason.

    A value that is missing as a whole, such as "edge-sfr.mtf50", stands for the parts that others have of it.

    Examples
    --------
    >>> blurred, sharp = {"mtf50": Estimate(reason="too wide")}, {"mtf50.G": Estimate(0.3, 0.01)}
    >>> [each["mtf50.G"].reason for each in with_all_names([blurred, sharp])]
    ['too wide', None]
    """
    names = dict.fromkeys(name for each in found for name in each)
    whole = [name for name in names if any(other.startswith(f"{name}.") for other in names)]

    def of(each: Mapping[str, Estimate], name: str) -> Estimate:
        owners = (owner for owner in whole if owner in each and name.startswith(f"{owner}."))
        return each.get(name) or next((each[owner] for owner in owners), Estimate(reason=NO_PART))

    return [{name: of(each, name) for name in names if name not in whole} for each in found]
