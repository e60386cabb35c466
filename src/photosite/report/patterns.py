"""The fixed pattern in a calibration's report: spectrograms, profiles, histograms, and the outlier pixels."""

from __future__ import annotations

from collections.abc import Mapping

from photosite.calibration.result import Calibration
from photosite.calibration.spatial.spatial_analysis import FramePattern, SpatialAnalysis
from photosite.report.blocks import figure_block, lacking_blocks, reason_block
from photosite.report.figures.histogram import histogram_figure
from photosite.report.figures.profiles import profiles_figure
from photosite.report.figures.spectrogram import spectrogram_figure
from photosite.report.html import Block, Column, Details, Paragraph, Subheading, Table
from photosite.report.numbers import format_number
from photosite.values.uncertain import Missing

_LISTED = 200
"""Pixels of a list at most: the farthest."""

_FRAMES = {"dark": "the mean dark frame", "light": "the mean light frame near half saturation, less the dark"}


def non_uniformity_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Spectrograms, profiles and histograms of the mean frames, in the dark and in the light.

    Parameters
    ----------
    calibration
        What `calibrate` gave.

    Notes
    -----
    EMVA 1288 R4.0 Linear, 8.6 to 8.8.
    """
    found = _analyses(calibration)
    if not found:
        return (reason_block(_why(calibration)),)
    kinds = {kind: _patterns(found, kind) for kind in _FRAMES}
    blocks: list[Block] = [Subheading("Spectrograms")]
    for kind, patterns in kinds.items():
        blocks.append(_spectrogram(kind, patterns) if patterns else _no_light(found))
    blocks += lacking_blocks({channel: analysis.light for channel, analysis in found.items()}, "pattern in the light")
    blocks.append(Subheading("Profiles"))
    blocks += [_profiles(channel, analysis, len(found) > 1) for channel, analysis in found.items()]
    blocks.append(Subheading("Histograms"))
    blocks += [_histogram(kind, patterns) for kind, patterns in kinds.items() if patterns]
    return tuple(blocks)


def outlier_pixel_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the outlier pixels of the histograms, candidates for the defect list, with the rule that found them."""
    found = _analyses(calibration)
    if not found:
        return (reason_block(_why(calibration)),)
    patterns = [(channel, pattern) for kind in _FRAMES for channel, pattern in _patterns(found, kind).items()]
    columns = ("Frame", "Channel", "Pixels", "Listed beyond", "Unit", "Rule")
    titles = tuple(Column(title, numeric=title in ("Pixels", "Listed beyond")) for title in columns)
    rows = tuple(
        (p.kind, channel, str(len(p.outliers.row)), format_number(p.outliers.threshold, 4), p.unit, p.outliers.rule)
        for channel, p in patterns
    )
    blocks: list[Block] = [
        Paragraph(
            "Pixels that deviate from the mean of their map by more than a threshold. They are candidates for a list "
            "of defects: what counts as one, the application decides."
        ),
        Table("Candidates for the list of defects", titles, rows),
    ]
    blocks += [_outlier_list(channel, pattern) for channel, pattern in patterns if len(pattern.outliers.row)]
    return tuple(blocks)


def _outlier_list(channel: str, pattern: FramePattern) -> Details:
    found = pattern.outliers
    count = len(found.row)
    some = f"the {_LISTED} farthest of {count} pixels" if count > _LISTED else f"{count} pixel{'s' * (count != 1)}"
    columns = (
        Column("Row", numeric=True),
        Column("Column", numeric=True),
        Column(f"Deviation ({pattern.unit})", numeric=True),
    )
    rows = tuple(
        (str(row), str(col), format_number(float(deviation), 4))
        for row, col, deviation in zip(found.row[:_LISTED], found.col[:_LISTED], found.deviation[:_LISTED], strict=True)
    )
    where = f"channel {channel}, " if channel != "M" else ""
    title = f"Outlier pixels of {_FRAMES[pattern.kind]}: {where}{some}"
    return Details(title, (Table("Places counted from 0, the most deviating first", columns, rows),))


def _analyses(calibration: Calibration) -> dict[str, SpatialAnalysis]:
    return {channel: found for channel, found in calibration.spatial.items() if isinstance(found, SpatialAnalysis)}


def _why(calibration: Calibration) -> str:
    reasons = [found.reason for found in calibration.spatial.values() if isinstance(found, Missing)]
    return reasons[0] if reasons else "the patterns of these frames were not looked at"


def _patterns(found: Mapping[str, SpatialAnalysis], kind: str) -> dict[str, FramePattern]:
    """Per channel, the pattern of one kind of frame, where there is one."""
    patterns = {channel: getattr(analysis, kind) for channel, analysis in found.items()}
    return {channel: pattern for channel, pattern in patterns.items() if isinstance(pattern, FramePattern)}


def _no_light(found: Mapping[str, SpatialAnalysis]) -> Paragraph:
    reasons = [analysis.light.reason for analysis in found.values() if isinstance(analysis.light, Missing)]
    return reason_block(f"the pattern in the light; {reasons[0] if reasons else 'no channel has one'}")


def _spectrogram(kind: str, patterns: Mapping[str, FramePattern]) -> Block:
    return figure_block(
        spectrogram_figure(patterns),
        f"Horizontal and vertical spectrogram of {_FRAMES[kind]}",
        f"Spectrograms of {_FRAMES[kind]}: a regular pattern is a peak at its frequency, uneven light a rise at the "
        "left, pixels that know nothing of each other a level line. What lies above the temporal noise left is the "
        "sensor's.",
    )


def _profiles(channel: str, analysis: SpatialAnalysis, named: bool) -> Block:
    of_channel = f", channel {channel}" if named else ""
    return figure_block(
        profiles_figure(analysis),
        f"Horizontal and vertical profiles of the mean frames{of_channel}",
        f"Profiles of the mean frames{of_channel}: left, over each column the mean, the extremes and the middle "
        "row; right, the same over each row. Uneven light bends them, a defective line is a spike.",
    )


def _histogram(kind: str, patterns: Mapping[str, FramePattern]) -> Block:
    return figure_block(
        histogram_figure(patterns),
        f"Logarithmic and accumulated histogram of {_FRAMES[kind]}",
        f"Histograms of {_FRAMES[kind]}: left, how many pixels deviate by how much; right, how many by so much or "
        "more. Where the pixels leave the dashed normal distribution, they are more unlike each other than chance "
        "explains.",
    )
