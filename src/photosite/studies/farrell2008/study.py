"""The study: chapters of the 2008 paper, run in order, and the files they are written to."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from photosite.errors import InputError, did_you_mean
from photosite.report.numbers import format_number, format_time, format_uncertain
from photosite.report.page import Column, Notice, Page, Section, Table
from photosite.report.write import write_report
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.studies.farrell2008.cameras import CASES, ILLUMINANT, HiddenTruth
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, text
from photosite.studies.farrell2008.fill_factor import fit_fill_factors
from photosite.studies.farrell2008.high_dynamic_range import high_dynamic_range
from photosite.studies.farrell2008.patches import compare_charts
from photosite.studies.farrell2008.pixel_size import pixel_sizes
from photosite.studies.farrell2008.portrait import dim_face
from photosite.studies.farrell2008.snr import snr_against_volts
from photosite.studies.farrell2008.table1 import measure_table1
from photosite.studies.progress import NoProgress, Progress
from photosite.values.uncertain import Measured

PAGE_NAME, RESULTS_NAME, FIGURES_NAME = "farrell2008.html", "results.json", "figures"


class Result(Protocol):
    """Result of a chapter."""

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`: plain values that depend on the seed only."""
        ...

    def part(self) -> Part:
        """Draw the section of the page."""
        ...

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the lines of the summary."""
        ...


Compute = Callable[[int, Progress, Mapping[str, Any]], Result]
"""Compute a chapter from the seed of the study, the receiver of progress, and the results of earlier chapters."""


@dataclass(frozen=True)
class Chapter:
    """A part of the paper: key in `results.json`, heading, function that computes the result, and keys of earlier
    chapters whose results it uses."""

    key: str
    title: str
    compute: Compute
    needs: tuple[str, ...] = ()


CHAPTERS: tuple[Chapter, ...] = (
    Chapter("table1", "Section 2: Table 1 measured", lambda seed, progress, _: measure_table1(seed, progress=progress)),
    Chapter("fill_factor", "Section 3: the fill factor", lambda seed, *_: fit_fill_factors(seed)),
    Chapter(
        "patches",
        "Figures 1 to 5: the chart, measured and simulated",
        lambda seed, _, results: compare_charts(seed, results["fill_factor"]),
        needs=("fill_factor",),
    ),
    Chapter("snr", "Figure 6: what limits the signal-to-noise ratio", lambda seed, *_: snr_against_volts(seed)),
    Chapter("pixel_size", "Figure 7: 1.4 µm against 2.2 µm", lambda seed, *_: pixel_sizes(seed)),
    Chapter("dim_face", "Section 5: a dimly lit face", lambda seed, *_: dim_face(seed)),
    Chapter("high_dynamic_range", "Section 5: high dynamic range", lambda seed, *_: high_dynamic_range(seed)),
)
"""In the order of the paper. A new chapter is added here, and the prose of its figures in `text.toml`."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Result of the study: its seed, and results and wall-clock times by chapter."""

    seed: int
    results: Mapping[str, Result]
    seconds: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `results.json`, which depends on the seed only, except for `seconds`."""
        return {
            "study": "Farrell, Okincha and Parmar, Sensor calibration and simulation, Proc. SPIE 6817 (2008)",
            "seed": self.seed,
            "measured": (
                "virtual cameras, because the paper's frames were never published; hidden_truth is unknown to the "
                "simulation"
            ),
            "hidden_truth": {case.key: HiddenTruth.drawn(case, self.seed).to_dict() for case in CASES},
            "chapters": {key: result.to_dict() for key, result in self.results.items()},
            "seconds": dict(self.seconds),
        }

    def parts(self) -> dict[str, Part]:
        """Draw the chapters that were run."""
        return {key: result.part() for key, result in self.results.items()}

    def page(self, parts: Mapping[str, Part]) -> Page:
        """Return the page of the study from its drawn parts."""
        sections = [Section("Method", (Notice(text("notice")), _conditions(), _truth_table(self.seed)))]
        sections.append(Section("Summary", (self._summary(),)))
        for chapter in CHAPTERS:
            blocks = (entry.block if isinstance(entry, Drawing) else entry for entry in parts.get(chapter.key, ()))
            sections.append(Section(chapter.title, tuple(blocks)))
        return Page("Sensor calibration and simulation, reproduced", text("lead"), sections, text("footer"))

    def write(self, folder: Path) -> None:
        """Write the page, results.json, and the figures as SVG and PNG to an existing folder.

        The same study gives the same bytes, except for `seconds` in results.json.

        Raises
        ------
        FileError
            If a file cannot be written.
        """
        parts = self.parts()
        figures = folder / FIGURES_NAME
        figures.mkdir()
        for part in parts.values():
            for entry in part:
                if isinstance(entry, Drawing):
                    entry.save(figures)
        content = json.dumps(self.to_dict(), allow_nan=False, ensure_ascii=False, indent=1)
        (folder / RESULTS_NAME).write_text(content + "\n", encoding="utf-8", newline="\n")
        write_report(self.page(parts), folder / PAGE_NAME)

    def _summary(self) -> Table:
        rows = tuple(row for result in self.results.values() for row in result.summary())
        columns = (Column("Result"), Column("Paper"), Column("Here"), Column("Difference"))
        return Table("Results of the paper and of this study", columns, rows)


def reproduce(seed: int = 2008, keys: Iterable[str] | None = None, progress: Progress | None = None) -> Reproduction:
    """Run the study.

    Parameters
    ----------
    seed
        Seed of all random draws.
    keys
        Chapters to run, with those they need; all by default.
    progress
        Receives stages and frame counts.

    Raises
    ------
    InputError
        If a chapter is unknown.
    """
    progress = progress or NoProgress()
    wanted = _with_needs([chapter.key for chapter in CHAPTERS] if keys is None else list(keys))
    results: dict[str, Result] = {}
    seconds: dict[str, float] = {}
    for chapter in CHAPTERS:
        if chapter.key in wanted:
            begin = time.perf_counter()
            progress.stage(chapter.title)
            results[chapter.key] = chapter.compute(seed, progress, MappingProxyType(results))
            seconds[chapter.key] = time.perf_counter() - begin
    return Reproduction(seed, results, seconds)


def _with_needs(keys: list[str]) -> set[str]:
    known = {chapter.key: chapter for chapter in CHAPTERS}
    wanted: set[str] = set()
    while keys:
        key = keys.pop()
        if key not in known:
            raise InputError("chapter", value=key, expected="a known name", hint=did_you_mean(key, known))
        if key not in wanted:
            wanted.add(key)
            keys += known[key].needs
    return wanted


def _conditions() -> Table:
    def stated(value: Measured, unit: str) -> str:
        return f"{format_uncertain(value.value, 0.0)} {unit}" + (" (assumed; confidential)" if value.assumed else "")

    pixels = [case.sensor().pixel for case in CASES]
    charts = (
        f"ColorChecker at {DEFAULT_DISTANCE_M:g} m, tungsten light (CIE {ILLUMINANT}), "
        f"{', '.join(f'{level:g}' for level in case.luminances_cd_m2)} cd/m² on average over its patches"
        for case in CASES
    )
    rows = (
        ("Pixel", *(f"{pixel.width_um.value:g} µm" for pixel in pixels)),
        ("Voltage swing", *(stated(pixel.voltage_swing_v, "V") for pixel in pixels)),
        ("Well capacity", *(stated(pixel.well_capacity_e, "e⁻") for pixel in pixels)),
        ("Lens", *(f"f/{case.f_number:g}, {case.focal_length_mm:g} mm" for case in CASES)),
        ("Exposure of the chart", *(format_time(case.exposure_s) for case in CASES)),
        ("Chart", *charts),
        ("Frames of the chart", *(f"{case.chart_rows} × {case.chart_cols} pixels" for case in CASES)),
    )
    titles = (Column(""), *(Column(case.title) for case in CASES))
    return Table("Conditions that measured and simulated cameras share", titles, rows)


def _truth_table(seed: int) -> Table:
    truths = [HiddenTruth.drawn(case, seed) for case in CASES]
    lenses = (f"out of focus by {truth.wavefront_error_waves:g} waves RMS at 550 nm" for truth in truths)
    lights = (
        f"uneven by {100 * truth.unevenness:g} %, brightest towards {truth.lamp_angle_deg:.0f}° (0° is right, 90° down)"
        for truth in truths
    )
    return Table(
        f"Properties of the simulation and of the virtual cameras (seed {seed})",
        (Column(""), Column("Simulation"), *(Column(f"{case.title}, measured") for case in CASES)),
        (
            ("Fill factor", "fitted", *(format_number(truth.fill_factor, 4) for truth in truths)),
            ("Lens", "diffraction-limited", *lenses),
            ("Light on the chart", "even, same mean", *lights),
            ("Chip", "another chip of the design", *(truth.serial for truth in truths)),
        ),
    )
