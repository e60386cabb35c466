"""Figures 1 to 5 on the page: spectral sensitivity, pictures, patch means and noise, and colour differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from photosite.develop.pair import develop_pair
from photosite.report.figures.marks import channel_handles
from photosite.report.figures.sensor import draw_spectral_sensitivity
from photosite.report.figures.validation import FillStyle, draw_identity, draw_patch_means, draw_patch_snr
from photosite.report.page import Block, Column, Listing, Paragraph, Table
from photosite.report.pictures import magnified, shrink
from photosite.report.style import BLACK, GRAY, ORANGE, SKY, styled
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.patches import FORMULAS, CameraPatches, Patches, differences
from photosite.validation.result import Validation

_FILLS: tuple[FillStyle, ...] = ("full", "bottom", "none")
"""Marker fills from the brightest chart to the dimmest."""

_LARGEST_BAR_PERCENT = 3.0
_LARGEST_BAR_DB = 1.0
"""Differences with larger error bars are left out of the lower panels."""

_WIDEST, _WIDEST_DIFFERENCE = 262, 98
_MAGNIFICATION = 10.0
_BINS = 12

_Draw = Callable[[Axes, Axes, Validation, FillStyle, float], None]


def patches_part(chapter: Patches) -> Part:
    """Return figures 1 to 5 and their description in words."""
    return (
        sensitivity_drawing(chapter),
        pictures_drawing(chapter),
        Drawing.of(
            "figure3-patch-means",
            patch_means_figure(chapter),
            "Patch means of the virtual cameras against the simulation, all patches and channels",
            "Figure 3: means of the 24 patches above black on the raw mosaic, measured (virtual camera) against "
            "simulated with the fitted fill factor; the line is equality. Below: relative difference where it is known "
            f"to ±{_LARGEST_BAR_PERCENT:g} % or better. Bars are 95 % intervals from the noise of both frames; in the "
            f"upper panels most are smaller than the markers.{_below_black(chapter)}",
        ),
        Drawing.of(
            "figure4-patch-snr",
            patch_snr_figure(chapter),
            "Patch signal-to-noise ratios of the virtual cameras against the simulation, all patches and channels",
            "Figure 4: signal-to-noise ratio over the pixels of each patch (read noise, DSNU, PRNU and shot noise), "
            "measured (virtual camera) against simulated; the line is equality. Below: difference where it is known to "
            f"±{_LARGEST_BAR_DB:g} dB or better. Bars are 95 % intervals.",
        ),
        Listing(tuple(line for found in chapter.cameras.values() for line in _words(found))),
        *color_blocks(chapter),
    )


def _below_black(chapter: Patches) -> str:
    """Return a sentence on points that a logarithmic axis cannot show, if there are any."""
    every = [both for found in chapter.cameras.values() for both in found.comparisons.values()]
    count = sum(int((np.minimum(both.measured.mean_dn, both.simulated.mean_dn) <= 0).sum()) for both in every)
    return f" Not shown, because a mean is not above black: {count} points." if count else ""


def _words(found: CameraPatches) -> tuple[str, ...]:
    lines = []
    for level in _brightest_first(found):
        comparison = found.comparisons[level]
        means, noise = comparison.means, comparison.noise
        agree = "consistent" if noise.p_value >= 0.05 else "inconsistent"
        size = 100.0 * float(np.median(np.abs(np.ma.compressed(comparison.relative_difference[comparison.used]))))
        lines.append(
            f"{found.case.title}, {level:g} cd/m²: half of the means differ by less than {size:.2f} %. The lamp is "
            f"uneven, which the simulation does not know: chi-square of the means is {means.statistic:.0f}, against "
            f"{means.degrees_of_freedom} for noise alone. Noise: chi-square {noise.statistic:.0f} with "
            f"{noise.degrees_of_freedom} degrees of freedom, p = {noise.p_value:.2g}: {agree}."
        )
    return tuple(lines)


@styled()
def patch_means_figure(chapter: Patches) -> Figure:
    """Draw patch means and their relative differences (Figure 3)."""
    figure, panels = _panels(chapter, draw_patch_means, _LARGEST_BAR_PERCENT)
    for (upper, lower), found in zip(panels, chapter.cameras.values(), strict=True):
        upper.set(xscale="log", yscale="log")
        _square(upper, _positive(found))
        draw_identity(upper)
        lower.set_xlabel("patch mean above black, simulated (DN)")
    panels[0][0].set_ylabel("patch mean, virtual camera (DN)")
    panels[0][1].set_ylabel("difference (%)")
    return figure


@styled()
def patch_snr_figure(chapter: Patches) -> Figure:
    """Draw patch signal-to-noise ratios and their differences (Figure 4)."""
    figure, panels = _panels(chapter, draw_patch_snr, _LARGEST_BAR_DB)
    for upper, lower in panels:
        draw_identity(upper)
        lower.set_xlabel("patch SNR, simulated (dB)")
    panels[0][0].set_ylabel("patch SNR, virtual camera (dB)")
    panels[0][1].set_ylabel("difference (dB)")
    return figure


def _panels(chapter: Patches, draw: _Draw, largest_bar: float) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """Draw a column of two axes for each camera."""
    figure = Figure(figsize=(10.2, 6.4))
    grid = figure.subplots(2, 2, sharex="col", height_ratios=(2.4, 1.0))
    looks: dict[float, FillStyle] = {}
    for (upper, lower), found in zip(grid.T, chapter.cameras.values(), strict=True):
        levels = _brightest_first(found)
        for level, filled in zip(levels, _FILLS, strict=False):
            draw(upper, lower, found.comparisons[level], filled, largest_bar)
            looks.setdefault(level, filled)
        lower.axhline(0.0, color=BLACK, linewidth=0.8)
        upper.set_title(f"{found.case.title}, {', '.join(f'{level:g}' for level in levels)} cd/m²", loc="left")
    handles = [*channel_handles(list("RGB"), "", lines=False), *(_handle(*look) for look in looks.items())]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.align_ylabels()
    return figure, [(upper, lower) for upper, lower in grid.T]


def _handle(level: float, filled: FillStyle) -> Line2D:
    handle = Line2D([], [], color=GRAY, marker="o", linestyle="", fillstyle=filled, label=f"{level:g} cd/m²")
    handle.set_markerfacecoloralt("white")
    return handle


def _brightest_first(found: CameraPatches) -> list[float]:
    return sorted(found.comparisons, reverse=True)


def _positive(found: CameraPatches) -> tuple[float, float]:
    """Return the smallest and the largest mean above black."""
    means = np.concatenate(
        [side.mean_dn.ravel() for both in found.comparisons.values() for side in (both.measured, both.simulated)]
    )
    lit = means[means > 0]
    return float(lit.min()), float(lit.max())


def _square(axes: Axes, ends: tuple[float, float]) -> None:
    """Set the same range for both logarithmic axes, so that bars below black do not extend them."""
    low, high = ends
    axes.set(xlim=(low / 1.4, 1.4 * high), ylim=(low / 1.4, 1.4 * high))


def sensitivity_drawing(chapter: Patches) -> Drawing:
    """Return Figure 1 with the sources of its curves."""
    vendor = list(chapter.cameras.values())[-1]
    red = vendor.sensor.channels["R"]
    end_nm, end = red.wavelength_nm[-1], red.quantum_efficiency[-1]
    return Drawing.of(
        "figure1-spectral-sensitivity",
        sensitivity_figure(chapter),
        "Quantum efficiency against wavelength of the D200 and the vendor's sensor",
        "Figure 1: spectral sensitivity, lens and infrared filter included. These are not the curves of the paper, "
        "whose values were not published. The shape of the D200 was measured on another D200 (rawtoaces); its scale is "
        "an assumption. The vendor curves, which are confidential in the paper, are those of the example sensor of "
        f"ISETCam. Its table ends at {end_nm:g} nm, where red is still {100 * end:.1f} %; beyond, 0 is assumed.",
    )


@styled()
def sensitivity_figure(chapter: Patches) -> Figure:
    """Draw the spectral sensitivity of both sensors (Figure 1)."""
    figure = Figure(figsize=(10.2, 4.0))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, found in zip(panels, chapter.cameras.values(), strict=True):
        draw_spectral_sensitivity(axes, found.sensor)
        axes.set_title(found.case.title, loc="left")
    panels[1].set_ylabel("")
    handles = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend([handles[name] for name in "RGB"], list("RGB"), loc="outside upper center", ncols=3)
    return figure


def pictures_drawing(chapter: Patches) -> Drawing:
    """Return Figure 2."""
    return Drawing.of(
        "figure2-pictures",
        pictures_figure(chapter),
        "The colour chart by the virtual camera and by the simulation, and ten times their difference",
        "Figure 2: raw frames after bilinear demosaic, through the best matrix of the simulation to XYZ under D65 and "
        "display encoding, at one exposure. Measured is the virtual camera. Each pixel shown is the mean of a square. "
        f"Right: measured minus simulated, magnified {_MAGNIFICATION:g} times and averaged over larger squares, around "
        "gray, in display values: the uneven lamp, and noise in dark patches.",
    )


@styled()
def pictures_figure(chapter: Patches) -> Figure:
    """Draw pictures of the chart, a row for each camera (Figure 2)."""
    figure = Figure(figsize=(10.2, 5.0))
    panels = figure.subplots(2, 3)
    for row, found in zip(panels, chapter.cameras.values(), strict=True):
        titles = ("measured (virtual camera)", "simulated", f"difference × {_MAGNIFICATION:g}")
        for axes, picture, title in zip(row, _pictures(found), titles, strict=True):
            _show(axes, picture)
            axes.set_title(title, loc="left")
        row[0].set_ylabel(found.case.title)
    return figure


def _pictures(found: CameraPatches) -> tuple[NDArray[np.float32], ...]:
    # The matrix applies to values above black; `develop` sets the scale.
    pair = develop_pair(found.measured, found.simulated, found.colors.simulated)
    measured, simulated = (shrink(picture, _WIDEST_DIFFERENCE) for picture in pair)
    return *(shrink(picture, _WIDEST) for picture in pair), magnified(measured, simulated, _MAGNIFICATION)


def _show(axes: Axes, picture: NDArray[np.float32]) -> None:
    axes.imshow(np.rint(255.0 * picture).astype(np.uint8), interpolation="none")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)


def color_blocks(chapter: Patches) -> tuple[Block | Drawing, ...]:
    """Return Figure 5, its means, and a note on the fitted patches."""
    return (
        Drawing.of(
            "figure5-color-differences",
            colors_figure(chapter),
            "Histograms of colour differences by three formulas, fitted and left out, of both cameras",
            "Figure 5: differences between the colours of the chart under D65 and those from the best 3 × 3 matrix of "
            "camera RGB under tungsten light, 24 patches. Fitted: one matrix for all patches. Left out: each patch "
            "with a matrix fitted to the 23 others. Measured is the virtual camera. Means are of measured and of "
            "simulated.",
        ),
        _color_table(chapter),
        Paragraph(_color_words(chapter)),
    )


@styled()
def colors_figure(chapter: Patches) -> Figure:
    """Draw histograms of colour differences, a column for each formula (Figure 5)."""
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
    # Fitted and left-out patches share one axis range.
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


def _color_table(chapter: Patches) -> Table:
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


def _color_words(chapter: Patches) -> str:
    def gain(found: CameraPatches) -> float:
        fitted, left_out = (differences(found.colors.measured, "2000", each).mean() for each in (False, True))
        return 100.0 * float(left_out / fitted - 1.0)

    increase = " and ".join(f"{gain(found):.0f} % ({found.case.title})" for found in chapter.cameras.values())
    return (
        "Nine numbers fitted to 24 patches underestimate the error: for patches outside the fit, the mean CIEDE2000 "
        f"difference is larger by {increase}. The paper shows histograms of fitted patches; their values are not "
        "known, and they depend on spectral sensitivities that differ from those here. Measured and simulated can be "
        "compared: the last two columns, both with the matrix of the simulation, exposure included."
    )
