"""Fields that were read from a YAML file, validated by Pydantic, with errors that name the line."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

from pydantic import TypeAdapter, ValidationError

from photosite.errors import FileError
from photosite.files.yaml import line_of
from photosite.values.validated import input_error


def validated(kind: Any, data: Any, path: str | PathLike[str], section: str = "", context: Any = None) -> Any:
    """Return the value of a type that the fields describe.

    Parameters
    ----------
    kind
        A Pydantic model, or another type that Pydantic validates.
    data
        The fields, as `photosite.files.yaml` reads them.
    path
        The file, for messages.
    section
        Section of the file that the fields are in; empty for the top level.
    context
        What the validators of the type need, see Pydantic's `ValidationInfo`.

    Raises
    ------
    FileError
        If the fields are invalid; with the line of the deepest part of the location that the file has.
    """
    try:
        return TypeAdapter(kind).validate_python(data, context=context)
    except ValidationError as error:
        found, location = input_error(error), error.errors()[0]["loc"]
    inner = found.where.split(".") if found.where and not location else ()
    line = line_at(data, (*location, *inner, found.what.partition("[")[0]))
    if line is None and section:
        line = data.lc.line + 1 if hasattr(data, "lc") else None
    where = ".".join(part for part in (section, found.where) if part) or None
    raise FileError(path, found.what, line, **found.fields | {"where": where}) from None


def line_at(data: Any, location: Sequence[str | int]) -> int | None:
    """Return the line of the deepest part of the location that the file has."""
    line: int | None = None
    for part in location:
        if (found := line_of(data, part)) is None:
            break
        line, data = found, data[part]
    return line
