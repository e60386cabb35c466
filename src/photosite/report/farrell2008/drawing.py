"""A figure of the study: on the page, and as files beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from photosite.report.html import Block, Image, Images
from photosite.report.style import png_bytes, svg_bytes


@dataclass(frozen=True)
class Drawing:
    """A figure, drawn.

    Parameters
    ----------
    name
        Of its files, without an ending.
    svg, png
        Their bytes.
    alternative, caption
        For the page: what it shows to readers who do not see it, and what stands below it.
    """

    name: str
    svg: bytes
    png: bytes
    alternative: str
    caption: str

    @classmethod
    def of(cls, name: str, figure: Figure, alternative: str, caption: str) -> Drawing:
        """Draw a figure, in both formats."""
        return cls(name, svg_bytes(figure), png_bytes(figure), alternative, caption)

    @property
    def block(self) -> Images:
        """The figure on a page."""
        return Images((Image(self.svg, "image/svg+xml", self.alternative),), self.caption)

    def save(self, folder: Path) -> None:
        """Write NAME.svg and NAME.png."""
        (folder / f"{self.name}.svg").write_bytes(self.svg)
        (folder / f"{self.name}.png").write_bytes(self.png)


Part = tuple[Block | Drawing, ...]
"""What the page says of a chapter: blocks and figures in their order."""
