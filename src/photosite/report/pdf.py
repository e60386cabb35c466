"""Pages as PDF on A4, written by fpdf2 without a browser or system libraries.

Figures stay vector graphics, text is searchable, sections appear in the outline, and folded parts are unfolded. The
fonts are matplotlib's DejaVu, of which the used letters are embedded.
"""

from __future__ import annotations

import base64
import io
import logging
import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import matplotlib
from fpdf import FPDF
from fpdf.fonts import FontFace
from fpdf.util import Padding
from PIL import Image as Picture

from photosite.files.writing import date_of_files
from photosite.report.page import (
    Block,
    Card,
    Details,
    Gallery,
    Heading,
    Image,
    Images,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    Subheading,
    Table,
    Terms,
    Tile,
    Tiles,
    beside_name,
)

_Item = TypeVar("_Item")

_TEXT, _SMALL, _TINY = 9.5, 8.0, 6.5  # sizes of letters, in points
_LINE = 1.35  # line height, in font sizes
_MM_PER_POINT = 25.4 / 72.0

_INK, _QUIET, _ACCENT, _ALARM = (31, 35, 40), (89, 99, 110), (0, 114, 178), (213, 94, 0)
_STATES = {"pass": (0, 120, 90), "undecided": (138, 90, 0), "fail": _ALARM, "missing": _QUIET}
_TINT, _ALARM_TINT, _RULE = (246, 248, 250), (255, 246, 240), (216, 222, 228)

# Widths in mm.
_DRAWING_MM = 124.0  # of a figure; two fit on a page
_GAP = 4.0  # between images side by side
_PADDING = 3.4  # horizontal padding of a cell, both sides together

_TILES_PART = 0.5
"""Part of a crowded first page that tiles take at most."""
_NOTE_MM = 6.0
"""Height of the line below a crowded first page."""
_TILES, _FEW_CARDS = 4, 6
"""Tiles in a row; images up to which two are in a row, of more three."""

_NARROW, _WIDE = 14.0, 62.0
"""Bounds of what a column of a table asks for at least, in mm: a long word, and a sentence that may be broken."""


def pdf_bytes(page: Page, stem: str = "report") -> bytes:
    """Return the page as a PDF; equal pages give equal bytes, but for the creation date.

    The creation date is now, or the seconds since 1970 in the environment variable SOURCE_DATE_EPOCH. Tables for a file
    beside the PDF (`Table.beside`) are replaced by that file's name, which begins with `stem`.

    Examples
    --------
    >>> from photosite.report.page import Section
    >>> pdf_bytes(Page("Chip", "A chip.", (Section("Result", (Paragraph("3 e⁻"),)),)))[:5]
    b'%PDF-'
    """
    document = _Document(page, stem)
    if page.overview:
        document.overview(page.overview)
    for section in page.sections:
        if section.blocks:
            document.section(section)
    return bytes(document.output())


class _Document(FPDF):
    """A PDF document that adds page breaks where a block does not fit."""

    def __init__(self, page: Page, stem: str) -> None:
        super().__init__(format="A4")
        self._stem = stem
        self.set_creation_date(date_of_files())
        logging.getLogger("fontTools").setLevel(logging.ERROR)
        fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
        self.add_font("text", "", fonts / "DejaVuSans.ttf")
        self.add_font("text", "B", fonts / "DejaVuSans-Bold.ttf")
        self.add_font("code", "", fonts / "DejaVuSansMono.ttf")
        self._page = page
        self.set_title(page.title)
        self.set_lang("en")
        self.set_margins(16, 15, 16)
        self.set_auto_page_break(True, margin=18)
        self.add_page()
        self._write(page.title, size=17, style="B")
        self._write(page.lead, size=10.5, color=_QUIET)

    def footer(self) -> None:
        """Write the title and the page number."""
        self.set_y(-13)
        self._look(_SMALL, color=_QUIET)
        self.cell(0, 5, f"{self._page.title}   ·   page {self.page_no()}", align="R")

    def overview(self, blocks: Sequence[Block]) -> None:
        """Write the overview on the first page, what does not fit on the next ones, and begin a new page.

        The first page has tiles and images: tiles take at most half of it where not all of both fit.
        """
        self.start_section("Overview")
        space = self.h - self.b_margin - self.get_y()
        crowded = sum(map(self._overview_height, blocks)) > space
        rest: list[Callable[[], None]] = []
        for block in blocks:
            match block:
                case Tiles(tiles) if crowded:
                    heights = [self._tiles_height(row) for row in _in_rows(tiles, _TILES)]
                    kept = _TILES * _fitting(heights, _TILES_PART * space)
                    self._tiles(tiles[:kept])
                    rest += [partial(self._tiles, tiles[kept:])] if tiles[kept:] else []
                case Gallery(cards) if crowded:
                    across = _across(cards)
                    heights = [self._cards_height(row, across) for row in _in_rows(cards, across)]
                    kept = across * _fitting(heights, self.h - self.b_margin - self.get_y() - _NOTE_MM)
                    self._gallery(cards[:kept], across)
                    rest += [partial(self._gallery, cards[kept:], across)] if cards[kept:] else []
                    if rest:
                        self._write("More values and figures follow on the next page.", size=_SMALL, color=_QUIET)
                case _:
                    self._block(block)
        if rest:
            self.add_page()
            self._write("Overview, continued", size=11, style="B")
        for write in rest:
            write()
        self.add_page()

    def _overview_height(self, block: Block) -> float:
        """Return the height of tiles, images, or a paragraph in mm."""
        match block:
            case Tiles(tiles):
                return sum(map(self._tiles_height, _in_rows(tiles, _TILES)))
            case Gallery(cards):
                across = _across(cards)
                return sum(self._cards_height(row, across) for row in _in_rows(cards, across))
            case Paragraph(text) | Notice(text) | Subheading(text):
                return self._height(text, _TEXT, "", self.epw) + 4.0
        return 0.0

    def section(self, section: Section) -> None:
        """Write a section, with its heading in the outline."""
        self._room(16 + self._asked(section.blocks))
        self.ln(4)
        self.set_draw_color(*_RULE)
        self.line(self.l_margin, self.get_y(), self.w - self.r_margin, self.get_y())
        self.ln(2)
        self.start_section(section.title)
        self._write(section.title, size=13.5, style="B")
        for index, block in enumerate(section.blocks):
            if isinstance(block, Subheading):
                self._room(self._asked(section.blocks[index:]))
            self._block(block)

    def _asked(self, blocks: Sequence[Block]) -> float:
        """Return the height in mm that the first block needs below a heading, so that they stay together."""
        match blocks:
            case [Subheading(), *rest]:
                return 10 + self._asked(rest)
            case [Images() as images, *_]:
                return self._images_height(images)
            case []:
                return 0.0
        return 30.0

    def _block(self, block: Block) -> None:
        match block:
            case Paragraph(text):
                self._write(text)
            case Subheading(text):
                self._write(text, size=11, style="B", above=2)
            case Notice(text, warning, name):
                self._notice(f"{text} [{name}]" if name else text, warning)
            case Listing(lines, code):
                for line in lines:
                    self._write(line if code else f"•  {line}", size=_TINY if code else _TEXT, code=code, below=0.6)
            case Terms(pairs):
                for term, meaning in pairs:
                    self._room(12)
                    self._write(term, style="B", below=0)
                    self._write(meaning)
            case Table():
                self._table(block)
            case Images():
                self._images(block)
            case Tiles(tiles):
                self._tiles(tiles)
            case Gallery(cards):
                self._gallery(cards)
            case Details(summary, blocks):
                self._room(25)
                self._write(summary, style="B", above=1.5)
                for inner in blocks:
                    self._block(inner)

    def _look(self, size: float, style: str = "", color: tuple[int, int, int] = _INK, *, code: bool = False) -> None:
        self.set_font("code" if code else "text", style, size)
        self.set_text_color(*color)

    def _write(
        self,
        text: str,
        *,
        size: float = _TEXT,
        style: str = "",
        color: tuple[int, int, int] = _INK,
        code: bool = False,
        above: float = 0.0,
        below: float = 1.6,
    ) -> None:
        """Write a paragraph over the whole width."""
        self.ln(above)
        self._look(size, style, color, code=code)
        self._paragraph(size, text)
        self.ln(below)

    def _paragraph(self, size: float, text: str, **look: Any) -> None:
        self.multi_cell(0, _LINE * size * _MM_PER_POINT, text, align="L", new_x="LMARGIN", new_y="NEXT", **look)

    def _notice(self, text: str, warning: bool) -> None:
        self._room(14)
        self._look(_TEXT)
        self.set_fill_color(*(_ALARM_TINT if warning else _TINT))
        self.set_draw_color(*(_ALARM if warning else _ACCENT))
        self.set_line_width(0.9)
        self._paragraph(_TEXT, text, border="L", fill=True, padding=Padding(1.2, 2, 1.2, 3))
        self.set_line_width(0.2)
        self.set_fill_color(0)
        self.ln(1.6)

    def _room(self, height_mm: float) -> None:
        """Start a new page if less than `height_mm` is left."""
        if self.get_y() + height_mm > self.h - self.b_margin:
            self.add_page()

    def _image_width(self, block: Images) -> float:
        count = len(block.images)
        return min(_DRAWING_MM, (self.epw - _GAP * (count - 1)) / count)

    def _images_height(self, block: Images) -> float:
        """Return the height of images, titles and caption, in mm."""
        self._look(_SMALL)
        line = _LINE * _SMALL * _MM_PER_POINT
        caption = self.multi_cell(0, line, block.caption, dry_run=True, output="HEIGHT")
        assert isinstance(caption, float)
        tallest = max(_height_over_width(image) for image in block.images) * self._image_width(block)
        return tallest + (6.0 if any(image.title for image in block.images) else 0.0) + caption + 4.0

    def _images(self, block: Images) -> None:
        self._room(self._images_height(block))
        width = self._image_width(block)
        lefts = [self.l_margin + number * (width + _GAP) for number in range(len(block.images))]
        if any(image.title for image in block.images):
            self._look(_SMALL, "B")
            for image, left in zip(block.images, lefts, strict=True):
                self.set_x(left)
                self.cell(width, 5, image.title)
            self.ln(6)
        top = self.get_y()
        self.set_draw_color(0)  # the default color of SVG elements; fpdf2 would use the current color
        self.set_fill_color(0)
        for image, left in zip(block.images, lefts, strict=True):
            self.image(_readable(image), x=left, y=top, w=width, alt_text=image.alternative)
        self.set_y(top + max(_height_over_width(image) for image in block.images) * width + 1)
        self._write(block.caption, size=_SMALL, color=_QUIET, below=4)

    def _tiles(self, tiles: Sequence[Tile]) -> None:
        width = (self.epw - _GAP * (_TILES - 1)) / _TILES
        for row in _in_rows(tiles, _TILES):
            texts = [_tile_lines(tile) for tile in row]
            height = self._tiles_height(row) - 2
            self._room(height)
            top = self.get_y()
            for number, (tile, lines) in enumerate(zip(row, texts, strict=True)):
                left = self.l_margin + number * (width + _GAP)
                color = _STATES.get(tile.state, _INK)
                self.set_fill_color(*_TINT)
                self.rect(left, top, width, height, style="F")
                self.set_fill_color(*(_STATES.get(tile.state, _RULE)))
                self.rect(left, top, 0.9, height, style="F")
                self.set_y(top + 1)
                for (text, size, style), shade in zip(lines, (_QUIET, color, _QUIET), strict=True):
                    self._look(size, style, shade)
                    self.set_x(left + 3)
                    self.multi_cell(width - 4, _LINE * size * _MM_PER_POINT, text, align="L", new_y="NEXT")
            self.set_y(top + height + 2)
        self.set_fill_color(0)

    def _tiles_height(self, row: Sequence[Tile]) -> float:
        """Return the height of a row of tiles with the gap below, in mm."""
        width = (self.epw - _GAP * (_TILES - 1)) / _TILES
        return max(sum(self._height(*line, width - 4) for line in _tile_lines(tile)) for tile in row) + 4

    def _height(self, text: str, size: float, style: str, width: float) -> float:
        """Return the height of a text that is wrapped to a width, in mm."""
        self._look(size, style)
        line = _LINE * size * _MM_PER_POINT
        height = self.multi_cell(width, line, text, dry_run=True, output="HEIGHT") if text else 0.0
        assert isinstance(height, float | int)
        return float(height)

    def _cards_height(self, row: Sequence[Card], across: int) -> float:
        """Return the height of a row of images with titles and captions, in mm."""
        width = (self.epw - _GAP * (across - 1)) / across
        titles = max(self._height(card.image.title, _SMALL, "B", width) for card in row)
        captions = max(self._height(card.caption, _SMALL, "", width) for card in row)
        return titles + max(_height_over_width(card.image) for card in row) * width + captions + 3

    def _gallery(self, cards: Sequence[Card], across: int | None = None) -> None:
        across = across or _across(cards)
        width = (self.epw - _GAP * (across - 1)) / across
        for row in _in_rows(cards, across):
            titles = max(self._height(card.image.title, _SMALL, "B", width) for card in row)
            captions = max(self._height(card.caption, _SMALL, "", width) for card in row)
            tallest = max(_height_over_width(card.image) for card in row) * width
            self._room(self._cards_height(row, across))
            top = self.get_y()
            for number, card in enumerate(row):
                left = self.l_margin + number * (width + _GAP)
                line = _LINE * _SMALL * _MM_PER_POINT
                self._look(_SMALL, "B")
                self.set_xy(left, top)
                self.multi_cell(width, line, card.image.title, align="L")
                self.set_draw_color(0)
                self.set_fill_color(0)
                self.image(_readable(card.image), x=left, y=top + titles, w=width, alt_text=card.image.alternative)
                self._look(_SMALL, color=_QUIET)
                self.set_xy(left, top + titles + tallest)
                self.multi_cell(width, line, card.caption, align="L")
            self.set_y(top + titles + tallest + captions + 3)

    def _table(self, table: Table) -> None:
        self._room(30)
        if table.beside:
            self._write(f"{len(table.rows)} rows in the file {beside_name(self._stem, table)}. {table.caption}")
            return
        self._write(table.caption, size=_SMALL, color=_QUIET, above=1, below=0.8)
        self.set_draw_color(*_RULE)
        widths = self._widths(table)
        self._look(_SMALL)
        with self.table(
            col_widths=widths,
            width=min(sum(widths), self.epw),
            align="LEFT",
            text_align=tuple("RIGHT" if column.numeric else "LEFT" for column in table.columns),
            v_align="TOP",
            borders_layout="HORIZONTAL_LINES",
            headings_style=FontFace(emphasis="BOLD", color=_INK),
            line_height=1.3 * _SMALL * _MM_PER_POINT,
            padding=(0.7, 1.2, 0.7, 0),
        ) as laid:
            laid.row([column.title for column in table.columns])
            for row in table.rows:
                if isinstance(row, Heading):
                    style = FontFace(emphasis="BOLD", color=_ACCENT)
                    laid.row().cell(row.text, colspan=len(table.columns), style=style)
                else:
                    laid.row(row)
        self.ln(2)

    def _widths(self, table: Table) -> list[float]:
        """Return the column widths: the requested ones, or a minimum plus a fraction of the remaining width."""
        rows = [row for row in table.rows if not isinstance(row, Heading)]
        texts = list(zip([column.title for column in table.columns], *rows, strict=True))
        self._look(_SMALL, "B")  # bold is the widest style
        wanted = [self._widest(column) for column in texts]
        if sum(wanted) <= self.epw:
            return wanted
        words = [self._widest([word for text in column for word in re.split(r"[ \n-]", text)]) for column in texts]
        least = [
            width if column.numeric else min(width, max(_NARROW, min(word, _WIDE)))
            for width, word, column in zip(wanted, words, table.columns, strict=True)
        ]
        spare = self.epw - sum(least)
        asked = [width - floor for width, floor in zip(wanted, least, strict=True)]
        if spare <= 0 or sum(asked) == 0:
            return [floor * self.epw / sum(least) for floor in least]
        # A column of sentences may request more than the page width, and can be wrapped.
        weights = [min(ask, self.epw) for ask in asked]
        return [floor + spare * weight / sum(weights) for floor, weight in zip(least, weights, strict=True)]

    def _widest(self, texts: Sequence[str]) -> float:
        return max(map(self.get_string_width, texts)) + _PADDING


def _tile_lines(tile: Tile) -> tuple[tuple[str, float, str], ...]:
    """Return text, size and style of the lines of a tile."""
    return (tile.label, _TINY, ""), (tile.text, 10.5, "B"), (tile.note, _TINY, "")


def _across(cards: Sequence[Card]) -> int:
    return 2 if len(cards) <= _FEW_CARDS else 3


def _fitting(heights: Sequence[float], space: float) -> int:
    """Return how many of the first heights fit into a space.

    Examples
    --------
    >>> _fitting([30, 30, 30], 70)
    2
    """
    return sum(total <= space for total in accumulate(heights))


def _in_rows(items: Sequence[_Item], across: int) -> list[Sequence[_Item]]:
    """Return items in rows.

    Examples
    --------
    >>> _in_rows("abcde", 2)
    ['ab', 'cd', 'e']
    """
    return [items[start : start + across] for start in range(0, len(items), across)]


def _readable(image: Image) -> io.BytesIO:
    """Return an image as fpdf2 reads it: without the transform that turns the pictures of matplotlib upside down."""

    def turned(found: re.Match[bytes]) -> bytes:
        with Picture.open(io.BytesIO(base64.b64decode(found[2]))) as picture:
            stream = io.BytesIO()
            picture.transpose(Picture.Transpose.FLIP_TOP_BOTTOM).save(stream, format="PNG")
        return found[1] + base64.b64encode(stream.getvalue()) + found[3] + found[4] + b'y="%.6f"' % -float(found[5])

    return io.BytesIO(_TURNED.sub(turned, image.content))


_TURNED = re.compile(
    rb'(<image xlink:href="data:image/png;base64,)([^"]+)("[^>]*?)transform="scale[^"]*"([^>]*?)y="([-.0-9]+)"'
)


def _height_over_width(image: Image) -> float:
    """Return the aspect ratio of an SVG or a picture."""
    if image.media_type == "image/svg+xml":
        head = image.content[:2000].decode("utf-8", "replace")
        found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', head)
        if found is None:
            raise ValueError(f"the drawing '{image.alternative}' has no viewBox")
        return float(found[2]) / float(found[1])
    with Picture.open(io.BytesIO(image.content)) as picture:
        return picture.height / picture.width
