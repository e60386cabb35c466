"""What commands print: one JSON object, aligned tables, and progress for whoever watches."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import click


def print_json(content: Mapping[str, Any]) -> None:
    """One JSON object on standard output.

    Raises
    ------
    ValueError
        If a number is not finite: a result holds none, so that is a bug.
    """
    click.echo(json.dumps(content, allow_nan=False, ensure_ascii=False, default=_plain))


def _plain(value: Any) -> Any:
    """NumPy's scalars and paths as JSON has them."""
    if hasattr(value, "item"):
        return value.item()
    if hasattr(value, "__fspath__"):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def table(rows: Sequence[Sequence[str]], align: str) -> str:
    """Rows of text in columns, two spaces apart; the first row is the heading.

    Parameters
    ----------
    rows
        All of one length.
    align
        One of `<` and `>` per column.

    Examples
    --------
    >>> print(table([("name", "value"), ("gain", "30")], "<>"))
    name  value
    gain     30
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)


def say(message: str) -> None:
    """A line for the reader on standard error."""
    click.echo(message, err=True)


def say_if_compiling() -> None:
    """Say why the first computation takes longer than any later one; nothing where the kernels lie ready."""
    from photosite.engine.jit import kernels_are_cached

    if not kernels_are_cached():
        say("compiling kernels (once; about 20 s) ...")


_LINE_EVERY_S = 10.0
"""Where standard error goes to a file: for a log of a long stage that still says that it moves."""


class Stages:
    """Progress on standard error: a line per stage, and a count within it; in a file, a line every ten seconds.

    An instance is called as `progress(done, total, what)`, which is what the library's long functions ask for.
    """

    def __init__(self) -> None:
        self._watched = sys.stderr.isatty()
        self._what = ""
        self._shown_s = time.monotonic()

    def stage(self, what: str) -> None:
        """Begin a stage."""
        self._clear()
        self._what = what
        self._shown_s = time.monotonic()
        say(f"{what} ...")

    def __call__(self, done: int, total: int, what: str = "frames") -> None:
        """Tell how far the stage is: at most ten times a second to a terminal, else every ten seconds."""
        now = time.monotonic()
        if self._watched and (now - self._shown_s > 0.1 or done == total):
            self._shown_s = now
            click.echo(f"\r\x1b[K  {done} of {total} {what}", nl=False, err=True)
            if done == total:
                self._clear()
        elif not self._watched and now - self._shown_s >= _LINE_EVERY_S:
            self._shown_s = now
            say(f"  {done} of {total} {what}")

    def _clear(self) -> None:
        if self._watched:
            click.echo("\r\x1b[K", nl=False, err=True)
