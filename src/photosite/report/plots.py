"""The plots of a calibration's report, in the order of the EMVA 1288 data sheet; where one is missing, the reason."""

from __future__ import annotations

from photosite.calibration.photon_transfer.curves import Curve
from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.calibration.photon_transfer.linearity import Linearity
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.calibration.result import Calibration
from photosite.report.blocks import figure_block, lacking_blocks, reason_block
from photosite.report.chip import defect_blocks, temporal_blocks
from photosite.report.figures.curve import Residuals, curve_figure
from photosite.report.figures.general_model import general_model_figure
from photosite.report.figures.linearity import linearity_figure
from photosite.report.figures.snr import snr_figure
from photosite.report.html import Block, Section, Subheading
from photosite.report.patterns import non_uniformity_blocks, outlier_pixel_blocks
from photosite.report.tables import linear_range_table
from photosite.values.uncertain import Missing

_CURVES: dict[str, tuple[Residuals, str]] = {
    "response": (
        "percent",
        "Response: signal against the amount of light, with the line through the linear range. Below: its deviation "
        "from that line. Bars are 95 % intervals from sampling alone, the band that of the line.",
    ),
    "photon_transfer": (
        "standard",
        "Photon transfer: temporal variance against signal, both less the dark's. The slope of the line is the system "
        "gain K. Below: what the line leaves, in standard uncertainties; 95 % should lie between the dotted lines. The "
        "band is that of the line.",
    ),
    "dark_signal": (
        "standard",
        "Dark signal: mean of the dark frames against exposure. The slope of the line is the dark current. Below: what "
        "the line leaves, in standard uncertainties.",
    ),
    "dark_variance": (
        "standard",
        "Dark noise: temporal variance of the dark frames against exposure; without dark current it stays that of the "
        "read noise. Below: what the line leaves, in standard uncertainties.",
    ),
}


def curve_blocks(calibration: Calibration, kinds: tuple[str, ...] = tuple(_CURVES)) -> tuple[Block, ...]:
    """A figure for each kind of curve that has two points or more in some channel.

    Parameters
    ----------
    calibration
        Whose curves.
    kinds
        Which, of "response", "photon_transfer", "dark_signal" and "dark_variance".
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
    """The sections of the data sheet that hold plots, in the standard's order.

    Parameters
    ----------
    calibration
        What `calibrate` gave.

    Returns
    -------
    tuple of Section
        Each has its plots, or the reason why there are none.

    Notes
    -----
    EMVA 1288 R4.0 Linear, the plots that a data sheet presents.
    """
    defects = (*defect_blocks(calibration), *outlier_pixel_blocks(calibration))
    ranges = [linear_range_table(calibration.linear_range)] if calibration.linear_range else []
    gain = calibration.system_gain_dn_per_e
    no_light = gain.reason or "one light level only; a curve needs two or more"
    return (
        Section("Sensitivity", (*_or_reason(calibration, "response", no_light), *ranges)),
        Section("Photon transfer", _or_reason(calibration, "photon_transfer", no_light)),
        Section("Signal-to-noise ratio", _snr_blocks(calibration)),
        Section("Linearity", _linearity_blocks(calibration)),
        Section("General model", _general_blocks(calibration)),
        Section("Dark current", _dark_blocks(calibration)),
        Section("Noise in the dark", temporal_blocks(calibration)),
        Section("Non-uniformity", non_uniformity_blocks(calibration)),
        Section("Defects", defects),
    )


def _or_reason(calibration: Calibration, kind: str, lacking: str) -> tuple[Block, ...]:
    """The figure of a kind of curve, or why there is none."""
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
        "one that turns every photon into an electron and adds no noise"
        if photons
        else "one that adds no noise to that of the electrons, since the photons are not known"
    )
    caption = (
        "Signal-to-noise ratio of a pixel from frame to frame: points as measured, with 95 % intervals; lines from the "
        f"fitted gain, response and dark noise, with 95 % bands; dotted, that of an ideal sensor, {ideal}. The thin "
        "line is the total ratio, with the fixed pattern (DSNU and PRNU) among the noise."
    )
    alternative = "Signal-to-noise ratio against light: points, linear model with 95 % band, ideal sensor"
    return (figure_block(figure, alternative, caption), *lacking_blocks(calibration.snr, "ratio"))


def _patterns(calibration: Calibration, curves: dict[str, SnrCurve]) -> dict[str, tuple[float, float]]:
    """DSNU1288 in DN and PRNU1288 as a share, of the channels that have both."""
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
        "Deviation of the response from a straight line. Above, relative to the line, which is fitted to the relative "
        "deviations (EMVA 1288 R3.1 and R4.0): small signals count as much as large ones. Below, relative to the full "
        "scale (R3.0). Bars are 95 % intervals from sampling, dotted lines the extremes of the levels fitted, from 5 "
        "to 95 % of saturation."
    )
    alternative = "Deviation from linearity against light, by two definitions"
    lacking = lacking_blocks(calibration.linearity, "deviation from linearity")
    return (figure_block(linearity_figure(found), alternative, caption), *lacking)


def _general_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Where the photons are not known: what EMVA 1288 R4.0 General tells of any camera."""
    found = {channel: entry for channel, entry in calibration.general.items() if isinstance(entry, GeneralModel)}
    if calibration.model != "general" or not found:
        return ()
    caption = (
        "What can be told of any camera, whatever its light and its response. Above, the characteristic curve; below, "
        "the signal-to-noise ratio of the input: the amount of light over the noise that it would have to have, the "
        "noise seen over the local slope of the curve. Bars are 95 % intervals."
    )
    alternative = "Characteristic curve and signal-to-noise ratio of the input against exposure"
    lacking = lacking_blocks(calibration.general, "figures of the general model")
    return (figure_block(general_model_figure(found), alternative, caption), *lacking)


def _dark_blocks(calibration: Calibration) -> tuple[Block, ...]:
    one = "darks at one exposure only; a slope needs two or more"
    return (
        Subheading("From the mean"),
        *_or_reason(calibration, "dark_signal", one),
        Subheading("From the variance"),
        *_or_reason(calibration, "dark_variance", f"{one}, with two frames each"),
    )
