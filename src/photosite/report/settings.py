"""The report of several settings of a measurement: a table that compares them, and the report of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from photosite.calibration.parameters import parameter_label
from photosite.calibration.settings_result import SHOWN, SettingsCalibration
from photosite.report.calibration import FOOTER, READING_TITLE
from photosite.report.diagnostics import explanations, notices
from photosite.report.page import Block, Details, Page, Section, Table, Terms
from photosite.report.pages import page
from photosite.report.tables import comparison_blocks


def settings_page(result: SettingsCalibration) -> Page:
    """Return the report of several settings as a page."""
    titles = {key: f"{parameter_label(key).label} ({parameter_label(key).unit})" for key in SHOWN}
    rows = {
        name: {title: getattr(each, key) for key, title in titles.items()} for name, each in result.calibrations.items()
    }
    refused = notices(entry for entry in result.diagnostics if entry.id == "setting-not-calibrated")
    sections = [Section("Settings", (*(comparison_blocks(rows, "Setting") if rows else ()), *refused))]
    reading: dict[str, Section] = {}
    for number, (name, each) in enumerate(result.settings.items(), start=1):
        parts = page(each).sections
        reading |= {part.title: part for part in parts if part.title == READING_TITLE}
        blocks = tuple(
            Details(part.title, tuple(_within(part.blocks, f"setting{number}")))
            for part in parts
            if part.blocks and part.title != READING_TITLE
        )
        sections.append(Section(f"Setting {number}: {name}", blocks))
    sections += [Section("Diagnostics", explanations(result.diagnostics)), *reading.values()]
    frames = sum(each.frame_count for each in result.calibrations.values())
    lead = (
        f"{len(result.settings) + len(result.refused)} settings of one measurement, each calibrated by itself, from "
        f"{frames} dark frames and flat fields. Frames that are used with several settings count for each."
    )
    return Page("Calibration of several settings", lead, sections, FOOTER)


def _within(blocks: Iterable[Block], setting: str) -> Iterable[Block]:
    """Yield the blocks of a setting: without the explanations that the page has once, files beside it with its name."""
    for block in blocks:
        if isinstance(block, Table) and block.beside:
            yield replace(block, beside=f"{setting}.{block.beside}")
        elif not isinstance(block, Details):
            yield block
        elif not any(isinstance(inner, Terms) and inner.anchor for inner in block.blocks):
            yield replace(block, blocks=tuple(_within(block.blocks, setting)))
