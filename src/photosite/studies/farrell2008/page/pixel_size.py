"""Figure 7 on the page: pixels of 1.4 um and 2.2 um, with and without read noise and DSNU."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.report.numbers import format_number
from photosite.report.page import Column as TableColumn
from photosite.report.page import Listing, Paragraph, Table
from photosite.report.style import BLUE, GRAY, VERMILION, styled
from photosite.studies.farrell2008.page.dim_face import Column, portraits_figure
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.pixel_size import (
    ASSUMPTIONS,
    LUMINANCES_CD_M2,
    PICTURE_LUMINANCE_CD_M2,
    PRESETS,
    PixelCurve,
    PixelPicture,
    PixelSize,
)

_COLORS = dict(zip(PRESETS, (BLUE, VERMILION), strict=True))


def pixel_size_part(chapter: PixelSize) -> Part:
    """Return pictures, curves, the values at the luminances of the paper, and the assumptions."""
    columns = [Column(_title(entry), entry.shot.picture, _note(entry)) for entry in chapter.pictures]
    return (
        Drawing.of(
            "figure7-pixel-size-pictures",
            portraits_figure(columns),
            "The same portrait with pixels of 2.2 and 1.4 micrometres, with and without read noise and DSNU",
            f"Figure 7: the portrait of {PICTURE_LUMINANCE_CD_M2:g} cd/m² on average (its face: "
            f"{chapter.face_luminance_cd_m2:.0f} cd/m²) on the same area of chip, 300 × 256 pixels of 2.2 µm and "
            "472 × 402 of 1.4 µm, f/2.8, 66 ms, tungsten light, gray world. Simulated; pictures with and without read "
            "noise and DSNU share their photon noise.",
        ),
        Drawing.of(
            "figure7-pixel-size-snr",
            pixel_size_figure(chapter),
            "Signal-to-noise ratio of green against luminance for both pixels, per pixel and for the same area",
            "Figure 7 as curves, green, up to saturation. Left: one pixel. Right: the mean over the area of one 2.2 µm "
            "pixel (2.47 pixels of 1.4 µm). Dotted lines are the luminances of the paper for this sensor.",
        ),
        _table(chapter),
        Paragraph(_words(chapter)),
        Paragraph("Assumptions about what the paper does not state:"),
        Listing(ASSUMPTIONS),
    )


@styled()
def pixel_size_figure(chapter: PixelSize) -> Figure:
    """Draw the ratio against luminance, per pixel and per area."""
    figure = Figure(figsize=(8.6, 4.5))
    left, right = figure.subplots(1, 2, sharey=True)
    _draw(left, chapter, lambda curve: curve.snr_db)
    _draw(right, chapter, lambda curve: curve.equal_area_db)
    left.set_title("one pixel", loc="left")
    right.set_title("the area of one 2.2 µm pixel", loc="left")
    left.set_ylabel("signal-to-noise ratio, green (dB)")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _draw(axes: Axes, chapter: PixelSize, ratio: Callable[[PixelCurve], NDArray[np.float64]]) -> None:
    for curve in chapter.curves:
        label = f"{curve.width_um:g} µm, {_with(curve.quiet)}"
        style, color = "--" if curve.quiet else "-", _COLORS[curve.width_um]
        axes.plot(curve.luminance_cd_m2, ratio(curve), style, color=color, label=label)
    for level in LUMINANCES_CD_M2:
        axes.axvline(level, color=GRAY, linestyle=":", linewidth=1.0)
        axes.annotate(
            f"{level:g}", (level, 0.0), (3, 4), ("data", "axes fraction"), "offset points", color=GRAY, fontsize=9
        )
    axes.set(xscale="log", xlabel="luminance of a white surface (cd/m²)")


def _with(quiet: bool) -> str:
    return "without read noise and DSNU" if quiet else "with read noise and DSNU"


def _title(entry: PixelPicture) -> str:
    return f"{entry.width_um:g} µm, {'without' if entry.quiet else 'with'}\nread noise, DSNU"


def _note(entry: PixelPicture) -> str:
    return f"green: {format_number(entry.shot.noise('G').snr_db, 3)} dB"


def _table(chapter: PixelSize) -> Table:
    rows = tuple(
        (
            f"{curve.width_um:g} µm",
            "no" if curve.quiet else "yes",
            *(f"{curve.snr_at(level):.1f}".replace("-", "−") for level in LUMINANCES_CD_M2),
            format_number(curve.luminance_of_good_snr_cd_m2, 3),
            format_number(float(curve.luminance_cd_m2[-1]), 3),
        )
        for curve in chapter.curves
    )
    return Table(
        "Signal-to-noise ratio of one pixel, green, of a white surface; luminances in cd/m²",
        (
            TableColumn("Pixel"),
            TableColumn("Read noise and DSNU"),
            *(TableColumn(f"dB at {level:g}", numeric=True) for level in LUMINANCES_CD_M2),
            TableColumn("20 dB (10 : 1) at", numeric=True),
            TableColumn("Saturates at", numeric=True),
        ),
        rows,
    )


def _words(chapter: PixelSize) -> str:
    dim = LUMINANCES_CD_M2[0]
    noisy, quiet = (chapter.curve(2.2, q).snr_at(dim) - chapter.curve(1.4, q).snr_at(dim) for q in (False, True))
    gain = float(chapter.curve(1.4, True).equal_area_db[0] - chapter.curve(1.4, True).snr_db[0])
    noisy_need, quiet_need = (
        chapter.curve(1.4, q).equal_area_luminance_of_good_snr_cd_m2
        / chapter.curve(2.2, q).equal_area_luminance_of_good_snr_cd_m2
        for q in (False, True)
    )
    return (
        f"At {dim:g} cd/m² a small pixel has {noisy:.1f} dB less than a large one with read noise and DSNU, and "
        f"{quiet:.1f} dB less without. Averaging over the same area gains {gain:.1f} dB: nothing is lost in dim light "
        f"without read noise and DSNU, and {noisy - gain:.1f} dB with them. For 20 dB over the area of a 2.2 µm pixel "
        f"the small pixels need {noisy_need:.2f} times the light with read noise and DSNU, and {quiet_need:.2f} times "
        "without, because PRNU averages out too. In dim light the cost of smaller pixels is the noise that does not "
        "shrink with them. The values of the paper’s Figure 7 are not known."
    )
