"""The registry of measurements: each file of a folder of `photosite.metrics` defines one as `MEASUREMENT`."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from types import MappingProxyType

from photosite.errors import InputError, did_you_mean
from photosite.metrics.measurement import Measurement
from photosite.values.estimate import Estimate
from photosite.values.registry import registered

PACKAGE = "photosite.metrics"
_MOST_NAMES = 4
"""Names of values in a message."""


@cache
def measurements() -> Mapping[str, Measurement]:
    """Return all measurements by id, in their order.

    Examples
    --------
    >>> measurements()["edge-sfr"].charts
    ('slanted-edge',)
    """
    found: dict[str, Measurement] = {}
    for area in pkgutil.iter_modules(import_module(PACKAGE).__path__):
        if area.ispkg:
            entries: dict[str, Measurement] = registered(f"{PACKAGE}.{area.name}", "MEASUREMENT")
            for name, entry in entries.items():
                id = name.replace("_", "-")
                found[id] = replace(entry, id=id)
    return MappingProxyType(dict(sorted(found.items(), key=lambda item: (item[1].order, item[0]))))


def measurement(name: str) -> Measurement:
    """Return a measurement by its id.

    Raises
    ------
    InputError
        If there is no such measurement.
    """
    known = measurements()
    if name not in known:
        hint = did_you_mean(name, known, "photosite measure --list lists them")
        raise InputError("measurement", value=name, expected="the id of a measurement", hint=hint)
    return known[name]


@dataclass(frozen=True)
class ValueName:
    """Which value of a measurement: `edge-sfr.mtf50.G`, or every part of `edge-sfr.mtf50`."""

    measurement: str
    quantity: str
    part: str | None = None

    @classmethod
    def parse(cls, text: str) -> ValueName:
        """Parse MEASUREMENT.QUANTITY.PART; the part may be left out.

        Raises
        ------
        InputError
            If the text is not of the form, or the measurement or its quantity is unknown.

        Examples
        --------
        >>> ValueName.parse("edge-sfr.mtf50.G").quantity
        'mtf50'
        """
        name, _, rest = text.strip().partition(".")
        quantity, dot, part = rest.partition(".")
        if name not in measurements() and (owners := _with_quantity(name)):
            raise InputError("measurement", value=name, expected=f"given first, as in {', '.join(owners)}")
        known = measurement(name).quantities
        if quantity not in known:
            raise InputError("quantity", where=name, value=quantity, expected=f"one of {', '.join(known)}")
        return cls(name, quantity, part if dot else None)

    def __str__(self) -> str:
        return ".".join(filter(None, (self.measurement, self.quantity, self.part)))

    @property
    def unit(self) -> str:
        """The unit of the value; "" for ratios."""
        return measurement(self.measurement).quantities[self.quantity].unit

    @property
    def label(self) -> str:
        """The value in words, without its unit."""
        label = measurement(self.measurement).quantities[self.quantity].label
        return f"{self.measurement}: {', '.join(filter(None, (label, self.part)))}"

    def among(self, values: Mapping[tuple[str, str], Estimate]) -> dict[str, Estimate]:
        """Return the values of a result that have the name, by part."""
        return {
            part: estimate
            for (quantity, part), estimate in values.items()
            if quantity == self.quantity and self.part in (None, part)
        }


def axis_label(name: str) -> str:
    """Return the label of an axis or a row: words and unit of a value of the registry, else the name itself.

    Examples
    --------
    >>> axis_label("edge-sfr.mtf50.G"), axis_label("snr_db")
    ('edge-sfr: MTF50, G (cycles/pixel)', 'snr_db')
    """
    if name.partition(".")[0] not in measurements():
        return name
    value = ValueName.parse(name)
    return f"{value.label} ({value.unit})" if value.unit else value.label


def simulated_values() -> dict[ValueName, Measurement]:
    """Return the values that simulated charts have, with their measurements.

    Examples
    --------
    >>> next(iter(simulated_values()))
    ValueName(measurement='oecf', quantity='signal_per_luminance', part=None)
    """
    return {
        ValueName(id, quantity): entry
        for id, entry in measurements().items()
        for quantity in entry.quantities
        if quantity not in entry.of_photograph
    }


def _with_quantity(name: str) -> list[str]:
    """Return names of values whose quantity has a name, or continues it."""
    return [
        f"{id}.{quantity}"
        for id, entry in measurements().items()
        for quantity in entry.quantities
        if quantity == name or quantity.startswith(f"{name}_")
    ][:_MOST_NAMES]


def charts_measured() -> tuple[str, ...]:
    """Return the names of the charts that any measurement works on, in alphabetical order."""
    return tuple(sorted({chart for entry in measurements().values() for chart in entry.charts}))
