"""Pages: sections of paragraphs, tables and figures, before they are written as HTML or PDF; pictures for them.

All text is plain text; markup characters are shown as they are.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.values.uncertain import Missing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDEST = 900
"""Largest width of a picture on a page, in pixels."""


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
    """A list of terms and their definitions; `anchor` and term make the id of the term in the page."""

    pairs: tuple[tuple[str, str], ...]
    anchor: str = ""
    kind: ClassVar[str] = "terms"


@dataclass(frozen=True)
class Notice:
    """A highlighted note or warning, with the id of a diagnostic that the page explains."""

    text: str
    warning: bool = False
    id: str = ""
    kind: ClassVar[str] = "notice"


@dataclass(frozen=True)
class Listing:
    """A list of plain lines."""

    lines: tuple[str, ...]
    code: bool = False
    kind: ClassVar[str] = "listing"


@dataclass(frozen=True)
class Column:
    """A column of a table; numbers are aligned at the right."""

    title: str
    numeric: bool = False


def numeric(title: str) -> Column:
    """Return a column of numbers."""
    return Column(title, numeric=True)


def columns(*titles: str | Column) -> tuple[Column, ...]:
    """Return the columns of a table, of which plain titles are columns of text."""
    return tuple(Column(title) if isinstance(title, str) else title for title in titles)


@dataclass(frozen=True)
class Heading:
    """A row that spans the table, above a group of rows."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table. Each row has one text per column, or is a `Heading`; `ValueError` for a row of another length.

    With a name in `beside`, a PDF refers to a file beside it instead of showing the table.
    """

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...] | Heading, ...]
    beside: str = ""
    kind: ClassVar[str] = "table"

    def __post_init__(self) -> None:
        for row in self.rows:
            if not isinstance(row, Heading) and len(row) != len(self.columns):
                raise ValueError(f"table '{self.caption}': expected {len(self.columns)} texts in a row, got {row}")


def beside_name(stem: str, table: Table) -> str:
    """Return the name of the file of a table beside the PDF `stem`.pdf.

    Examples
    --------
    >>> beside_name("report", Table("Digests", (Column("Frame"),), (), beside="frames"))
    'report.frames.csv'
    """
    return f"{stem}.{table.beside}.csv"


@dataclass(frozen=True)
class Image:
    """An image with its media type: "image/svg+xml" for a figure, "image/png" or "image/jpeg" for a picture.

    The alternative text describes it to screen readers; the title is shown above images side by side.
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


State = Literal["", "pass", "undecided", "fail", "missing"]


@dataclass(frozen=True)
class Tile:
    """A value to be seen at a glance, with a label above and a note below; `anchor` is that of its section."""

    label: str
    text: str
    note: str = ""
    state: State = ""
    anchor: str = ""


@dataclass(frozen=True)
class Tiles:
    """Values side by side."""

    tiles: tuple[Tile, ...]
    kind: ClassVar[str] = "tiles"


@dataclass(frozen=True)
class Card:
    """An image with its title, a caption, and the anchor of its section."""

    image: Image
    caption: str = ""
    anchor: str = ""


@dataclass(frozen=True)
class Gallery:
    """Small images in rows."""

    cards: tuple[Card, ...]
    kind: ClassVar[str] = "gallery"


@dataclass(frozen=True)
class Details:
    """Blocks folded under a summary line."""

    summary: str
    blocks: tuple[Block, ...]
    kind: ClassVar[str] = "details"


Block = Paragraph | Subheading | Terms | Notice | Listing | Table | Images | Tiles | Gallery | Details


@dataclass(frozen=True)
class Section:
    """A section of the page, listed in its navigation."""

    title: str
    blocks: tuple[Block, ...]

    @property
    def anchor(self) -> str:
        """Name of the section in links."""
        return anchor_of(self.title)


def anchor_of(title: str) -> str:
    """Return the name of a section in links.

    Examples
    --------
    >>> anchor_of("Noise & color")
    'noise-color'
    """
    return "-".join("".join(letter if letter.isalnum() else " " for letter in title.lower()).split())


@dataclass(frozen=True)
class Page:
    """A page: title, one or two sentences below it, sections (empty ones are omitted), and a last line.

    The overview is a first page of its own: what to look at before the sections are read.
    """

    title: str
    lead: str
    sections: Sequence[Section]
    footer: str = ""
    overview: tuple[Block, ...] = ()


def figure_block(figure: Figure, alternative: str, caption: str) -> Images:
    """Return a figure with its caption as a block."""
    from photosite.report.style import svg_bytes  # needs matplotlib, which tables as text do not

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


def first_reason(found: Mapping[str, object], otherwise: str) -> Paragraph:
    """Return the paragraph for a figure that all channels lack: the first channel's reason, or another one."""
    return reason_block(next((entry.reason for entry in found.values() if isinstance(entry, Missing)), otherwise))


def missing_channel_blocks(found: Mapping[str, object], what: str) -> tuple[Paragraph, ...]:
    """Return paragraphs that list the channels missing from a figure, with the reasons; none if all are missing.

    Parameters
    ----------
    found
        The content of the figure by channel, or `Missing`.
    what
        Name of the content.

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
    paragraphs = []
    for reason, names in reasons.items():
        *others, last = names
        subject = f"channels {', '.join(others)} and {last} have" if others else f"channel {last} has"
        paragraphs.append(Paragraph(sentence(f"{subject} no {what}: {reason}")))
    return tuple(paragraphs)


# Pictures for pages: reduced, enlarged, differences of two, and as JPEG.


def shrink(picture: NDArray[np.float32], widest: int = WIDEST) -> NDArray[np.float32]:
    """Reduce a picture, (rows, cols, 3) or (rows, cols), by the smallest integer factor to at most `widest` columns.

    Squares of pixels are averaged; incomplete squares at the right and bottom are dropped.

    Examples
    --------
    >>> shrink(np.ones((7, 10, 3), np.float32), widest=5).shape
    (3, 5, 3)
    """
    factor = -(-picture.shape[1] // widest)
    rows, cols = picture.shape[0] // factor, picture.shape[1] // factor
    kept = picture[: rows * factor, : cols * factor]
    squares = kept.reshape(rows, factor, cols, factor, *picture.shape[2:])
    return np.asarray(squares.mean(axis=(1, 3)), dtype=np.float32)


def enlarge(picture: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Enlarge a picture, each pixel to a square of factor x factor."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def magnified(picture: NDArray[np.float32], reference: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """Return the difference from a reference (a picture or a color), multiplied by a factor, around middle gray.

    The result is clipped to the display's range.

    Examples
    --------
    >>> magnified(np.full((1, 1, 3), 0.6), np.array([0.6, 0.5, 0.0]), 2.0)[0, 0]
    array([0.5, 0.7, 1. ], dtype=float32)
    """
    return np.asarray(np.clip(0.5 + factor * (picture - reference), 0.0, 1.0), dtype=np.float32)


def jpeg_bytes(picture: NDArray[np.float32]) -> bytes:
    """Return a picture (rows, cols, 3) in display sRGB as JPEG."""
    from PIL import Image as Picture

    stream = io.BytesIO()
    whole = np.rint(np.clip(picture, 0.0, 1.0) * 255.0).astype(np.uint8)
    Picture.fromarray(whole).save(stream, format="JPEG", quality=88, subsampling=0)
    return stream.getvalue()
