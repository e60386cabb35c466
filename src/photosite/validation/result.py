"""The result of comparing measured with simulated frames, with the color differences of patches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import delta_e_76, delta_e_94, delta_e_2000
from photosite.develop.camera_color import ColorMatrix, fit_color_matrix
from photosite.errors import InputError
from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import ChiSquare, RelativeDifference, dict_or_none, largest, relative_difference
from photosite.validation.noise_difference import describe_noise_difference
from photosite.validation.regression import Regression
from photosite.values.shown import ResultTable, Shown, Tabular, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class ColorComparison(Shown):
    """Color differences between measured and simulated patches, both through one color matrix.

    Parameters
    ----------
    names
        The patches, without those that have a saturated channel.
    delta_e_76, delta_e_94, delta_e_2000
        (patches,) differences between measured and simulated; measured is the reference of CIE 1994.
    matrix
        Camera RGB in DN above black to XYZ under D65, fitted to the simulated patches, with its residuals against the
        patches' true colors.
    """

    names: tuple[str, ...]
    delta_e_76: NDArray[np.float64]
    delta_e_94: NDArray[np.float64]
    delta_e_2000: NDArray[np.float64]
    matrix: ColorMatrix


def compare_colors(
    names: tuple[str, ...],
    channels: tuple[str, ...],
    means: tuple[NDArray[np.float64], NDArray[np.float64]],
    used: NDArray[np.bool_],
    reference_xyz: NDArray[np.float64] | None,
    notes: list[str],
) -> ColorComparison | None:
    """Return the color differences of the patches that have no saturated channel.

    The matrix is fitted to the simulated patches and applied to both without rescaling. A measured chart that is
    uniformly brighter therefore differs in color.

    Parameters
    ----------
    names, channels
        Patches and channels.
    means
        Means above black, measured and simulated, each (patches, channels).
    used
        (patches, channels), false where a value is saturated.
    reference_xyz
        (patches, 3) tristimulus values under D65, Y = 1 for the perfect white; None if the colors are unknown.
    notes
        List that gets the reason if there are no color differences.

    Examples
    --------
    >>> camera = np.random.default_rng(5).uniform(200, 3000, (24, 3))
    >>> names, used = tuple("abcdefghijklmnopqrstuvwx"), np.ones((24, 3), bool)
    >>> result = compare_colors(names, ("R", "G", "B"), (camera, camera), used, camera / 3000, [])
    >>> float(result.delta_e_2000.max()), result.delta_e_2000.shape
    (0.0, (24,))
    """
    try:
        if set(channels) != {"R", "G", "B"}:
            raise InputError("the channels are not R, G and B")
        if reference_xyz is None:
            raise InputError("the patches' colors are unknown")
        order = [channels.index(name) for name in "RGB"]
        whole = np.flatnonzero(used.all(axis=1))
        measured_rgb, simulated_rgb = (mean[whole][:, order] for mean in means)
        matrix = fit_color_matrix(simulated_rgb, reference_xyz[whole])
    except InputError as reason:
        notes.append(f"no color differences: {reason}")
        return None
    xyz = matrix.apply(measured_rgb), matrix.apply(simulated_rgb)
    chosen = tuple(names[patch] for patch in whole)
    return ColorComparison(chosen, delta_e_76(*xyz), delta_e_94(*xyz), delta_e_2000(*xyz), matrix)


@dataclass(frozen=True, eq=False, kw_only=True)
class PatchDifferences(Shown, ABC):
    """What every comparison of two sets of patches holds.

    Parameters
    ----------
    level, tolerance_percent
        False-alarm rate of the verdict, and relative tolerance.
    used
        (patches, channels), false where either is saturated.
    regression, regression_by_channel
        Regression of the means of the first on those of the second, all channels together and each channel; None with
        fewer than three distinct points.
    color, notes
        Color differences, or None; what was left out and why.
    """

    level: float
    tolerance_percent: float
    used: NDArray[np.bool_]
    regression: Regression | None
    regression_by_channel: Mapping[str, Regression | None]
    color: ColorComparison | None
    notes: tuple[str, ...]

    @property
    @abstractmethod
    def agrees(self) -> bool:
        """The verdict."""

    @property
    @abstractmethod
    def reasons(self) -> tuple[str, ...]:
        """The reasons for the verdict."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings for JSON, with None for values that are not finite or masked."""
        return {
            "agrees": self.agrees,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "level": self.level,
            "tolerance_percent": self.tolerance_percent,
            "used": self.used.tolist(),
            "regression": dict_or_none(self.regression),
            "regression_by_channel": {name: dict_or_none(line) for name, line in self.regression_by_channel.items()},
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Validation(Tabular, PatchDifferences):
    """Measured frames against simulated frames.

    Parameters
    ----------
    measured, simulated
        Statistics of the patches.
    means, noise, temporal_noise
        Chi-square of patch means, of variances over pixels, and of variances from frame to frame. The last is None
        unless both sides are stacks of frames.
    exposures_s
        Exposure times of the measured and the simulated frames, where known.
    """

    measured: PatchStatistics
    simulated: PatchStatistics
    means: ChiSquare
    noise: ChiSquare
    temporal_noise: ChiSquare | None
    exposures_s: tuple[float | None, float | None] = (None, None)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw measured against simulated patch means on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    def _table(self) -> ResultTable:
        tests = ", ".join(
            f"{name} {test.p_text}"
            for name, test in (("means", self.means), ("noise", self.noise), ("temporal noise", self.temporal_noise))
            if test is not None
        )
        verdict = "agree" if self.agrees else "differ"
        title = f"Validation: measured and simulated frames {verdict} ({tests})"
        seen, made = self.measured, self.simulated
        difference = 100.0 * self.relative_difference
        rows = [
            (
                patch,
                channel,
                float(seen.mean_dn[i, k]),
                float(made.mean_dn[i, k]),
                None if difference[i, k] is np.ma.masked else float(difference[i, k]),
                float(seen.spatial_noise_dn[i, k]),
                float(made.spatial_noise_dn[i, k]),
                bool(self.used[i, k]),
            )
            for i, patch in enumerate(seen.names)
            for k, channel in enumerate(seen.channels)
        ]
        columns = ("measured_dn", "simulated_dn", "difference_percent", "measured_noise_dn", "simulated_noise_dn")
        return ResultTable(title, ("patch", "channel", *columns, "used"), rows)

    def _brief_table(self) -> ResultTable:
        return self._table().only(("patch", "channel", "measured_dn", "simulated_dn", "difference_percent", "used"))

    @property
    def tests(self) -> tuple[ChiSquare, ...]:
        """The tests of the verdict, which share the false-alarm rate evenly."""
        return tuple(test for test in (self.means, self.noise, self.temporal_noise) if test is not None)

    @property
    def agrees(self) -> bool:
        """Whether no test finds a difference at its share of the false-alarm rate."""
        return min(test.p_value for test in self.tests) >= self.level / len(self.tests)

    @property
    def relative_difference(self) -> RelativeDifference:
        """(measured - simulated) / simulated of (patches, channels), masked where simulated is not above black."""
        return relative_difference(self.measured.mean_dn, self.simulated.mean_dn)

    @property
    def relative_noise_difference(self) -> RelativeDifference:
        """`relative_difference` of the standard deviations over pixels."""
        return relative_difference(self.measured.spatial_noise_dn, self.simulated.spatial_noise_dn)

    @property
    def relative_temporal_difference(self) -> RelativeDifference:
        """`relative_difference` of the standard deviations from frame to frame.

        Raises
        ------
        InputError
            If either side has only one frame.
        """
        seen, made = self.measured.temporal_noise_dn, self.simulated.temporal_noise_dn
        if seen is None or made is None:
            raise InputError("noise from frame to frame needs at least two frames on both sides")
        return relative_difference(seen, made)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons for the verdict: each test, then the size and kind of the differences.

        With a tolerance, each test also gives the largest difference and its patch and channel.
        """
        lines = [
            self._describe("patch means", self.means, self.relative_difference),
            self._describe("noise over pixels", self.noise, self.relative_noise_difference),
        ]
        if self.temporal_noise is not None:
            lines.append(
                self._describe("noise from frame to frame", self.temporal_noise, self.relative_temporal_difference)
            )
        if self.agrees:
            return tuple(lines)
        text = self._largest(self.relative_difference)
        if text and not self.tolerance_percent:
            lines.append(f"the largest difference of means is {text}")
        for test, temporal in ((self.noise, False), (self.temporal_noise, True)):
            if test is not None and test.p_value < self.level / len(self.tests):
                lines.extend(describe_noise_difference(self.measured, self.simulated, self.used, temporal=temporal))
        slopes = {name: line.slope_through_origin for name, line in self.regression_by_channel.items() if line}
        lines += [
            f"channel {name}: measured is {slope.value:.4f} times simulated "
            f"({slope.lower_95:.4f} to {slope.upper_95:.4f})"
            for name, slope in slopes.items()
            if not slope.lower_95 <= 1.0 <= slope.upper_95
        ]
        one, other = self.exposures_s
        if one is not None and other is not None and one != other:
            lines.append(f"the exposure times differ: measured {one:g} s, simulated {other:g} s")
        return tuple(lines)

    def _describe(self, what: str, test: ChiSquare, difference: RelativeDifference) -> str:
        level = self.level / len(self.tests)
        verdict = "agree" if test.p_value >= level else "differ"
        line = (
            f"{what} {verdict}: chi-square {test.statistic:.1f} with {test.degrees_of_freedom} degrees of freedom, "
            f"{test.p_text}, at level {level:.3g}"
        )
        if not self.tolerance_percent:
            return line
        size = self._largest(difference) or "unknown, because the simulated values are 0"
        return f"{line}; largest difference {size}, tolerance {self.tolerance_percent:g} % beyond the sampling error"

    def _largest(self, difference: RelativeDifference) -> str | None:
        """Return the largest relative difference of the used values as text; None where there are no values."""
        if (at := largest(difference, self.used)) is None:
            return None
        return f"{100 * difference[at]:+.2f} % ({self.measured.names[at[0]]}, {self.measured.channels[at[1]]})"

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings for JSON, with None for values that are not finite or masked."""
        return super().to_dict() | {
            "exposures_s": list(self.exposures_s),
            "patches": list(self.measured.names),
            "channels": list(self.measured.channels),
            "measured": _statistics(self.measured),
            "simulated": _statistics(self.simulated),
            "relative_difference": _plain(self.relative_difference),
            **{name: dict_or_none(getattr(self, name)) for name in ("means", "noise", "temporal_noise")},
            "color": None if self.color is None else _color(self.color),
        }


def _plain(values: NDArray[Any]) -> Any:
    return np.ma.masked_invalid(values).tolist()


def _statistics(found: PatchStatistics) -> dict[str, Any]:
    names = (
        "mean_dn",
        "standard_error_dn",
        "spatial_noise_dn",
        "spatial_snr_db",
        "temporal_snr_db",
        "saturated_fraction",
    )
    values = {name: getattr(found, name) for name in names}
    plain = {name: None if value is None else _plain(value) for name, value in values.items()}
    return {"frames": found.frames, "pixels": found.pixels.tolist(), **plain}


def _color(found: ColorComparison) -> dict[str, Any]:
    names = ("delta_e_76", "delta_e_94", "delta_e_2000")
    return {
        "patches": list(found.names),
        **{name: getattr(found, name).tolist() for name in names},
        "matrix": found.matrix.matrix.tolist(),
        **{f"fit_{name}": getattr(found.matrix, name).tolist() for name in names},
        **{f"fit_{name}_left_out": getattr(found.matrix, f"{name}_left_out").tolist() for name in names},
    }
