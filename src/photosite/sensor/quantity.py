"""Building blocks of the sensor file's models: quantities with uncertainty, and tables over wavelength."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import AfterValidator, Field, PlainSerializer, PlainValidator, StrictBool, StrictStr, WithJsonSchema

from photosite.errors import InputError
from photosite.values.measured import Measured
from photosite.values.validated import Number, Section


class Quantity(Section):
    """A value with its standard uncertainty and source."""

    value: Number
    standard_uncertainty: Annotated[Number, Field(ge=0)] = 0.0
    source: StrictStr | None = None
    assumed: StrictBool = False


def _quantity(raw: Any) -> Measured:
    if isinstance(raw, Measured):
        return raw
    return Measured(**dict(Quantity.model_validate(raw if isinstance(raw, Mapping) else {"value": raw})))


def _as_file_value(quantity: Measured) -> float | dict[str, Any]:
    """Return the shortest lossless form: a bare number if there is only a value."""
    rest = {name: getattr(quantity, name) for name in ("standard_uncertainty", "source", "assumed")}
    given = {name: entry for name, entry in rest.items() if entry}
    return {"value": quantity.value, **given} if given else quantity.value


def _bounded(lowest: float, highest: float = math.inf, *, open_below: bool = False) -> AfterValidator:
    def check(quantity: Measured) -> Measured:
        value = quantity.value
        if value < lowest or value > highest or (open_below and value == lowest):
            floor = f"above {lowest:g}" if open_below else f"{lowest:g} or more"
            ceiling = "" if highest == math.inf else f" and at most {highest:g}"
            raise InputError("value", value=value, expected=f"{floor}{ceiling}")
        return quantity

    return AfterValidator(check)


_Value = Annotated[
    Measured,
    PlainValidator(_quantity),
    PlainSerializer(_as_file_value),
    WithJsonSchema({"anyOf": [{"type": "number"}, Quantity.model_json_schema()]}),
]
Positive = Annotated[_Value, _bounded(0.0, open_below=True)]
NotNegative = Annotated[_Value, _bounded(0.0)]
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
        raise InputError(name, value=f"{len(values)} entries", expected=f"one entry per {grid}, {count}")
