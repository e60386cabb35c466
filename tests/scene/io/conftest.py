"""ICC profiles for the tests of pictures."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from icc_profiles import written


@pytest.fixture(scope="session")
def profile() -> Callable[..., bytes]:
    """Return `written(name, colorants, curve, extra, without)`."""
    return written
