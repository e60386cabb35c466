"""A figure of the study: on the page, and as files beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from photosite.report.page import Block, Image, Images
from photosite.report.style import png_bytes, svg_bytes

_OF_THE_PAPER = {
    "figure1-spectral-sensitivity": (
        "Figure 1: virtual cameras, not the paper’s curves. D200: another D200’s, with an assumed scale; vendor: "
        "ISETCam’s example sensor"
    ),
    "figure2-pictures": "Figure 2: virtual cameras",
    "figure3-patch-means": "Figure 3: virtual cameras",
    "figure4-patch-snr": "Figure 4: virtual cameras",
    "figure5-color-differences": "Figure 5: virtual cameras",
    "figure6-snr": "Figure 6: virtual cameras",
    "figure7-pixel-size-pictures": "Figure 7: simulated",
    "figure7-pixel-size-snr": "Figure 7: simulated",
    "fill-factor-residuals": "Section 3, not a figure of the paper: virtual cameras",
    "table1-deviations": "Table 1, not a figure of the paper: virtual cameras",
    "section5-dim-face": "Section 5, not the paper’s picture: simulated",
    "section5-high-dynamic-range": "Section 5, not the paper’s picture: simulated",
    "section5-high-dynamic-range-wedge": "Section 5, not a figure of the paper: simulated",
}
"""What stands below each figure, since its files are read without the page's captions."""


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
        """Draw a figure, in both formats, with a line below that says which it is and that no camera was measured."""
        below = f"photosite, Farrell et al. 2008, {_OF_THE_PAPER[name]}"
        return cls(name, svg_bytes(figure, below), png_bytes(figure, below=below), alternative, caption)

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
