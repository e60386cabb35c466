"""Context managers that check the fields of photosite's exceptions and warnings."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from photosite.errors import PhotositeError, PhotositeWarning


def check(error: Any, what: str, fields: dict[str, Any]) -> None:
    assert error.what.startswith(what), error
    for name, value in fields.items():
        assert getattr(error, name) == value, (name, error)
    assert "\n" not in str(error)


@contextmanager
def raises(kind: type[PhotositeError], what: str, **fields: Any) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an exception whose `what` begins with a text, whose other fields are equal, and whose message is one line.

    Examples
    --------
    >>> from photosite.errors import InputError
    >>> with raises(InputError, "bits", value=20):
    ...     raise InputError("bits", value=20, expected="1 to 16")
    """
    with pytest.raises(kind) as caught:
        yield caught
    check(caught.value, what, fields)


@contextmanager
def warns(what: str, **fields: Any) -> Iterator[list[warnings.WarningMessage]]:
    """Expect warnings of photosite, each with a `what` that begins with a text, and with equal other fields."""
    with pytest.warns(PhotositeWarning) as caught:
        yield caught.list
    for entry in caught.list:
        check(entry.message, what, fields)
