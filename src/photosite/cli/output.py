"""Output of the commands: one JSON object, aligned tables, and progress on standard error."""

from __future__ import annotations

import json
import os
import shutil
import sys
import textwrap
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from os import PathLike
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import click
from platformdirs import user_cache_path

from photosite.cli.compilation import start_beside
from photosite.errors import PhotositeWarning, printable

if TYPE_CHECKING:
    from tqdm import tqdm

    from photosite.values.diagnostic import Diagnostic
    from photosite.values.shown import Tabular


def show(
    as_json: bool,
    content: Mapping[str, Any] | Callable[[], Mapping[str, Any]],
    text: Callable[[], str],
    **written: PathLike[str] | Mapping[str, PathLike[str]] | None,
) -> None:
    """Print a result on standard output, as one JSON object or as text.

    Parameters
    ----------
    as_json
        Whether the command was called with --json.
    content
        The JSON object, or what returns it where that takes long. Its numbers are finite.
    text
        Returns the text.
    **written
        Files that the command wrote, or several by name, by their names in the JSON object; None for those not asked
        for.
    """
    _clear_clock()
    files = {name: path for name, path in written.items() if path is not None}
    if as_json:
        found = content() if callable(content) else content
        click.echo(json.dumps({**found, **files}, allow_nan=False, default=_plain))
    else:
        paths = [path for each in files.values() for path in (each.values() if isinstance(each, Mapping) else (each,))]
        click.echo(printable("\n".join([text(), *(f"wrote {path}" for path in paths)])))


def _plain(value: Any) -> Any:
    """NumPy scalars and paths as JSON values."""
    if hasattr(value, "item"):
        return value.item()
    if hasattr(value, "__fspath__"):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def table(rows: Sequence[Sequence[str]], align: str, width: int | None = None) -> str:
    """Return rows of text in columns; the first row is the heading, `align` has `<` or `>` for each column.

    Parameters
    ----------
    rows, align
        Texts, and the alignment of each column.
    width
        Characters per line, for which the widest columns of text are wrapped. Default: those of the terminal; no limit
        where standard output is not a terminal.

    Examples
    --------
    >>> print(table([("name", "value", "method"), ("gain", "30", "photon transfer")], "<><", width=20))
    name  value  method
    gain     30  photon
                 transfer
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    if width is None and sys.stdout.isatty():
        width = shutil.get_terminal_size().columns
    text_columns = [index for index, side in enumerate(align) if side == "<"]
    while width is not None and text_columns and sum(widths) + 2 * (len(widths) - 1) > width:
        widest = max(text_columns, key=lambda index: widths[index])
        if widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    lines = []
    for row in rows:
        cells = [
            [cell] if len(cell) <= size else textwrap.wrap(cell, size) for cell, size in zip(row, widths, strict=True)
        ]
        for parts in zip_longest(*cells, fillvalue=""):
            padded = (f"{part:{side}{size}}" for part, side, size in zip(parts, align, widths, strict=True))
            lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)


_TEXTS = 3
"""Diagnostics of one kind that are printed unless all are."""


def diagnostics_text(diagnostics: Iterable[Diagnostic], *, every: bool = True) -> list[str]:
    """Return a table of the diagnostics, each text once; not `every`: at most three of a kind."""
    kinds: dict[tuple[str, str], list[str]] = {}
    for entry in diagnostics:
        text = entry.text
        if entry.severity == "withheld":
            text = f"{', '.join(entry.parameters) if every else many(len(entry.parameters), 'parameter')}: {text}"
        texts = kinds.setdefault((entry.severity, entry.id), [])
        if text not in texts:
            texts.append(text)
    rows = [("severity", "id", "diagnostic (photosite explain ID)")]
    for (severity, name), texts in kinds.items():
        shown = texts if every else texts[:_TEXTS]
        rows += [(severity, name, text) for text in shown]
        if len(shown) < len(texts):
            rows.append((severity, name, f"{len(texts) - len(shown)} more; --all lists them"))
    return [table(rows, "<<<")] if len(rows) > 1 else []


def tabular(found: Tabular) -> str:
    """Return the table of a result: as much as fits a terminal, all of it for a file or another program."""
    return repr(found) if sys.stdout.isatty() else found.to_text()


_NARROWEST = 8
"""Characters below which a column of text is not wrapped further."""


def many(count: int, what: str) -> str:
    """Return a number of things in words.

    Examples
    --------
    >>> many(1, "pair"), many(2, "pair")
    ('1 pair', '2 pairs')
    """
    return f"{count} {what}" + ("" if count == 1 else "s")


def verdict(agrees: bool) -> str:
    """Return the verdict of a comparison in one word."""
    return "agree" if agrees else "differ"


def listed(heading: str, lines: Iterable[str]) -> str:
    """Return a heading with indented lines below it."""
    return "\n".join([heading, *(f"  {line}" for line in lines)])


def say(message: str) -> None:
    """Print a line on standard error."""
    _clear_clock()
    click.echo(printable(message), err=True)


def say_if_compiling(kernel: str = "*", beside: Callable[[], None] | None = None) -> None:
    """Announce the compilation of kernels, which makes the first computation slower than later ones.

    `kernel` is one that the command needs, "module.function". `beside` is a function of `compilation` for a second
    process, which compiles while this one is still at other work.
    """
    from photosite.engine.kernel_folder import is_cached, kernel_folder

    if is_cached(kernel):
        return
    folder, usual = kernel_folder(), user_cache_path("photosite", appauthor=False)
    say(f"compiling kernels, once, about 10 s; kept in {folder}")
    if not folder.is_relative_to(usual):
        variable = "XDG_CACHE_HOME" if os.name == "posix" else "LOCALAPPDATA"
        say(f"{usual} cannot be written; {variable} names another folder")
    if beside is not None:
        start_beside(beside)


_BAR_AFTER_S = 1.0
"""What takes less needs no bar."""
_LOG_EVERY_S = 10.0
"""Interval of the lines where standard error is not a terminal."""


def not_listed(held: list[PhotositeWarning], shown: Sequence[str]) -> None:
    """Remove the warnings that a result lists, so that each is shown once."""
    held[:] = [each for each in held if not any(text in str(each) or each.what in text for text in shown)]


_WORKING_AFTER_S = 2.0
_TERMINAL = {"bar": False, "clock": False}
"""What is on the terminal's last line: a bar of progress, the time that a command works."""


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show on a terminal's standard error that a command works, and for how long, from two seconds on.

    A bar of progress takes its place; logs get nothing.
    """
    if not sys.stderr.isatty():
        yield
        return
    done, begun = Event(), time.monotonic()

    def show_time() -> None:
        wait_s = _WORKING_AFTER_S
        while not done.wait(wait_s):
            if not _TERMINAL["bar"]:
                wait_s, _TERMINAL["clock"] = 1.0, True
                sys.stderr.write(f"\r{printable(what)}: working, {time.monotonic() - begun:.0f} s\033[K")
                sys.stderr.flush()

    clock = Thread(target=show_time, daemon=True)
    clock.start()
    try:
        yield
    finally:
        done.set()
        clock.join()
        _clear_clock()


def _clear_clock() -> None:
    """Clear the line of `working` before another text."""
    if _TERMINAL["clock"]:
        _TERMINAL["clock"] = False
        sys.stderr.write("\r\033[K")
        sys.stderr.flush()


@contextmanager
def held_warnings() -> Iterator[list[PhotositeWarning]]:
    """Hold back warnings, which the caller shows with its result; show those that are left in the list, at the end."""
    held: list[PhotositeWarning] = []
    show_now = warnings.showwarning

    def hold(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if isinstance(message, PhotositeWarning):
            held.append(message)
        else:
            show_now(message, category, *place, **more)

    warnings.showwarning = hold
    try:
        yield held
    finally:
        warnings.showwarning = show_now
        for message in held:
            warnings.showwarning(message, type(message), "", 0)


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
        """Show the progress of a stage."""
        if not sys.stderr.isatty():
            now = time.monotonic()
            if now - self._logged_s >= _LOG_EVERY_S:
                self._logged_s = now
                say(f"  {done} of {total} {unit}")
            return
        if self._bar is None or (self._bar.total, self._bar.unit) != (total, f" {unit}"):
            from tqdm import tqdm

            self._close()
            _clear_clock()
            _TERMINAL["bar"] = True
            self._bar = tqdm(total=total, unit=f" {unit}", leave=False, delay=_BAR_AFTER_S)
        self._bar.update(done - self._bar.n)
        if done >= total:
            self._close()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
            _TERMINAL["bar"] = False
