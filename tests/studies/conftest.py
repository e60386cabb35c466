"""One thread for the many small frames of these tests: a frame is the same whatever the threads, and several test
processes on few cores would wait for each other's threads at every frame."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import pytest


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(threads)
