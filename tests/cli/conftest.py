"""Commands run in this process, as the console script runs them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from short_protocol import short_d200_protocol

from photosite.cli.main import run
from photosite.engine.threads import threads_for


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one JSON object; NaN and infinities are no JSON."""

        def refuse(constant: str) -> float:
            raise AssertionError(f"{constant} in JSON")

        return json.loads(self.out, parse_constant=refuse)


@pytest.fixture
def photosite(capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs a command line; file descriptors are captured, so that libraries that print below Python are seen too."""

    def call(*arguments: object) -> Outcome:
        capfd.readouterr()
        status = run([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return Outcome(status, out, err)

    return call


@pytest.fixture(scope="session")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A measurement that `photosite shoot` wrote: 121 frames of 66 x 98 pixels. Tests do not change it."""
    folder = tmp_path_factory.mktemp("shot") / "stack"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("photosite.studies.protocol.paper_d200_protocol", short_d200_protocol)
        assert run(["shoot", "--rows", "66", "--cols", "98", "--seed", "5", "-o", str(folder)]) == 0
    return folder


@pytest.fixture
def short_protocol(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `photosite shoot` take a quarter of its frames."""
    monkeypatch.setattr("photosite.studies.protocol.paper_d200_protocol", short_d200_protocol)


@pytest.fixture(autouse=True)
def unrendered_figures(undrawn: Any) -> Iterator[None]:
    """Commands write pages without figures; tests/report has these."""
    with undrawn():
        yield


@pytest.fixture(autouse=True)
def output_without_notices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the output of a command independent of compiled kernels and of the speed of the machine."""
    monkeypatch.setattr("photosite.engine.kernel_folder.is_cached", lambda kernel: True)
    monkeypatch.setattr("photosite.cli.output._LOG_EVERY_S", float("inf"))


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    """A frame is the same whatever the threads, and test processes on few cores would wait for each other's."""
    with threads_for(1):
        yield
