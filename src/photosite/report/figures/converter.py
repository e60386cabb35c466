"""Figure of the converter's differential and integral nonlinearity."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.converter_error import ConverterCodes
from photosite.report.style import BAND, BLACK, BLUE, styled, thinned, two_panels
from photosite.values.uncertain import COVERAGE_95


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
