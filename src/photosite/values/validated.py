"""Base classes of Pydantic models, with errors that are photosite's own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError

from photosite.errors import InputError, did_you_mean
from photosite.values.limits import check_magnitude
from photosite.values.shown import short_repr

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NonNegativeNumber = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
PositiveNumber = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]

_EXPECTED = {
    "greater_than": "above {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "below {lt:g}",
    "less_than_equal": "at most {le:g}",
    "finite_number": "a finite number",
    "literal_error": "{expected}",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "list_type": "a list",
    "too_short": "a list of {min_length} or more entries",
    "string_too_short": "text with at least {min_length} characters",
    "string_pattern_mismatch": "text that matches {pattern}",
    "value_error": "{error}",
}
"""The condition that each kind of Pydantic error states."""

_UNKNOWN_FIELD = "unknown_field"


class Section(BaseModel):
    """Fields of a file: immutable, without unknown fields, and within the limits of the units that they state."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)

    def __repr__(self) -> str:
        return short_repr(self, {name: getattr(self, name) for name in type(self).model_fields})

    def __str__(self) -> str:
        return repr(self)

    def __dir__(self) -> Iterable[str]:
        fields = type(self).model_fields
        names = (name for name in super().__dir__() if not name.startswith("_"))
        return [name for name in names if name in fields or not hasattr(BaseModel, name)]

    @model_validator(mode="before")
    @classmethod
    def _reject_unknown_names(cls, raw: Any) -> Any:
        fields = list(cls.model_fields)
        if isinstance(raw, cls):
            return raw
        if not isinstance(raw, Mapping):
            raise ValueError(f"a mapping {{{', '.join(fields)}}}")
        reject_unknown(raw, fields)
        return raw

    @field_validator("*", mode="after")
    @classmethod
    def _check_magnitude(cls, value: Any, info: ValidationInfo) -> Any:
        name = str(info.field_name)
        check_magnitude(name, value, unit_of(cls.model_fields[name]))
        return value


def unit_of(field: FieldInfo) -> str | None:
    """Return the unit that a field of a model states, or None."""
    stated = field.json_schema_extra
    return str(stated.get("unit")) if isinstance(stated, dict) else None


def reject_unknown(raw: Mapping[Any, Any], known: Sequence[str], *location: int | str) -> None:
    """Raise an error in a validator for the first unknown field, with the most similar known one."""
    for name in raw:
        if name not in known:
            unknown = InputError(f"unknown field '{name}'", hint=did_you_mean(str(name), known))
            raise located(unknown, *location, name if isinstance(name, str | int) else str(name), kind=_UNKNOWN_FIELD)


class Validated(BaseModel):
    """Options that travel together, checked once when the object is made.

    An invalid or unknown option raises `InputError` with the option's name.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", arbitrary_types_allowed=True)

    def __init__(self, **options: Any) -> None:
        for name in options:
            if name not in type(self).model_fields:
                raise self.unknown(name)
        plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in options.items()}
        try:
            super().__init__(**plain)
        except ValidationError as error:
            raise input_error(error) from None

    @field_validator("*", mode="after")
    @classmethod
    def _check_magnitude(cls, value: Any, info: ValidationInfo) -> Any:
        check_magnitude(str(info.field_name), value)
        return value

    @classmethod
    def unknown(cls, name: str) -> InputError:
        """Return the error for an option that does not exist."""
        known = list(cls.model_fields)
        hint = did_you_mean(name, known) if known else "There are no options"
        return InputError(f"unknown option '{name}'", hint=hint)

    def given(self) -> dict[str, Any]:
        """Return the options that differ from their defaults."""
        defaults = {name: field.default for name, field in type(self).model_fields.items()}
        values = {name: getattr(self, name) for name in defaults}
        return {name: value for name, value in values.items() if _differs(value, defaults[name])}


def _differs(value: object, default: object) -> bool:
    return value is not default and (default is None or value != default)


def located(error: InputError, *location: int | str, kind: str = "value_error") -> ValidationError:
    """Return an error to raise in a validator, with the location below the validated value."""
    cause = {"error": error}
    details = InitErrorDetails(type=PydanticCustomError(kind, "invalid", cause), loc=location, input=None)
    return ValidationError.from_exception_data("located", [details])


def input_error(error: ValidationError) -> InputError:
    """Return the first error of a validation; `where` is the section of the field.

    Examples
    --------
    >>> class Lens(Section):
    ...     f_number: PositiveNumber
    >>> try:
    ...     Lens.model_validate({"f_number": -8})
    ... except ValidationError as error:
    ...     print(input_error(error))
    f_number must be above 0, got -8
    """
    first = error.errors()[0]
    location, kind, context = first["loc"], first["type"], first.get("ctx", {})
    parents, field = location[:-1], location[-1] if location else ""
    found = context.get("error")
    if isinstance(found, InputError):
        if kind != _UNKNOWN_FIELD and found.what != field:
            parents = location
    elif kind == "missing":
        found = InputError(f"field '{field}' is missing")
    else:
        named = max((k for k, part in enumerate(location) if isinstance(part, str)), default=0)
        known = _EXPECTED.get(kind)
        expected = first["msg"].removeprefix("Input should be ") if known is None else known.format(**context)
        parents = location[:named]
        found = InputError(_dotted(location[named:]), value=first["input"], expected=expected)
    return found.within(_dotted(parents)) if parents else found


def _dotted(location: tuple[int | str, ...]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).removeprefix(".")
