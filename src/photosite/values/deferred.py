"""A value that is computed when it is first needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

T_co = TypeVar("T_co", covariant=True)


class Deferred(Generic[T_co]):
    """A value that is computed when it is first needed, and then kept; pickling computes it.

    Parameters
    ----------
    function
        Returns the value. It is called once, and what it holds is then released.

    Examples
    --------
    >>> later = Deferred(lambda: print("computed") or 7)
    >>> later.value, later.value
    computed
    (7, 7)
    """

    def __init__(self, function: Callable[[], T_co]) -> None:
        self._function: Callable[[], T_co] | None = function

    @property
    def value(self) -> T_co:
        """The value."""
        if self._function is not None:
            self._value, self._function = self._function(), None
        return self._value

    def __getstate__(self) -> dict[str, Any]:
        _ = self.value
        return vars(self)
