"""The result of comparing measured with simulated frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import ChiSquare
from photosite.validation.color import ColorComparison
from photosite.validation.noise_diagnosis import describe_noise_difference
from photosite.validation.regression import Regression


@dataclass(frozen=True, eq=False)
class Validation:
    """Measured frames against simulated frames.

    Parameters
    ----------
    level
        False-alarm rate of the verdict.
    tolerance_percent
        Relative tolerance of means and noise, in percent.
    measured, simulated
        Statistics of the patches; arrays are (patches, channels).
    used
        (patches, channels), false where either is saturated.
    means, noise, temporal_noise
        Chi-square of patch means, of variances over pixels, and of variances from frame to frame. The last is None
        unless both sides are stacks of frames.
    regression
        Regression of measured on simulated means in DN above black, all channels together; None with fewer than three
        points.
    regression_by_channel
        The regression of each channel.
    color
        Colour differences, or None with the reason in `notes`.
    exposures_s
        Exposure times of the measured and the simulated frames, where known.
    notes
        What was left out and why.
    """

    level: float
    tolerance_percent: float
    measured: PatchStatistics
    simulated: PatchStatistics
    used: NDArray[np.bool_]
    means: ChiSquare
    noise: ChiSquare
    temporal_noise: ChiSquare | None
    regression: Regression | None
    regression_by_channel: Mapping[str, Regression | None]
    color: ColorComparison | None
    exposures_s: tuple[float | None, float | None]
    notes: tuple[str, ...]

    @property
    def tests(self) -> tuple[ChiSquare, ...]:
        """The tests of the verdict, which share the false-alarm rate evenly."""
        return tuple(test for test in (self.means, self.noise, self.temporal_noise) if test is not None)

    @property
    def agrees(self) -> bool:
        """Whether no test finds a difference at its share of the false-alarm rate."""
        return min(test.p_value for test in self.tests) >= self.level / len(self.tests)

    @property
    def relative_difference(self) -> np.ma.MaskedArray[Any, np.dtype[np.float64]]:
        """(patches, channels): (measured - simulated) / simulated, masked where simulated is not above black."""
        made = np.ma.masked_less_equal(self.simulated.mean_dn, 0.0)
        return (self.measured.mean_dn - made) / made

    @property
    def relative_noise_difference(self) -> np.ma.MaskedArray[Any, np.dtype[np.float64]]:
        """(patches, channels): `relative_difference` of the standard deviations over pixels."""
        made = np.ma.masked_less_equal(self.simulated.spatial_noise_dn, 0.0)
        return (self.measured.spatial_noise_dn - made) / made

    @property
    def relative_temporal_difference(self) -> np.ma.MaskedArray[Any, np.dtype[np.float64]]:
        """(patches, channels): `relative_difference` of the standard deviations from frame to frame.

        Raises
        ------
        InputError
            If either side has only one frame.
        """
        seen, made = self.measured.temporal_noise_dn, self.simulated.temporal_noise_dn
        if seen is None or made is None:
            raise InputError("noise from frame to frame needs at least two frames on both sides")
        simulated = np.ma.masked_less_equal(made, 0.0)
        return np.ma.asarray((seen - simulated) / simulated)

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
        largest = self._largest(self.relative_difference)
        if largest and not self.tolerance_percent:
            lines.append(f"the largest difference of means is {largest}")
        for test, temporal in ((self.noise, False), (self.temporal_noise, True)):
            if test is not None and test.p_value < self.level / len(self.tests):
                lines.extend(describe_noise_difference(self.measured, self.simulated, self.used, temporal=temporal))
        for name, line in self.regression_by_channel.items():
            if line is None:
                continue
            slope = line.slope_through_origin
            if not slope.lower_95 <= 1.0 <= slope.upper_95:
                lines.append(
                    f"channel {name}: measured is {slope.value:.4f} times simulated "
                    f"({slope.lower_95:.4f} to {slope.upper_95:.4f})"
                )
        one, other = self.exposures_s
        if one is not None and other is not None and one != other:
            lines.append(f"the exposure times differ: measured {one:g} s, simulated {other:g} s")
        return tuple(lines)

    def _describe(self, what: str, test: ChiSquare, difference: np.ma.MaskedArray[Any, np.dtype[np.float64]]) -> str:
        level = self.level / len(self.tests)
        verdict = "agree" if test.p_value >= level else "differ"
        line = (
            f"{what} {verdict}: chi-square {test.statistic:.1f} with {test.degrees_of_freedom} degrees of freedom, "
            f"{test.p_text}, at level {level:.3g}"
        )
        if not self.tolerance_percent:
            return line
        largest = self._largest(difference) or "unknown, because the simulated values are 0"
        return f"{line}; largest difference {largest}, tolerance {self.tolerance_percent:g} % beyond the sampling error"

    def _largest(self, difference: np.ma.MaskedArray[Any, np.dtype[np.float64]]) -> str | None:
        """Return the largest relative difference of the used values as text; None where there are no values."""
        size = np.ma.abs(np.ma.array(difference, mask=~self.used | np.ma.getmaskarray(difference)))
        if not size.count():
            return None
        patch, channel = np.unravel_index(int(size.argmax()), size.shape)
        name, letter = self.measured.names[patch], self.measured.channels[channel]
        return f"{100 * difference[patch, channel]:+.2f} % ({name}, {letter})"

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings for JSON, with None for values that are not finite or masked."""
        return {
            "agrees": self.agrees,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "level": self.level,
            "tolerance_percent": self.tolerance_percent,
            "exposures_s": list(self.exposures_s),
            "patches": list(self.measured.names),
            "channels": list(self.measured.channels),
            "used": self.used.tolist(),
            "measured": _statistics(self.measured),
            "simulated": _statistics(self.simulated),
            "relative_difference": _plain(self.relative_difference),
            "means": asdict(self.means),
            "noise": asdict(self.noise),
            "temporal_noise": None if self.temporal_noise is None else asdict(self.temporal_noise),
            "regression": None if self.regression is None else asdict(self.regression),
            "regression_by_channel": {
                name: None if line is None else asdict(line) for name, line in self.regression_by_channel.items()
            },
            "color": None if self.color is None else _color(self.color),
        }


def _plain(values: NDArray[Any]) -> Any:
    return np.ma.masked_invalid(values).tolist()


def _statistics(found: PatchStatistics) -> dict[str, Any]:
    return {
        "frames": found.frames,
        "pixels": found.pixels.tolist(),
        "mean_dn": _plain(found.mean_dn),
        "standard_error_dn": _plain(found.standard_error_dn),
        "spatial_noise_dn": _plain(found.spatial_noise_dn),
        "spatial_snr_db": _plain(found.spatial_snr_db),
        "temporal_snr_db": None if found.temporal_snr_db is None else _plain(found.temporal_snr_db),
        "saturated_share": _plain(found.saturated_share),
    }


def _color(found: ColorComparison) -> dict[str, Any]:
    return {
        "patches": list(found.names),
        "delta_e_76": found.delta_e_76.tolist(),
        "delta_e_94": found.delta_e_94.tolist(),
        "delta_e_2000": found.delta_e_2000.tolist(),
        "matrix": found.matrix.matrix.tolist(),
        "fit_delta_e_76": found.matrix.delta_e_76.tolist(),
        "fit_delta_e_94": found.matrix.delta_e_94.tolist(),
        "fit_delta_e_2000": found.matrix.delta_e_2000.tolist(),
        "fit_delta_e_76_left_out": found.matrix.delta_e_76_left_out.tolist(),
        "fit_delta_e_94_left_out": found.matrix.delta_e_94_left_out.tolist(),
        "fit_delta_e_2000_left_out": found.matrix.delta_e_2000_left_out.tolist(),
    }
