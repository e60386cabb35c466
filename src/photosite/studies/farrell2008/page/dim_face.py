"""The dimly lit face on the page, and figures of portraits side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Column as TableColumn
from photosite.report.page import Paragraph, Table
from photosite.report.style import styled
from photosite.studies.farrell2008.dim_face import COLS, EXPOSURE_S, LUMINANCE_CD_M2, ROWS, DimFace, FaceShot
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.portrait import FACE, PORTRAIT_SOURCE, portrait


@dataclass(frozen=True, eq=False)
class Column:
    """A picture of a portrait figure.

    Parameters
    ----------
    title
        Text above the picture.
    picture
        (rows, cols, 3), display sRGB.
    note
        Text below the face.
    """

    title: str
    picture: NDArray[Any]
    note: str


@styled()
def portraits_figure(columns: Sequence[Column]) -> Figure:
    """Draw pictures of the portrait in a row, with the enlarged face below each.

    Parameters
    ----------
    columns
        From left to right; pictures of different sizes are drawn equally large.
    """
    figure = Figure(figsize=(8.6, 5.2))
    wholes, faces = figure.subplots(
        2, len(columns), height_ratios=(600 / 512, (FACE.r1 - FACE.r0) / (FACE.c1 - FACE.c0))
    )
    rows, cols = portrait().picture.shape[:2]
    for column, whole, face in zip(columns, wholes, faces, strict=True):
        height, width = column.picture.shape[:2]
        r0, r1 = (round(height * r / rows) for r in (FACE.r0, FACE.r1))
        c0, c1 = (round(width * c / cols) for c in (FACE.c0, FACE.c1))
        whole.imshow(column.picture, interpolation="none")
        face.imshow(column.picture[r0:r1, c0:c1], interpolation="none")
        whole.set_title(column.title)
        face.set_xlabel(column.note)
        for axes in (whole, face):
            axes.set(xticks=(), yticks=())
            axes.grid(visible=False)
            axes.spines[:].set_visible(False)
    return figure


def dim_face_part(chapter: DimFace) -> Part:
    """Return the pictures, the noise on the face, and a comparison with the paper."""
    columns = [Column("the print", portrait().picture, "no camera")]
    columns += [Column(_title(entry), entry.shot.picture, _note(entry)) for entry in chapter.shots]
    return (
        Paragraph(
            f"A portrait of {LUMINANCE_CD_M2:g} cd/m² on average under tungsten light, exposed for "
            f"{1e3 * EXPOSURE_S:g} ms, simulated with the sensors of Table 1 and white-balanced by gray world. That "
            "the luminance of the paper is a mean over the picture is an assumption; the face has "
            f"{chapter.face_luminance_cd_m2:.1f} cd/m². The portrait of the paper is not available. This one: "
            f"{PORTRAIT_SOURCE}"
        ),
        Drawing.of(
            "section5-dim-face",
            portraits_figure(columns),
            "A portrait and captures of it with three cameras in dim light, with the faces enlarged below",
            f"The dimly lit face, {ROWS} × {COLS} pixels of each chip, bilinear demosaic, gray world, no noise "
            "reduction. Every picture is scaled so that a white surface in this light is white. Each sensor has the "
            "lens of Table 1; the last picture gives the D200 the f-number of the vendor camera, and with it the same "
            "irradiance. The first picture is the print, the others are simulated.",
        ),
        _table(chapter),
        Paragraph(_words(chapter)),
    )


def _title(entry: FaceShot) -> str:
    return f"{entry.case.title}, f/{entry.case.f_number:g}"


def _note(entry: FaceShot) -> str:
    return f"green: {format_number(entry.shot.noise('G').snr_db, 3)} dB"


def _table(chapter: DimFace) -> Table:
    rows = []
    for entry in chapter.shots:
        for channel in "RGB":
            noise = entry.shot.noise(channel)
            rows.append(
                (
                    _title(entry) if channel == "R" else "",
                    channel,
                    format_number(noise.mean_e, 3),
                    format_uncertain(noise.snr_db, noise.standard_error_db),
                    f"{noise.expected_db:.2f}".replace("-", "−"),
                )
            )
    return Table(
        "Signal-to-noise ratio on the face, raw mosaic",
        (
            TableColumn("Camera"),
            TableColumn("Channel"),
            TableColumn("Mean signal, e⁻", numeric=True),
            TableColumn("SNR of the frame, dB", numeric=True),
            TableColumn("SNR from the noise model, dB", numeric=True),
        ),
        tuple(rows),
    )


def _words(chapter: DimFace) -> str:
    limited = [_title(entry) for entry in chapter.shots if entry.read_dsnu_dominate_on_the_face]
    free = [_title(entry) for entry in chapter.shots if not entry.read_dsnu_dominate_on_the_face]
    vendor, d200 = chapter.shots[:2]
    more_db = d200.shot.noise("G").snr_db - vendor.shot.noise("G").snr_db
    light = (vendor.case.f_number / d200.case.f_number) ** 2
    area = d200.shot.camera.sensor.pixel_area_m2 / vendor.shot.camera.sensor.pixel_area_m2
    noise = _floor_e(d200) / _floor_e(vendor)
    text = (
        f"Read noise and DSNU exceed shot noise and PRNU at the green signal of the face with {' and '.join(limited)}"
    )
    text += f", but not with {' and '.join(free)}. " if free else ". "
    return text + (
        f"The green channel of the D200 has {more_db:.0f} dB more than that of the vendor sensor, although its lens "
        f"passes {light:.2f} of the light: its pixel has {area:.1f} times the area, and {noise:.2f} of the read noise "
        "and DSNU in electrons. The paper shows the same two sensors; the f-number of its D200 for the face and its "
        "values are not known."
    )


def _floor_e(entry: FaceShot) -> float:
    """Return read noise and DSNU combined."""
    sensor = entry.shot.camera.sensor
    return float(
        np.hypot(sensor.electrons(sensor.noise.read_noise_mv.value), sensor.electrons(sensor.noise.dsnu_mv.value))
    )
