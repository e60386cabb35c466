"""What tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

REFERENCE = Path(__file__).parents[2] / "shared" / "reference"


@pytest.fixture(scope="session")
def reference() -> Path:
    """The folder of real frames and independent results beside the project, where there is one."""
    if not REFERENCE.is_dir():
        pytest.skip(f"skipped: the reference frames and results are not there ({REFERENCE.name} beside the project)")
    return REFERENCE
