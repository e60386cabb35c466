"""The page of the study: every table and figure of the 2008 paper beside what came out here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from photosite.report.numbers import format_number, format_time, format_uncertain
from photosite.report.page import Block, Column, Notice, Page, Section, Table
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.studies.farrell2008.cameras import CASES, ILLUMINANT, HiddenTruth
from photosite.studies.farrell2008.page.dim_face import dim_face_part
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.page.fill_factor import fill_factor_part
from photosite.studies.farrell2008.page.glance import glance_table
from photosite.studies.farrell2008.page.high_dynamic_range import high_dynamic_range_part
from photosite.studies.farrell2008.page.patches import patches_part
from photosite.studies.farrell2008.page.pixel_size import pixel_size_part
from photosite.studies.farrell2008.page.snr import snr_part
from photosite.studies.farrell2008.page.table1 import table1_part
from photosite.studies.farrell2008.study import CHAPTERS, Reproduction
from photosite.values.measured import Measured

PARTS: dict[str, Callable[[Any], Part]] = {
    "table1": table1_part,
    "fill_factor": fill_factor_part,
    "patches": patches_part,
    "snr": snr_part,
    "pixel_size": pixel_size_part,
    "dim_face": dim_face_part,
    "high_dynamic_range": high_dynamic_range_part,
}
"""What is drawn of each chapter of `studies.farrell2008.study.CHAPTERS`, by its key."""

_LEAD = (
    "J. Farrell, M. Okincha and M. Parmar, “Sensor calibration and simulation”, Proc. SPIE 6817 (2008), from its "
    "calibration to its applications: each result beside what the paper reports, and the differences in words."
)
_NOTICE = (
    "The paper’s frames were never published. Whatever is called measured on this page was shot by a virtual camera. "
    "It has the sensor of the paper’s Table 1, and what nobody tells a simulation: a lens a little out of focus, "
    "a lamp that lights the chart unevenly, a fill factor of its own, and another chip of the same design. The "
    "simulation was told none of these."
)
_FOOTER = "Values are estimate ± one standard uncertainty (GUM), unless they say otherwise."


def study_parts(study: Reproduction) -> dict[str, Part]:
    """What the page says of each chapter that was run, its figures drawn."""
    return {key: PARTS[key](result) for key, result in study.results.items()}


def study_page(study: Reproduction, parts: Mapping[str, Part]) -> Page:
    """The page, before it is HTML.

    Parameters
    ----------
    study
        What came out.
    parts
        `study_parts` of it.
    """
    titles = {chapter.key: chapter.title for chapter in CHAPTERS}
    sections = [Section("What is measured here", (Notice(_NOTICE), _conditions(), _truth_table(study.seed)))]
    sections.append(Section("At a glance", (glance_table(study),)))
    sections += [Section(titles[key], tuple(_block(entry) for entry in part)) for key, part in parts.items()]
    return Page("Sensor calibration and simulation, reproduced", _LEAD, sections, _FOOTER)


def _block(entry: Block | Drawing) -> Block:
    return entry.block if isinstance(entry, Drawing) else entry


def _conditions() -> Table:
    """What both sides know."""
    sensors = [case.sensor() for case in CASES]

    def row(what: str, *cells: str) -> tuple[str, ...]:
        return what, *cells

    return Table(
        "What the measured cameras and the simulations of them have in common",
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
    """What each side of the comparison has."""
    truths = [HiddenTruth.drawn(case, seed) for case in CASES]

    def row(what: str, told: str, real: Callable[[HiddenTruth], str]) -> tuple[str, ...]:
        return what, told, *(real(truth) for truth in truths)

    return Table(
        f"What the simulation is told, and what the virtual cameras are (seed {seed})",
        (Column(""), Column("Told"), *(Column(f"{case.title}, measured") for case in CASES)),
        (
            row("Fill factor", "not told; fitted", lambda truth: format_number(truth.fill_factor, 4)),
            row(
                "Lens",
                "limited by diffraction",
                lambda truth: f"out of focus by {truth.wavefront_error_waves:g} waves RMS at 550 nm",
            ),
            row(
                "Light on the chart",
                "even, as bright as the mean",
                lambda truth: (
                    f"uneven by {100 * truth.unevenness:g} %, brightest towards {truth.lamp_angle_deg:.0f}° (0° is "
                    "right, 90° down)"
                ),
            ),
            row("Chip", "another one of the design", lambda truth: truth.serial),
        ),
    )
