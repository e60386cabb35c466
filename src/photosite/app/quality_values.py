"""Names of values of image quality in requests, and what the registry knows of them."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from photosite.app.places import Part, Text
from photosite.errors import InputError
from photosite.metrics.registry import ValueName, simulated_values


def _known(name: str) -> str:
    try:
        ValueName.parse(name)
    except InputError as error:
        raise ValueError(str(error)) from None
    return name


QualityValues = Annotated[
    tuple[Annotated[Text, AfterValidator(_known)], ...],
    Field(max_length=16, description="Values of image quality of simulated charts, those of GET /api/values."),
]


class ValueInfo(Part):
    """A value of image quality: its name in requests, and what it is."""

    name: str
    label: str
    unit: str
    definition: str
    measurement: str
    standard: str


def known_values() -> list[ValueInfo]:
    """Return the values that simulated charts have."""
    return [
        ValueInfo(
            name=str(value),
            label=(quantity := entry.quantities[value.quantity]).label,
            unit=quantity.unit,
            definition=quantity.definition,
            measurement=entry.title,
            standard=entry.standard,
        )
        for value, entry in simulated_values().items()
    ]
