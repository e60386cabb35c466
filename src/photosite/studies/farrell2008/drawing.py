"""Figures and texts of the study: a figure as SVG, PNG and a block of the page, and the prose in `text.toml`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.report.page import Block, Image, Images, Listing, Paragraph
from photosite.report.style import png_bytes, svg_bytes


@cache
def texts() -> dict[str, Any]:
    """Return the content of `text.toml`: tables of figures, paragraphs and listings by name."""
    content: dict[str, Any] = tomllib.loads(files(__package__).joinpath("text.toml").read_text(encoding="utf-8"))
    return content


def text(name: str, **values: object) -> str:
    """Return a text by name, with values inserted."""
    return str(texts()["text"][name]).format(**values)


def paragraph(name: str, **values: object) -> Paragraph:
    """Return a text as a paragraph."""
    return Paragraph(text(name, **values))


def listing(name: str, **values: object) -> Listing:
    """Return a list of texts as a block."""
    return Listing(tuple(line.format(**values) for line in texts()["listing"][name]))


@dataclass(frozen=True)
class Drawing:
    """A drawn figure.

    Parameters
    ----------
    name
        File name without suffix.
    svg, png
        Content of the files.
    alternative, caption
        Alternative text and caption on the page.
    """

    name: str
    svg: bytes
    png: bytes
    alternative: str
    caption: str

    @classmethod
    def of(cls, name: str, figure: Figure, **values: object) -> Drawing:
        """Draw a figure in both formats, with a note below it, and insert values into its caption."""
        words = texts()["figure"][name]
        below = f"photosite, Farrell et al. 2008, {words['note']}"
        caption = words["caption"].format(**values)
        return cls(name, svg_bytes(figure, below), png_bytes(figure, below=below), words["alternative"], caption)

    @property
    def block(self) -> Images:
        """The figure as a block of the page."""
        return Images((Image(self.svg, "image/svg+xml", self.alternative),), self.caption)

    def save(self, folder: Path) -> None:
        """Write NAME.svg and NAME.png."""
        (folder / f"{self.name}.svg").write_bytes(self.svg)
        (folder / f"{self.name}.png").write_bytes(self.png)


Part = tuple[Block | Drawing, ...]
"""Blocks and figures of a chapter in their order."""

SummaryRow = tuple[str, str, str, str]
"""Result, value in the paper, value here, and the difference in words."""


def bare(axes: Axes) -> Axes:
    """Remove ticks, grid and frame around a picture."""
    axes.set(xticks=(), yticks=())
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    return axes
