"""Small pieces that several pages are made of."""

from __future__ import annotations

from matplotlib.figure import Figure

from photosite.report.html import Image, Images, Paragraph
from photosite.report.style import svg_bytes


def figure_block(figure: Figure, alternative: str, caption: str) -> Images:
    """A figure with its caption, as a block of a page."""
    return Images((Image(svg_bytes(figure), "image/svg+xml", alternative),), caption)


def sentence(text: str) -> str:
    """With a full stop at the end and a capital at the beginning, unless it begins with a parameter's name.

    Examples
    --------
    >>> sentence("no light frames"), sentence("dsnu_mv: too large")
    ('No light frames.', 'dsnu_mv: too large.')
    """
    first = text.split(" ", 1)[0]
    whole = text if "_" in first else text[:1].upper() + text[1:]
    return whole if whole.endswith((".", "!", "?")) else f"{whole}."


def reason_block(reason: str) -> Paragraph:
    """What stands in the place of a figure that is missing."""
    return Paragraph(f"Not shown: {sentence(reason)}")
