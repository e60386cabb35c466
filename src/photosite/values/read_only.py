"""A mapping that cannot be changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class ReadOnly(Mapping[K, V]):
    """A copy of a mapping, without methods that change it. It can be pickled, unlike `types.MappingProxyType`.

    Examples
    --------
    >>> metadata = ReadOnly({"iso": 100})
    >>> metadata["iso"], {**metadata, "seed": 1}, metadata
    (100, {'iso': 100, 'seed': 1}, {'iso': 100})
    >>> metadata["iso"] = 200
    Traceback (most recent call last):
    TypeError: 'ReadOnly' object does not support item assignment
    """

    __slots__ = ("_entries",)

    def __init__(self, entries: Mapping[K, V]) -> None:
        self._entries = dict(entries)

    def __getitem__(self, key: K) -> V:
        return self._entries[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return repr(self._entries)

    def __reduce__(self) -> tuple[Any, ...]:
        return ReadOnly, (self._entries,)
