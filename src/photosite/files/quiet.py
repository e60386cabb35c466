"""Silence for C libraries that print to standard error."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_LOCK = threading.RLock()


@contextmanager
def no_stderr() -> Iterator[None]:
    """Discard everything that is written to standard error within the block, by one thread at a time.

    Examples
    --------
    >>> with no_stderr():
    ...     _ = os.write(2, b"libpng warning")
    """
    with _LOCK:
        kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)
