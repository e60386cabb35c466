"""The plots of a calibration's report, in the order of the EMVA 1288 data sheet, or the reasons for missing ones."""

from __future__ import annotations

from collections.abc import Mapping

from photosite.calibration.photon_transfer.curves import Curve
from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.calibration.photon_transfer.linearity import Linearity
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.calibration.result import Calibration
from photosite.calibration.spatial.spatial_analysis import FramePattern, SpatialAnalysis
from photosite.report.chip import defect_blocks, temporal_blocks
from photosite.report.figures.fixed_pattern import histogram_figure, profiles_figure, spectrogram_figure
from photosite.report.figures.response import (
    Residuals,
    curve_figure,
    general_model_figure,
    linearity_figure,
    snr_figure,
)
from photosite.report.numbers import format_number
from photosite.report.page import (
    Block,
    Column,
    Details,
    Paragraph,
    Section,
    Subheading,
    Table,
    figure_block,
    missing_channel_blocks,
    reason_block,
)
from photosite.report.tables import linear_range_table
from photosite.values.uncertain import Missing

_CURVES: dict[str, tuple[Residuals, str]] = {
    "response": (
        "percent",
        "Response: signal against light, with the line fitted to the linear range. Below: deviation from the line. "
        "Error bars are 95 % intervals from sampling; the band is that of the line.",
    ),
    "photon_transfer": (
        "standard",
        "Photon transfer: temporal variance against signal, both minus the dark value. The slope of the line is the "
        "system gain K. Below: residuals in standard uncertainties; 95 % should lie between the dotted lines. The "
        "band is that of the line.",
    ),
    "dark_signal": (
        "standard",
        "Dark signal: mean of the dark frames against exposure time. The slope of the line is the dark current. Below: "
        "residuals in standard uncertainties.",
    ),
    "dark_variance": (
        "standard",
        "Dark noise: temporal variance of the dark frames against exposure time; without dark current it is constant. "
        "Below: residuals in standard uncertainties.",
    ),
}


def curve_blocks(calibration: Calibration, kinds: tuple[str, ...] = tuple(_CURVES)) -> tuple[Block, ...]:
    """Return a figure for each kind of curve that has at least two points in some channel.

    Parameters
    ----------
    calibration
        The calibration.
    kinds
        Kinds of curves: "response", "photon_transfer", "dark_signal", "dark_variance".
    """
    blocks: list[Block] = []
    for kind in kinds:
        residuals, caption = _CURVES[kind]
        curves = _curves(calibration, kind)
        if any(len(curve.x) > 1 for curve in curves.values()):
            title = next(iter(curves.values())).title
            figure = curve_figure(curves, residuals)
            blocks.append(figure_block(figure, f"{title}: points and fitted lines with 95 % bands", caption))
    return tuple(blocks)


def _curves(calibration: Calibration, kind: str) -> dict[str, Curve]:
    return {channel: found[kind] for channel, found in calibration.curves.items() if kind in found}


def plot_sections(calibration: Calibration) -> tuple[Section, ...]:
    """Return the sections of the data sheet with plots, in the standard's order.

    Parameters
    ----------
    calibration
        Result of `calibrate`.

    Returns
    -------
    tuple of Section
        Each with its plots, or the reason why they are missing.

    References
    ----------
    EMVA 1288 R4.0 Linear, the plots of a data sheet.
    """
    defects = (*defect_blocks(calibration), *outlier_pixel_blocks(calibration))
    ranges = [linear_range_table(calibration.linear_range)] if calibration.linear_range else []
    gain = calibration.system_gain_dn_per_e
    no_light = gain.reason or "there is only one light level; a curve needs at least two"
    return (
        Section("Sensitivity", (*_or_reason(calibration, "response", no_light), *ranges)),
        Section("Photon transfer", _or_reason(calibration, "photon_transfer", no_light)),
        Section("Signal-to-noise ratio", _snr_blocks(calibration)),
        Section("Linearity", _linearity_blocks(calibration)),
        Section("General model", _general_blocks(calibration)),
        Section("Dark current", _dark_blocks(calibration)),
        Section("Noise in the dark", temporal_blocks(calibration)),
        Section("Nonuniformity", non_uniformity_blocks(calibration)),
        Section("Defects", defects),
    )


def _or_reason(calibration: Calibration, kind: str, lacking: str) -> tuple[Block, ...]:
    """Return the figure of a kind of curve, or the reason why it is missing."""
    return curve_blocks(calibration, (kind,)) or (reason_block(lacking),)


def _snr_blocks(calibration: Calibration) -> tuple[Block, ...]:
    curves = {
        channel: found for channel, found in calibration.snr.items() if isinstance(found, SnrCurve) and found.x.size
    }
    if not curves:
        reasons = [found.reason for found in calibration.snr.values() if isinstance(found, Missing)]
        return (
            reason_block(reasons[0] if reasons else calibration.system_gain_dn_per_e.reason or "no level has a ratio"),
        )
    figure = snr_figure(curves, _patterns(calibration, curves))
    photons = next(iter(curves.values())).photons
    ideal = (
        "which turns every photon into an electron and adds no noise"
        if photons
        else "which adds no noise to the shot noise of the electrons (the photons are unknown)"
    )
    caption = (
        "Temporal signal-to-noise ratio of a pixel. Points: measured, with 95 % intervals. Lines: from the fitted "
        f"gain, response and dark noise, with 95 % bands. Dotted: an ideal sensor, {ideal}. Thin line: total ratio, "
        "with the fixed pattern (DSNU and PRNU) included in the noise."
    )
    alternative = "Signal-to-noise ratio against light: points, linear model with 95 % band, ideal sensor"
    return (figure_block(figure, alternative, caption), *missing_channel_blocks(calibration.snr, "ratio"))


def _patterns(calibration: Calibration, curves: dict[str, SnrCurve]) -> dict[str, tuple[float, float]]:
    """Return DSNU1288 in DN and PRNU1288 as a fraction, for the channels that have both."""
    found = {}
    for channel, curve in curves.items():
        parameters = calibration.channels.get(channel, calibration)
        dsnu_e, prnu_percent = parameters.dsnu1288_e.value, parameters.prnu1288_percent.value
        if dsnu_e is not None and prnu_percent is not None:
            found[channel] = (curve.gain_dn_per_e.value * dsnu_e, prnu_percent / 100.0)
    return found


def _linearity_blocks(calibration: Calibration) -> tuple[Block, ...]:
    found = {channel: entry for channel, entry in calibration.linearity.items() if isinstance(entry, Linearity)}
    if not found:
        reasons = [entry.reason for entry in calibration.linearity.values() if isinstance(entry, Missing)]
        return (
            reason_block(reasons[0] if reasons else calibration.linearity_error_percent.reason or "no light frames"),
        )
    caption = (
        "Deviation of the response from a straight line. Above: relative to the line, fitted to the relative "
        "deviations (EMVA 1288 R3.1 and R4.0), so that small signals have the same weight as large ones. Below: "
        "relative to full scale (R3.0). Error bars are 95 % intervals from sampling. Dotted lines are the extremes "
        "of the fitted levels, 5 to 95 % of saturation."
    )
    alternative = "Deviation from linearity against light, by two definitions"
    lacking = missing_channel_blocks(calibration.linearity, "deviation from linearity")
    return (figure_block(linearity_figure(found), alternative, caption), *lacking)


def _general_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the plots of EMVA 1288 R4.0 General, if the photons are unknown."""
    found = {channel: entry for channel, entry in calibration.general.items() if isinstance(entry, GeneralModel)}
    if calibration.model != "general" or not found:
        return ()
    caption = (
        "The general model, which assumes neither known photons nor a linear response. Above: the characteristic "
        "curve. Below: the signal-to-noise ratio of the input, which is the light divided by the input noise: the "
        "measured noise divided by the local slope of the curve. Error bars are 95 % intervals."
    )
    alternative = "Characteristic curve and signal-to-noise ratio of the input against exposure"
    lacking = missing_channel_blocks(calibration.general, "figures of the general model")
    return (figure_block(general_model_figure(found), alternative, caption), *lacking)


def _dark_blocks(calibration: Calibration) -> tuple[Block, ...]:
    one = "dark frames at only one exposure time; a slope needs at least two"
    return (
        Subheading("From the mean"),
        *_or_reason(calibration, "dark_signal", one),
        Subheading("From the variance"),
        *_or_reason(calibration, "dark_variance", f"{one}, with two frames each"),
    )


_LISTED = 200
"""Largest number of pixels in a list."""

_FRAMES = {"dark": "the mean dark frame", "light": "the mean flat field near half saturation, minus dark"}


def non_uniformity_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return spectrograms, profiles and histograms of the mean frames, in the dark and in the light.

    Parameters
    ----------
    calibration
        Result of `calibrate`.

    References
    ----------
    EMVA 1288 R4.0 Linear, 8.6 to 8.8.
    """
    found = _analyses(calibration)
    if not found:
        return (reason_block(_why(calibration)),)
    kinds = {kind: _patterns_of_kind(found, kind) for kind in _FRAMES}
    blocks: list[Block] = [Subheading("Spectrograms")]
    for kind, patterns in kinds.items():
        blocks.append(_spectrogram(kind, patterns) if patterns else _no_light(found))
    blocks += missing_channel_blocks(
        {channel: analysis.light for channel, analysis in found.items()}, "pattern in the light"
    )
    blocks.append(Subheading("Profiles"))
    blocks += [_profiles(channel, analysis, len(found) > 1) for channel, analysis in found.items()]
    blocks.append(Subheading("Histograms"))
    blocks += [_histogram(kind, patterns) for kind, patterns in kinds.items() if patterns]
    return tuple(blocks)


def outlier_pixel_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the outlier pixels of the histograms, candidates for a defect list, with the rule that found them."""
    found = _analyses(calibration)
    if not found:
        return (reason_block(_why(calibration)),)
    patterns = [(channel, pattern) for kind in _FRAMES for channel, pattern in _patterns_of_kind(found, kind).items()]
    columns = ("Frame", "Channel", "Pixels", "Listed beyond", "Unit", "Rule")
    titles = tuple(Column(title, numeric=title in ("Pixels", "Listed beyond")) for title in columns)
    rows = tuple(
        (p.kind, channel, str(len(p.outliers.row)), format_number(p.outliers.threshold, 4), p.unit, p.outliers.rule)
        for channel, p in patterns
    )
    blocks: list[Block] = [
        Paragraph(
            "Pixels that deviate from the mean of their map by more than a threshold. They are candidates for a defect "
            "list; the application decides what counts as a defect."
        ),
        Table("Candidates for a defect list", titles, rows),
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
    return Details(title, (Table("Positions counted from 0, sorted by deviation", columns, rows),))


def _analyses(calibration: Calibration) -> dict[str, SpatialAnalysis]:
    return {channel: found for channel, found in calibration.spatial.items() if isinstance(found, SpatialAnalysis)}


def _why(calibration: Calibration) -> str:
    reasons = [found.reason for found in calibration.spatial.values() if isinstance(found, Missing)]
    return reasons[0] if reasons else "the patterns of these frames were not analysed"


def _patterns_of_kind(found: Mapping[str, SpatialAnalysis], kind: str) -> dict[str, FramePattern]:
    """Return the pattern of one kind of frame, by channel."""
    patterns = {channel: getattr(analysis, kind) for channel, analysis in found.items()}
    return {channel: pattern for channel, pattern in patterns.items() if isinstance(pattern, FramePattern)}


def _no_light(found: Mapping[str, SpatialAnalysis]) -> Paragraph:
    reasons = [analysis.light.reason for analysis in found.values() if isinstance(analysis.light, Missing)]
    return reason_block(f"the pattern in the light; {reasons[0] if reasons else 'no channel has one'}")


def _spectrogram(kind: str, patterns: Mapping[str, FramePattern]) -> Block:
    return figure_block(
        spectrogram_figure(patterns),
        f"Horizontal and vertical spectrogram of {_FRAMES[kind]}",
        f"Spectrograms of {_FRAMES[kind]}. A regular pattern gives a peak at its frequency, uneven light a rise at "
        "the left, and independent pixels a flat spectrum. The excess over the remaining temporal noise is due to "
        "the sensor.",
    )


def _profiles(channel: str, analysis: SpatialAnalysis, named: bool) -> Block:
    of_channel = f", channel {channel}" if named else ""
    return figure_block(
        profiles_figure(analysis),
        f"Horizontal and vertical profiles of the mean frames{of_channel}",
        f"Profiles of the mean frames{of_channel}. Left: mean, extremes and middle row along the columns. Right: the "
        "same along the rows. Uneven light bends the profiles; a defective line gives a spike.",
    )


def _histogram(kind: str, patterns: Mapping[str, FramePattern]) -> Block:
    return figure_block(
        histogram_figure(patterns),
        f"Logarithmic and accumulated histogram of {_FRAMES[kind]}",
        f"Histograms of {_FRAMES[kind]}. Left: pixels by deviation from the mean. Right: percentage of pixels with at "
        "least that deviation. Dashed: the normal distribution of the same standard deviation.",
    )
