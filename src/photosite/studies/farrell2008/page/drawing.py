"""A figure of the study, for the page and as SVG and PNG files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from photosite.report.page import Block, Image, Images
from photosite.report.style import png_bytes, svg_bytes

_NOTES = {
    "figure1-spectral-sensitivity": (
        "Figure 1: virtual cameras, not the curves of the paper. D200: measured on another D200, assumed scale; "
        "vendor: example sensor of ISETCam"
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
    "section5-dim-face": "Section 5, not a picture of the paper: simulated",
    "section5-high-dynamic-range": "Section 5, not a picture of the paper: simulated",
    "section5-high-dynamic-range-wedge": "Section 5, not a figure of the paper: simulated",
}
"""Note below each figure, because its files are also seen without the captions of the page."""


@dataclass(frozen=True)
class Drawing:
    """A drawn figure.

    Parameters
    ----------
    name
        File name without suffix.
    svg, png
        Content of the files.
    alternative, caption
        Alternative text and caption on the page.
    """

    name: str
    svg: bytes
    png: bytes
    alternative: str
    caption: str

    @classmethod
    def of(cls, name: str, figure: Figure, alternative: str, caption: str) -> Drawing:
        """Draw a figure in both formats, with a note below it."""
        below = f"photosite, Farrell et al. 2008, {_NOTES[name]}"
        return cls(name, svg_bytes(figure, below), png_bytes(figure, below=below), alternative, caption)

    @property
    def block(self) -> Images:
        """The figure as a block of the page."""
        return Images((Image(self.svg, "image/svg+xml", self.alternative),), self.caption)

    def save(self, folder: Path) -> None:
        """Write NAME.svg and NAME.png."""
        (folder / f"{self.name}.svg").write_bytes(self.svg)
        (folder / f"{self.name}.png").write_bytes(self.png)


Part = tuple[Block | Drawing, ...]
"""Blocks and figures of a chapter in their order."""
