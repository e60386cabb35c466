"""The image quality of a camera: results on several charts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from photosite.metrics.measure import ImageQuality
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.shown import Reported, ResultTable, Tabular


@dataclass(frozen=True, eq=False)
class CameraQuality(Tabular, Diagnosed, Reported):
    """The image quality of a camera on several charts.

    Parameters
    ----------
    name
        The camera.
    charts
        Results by the name of the chart.
    """

    name: str
    charts: Mapping[str, ImageQuality]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]  # of all charts
        """Diagnostics of all charts, with their names."""
        return tuple(entry.within(name) for name, quality in self.charts.items() for entry in quality.diagnostics)

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {"name": self.name, "charts": {name: quality.to_dict() for name, quality in self.charts.items()}}

    def _table(self) -> ResultTable:
        tables = {name: quality.table for name, quality in self.charts.items()}
        columns = next(iter(tables.values())).columns
        rows = [(name, *row) for name, table in tables.items() for row in table.rows]
        return ResultTable(f"Image quality of {self.name}", ("chart", *columns), rows)
