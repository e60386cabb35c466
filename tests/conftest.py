"""Fixtures that all tests share, and a summary of what a run left out."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from page_reader import PageReader

if TYPE_CHECKING:
    from photosite.studies.closed_loop import ClosedLoop

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests" / "data"
_SLOW = pytest.StashKey[int]()


def reference_folder() -> Path | None:
    """Return the folder of published camera frames: $PHOTOSITE_REFERENCE, else ../shared/reference, else None."""
    named = os.environ.get("PHOTOSITE_REFERENCE")
    folder = Path(named) if named else ROOT.parent / "shared" / "reference"
    return folder if folder.is_dir() else None


@pytest.fixture(scope="session")
def isetcam_results() -> Path:
    """ISETCam's electrons of the ColorChecker patches."""
    return DATA / "isetcam_macbeth_tungsten.json"


@pytest.fixture(scope="session")
def d200_sensitivity() -> Path:
    """The published spectral sensitivity of the Nikon D200."""
    return DATA / "nikon_d200_sensitivity.csv"


@pytest.fixture(scope="session")
def emva_frames() -> Path:
    """The descriptor of the EMVA 1288 reference measurement, 300 frames of a CCD camera (68 MB)."""
    folder = reference_folder()
    descriptor = folder / "emva1288_ccd12" / "EMVA1288_Data.txt" if folder else None
    if descriptor is None or not descriptor.is_file():
        pytest.skip("camera frames of the EMVA 1288 reference measurement not found; see docs/validation/index.md")
    return descriptor


@pytest.fixture(scope="session")
def published_edges() -> Path:
    """The folder of edges with published spatial frequency responses."""
    folder = reference_folder()
    if folder is None or not (folder / "sfr_edges" / "h_edge.tif").is_file():
        pytest.skip("edges with published responses not found; see docs/validation/index.md")
    return folder / "sfr_edges"


@pytest.fixture(scope="session")
def isetcam_metrics() -> Path:
    """The folder of results of ISETCam's metrics."""
    folder = reference_folder()
    if folder is None or not (folder / "isetcam_metrics").is_dir():
        pytest.skip("results of ISETCam's metrics not found; see docs/validation/index.md")
    return folder / "isetcam_metrics"


@pytest.fixture(scope="session")
def read_page() -> type[PageReader]:
    """A strict reader of HTML pages."""
    return PageReader


@contextmanager
def _undrawn() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("photosite.report.style.svg_bytes", lambda figure: b"<svg/>")
        for name in ("svg_bytes", "png_bytes"):
            patch.setattr(f"photosite.studies.farrell2008.drawing.{name}", lambda *_, **__: b"<svg/>")
        yield


@pytest.fixture(scope="session")
def undrawn() -> Callable[[], AbstractContextManager[None]]:
    """Return a context in which figures are made but not rendered, which takes most of the time of a page."""
    return _undrawn


@pytest.fixture(scope="session")
def loop() -> ClosedLoop:
    """A small virtual D200, measured and compared with its truth."""
    import photosite as ps
    from photosite.studies.closed_loop import closed_loop
    from photosite.studies.protocol import ShootingProtocol, series
    from photosite.studies.virtual_lab import with_pedestal

    steps = (*series("dark", 1 / 8000, 1.0, 4, 6), *series("light", 1 / 8000, 1 / 25, 8, 4))
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=132, cols=196))
    return closed_loop(sensor, ShootingProtocol("short", steps), seed=5)


def pytest_configure(config: pytest.Config) -> None:
    os.environ.setdefault("PHOTOSITE_CACHE", "off")  # tests compute what they test
    gc.set_threshold(100_000, 20, 100)  # collections in a process of 6000 tests take a sixth of its start


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Make the examples of the public names smoke tests."""
    examples = [item for item in items if isinstance(item, pytest.DoctestItem)]
    if examples:
        from public_names import public_doctests

        public = public_doctests()
        for item in examples:
            if item.name in public:
                item.add_marker("smoke")


def pytest_deselected(items: list[pytest.Item]) -> None:
    """Count the slow tests that a run leaves out."""
    slow = [item for item in items if "slow" in item.keywords]
    if slow:
        stash = slow[0].config.stash
        stash[_SLOW] = stash.get(_SLOW, 0) + len(slow)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish(session: pytest.Session) -> None:
    """Tell the controlling process of a parallel run how many tests a worker left out."""
    output: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["slow"] = session.config.stash.get(_SLOW, 0)


def pytest_testnodedown(node: Any, error: object) -> None:
    """Read the number from the workers; each collects all tests."""
    stash = node.config.stash
    stash[_SLOW] = max(stash.get(_SLOW, 0), getattr(node, "workeroutput", {}).get("slow", 0))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Name what the run left out, and how to run it."""
    slow = config.stash.get(_SLOW, 0)
    if slow:
        terminalreporter.write_line(f"left out: {slow} slow tests; run them with: make test-slow")
