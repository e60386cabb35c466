"""Write a page as HTML or PDF.

The HTML is one file that loads nothing; its only script sorts and copies tables. A PDF has no room for long tables of
digests, which are written beside it as CSV.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from os import PathLike
from pathlib import Path

from photosite.files.writing import atomic_path
from photosite.report.page import Block, Details, Heading, Page, Table, beside_name


def write_report(page: Page, path: str | PathLike[str]) -> None:
    """Write a page to a file: PDF if the suffix is .pdf, with its tables for a file beside it as CSV, else HTML.

    Raises
    ------
    FileError
        If the file cannot be written. An existing file is then unchanged.
    """
    target = Path(path)
    if target.suffix.lower() == ".pdf":
        from photosite.report.pdf import pdf_bytes

        content = pdf_bytes(page, target.stem)
        for table in (found for section in page.sections for found in _beside(section.blocks)):
            with atomic_path(target.with_name(beside_name(target.stem, table))) as temporary:
                temporary.write_text(_csv(table), encoding="utf-8")
    else:
        content = render_page(page).encode("utf-8")
    with atomic_path(target) as temporary:
        temporary.write_bytes(content)


def _beside(blocks: Sequence[Block]) -> Iterator[Table]:
    """Yield the tables for files beside a PDF."""
    for block in blocks:
        if isinstance(block, Details):
            yield from _beside(block.blocks)
        elif isinstance(block, Table) and block.beside:
            yield block


def _csv(table: Table) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.title for column in table.columns])
    writer.writerows(row for row in table.rows if not isinstance(row, Heading))
    return text.getvalue()


def render_page(page: Page) -> str:
    """Return the page as an HTML document that contains its style sheet and images; equal pages give equal text.

    Examples
    --------
    >>> from photosite.report.page import Paragraph, Section
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
