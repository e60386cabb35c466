"""Units of a sensor file: values as data sheets state them, converted to those of the model and back.

The gain is stated as conversion gain, voltage swing and analog gain, or as system gain K, or both:

    K = conversion_gain_uv_per_e 1e-6 analog_gain 2^bits / voltage_swing_v        DN per electron

Noise and dark current are stated in volts at the pixel, electrons or DN. Uncertainties and their correlations are
propagated to first order, so that a value in electrons keeps its own uncertainty and not that of the system gain.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from decimal import Decimal
from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from photosite.errors import InputError, did_you_mean
from photosite.files.yaml import line_of
from photosite.sensor.quantity import Covariance, as_measured
from photosite.values.limits import check_magnitude
from photosite.values.uncertain import JointCovariance, Measured, Source, Uncertain, correlated
from photosite.values.validated import input_error, located, reject_unknown, unit_of

Values = dict[str, Uncertain]
Stated = dict[str, Measured]

CONVERSION, SWING, AMPLIFIER = "conversion_gain_uv_per_e", "voltage_swing_v", "analog_gain"
DN_PER_E, E_PER_DN = "system_gain_dn_per_e", "system_gain_e_per_dn"
GAINS = (CONVERSION, SWING, AMPLIFIER)
_MICRO = 1e-6
_MILLI = 1e3
_NEGLIGIBLE = 1e-4
_MOST_BITS = 16

ASSUMED_SWING = Measured(1.0, 0.0, "assumed: only the system gain is stated; the swing scales values in volts", True)
"""Voltage swing where a file states the gain without volts."""

UNITS: dict[str, tuple[str, ...]] = {
    "width_um": ("pitch_um",),
    "height_um": ("pitch_um",),
    "well_capacity_e": ("full_well_e",),
    "read_noise_mv": ("read_noise_e", "read_noise_dn"),
    "row_noise_mv": ("row_noise_e", "row_noise_dn"),
    "column_noise_mv": ("column_noise_e", "column_noise_dn"),
    "dsnu_mv": ("dsnu_e", "dsnu_dn"),
    "dark_voltage_mv_per_s": ("dark_current_e_per_s", "dark_current_dn_per_s"),
}
"""The model's fields and their other units in a file; the gains are apart."""

IN_ELECTRONS = {name: others[0] for name, others in UNITS.items() if name.endswith(("_mv", "_mv_per_s"))}
"""The model's fields in volts, and the same in electrons."""

REQUIRED = {
    "pixel": {"pixel width": "width_um", "pixel height": "height_um", "full well": "well_capacity_e"},
    "noise": {"read noise": "read_noise_mv", "DSNU": "dsnu_mv"},
}
"""Per section, the quantities that a file must state in one of their units."""

SETTING_VALUES = (
    *(CONVERSION, AMPLIFIER, "well_capacity_e", "read_noise_mv", "row_noise_mv", "column_noise_mv"),
    *("dsnu_mv", "prnu_percent", "dark_voltage_mv_per_s", "dcnu_percent", "black_level_dn"),
)
"""Fields of the model that change with the gain setting."""

_OTHER_UNITS = {*(name for names in UNITS.values() for name in names), DN_PER_E, E_PER_DN}


def model_fields_of(name: str) -> tuple[str, ...]:
    """Return the model's fields that a field in another unit sets; empty for the model's own fields.

    Examples
    --------
    >>> model_fields_of("pitch_um"), model_fields_of("width_um"), model_fields_of("system_gain_dn_per_e")
    (('width_um', 'height_um'), (), ('analog_gain',))
    """
    if name in (DN_PER_E, E_PER_DN):
        return (AMPLIFIER,)
    return tuple(own for own, others in UNITS.items() if name in others)


def choices_of(section: str) -> list[list[str]]:
    """Return the fields of which a section must have one, for each required quantity."""
    return [[own, *UNITS[own]] for own in REQUIRED.get(section, {}).values()]


def in_model_units(raw: Any, sections: Mapping[str, tuple[type[BaseModel], type[BaseModel]]]) -> Any:
    """Return the fields of a sensor file with all values in the units of the model.

    Parameters
    ----------
    raw
        The file's fields. Anything else, and sections that are not mappings, are left to the model to reject.
    sections
        Per section, the model of its fields and the model of its fields in other units.

    Raises
    ------
    ValidationError
        With an `InputError` that names the quantity that is missing, or the values that contradict each other.
    """
    if not isinstance(raw, Mapping) or not all(isinstance(raw.get(name), Mapping) for name in sections):
        return raw
    place: dict[str, str] = {}
    for section, (own, other) in sections.items():
        known = [*own.model_fields, *other.model_fields]
        reject_unknown(raw[section], known, section)
        place |= dict.fromkeys(known, section)
    _check_complete(raw)
    bits = raw["readout"].get("bits")
    settings = raw.get("gain_settings")
    has_units = any(name in raw[place[name]] for name in _OTHER_UNITS)
    if not (has_units or settings) or not isinstance(bits, int) or bits < 1:
        return raw
    fields = {name: raw[place[name]][name] for name in place if name in raw[place[name]]}
    stated = {
        name: value
        for section, kinds in sections.items()
        for name, value in _quantities(raw[section], kinds, (section,))
    }
    result = dict(raw)
    if has_units:
        check_volts(stated, {name: (section, name) for name, section in place.items()})
        _check_agreement(stated, bits, fields, {name: (section, name) for name, section in place.items()}, raw)
        values = _to_model(_inputs(stated, _stated_covariance(raw, stated, ())), bits)
        for section in sections:
            result[section] = {key: value for key, value in raw[section].items() if key not in _OTHER_UNITS}
        for name, value in values.items():
            if name not in result[place[name]] and (derived := _as_field(name, value, stated)) is not None:
                result[place[name]][name] = derived
        result["covariance"] = _covariance(values, digits=15)
    if isinstance(settings, Sequence) and all(isinstance(entry, Mapping) for entry in settings):
        kinds = tuple(kind for pair in sections.values() for kind in pair)
        top = {name: value for part in sections for name, value in result[part].items()}
        shared = _stated_covariance(result, {name: Measured(0.0) for name in place}, ())
        result["gain_settings"] = [
            _setting_in_model_units(entry, ("gain_settings", number), kinds, top, shared, bits)
            for number, entry in enumerate(settings)
        ]
    return result


def _setting_in_model_units(
    entry: Mapping[str, Any],
    place: tuple[str | int, ...],
    kinds: tuple[type[BaseModel], ...],
    top: Mapping[str, Any],
    top_covariance: Covariance | None,
    bits: int,
) -> dict[str, Any]:
    """Return an entry of `gain_settings` with all its values, those that it does not state from the top of the file.

    Without a conversion gain, a system gain sets the analog gain. With another conversion gain, noise and dark current
    are taken from the top of the file in electrons.
    """
    units = [name for name in _OTHER_UNITS if {*model_fields_of(name)} <= {*SETTING_VALUES}]
    reject_unknown(entry, ["setting", "covariance", *SETTING_VALUES, *units], *place)
    stated = dict(_quantities(entry, kinds, place))
    zero = ("row_noise_mv", "column_noise_mv", "dark_voltage_mv_per_s", "dcnu_percent", "black_level_dn")
    defaults = {AMPLIFIER: 1.0, **dict.fromkeys(zero, 0.0)}
    replaced = {own for name in stated for own in (name, *model_fields_of(name))}
    if AMPLIFIER in stated and (DN_PER_E in stated or E_PER_DN in stated):
        replaced.add(CONVERSION)
    inherited = [name for name in (*SETTING_VALUES, SWING) if name not in replaced]
    above = {name: as_measured(top.get(name, defaults.get(name))) for name in (*SETTING_VALUES, SWING)}
    shared = top_covariance and top_covariance.without({*top_covariance.names} - {*above})
    if above[SWING] == ASSUMED_SWING:
        check_volts(stated, {name: (*place, name) for name in stated})
    if CONVERSION in replaced:  # electrons, not volts, are those of the other setting
        inherited = [IN_ELECTRONS.get(name, name) for name in inherited]
        above, shared = in_file_units(above, shared, bits, inherited)
    shared = shared and shared.without({*shared.names} - {*inherited})
    complete = stated | {name: above[name] for name in inherited}
    _check_agreement(complete, bits, entry, {name: (*place, name) for name in complete}, None)
    values = _to_model(_inputs(complete, shared, _stated_covariance(entry, complete, place)), bits)
    fields = {name: entry.get(name, complete.get(name)) for name in SETTING_VALUES}
    result = {
        name: _as_field(name, values[name], complete) if field is None else field for name, field in fields.items()
    }
    own = {name: value for name, value in values.items() if name in SETTING_VALUES}
    setting = {"setting": entry["setting"]} if "setting" in entry else {}
    return {**setting, **result, "covariance": _covariance(own, digits=15)}


def _check_complete(raw: Mapping[str, Any]) -> None:
    """Raise an error for quantities without a value in any unit."""
    for section, quantities in REQUIRED.items():
        for quantity, own in quantities.items():
            names = [own, *UNITS[own]]
            if not any(name in raw[section] for name in names):
                raise located(InputError(f"{quantity} is missing", hint=f"Give {_either(names)}"), section)
    pixel, readout = raw["pixel"], raw["readout"]
    if not (DN_PER_E in readout or E_PER_DN in readout):
        missing = [name for name in (CONVERSION, SWING) if name not in pixel]
        if missing:
            hint = f"Give {_either([f'pixel.{name}' for name in missing], 'and')}, or readout.{DN_PER_E} or {E_PER_DN}"
            raise located(InputError("gain is incomplete", hint=hint), "pixel")


def check_volts(stated: Stated, places: Mapping[str, tuple[str | int, ...]]) -> None:
    """Raise an error for noise in volts that is stated without a gain in volts: its electrons are unknown."""
    if CONVERSION in stated or SWING in stated:
        return
    for name, electrons in IN_ELECTRONS.items():
        if name in stated and stated[name].value:
            expected = f"stated with pixel.{CONVERSION} or pixel.{SWING}"
            hint = f"Give one of them, or {electrons} instead"
            raise located(InputError(name, value=stated[name].value, expected=expected, hint=hint), *places[name])


def _either(names: list[str], word: str = "or") -> str:
    return f" {word} ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _quantities(
    fields: Mapping[str, Any], kinds: tuple[type[BaseModel], ...], place: tuple[str | int, ...]
) -> Iterator[tuple[str, Measured]]:
    """Yield the values with an uncertainty that fields state, checked by the fields' models and their units."""
    for kind in kinds:
        for name, field in kind.model_fields.items():
            if field.annotation is Measured and name in fields:
                try:
                    value = _adapter(kind, name).validate_python(fields[name])
                except ValidationError as error:
                    raise located(input_error(error), *place, name) from None
                try:
                    check_magnitude(name, value, unit_of(field))
                except InputError as error:
                    raise located(error, *place, name) from None
                yield name, value


def check_quantities(fields: Mapping[str, float], kinds: Iterable[type[BaseModel]]) -> None:
    """Raise `InputError` for a value outside the limits of its field."""
    try:
        for _ in _quantities(fields, tuple(kinds), ()):
            pass
    except ValidationError as error:
        found = input_error(error)
        raise InputError(found.where or found.what, value=found.value, expected=found.expected) from None


@cache
def _adapter(kind: type[BaseModel], name: str) -> TypeAdapter[Measured]:
    field = kind.model_fields[name]
    annotated: Any = Annotated[(field.annotation, *field.metadata)]
    return TypeAdapter(annotated)


def _stated_covariance(raw: Mapping[str, Any], stated: Stated, place: tuple[str | int, ...]) -> Covariance | None:
    """Return the correlations that a file states, of values that it states."""
    if raw.get("covariance") is None:
        return None
    try:
        shared = Covariance.model_validate(raw["covariance"])
    except ValidationError as error:
        raise located(input_error(error), *place, "covariance") from None
    if unknown := [name for name in shared.names if name not in stated]:
        wrong = InputError(f"the file states no value '{unknown[0]}'", hint=did_you_mean(unknown[0], stated))
        raise located(wrong, *place, "covariance", "names")
    return shared


def _inputs(values: Stated, *shared: Covariance | None) -> Values:
    """Return values for propagation, with their correlations."""
    names, count = list(values), len(values)
    correlation = np.eye(count)
    for part in shared:
        correlation += 0.0 if part is None else part.matrix(names, np.ones(count)) - np.eye(count)
    # Unit variances: rounding errors of the decomposition would be those of the largest unit.
    deviates = correlated(np.zeros(count), correlation)
    return {
        name: values[name].standard_uncertainty * deviate + values[name].value
        for name, deviate in zip(names, deviates, strict=True)
    }


def _to_model(stated: Values, bits: int) -> Values:
    """Return the values in the model's units, as far as they are stated, and all gains."""
    values = {name: value for name, value in stated.items() if name not in _OTHER_UNITS} | _gains(stated, bits)
    for name, others in UNITS.items():
        given = next((other for other in others if other in stated), None)
        if name not in values and given is not None:
            values[name] = stated[given] * _factor(given, values, bits)
    return values


def _gains(stated: Values, bits: int) -> Values:
    """Return conversion gain, voltage swing and analog gain; what the system gain leaves open is assumed."""
    conversion, swing, amplifier = (stated.get(name) for name in GAINS)
    one = Uncertain(1.0)
    gain = stated[DN_PER_E] if DN_PER_E in stated else 1.0 / stated[E_PER_DN] if E_PER_DN in stated else None
    if not 1 <= bits <= _MOST_BITS:
        raise InputError("bits", value=bits, expected=f"1 to {_MOST_BITS}")
    codes = float(1 << bits)
    if gain is not None:
        if conversion is not None and swing is not None:
            amplifier = amplifier or gain * swing / (conversion * _MICRO * codes)
        elif conversion is not None:
            swing = conversion * _MICRO * codes * (amplifier or one) / gain
        else:
            swing = swing or Uncertain(ASSUMED_SWING.value)
            conversion = gain * swing / (_MICRO * codes * (amplifier or one))
    assert conversion is not None
    assert swing is not None
    return {CONVERSION: conversion, SWING: swing, AMPLIFIER: amplifier or one}


def _factor(name: str, gains: Values, bits: int) -> Uncertain:
    """Return the model's unit per unit of a field: 1, or mV at the pixel per electron or DN."""
    if name.endswith(("_dn", "_dn_per_s")):
        return _MILLI * gains[SWING] / (gains[AMPLIFIER] * float(1 << bits))
    if name in IN_ELECTRONS.values():
        return gains[CONVERSION] * (1.0 / _MILLI)
    return Uncertain(1.0)


def _in_unit(name: str, values: Values, bits: int) -> Uncertain:
    """Return a value of the model as a field of a file."""
    if name in values:
        return values[name]
    if name in (DN_PER_E, E_PER_DN):
        gain = values[CONVERSION] * values[AMPLIFIER] * (_MICRO * float(1 << bits)) / values[SWING]
        return gain if name == DN_PER_E else 1.0 / gain
    return values[model_fields_of(name)[0]] / _factor(name, values, bits)


def _check_agreement(
    stated: Stated,
    bits: int,
    fields: Mapping[str, Any],
    places: Mapping[str, tuple[str | int, ...]],
    raw: Mapping[str, Any] | None,
) -> None:
    """Raise an error for a value that the others contradict, beyond their last digits and twice their uncertainties.

    - `fields`, `places`, `raw`: The fields as they were written, their locations, and the file with its lines.
    """
    limits: Values = {}
    names: dict[Source, str] = {}
    for name, quantity in stated.items():
        field = fields.get(name, quantity.value)
        number = field["value"] if isinstance(field, Mapping) else field
        number = quantity.value if isinstance(number, Measured) else number
        exact = name in (AMPLIFIER, SWING) and isinstance(number, int)  # a gain of 1, a swing of 1 V
        digit = 0.0 if exact else _half_digit(number)
        limits[name] = Uncertain.of(quantity.value, digit + 2.0 * quantity.standard_uncertainty)
        names |= dict.fromkeys(limits[name].parts, name)
    values = _to_model(limits, bits)
    for name, value in limits.items():
        own = UNITS.keys() & model_fields_of(name) or {name}
        for each in own:  # a pitch is width and height
            follows = values[each] if len(own) > 1 else _in_unit(name, values, bits)
            off = follows - value
            allowed = math.fsum(map(abs, off.parts.values())) + 1e-9 * abs(value.value)
            if abs(off.value) <= allowed:
                continue
            others = [names[part] for part in off.parts if names[part] != name]
            text = _either([_with_line(other, raw and raw[str(places[other][0])]) for other in others], "and")
            expected = f"about {follows.value:.3g}, from {text}"
            hint = "Correct the one that is wrong, or remove it"
            raise located(InputError(name, value=value.value, expected=expected, hint=hint), *places[name])


def _with_line(name: str, section: Mapping[str, Any] | None) -> str:
    line = line_of(section, name)
    return name if line is None else f"{name} (line {line})"


def _half_digit(number: Any) -> float:
    """Return half a unit of a number's last digit, as it was written: 0.005 for 2.40; at most a tenth of the number.

    Examples
    --------
    >>> _half_digit(12), _half_digit(0.5), _half_digit(1)
    (0.5, 0.05, 0.1)
    """
    decimals, width = getattr(number, "_prec", None), getattr(number, "_width", None)
    if decimals is not None and width is not None and getattr(number, "_exp", None) is None:
        exponent = -(width - decimals - 1 - bool(number._m_sign))  # ruamel.yaml keeps the form of floats
    else:
        exponent = int(Decimal(repr(number if isinstance(number, int) else float(number))).as_tuple().exponent)
    return float(min(0.5 * 10.0**exponent, 0.1 * abs(number)))


def _as_field(name: str, value: Uncertain, stated: Stated) -> Measured | None:
    """Return a derived value with the origin of the stated one; None for the model's default."""
    given = [unit for unit in (name, *UNITS.get(name, ())) if unit in stated]
    if name in GAINS:
        given = [unit for unit in (DN_PER_E, E_PER_DN) if unit in stated]
        if name == SWING and CONVERSION not in stated:
            return ASSUMED_SWING
        if name == AMPLIFIER and not (given and CONVERSION in stated and SWING in stated):
            return None
    origin = stated[given[0]]
    return Measured(value.value, value.standard_uncertainty, origin.source, origin.assumed)


def _covariance(values: Values, digits: int) -> Covariance | None:
    """Return the correlations of values; None if all are independent."""
    joint = JointCovariance.of(values)
    shared = Covariance.of(joint.names, joint.matrix, digits)
    if shared is None or np.array_equal(np.array(shared.correlation), np.eye(len(shared.names))):
        return None
    return shared


def in_file_units(
    values: Stated, covariance: Covariance | None, bits: int, names: Iterable[str]
) -> tuple[Stated, Covariance | None]:
    """Return values of the model in the units of a file, with their correlations.

    Parameters
    ----------
    values, covariance, bits
        Values of the model by their fields, their correlations, and the converter's bit depth.
    names
        The fields of the file.
    """
    inputs = _inputs(values, covariance)
    negligible = _NEGLIGIBLE * max((value.relative for value in inputs.values() if value.value), default=0.0)
    found, result = {}, {}
    for name in names:
        value = _in_unit(name, inputs, bits)
        if name in values:
            found[name], result[name] = value, values[name]
            continue
        if value.standard_uncertainty <= negligible * abs(value.value):  # parts that cancel but for their rounding
            value = Uncertain(value.value)
        origin = values[CONVERSION if name in (DN_PER_E, E_PER_DN) else model_fields_of(name)[0]]
        number, uncertainty = float(f"{value.value:.12g}"), float(f"{value.standard_uncertainty:.6g}")
        found[name], result[name] = value, Measured(number, uncertainty, origin.source, origin.assumed)
    return result, _covariance(found, digits=10)


def stated_names(names: Set[str], values: Stated) -> list[str]:
    """Return the fields in which a file states the values of the model, given the fields that it had before.

    A value keeps its units. Gains that follow from the system gain are left out. A file that states no volts gets new
    values in electrons.
    """
    if values.get("width_um") != values.get("height_um"):
        names = names - {"pitch_um"}
    gains = [name for name in (DN_PER_E, E_PER_DN) if name in names]
    implied: set[str] = set()
    if gains:
        is_one = {name: (values[name].value, values[name].standard_uncertainty) == (1.0, 0.0) for name in GAINS}
        if CONVERSION not in names:
            implied = {CONVERSION, *(name for name in (SWING, AMPLIFIER) if is_one[name])}
        else:
            implied = {AMPLIFIER} if SWING in names else {SWING, *([AMPLIFIER] if is_one[AMPLIFIER] else [])}
    in_volts = not gains or CONVERSION in names or SWING in names
    result = []
    for own in values:
        others = [name for name in UNITS.get(own, ()) if name in names]
        if own in names or not (others or own in implied):
            result.append(own if in_volts else IN_ELECTRONS.get(own, own))
        result += others
    return list(dict.fromkeys([*result, *gains]))
