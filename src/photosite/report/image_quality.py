"""The report of image quality: the chart as it was found, a table and the figures of every measurement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageDraw

from photosite.color.colorimetry import srgb_from_light
from photosite.metrics.camera_quality import CameraQuality
from photosite.metrics.limits import Judged, Verdict
from photosite.metrics.measure import ImageQuality
from photosite.metrics.measurement import FieldMap, Measurement, Result
from photosite.metrics.registry import measurements
from photosite.report.diagnostics import explanations, notices
from photosite.report.figures.measurement import curve_figures, map_figure, small_figure
from photosite.report.numbers import format_number
from photosite.report.page import (
    WIDEST,
    Block,
    Card,
    Gallery,
    Image,
    Images,
    Notice,
    Page,
    Paragraph,
    Section,
    Subheading,
    Table,
    Tile,
    Tiles,
    anchor_of,
    columns,
    figure_block,
    jpeg_bytes,
    numeric,
    sentence,
    shrink,
)
from photosite.report.style import svg_bytes
from photosite.report.tables import format_estimate, interval_text
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing

_FOOTER = "Intervals contain the true value in 95 % of measurements."
_BRIGHT = 99.5
"""Percentile of the picture that is shown as white."""


def image_quality_page(quality: ImageQuality, judged: Judged | None = None) -> Page:
    """Return the report of the measurements on a chart as a page."""
    image, chart = quality.image, quality.chart
    rows, cols = image.shape
    count = "one frame" if len(image.frames) == 1 else f"{len(image.frames)} frames"
    kind = {"raw": "raw", "picture": "developed", "electrons": "noise-free"}[image.origin]
    lead = f"{chart.name} in {count}, {kind}, {rows} × {cols} pixels. The chart {_FOUND[chart.found]}."
    sections = [*_sections(quality), Section("Diagnostics", explanations(quality.diagnostics))]
    pictures = tuple(Card(image, anchor="chart") for image in _picture(quality, "Chart").images)
    return Page("Image quality", lead, sections, _FOOTER, _overview({"": quality}, judged, pictures))


def camera_quality_page(found: CameraQuality, judged: Judged | None = None) -> Page:
    """Return the report of a camera's charts as a page."""
    lead = f"{found.name}: {', '.join(found.charts)}."
    sections = [
        Section(_titled(section.title, name), section.blocks)
        for name, quality in found.charts.items()
        for section in _sections(quality)
    ]
    sections.append(Section("Diagnostics", explanations(found.diagnostics)))
    return Page("Image quality of a camera", lead, sections, _FOOTER, _overview(found.charts, judged))


def judged_page(judged: Judged) -> Page:
    """Return the report of image quality that was judged by limits as a page."""
    found = judged.quality
    return image_quality_page(found, judged) if isinstance(found, ImageQuality) else camera_quality_page(found, judged)


def _sections(quality: ImageQuality) -> Iterator[Section]:
    """Yield the sections of a chart, for those who read."""
    missing = tuple(
        Notice(f"{name}: not measured. {sentence(found.reason)}")
        for name, found in quality.results.items()
        if isinstance(found, Missing)
    )
    yield Section("Chart", (_picture(quality), *notices(quality.image_diagnostics), *missing))
    yield from (_section(found) for found in quality.results.values() if isinstance(found, Result))


def _titled(title: str, chart: str) -> str:
    return f"{title} ({chart})" if chart else title


def _overview(
    charts: Mapping[str, ImageQuality], judged: Judged | None, pictures: tuple[Card, ...] = ()
) -> tuple[Block, ...]:
    """Return the first page: verdicts or the headline values, and the figures that people look at."""
    shown = list(_shown(charts))
    strip = _headlines(shown) if judged is None else _verdicts(judged, charts)
    cards = [card for each in shown if (card := _card(each)) is not None]
    lines: list[Block] = []
    heading: list[Block] = []
    if judged is not None:
        counts = Counter(row.verdict for row in judged.rows)
        words = ", ".join(f"{counts[verdict]} {verdict}" for verdict in get_args(Verdict) if counts[verdict])
        heading.append(Subheading(f"{judged.name}: {'pass' if judged.passed else 'no pass'} ({words})"))
    diagnostics = [entry for quality in charts.values() for entry in quality.diagnostics]
    limiting = Counter(entry.id for entry in diagnostics if entry.severity in ("note", "warning"))
    if limiting:
        named = ", ".join(f"{id} ({count})" if count > 1 else id for id, count in limiting.items())
        warning = any(entry.severity == "warning" for entry in diagnostics)
        lines.append(Notice(f"Diagnostics, explained below: {named}.", warning=warning))
    made = {each.measurement.id for each in shown}
    absent = dict.fromkeys(
        _titled(id, name if id in made and len(charts) > 1 else "")
        for name, quality in charts.items()
        for id, found in quality.results.items()
        if isinstance(found, Missing)
    )
    if absent:
        lines.append(Paragraph(f"Not measured, with the reasons below: {', '.join(absent)}."))
    return (*heading, Tiles(strip), *lines, Gallery((*pictures, *cards)))


@dataclass(frozen=True)
class _Shown:
    """A result on the first page, with the name of its photograph, and this name where there are several."""

    result: Result
    measurement: Measurement
    channel: str
    photograph: str
    named: str

    @property
    def anchor(self) -> str:
        return anchor_of(_titled(self.measurement.title, self.photograph))


def _shown(charts: Mapping[str, ImageQuality]) -> Iterator[_Shown]:
    """Yield the results of each measurement on the chart that it prefers."""
    for id, entry in measurements().items():
        made = {
            name: result for name, quality in charts.items() if isinstance(result := quality.results.get(id), Result)
        }
        place = {name: entry.charts.index(charts[name].chart.name) if entry.charts else 0 for name in made}
        for name, result in made.items():
            if place[name] == min(place.values()):
                channel = charts[name].image.sharp_channel
                yield _Shown(result, entry, channel, name, name if len(made) > 1 else "")


def _headlines(shown: Sequence[_Shown]) -> tuple[Tile, ...]:
    """Return the headline values: those of the channel that sharpness is measured on, where there are several."""
    tiles = []
    for each in shown:
        for headline in each.measurement.headline:
            quantity = each.result.quantity(headline)
            values = {part: value for (name, part), value in each.result.values.items() if name == headline}
            for part, estimate in _of_channel(values, each.channel).items():
                if estimate.value is None:
                    continue
                label = _titled(f"{quantity.label}{', ' if part else ''}{part}", each.named)
                text, power, _ = value_text(estimate).partition(" ±")
                text = format_number(estimate.value, 3) if power and text.startswith("(") else text
                interval = interval_text(estimate) if estimate.standard_uncertainty else ""
                tiles.append(Tile(label, text, f"{interval} {quantity.unit}".strip(), anchor=each.anchor))
    return tuple(tiles)


def _of_channel(values: Mapping[str, Estimate], channel: str) -> dict[str, Estimate]:
    """Return the values of a channel, those of whole fields or patches before those of their parts; else the first."""
    whole = {part: each for part, each in values.items() if ", " not in part} or dict(values)
    own = {part: each for part, each in whole.items() if part.partition(", ")[0] == channel}
    return dict(list((own or whole).items())[:_MOST_TILES])


_MOST_TILES = 3


def _verdicts(judged: Judged, charts: Mapping[str, ImageQuality]) -> tuple[Tile, ...]:
    tiles = []
    for row in judged.rows:
        text = row.limit.text.replace(">=", "≥").replace("<=", "≤")
        part = "" if row.limit.name.part or not row.part else f", {row.part}"
        label = _titled(f"{text}{part}", row.chart if len(charts) > 1 else "")
        missing = row.estimate.value is None
        interval = interval_text(row.estimate)
        note = row.estimate.reason or "" if missing else f"{value_text(row.estimate)}{interval and f' ({interval})'}"
        tiles.append(Tile(label, row.verdict, note, row.verdict))
    return tuple(tiles)


def _card(shown: _Shown) -> Card | None:
    figure = small_figure(shown.result, shown.channel)
    if figure is None:
        return None
    title = _titled(shown.measurement.title, shown.named)
    return Card(Image(svg_bytes(figure), "image/svg+xml", f"Figure of {title}", title), anchor=shown.anchor)


_FOUND = {
    "given corners": "is at the given corners",
    "fills the frame": "is assumed to fill the frame",
    "detected": "was detected",
}


def _section(result: Result) -> Section:
    entry = result.measurement
    assert entry is not None
    blocks: list[Block] = [Paragraph(f"{entry.standard}."), *notices(result.diagnostics), _values(result)]
    if result.options:
        given = ", ".join(f"{name} = {value}" for name, value in result.options.items())
        blocks.insert(1, Paragraph(f"Options: {given}."))
    blocks += map(Paragraph, _reasons(result))
    for number, figure in enumerate(curve_figures(result)):
        curve = next(c for c in result.curves if (c.x_label, c.y_label) == list(_axes(result))[number])
        label = f"{curve.y_label.removeprefix('log ')} over {curve.x_label.removeprefix('log ')}"
        drawn = "bands" if curve.joined else "error bars"
        banded = f"; the {drawn} are 95 % intervals" if curve.standard_uncertainty is not None else ""
        blocks.append(figure_block(figure, label, f"{sentence(label)[:-1]}{banded}."))
    for found in result.maps:
        blocks.append(figure_block(map_figure(found), f"{found.label} over {_over(found)}", sentence(found.label)))
    if entry.left_out:
        blocks.append(Paragraph(f"Not implemented or different from the standard: {entry.left_out}"))
    return Section(entry.title, tuple(blocks))


def _axes(result: Result) -> dict[tuple[str, str], None]:
    return dict.fromkeys((curve.x_label, curve.y_label) for curve in result.curves)


def _over(found: FieldMap) -> str:
    return "the frame" if found.axes == FieldMap.axes else found.axes[0]


_MOST_PARTS = 4
"""Parts up to which each has a column."""


def _values(result: Result) -> Table:
    """Return the values: a column for each of a few parts or channels, or a row for each value."""
    parts = list(dict.fromkeys(part for _, part in result.values))
    split = {part: ("", part) if len(parts) <= _MOST_PARTS else part.partition(", ")[::-2] for part in parts}
    across = list(dict.fromkeys(column for _, column in split.values()))
    if 1 < len(across) <= _MOST_PARTS:
        cells: dict[tuple[str, str], dict[str, Estimate]] = {}
        for (name, part), each in result.values.items():
            rest, column = split[part]
            cells.setdefault((name, rest), {})[column] = each
        of = any(rest for _, rest in cells)
        titles = columns("Quantity", *["Of"] * of, *map(numeric, across), "Unit")
        rows = tuple(
            (
                result.quantity(name).label,
                *[rest] * of,
                *(_text(found.get(column)) for column in across),
                result.quantity(name).unit,
            )
            for (name, rest), found in cells.items()
        )
        return Table("Values ± standard uncertainties", titles, rows)
    rows = tuple(
        (result.quantity(name).label, part, value_text(each), interval_text(each), result.quantity(name).unit)
        for (name, part), each in result.values.items()
    )
    titles = columns("Quantity", "Of", numeric("Value ± standard uncertainty"), numeric("95 % interval"), "Unit")
    return Table("Values", titles, rows)


def _text(estimate: Estimate | None) -> str:
    return "" if estimate is None else value_text(estimate)


def _reasons(result: Result) -> list[str]:
    """Return why values are missing, a sentence for each reason."""
    missing: dict[str, dict[str, list[str]]] = {}
    for (name, part), each in result.values.items():
        if each.value is None:
            missing.setdefault(each.reason or "", {}).setdefault(result.quantity(name).label, []).append(part)
    texts = []
    for reason, of in missing.items():
        named = (f"{label} ({', '.join(parts)})" if any(parts) else label for label, parts in of.items())
        texts.append(f"Not measured: {'; '.join(named)}. {sentence(reason)}")
    return texts


def value_text(estimate: Estimate) -> str:
    """Return a value with its uncertainty, or without one.

    Examples
    --------
    >>> value_text(Estimate(0.25)), value_text(Estimate(reason="no edge"))
    ('0.2500', 'not measured')
    """
    if estimate.value is None:
        return "not measured"
    if not estimate.standard_uncertainty:
        return format_number(estimate.value)
    return format_estimate(estimate)


def _picture(quality: ImageQuality, title: str = "") -> Images:
    """Return the first frame with the outlines of what was measured."""
    image = quality.image
    factor = -(-image.shape[1] // WIDEST)
    light = np.stack([shrink(plane) for plane in _planes(quality, factor)], axis=-1)
    light = np.clip(light / max(float(np.percentile(light, _BRIGHT)), 1e-30), 0.0, 1.0)
    whole = Pillow.fromarray(
        np.rint(srgb_from_light(np.broadcast_to(light, (*light.shape[:2], 3))) * 255.0).astype(np.uint8)
    )
    draw = ImageDraw.Draw(whole)
    results = (result for result in quality.results.values() if isinstance(result, Result))
    outlines: list[Any] = [outline for result in results for outline in result.outlines]
    for outline in outlines or [quality.chart.corners, *(patch.corners for patch in quality.chart.patches)]:
        points = [(col / factor, row / factor) for row, col in outline]
        for width, color in ((3, "black"), (1, "white")):
            draw.line([*points, points[0]], fill=color, width=width)
    content = jpeg_bytes(np.asarray(whole, dtype=np.float32) / np.float32(255.0))
    caption = "The first frame with the outlines of the chart and of the measured parts; check them."
    return Images((Image(content, "image/jpeg", "Frame with the outlines of the chart", title),), caption)


def _planes(quality: ImageQuality, factor: int) -> list[NDArray[np.float32]]:
    """Return the planes of a picture, or a mosaic whose colors do not show as a pattern after it is shrunk."""
    image = quality.image
    if image.origin == "picture":
        return [image.plane(name)[0].astype(np.float32) for name in ("R", "G", "B")]
    values = image.mean.astype(np.float32) - np.float32(image.black)
    down, along = len(image.cfa), len(image.cfa[0])
    if factor % down == factor % along == 0:
        return [values]
    rows, cols = values.shape[0] // down * down, values.shape[1] // along * along
    tiles = values[:rows, :cols].reshape(rows // down, down, cols // along, along).mean(axis=(1, 3))
    return [tiles.repeat(down, axis=0).repeat(along, axis=1)]
