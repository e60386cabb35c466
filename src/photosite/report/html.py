"""A page that stands alone: one HTML file with its style sheet, figures and pictures inside.

A page is sections of blocks. Text is plain text: whatever it holds is shown as it is, never read as markup. Nothing
on the page is fetched from elsewhere, nothing runs, and nothing depends on the hour it was written.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import ClassVar

from photosite.files.atomic import atomic_path


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Subheading:
    """A heading within a section."""

    text: str
    kind: ClassVar[str] = "subheading"


@dataclass(frozen=True)
class Terms:
    """Terms and what they mean, one pair each."""

    pairs: tuple[tuple[str, str], ...]
    kind: ClassVar[str] = "terms"


@dataclass(frozen=True)
class Notice:
    """Something the reader must not miss: a warning, or what a picture is."""

    text: str
    warning: bool = False
    kind: ClassVar[str] = "notice"


@dataclass(frozen=True)
class Listing:
    """A list of plain lines."""

    lines: tuple[str, ...]
    code: bool = False
    kind: ClassVar[str] = "listing"


@dataclass(frozen=True)
class Column:
    """A table's column."""

    title: str
    numeric: bool = False


@dataclass(frozen=True)
class Heading:
    """A line across a table."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table.

    Parameters
    ----------
    caption
        What it holds.
    columns
        Its columns.
    rows
        One text per column each, an empty one stays empty; or a `Heading` over the rows that follow.

    Raises
    ------
    ValueError
        If a row has more or fewer texts than there are columns.
    """

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...] | Heading, ...]
    kind: ClassVar[str] = "table"

    def __post_init__(self) -> None:
        for row in self.rows:
            if isinstance(row, Heading):
                continue
            if len(row) != len(self.columns):
                raise ValueError(f"table '{self.caption}': {len(self.columns)} columns, but a row of {len(row)}: {row}")


@dataclass(frozen=True)
class Image:
    """One image: a figure's SVG, or a picture's PNG or JPEG.

    Parameters
    ----------
    content
        The bytes of the image.
    media_type
        "image/svg+xml", "image/png" or "image/jpeg".
    alternative
        What it shows, for readers who do not see it.
    title
        Stands over it where several stand side by side.
    """

    content: bytes
    media_type: str
    alternative: str
    title: str = ""

    @property
    def data_uri(self) -> str:
        """The image itself as an address, so that the page needs no other file."""
        return f"data:{self.media_type};base64,{base64.b64encode(self.content).decode('ascii')}"


@dataclass(frozen=True)
class Images:
    """One image, or several side by side, with a caption."""

    images: tuple[Image, ...]
    caption: str
    kind: ClassVar[str] = "images"


@dataclass(frozen=True)
class Details:
    """Blocks folded away under a line."""

    summary: str
    blocks: tuple[Block, ...]
    kind: ClassVar[str] = "details"


Block = Paragraph | Subheading | Terms | Notice | Listing | Table | Images | Details


@dataclass(frozen=True)
class Section:
    """A part of the page, named in its navigation."""

    title: str
    blocks: tuple[Block, ...]

    @property
    def anchor(self) -> str:
        """What a link to the section says.

        Examples
        --------
        >>> Section("Noise & colour", ()).anchor
        'noise-colour'
        """
        words = "".join(letter if letter.isalnum() else " " for letter in self.title.lower()).split()
        return "-".join(words)


@dataclass(frozen=True)
class Page:
    """A page.

    Parameters
    ----------
    title
        Of the page.
    lead
        What it is about, in a sentence or two under the title.
    sections
        Its parts, in order; those without blocks are left out.
    footer
        The last line.
    """

    title: str
    lead: str
    sections: Sequence[Section]
    footer: str = ""


def render_page(page: Page) -> str:
    """The page as HTML.

    Parameters
    ----------
    page
        What to say.

    Returns
    -------
    str
        A whole HTML document; the same page gives the same text.

    Examples
    --------
    >>> page = Page("Chip <1>", "A & B.", [Section("Result", (Paragraph("1 < 2"),))])
    >>> "<h1>Chip &lt;1&gt;</h1>" in render_page(page)
    True
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("photosite.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    sections = [section for section in page.sections if section.blocks]
    return environment.get_template("page.html").render(page=page, sections=sections)


def write_page(page: Page, path: str | PathLike[str]) -> None:
    """Write the page to a file, whole or not at all.

    Parameters
    ----------
    page
        What to say.
    path
        The file.

    Raises
    ------
    FileError
        If it cannot be written; a file that had the name stays as it was.
    """
    text = render_page(page)
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
