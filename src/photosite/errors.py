"""Exceptions and warnings, each with fields that say what is wrong.

- `InputError`: an argument of a function is invalid: an exposure time of zero, an unknown preset, a spectrum whose
  lengths differ. It is also a `ValueError`.
- `FileError`: a file is missing, truncated, of the wrong kind, or has invalid content. It carries the path and, where
  known, the line.
- `CalibrationError`: the frames can be read and the call is valid, but these frames cannot support the result:
  clipped blacks, one exposure time only, frames of mixed size.
- `WorkerError`: processes or machines that share the work died or were lost, and starting them again did not help.
- `PhotositeWarning`: the result is valid within a limitation that the user should know: light outside the scene's
  wavelengths, a flat field that never reached saturation.

The message is built from the fields in one place, the method `format`. The command line prints it with its own option
names and exits with 2. Any other exception that leaves photosite is a bug.
"""

from __future__ import annotations

import copy
import difflib
import enum
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from os import PathLike, fspath
from types import MappingProxyType
from typing import Any, Protocol, Self

__all__ = [
    "CalibrationError",
    "FileError",
    "InputError",
    "PhotositeError",
    "PhotositeWarning",
    "WorkerError",
]
__dir__ = __all__.copy

_LONGEST_VALUE = 80
_LONGEST_PATH = 400
_MOST_NAMES = 4


class NotGiven(enum.Enum):
    """The value of an error that is about no value; `None` is a value."""

    NOT_GIVEN = "not given"


NOT_GIVEN = NotGiven.NOT_GIVEN


class Spelling(Protocol):
    """How a user of an interface writes argument names and values."""

    def name(self, field: str) -> str:
        """Return the name of an argument."""

    def argument(self, field: str, value: Any) -> str:
        """Return an argument with its value."""


class PythonSpelling:
    """Arguments as a Python caller writes them."""

    def name(self, field: str) -> str:
        """Return the name unchanged."""
        return field

    def argument(self, field: str, value: Any) -> str:
        """Return `name=value`.

        Examples
        --------
        >>> PythonSpelling().argument("illuminant", "D65")
        "illuminant='D65'"
        """
        return f"{field}={value!r}"


_PYTHON = PythonSpelling()


class _Fields(Exception):  # noqa: N818 - shared by errors and warnings
    """The fields that exceptions and warnings share, and the line built from them.

    Parameters
    ----------
    what
        With `expected`: the name of the invalid field or argument. Otherwise: a clause that states the problem.
    where
        The file, section or object that the problem is in.
    value
        The value that was given.
    expected
        The condition on the value, to follow "must be".
    hint
        What to do. `{name}` in it stands for that entry of `arguments`, written as the user's interface writes it.
    arguments
        Arguments that the hint refers to, with an example value each.
    id
        The kind of problem in the registry of diagnostics, where it has one: `photosite explain ID` prints the entry.

    Examples
    --------
    >>> print(InputError("exposure_s", value=0.0, expected="above 0", hint="Give seconds, such as 0.005"))
    exposure_s must be above 0, got 0.0. Give seconds, such as 0.005
    >>> print(InputError("the file holds reflectances", hint="Pass {illuminant}", arguments={"illuminant": "D65"}))
    the file holds reflectances. Pass illuminant='D65'
    """

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        value: Any = NOT_GIVEN,
        expected: str | None = None,
        hint: str | None = None,
        arguments: Mapping[str, Any] = MappingProxyType({}),
        id: str | None = None,
    ) -> None:
        self.what = what
        self.where = where
        self.value = value
        self.expected = expected
        self.hint = hint
        self.arguments = dict(arguments)
        self.id = id
        super().__init__(what)

    @property
    def fields(self) -> dict[str, Any]:
        """The keyword arguments that make an equal exception."""
        names = ("where", "value", "expected", "hint", "arguments", "id")
        return {name: getattr(self, name) for name in names}

    def format(self, spelling: Spelling = _PYTHON) -> str:
        """Return the message, one line; `spelling` is how the user's interface writes arguments."""
        text = self.what if self.expected is None else f"{self._field(spelling)} must be {self.expected}"
        if self.value is not NOT_GIVEN:
            text += f", got {_short(self.value)}"
        if self.hint:
            text += f". {self._spelled_hint(spelling)}"
        return f"{self.where}: {text}" if self.where else text

    def _field(self, spelling: Spelling) -> str:
        return spelling.name(self.what)

    def _spelled_hint(self, spelling: Spelling) -> str | None:
        written = {name: spelling.argument(name, value) for name, value in self.arguments.items()}
        return self.hint.format(**written) if self.hint and written else self.hint

    def __str__(self) -> str:
        return printable(self.format())

    def __reduce__(self) -> tuple[Any, ...]:
        return _made_again, (type(self), (self.what,), self.fields)


def _made_again(kind: type[Any], positional: tuple[Any, ...], fields: dict[str, Any]) -> Any:
    return kind(*positional, **fields)


class PhotositeError(_Fields):
    """Base class of the exceptions that photosite raises on purpose.

    Examples
    --------
    >>> import photosite as ps
    >>> try:
    ...     ps.DiffractionLimited(f_number=0, focal_length_mm=50)
    ... except PhotositeError as error:
    ...     error.what, error.value
    ('f_number', 0)
    """

    def in_file(
        self, path: str | PathLike[str], line: int | None = None, spelling: Spelling | None = None
    ) -> FileError:
        """Return this error as that of a file's content; `where` becomes the section inside the file.

        Parameters
        ----------
        path, line
            As for `FileError`.
        spelling
            How the file writes arguments; None: the hint's placeholders are kept, to be filled by the interface.

        Examples
        --------
        >>> error = InputError("exposure_s", value=0, expected="above 0", where="frames[2]")
        >>> print(error.in_file("protocol.yaml", line=7))
        protocol.yaml:7: frames[2]: exposure_s must be above 0, got 0
        """
        if spelling is None:
            return FileError(path, self.what, line, **self.fields)
        what = self.what if self.expected is None else self._field(spelling)
        fields = self.fields | {"hint": self._spelled_hint(spelling), "arguments": {}}
        return FileError(path, what, line, **fields)

    def within(self, where: str) -> Self:
        """Return this error with a place in front of `where`.

        Examples
        --------
        >>> print(InputError("f_number", value=-1, expected="above 0").within("optics"))
        optics: f_number must be above 0, got -1
        """
        again = copy.copy(self)
        again.where = f"{where}: {self.where}" if self.where else where
        return again


class InputError(PhotositeError, ValueError):
    """An argument is invalid.

    Examples
    --------
    >>> print(InputError("exposure_s", value=0.0, expected="above 0", hint="Give seconds, such as 0.005"))
    exposure_s must be above 0, got 0.0. Give seconds, such as 0.005
    """


class FileError(PhotositeError):
    """A file cannot be read, or its content is invalid.

    Parameters
    ----------
    path, line
        The file, and its line counted from 1, where known.
    what, **fields
        As for the other exceptions; `where` is the section inside the file.

    Examples
    --------
    >>> print(FileError("a.sensor.yaml", "rows", 3, value=0, expected="1 or more"))
    a.sensor.yaml:3: rows must be 1 or more, got 0
    """

    def __init__(self, path: str | PathLike[str], what: str, line: int | None = None, **fields: Any) -> None:
        self.path = fspath(path)
        self.line = line
        super().__init__(what, **fields)

    @property
    def place(self) -> str:
        """The path, and the line number where it is known."""
        return self.path if self.line is None else f"{self.path}:{self.line}"

    def format(self, spelling: Spelling = _PYTHON) -> str:
        """Return the message, one line, which begins with the path and the line number."""
        line = "" if self.line is None else f":{self.line}"
        return f"{shortened_path(self.path)}{line}: {self.format_content(spelling)}"

    def format_content(self, spelling: Spelling = _PYTHON) -> str:
        """Return the message without the path and the line number."""
        return super().format(spelling)

    def in_file(
        self, path: str | PathLike[str], line: int | None = None, spelling: Spelling | None = None
    ) -> FileError:
        """Return this error as that of another file's content, which names this one."""
        return super().in_file(path, line, spelling).within(self.place)

    def _field(self, spelling: Spelling) -> str:
        return self.what  # a field of the file, not an argument of the interface

    def __reduce__(self) -> tuple[Any, ...]:
        return _made_again, (type(self), (self.path, self.what, self.line), self.fields)


class CalibrationError(PhotositeError):
    """The frames cannot support the result that was asked for.

    Examples
    --------
    >>> CalibrationError("all frames are dark", id="no-flats").id
    'no-flats'
    """


class WorkerError(PhotositeError):
    """Worker processes died repeatedly, or the scheduler that they belong to was lost.

    Examples
    --------
    >>> print(WorkerError("4 workers died", hint="See the memory that they have"))
    4 workers died. See the memory that they have
    """


class PhotositeWarning(_Fields, UserWarning):
    """The result is valid within a limitation that the user should know.

    Examples
    --------
    >>> print(PhotositeWarning("the light is polarized", where="a.exr"))
    a.exr: the light is polarized
    """


@contextmanager
def in_file(path: str | PathLike[str], line: int | None = None) -> Iterator[None]:
    """Raise an `InputError` as a `FileError` of the file that the value is from.

    Examples
    --------
    >>> with in_file("lens.yaml", 3):
    ...     raise InputError("f_number", value=0, expected="above 0")
    Traceback (most recent call last):
    photosite.errors.FileError: lens.yaml:3: f_number must be above 0, got 0
    """
    try:
        yield
    except InputError as error:
        raise error.in_file(path, line) from None


def _short(value: Any) -> str:
    """Return the value's repr on one line, shortened; NumPy scalars as plain numbers."""
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    try:
        text = " ".join(repr(value).split())
    except Exception:  # of a library's object, which must not hide the error that names it
        text = f"an object of type {type(value).__name__}"
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def shortened_path(path: str) -> str:
    """Return a path for a message; of one with more than 400 characters, the beginning and the end.

    Examples
    --------
    >>> shortened_path("frames/dark_01.tif")
    'frames/dark_01.tif'
    >>> len(shortened_path("frames/" * 100 + "dark_01.tif"))
    400
    """
    return path if len(path) <= _LONGEST_PATH else f"{path[:100]}...{path[103 - _LONGEST_PATH :]}"


_CONTROL = (*range(0x20), *range(0x7F, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A), *range(0xDC80, 0xDD00))
_ESCAPES = {code: ascii(chr(code))[1:-1] for code in _CONTROL if chr(code) not in "\t\n"}


def printable(text: str) -> str:
    r"""Return text for a terminal or log: control characters, of file names for example, as Python escapes.

    Tabs and line feeds remain. Characters that change the direction of writing count as control characters, as do the
    surrogates that stand for bytes of file names that are not UTF-8.

    Examples
    --------
    >>> print(printable("a\x1b[31m.dng"))
    a\x1b[31m.dng
    """
    return text.translate(_ESCAPES)


def message_of(error: Exception) -> str:
    """Return another library's message on one line, shortened; the name of its class where it has none.

    Examples
    --------
    >>> message_of(ValueError("damaged\\n  header")), message_of(KeyError()), message_of(OSError(13, "No access"))
    ('damaged header', 'KeyError', 'No access')
    """
    text = error.strerror if isinstance(error, OSError) and error.strerror else " ".join(str(error).split())
    return text[:200] or type(error).__name__


def did_you_mean(name: str, known: Iterable[str], otherwise: str | None = None) -> str:
    """Return a hint for an unknown name: known names that continue it, the most similar known name, or all.

    `otherwise` is the hint in place of a long list of all names.

    Examples
    --------
    >>> did_you_mean("fil_factor", ["fill_factor", "width_um"])
    "Did you mean 'fill_factor'?"
    >>> did_you_mean("read_noise", ["read_noise_dn", "read_noise_e", "dsnu_e"])
    "Did you mean 'read_noise_dn' or 'read_noise_e'?"
    >>> did_you_mean("zzz", ["fill_factor", "width_um"])
    'Known are: fill_factor, width_um'
    """
    names = list(known)
    longer = [known for known in names if known.startswith(f"{name}_")][:_MOST_NAMES] if name else []
    close = longer or difflib.get_close_matches(name, names, n=1)
    if close:
        return f"Did you mean {' or '.join(map(repr, close))}?"
    return otherwise or "Known are: " + ", ".join(names)
