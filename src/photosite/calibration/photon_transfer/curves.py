"""The points behind the fits, for reports and for eyes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.patterns import Channel
from photosite.calibration.photon_transfer.dark import DarkLine, Darkness
from photosite.calibration.photon_transfer.fit import Fit
from photosite.calibration.photon_transfer.photon_transfer import LINEAR_SHARE, fit_gain, fit_response
from photosite.calibration.reduction.groups import CLIPPED_SHARE
from photosite.calibration.result import Curve, LinearRange


def channel_curves(background: Darkness, channel: Channel | None) -> dict[str, Curve]:
    """One channel's curves by name: "dark_signal", "dark_variance", "response", "photon_transfer"."""
    curves = {
        "dark_signal": _dark_curve(background.mean, "Dark signal", "mean (DN)"),
        "dark_variance": _dark_curve(background.variance, "Dark temporal variance", "variance (DN²)"),
    }
    if channel is not None:
        curves["response"] = _response(channel)
        curves["photon_transfer"] = _photon_transfer(channel)
    return curves


def _dark_curve(line: DarkLine, title: str, y_label: str) -> Curve:
    fit = line.fit
    return Curve(
        title,
        "exposure (s)",
        y_label,
        line.exposure_s,
        line.y,
        np.sqrt(line.variance),
        np.ones(len(line.y), dtype=np.bool_),
        None if fit is None else float(fit.parameters[0]),
        None if fit is None else float(fit.parameters[1]),
        0.0 if fit is None else fit.extra_variance,
        None if fit is None else fit.covariance,
    )


def _response(channel: Channel) -> Curve:
    levels = channel.levels
    fit = fit_response(levels, channel.used)
    return Curve(
        "Response",
        "photons per pixel" if levels.abscissa == "photons_per_pixel" else "exposure (s)",
        "signal (DN)",
        levels.x,
        levels.signal,
        np.sqrt(np.diag(levels.signal_covariance)),
        channel.used,
        None if fit is None else 0.0,
        None if fit is None else float(fit.parameters[0]),
        0.0 if fit is None else fit.extra_variance,
        None if fit is None else _through_origin(fit),
    )


def _photon_transfer(channel: Channel) -> Curve:
    levels = channel.levels
    there = levels.repeated
    fit = fit_gain([levels], [channel.used])
    return Curve(
        "Photon transfer",
        "signal (DN)",
        "temporal variance less dark (DN²)",
        levels.signal[there],
        levels.shot[there],
        np.sqrt(np.diag(levels.shot_covariance))[there],
        channel.used[there],
        None if fit is None else 0.0,
        None if fit is None else float(fit.parameters[0]),
        0.0 if fit is None else fit.extra_variance,
        None if fit is None else _through_origin(fit),
    )


def _through_origin(fit: Fit) -> NDArray[np.float64]:
    """(2, 2) covariance of intercept and slope of a line whose intercept is 0 by definition."""
    covariance = np.zeros((2, 2))
    covariance[1, 1] = fit.covariance[0, 0]
    return covariance


def linear_range(channel: Channel) -> LinearRange:
    """The linear range of a channel that has levels in it."""
    levels, used = channel.levels, channel.used
    rule = f"at most {100 * CLIPPED_SHARE:g} % of the pixels clipped"
    if channel.saturation.signal is not None:
        limit = LINEAR_SHARE * channel.saturation.signal
        rule += f", and signal up to {100 * LINEAR_SHARE:g} % of that at the largest temporal variance, {limit:.1f} DN"
    return LinearRange(
        abscissa=levels.abscissa,
        lowest=float(levels.x[used].min()),
        highest=float(levels.x[used].max()),
        highest_dn=float(levels.mean[used].max()),
        levels=int(used.sum()),
        levels_measured=len(used),
        rule=rule,
    )
