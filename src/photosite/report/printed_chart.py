"""Charts to print: a picture at its size, and the reflectances of the paper or transmittances of the film."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from fpdf import FPDF
from numpy.typing import NDArray
from PIL import Image

from photosite.color.colorimetry import srgb_from_light
from photosite.errors import InputError
from photosite.files.writing import atomic_path, date_of_files
from photosite.scene.charts.chart import Chart
from photosite.values.region import Region
from photosite.values.shown import Shown

_MM_PER_INCH = 25.4
_MARGIN_MM = 15.0
_TEXT_PT, _LINE_MM, _ENTRY_MM = 8.0, 4.0, 58.0
_MOST_NAMED = 2
"""Patches of equal values up to which each is named."""
_MOST_PIXELS = 1 << 28
_DARKEST = 3e-4
"""Linear value of the code 1 in sRGB of 8 bits."""


def dots(width_mm: float, dots_per_inch: int) -> int:
    """Return the dots across a width.

    Examples
    --------
    >>> dots(25.4, 600)
    600
    """
    return round(width_mm / _MM_PER_INCH * dots_per_inch)


@dataclass(frozen=True)
class PrintedPatch(Shown):
    """What a patch of a printed chart should be.

    Parameters
    ----------
    name, factor
        The patch, and its reflectance; its transmittance on film.
    transmissive
        Whether it is on film.

    Examples
    --------
    >>> str(PrintedPatch("gray", 0.18)), str(PrintedPatch("gray", 0.18, transmissive=True))
    ('reflectance 0.180, L* 49.5', 'transmittance 0.180, density 0.74')
    """

    name: str
    factor: float
    transmissive: bool = False

    @property
    def quantity(self) -> str:
        """What the factor is."""
        return "transmittance" if self.transmissive else "reflectance"

    @property
    def lightness(self) -> float:
        """CIELAB L*, relative to a perfect diffuser, or to the light without film."""
        return 116.0 * self.factor ** (1 / 3) - 16.0 if self.factor > (6 / 29) ** 3 else self.factor * (29 / 3) ** 3

    @property
    def density(self) -> float:
        """Negative decimal logarithm of the factor."""
        return -math.log10(self.factor) + 0.0 if self.factor > 0 else math.inf

    def __str__(self) -> str:
        after = f"density {self.density:.2f}" if self.transmissive else f"L* {self.lightness:.1f}"
        factor = f"{self.factor:.3f}" if self.factor >= 0.01 else f"{self.factor:.2g}"
        return f"{self.quantity} {factor}, {after}"


def write_printed_chart(
    chart: Chart,
    path: str | PathLike[str],
    *,
    width_mm: float,
    dots_per_inch: int = 600,
    brightest: float | None = None,
) -> tuple[PrintedPatch, list[PrintedPatch]]:
    """Write a gray chart as PNG or PDF that prints at its size, in sRGB, and return what its parts should be.

    Parameters
    ----------
    chart
        A gray chart, without a light.
    path
        A .png file with its resolution, or a .pdf file of one page with the chart's size, name, brightest part and
        patches below it.
    width_mm, dots_per_inch
        Width on paper or film, and the resolution; a sample becomes the nearest dots.
    brightest
        Reflectance of the brightest sample, 0.9 by default; where the chart is transmissive, its transmittance, 1.

    Returns
    -------
    tuple
        The brightest part, and the patches.

    Raises
    ------
    InputError
        If the chart is in color, whose spectra no printer has, the picture would be too large, or patches would be
        darker than 8 bits show.
    """
    if chart.reflectance is not None:
        raise InputError("chart", value=chart.name, expected="gray: a printer does not have the spectra of colors")
    if brightest is None:
        brightest = 1.0 if chart.transmissive else 0.9
    rows, cols = chart.weights.shape[1:]
    wide = dots(width_mm, dots_per_inch)
    high = round(wide * rows / cols)
    if not 1 <= wide * high <= _MOST_PIXELS:
        raise InputError("width_mm", value=width_mm, expected=f"at most {_MOST_PIXELS} dots in all")
    if not 0 < brightest <= 1:
        raise InputError("brightest", value=brightest, expected="above 0 and at most 1")
    reflectance = chart.weights[0].astype(np.float64) * (brightest / float(chart.weights.max()))
    row = ((np.arange(high) + 0.5) * rows / high).astype(np.intp)
    col = ((np.arange(wide) + 0.5) * cols / wide).astype(np.intp)
    codes = np.rint(srgb_from_light(reflectance) * 255.0).astype(np.uint8)[row][:, col]
    picture = Image.fromarray(codes)
    patches = [PrintedPatch(each.name, _mean(each, reflectance), chart.transmissive) for each in chart.regions]
    dark = [patch for patch in patches if 0.0 < patch.factor < _DARKEST]
    if dark:
        expected = f"{_DARKEST} or more, as 8 bits show, or 0"
        hint = "Print fewer decades or densities"
        raise InputError(f"{dark[0].quantity} of {dark[0].name}", value=dark[0].factor, expected=expected, hint=hint)
    field = PrintedPatch("brightest part", brightest, chart.transmissive)
    target = Path(path)
    with atomic_path(target) as file:
        if target.suffix.lower() == ".png":
            picture.save(file, format="PNG", dpi=(dots_per_inch, dots_per_inch))
        else:
            file.write_bytes(_pdf(picture, chart, (width_mm, width_mm * high / wide), field, patches))
    return field, patches


def _mean(region: Region, values: NDArray[np.float64]) -> float:
    return float(values[region.r0 : region.r1, region.c0 : region.c1].mean())


def _pdf(
    picture: Image.Image,
    chart: Chart,
    size_mm: tuple[float, float],
    field: PrintedPatch,
    patches: list[PrintedPatch],
) -> bytes:
    width, height = size_mm
    alike: dict[str, list[str]] = {}
    for patch in patches:
        alike.setdefault(str(patch), []).append(patch.name)
    columns = max(int(width // _ENTRY_MM), 1)
    lines = -(-len(alike) // columns) + 3
    page = width + 2 * _MARGIN_MM, height + 2 * _MARGIN_MM + lines * _LINE_MM
    pdf = FPDF(unit="mm", format=page)
    pdf.set_creation_date(date_of_files())
    pdf.set_auto_page_break(False)
    pdf.set_margin(0)
    pdf.add_page()
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    pdf.image(stream, x=_MARGIN_MM, y=_MARGIN_MM, w=width, h=height)
    pdf.set_font("Helvetica", size=_TEXT_PT)
    below = _MARGIN_MM + height + _LINE_MM
    on = "film, for transmitted light" if chart.transmissive else "paper"
    pdf.text(_MARGIN_MM, below, f"{chart.name}; {width:g} x {height:.1f} mm; print at 100 % on {on}, sRGB")
    pdf.text(_MARGIN_MM, below + _LINE_MM, f"{field.name}: {field}")
    for number, (values, names) in enumerate(alike.items()):
        text = f"{', '.join(names) if len(names) <= _MOST_NAMED else f'{names[0]} to {names[-1]}'}: {values}"
        column, line = number % columns, number // columns
        pdf.text(_MARGIN_MM + column * width / columns, below + (line + 2) * _LINE_MM, text)
    return bytes(pdf.output())
