"""A measurement of image quality: the entry of the registry, and the result with values, curves and diagnostics."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import create_model

from photosite.errors import InputError, did_you_mean
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.shown import Cell, ResultTable, Shown, Tabular, drawn
from photosite.values.uncertain import Missing
from photosite.values.validated import Validated

Array = NDArray[np.float64]

View = Literal["middle", "fine", "field"]


@dataclass(frozen=True)
class Quantity(Shown):
    """A quantity that a measurement returns.

    Parameters
    ----------
    label, unit
        For tables and axes; the unit is "" for ratios.
    definition
        What the value is.

    Examples
    --------
    >>> Quantity("MTF50", "cycles/pixel", "lowest frequency at which the SFR is 0.5").unit
    'cycles/pixel'
    """

    label: str
    unit: str
    definition: str


@dataclass(frozen=True, eq=False)
class Curve(Shown):
    """A curve of a result.

    Parameters
    ----------
    part
        What it is of: a channel, an edge, a patch.
    x_label, y_label
        Labels of the axes, with units; "log " in front of one makes its axis logarithmic. Curves with equal labels
        share a figure.
    x, y
        (n,) values.
    standard_uncertainty
        (n,) of `y`; None where it is not known.
    joined
        Whether the values are those of one curve; if not, they are drawn as points.
    ends
        What the first and the last point are, for curves that are differences.
    color
        Color to draw it in, such as "#735244"; None: by its part or place.
    """

    part: str
    x_label: str
    y_label: str
    x: Array
    y: Array
    standard_uncertainty: Array | None = None
    joined: bool = True
    ends: tuple[str, str] | None = None
    color: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON; values that are not finite are None."""
        spread = None if self.standard_uncertainty is None else _finite(self.standard_uncertainty)
        labels = {"part": self.part, "x_label": self.x_label, "y_label": self.y_label}
        return labels | {"x": _finite(self.x), "y": _finite(self.y), "standard_uncertainty": spread}


@dataclass(frozen=True, eq=False)
class FieldMap(Shown):
    """Values over the frame, or over other places.

    Parameters
    ----------
    part, label
        What it is of, and what the values are, with their unit.
    row, col
        (n,) and (m,) coordinates of the centers of the cells in the frame, in pixels.
    values
        (n, m) values; NaN where nothing was measured.
    axes
        What rows and columns are, if not places in the frame.
    """

    part: str
    label: str
    row: Array
    col: Array
    values: Array
    axes: tuple[str, str] = ("row (pixels)", "column (pixels)")

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON; values that are not finite are None."""
        places = {"part": self.part, "label": self.label, "row": _finite(self.row), "col": _finite(self.col)}
        places["axes"] = list(self.axes)
        return places | {"values": [_finite(row) for row in self.values]}


def _finite(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


@dataclass(frozen=True, eq=False)
class Result(Tabular, Diagnosed):
    """The result of one measurement on one chart.

    Parameters
    ----------
    values
        Estimates by quantity and part: `("mtf50", "G")`. The part is "" for the whole frame.
    curves, maps
        Curves and maps over the frame.
    diagnostics
        Limitations of the result.
    outlines
        (corners, 2) rows and columns of the parts of the image that were measured, where these are not the chart's
        patches.
    measurement
        The entry of the registry; set by the registry.
    options
        Options of the measurement that were given; set by the registry.

    Examples
    --------
    >>> result = Result({("mtf50", "G"): Estimate(0.25, 0.01)})
    >>> result["mtf50"].value, result["mtf50", "G"].standard_uncertainty
    (0.25, 0.01)
    """

    values: Mapping[tuple[str, str], Estimate]
    curves: tuple[Curve, ...] = ()
    maps: tuple[FieldMap, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()
    outlines: tuple[Array, ...] = ()
    measurement: Measurement | None = field(default=None, repr=False)
    options: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __getitem__(self, name: str | tuple[str, str]) -> Estimate:
        """Return an estimate by quantity and part; the part may be left out where there is one.

        Raises
        ------
        InputError
            If there is no such estimate, or the quantity has several parts.
        """
        if isinstance(name, tuple):
            if name in self.values:
                return self.values[name]
            hint = did_you_mean(".".join(name), [".".join(key) for key in self.values])
            raise InputError("quantity and part", value=name, expected="those of a value of the result", hint=hint)
        parts = {part: estimate for (quantity, part), estimate in self.values.items() if quantity == name}
        if len(parts) == 1:
            return next(iter(parts.values()))
        if not parts:
            hint = did_you_mean(name, {quantity for quantity, _ in self.values})
            raise InputError("quantity", value=name, expected="one of the result", hint=hint)
        raise InputError("part", expected=f"given for {name}: {', '.join(parts)}")

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(self.values)

    def plot(self, ax: Any = None) -> Any:
        """Draw the first curves or the first map on Matplotlib axes, new ones for None, and return them."""
        return drawn(self, ax)

    @property
    def name(self) -> str:
        """The id of the measurement."""
        return "" if self.measurement is None else self.measurement.id

    def quantity(self, name: str) -> Quantity:
        """Return the quantity of a value."""
        known = {} if self.measurement is None else self.measurement.quantities
        return known.get(name, Quantity(name, "", ""))

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        values = [
            {"quantity": name, "part": part, "unit": self.quantity(name).unit} | estimate.to_dict()
            for (name, part), estimate in self.values.items()
        ]
        about = {} if self.measurement is None else self.measurement.about
        return about | {
            "options": dict(self.options),
            "values": values,
            "curves": [curve.to_dict() for curve in self.curves],
            "maps": [each.to_dict() for each in self.maps],
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "outlines": [outline.tolist() for outline in self.outlines],
        }

    def rows(self) -> list[tuple[Cell, ...]]:
        """Return the rows of the table: label, part, value, the ends of the 95 % interval, unit, reason without one."""
        rows: list[tuple[Cell, ...]] = []
        for (name, part), estimate in self.values.items():
            quantity = self.quantity(name)
            low, high = estimate.interval_95 or (None, None)
            rows.append((quantity.label, part, estimate.shown_value, low, high, quantity.unit, estimate.reason))
        return rows

    def _table(self) -> ResultTable:
        title = "Result" if self.measurement is None else f"{self.measurement.title} ({self.measurement.standard})"
        return ResultTable(title, COLUMNS, self.rows())


COLUMNS = ("quantity", "part", "value", "lower 95 %", "upper 95 %", "unit", "missing because")


@dataclass(frozen=True)
class Measurement:
    """A measurement of image quality. Each file of `metrics/AREA` defines one as `MEASUREMENT`; its id is the file's.

    Parameters
    ----------
    title, standard
        What is measured, and the standard with edition and clause, or the publication.
    charts
        Charts that it works on: built-in scenes by name. Empty for frames without a chart.
    measure
        Called with the image, the chart in it and the measurement's own options, which are keyword arguments with
        annotations and defaults. It raises `InputError` where the frames do not show what it needs.
    quantities
        The quantities of its values, by name.
    oracle
        What the tests compare it with.
    left_out
        What the standard has and this implementation has not.
    order
        Place among the measurements.
    view
        What a simulated frame must show: the "middle" of the field at a usual number of pixels; the middle with "fine"
        cells, for responses; or the whole "field".
    headline
        Quantities that the first page of a report shows.
    figure
        Figure that the first page shows: the first "curves", the first "map", or none.
    of_photograph
        Quantities that are those of a photograph and not of the camera, such as the pose of the chart, or that need
        motion, lamps or developed pictures: simulated charts do not have them.
    """

    title: str
    standard: str
    charts: tuple[str, ...]
    measure: Callable[..., Result]
    quantities: Mapping[str, Quantity]
    oracle: str
    left_out: str = ""
    order: int = 0
    view: View = "middle"
    headline: tuple[str, ...] = ()
    figure: Literal["curves", "map", ""] = ""
    of_photograph: tuple[str, ...] = ()
    id: str = ""

    @cached_property
    def options(self) -> type[Validated]:
        """The model of the measurement's own options."""
        hints = get_type_hints(self.measure, include_extras=True)
        own: dict[str, Any] = {
            name: (hints[name], entry.default)
            for name, entry in inspect.signature(self.measure).parameters.items()
            if entry.kind is entry.KEYWORD_ONLY
        }
        return create_model(f"{self.id} options", __base__=Validated, **own)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "options"}  # its class is made here

    @property
    def about(self) -> dict[str, Any]:
        """Id, title, standard and what is left out, for JSON."""
        return {"id": self.id, "title": self.title, "standard": self.standard, "left_out": self.left_out}

    def __call__(self, image: ChartImage, chart: PlacedChart, **options: Any) -> Result:
        """Measure.

        Raises
        ------
        InputError
            If an option is invalid, or the image does not show what the measurement needs.
        """
        if self.charts and chart.name not in self.charts:
            expected = f"one of {', '.join(self.charts)} for {self.id}"
            raise InputError("chart", value=chart.name, expected=expected)
        values = self.options(**options)
        given = {name: getattr(values, name) for name in type(values).model_fields}
        key = self.measure, chart, repr(given)  # another measurement may be made of the same result
        result = image.shared(key, lambda: self.measure(image, chart, **given))
        return replace(result, measurement=self, options=values.given())


Measured = Result | Missing
