"""The PDF has the content of the page: text, outline and fonts, read by a small parser."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photosite.errors import FileError
from photosite.metrics.measurement import FieldMap
from photosite.report.calibration import calibration_page
from photosite.report.figures.measurement import map_figure
from photosite.report.page import (
    Card,
    Column,
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
    figure_block,
    jpeg_bytes,
)
from photosite.report.pdf import pdf_bytes
from photosite.report.write import write_report


def objects(pdf: bytes) -> dict[int, bytes]:
    """Return the objects by number, with streams inflated."""
    found = {}
    for number, body in re.findall(rb"(?:^|\n)(\d+) 0 obj\n(.*?)\nendobj", pdf, re.DOTALL):
        head, stream, rest = body.partition(b"\nstream\n")
        if stream:
            data = rest.rpartition(b"\nendstream")[0]
            body = head + b"\nstream\n" + (zlib.decompress(data) if b"FlateDecode" in head else data)
        found[int(number)] = body
    return found


def text_of(pdf: bytes) -> list[str]:
    """Return the text of each page with single spaces, decoded by the fonts' glyph maps."""
    parts = objects(pdf)
    fonts: dict[bytes, dict[str, str]] = {}
    names = dict(re.findall(rb"/(F\d+) (\d+) 0 R", b"\n".join(parts.values())))
    for name, number in names.items():
        unicode_map = parts[int(re.search(rb"/ToUnicode (\d+)", parts[int(number)])[1])].decode("ascii")
        pairs = re.findall(r"<([0-9A-Fa-f]{4})> <([0-9A-Fa-f]{4,})>\n", unicode_map)
        fonts[name] = {code.upper(): bytes.fromhex(to).decode("utf-16-be") for code, to in pairs}
    pages = []
    for body in parts.values():
        if b"/Type /Page\n" not in body:
            continue
        content = parts[int(re.search(rb"/Contents (\d+)", body)[1])].partition(b"\nstream\n")[2]
        texts, font = [], {}
        for switch, string in re.findall(rb"/(F\d+) [\d.]+ Tf|\(((?:[^()\\]|\\.)*)\)", content, re.DOTALL):
            if switch:
                font = fonts[switch]
                continue
            raw = re.sub(rb"\\([nrtbf()\\])", lambda m: ESCAPES.get(m[1], m[1]), string)
            texts.append("".join(font[raw[i : i + 2].hex().upper()] for i in range(0, len(raw), 2)))
        pages.append(" ".join(" ".join(texts).split()))
    return pages


ESCAPES = {b"n": b"\n", b"r": b"\r", b"t": b"\t", b"b": b"\b", b"f": b"\f"}


def words(text: str) -> str:
    """Remove white space, so that line breaks do not matter."""
    return "".join(text.split())


@pytest.fixture(scope="module")
def of_loop(loop) -> tuple[Page, bytes]:
    """The report of a calibration with all tables and four figures, and its PDF at a given time."""
    page = calibration_page(replace(loop.calibration, curves={}, snr={}, linearity={}, spatial={}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "1700000000")
        return page, pdf_bytes(page)


def test_every_kind_of_block() -> None:
    table = Table(
        "caption", (Column("left"), Column("right", numeric=True)), (Heading("over"), ("cell", "−3.2 × 10⁻⁵"))
    )
    blocks = (
        Paragraph("3 e⁻ ± 1, “quoted” & <not markup>"),
        Subheading("below"),
        Notice("mind", warning=True),
        Listing(("first", "second")),
        Terms((("word", "meaning"),)),
        Details("folded", (Paragraph("laid open"), table)),
    )
    (text,) = text_of(pdf_bytes(Page("Title", "Lead.", (Section("One", blocks), Section("Empty", ())), "end")))
    for said in ("Title", "Lead.", "One", "3 e⁻ ± 1, “quoted” & <not markup>", "below", "mind", "• first", "• second"):
        assert said in text, said
    for said in ("word", "meaning", "folded", "laid open", "caption", "left", "right", "over", "cell", "−3.2 × 10⁻⁵"):
        assert said in text, said
    assert "Empty" not in text
    assert "page 1" in text


def test_report_contains_every_value_and_interval(of_loop) -> None:
    page, pdf = of_loop
    pages = text_of(pdf)
    assert len(pages) > 5
    whole = words("".join(pages))
    tables = [block for section in page.sections for block in section.blocks if isinstance(block, Table)]
    cells = [cell for table in tables for row in table.rows if not isinstance(row, Heading) for cell in row]
    assert len(cells) > 200
    for cell in cells:
        # A line of a neighboring cell may separate the words of a cell.
        for word in cell.split():
            assert words(word) in whole, f"'{word}' of '{cell}'"


def test_outline_and_alternative_texts(of_loop) -> None:
    page, pdf = of_loop
    for section in (one for one in page.sections if one.blocks):
        title = section.title.encode("utf-16-be").hex().upper()
        assert title.encode() in pdf.upper() or f"({section.title})".encode() in pdf, section.title
    figures = [block for section in page.sections for block in section.blocks if isinstance(block, Images)]
    assert pdf.count(b"/Alt ") == len(figures) == 4


def test_digests_are_in_a_file_beside_the_pdf(tmp_path: Path) -> None:
    frames = tuple((f"dark_{n}.tif", f"{n:064x}") for n in range(300))
    table = Table("Digests of the frames.", (Column("Frame"), Column("SHA-256")), frames, beside="frames")
    page = Page("t", "l", (Section("Provenance", (Details("All frames", (table,)),)),))
    write_report(page, tmp_path / "chip.pdf")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["chip.frames.csv", "chip.pdf"]
    lines = (tmp_path / "chip.frames.csv").read_text(encoding="utf-8").splitlines()
    assert (lines[0], lines[-1], len(lines)) == ("Frame,SHA-256", f"dark_299.tif,{299:064x}", 301)
    (text,) = text_of((tmp_path / "chip.pdf").read_bytes())
    assert "300 rows in the file chip.frames.csv" in text


def test_pdf_is_reproducible_and_self_contained(of_loop, monkeypatch: pytest.MonkeyPatch) -> None:
    page, one = of_loop
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert one == pdf_bytes(page)
    assert b"D:20231114221320" in one
    assert one.startswith(b"%PDF-")
    assert one.rstrip().endswith(b"%%EOF")
    assert b"/URI" not in one
    assert len(one) < 1_000_000


def test_suffix_selects_the_format_and_writing_is_atomic(
    darks_only, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "report.PDF"
    darks_only.report(path)
    assert path.read_bytes()[:5] == b"%PDF-"
    path.write_bytes(b"old")
    monkeypatch.setattr(Path, "write_bytes", _full_disk)
    with pytest.raises(FileError) as error:
        write_report(Page("t", "l", ()), path)
    assert error.value.path == str(path)
    assert path.read_bytes() == b"old"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["report.PDF", "report.frames.csv"]


def _full_disk(*args: object) -> int:
    raise OSError(28, "No space left on device")


def test_pictures_within_figures_are_upright(caplog: pytest.LogCaptureFixture) -> None:
    """Matplotlib turns the pictures in an SVG upside down by a transform, which fpdf2 ignores."""
    values = np.zeros((6, 8))
    values[0] = 1.0  # a bright row on top
    figure = map_figure(FieldMap("", "level", np.arange(6.0), np.arange(8.0), values))
    pdf = pdf_bytes(Page("Map", "", (Section("One", (figure_block(figure, "map", "caption"),)),)))
    assert not [record for record in caplog.records if "transform" in record.getMessage()]
    (pixels,) = (
        body.partition(b"\nstream\n")[2]
        for body in objects(pdf).values()
        if b"/Subtype /Image" in body and int(re.search(rb"/Width (\d+)", body)[1]) > 100  # not the color bar
    )
    assert sum(pixels[1:4]) > 2 * sum(pixels[-3:]), "bright on top"


def test_the_overview_is_a_page_of_its_own() -> None:
    overview = (Tiles((Tile("MTF50 ≥ 0.3", "fail", "0.28", "fail"),)),)
    first, second = text_of(pdf_bytes(Page("Title", "Lead.", (Section("One", (Paragraph("read"),)),), "", overview)))
    assert "MTF50 ≥ 0.3 fail 0.28" in first
    assert "One" not in first
    assert "One read" in second


def test_an_overview_of_many_charts_begins_with_one_whole_page() -> None:
    """Values and figures share the first page, and the others follow in their order."""
    picture = jpeg_bytes(np.zeros((60, 80, 3), np.float32))
    tiles = tuple(Tile(f"value {n}.", "1", "0 to 2") for n in range(60))
    cards = tuple(Card(Image(picture, "image/jpeg", "", f"figure {n}.")) for n in range(24))
    blocks = (Tiles(tiles), Notice("Diagnostics."), Gallery(cards))
    pages = text_of(pdf_bytes(Page("Title", "Lead.", (Section("One", (Paragraph("read"),)),), "", blocks)))
    first, *rest = pages
    assert "value 0." in first
    assert "Diagnostics." in first
    assert first.count("figure ") >= 6
    assert first.endswith("page 1")
    assert "follow on the next page" in first
    whole = " ".join(pages)
    for word, count in (("value", 60), ("figure", 24)):
        assert [int(n) for n in re.findall(rf"{word} (\d+)\.", whole)] == list(range(count))
    assert "read" in rest[-1]
    assert len(pages) <= 5

    few = (Tiles(tiles[:8]), Gallery(cards[:6]))
    pages = text_of(pdf_bytes(Page("Title", "Lead.", (Section("One", (Paragraph("read"),)),), "", few)))
    assert ["figure 5." in page for page in pages] == [True, False]
    assert "next page" not in pages[0]
