"""What tests share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from page_reader import PageReader

if TYPE_CHECKING:
    from photosite.studies.closed_loop.study import ClosedLoop

REFERENCE = Path(__file__).parents[2] / "shared" / "reference"


@pytest.fixture(scope="session")
def reference() -> Path:
    """The folder of real frames and independent results beside the project, where there is one."""
    if not REFERENCE.is_dir():
        pytest.skip(f"skipped: the reference frames and results are not there ({REFERENCE.name} beside the project)")
    return REFERENCE


@pytest.fixture(scope="session")
def read_page() -> type[PageReader]:
    """A strict reader of HTML pages."""
    return PageReader


@pytest.fixture(scope="session")
def loop() -> ClosedLoop:
    """A small virtual D200, measured and compared with its truth."""
    import photosite as ps
    from photosite.studies.closed_loop.study import closed_loop
    from photosite.studies.protocol import ShootingProtocol, series
    from photosite.studies.virtual_lab import with_pedestal

    steps = (*series("dark", 1 / 8000, 1.0, 4, 6), *series("light", 1 / 8000, 1 / 25, 8, 4))
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=132, cols=196))
    return closed_loop(sensor, ShootingProtocol("short", steps), seed=5)
