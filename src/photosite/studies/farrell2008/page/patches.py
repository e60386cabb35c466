"""Figures 3 and 4: means and signal-to-noise ratios of the patches, measured against simulated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from photosite.report.figures.marks import channel_handles
from photosite.report.figures.validation import FillStyle, draw_identity, draw_patch_means, draw_patch_snr
from photosite.report.page import Listing
from photosite.report.style import BLACK, GRAY, styled
from photosite.studies.farrell2008.page.chart_pictures import pictures_drawing
from photosite.studies.farrell2008.page.colors import color_blocks
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.page.sensitivity import sensitivity_drawing
from photosite.studies.farrell2008.patches import CameraPatches, Patches
from photosite.validation.result import Validation

_FILLS: tuple[FillStyle, ...] = ("full", "bottom", "none")
"""From the brightest chart to the dimmest."""

_LARGEST_BAR_PERCENT = 3.0
_LARGEST_BAR_DB = 1.0
"""Differences that are known less well than this are left out of the lower panels; they would hide the others."""

_Draw = Callable[[Axes, Axes, Validation, FillStyle, float], None]


def patches_part(chapter: Patches) -> Part:
    """Figures 1 to 5, and what they say in words."""
    return (
        sensitivity_drawing(chapter),
        pictures_drawing(chapter),
        Drawing.of(
            "figure3-patch-means",
            patch_means_figure(chapter),
            "Patch means of the virtual cameras against the simulation, all patches and channels",
            "Figure 3: means of the 24 patches above black, on the raw mosaic, measured (virtual camera) against "
            "simulated with the fitted fill factor; the line is equality. Below: the relative difference, of the "
            f"points that are known to ±{_LARGEST_BAR_PERCENT:g} % or better. Bars are 95 % intervals from noise of "
            f"both frames; in the upper panels most are smaller than the marks.{_below_black(chapter)}",
        ),
        Drawing.of(
            "figure4-patch-snr",
            patch_snr_figure(chapter),
            "Patch signal-to-noise ratios of the virtual cameras against the simulation, all patches and channels",
            "Figure 4: signal-to-noise ratio over the pixels of each patch, read noise, DSNU, PRNU and shot noise "
            "together, measured (virtual camera) against simulated; the line is equality. Below: their difference, "
            f"of the points that are known to ±{_LARGEST_BAR_DB:g} dB or better. Bars are 95 % intervals.",
        ),
        Listing(tuple(line for found in chapter.cameras.values() for line in _words(found))),
        *color_blocks(chapter),
    )


def _below_black(chapter: Patches) -> str:
    """Which points a logarithmic axis cannot show, as a sentence; nothing where there are none."""
    every = [both for found in chapter.cameras.values() for both in found.comparisons.values()]
    count = sum(int((np.minimum(both.measured.mean_dn, both.simulated.mean_dn) <= 0).sum()) for both in every)
    return f" Not shown, since a mean is not above black: {count} of the points." if count else ""


def _words(found: CameraPatches) -> tuple[str, ...]:
    lines = []
    for level in _brightest_first(found):
        comparison = found.comparisons[level]
        means, noise = comparison.means, comparison.noise
        agree = "as alike as their errors allow" if noise.p_value >= 0.05 else "further apart than their errors allow"
        size = 100.0 * float(np.median(np.abs(np.ma.compressed(comparison.relative_difference[comparison.used]))))
        lines.append(
            f"{found.case.title}, {level:g} cd/m²: half of the means differ by less than {size:.2f} %; with the lamp "
            f"uneven and the simulation not told of it, chi-square of the means is {means.statistic:.0f} where "
            f"{means.degrees_of_freedom} would be noise alone. Noise: chi-square {noise.statistic:.0f} with "
            f"{noise.degrees_of_freedom} degrees of freedom, p = {noise.p_value:.2g}: {agree}."
        )
    return tuple(lines)


@styled()
def patch_means_figure(chapter: Patches) -> Figure:
    """Means, and their relative differences below.

    Parameters
    ----------
    chapter
        What `compare_charts` gave.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 3.
    """
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
    """Signal-to-noise ratios, and their differences below.

    Parameters
    ----------
    chapter
        What `compare_charts` gave.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 4.
    """
    figure, panels = _panels(chapter, draw_patch_snr, _LARGEST_BAR_DB)
    for upper, lower in panels:
        draw_identity(upper)
        lower.set_xlabel("patch SNR, simulated (dB)")
    panels[0][0].set_ylabel("patch SNR, virtual camera (dB)")
    panels[0][1].set_ylabel("difference (dB)")
    return figure


def _panels(chapter: Patches, draw: _Draw, largest_bar: float) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """A column of two axes for each camera, drawn, titled and with a legend outside."""
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
    """The smallest and the largest mean that a logarithmic axis can show."""
    means = np.concatenate(
        [side.mean_dn.ravel() for both in found.comparisons.values() for side in (both.measured, both.simulated)]
    )
    lit = means[means > 0]
    return float(lit.min()), float(lit.max())


def _square(axes: Axes, ends: tuple[float, float]) -> None:
    """The same range along both logarithmic axes: bars that reach below black do not stretch them."""
    low, high = ends
    axes.set(xlim=(low / 1.4, 1.4 * high), ylim=(low / 1.4, 1.4 * high))
