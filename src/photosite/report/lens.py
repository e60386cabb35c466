"""Page of a traced lens: layout, spots, MTF, distortion, illumination."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from photosite.optics.lens_design import LensDesign
from photosite.optics.trace import TracedLens
from photosite.report.page import Column, Page, Paragraph, Section, Table, figure_block, numeric
from photosite.report.style import GRAY, legend_above, line_style, new_figure, styled, two_panels


def lens_page(traced: TracedLens) -> Page:
    """Return the page of a traced lens."""
    base = traced.lens.base
    waves = ", ".join(f"{wavelength:g}" for wavelength in traced.wavelength_nm)
    lead = (
        f"Focal length {base.focal_length_mm:.4g} mm, f/{base.f_number:.3g}; wavelengths {waves} nm; objects far away."
    )
    source = f"Rays of rayoptics through {traced.prescription.path.name}."
    return Page(
        f"Lens {traced.lens.name or traced.prescription.path.stem}",
        lead,
        (
            Section(
                "Layout",
                (
                    figure_block(
                        _layout(traced), "section of the lens with rays", "Surfaces, and rays of three field angles."
                    ),
                ),
            ),
            Section(
                "Spots",
                (
                    figure_block(
                        _spots(traced),
                        "spot diagrams",
                        "Where rays land about the chief ray of the reference wavelength; a color for each wavelength.",
                    ),
                ),
            ),
            Section(
                "MTF",
                (
                    figure_block(
                        _mtf(traced),
                        "modulation transfer function",
                        "MTF at the reference wavelength: tangential (lines), sagittal (dashes).",
                    ),
                ),
            ),
            Section(
                "Field",
                (
                    figure_block(
                        _field(traced),
                        "distortion and illumination",
                        "Distortion, relative to f tan(angle), and relative illumination.",
                    ),
                    _table(traced),
                ),
            ),
        ),
        source,
    )


@styled()
def _layout(traced: TracedLens) -> Figure:
    figure, axes = new_figure(3.6)
    for section in traced.surfaces:
        axes.plot(*section.T, color=GRAY)
    for position, rays in enumerate(traced.paths):
        for ray in rays:
            axes.plot(*ray.T, color=line_style(position)[0], linewidth=0.7)
    axes.set(xlabel="along the axis (mm)", ylabel="height (mm)", aspect="equal")
    return figure


@styled()
def _spots(traced: TracedLens) -> Figure:
    figure, axes = new_figure(2.4)
    count = len(traced.field_deg)
    points = [[(b.landing[b.even] - row[traced.reference].chief) * 1e3 for b in row] for row in traced.bundles]
    step = 2.4 * max(float(np.abs(p).max()) for row in points for p in row)
    for place, row in enumerate(points):
        for position, spot in enumerate(row):
            x, color = spot[:, 0] + place * step, line_style(position)[0]
            axes.plot(x, spot[:, 1], ".", color=color, markersize=1.5, alpha=0.6)
    axes.set(xlabel="field angle (degrees)", ylabel="from the chief ray (µm)", aspect="equal")
    waves = [
        Line2D(
            [], [], marker="o", linestyle="", markersize=4, color=line_style(position)[0], label=f"{wavelength:g} nm"
        )
        for position, wavelength in enumerate(traced.wavelength_nm)
    ]
    legend_above(figure, waves)
    axes.set_xticks([place * step for place in range(count)], [f"{angle:.3g}" for angle in traced.field_deg])
    return figure


def mtf_of(traced: TracedLens, field: int, wavelength: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frequencies per mm, and the tangential and sagittal MTF of a field point and wavelength."""
    blur = traced.lens.blur
    assert isinstance(blur, LensDesign)
    psf = blur.psf[field, wavelength]
    frequency = np.fft.rfftfreq(psf.shape[0], blur.spacing_um * 1e-3)
    tangential, sagittal = (np.abs(np.fft.rfft(psf.sum(axis=axis))) for axis in (1, 0))
    return frequency, tangential, sagittal


@styled()
def _mtf(traced: TracedLens) -> Figure:
    figure, axes = new_figure(3.6)
    cutoff = 1e6 / (traced.wavelength_nm[traced.reference] * traced.lens.base.f_number)
    for position, angle in enumerate(traced.field_deg):
        frequency, tangential, sagittal = mtf_of(traced, position, traced.reference)
        shown, color = frequency <= cutoff, line_style(position)[0]
        axes.plot(frequency[shown], tangential[shown], "-", color=color, label=f"{angle:.3g} degrees")
        axes.plot(frequency[shown], sagittal[shown], "--", color=color)
    axes.set(xlabel="cycles per mm", ylabel="MTF", ylim=(0, 1), xlim=(0, cutoff))
    axes.legend()
    return figure


@styled()
def _field(traced: TracedLens) -> Figure:
    figure, upper, lower = two_panels(4.4)
    color, illumination = line_style(0)[0], traced.lens.illumination
    upper.plot(traced.field_deg, traced.distortion_percent, "o-", color=color, markersize=3)
    if illumination is not None:
        lower.plot(traced.field_deg, 100 * illumination.relative, "o-", color=color, markersize=3)
    upper.set(ylabel="distortion (%)")
    lower.set(xlabel="field angle (degrees)", ylabel="illumination (%)", ylim=(0, 105))
    return figure


def _table(traced: TracedLens) -> Table | Paragraph:
    illumination = traced.lens.illumination
    if illumination is None:
        return Paragraph("The file has the axis only.")
    color = traced.lens.lateral_color
    shifts = np.zeros((1, len(traced.field_deg))) if color is None else color.shift_um
    rows = tuple(
        (
            f"{angle:.4g}",
            f"{np.hypot(*row[traced.reference].chief):.5g}",
            "" if np.isnan(distortion) else f"{distortion:.3g}",
            f"{100 * illumination.relative[k]:.4g}",
            f"{np.ptp(shifts[:, k]):.3g}",
            f"{row[traced.reference].spot_radius_mm * 1e3:.4g}",
        )
        for k, (angle, distortion, row) in enumerate(
            zip(traced.field_deg, traced.distortion_percent, traced.bundles, strict=True)
        )
    )
    heads = ("image height, mm", "distortion, %", "illumination, %", "lateral color, µm", "RMS spot, µm")
    return Table("Over the field", (Column("field angle, degrees"), *map(numeric, heads)), rows)
