"""The latest files of a source, kept in memory up to a limit."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any, Generic, TypeVar

T = TypeVar("T")

MOST_BYTES = 1 << 28
"""Of all values that are kept; one value is kept whatever its size."""


class Kept(Generic[T]):
    """The values that were used last, in the process that uses them: they are not pickled.

    Examples
    --------
    >>> kept = Kept(10)
    >>> [kept.get(name, lambda: name.upper(), lambda text: 6) for name in "aba"], kept.names
    (['A', 'B', 'A'], ['a'])
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._values: dict[Hashable, tuple[T, int]] = {}
        self._lock = Lock()

    @property
    def names(self) -> list[Hashable]:
        """The names of the values, the latest last."""
        return list(self._values)

    def get(self, name: Hashable, make: Callable[[], T], bytes_of: Callable[[T], int]) -> T:
        """Return a value, made if it is not kept."""
        with self._lock:
            found = self._values.pop(name, None)
        if found is None:  # two threads may make the same value
            value = make()
            found = value, bytes_of(value)
        with self._lock:
            self._values[name] = found
            while len(self._values) > 1 and sum(size for _, size in self._values.values()) > self._most_bytes:
                del self._values[next(iter(self._values))]
        return found[0]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._most_bytes,)
