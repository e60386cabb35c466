"""Building blocks of the sensor file's models: quantities with uncertainty, tables over wavelength, sections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    WithJsonSchema,
)

from photosite.errors import InputError, did_you_mean
from photosite.values.measured import Measured


class Section(BaseModel):
    """A section of the sensor file: immutable, and without unknown fields."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, validate_default=True)


_QUANTITY_KEYS = ("value", "standard_uncertainty", "source", "assumed")


def _quantity(raw: Any) -> Measured:
    if isinstance(raw, Measured):
        return raw
    entry = dict(raw) if isinstance(raw, Mapping) else {"value": raw}
    for key in entry:
        if key not in _QUANTITY_KEYS:
            raise InputError(f"unknown field '{key}'", hint=did_you_mean(str(key), _QUANTITY_KEYS))
    if "value" not in entry:
        raise InputError("field 'value' is missing")
    value, uncertainty = entry["value"], entry.get("standard_uncertainty", 0.0)
    assumed, source = entry.get("assumed", False), entry.get("source")
    for name, number in (("value", value), ("standard_uncertainty", uncertainty)):
        if not is_number(number):
            raise InputError(name, value=number, expected="a number")
    if not isinstance(assumed, bool):
        raise InputError("assumed", value=assumed, expected="true or false")
    if source is not None and not isinstance(source, str):
        raise InputError("source", value=source, expected="text")
    return Measured(float(value), float(uncertainty), source, assumed)


def _as_file_value(quantity: Measured) -> float | dict[str, Any]:
    """Return the shortest lossless form: a bare number if there is only a value."""
    entry: dict[str, Any] = {"value": quantity.value}
    if quantity.standard_uncertainty:
        entry["standard_uncertainty"] = quantity.standard_uncertainty
    if quantity.source is not None:
        entry["source"] = quantity.source
    if quantity.assumed:
        entry["assumed"] = True
    return quantity.value if len(entry) == 1 else entry


_QUANTITY_SCHEMA: dict[str, Any] = {
    "anyOf": [
        {"type": "number"},
        {
            "type": "object",
            "properties": {
                "value": {"type": "number"},
                "standard_uncertainty": {"type": "number", "minimum": 0},
                "source": {"type": "string"},
                "assumed": {"type": "boolean"},
            },
            "required": ["value"],
            "additionalProperties": False,
        },
    ]
}


def _bounded(lowest: float, highest: float = math.inf, *, open_below: bool = False) -> AfterValidator:
    def check(quantity: Measured) -> Measured:
        value = quantity.value
        if value < lowest or value > highest or (open_below and value == lowest):
            floor = f"above {lowest:g}" if open_below else f"at least {lowest:g}"
            ceiling = "" if highest == math.inf else f" and at most {highest:g}"
            raise InputError("value", value=value, expected=f"{floor}{ceiling}")
        return quantity

    return AfterValidator(check)


_Quantity = Annotated[
    Measured,
    PlainValidator(_quantity),
    PlainSerializer(_as_file_value),
    WithJsonSchema(_QUANTITY_SCHEMA),
]
Positive = Annotated[_Quantity, _bounded(0.0, open_below=True)]
NotNegative = Annotated[_Quantity, _bounded(0.0)]
Fraction = Annotated[_Quantity, _bounded(0.0, 1.0, open_below=True)]
# 15 %: a deviation of -100 % is then 6.7 standard deviations, more than the 32-bit normal deviates reach.
ResponseSpread = Annotated[_Quantity, _bounded(0.0, 15.0)]


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
