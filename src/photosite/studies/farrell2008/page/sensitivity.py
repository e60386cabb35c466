"""Figure 1: spectral sensitivity of both sensors."""

from __future__ import annotations

from matplotlib.figure import Figure

from photosite.report.figures.sensor import draw_spectral_sensitivity
from photosite.report.style import styled
from photosite.studies.farrell2008.page.drawing import Drawing
from photosite.studies.farrell2008.patches import Patches


def sensitivity_drawing(chapter: Patches) -> Drawing:
    """Figure 1, and where its curves come from and where they end."""
    vendor = list(chapter.cameras.values())[-1]
    red = vendor.sensor.channels["R"]
    end_nm, end = red.wavelength_nm[-1], red.quantum_efficiency[-1]
    return Drawing.of(
        "figure1-spectral-sensitivity",
        sensitivity_figure(chapter),
        "Quantum efficiency against wavelength of the D200 and the vendor's sensor",
        "Figure 1: spectral sensitivity, lens and infrared filter included. Not the paper’s curves: their numbers were "
        "not published. The D200’s shape is a measurement of another D200 (rawtoaces), its scale an assumption; the "
        "vendor’s curves, which the paper keeps confidential, are those of ISETCam’s example sensor. Its table ends "
        f"at {end_nm:g} nm, where its red still stands at {100 * end:.1f} %: what lies beyond is not "
        "known, and none is assumed.",
    )


@styled()
def sensitivity_figure(chapter: Patches) -> Figure:
    """Both sensors side by side.

    Parameters
    ----------
    chapter
        What `compare_charts` gave.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 1.
    """
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
