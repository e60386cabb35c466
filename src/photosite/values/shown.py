"""How objects show themselves: a `repr` that fits a screen, a `dir` of public names, tables for notebooks.

Plots and reports are the work of `photosite.report`, which only this file names.
"""

from __future__ import annotations

import dataclasses
import html
import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

WIDEST, MOST_LINES = 100, 12
"""Columns and lines of a `repr`."""
_MOST_ENTRIES = 4
_MOST_HTML_ROWS = 60
_SMALL_ARRAY = 6
_ELLIPSIS = "..."


def clipped(text: str, widest: int = WIDEST) -> str:
    """Return the text on one line, shortened.

    Examples
    --------
    >>> clipped("a long\\n  text", 8)
    'a lon...'
    """
    line = " ".join(text.split()) if "\n" in text else text
    return line if len(line) <= widest else line[: widest - len(_ELLIPSIS)] + _ELLIPSIS


def short_repr(shown: object, fields: Mapping[str, object]) -> str:
    """Return `Name(field=value, ...)`: on one line if it fits, else a field per line, at most 12 lines.

    Examples
    --------
    >>> print(short_repr(np.e, {"first": np.zeros((9, 9)), "second": "word " * 30}))
    float(
        first=<float64 array (9, 9)>,
        second='word word word word word word word word word word word word word word word word w...,
    )
    """
    name = type(shown).__name__
    texts = [f"{field}={_brief(value)}" for field, value in fields.items()]
    line = f"{name}({', '.join(texts)})"
    if len(line) <= WIDEST:
        return line
    most = MOST_LINES - 2
    lines = texts if len(texts) <= most else [*texts[: most - 1], f"{_ELLIPSIS} {len(texts) - most + 1} more fields"]
    return "\n".join([f"{name}(", *(f"    {clipped(text, WIDEST - 5)}," for text in lines), ")"])


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray):
        small = value.size <= _SMALL_ARRAY and value.dtype.kind in "biufc"
        return clipped(repr(value)) if small else f"<{value.dtype} array {value.shape}>"
    if isinstance(value, Mapping):
        entries = [f"{key!r}: {_brief(entry)}" for key, entry in list(value.items())[:_MOST_ENTRIES]]
        return "{" + ", ".join(_with_rest(entries, len(value))) + "}"
    if type(value) in (tuple, list):
        assert isinstance(value, tuple | list)
        entries = _with_rest([_brief(entry) for entry in value[:_MOST_ENTRIES]], len(value))
        text = ", ".join(entries)
        return f"[{text}]" if isinstance(value, list) else f"({text},)" if len(value) == 1 else f"({text})"
    if isinstance(value, Tabular):
        return f"<{repr(value).partition(chr(10))[0]}>"
    if callable(value):
        return f"<{getattr(getattr(value, 'func', value), '__qualname__', type(value).__name__)}>"
    return clipped(repr(value), 2 * WIDEST).replace("( ", "(")


def _with_rest(entries: list[str], count: int) -> list[str]:
    return entries if count <= len(entries) else [*entries, f"{_ELLIPSIS} {count} in all"]


class Shown:
    """Base of public classes: their `repr` fits a screen and `dir` lists public names only.

    Examples
    --------
    >>> @dataclass(frozen=True, eq=False)
    ... class Image(Shown):
    ...     pixels: np.ndarray
    >>> Image(np.zeros((4000, 6000))), dir(Image(np.zeros(1)))
    (Image(pixels=<float64 array (4000, 6000)>), ['pixels'])
    """

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.__repr__ = cls.__repr__  # type: ignore[method-assign]  # `dataclass` keeps the one of the class itself

    def __repr__(self) -> str:
        assert dataclasses.is_dataclass(self)
        fields = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self) if entry.repr}
        return short_repr(self, fields)

    def __dir__(self) -> Iterable[str]:
        return [name for name in super().__dir__() if not name.startswith("_")]


Cell = str | float | int | bool | None


@dataclass(frozen=True)
class ResultTable:
    """A result as a table.

    Parameters
    ----------
    title, columns, rows
        A line above it, the names of the columns with their units, and a value for each column in every row.

    Examples
    --------
    >>> gains = ResultTable("Two gains", ("setting", "read_noise_e"), ((100, 3.21987), (200, None)))
    >>> print(gains.text())
    Two gains
    setting  read_noise_e
        100          3.22
        200
    >>> gains.to_dict()
    {'setting': [100, 200], 'read_noise_e': [3.21987, None]}
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]

    def only(self, columns: Sequence[str], rows: Iterable[int] | None = None) -> ResultTable:
        """Return some columns, by name, and some rows, by number; None: all rows."""
        places = [self.columns.index(name) for name in columns]
        chosen = self.rows if rows is None else [self.rows[number] for number in rows]
        return ResultTable(self.title, tuple(columns), [tuple(row[place] for place in places) for row in chosen])

    def text(self, *, cut: bool = True) -> str:
        """Return the table as text that fits a screen; rows that do not fit are counted. Not `cut`: all of it."""
        most = MOST_LINES - 2
        shown = self.rows if not cut or len(self.rows) <= most else self.rows[: most - 1]
        lines = [self.columns, *(tuple(map(cell_text, row)) for row in shown)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        sides = [">" if self._numeric(place) else "<" for place in range(len(self.columns))]
        texts = [
            "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(line, sides, widths, strict=True))
            for line in lines
        ]
        rest = [f"{_ELLIPSIS} {len(self.rows) - len(shown)} more rows"] if len(shown) < len(self.rows) else []
        lines_of_text = [text.rstrip() for text in (self.title, *texts, *rest)]
        return "\n".join(map(clipped, lines_of_text) if cut else lines_of_text)

    def html(self) -> str:
        """Return the table as HTML for notebooks, with at most 60 rows."""
        styles = [
            "text-align:right" if self._numeric(place) else "text-align:left" for place in range(len(self.columns))
        ]

        def line(tag: str, cells: Iterable[str]) -> str:
            parts = (
                f'<{tag} style="{style}">{html.escape(cell)}</{tag}>' for style, cell in zip(styles, cells, strict=True)
            )
            return f"<tr>{''.join(parts)}</tr>"

        body = "".join(line("td", map(cell_text, row)) for row in self.rows[:_MOST_HTML_ROWS])
        hidden = len(self.rows) - _MOST_HTML_ROWS
        rest = f'<tr><td colspan="{len(self.columns)}">{hidden} more rows</td></tr>' if hidden > 0 else ""
        caption = f'<caption style="text-align:left">{html.escape(self.title)}</caption>'
        head = f"<thead>{line('th', self.columns)}</thead>"
        return f'<div style="overflow-x:auto"><table>{caption}{head}<tbody>{body}{rest}</tbody></table></div>'

    def to_dict(self) -> dict[str, list[Cell]]:
        """Return the values by column."""
        return {name: [row[place] for row in self.rows] for place, name in enumerate(self.columns)}

    def to_dataframe(self) -> DataFrame:
        """Return a pandas data frame; raise `InputError` without pandas."""
        try:
            from pandas import DataFrame
        except ImportError:
            hint = "Run pip install '.[dataframe]' in the clone, or use to_dict()"
            raise InputError("a data frame needs pandas, which is not installed", hint=hint) from None
        return DataFrame(self.to_dict())

    def _numeric(self, place: int) -> bool:
        return all(row[place] is None or isinstance(row[place], int | float) for row in self.rows)


def cell_text(value: Cell) -> str:
    """Return a cell as text: four digits of a number, nothing for None.

    Examples
    --------
    >>> cell_text(0.123456), cell_text(123456.7), cell_text(True), cell_text(None)
    ('0.1235', '123457', 'yes', '')
    """
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer) or not math.isfinite(value):
        return str(value)
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"


class Tabular(Shown):
    """Base of results that are tables: text in a terminal, HTML in a notebook, a data frame of pandas."""

    __slots__ = ()

    @abstractmethod
    def _table(self) -> ResultTable:
        """Return the whole table."""

    def _brief_table(self) -> ResultTable:
        """Return the part that a terminal shows."""
        return self._table()

    def __repr__(self) -> str:
        return self._brief_table().text()

    def _repr_html_(self) -> str:
        return self._table().html()

    def to_text(self) -> str:
        """Return the table that `repr` shows, with all rows and whole lines."""
        return self._brief_table().text(cut=False)

    def to_dataframe(self) -> DataFrame:
        """Return the table as a pandas data frame.

        Raises
        ------
        InputError
            If pandas, the extra `dataframe`, is not installed.
        """
        return self._table().to_dataframe()


class Reported:
    """Base of results that `photosite.report` shows as a page."""

    __slots__ = ()

    def report(self, path: str | PathLike[str]) -> None:
        """Write the report with all results: a PDF for the suffix .pdf, else one self-contained HTML page.

        Raises
        ------
        FileError
            If the file cannot be written. An existing file is then unchanged.
        """
        from photosite.report.pages import page
        from photosite.report.write import write_report

        write_report(page(self), path)


def drawn(value: object, ax: Axes | None, *options: Any) -> Axes:
    """Draw a value on Matplotlib axes, new ones for None, and return them; raise as its plot does."""
    from photosite.report.plots import draw

    return draw(value, ax, *options)


def thumbnail(raw: Any) -> NDArray[np.float32]:
    """Return a small picture of a raw frame for notebooks."""
    from photosite.report.thumbnail import frame_thumbnail

    return frame_thumbnail(raw)
