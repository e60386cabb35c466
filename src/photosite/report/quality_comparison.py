"""The report of image quality compared: values that differ, and the table of all."""

from __future__ import annotations

from photosite.report.image_quality import value_text
from photosite.report.numbers import format_number
from photosite.report.page import Block, Heading, Notice, Page, Section, Table, Tile, Tiles, columns, numeric, sentence
from photosite.validation.quality_comparison import ComparedValue, QualityComparison

_MOST_TILES = 24


def quality_comparison_page(found: QualityComparison) -> Page:
    """Return the report of a comparison as a page: first the values that differ, the largest differences first."""
    counts = ", ".join(f"{verdict} {count}" for verdict, count in found.count.items())
    lead = f"Measured and simulated values {'agree' if found.agrees else 'differ'} ({counts})."
    differing = [each for each in found.values if each.verdict == "differs"]
    differing.sort(key=lambda each: -abs(each.score or 0.0))
    tiles = tuple(_tile(each) for each in differing[:_MOST_TILES])
    overview: tuple[Block, ...] = tuple(Notice(sentence(note), warning=True) for note in found.notes)
    overview = (Tiles(tiles or (Tile("all values", "agrees", counts, "pass"),)), *overview)
    rows: list[tuple[str, ...] | Heading] = []
    for chart in dict.fromkeys(each.chart for each in found.values):
        rows.append(Heading(chart))
        rows += [_row(each) for each in found.values if each.chart == chart]
    titles = columns(
        *("Value", "Verdict", numeric("Difference / uncertainty"), numeric("Measured"), numeric("Simulated"), "Unit")
    )
    caption = "Values ± standard uncertainties"
    footer = f"False-alarm rate of the table {found.level:g}, tolerance {found.tolerance_percent:g} %."
    sections = (Section("All values", (Table(caption, titles, tuple(rows)),)),)
    return Page("Image quality, measured and simulated", lead, sections, footer, overview)


def _score(each: ComparedValue) -> str:
    return "" if each.score is None else format_number(each.score, 2)


def _tile(each: ComparedValue) -> Tile:
    measured, simulated = value_text(each.measured), value_text(each.simulated)
    note = f"measured {measured}, simulated {simulated} {each.quantity.unit}".rstrip()
    score = _score(each)
    return Tile(f"{each.name} ({each.chart})", f"{score} σ" if score else "differs", note, "fail")


def _row(each: ComparedValue) -> tuple[str, ...]:
    values = (value_text(each.measured), value_text(each.simulated))
    return (each.name, each.verdict, _score(each), *values, each.quantity.unit)
