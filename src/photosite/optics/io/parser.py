"""Fields of a YAML file as Pydantic models and values, with errors that name the line and the section."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.validation import known_fields, line_at

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
PositiveNumber = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]

_NOT_A_MAPPING = ("dict_type", "model_type", "model_attributes_type")
_Model = TypeVar("_Model", bound=BaseModel)
_Built = TypeVar("_Built")


class Section(BaseModel):
    """A mapping of the file; unknown fields are rejected."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class LocatedError(Exception):
    """An `InputError` with its location inside a section."""

    def __init__(self, error: InputError, *location: str | int) -> None:
        super().__init__(str(error))
        self.error = error
        self.location = location


@contextmanager
def located_at(*location: str | int) -> Iterator[None]:
    """Give an `InputError` its location inside a section."""
    try:
        yield
    except InputError as error:
        raise LocatedError(error, *location) from None


class Parser:
    """The fields of a file.

    Parameters
    ----------
    path
        The file.
    data
        The fields, as `photosite.files.yaml` reads them.
    section
        Section of the file that holds the fields; empty for the top level.
    """

    def __init__(self, path: Path, data: Mapping[str, Any], section: str = "") -> None:
        self.path = path
        self.data = data
        self.section = section

    def located(self, error: InputError, location: Sequence[str | int]) -> FileError:
        """Return the error as one of the file, with the line of the deepest part of the location that exists."""
        parts = list(location)
        if parts and parts[-1] == error.what:
            parts.pop()
        where = ".".join(part for part in (self.section, *map(str, parts)) if part)
        line = self._line((*parts, error.what.partition("[")[0]))
        return (error.within(where) if where else error).in_file(self.path, line)

    def _line(self, location: Sequence[str | int]) -> int | None:
        if (line := line_at(self.data, location)) is not None or not self.section:
            return line
        position = getattr(getattr(self.data, "lc", None), "line", None)
        return None if position is None else position + 1

    def validated(self, model: type[_Model], data: Any, above: tuple[str, ...] = ()) -> _Model:
        """Return the model of a mapping, which is at the location `above`."""
        try:
            return model.model_validate(data)
        except ValidationError as error:
            found = error.errors()
        # A misspelt field is also a missing one; the misspelling helps more.
        first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
        *parents, last = (*above, *first["loc"]) or ("",)
        if first["type"] == "extra_forbidden":
            hint = did_you_mean(str(last), known_fields(model, first["loc"][:-1]))
            unknown = self.located(InputError(f"unknown field '{last}'", hint=hint), parents)
            unknown.line = self._line((*parents, last))
            raise unknown
        if first["type"] == "missing":
            raise self.located(InputError(f"field '{last}' is missing"), parents)
        if isinstance(own := first.get("ctx", {}).get("error"), InputError):
            raise self.located(own, (*parents, last))
        if first["type"] in _NOT_A_MAPPING:
            expected = _form(model, first["loc"])
        else:
            expected = str(first["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
            expected = expected.replace("a valid tuple", "a list, [...]")
        what = f"{parents.pop()}[{last}]" if isinstance(last, int) and parents else str(last)
        raise self.located(InputError(what, value=_plain(first["input"]), expected=expected), parents)

    def built(self, key: str, build: Callable[[], _Built]) -> _Built:
        """Return the value of a section; give errors the line of the section."""
        try:
            return build()
        except FileError as error:
            if os.path.exists(error.path):  # False for an invalid name
                raise
            named = [part for part in ("file", "source") if part in self.data[key]]
            missing = InputError(f"there is no such file, {error.path}")
            raise self.located(missing, (key, *named)) from None
        except OSError as error:  # an invalid name
            raise self.located(InputError(f"cannot be read: {error.strerror or error}"), (key,)) from None
        except LocatedError as error:
            raise self.located(error.error, (key, *error.location)) from None
        except InputError as error:
            raise self.located(error, (key,) if key in self.data else ()) from None
        except ValueError as error:
            raise self.located(InputError(str(error)), (key,)) from None


def _plain(value: Any) -> Any:
    """Return a value of YAML as plain Python."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value


def _form(model: type[BaseModel], location: Sequence[str | int]) -> str:
    """Return the description of a section, or its fields."""
    field = model.model_fields.get(str(location[0])) if len(location) == 1 else None
    if field is not None and field.description is not None:
        return field.description
    return f"{{{', '.join(known_fields(model, location))}}}"
