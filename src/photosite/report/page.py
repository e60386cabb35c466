"""Pages: sections of paragraphs, tables and figures, before they are written as HTML or PDF.

All text is plain text; markup characters are shown as they are.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from matplotlib.figure import Figure

from photosite.report.style import svg_bytes
from photosite.values.uncertain import Missing


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
    """A list of terms and their definitions."""

    pairs: tuple[tuple[str, str], ...]
    kind: ClassVar[str] = "terms"


@dataclass(frozen=True)
class Notice:
    """A highlighted note or warning."""

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
    """A column of a table."""

    title: str
    numeric: bool = False


@dataclass(frozen=True)
class Heading:
    """A row that spans the table, above a group of rows."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table.

    Parameters
    ----------
    caption
        Caption.
    columns
        Columns.
    rows
        Each row has one text per column, or is a `Heading`.

    Raises
    ------
    ValueError
        If the number of texts in a row differs from the number of columns.
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
                raise ValueError(f"table '{self.caption}': expected {len(self.columns)} texts in a row, got {row}")


@dataclass(frozen=True)
class Image:
    """An image: SVG of a figure, or PNG or JPEG of a picture.

    Parameters
    ----------
    content
        Bytes of the image.
    media_type
        "image/svg+xml", "image/png" or "image/jpeg".
    alternative
        Alternative text.
    title
        Title, shown above images side by side.
    """

    content: bytes
    media_type: str
    alternative: str
    title: str = ""

    @property
    def data_uri(self) -> str:
        """The image as a data URI."""
        return f"data:{self.media_type};base64,{base64.b64encode(self.content).decode('ascii')}"


@dataclass(frozen=True)
class Images:
    """One image, or several side by side, with a caption."""

    images: tuple[Image, ...]
    caption: str
    kind: ClassVar[str] = "images"


@dataclass(frozen=True)
class Details:
    """Blocks folded under a summary line."""

    summary: str
    blocks: tuple[Block, ...]
    kind: ClassVar[str] = "details"


Block = Paragraph | Subheading | Terms | Notice | Listing | Table | Images | Details


@dataclass(frozen=True)
class Section:
    """A section of the page, listed in its navigation."""

    title: str
    blocks: tuple[Block, ...]

    @property
    def anchor(self) -> str:
        """Name of the section in links.

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
        Title.
    lead
        One or two sentences below the title.
    sections
        Sections, in order. Empty ones are omitted.
    footer
        Last line.
    """

    title: str
    lead: str
    sections: Sequence[Section]
    footer: str = ""


def figure_block(figure: Figure, alternative: str, caption: str) -> Images:
    """Return a figure with its caption as a block."""
    return Images((Image(svg_bytes(figure), "image/svg+xml", alternative),), caption)


def sentence(text: str) -> str:
    """Return the text with a capital first letter and a full stop. Parameter names keep their first letter.

    Examples
    --------
    >>> sentence("no light frames"), sentence("dsnu_mv: too large")
    ('No light frames.', 'dsnu_mv: too large.')
    """
    first = text.split(" ", 1)[0]
    whole = text if "_" in first else text[:1].upper() + text[1:]
    return whole if whole.endswith((".", "!", "?")) else f"{whole}."


def reason_block(reason: str) -> Paragraph:
    """Return the paragraph that replaces a missing figure."""
    return Paragraph(f"Not shown: {sentence(reason)}")


def missing_channel_blocks(found: Mapping[str, object], what: str) -> tuple[Paragraph, ...]:
    """Return paragraphs that list the channels missing from a figure, with the reasons.

    Parameters
    ----------
    found
        The content of the figure by channel, or `Missing`.
    what
        Name of the content.

    Returns
    -------
    tuple of Paragraph
        Empty if all channels are missing.

    Examples
    --------
    >>> missing_channel_blocks({"R": 1, "G": Missing("no flats"), "B": Missing("no flats")}, "linearity")[0].text
    'Channels G and B have no linearity: no flats.'
    """
    reasons: dict[str, list[str]] = {}
    for channel, entry in found.items():
        if isinstance(entry, Missing):
            reasons.setdefault(entry.reason, []).append(channel)
    if len(found) == sum(map(len, reasons.values())):
        return ()
    return tuple(
        Paragraph(sentence(f"channel{'s' * (len(names) > 1)} {_listed(names)} {_have(names)} no {what}: {reason}"))
        for reason, names in reasons.items()
    )


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _have(names: list[str]) -> str:
    return "has" if len(names) == 1 else "have"
