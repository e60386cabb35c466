"""The scene of high dynamic range on the page."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.metrics.snr import noise_budget
from photosite.report.page import Paragraph
from photosite.report.style import BLUE, GRAY, VERMILION, new_figure, styled
from photosite.studies.farrell2008.high_dynamic_range import (
    SHADE,
    STEPS,
    WHITE_CD_M2,
    WHITE_SHARE,
    HdrShot,
    HighDynamicRange,
)
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.values.measured import COVERAGE_95

_LOOKS = (("o", "-", BLUE), ("s", "--", VERMILION))


def high_dynamic_range_part(chapter: HighDynamicRange) -> Part:
    """Return the pictures, the wedge with the noise budgets, and the dynamic ranges in words."""
    return (
        Paragraph(
            f"Two prints of the portrait in daylight, the right one in shade with 1/{1 / SHADE:g} of the light, above "
            f"a wedge of {STEPS} grays, each half as bright as the one before. White in the bright light has "
            f"{WHITE_CD_M2:g} cd/m². Each camera is exposed so that this white reaches {100 * WHITE_SHARE:g} % of its "
            "range. The scene of section 5 of the paper is not known; this one makes its numbers easy to check."
        ),
        Drawing.of(
            "section5-high-dynamic-range",
            hdr_figure(chapter),
            "Two portraits, one in bright light and one in shade, with both cameras, displayed at two brightnesses",
            "One frame of each camera, 360 × 512 pixels, shown twice: exposed for the bright light, and brightened "
            f"{1 / SHADE:g} times for the shade. Bilinear demosaic, gray world. Simulated with the sensors of Table 1.",
        ),
        Drawing.of(
            "section5-high-dynamic-range-wedge",
            wedge_figure(chapter),
            "Signal-to-noise ratio of the steps of the wedge against their light, for both cameras",
            "Steps of the wedge in the raw frames (green, 95 % intervals) and the noise budgets of the cameras. At 0 "
            "dB the signal equals its noise: the end of the dynamic range. Steps with a mean of less than three "
            "standard errors above black are not shown. Points are drawn at their light, diffraction from brighter "
            "parts included.",
        ),
        Paragraph(" ".join(_words(shot) for shot in chapter.shots)),
    )


@styled()
def hdr_figure(chapter: HighDynamicRange) -> Figure:
    """Draw the frame of each camera at two brightnesses."""
    figure = Figure(figsize=(8.6, 6.5))
    panels = figure.subplots(len(chapter.shots), 2)
    for line, shot in zip(panels, chapter.shots, strict=True):
        for axes, picture, what in (
            (line[0], shot.picture, "exposed for the bright light"),
            (line[1], shot.lifted, f"the same frame, {1 / SHADE:g} times brighter"),
        ):
            axes.imshow(picture, interpolation="none")
            axes.set_axis_off()
            axes.set_title(f"{shot.case.title}, {what}", loc="left")
    return figure


@styled()
def wedge_figure(chapter: HighDynamicRange) -> Figure:
    """Draw the steps of the wedge and the noise budgets."""
    figure, axes = new_figure(height_in=4.4)
    for shot, (marker, line, color) in zip(chapter.shots, _LOOKS, strict=True):
        wedge, sensor = shot.wedge, shot.sensor
        white_e = wedge.mean_e[0]
        light = np.geomspace(0.5**STEPS, 1.0, 200)
        volts = light * white_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
        axes.plot(
            light, noise_budget(sensor, volts).total_db, line, color=color, label=f"{shot.case.title}, noise budget"
        )
        pairs = zip(wedge.mean_e / white_e, wedge.snr_db, wedge.standard_error_db, strict=True)
        seen = [(x, snr_db, error_db) for x, snr_db, error_db in pairs if snr_db is not None and error_db is not None]
        x, snr_db, error_db = np.array(seen).T
        axes.errorbar(
            x,
            snr_db,
            COVERAGE_95 * error_db,
            fmt=marker,
            color=color,
            markerfacecolor="white",
            elinewidth=1.0,
            label=f"{shot.case.title}, frame",
        )
    axes.axhline(0.0, color=GRAY, linewidth=0.8)
    axes.axvline(SHADE, color=GRAY, linewidth=1.0, linestyle=":")
    axes.annotate(
        "white in the shade",
        (SHADE, 1.0),
        (-5, -4),
        ("data", "axes fraction"),
        "offset points",
        ha="right",
        va="top",
        color=GRAY,
        fontsize=9,
    )
    axes.set_xscale("log", base=2)
    axes.set(xlabel="light, relative to white in the bright light", ylabel="signal-to-noise ratio, green (dB)")
    axes.legend(loc="lower right")
    return figure


def _words(shot: HdrShot) -> str:
    stops = shot.dynamic_range_db / (20 * np.log10(2))
    in_shade = f"{shot.wedge.expected_db[round(-np.log2(SHADE))]:.1f}".replace("-", "−")
    return (
        f"{shot.case.title}: a dynamic range of {shot.dynamic_range_db:.1f} dB, {stops:.1f} stops, from saturation to "
        "the signal that equals its noise, fixed pattern included. In the noise budget "
        f"{shot.steps_above(0.0)} of the {STEPS} steps of the wedge exceed 0 dB, {shot.steps_above(20.0)} exceed 20 "
        f"dB. White in the shade has {in_shade} dB."
    )
