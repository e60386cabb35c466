"""The dimly lit face on the page."""

from __future__ import annotations

import numpy as np

from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Column as TableColumn
from photosite.report.page import Paragraph, Table
from photosite.studies.farrell2008.dim_face import COLS, EXPOSURE_S, LUMINANCE_CD_M2, ROWS, DimFace, FaceShot
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.page.portraits import Column, portraits_figure
from photosite.studies.farrell2008.portrait import PORTRAIT_SOURCE, portrait


def dim_face_part(chapter: DimFace) -> Part:
    """The pictures, the noise on the face in numbers, and what is not known of the paper's."""
    columns = [Column("the print, no camera", portrait().picture, "as raised to spectra")]
    columns += [Column(_title(entry), entry.shot.picture, _note(entry)) for entry in chapter.shots]
    return (
        Paragraph(
            f"A portrait of {LUMINANCE_CD_M2:g} cd/m² on average under tungsten light, exposed for "
            f"{1e3 * EXPOSURE_S:g} ms, simulated with the sensors of Table 1 and balanced by gray world. That the "
            "paper’s luminance is a mean over the picture is an assumption: the face itself has "
            f"{chapter.face_luminance_cd_m2:.1f} cd/m². The paper’s portrait is not at hand; this one: "
            f"{PORTRAIT_SOURCE}"
        ),
        Drawing.of(
            "section5-dim-face",
            portraits_figure(columns),
            "A portrait as it is and under three cameras in dim light, with the faces enlarged below",
            f"The dimly lit face, {ROWS} × {COLS} pixels of each chip, bilinear demosaic, gray world, no noise "
            "reduction. Every picture is brightened so that a white surface in this light is white. Each sensor has "
            "the lens of Table 1; the last picture gives the D200 the vendor’s f-number, and with it the same light on "
            "each square millimetre. The first picture is the print, the others are simulated; none is measured.",
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
            TableColumn("SNR by the noise model, dB", numeric=True),
        ),
        tuple(rows),
    )


def _words(chapter: DimFace) -> str:
    ruled = [_title(entry) for entry in chapter.shots if entry.read_dsnu_rule_on_the_face]
    free = [_title(entry) for entry in chapter.shots if not entry.read_dsnu_rule_on_the_face]
    vendor, told = chapter.shots[:2]
    more_db = told.shot.noise("G").snr_db - vendor.shot.noise("G").snr_db
    light = (vendor.case.f_number / told.case.f_number) ** 2
    area = told.shot.camera.sensor.pixel_area_m2 / vendor.shot.camera.sensor.pixel_area_m2
    noise = _floor_e(told) / _floor_e(vendor)
    said = f"Read noise and DSNU are more than shot noise and PRNU on the face’s green under {_listed(ruled)}"
    said += f", and less under {_listed(free)}. " if free else ". "
    return said + (
        f"The D200’s green has {more_db:.0f} dB more than the vendor’s although its lens passes {light:.2f} of the "
        f"light: its pixel has {area:.1f} times the area, and {noise:.2f} of the read noise and DSNU in electrons. The "
        "paper shows the same two sensors; which opening its D200 had for the face, and its numbers on it, are not "
        "known here."
    )


def _floor_e(entry: FaceShot) -> float:
    """Read noise and DSNU together."""
    sensor = entry.shot.camera.sensor
    return float(
        np.hypot(sensor.electrons(sensor.noise.read_noise_mv.value), sensor.electrons(sensor.noise.dsnu_mv.value))
    )


def _listed(names: list[str]) -> str:
    return " and ".join(names)
