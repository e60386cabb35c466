"""Small pieces that several pages are made of."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from photosite.report.html import Image, Images, Paragraph
from photosite.report.style import svg_bytes
from photosite.values.uncertain import Missing


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


def lacking_blocks(found: Mapping[str, object], what: str) -> tuple[Paragraph, ...]:
    """Which channels are not in a figure although others are, and why.

    Parameters
    ----------
    found
        What the figure shows by channel, or `Missing`.
    what
        What the figure shows, in words.

    Examples
    --------
    >>> lacking_blocks({"R": 1, "G": Missing("no flats"), "B": Missing("no flats")}, "linearity")[0].text
    'Channels G and B have no linearity: no flats.'
    """
    reasons: dict[str, list[str]] = {}
    for channel, entry in found.items():
        if isinstance(entry, Missing):
            reasons.setdefault(entry.reason, []).append(channel)
    if len(found) == sum(map(len, reasons.values())):
        return ()
    return tuple(
        Paragraph(sentence(f"channel{'s' * (len(names) > 1)} {_listed(names)} {_have(names)} no {what}: {reason}"))
        for reason, names in reasons.items()
    )


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _have(names: list[str]) -> str:
    return "has" if len(names) == 1 else "have"
