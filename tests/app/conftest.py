"""A server of the workbench with its worker processes, called in this process without a port."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

pytest.importorskip("fastapi", reason="the extra app is not installed")
pytest.importorskip("httpx", reason="httpx is not installed")

from photosite.app.server import Settings, Workbench, create_app

PORT, TOKEN = 8123, "the-key-of-the-tests"
BASE = f"http://127.0.0.1:{PORT}"


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A served folder, with a file beside it that must not be served."""
    outer = tmp_path_factory.mktemp("app")
    folder = outer / "served"
    (folder / "inner").mkdir(parents=True)
    import photosite as ps

    ps.load_sensor("nikon-d200").with_(name="Mine", rows=64, cols=96).save(folder / "inner" / "mine.sensor.yaml")
    ps.load_sensor("nikon-d200").save(outer / "secret.sensor.yaml")
    os.symlink(outer / "secret.sensor.yaml", folder / "link.sensor.yaml")
    os.symlink(outer, folder / "up")
    return folder


@pytest.fixture(scope="session")
def workbench(served: Path) -> Iterator[Workbench]:
    made = Workbench(Settings(folder=served, upload_bytes=1 << 20, pictures=1, jobs=1, job_s=60.0))
    yield made
    made.close()


@pytest.fixture
def client(workbench: Workbench):
    """A client that has the key, as a notebook has it."""
    from starlette.testclient import TestClient

    return TestClient(create_app(workbench, PORT, TOKEN), base_url=BASE, headers={"Authorization": f"Bearer {TOKEN}"})


@pytest.fixture
def stranger(workbench: Workbench):
    """A client without the key."""
    from starlette.testclient import TestClient

    return TestClient(create_app(workbench, PORT, TOKEN), base_url=BASE, follow_redirects=False)


@pytest.fixture
def unrendered(undrawn: Callable[[], AbstractContextManager[None]]) -> Iterator[None]:
    """Reports without figures; tests/report has these."""
    with undrawn():
        yield
