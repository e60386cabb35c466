"""Output of the commands: one JSON object, aligned tables, and progress on standard error."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from tqdm import tqdm


def show(as_json: bool, content: Mapping[str, Any], text: Callable[[], str], **written: PathLike[str] | None) -> None:
    """Print a result on standard output, as one JSON object or as text.

    Parameters
    ----------
    as_json
        Whether the command was called with --json.
    content
        The JSON object. Its numbers are finite.
    text
        Returns the text.
    **written
        Files that the command wrote, by their names in the JSON object; None for those that were not asked for.
    """
    files = {name: str(path) for name, path in written.items() if path is not None}
    if as_json:
        click.echo(json.dumps({**content, **files}, allow_nan=False, ensure_ascii=False, default=_plain))
    else:
        click.echo("\n".join([text(), *(f"wrote {path}" for path in files.values())]))


def _plain(value: Any) -> Any:
    """NumPy scalars and paths as JSON values."""
    if hasattr(value, "item"):
        return value.item()
    if hasattr(value, "__fspath__"):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def table(rows: Sequence[Sequence[str]], align: str) -> str:
    """Return rows of text in columns; the first row is the heading, `align` has `<` or `>` for each column.

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


def verdict(agrees: bool) -> str:
    """Return the verdict of a comparison in one word."""
    return "agree" if agrees else "differ"


def listed(heading: str, lines: Iterable[str]) -> str:
    """Return a heading with indented lines below it."""
    return "\n".join([heading, *(f"  {line}" for line in lines)])


def say(message: str) -> None:
    """Print a line on standard error."""
    click.echo(message, err=True)


def say_if_compiling() -> None:
    """Announce the compilation of the kernels, which makes the first computation slower than later ones."""
    from photosite.engine.jit import kernels_are_cached

    if not kernels_are_cached():
        say("compiling kernels (once; about 20 s) ...")


_LOG_EVERY_S = 10.0
"""Interval of the lines where standard error is not a terminal."""


class Stages:
    """Progress on standard error: a line per stage and, on a terminal, a bar; in a log, a line every ten seconds.

    An instance is called as `progress(done, total, unit)`, as the library's long functions do.
    """

    def __init__(self) -> None:
        self._bar: tqdm[Any] | None = None
        self._logged_s = time.monotonic()

    def stage(self, what: str) -> None:
        """Begin a stage."""
        self._close()
        self._logged_s = time.monotonic()
        say(f"{what} ...")

    def __call__(self, done: int, total: int, unit: str = "frames") -> None:
        """Show how much of a stage is done."""
        if not sys.stderr.isatty():
            now = time.monotonic()
            if now - self._logged_s >= _LOG_EVERY_S:
                self._logged_s = now
                say(f"  {done} of {total} {unit}")
            return
        if self._bar is None or (self._bar.total, self._bar.unit) != (total, f" {unit}"):
            from tqdm import tqdm

            self._close()
            self._bar = tqdm(total=total, unit=f" {unit}", leave=False)
        self._bar.update(done - self._bar.n)
        if done >= total:
            self._close()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
