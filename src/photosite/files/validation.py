"""Errors of a Pydantic model's validation as errors of the file that the data come from, with the line."""

from __future__ import annotations

import types
import typing
from collections.abc import Sequence
from os import PathLike
from typing import Any

from pydantic import BaseModel, ValidationError

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import line_of

_EXPECTED = {
    "string_type": "text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": ("gt", "above {}"),
    "greater_than_equal": ("ge", "{} or above"),
    "less_than": ("lt", "below {}"),
    "less_than_equal": ("le", "at most {}"),
    "literal_error": ("expected", "{}"),
    "too_short": ("min_length", "a list with at least {} entries"),
    "string_too_short": ("min_length", "text with at least {} characters"),
    "string_pattern_mismatch": ("pattern", "text that matches {}"),
}


def validation_error(model: type[BaseModel], error: ValidationError) -> InputError:
    """Return the most helpful of a validation's errors, with the field, its section and its value.

    Examples
    --------
    >>> class Lens(BaseModel, extra="forbid"):
    ...     f_number: float
    >>> try:
    ...     Lens.model_validate({"f_numbr": 8})
    ... except ValidationError as error:
    ...     print(validation_error(Lens, error))
    unknown field 'f_numbr'. Did you mean 'f_number'?
    """
    return _described(model, _first(error))


def file_error(model: type[BaseModel], error: ValidationError, data: Any, path: str | PathLike[str]) -> FileError:
    """Return a validation's error as that of the file that `data` were read from by `photosite.files.yaml`."""
    first = _first(error)
    return _described(model, first).in_file(path, line_at(data, first["loc"]))


def _first(error: ValidationError) -> Any:
    """Return the error to report: a misspelt field is also a missing one, and the misspelling helps more."""
    found = error.errors()
    return next((e for e in found if e["type"] == "extra_forbidden"), found[0])


def _described(model: type[BaseModel], error: Any) -> InputError:
    *parents, field = error["loc"] or ("",)
    where = _dotted(parents) or None
    kind, context = error["type"], error.get("ctx", {})
    if kind == "extra_forbidden":
        hint = did_you_mean(str(field), known_fields(model, parents))
        return InputError(f"unknown field '{field}'", where=where, hint=hint)
    if kind == "missing":
        return InputError(f"field '{field}' is missing", where=where)
    if kind in _EXPECTED:
        return InputError(str(field), where=where, value=error["input"], expected=_EXPECTED[kind])
    if kind in _BOUNDS:
        name, text = _BOUNDS[kind]
        return InputError(str(field), where=where, value=error["input"], expected=text.format(context[name]))
    cause = context.get("error")
    if isinstance(cause, InputError):
        place = _dotted(parents if cause.what == field else error["loc"])
        return cause.within(place) if place else cause
    return InputError(error["msg"].removeprefix("Value error, "), where=_dotted(error["loc"]) or None)


def _dotted(location: Sequence[str | int]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def known_fields(model: type[BaseModel], parents: Sequence[str | int]) -> list[str]:
    """Return the fields of the section that a location names."""
    found: Any = model
    for part in parents:
        if isinstance(found, type) and issubclass(found, BaseModel) and part in found.model_fields:
            found = _model_in(found.model_fields[str(part)].annotation)
    return list(found.model_fields) if isinstance(found, type) and issubclass(found, BaseModel) else []


def _model_in(annotation: Any) -> Any:
    """Return the model in an annotation such as `Model | None`, `dict[str, Model]` or `tuple[Model, ...]`."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((m for inner in typing.get_args(annotation) if (m := _model_in(inner)) is not None), None)


def line_at(data: Any, location: Sequence[str | int]) -> int | None:
    """Return the line of the deepest part of the location that the file has."""
    line: int | None = None
    for part in location:
        if (found := line_of(data, part)) is None:
            break
        line = found
        data = data[part]
    return line
