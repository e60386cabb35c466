"""The page of the study, and its files: page, numbers, figures."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from photosite.report.numbers import format_number, format_time, format_uncertain
from photosite.report.page import Block, Column, Notice, Page, Section, Table
from photosite.report.write import write_report
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.studies.farrell2008.cameras import CASES, ILLUMINANT, HiddenTruth
from photosite.studies.farrell2008.page.dim_face import dim_face_part
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.page.fill_factor import fill_factor_part
from photosite.studies.farrell2008.page.high_dynamic_range import high_dynamic_range_part
from photosite.studies.farrell2008.page.patches import patches_part
from photosite.studies.farrell2008.page.pixel_size import pixel_size_part
from photosite.studies.farrell2008.page.snr import snr_part
from photosite.studies.farrell2008.page.summary import summary_table
from photosite.studies.farrell2008.page.table1 import table1_part
from photosite.studies.farrell2008.study import CHAPTERS, Reproduction
from photosite.values.measured import Measured

PAGE_NAME, RESULTS_NAME, FIGURES_NAME = "farrell2008.html", "results.json", "figures"

PARTS: dict[str, Callable[[Any], Part]] = {
    "table1": table1_part,
    "fill_factor": fill_factor_part,
    "patches": patches_part,
    "snr": snr_part,
    "pixel_size": pixel_size_part,
    "dim_face": dim_face_part,
    "high_dynamic_range": high_dynamic_range_part,
}
"""Drawing of each chapter in `studies.farrell2008.study.CHAPTERS`, by key."""

_LEAD = (
    "The experiments of J. Farrell, M. Okincha and M. Parmar, “Sensor calibration and simulation”, Proc. SPIE 6817 "
    "(2008): each result with the value in the paper, and the differences in words."
)
_NOTICE = (
    "The paper’s frames were never published. All measured values on this page come from a virtual camera. It has the "
    "sensor of Table 1 and hidden properties that the simulation does not know: a lens slightly out of focus, a lamp "
    "that lights the chart unevenly, a different fill factor, and another chip of the same design."
)
_FOOTER = "Values are estimate ± one standard uncertainty (GUM) unless stated otherwise."


def study_parts(study: Reproduction) -> dict[str, Part]:
    """Return the drawn parts of the chapters that were run."""
    return {key: PARTS[key](result) for key, result in study.results.items()}


def study_page(study: Reproduction, parts: Mapping[str, Part]) -> Page:
    """Return the page of the study from its drawn parts."""
    titles = {chapter.key: chapter.title for chapter in CHAPTERS}
    sections = [Section("Method", (Notice(_NOTICE), _conditions(), _truth_table(study.seed)))]
    sections.append(Section("Summary", (summary_table(study),)))
    sections += [Section(titles[key], tuple(_block(entry) for entry in part)) for key, part in parts.items()]
    return Page("Sensor calibration and simulation, reproduced", _LEAD, sections, _FOOTER)


def _block(entry: Block | Drawing) -> Block:
    return entry.block if isinstance(entry, Drawing) else entry


def _conditions() -> Table:
    sensors = [case.sensor() for case in CASES]

    def row(what: str, *cells: str) -> tuple[str, ...]:
        return what, *cells

    return Table(
        "Conditions that measured and simulated cameras share",
        (Column(""), *(Column(case.title) for case in CASES)),
        (
            row("Pixel", *(f"{sensor.pixel.width_um.value:g} µm" for sensor in sensors)),
            row("Voltage swing", *(_stated(sensor.pixel.voltage_swing_v, "V") for sensor in sensors)),
            row("Well capacity", *(_stated(sensor.pixel.well_capacity_e, "e⁻") for sensor in sensors)),
            row("Lens", *(f"f/{case.f_number:g}, {case.focal_length_mm:g} mm" for case in CASES)),
            row("Exposure of the chart", *(format_time(case.exposure_s) for case in CASES)),
            row(
                "Chart",
                *(
                    f"ColorChecker at {DEFAULT_DISTANCE_M:g} m, tungsten light (CIE {ILLUMINANT}), "
                    f"{', '.join(f'{level:g}' for level in case.luminances_cd_m2)} cd/m² on average over its patches"
                    for case in CASES
                ),
            ),
            row("Frames of the chart", *(f"{case.chart_rows} × {case.chart_cols} pixels" for case in CASES)),
        ),
    )


def _stated(value: Measured, unit: str) -> str:
    return f"{format_uncertain(value.value, 0.0)} {unit}" + (" (assumed; confidential)" if value.assumed else "")


def _truth_table(seed: int) -> Table:
    truths = [HiddenTruth.drawn(case, seed) for case in CASES]

    def row(what: str, known: str, real: Callable[[HiddenTruth], str]) -> tuple[str, ...]:
        return what, known, *(real(truth) for truth in truths)

    return Table(
        f"Properties of the simulation and of the virtual cameras (seed {seed})",
        (Column(""), Column("Simulation"), *(Column(f"{case.title}, measured") for case in CASES)),
        (
            row("Fill factor", "fitted", lambda truth: format_number(truth.fill_factor, 4)),
            row(
                "Lens",
                "diffraction-limited",
                lambda truth: f"out of focus by {truth.wavefront_error_waves:g} waves RMS at 550 nm",
            ),
            row(
                "Light on the chart",
                "even, same mean",
                lambda truth: (
                    f"uneven by {100 * truth.unevenness:g} %, brightest towards {truth.lamp_angle_deg:.0f}° (0° is "
                    "right, 90° down)"
                ),
            ),
            row("Chip", "another chip of the design", lambda truth: truth.serial),
        ),
    )


def write_study(study: Reproduction, folder: Path) -> None:
    """Write the page, results.json, and the figures as SVG and PNG to an existing folder.

    The same study gives the same bytes, except for `seconds` in results.json.

    Raises
    ------
    FileError
        If a file cannot be written.
    """
    parts = study_parts(study)
    figures = folder / FIGURES_NAME
    figures.mkdir()
    for part in parts.values():
        for entry in part:
            if isinstance(entry, Drawing):
                entry.save(figures)
    text = json.dumps(study.to_dict(), allow_nan=False, ensure_ascii=False, indent=1)
    (folder / RESULTS_NAME).write_text(text + "\n", encoding="utf-8", newline="\n")
    write_report(study_page(study, parts), folder / PAGE_NAME)
