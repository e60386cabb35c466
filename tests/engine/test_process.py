"""Settings of a process of photosite's own: they do not replace those of the user."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import pytest

_CODE = """
import os
from photosite.engine.process import prepare_process
prepare_process()
import numpy as np
def resident():
    return int(open('/proc/self/statm').read().split()[1]) * os.sysconf('SC_PAGE_SIZE')
values = np.ones(8_000_000)
guard = np.ones(100)
before = resident()
del values
print(before - resident())
"""


def _freed(**given: str) -> int:
    ours = ("MALLOC_", "GLIBC_")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    done = subprocess.run([sys.executable, "-c", _CODE], env=kept | given, capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="memory is kept by settings of the GNU C library")
def test_freed_memory_is_kept_unless_the_user_says_otherwise() -> None:
    assert _freed() < 1_000_000
    assert _freed(MALLOC_TRIM_THRESHOLD_="100000") > 60_000_000
