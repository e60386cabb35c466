"""Summary of the study: one line for each result of the paper, with the result here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Column, Table
from photosite.studies.farrell2008.dim_face import EXPOSURE_S, LUMINANCE_CD_M2, DimFace
from photosite.studies.farrell2008.fill_factor import FillFactors
from photosite.studies.farrell2008.high_dynamic_range import HighDynamicRange
from photosite.studies.farrell2008.page.fill_factor import TOO_LARGE
from photosite.studies.farrell2008.patches import FORMULAS, Patches, differences, snr_difference_db
from photosite.studies.farrell2008.pixel_size import PICTURE_LUMINANCE_CD_M2, PRESETS, PixelSize
from photosite.studies.farrell2008.snr import PAPER_D200_AT_SWING_DB, SnrChapter
from photosite.studies.farrell2008.study import Reproduction
from photosite.studies.farrell2008.table1 import CameraTable, Table1
from photosite.values.measured import COVERAGE_95

Row = tuple[str, str, str, str]

_PICTURED = "shown in figures; values not published"
_NOISE = ("read_noise_mv", "dsnu_mv", "prnu_percent")


def summary_table(study: Reproduction) -> Table:
    """Return the lines of the chapters that were run."""
    rows = tuple(row for result in study.results.values() for row in _rows(result))
    columns = (Column("Result"), Column("Paper"), Column("Here"), Column("Difference"))
    return Table("Results of the paper and of this study", columns, rows)


def _rows(result: Any) -> tuple[Row, ...]:
    rows: tuple[Row, ...] = SUMMARIES[type(result)](result) if type(result) in SUMMARIES else ()
    return rows


def _table1(result: Table1) -> tuple[Row, ...]:
    eight = result.eight
    return (
        *(_noise_row(table) for table in result.cameras.values()),
        (
            f"DSNU from {eight.frames} dark frames",
            "6 mV, with a read noise of 4.58 mV",
            f"{format_uncertain(eight.dsnu_mv, eight.dsnu_uncertainty_mv)} mV",
            f"The DSNU of the chip is well determined; the offset of a pixel only to {eight.pixel_offset_error_mv:.2f} "
            "mV, and noisy pixels are not identified.",
        ),
    )


def _noise_row(table: CameraTable) -> Row:
    rows = [table.row(name) for name in _NOISE]
    inside = sum(row.covered for row in table.rows)
    return (
        f"Table 1, {table.case.title}: read noise, DSNU, PRNU",
        ", ".join(f"{row.paper:g} {row.unit}" for row in rows if row.paper is not None),
        ", ".join(
            f"{format_uncertain(row.estimate.value, row.estimate.standard_uncertainty or 0.0)} {row.unit}"
            for row in rows
            if row.estimate.value is not None
        ),
        f"{inside} of {len(table.rows)} values of the table have a 95 % interval that contains the true value. "
        "Conversion gain, system gain and saturation capacity follow from one gain, so that their errors are "
        "correlated.",
    )


def _fill_factors(result: FillFactors) -> tuple[Row, ...]:
    rows = []
    for found in result.cameras.values():
        fit = found.fit
        inside = "inside" if abs(fit.value - found.true) <= COVERAGE_95 * fit.standard_error else "outside"
        rows.append(
            (
                f"Fill factor, {found.case.title}",
                f"{found.case.paper_fill_factor:g}",
                f"{format_uncertain(fit.value, fit.standard_error)}; hidden: {format_number(found.true, 4)}",
                f"{abs(found.pull):.1f} standard errors from the hidden value, {inside} the 95 % interval. "
                f"{TOO_LARGE} The hidden value was drawn for this study; that of the paper cannot be tested without "
                "its frames.",
            )
        )
    return tuple(rows)


def _patches(result: Patches) -> tuple[Row, ...]:
    rows = []
    for found in result.cameras.values():
        brightest = found.comparisons[found.case.luminances_cd_m2[-1]]
        means = abs(brightest.relative_difference[brightest.used]).mean()
        ratios = abs(snr_difference_db(brightest)).mean()
        rows.append(
            (
                f"Patch means and SNR, {found.case.title}",
                _PICTURED,
                f"{100 * means:.1f} % and {ratios:.2f} dB apart on average over patches and channels",
                "The measured chart is lit unevenly, which the simulation does not know.",
            )
        )
        fitted, left_out = (differences(found.colors.simulated, "2000", out).mean() for out in (False, True))
        seen = differences(found.colors.measured, "2000", True).mean()
        rows.append(
            (
                f"Colour differences with the best 3 × 3 matrix, {found.case.title}",
                _PICTURED,
                f"mean {FORMULAS['2000']}: {left_out:.2f} simulated, {seen:.2f} measured, patches left out of the fit",
                f"Fitted patches underestimate the error: {fitted:.2f} instead of {left_out:.2f}.",
            )
        )
    return tuple(rows)


def _snr(result: SnrChapter) -> tuple[Row, ...]:
    d200 = next(iter(result.sensors.values()))
    largest = max(abs(value) for value in result.from_paper_db.values())
    return (
        (
            f"Figure 6, SNR of the {d200.case.title} at {d200.swing_v:g} V",
            f"{PAPER_D200_AT_SWING_DB['total']:.2f} dB in total",
            f"{float(d200.at_swing.total_db):.2f} dB in total",
            f"The five curves differ by at most {largest:.3f} dB.",
        ),
    )


def _pixel_size(result: PixelSize) -> tuple[Row, ...]:
    level = PICTURE_LUMINANCE_CD_M2
    large, small = (result.curve(width, False) for width in sorted(PRESETS, reverse=True))
    quiet_large, quiet_small = (result.curve(width, True) for width in sorted(PRESETS, reverse=True))
    area_db = 10 * math.log10(small.per_large_pixel)
    lost, quiet = (b.snr_at(level) - s.snr_at(level) for b, s in ((large, small), (quiet_large, quiet_small)))
    return (
        (
            f"Figure 7, {large.width_um:g} µm against {small.width_um:g} µm at {level:g} cd/m²",
            _PICTURED,
            f"{large.snr_at(level):.1f} and {small.snr_at(level):.1f} dB on a white surface, one pixel each",
            f"The small pixel loses {lost:.1f} dB, and {lost - area_db:.1f} dB over the same area; without read noise "
            f"and DSNU the areas would differ by {abs(quiet - area_db):.1f} dB.",
        ),
    )


def _dim_face(result: DimFace) -> tuple[Row, ...]:
    shots = ", ".join(
        f"{entry.shot.noise('G').snr_db:.0f} dB ({entry.case.title}, f/{entry.case.f_number:g})"
        for entry in result.shots
    )
    limited = [entry.case.title for entry in result.shots if entry.read_dsnu_dominate_on_the_face]
    return (
        (
            f"Face in dim light, {LUMINANCE_CD_M2:g} cd/m², {1e3 * EXPOSURE_S:g} ms",
            "pictures; portrait not published",
            f"SNR of green on the face: {shots}",
            f"Read noise and DSNU dominate with {len(limited)} of {len(result.shots)} cameras. Simulated, not "
            "measured.",
        ),
    )


def _high_dynamic_range(result: HighDynamicRange) -> tuple[Row, ...]:
    ranges = ", ".join(f"{shot.dynamic_range_db:.0f} dB ({shot.case.title})" for shot in result.shots)
    return (
        (
            "Scene of high dynamic range",
            "pictures; scene not published",
            f"Dynamic range of one frame: {ranges}",
            "Simulated, not measured.",
        ),
    )


SUMMARIES: dict[type, Callable[[Any], tuple[Row, ...]]] = {
    Table1: _table1,
    FillFactors: _fill_factors,
    Patches: _patches,
    SnrChapter: _snr,
    PixelSize: _pixel_size,
    DimFace: _dim_face,
    HighDynamicRange: _high_dynamic_range,
}
"""Lines of a chapter by the type of its result."""
