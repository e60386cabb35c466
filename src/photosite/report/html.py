"""Pages as HTML: one file that contains its style sheet and images, loads nothing and runs no scripts."""

from __future__ import annotations

from photosite.report.page import Page


def render_page(page: Page) -> str:
    """Return the page as an HTML document; equal pages give equal text.

    Parameters
    ----------
    page
        The page.

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
