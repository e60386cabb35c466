"""Write a page to a file, as HTML or PDF."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from photosite.files.atomic import atomic_path
from photosite.report.html import render_page
from photosite.report.page import Page


def write_report(page: Page, path: str | PathLike[str]) -> None:
    """Write a page to a single, self-contained file.

    Parameters
    ----------
    page
        The page.
    path
        File to write: PDF if the suffix is .pdf, else HTML.

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
