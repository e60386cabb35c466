"""The converter in the report: differential and integral nonlinearity of its codes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.converter_error import ConverterCodes
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, Subheading, Table, columns, figure_block, numeric, reason_block
from photosite.report.style import BAND, BLACK, BLUE, styled, thinned, two_panels
from photosite.report.tables import format_estimate, interval_text
from photosite.values.uncertain import COVERAGE_95, Missing


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the nonlinearity of the converter, with a figure where it is beyond chance."""
    found, heading = calibration.converter, Subheading("Converter")
    if isinstance(found, Missing):
        return heading, reason_block(found.reason)
    entries = {"Differential nonlinearity": found.dnl_rms_lsb, "Integral nonlinearity": found.inl_rms_lsb}
    rows = tuple((label, format_estimate(entry), "LSB", interval_text(entry)) for label, entry in entries.items())
    judged = "beyond chance" if found.significant else "none beyond chance"
    title = f"Errors of {len(found.code)} codes, without deviations wider than about {found.smooth_codes} codes"
    table = Table(f"{title}: {judged}", columns("Quantity", numeric("Value"), "Unit", "95 % interval"), rows)
    if not found.significant:
        return heading, table
    figure = figure_block(
        converter_figure(found),
        "Differential and integral nonlinearity of the converter against the code",
        "Errors of the converter from the code density of the flat fields. Above: width of each code less 1. Below: "
        "error of the code, from the sum of the widths. Bands: where 95 % of the values of an ideal converter lie. "
        f"Errors wider than about {found.smooth_codes} codes cannot be distinguished from the density of the light: "
        "they are missing.",
    )
    return heading, figure, table


@styled()
def converter_figure(found: ConverterCodes) -> Figure:
    """Draw the errors of the codes with the 95 % bands of an ideal converter: widths above, errors below."""
    figure, upper, lower = two_panels(height_in=4.6)
    code = found.code.astype(np.float64)
    errors = (found.dnl_lsb, found.dnl_uncertainty_lsb), (found.inl_lsb, found.inl_uncertainty_lsb)
    gaps = np.flatnonzero(np.diff(found.code) > 1) + 1
    for axes, (error, uncertainty) in zip((upper, lower), errors, strict=True):
        half = COVERAGE_95 * uncertainty
        for part in np.split(np.arange(len(code)), gaps):
            axes.plot(*thinned(code[part], error[part]), color=BLUE, linewidth=0.8)
            axes.fill_between(code[part], -half[part], half[part], color=BLUE, alpha=BAND, linewidth=0)
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
    upper.set_ylabel("DNL (LSB)")
    lower.set(xlabel="code (DN)", ylabel="INL (LSB)")
    figure.align_ylabels()
    return figure


FIGURE = EffectFigure("Linearity", 10, _blocks)
