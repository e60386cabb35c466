"""Base of option objects: Pydantic models whose errors are photosite's own."""

from __future__ import annotations

from typing import Annotated, Any, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from photosite.errors import InputError, did_you_mean

PositiveNumber = Annotated[float, Field(gt=0, allow_inf_nan=False)]

_EXPECTED = {
    "greater_than": "above {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "below {lt:g}",
    "less_than_equal": "at most {le:g}",
    "finite_number": "finite",
    "literal_error": "{expected}",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "value_error": "{error}",
}
"""The condition that each kind of Pydantic error states."""


class Validated(BaseModel):
    """Options that travel together, checked once when the object is made.

    An invalid or unknown option raises `InputError` with the option's name.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", arbitrary_types_allowed=True)

    def __init__(self, **options: Any) -> None:
        plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in options.items()}
        try:
            super().__init__(**plain)
        except ValidationError as error:
            raise self._input_error(error) from None

    @classmethod
    def _input_error(cls, error: ValidationError) -> InputError:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else "options"
        if first["type"] == "extra_forbidden":
            return cls.unknown(name)
        expected = _EXPECTED.get(first["type"], "valid").format(**first.get("ctx", {}))
        return InputError(name, value=first["input"], expected=expected)

    @classmethod
    def unknown(cls, name: str) -> InputError:
        """Return the error for an option that does not exist."""
        known = list(cls.model_fields)
        return InputError(
            f"unknown option '{name}'", hint=did_you_mean(name, known) if known else "There are no options"
        )

    def given(self) -> dict[str, Any]:
        """Return the options that differ from their defaults."""
        defaults = {name: field.default for name, field in type(self).model_fields.items()}
        values = {name: getattr(self, name) for name in defaults}
        return {
            name: value
            for name, value in values.items()
            if value is not defaults[name] and (defaults[name] is None or value != defaults[name])
        }


def check_choice(name: str, value: object, choices: Any) -> None:
    """Raise `InputError` unless a value is one of a `Literal`'s.

    Examples
    --------
    >>> from typing import Literal
    >>> check_choice("waveform", "sin", Literal["sine", "square"])
    Traceback (most recent call last):
    photosite.errors.InputError: waveform must be 'sine' or 'square', got 'sin'. Did you mean 'sine'?
    """
    known = get_args(choices)
    if value not in known:
        raise InputError(
            name, value=value, expected=" or ".join(map(repr, known)), hint=did_you_mean(str(value), map(str, known))
        )
