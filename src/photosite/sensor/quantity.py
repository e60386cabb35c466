"""Building blocks of the sensor file's models: quantities with uncertainty, correlations, tables over wavelength."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    AfterValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    StrictBool,
    StrictStr,
    WithJsonSchema,
    model_validator,
)

from photosite.errors import InputError
from photosite.values.uncertain import Measured
from photosite.values.validated import Number, Section

ROUNDING = 1e-5
"""Tolerance for symmetry and positive semi-definiteness of correlations that were written with rounding."""

_DIGITS = 10


def about(
    description: str, unit: str, example: Any, *, over: str | None = None, keys: str | None = None, **constraints: Any
) -> Any:
    """Return a field with its description, unit and example, as the JSON Schema states them.

    `over` is the field of the same section that has the grid of this one, such as the wavelengths of an efficiency.
    `keys` is what the keys of a mapping name: channels or captures.
    """
    links = {"over": over, "keys": keys}
    stated: dict[str, Any] = {"unit": unit} | {name: link for name, link in links.items() if link is not None}
    if isinstance(default := constraints.get("default"), Measured):
        stated["default"] = default.value
    return Field(description=description, json_schema_extra=stated, examples=[example], **constraints)


NO_UNIT = "none"
"""Unit of text, flags and sections; that of ratios and counts is 1."""


class Quantity(Section):
    """A value with its standard uncertainty and source."""

    value: Number = about("The value, in the unit of the field.", "that of the field", 2.4)
    standard_uncertainty: Number = about(
        "Standard uncertainty (GUM) of the value; 0 if exact.", "that of the field", 0.05, ge=0, default=0.0
    )
    source: StrictStr | None = about("Origin of the value.", NO_UNIT, "data sheet, page 3", default=None)
    assumed: StrictBool = about(
        "Whether the value is an assumption, neither measured nor published.", NO_UNIT, True, default=False
    )


def as_measured(raw: Any) -> Measured:
    """Return the quantity of a file's number or mapping; raise Pydantic's `ValidationError` if it is invalid."""
    if isinstance(raw, Measured):
        return raw
    return Measured(**dict(Quantity.model_validate(raw if isinstance(raw, Mapping) else {"value": raw})))


def as_file_value(quantity: Measured) -> float | dict[str, Any]:
    """Return the shortest lossless form: a bare number if there is only a value."""
    rest = {name: getattr(quantity, name) for name in ("standard_uncertainty", "source", "assumed")}
    given = {name: entry for name, entry in rest.items() if entry}
    return {"value": quantity.value, **given} if given else quantity.value


@dataclass(frozen=True)
class Bounds:
    """The range of a quantity's value, as the function of a validator."""

    lowest: float
    highest: float = math.inf
    open_below: bool = False

    def __call__(self, quantity: Measured) -> Measured:
        """Return the quantity; raise `InputError` if its value is outside the range."""
        value = quantity.value
        if value < self.lowest or value > self.highest or (self.open_below and value == self.lowest):
            floor = f"above {self.lowest:g}" if self.open_below else f"{self.lowest:g} or more"
            ceiling = "" if self.highest == math.inf else f" and at most {self.highest:g}"
            raise InputError("value", value=value, expected=f"{floor}{ceiling}")
        return quantity


def _bounded(lowest: float, highest: float = math.inf, *, open_below: bool = False) -> AfterValidator:
    return AfterValidator(Bounds(lowest, highest, open_below))


_Value = Annotated[
    Measured,
    PlainValidator(as_measured),
    PlainSerializer(as_file_value),
    WithJsonSchema({"anyOf": [{"type": "number"}, Quantity.model_json_schema()]}),
]
AnyValue = Annotated[_Value, _bounded(-math.inf)]
Positive = Annotated[_Value, _bounded(0.0, open_below=True)]
NotNegative = Annotated[_Value, _bounded(0.0)]
UnitFraction = Annotated[_Value, _bounded(0.0, 1.0)]
LogSpread = Annotated[_Value, _bounded(0.0, 5.0)]
Fraction = Annotated[_Value, _bounded(0.0, 1.0, open_below=True)]
# 15 %: a deviation of -100 % is then 6.7 standard deviations, more than the 32-bit normal deviates reach.
ResponseSpread = Annotated[_Value, _bounded(0.0, 15.0)]


def is_number(raw: Any) -> bool:
    """Return whether a value is a number, and not true or false."""
    return isinstance(raw, int | float) and not isinstance(raw, bool)


def _increasing(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(map(math.isfinite, values)) or any(b <= a for a, b in pairwise(values)):
        raise InputError("the entries", expected="finite and increasing")
    return values


Increasing = Annotated[tuple[float, ...], Field(min_length=1), AfterValidator(_increasing)]
"""Wavelengths or angles of a table."""
UnitInterval = Annotated[float, Field(ge=0.0, le=1.0)]


def check_length(name: str, values: tuple[Any, ...], grid: str, count: int) -> None:
    """Raise `InputError` if a column of a table has another length than its grid."""
    if len(values) != count:
        raise InputError(name, value=f"{len(values)} entries", expected=f"{count} entries, one for each {grid}")


class Covariance(Section):
    """Correlations of measured values; with the values' standard uncertainties they give the covariance.

    Values with a common source, such as volts that were divided by one system gain, have correlated errors.

    Examples
    --------
    >>> shared = Covariance(names=("read_noise_mv", "conversion_gain_uv_per_e"), correlation=((1, 0.5), (0.5, 1)))
    >>> shared.without({"read_noise_mv"}) is None
    True
    """

    names: tuple[str, ...] = about(
        "Fields of pixel, noise and readout with correlated errors.",
        NO_UNIT,
        ["read_noise_mv", "conversion_gain_uv_per_e"],
        min_length=2,
    )
    correlation: tuple[tuple[float, ...], ...] = about(
        "Correlation matrix, a row for each of names; 1 on the diagonal.", "1", [[1.0, 0.5], [0.5, 1.0]]
    )

    @classmethod
    def of(cls, names: Sequence[str], covariance: NDArray[np.float64], digits: int = _DIGITS) -> Covariance | None:
        """Return the correlations of a covariance matrix, without values of variance 0; None for fewer than two.

        Examples
        --------
        >>> Covariance.of(["a", "b", "c"], np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])).correlation
        ((1.0, 0.5), (0.5, 1.0))
        """
        kept = np.flatnonzero(np.diag(covariance) > 0.0)
        if kept.size < 2:
            return None
        scale = np.sqrt(np.diag(covariance)[kept])
        matrix = np.round(covariance[np.ix_(kept, kept)] / np.outer(scale, scale), digits) + 0.0  # no -0
        np.fill_diagonal(matrix, 1.0)
        return cls(names=tuple(names[int(k)] for k in kept), correlation=tuple(map(tuple, matrix.tolist())))

    @model_validator(mode="after")
    def _check(self) -> Self:
        n = len(self.names)
        if len(set(self.names)) != n:
            raise InputError("names", value=self.names, expected="different fields of the sensor")
        if len(self.correlation) != n or any(len(row) != n for row in self.correlation):
            raise InputError("correlation", expected=f"{n} rows of {n} numbers, one for each of names")
        matrix = np.array(self.correlation)
        if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1.0 + ROUNDING:
            raise InputError("correlation", expected="finite and from -1 to 1")
        if np.abs(np.diag(matrix) - 1.0).max() > ROUNDING or np.abs(matrix - matrix.T).max() > ROUNDING:
            raise InputError("correlation", expected="symmetric, with 1 on the diagonal")
        if (lowest := float(np.linalg.eigvalsh(matrix).min())) < -n * ROUNDING:
            raise InputError("correlation", expected=f"positive semi-definite; its lowest eigenvalue is {lowest:.3g}")
        return self

    def without(self, names: set[str]) -> Covariance | None:
        """Return the correlations of the other values, or None for fewer than two."""
        kept = [k for k, name in enumerate(self.names) if name not in names]
        if len(kept) < 2:
            return None
        matrix = tuple(tuple(self.correlation[a][b] for b in kept) for a in kept)
        return Covariance(names=tuple(self.names[k] for k in kept), correlation=matrix)

    def matrix(self, names: Sequence[str], standard_uncertainty: ArrayLike) -> NDArray[np.float64]:
        """Return the (n, n) covariance of values by name; values without an entry are independent.

        Examples
        --------
        >>> shared = Covariance(names=("a", "b"), correlation=((1, 0.5), (0.5, 1)))
        >>> shared.matrix(["b", "other", "a"], [1.0, 3.0, 2.0]).tolist()
        [[1.0, 0.0, 1.0], [0.0, 9.0, 0.0], [1.0, 0.0, 4.0]]
        """
        known = [(i, self.names.index(name)) for i, name in enumerate(names) if name in self.names]
        correlation = np.eye(len(names))
        for i, a in known:
            for j, b in known:
                if i != j:
                    correlation[i, j] = self.correlation[a][b]
        scale = np.asarray(standard_uncertainty, dtype=np.float64)
        return correlation * np.outer(scale, scale)
