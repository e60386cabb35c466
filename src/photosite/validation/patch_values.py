"""Patch values of another simulator against a reference: differences, regressions and a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError, did_you_mean
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import (
    ChiSquare,
    RelativeDifference,
    check_verdict_settings,
    chi_square,
    compared,
    dict_or_none,
    largest,
    relative_difference,
)
from photosite.validation.regression import regressions
from photosite.validation.result import PatchDifferences, compare_colors
from photosite.values.choice import check_choice
from photosite.values.shown import Shown

Unit = Literal["e", "dn"]
UNITS: dict[Unit, str] = {"e": "electrons", "dn": "DN above black"}


@dataclass(frozen=True, eq=False)
class PatchValues(Shown):
    """Mean values of a chart's patches, as a tool gives them.

    Parameters
    ----------
    names, channels
        Patch and channel names, without repeats.
    unit
        "e" for electrons, "dn" for digital numbers above black.
    mean, standard_error, saturated
        (patches, channels) mean, its standard error (0 where it is exact), and whether it cannot be compared.

    Raises
    ------
    InputError
        If a name is repeated, shapes do not match, a value is not finite or a standard error is negative.

    Examples
    --------
    >>> PatchValues.exact(("white", "black"), ("M",), "e", [[3000.0], [100.0]]).standard_error.tolist()
    [[0.0], [0.0]]
    """

    names: tuple[str, ...]
    channels: tuple[str, ...]
    unit: Unit
    mean: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    saturated: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for what, listed in (("patch", self.names), ("channel", self.channels)):
            if twice := [name for name in listed if listed.count(name) > 1]:
                raise InputError(f"{what} names", value=twice[0], expected="without repeats")
        check_choice("unit", self.unit, Unit)
        shape = (len(self.names), len(self.channels))
        mean, error = (np.asarray(values, dtype=np.float64) for values in (self.mean, self.standard_error))
        lost = np.asarray(self.saturated, dtype=np.bool_)
        if not mean.shape == error.shape == lost.shape == shape or 0 in shape:
            raise InputError("mean", value=mean.shape, expected=f"of shape {shape}, patches by channels")
        for what, expected, values, wrong in (
            ("mean", "finite", mean, ~np.isfinite(mean)),
            ("standard_error", "0 or more", error, ~(error >= 0)),
        ):
            if wrong.any():
                patch, channel = np.argwhere(wrong)[0]
                place = f"patch '{self.names[patch]}', channel {self.channels[channel]}"
                raise InputError(what, where=place, value=values[patch, channel], expected=expected)
        for name, value in (("mean", mean), ("standard_error", error), ("saturated", lost)):
            object.__setattr__(self, name, value)

    @classmethod
    def exact(cls, names: tuple[str, ...], channels: tuple[str, ...], unit: Unit, mean: ArrayLike) -> PatchValues:
        """Return values without noise and saturation."""
        values = np.asarray(mean, dtype=np.float64)
        return cls(names, channels, unit, values, np.zeros_like(values), np.zeros_like(values, dtype=np.bool_))

    @classmethod
    def from_statistics(cls, found: PatchStatistics) -> PatchValues:
        """Return the means of patches of raw frames, in DN above black."""
        return cls(found.names, found.channels, "dn", found.mean_dn, found.standard_error_dn, found.saturated)


@dataclass(frozen=True, eq=False, kw_only=True)
class PatchComparison(PatchDifferences):
    """Patch values of another tool against a reference: photosite's simulation or a second file.

    Parameters
    ----------
    other, reference
        The values, with the same patches and channels in the same order.
    beyond
        Number of values without a standard error that differ by more than the tolerance.
    means
        Chi-square of the excess over the tolerance, of values with a standard error; None without such values.
    """

    other: PatchValues
    reference: PatchValues
    beyond: int
    means: ChiSquare | None

    @property
    def agrees(self) -> bool:
        """Whether exact values agree within the tolerance, and others within the tolerance and their noise."""
        return self.beyond == 0 and (self.means is None or self.means.p_value >= self.level)

    @property
    def relative_difference(self) -> RelativeDifference:
        """(patches, channels): (other - reference) / reference, masked where the reference is not above 0."""
        return relative_difference(self.other.mean, self.reference.mean)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons for the verdict: the largest difference, the tests and the regressions."""
        allowed = f"allowed {self.tolerance_percent:g} %"
        lines = [f"largest difference {self._largest()}; {allowed}"]
        if self.beyond:
            exact = int((self.used & ~_noisy(self.other, self.reference)).sum())
            lines.append(f"{self.beyond} of {exact} values without noise differ by more than the tolerance")
        if self.means is not None:
            lines.append(
                f"beyond the tolerance, chi-square {self.means.statistic:.1f} with {self.means.degrees_of_freedom} "
                f"values that have noise, {self.means.p_text}, at level {self.level:.3g}"
            )
        if self.regression is not None:
            slope, intercept = self.regression.slope, self.regression.intercept
            unit = UNITS[self.other.unit]
            lines.append(
                f"all channels: other = {slope.value:.8g} ({slope.lower_95:.8g} to {slope.upper_95:.8g}) x reference "
                f"{intercept.value:+.3g} ({intercept.lower_95:.3g} to {intercept.upper_95:.3g}) {unit}"
            )
        ratios = {name: line.slope_through_origin for name, line in self.regression_by_channel.items() if line}
        lines += [
            f"channel {name}: other is {ratio.value:.8g} of reference ({ratio.lower_95:.8g} to {ratio.upper_95:.8g})"
            for name, ratio in ratios.items()
        ]
        return tuple(lines)

    def _largest(self) -> str:
        difference = self.relative_difference
        if (at := largest(difference, self.used)) is None:
            return "unknown, because the reference is nowhere above 0"
        return f"{100 * float(difference[at]):+.3g} % ({self.other.names[at[0]]}, {self.other.channels[at[1]]})"

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings for JSON, with None for masked values."""
        sides = {"other": self.other, "reference": self.reference}
        return super().to_dict() | {
            "unit": self.other.unit,
            "patches": list(self.other.names),
            "channels": list(self.other.channels),
            **{k: {"mean": v.mean.tolist(), "standard_error": v.standard_error.tolist()} for k, v in sides.items()},
            "relative_difference": self.relative_difference.tolist(),
            "beyond": self.beyond,
            "means": dict_or_none(self.means),
            "delta_e_2000": None if self.color is None else self.color.delta_e_2000.tolist(),
        }


def compare_values(
    other: PatchValues, reference: PatchValues, *, tolerance_percent: float = 0.1, level: float = 0.05
) -> PatchComparison:
    """Compare another tool's patch values with a reference.

    Values without noise agree where they differ by no more than the tolerance. For values with standard errors, the
    excess over the tolerance in units of the standard error gives a chi-square.

    Parameters
    ----------
    other
        Values of the tool.
    reference
        Values of photosite's simulation or of another file. Patches and channels are matched by name.
    tolerance_percent
        Relative tolerance in percent.
    level
        False-alarm rate where values have standard errors.

    Raises
    ------
    InputError
        If units differ, the reference lacks a patch or channel, every patch is saturated, or the level or tolerance is
        invalid.

    Notes
    -----
    Regressions are weighted by the standard errors, or without them as for shot noise. Their intervals come
    from the scatter (`photosite.validation.regression`). Standard errors are treated as known: those of mosaics come
    from many pixels.

    Examples
    --------
    >>> names = ("white", "gray", "black")
    >>> made = PatchValues.exact(names, ("M",), "e", [[3000.0], [900.0], [100.0]])
    >>> other = PatchValues.exact(names, ("M",), "e", [[3030.0], [909.0], [101.0]])
    >>> result = compare_values(other, made)
    >>> result.agrees, result.reasons[0], round(result.regression.slope.value, 9)
    (False, 'largest difference +1 % (white, M); allowed 0.1 %', 1.01)
    """
    check_verdict_settings(level, tolerance_percent)
    notes: list[str] = []
    other, reference = _matched(other, reference, notes)
    used = compared(other.saturated | reference.saturated, other.names, other.channels, notes)
    excess = np.abs(other.mean - reference.mean) - tolerance_percent / 100 * np.abs(reference.mean)
    # Differences in the last bit are rounding: 3030 and 1.01 x 3000 agree within 1 %.
    excess = np.where(excess > 1e-12 * np.abs(reference.mean), excess, 0.0)
    noisy = _noisy(other, reference)
    error = np.hypot(other.standard_error, reference.standard_error)[used & noisy]
    try:
        true_xyz = chart_xyz_d65("macbeth", other.names)
    except InputError:
        true_xyz = None
    color = compare_colors(other.names, other.channels, (other.mean, reference.mean), used, true_xyz, notes)
    variance = other.standard_error**2 + reference.standard_error**2
    regression, by_channel = regressions(reference.mean, other.mean, variance, used, other.channels, notes)
    return PatchComparison(
        level=level,
        tolerance_percent=tolerance_percent,
        other=other,
        reference=reference,
        used=used,
        beyond=int((used & ~noisy & (excess > 0)).sum()),
        means=chi_square((excess[used & noisy] / error) ** 2) if error.size else None,
        regression=regression,
        regression_by_channel=by_channel,
        color=color,
        notes=tuple(notes),
    )


def _noisy(other: PatchValues, reference: PatchValues) -> NDArray[np.bool_]:
    return np.asarray((other.standard_error > 0) | (reference.standard_error > 0), dtype=np.bool_)


def _matched(other: PatchValues, reference: PatchValues, notes: list[str]) -> tuple[PatchValues, PatchValues]:
    """Return both with their common patches and channels, in the order of the reference."""
    if other.unit != reference.unit:
        raise InputError("unit", value=UNITS[other.unit], expected=f"that of the reference, {UNITS[reference.unit]}")
    shared = {}
    both = {"patch": (other.names, reference.names), "channel": (other.channels, reference.channels)}
    for what, (mine, theirs) in both.items():
        if unknown := [name for name in mine if name not in theirs]:
            raise InputError(f"the reference has no {what} '{unknown[0]}'", hint=did_you_mean(unknown[0], theirs))
        if absent := [name for name in theirs if name not in mine]:
            several = {"patch": "patches"}.get(what, f"{what}s")
            notes.append(f"not compared, because the values lack them: {several} {', '.join(absent)}")
        shared[what] = [name for name in theirs if name in mine]
    patches, channels = shared["patch"], shared["channel"]
    return _selected(other, patches, channels), _selected(reference, patches, channels)


def _selected(values: PatchValues, names: list[str], channels: list[str]) -> PatchValues:
    at = np.ix_([values.names.index(name) for name in names], [values.channels.index(name) for name in channels])
    return PatchValues(
        tuple(names), tuple(channels), values.unit, values.mean[at], values.standard_error[at], values.saturated[at]
    )
