"""A context manager that checks the fields of photosite's exceptions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from photosite.errors import PhotositeError


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
    error = caught.value
    assert error.what.startswith(what), error
    for name, value in fields.items():
        assert getattr(error, name) == value, (name, error)
    assert "\n" not in str(error)
