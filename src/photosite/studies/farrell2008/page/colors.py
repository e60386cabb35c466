"""Figure 5: how well the best 3 x 3 matrix finds the chart's colours, for patches it was fitted to and for others."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from photosite.report.page import Block, Column, Paragraph, Table
from photosite.report.style import BLACK, ORANGE, SKY, styled
from photosite.studies.farrell2008.page.drawing import Drawing
from photosite.studies.farrell2008.patches import FORMULAS, CameraPatches, Patches, differences

_BINS = 12


def color_blocks(chapter: Patches) -> tuple[Block | Drawing, ...]:
    """Figure 5, its means, and what flatters."""
    return (
        Drawing.of(
            "figure5-color-differences",
            colors_figure(chapter),
            "Histograms of colour differences by three formulas, fitted and left out, of both cameras",
            "Figure 5: differences between the chart’s colours under D65 and what the best 3 × 3 matrix makes of "
            "camera RGB under tungsten light, 24 patches. Fitted: one matrix for all. Left out: each patch by a matrix "
            "fitted to the 23 others. Measured is the virtual camera. Means are of measured and of simulated.",
        ),
        _table(chapter),
        Paragraph(_words(chapter)),
    )


@styled()
def colors_figure(chapter: Patches) -> Figure:
    """A row for each camera and way to count, a column for each formula.

    Parameters
    ----------
    chapter
        What `compare_charts` gave.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 5.
    """
    rows = [(found, left_out) for found in chapter.cameras.values() for left_out in (False, True)]
    figure = Figure(figsize=(10.2, 8.4))
    panels = figure.subplots(len(rows), len(FORMULAS), sharey="row", squeeze=False)
    for line, (found, left_out) in zip(panels, rows, strict=True):
        for axes, formula in zip(line, FORMULAS, strict=True):
            _draw_histograms(axes, found, formula, left_out)
        line[0].set_ylabel("patches")
        line[0].set_title(f"{found.case.title}, {'left out' if left_out else 'fitted'}", loc="left")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    return figure


def _draw_histograms(axes: Axes, found: CameraPatches, formula: str, left_out: bool) -> None:
    sides = _sides(found, formula, left_out)
    # One axis for what was fitted and what was left out, so that the two can be compared.
    top = float(
        np.ceil(max(values.max() for each in (False, True) for values in _sides(found, formula, each).values()))
    )
    edges = np.linspace(0.0, top, _BINS + 1)
    colors = {"measured (virtual camera)": SKY, "simulated": ORANGE}
    axes.hist(
        list(sides.values()),
        edges.tolist(),
        color=[colors[name] for name in sides],
        label=list(sides),
        edgecolor=BLACK,
        linewidth=0.5,
    )
    means = " and ".join(f"{values.mean():.2f}" for values in sides.values())
    axes.set_xlabel(f"ΔE, {FORMULAS[formula]}; means {means}")
    axes.set_xlim(0.0, top)
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _sides(found: CameraPatches, formula: str, left_out: bool) -> dict[str, NDArray[np.float64]]:
    return {
        "measured (virtual camera)": differences(found.colors.measured, formula, left_out),
        "simulated": differences(found.colors.simulated, formula, left_out),
    }


def _table(chapter: Patches) -> Table:
    rows = []
    for found in chapter.cameras.values():
        colors = found.colors
        for key, formula in FORMULAS.items():
            between = getattr(colors.between, f"delta_e_{key}")
            means = [
                f"{differences(matrix, key, left_out).mean():.2f}"
                for left_out in (False, True)
                for matrix in (colors.measured, colors.simulated)
            ]
            rows.append((found.case.title, formula, *means, f"{between.mean():.2f}", f"{between.max():.2f}"))
    return Table(
        "Mean colour difference of the patches",
        (
            Column("Camera"),
            Column("Formula"),
            Column("Measured, fitted", numeric=True),
            Column("Simulated, fitted", numeric=True),
            Column("Measured, left out", numeric=True),
            Column("Simulated, left out", numeric=True),
            Column("Measured to simulated", numeric=True),
            Column("Largest", numeric=True),
        ),
        tuple(rows),
    )


def _words(chapter: Patches) -> str:
    def gain(found: CameraPatches) -> float:
        fitted, left_out = (differences(found.colors.measured, "2000", each).mean() for each in (False, True))
        return 100.0 * float(left_out / fitted - 1.0)

    flattery = " and ".join(f"{gain(found):.0f} % ({found.case.title})" for found in chapter.cameras.values())
    return (
        "Nine numbers fitted to 24 patches flatter: by patches that the matrix has not seen, the mean CIEDE2000 "
        f"difference is larger by {flattery}. The paper shows histograms of fitted patches; their numbers are not "
        "known here, and they hang on spectral sensitivities that are others than here. What can be compared is "
        "measured with simulated: the last two columns, both through the simulation’s matrix, exposure included."
    )
