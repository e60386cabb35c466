"""The points behind the fits of one channel, and its linear range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.dark_lines import DarkLine, DarkLines
from photosite.calibration.photon_transfer.fit import Fit
from photosite.calibration.photon_transfer.photon_transfer import LINEAR_SHARE, fit_gain, fit_response
from photosite.calibration.reduction.groups import CLIPPED_SHARE

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """Measured points and the straight line through them.

    Parameters
    ----------
    title, x_label, y_label
        Labels of a plot, units included.
    x, y, y_uncertainty, used
        (points,) measured values; standard uncertainty of sampling alone; whether the fit used the point.
    intercept, slope, line_covariance
        The line, and the (2, 2) covariance of its parameters; None where no line could be fitted.
    extra_variance
        Variance per point, beyond sampling, that explains the scatter about the line; 0 for ideal frames.
    """

    title: str
    x_label: str
    y_label: str
    x: Array
    y: Array
    y_uncertainty: Array
    used: NDArray[np.bool_]
    intercept: float | None = None
    slope: float | None = None
    extra_variance: float = 0.0
    line_covariance: Array | None = None

    @classmethod
    def of_fit(
        cls,
        title: str,
        x_label: str,
        y_label: str,
        points: tuple[Array, Array, Array, NDArray[np.bool_]],
        fit: Fit | None,
    ) -> Curve:
        """Return the curve of a fit with two parameters, or with the slope alone through the origin."""
        if fit is None:
            return cls(title, x_label, y_label, *points)
        intercept, covariance = 0.0, np.zeros((2, 2))
        if len(fit.parameters) == 1:
            covariance[1, 1] = fit.covariance[0, 0]
        else:
            intercept, covariance = float(fit.parameters[0]), fit.covariance
        slope = float(fit.parameters[-1])
        return cls(title, x_label, y_label, *points, intercept, slope, fit.extra_variance, covariance)

    def line(self, x: ArrayLike) -> tuple[Array, Array] | None:
        """Return the line and its standard uncertainty at some abscissae; None without a line.

        With intercept a and slope b, u^2 = u^2(a) + 2 x u(a, b) + x^2 u^2(b): that of the true line, not of a point.

        Examples
        --------
        >>> none, used = np.array([]), np.array([], dtype=bool)
        >>> curve = Curve("", "s", "DN", none, none, none, used, 1.0, 2.0, 0.0, np.array([[4.0, -1.0], [-1.0, 1.0]]))
        >>> [numbers.tolist() for numbers in curve.line([0.0, 1.0])]
        [[1.0, 3.0], [2.0, 1.7320508075688772]]
        """
        if self.intercept is None or self.slope is None or self.line_covariance is None:
            return None
        at = np.asarray(x, dtype=np.float64)
        (aa, ab), (_, bb) = self.line_covariance
        return self.intercept + self.slope * at, np.sqrt(aa + 2.0 * ab * at + bb * at**2)


@dataclass(frozen=True)
class LinearRange:
    """The range of light in which a channel is taken as linear.

    Parameters
    ----------
    abscissa, lowest, highest
        The range of photons per pixel ("photons_per_pixel") or exposure time ("exposure_s").
    highest_dn
        Mean digital number of the brightest level inside.
    levels, levels_measured
        Number of light levels inside, and of all.
    rule
        How the range was found.
    contradicting
        Stated amounts of light of the levels left out because they contradict the others.
    """

    abscissa: str
    lowest: float
    highest: float
    highest_dn: float
    levels: int
    levels_measured: int
    rule: str
    contradicting: tuple[float, ...] = ()


def channel_curves(dark: DarkLines, channel: Channel | None) -> dict[str, Curve]:
    """Return one channel's curves: "dark_signal", "dark_variance" and, with light, "response", "photon_transfer"."""
    curves = {
        "dark_signal": _dark_curve(dark.mean, "Dark signal", "mean (DN)"),
        "dark_variance": _dark_curve(dark.variance, "Dark temporal variance", "variance (DN²)"),
    }
    if channel is None:
        return curves
    levels, used = channel.levels, channel.used
    axis = "photons per pixel" if levels.photons_known else "exposure (s)"
    uncertainty = np.sqrt(np.diag(levels.signal_covariance))
    points = levels.x, levels.signal, uncertainty, used & levels.trusted
    curves["response"] = Curve.of_fit("Response", axis, "signal (DN)", points, fit_response(levels, used))
    known = levels.repeated
    uncertainty = np.sqrt(np.diag(levels.shot_covariance))[known]
    points = levels.signal[known], levels.shot[known], uncertainty, used[known]
    y_label, fit = "temporal variance less dark (DN²)", fit_gain([levels], [used])
    curves["photon_transfer"] = Curve.of_fit("Photon transfer", "signal (DN)", y_label, points, fit)
    return curves


def _dark_curve(line: DarkLine, title: str, y_label: str) -> Curve:
    points = line.exposure_s, line.y, np.sqrt(line.variance), np.ones(len(line.y), dtype=np.bool_)
    return Curve.of_fit(title, "exposure (s)", y_label, points, line.fit)


def linear_range(channel: Channel) -> LinearRange:
    """Return the linear range of a channel that has at least one level in it."""
    levels, used = channel.levels, channel.used & channel.levels.trusted
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
        contradicting=tuple(levels.x[~levels.trusted].tolist()),
    )
