"""One thread for the many small frames of these tests: a frame is the same whatever the threads, and several test
processes on few cores would wait for each other's threads at every frame."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from photosite.engine.threads import threads_for


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    with threads_for(1):
        yield
