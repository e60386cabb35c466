"""Progress reports of a long study."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives the progress of a study: `photosite.cli.output.Stages` prints it."""

    def stage(self, what: str) -> None:
        """Begin a stage."""
        ...

    def __call__(self, done: int, total: int) -> None:
        """Report frames done, of how many in this stage."""
        ...


class NoProgress:
    """Ignores all progress reports."""

    def stage(self, what: str) -> None:
        """Do nothing."""

    def __call__(self, done: int, total: int) -> None:
        """Do nothing."""
