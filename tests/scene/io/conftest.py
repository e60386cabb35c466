"""ICC profiles for the tests of pictures; `icc_profiles` is importable beside them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def profile() -> Callable[..., bytes]:
    """Return `written(name, colorants, curve, extra, without)`."""
    from icc_profiles import written

    return written
