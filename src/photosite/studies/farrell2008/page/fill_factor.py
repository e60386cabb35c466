"""Section 3 on the page: the fitted fill factors, and the residuals of the patches."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from photosite.report.numbers import format_interval, format_number, format_uncertain
from photosite.report.page import Column, Listing, Paragraph, Table
from photosite.report.style import BLACK, channel_style, styled
from photosite.studies.farrell2008.cameras import FILL_FACTOR_BELOW, UNEVENNESS
from photosite.studies.farrell2008.fill_factor import CaseFit, FillFactors
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.validation.fill_factor import FillFactorFit
from photosite.values.measured import COVERAGE_95

_CHART = (4, 6)
"""Rows and columns of patches."""

_MAP_PERCENT = 2.0
"""Ends of the colour scale of the map."""

_LARGEST_BAR_PERCENT = 2.0
"""Residuals with larger error bars are not drawn by channel."""

TOO_LARGE = (
    "The standard error is too large here, because the simulation knows the mean light of the chart, over which the "
    "slope of the lamp cancels (photosite reproduce fill-factor gives the amount, over 100 seeds). In practice a meter "
    "reads the light at one place; the error of that reading dominates and is not part of the standard error."
)
"""Note on a distance in standard errors."""


def fill_factor_part(chapter: FillFactors) -> Part:
    """Return the table, the residuals, and the differences in words."""
    return (
        Paragraph(
            "The fill factor is the one value that the paper could not measure. It was chosen to minimize the squared "
            "difference between measured and simulated patch means, as here. The fit uses relative differences, "
            "because the differences are proportional to the light. Its standard error follows from the scatter of the "
            "patches, whose three channels share the same light. The simulation assumes an evenly lit chart with the "
            f"true mean light; the light of the virtual lamp varies by {100 * UNEVENNESS:g} %."
        ),
        _table(chapter),
        Drawing.of(
            "fill-factor-residuals",
            residuals_figure(chapter),
            "Residuals of the patches after the fit of the fill factor, over the chart and by channel",
            "Residuals of the fit, measured (virtual camera) over simulated, minus 1. Above: mean of the channels at "
            "the position of the patch on the chart. Below: each channel, patches along the rows of the chart. Bars "
            f"are 95 % intervals from noise alone; bars beyond ±{_LARGEST_BAR_PERCENT:g} % are not drawn: "
            f"{_hidden(chapter)}. The slope over the chart is the lamp, which the simulation does not know.",
        ),
        Listing(tuple(line for found in chapter.cameras.values() for line in _words(found))),
    )


def _table(chapter: FillFactors) -> Table:
    rows = []
    for found in chapter.cameras.values():
        for level, fit in sorted(found.fits.items(), reverse=True):
            low, high = fit.interval_95
            rows.append(
                (
                    found.case.title,
                    f"{level:g}",
                    f"{found.case.paper_fill_factor:g}",
                    format_number(found.true, 4),
                    format_uncertain(fit.value, fit.standard_error),
                    format_interval(low, high, fit.standard_error),
                    *(_channel(fit, name) for name in "RGB"),
                    f"{100 * fit.patch_scatter:.2f} %",
                )
            )
    columns = ("Paper", "Hidden", "Fitted", "95 % interval", "R alone", "G alone", "B alone", "Scatter of patches")
    return Table(
        "Fill factor; the result is that of the brightest chart, dimmer charts verify it",
        (Column("Camera"), Column("Chart, cd/m²", numeric=True), *(Column(name, numeric=True) for name in columns)),
        tuple(rows),
    )


def _channel(fit: FillFactorFit, name: str) -> str:
    found = fit.by_channel.get(name)
    return "–" if found is None else format_uncertain(found.value, found.standard_error)


def _known(fit: FillFactorFit) -> NDArray[np.bool_]:
    """Return (patches, channels) which residuals are drawn by channel."""
    half = 100.0 * COVERAGE_95 * fit.residual_noise
    return np.asarray(fit.used & (half.filled(np.inf) <= _LARGEST_BAR_PERCENT))


def _hidden(chapter: FillFactors) -> str:
    counts = [
        (found.case.title, int((found.fit.used & ~_known(found.fit)).sum())) for found in chapter.cameras.values()
    ]
    return " and ".join(f"{count} of 72 ({title})" for title, count in counts)


def _words(found: CaseFit) -> tuple[str, ...]:
    fit, title, paper = found.fit, found.case.title, found.case.paper_fill_factor
    within = "within" if abs(found.pull) <= 2.0 else "not within"
    chi = fit.chi_square
    return (
        f"{title}: the fit gives {format_uncertain(fit.value, fit.standard_error)}, {abs(found.pull):.1f} standard "
        f"errors from the hidden {format_number(found.true, 4)}, {within} two. {TOO_LARGE} The paper found {paper:g} "
        "for its camera, without an error. The difference from the paper is meaningless, because the hidden fill "
        f"factor was drawn from up to {FILL_FACTOR_BELOW:g} below that value.",
        f"{title}: noise alone does not explain the residuals (chi-square {chi.statistic:.0f} with "
        f"{chi.degrees_of_freedom} degrees of freedom). Patches scatter by {100 * fit.patch_scatter:.2f} %, which is "
        "the uneven light. Its mean over the chart is known, so that the errors of both sides cancel and the fit is "
        "closer to the truth than the scatter suggests.",
    )


@styled()
def residuals_figure(chapter: FillFactors) -> Figure:
    """Draw the residuals of each camera over the chart and by channel, at the brightest luminance."""
    figure = Figure(figsize=(10.2, 6.0))
    panels = figure.subplots(2, 2, height_ratios=(1.15, 1.0))
    panels[1, 1].sharey(panels[1, 0])
    for column, found in zip(panels.T, chapter.cameras.values(), strict=True):
        image = _draw_map(column[0], found.fit)
        column[0].set_title(f"{found.case.title}: fill factor {found.fit.value:.3f}", loc="left")
        _draw_channels(column[1], found.fit)
    bar = figure.colorbar(image, ax=panels[0].tolist(), extend="both", shrink=0.9)
    bar.set_label("residual, mean of channels (%)")
    panels[1, 0].set_ylabel("residual (%)")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    return figure


def _patch_residuals(fit: FillFactorFit) -> NDArray[np.float64]:
    """Return (patches,) noise-weighted means over the channels in percent; NaN where none is used."""
    weight = np.ma.filled(1.0 / fit.residual_noise**2, 0.0)
    total = weight.sum(axis=1)
    lit = total > 0
    mean = np.full(total.shape, np.nan)
    mean[lit] = 100.0 * (weight * fit.residuals.filled(0.0)).sum(axis=1)[lit] / total[lit]
    return mean


def _draw_map(axes: Axes, fit: FillFactorFit) -> AxesImage:
    percent = _patch_residuals(fit).reshape(_CHART)
    # Purple to orange is distinct for readers of every colour vision.
    image = axes.imshow(percent, cmap="PuOr_r", vmin=-_MAP_PERCENT, vmax=_MAP_PERCENT)
    for (row, col), value in np.ndenumerate(percent):
        if np.isfinite(value):
            red, green, blue, _ = image.to_rgba(np.array(value))
            dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.5
            text = f"{value:+.2f}".replace("-", "−")
            axes.text(col, row, text, ha="center", va="center", fontsize=9, color="white" if dark else BLACK)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)
    return image


def _draw_channels(axes: Axes, fit: FillFactorFit) -> None:
    patches = np.arange(1, len(fit.names) + 1)
    for shift, channel in enumerate("RGB"):
        k = fit.channels.index(channel)
        color, marker, _ = channel_style(channel)
        which = _known(fit)[:, k]
        axes.errorbar(
            patches[which] + 0.22 * (shift - 1),
            100.0 * fit.residuals[which, k],
            100.0 * COVERAGE_95 * fit.residual_noise[which, k],
            fmt=marker,
            color=color,
            markersize=4.0,
            elinewidth=0.9,
            label=channel,
        )
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set_xlim(0.3, len(patches) + 0.7)
    axes.set_xticks(range(1, len(patches) + 1, _CHART[1]))
    axes.set_xticks(patches, minor=True)
    axes.set_xlabel("patch, along the rows of the chart")
