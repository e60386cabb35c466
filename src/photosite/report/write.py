"""A page as a file: HTML or PDF, by the ending of its name."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from photosite.report.html import Page, write_page


def write_report(page: Page, path: str | PathLike[str]) -> None:
    """Write a page to a file, whole or not at all.

    Parameters
    ----------
    page
        What to say.
    path
        The file: a PDF where it ends in .pdf, HTML otherwise.

    Raises
    ------
    FileError
        If it cannot be written; a file that had the name stays as it was.
    """
    if Path(path).suffix.lower() == ".pdf":
        from photosite.report.pdf import write_pdf

        write_pdf(page, path)
    else:
        write_page(page, path)
