"""Quantities in a sensor file: a bare number, or a mapping with its uncertainty, source and whether it is assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, PlainSerializer, PlainValidator, WithJsonSchema

from photosite.errors import did_you_mean
from photosite.values.measured import Measured

_QUANTITY_KEYS = ("value", "standard_uncertainty", "source", "assumed")


def _quantity(raw: Any) -> Measured:
    """A bare number, or a mapping with `value` and what is known of it."""
    if isinstance(raw, Measured):
        return raw
    if isinstance(raw, Mapping):
        for key in raw:
            if key not in _QUANTITY_KEYS:
                raise ValueError(f"unknown key '{key}' beside 'value'; {did_you_mean(str(key), _QUANTITY_KEYS)}")
        if "value" not in raw:
            raise ValueError("a mapping here needs a 'value'")
        value = raw["value"]
        uncertainty = raw.get("standard_uncertainty", 0.0)
        assumed = raw.get("assumed", False)
        source = raw.get("source")
        if not isinstance(assumed, bool):
            raise ValueError(f"'assumed' is true or false, not {assumed!r}")
        if source is not None and not isinstance(source, str):
            raise ValueError(f"'source' is text, not {source!r}")
    else:
        value, uncertainty, assumed, source = raw, 0.0, False, None
    for what, number in (("value", value), ("standard_uncertainty", uncertainty)):
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(f"{what} must be a number, not {number!r}")
    return Measured(float(value), float(uncertainty), source, assumed)


def _as_file_value(quantity: Measured) -> float | dict[str, Any]:
    """The shortest form that loses nothing: a bare number where nothing else is known."""
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
            raise ValueError(f"must be {floor}{ceiling}, not {value:g}")
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
# 15 %: a deviation of -100 % is then 6.7 standard deviations out, more than the 32-bit normal deviates reach.
ResponseSpread = Annotated[_Quantity, _bounded(0.0, 15.0)]
