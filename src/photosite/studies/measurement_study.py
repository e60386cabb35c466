"""The registry of measurements in studies: each file of `studies/measurements` defines one as `STUDY`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from photosite.metrics.chart_image import Frames
from photosite.metrics.measurement import Result
from photosite.values.registry import registered

Truth = Mapping[tuple[str, str], float]
"""True values by quantity and part, as in a result; those that the chart does not define are left out."""


@dataclass(frozen=True, eq=False)
class HiddenChart:
    """Frames of a chart, and the true values, which the measurement does not know.

    Parameters
    ----------
    frames, chart
        What is measured, and the name of the built-in scene that it shows.
    truth
        Called with the result, for values that depend on where it was measured; otherwise the values.
    options, placing
        Options of the measurement, and arguments of `measure` for the place of the chart and its light.
    """

    frames: Frames
    chart: str
    truth: Truth | Callable[[Result], Truth]
    options: Mapping[str, Any] = field(default_factory=dict)
    placing: Mapping[str, Any] = field(default_factory=dict)

    def truth_of(self, result: Result) -> Truth:
        """Return the true values of a result."""
        return self.truth(result) if callable(self.truth) else self.truth


@dataclass(frozen=True)
class MeasurementStudy:
    """How a measurement is drawn for studies.

    Parameters
    ----------
    draw
        Returns a chart; called with a source of random numbers and the number of the draw, by which kinds alternate.
    varied
        What differs between the draws.
    """

    draw: Callable[[np.random.Generator, int], HiddenChart]
    varied: str


WITHOUT_DRAWS = MappingProxyType(
    {
        "chart-light": "values of a light that is given: no uncertainty",
        "defects": "a count, whose interval is that of the mean over chips",
    }
)
"""Measurements that take no part, with the reason."""


@cache
def measurement_studies() -> Mapping[str, MeasurementStudy]:
    """Return the studies by the id of their measurement.

    Examples
    --------
    >>> "edge-sfr" in measurement_studies()
    True
    """
    found: dict[str, MeasurementStudy] = registered("photosite.studies.measurements", "STUDY")
    return MappingProxyType({name.replace("_", "-"): study for name, study in found.items()})
