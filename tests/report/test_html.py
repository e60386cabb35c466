"""Pages as HTML: escaping, identifiers, links, and atomic writing."""

from __future__ import annotations

from pathlib import Path

import pytest

from photosite.errors import FileError
from photosite.report.page import (
    Column,
    Details,
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
)
from photosite.report.write import render_page, write_report

NASTY = "<script>alert('x')</script> & \"both\" 'quotes' {{ page }} é ⁻¹"


def page_of_everything(text: str) -> Page:
    table = Table(text, (Column(text), Column(text, numeric=True)), ((text, "1"), Heading(text), ("b", text)))
    image = Image(b"\x00\xff", "image/png", alternative=text, title=text)
    blocks = (
        Paragraph(text),
        Notice(text, warning=True),
        Notice(text),
        Listing((text, text), code=True),
        table,
        Images((image,), text),
        Images((image, image), text),
        Details(text, (Paragraph(text), Details(text, (table,)))),
        Subheading(text),
        Terms(((text, text),)),
    )
    return Page(text, text, (Section("One", blocks), Section("Two & three", blocks)), footer=text)


def test_text_is_escaped(read_page) -> None:
    page = read_page(render_page(page_of_everything(NASTY)))
    assert [tag for tag, _ in page.elements].count("script") == 1, "the page's own"
    # Twice each: paragraph, two notices, two lines, two tables of six texts, two captions, three image titles, two
    # summaries and the paragraph inside, subheading, term and meaning. Once each: title in head and page, lead, footer.
    assert page.text.count(NASTY) == 2 * (1 + 2 + 2 + 2 * 6 + 2 + 3 + 2 + 1 + 1 + 2) + 4
    assert page.values("alt") == [NASTY] * 6


def test_identifiers_are_unique_and_links_valid(read_page) -> None:
    page = read_page(render_page(page_of_everything("x")))
    ids = page.values("id")
    assert ids == ["one", "two-three"]
    assert page.values("href") == ["#one", "#one", "#two-three"], "a link past the navigation, and the navigation"


def test_empty_sections_are_omitted(read_page) -> None:
    page = read_page(render_page(Page("t", "l", (Section("Empty", ()), Section("Full", (Paragraph("x"),))))))
    assert page.values("id") == ["full"]
    assert "Empty" not in page.text
    assert "nav" not in {tag for tag, _ in page.elements}, "one section needs no navigation"


def test_row_of_the_wrong_length_is_rejected() -> None:
    with pytest.raises(ValueError, match="expected 2 texts"):
        Table("t", (Column("a"), Column("b")), (("1", "2"), ("1", "2", "3")))


def test_write_is_atomic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page("t", "l", (Section("S", (Paragraph("new"),)),))
    path = tmp_path / "page.html"
    path.write_text("old")
    monkeypatch.setattr(Path, "write_bytes", _full_disk)
    with pytest.raises(FileError) as error:
        write_report(page, path)
    assert error.value.path == str(path)
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_report(page, path)
    assert "new" in path.read_text(encoding="utf-8")


def _full_disk(*args: object, **keywords: object) -> int:
    raise OSError(28, "No space left on device")


def test_missing_folder_is_a_file_error(tmp_path: Path) -> None:
    path = tmp_path / "absent" / "page.html"
    with pytest.raises(FileError) as error:
        write_report(Page("t", "l", ()), path)
    assert error.value.path == str(path)


def test_wide_tables_scroll(read_page) -> None:
    """Each table is in a box that scrolls sideways, by keyboard too, so that narrow screens show everything."""
    table = Table("All of it", (Column("A"), Column("B", numeric=True)), (("a", "1"),))
    page = read_page(render_page(Page("Tables", "", (Section("One", (table, Details("more", (table,)))),))))
    tables = [index for index, (tag, _) in enumerate(page.elements) if tag == "table"]
    assert len(tables) == 2
    for index in tables:
        assert page.elements[index - 1] == (
            "div",
            {"class": "scroll", "role": "region", "aria-label": "All of it", "tabindex": "0"},
        )
