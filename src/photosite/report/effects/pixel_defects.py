"""Defective pixels in the report: counts by kind, and a map."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.pixel_defects import FoundDefects
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.reduction.defective_pixels import in_words
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.numbers import format_number
from photosite.report.page import Block, Paragraph, Table, columns, figure_block, numeric
from photosite.report.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION, WIDTH_IN, styled
from photosite.sensor.chip import DefectKind, Defects

DEFECT_LABELS = {
    DefectKind.HOT: ("Hot: dark current far above the channel's", "DN/s"),
    DefectKind.OFFSET: ("Offset: dark level far from the channel's", "DN"),
    DefectKind.DEAD: ("Dead: response below half of the channel's", "relative response"),
    DefectKind.RESPONSE: ("Response: far from the channel's", "relative response"),
    DefectKind.BLINKING: ("Blinking: jumps between two levels", "DN between levels"),
    DefectKind.NOISY: ("Noisy: noise far above the channel's", "DN"),
}


_DEFECT_MARKS = {
    DefectKind.HOT: ("hot", VERMILION, "o"),
    DefectKind.OFFSET: ("offset", ORANGE, "D"),
    DefectKind.DEAD: ("dead", BLACK, "x"),
    DefectKind.RESPONSE: ("response", BLUE, "+"),
    DefectKind.BLINKING: ("blinking", GREEN, "^"),
    DefectKind.NOISY: ("noisy", PURPLE, "v"),
}


_MOST = 4000  # largest number of pixels drawn of a kind, in order of deviation


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the figures with the pixels that are left out; the defects by kind and their map, if it was mapped."""
    left_out = _left_out(calibration)
    if (chip := calibration.chip) is None:
        return left_out
    defects = chip.defects
    rows = []
    for kind in DefectKind:
        count = len(defects.of(kind))
        rows.append((DEFECT_LABELS[kind][0], str(count), format_number(100.0 * count / chip.offset_dn.size, 3)))
    titles = columns("Kind", numeric("Pixels"), numeric("Percentage (%)"))
    counts = Table("Defective pixels by kind; a pixel may have several kinds", titles, tuple(rows))
    if not len(defects):
        return *left_out, counts, Paragraph("No pixel is defective.")
    figure = figure_block(
        defect_map_figure(defects, chip.shape),
        "Map of the chip with a marker for each defective pixel, by kind",
        "Positions of the defective pixels, row 0 at the top. Markers are much larger than pixels.",
    )
    return *left_out, counts, figure


def _left_out(calibration: Calibration) -> tuple[Block, ...]:
    """Return the figures without and with the defective pixels that are left out of them."""
    found = calibration.findings["pixel_defects"]
    if not isinstance(found, FoundDefects) or found.left_out is None:
        return ()
    left_out, rows = found.left_out, []
    for name, without in left_out.without.items():
        shown = PARAMETER_LABELS[name]
        with_them = format_number(left_out.all_pixels[name], 4)
        rows.append((shown.label, format_number(without, 4), with_them, shown.unit))
    kinds = in_words(left_out.pixels.counts())
    titles = columns("Quantity", numeric("Without them"), numeric("All pixels"), "Unit")
    return (Table(f"Figures without and with {len(left_out.pixels)} defective pixels: {kinds}", titles, tuple(rows)),)


@styled()
def defect_map_figure(defects: Defects, shape: tuple[int, int]) -> Figure:
    """Draw a marker for each defective pixel on the area of a chip of (rows, cols) pixels, row 0 at the top.

    The legend gives the number of each kind. Of more than 4000 pixels of a kind, those with the largest deviation are
    drawn, and the legend gives both numbers.
    """
    rows, cols = shape
    height = min(max((WIDTH_IN - 2.4) * rows / cols, 2.2), 7.0)
    figure = Figure(figsize=(WIDTH_IN, height + 0.9))
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.grid(visible=False)
    for kind, (name, color, marker) in _DEFECT_MARKS.items():
        chosen = defects.of(kind)
        if not len(chosen):
            continue
        drawn = np.argsort(-np.abs(chosen.deviation), kind="stable")[:_MOST]
        label = f"{name}: {len(chosen)}" + (f", {_MOST} drawn" if len(chosen) > _MOST else "")
        size, edge = (3.0, 0.7) if len(drawn) > 400 else (5.0, 1.1)
        look: dict[str, Any] = {"color": color, "markerfacecolor": "none", "markersize": size, "markeredgewidth": edge}
        axes.plot(chosen.col[drawn], chosen.row[drawn], marker, label=label, **look)
    axes.set_xlim(-0.5, cols - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.set_xlabel("column")
    axes.set_ylabel("row")
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    if len(defects):
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.0, markerscale=1.3)
    else:
        axes.text(0.5, 0.5, "no defective pixels", transform=axes.transAxes, ha="center", va="center")
    return figure


FIGURE = EffectFigure("Defects", 10, _blocks)
