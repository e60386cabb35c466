"""How far the response is from a straight line, by both of EMVA 1288's definitions."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.calibration.photon_transfer.linearity import Linearity, LinearityFit
from photosite.report.figures.marks import channel_handles, draw_points
from photosite.report.style import BLACK, WIDTH_IN, channel_style, styled
from photosite.values.measured import COVERAGE_95


@styled()
def linearity_figure(linearity: Mapping[str, Linearity]) -> Figure:
    """Deviations of the light levels from the fitted lines, in percent.

    Parameters
    ----------
    linearity
        By channel, all against the same axis.

    Returns
    -------
    matplotlib.figure.Figure
        Above, relative to the line (releases 3.1 and 4.0); below, to the full scale (release 3.0). Bars are 95 %
        intervals; filled levels lie between 5 and 95 % of saturation and were fitted. Dotted lines mark the lowest and
        the highest deviation of those.

    Notes
    -----
    EMVA 1288 R4.0 Linear, the plot of deviations from linearity.
    """
    figure = Figure(figsize=(WIDTH_IN, 5.4))
    upper, lower = figure.subplots(2, 1, sharex=True)
    for position, (channel, found) in enumerate(linearity.items()):
        for axes, fit in ((upper, found.relative), (lower, found.full_scale)):
            _draw(axes, found, fit, channel, position)
    for axes in (upper, lower):
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
    upper.set_ylabel("deviation from the line (%)")
    lower.set_ylabel("deviation / full scale (%)")
    photons = next(iter(linearity.values())).abscissa == "photons_per_pixel"
    lower.set_xlabel("photons per pixel" if photons else "exposure (s)")
    hollow = not all(found.used.all() for found in linearity.values())
    handles = channel_handles(list(linearity), "fitted", "not fitted" if hollow else None, lines=False)
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    figure.align_ylabels([upper, lower])
    return figure


def _draw(axes: Axes, found: Linearity, fit: LinearityFit, channel: str, position: int) -> None:
    color, marker, _ = channel_style(channel, position)
    half = COVERAGE_95 * fit.deviation_uncertainty
    draw_points(axes, found.x, fit.deviation_percent, half, found.used, (color, marker), size=4.0)
    for limit in (fit.lowest.value, fit.highest.value):
        axes.axhline(limit, color=color, linewidth=0.8, linestyle=":")
    # What is not fitted may lie far off; the plot is about what is.
    inside = fit.deviation_percent[found.used]
    reach = max(1e-9, *(abs(inside) + half[found.used]))
    low, high = axes.get_ylim() if position else (0.0, 0.0)
    axes.set_ylim(min(low, -1.6 * reach), max(high, 1.6 * reach))
