"""Write a page as HTML or PDF, one file that loads nothing and runs no scripts."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from photosite.files.writing import atomic_path
from photosite.report.page import Page


def write_report(page: Page, path: str | PathLike[str]) -> None:
    """Write a page to a file: PDF if the suffix is .pdf, else HTML.

    Raises
    ------
    FileError
        If the file cannot be written. An existing file is then unchanged.
    """
    if Path(path).suffix.lower() == ".pdf":
        from photosite.report.pdf import pdf_bytes

        content = pdf_bytes(page)
    else:
        content = render_page(page).encode("utf-8")
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


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
