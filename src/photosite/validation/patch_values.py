"""Patch values of another simulator against a reference: differences, regressions and a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError, did_you_mean
from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import ChiSquare, check_verdict_settings
from photosite.validation.charts import chart_xyz_d65
from photosite.validation.color import ColorComparison, compare_patch_colors
from photosite.validation.regression import Regression, regress

Unit = Literal["e", "dn"]
UNITS: dict[Unit, str] = {"e": "electrons", "dn": "DN above black"}


@dataclass(frozen=True, eq=False)
class PatchValues:
    """Mean values of a chart's patches, as a tool gives them.

    Parameters
    ----------
    names
        Patch names, without repeats.
    channels
        Channel names, without repeats.
    unit
        "e" for electrons, "dn" for digital numbers above black.
    mean
        (patches, channels).
    standard_error
        (patches, channels) standard error of `mean`; 0 where it is exact.
    saturated
        (patches, channels), true where the value cannot be compared.

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
            if twice := [name for name in dict.fromkeys(listed) if listed.count(name) > 1]:
                raise InputError(f"{what} names", value=twice[0], expected="without repeats")
        if self.unit not in UNITS:
            raise InputError("unit", value=self.unit, expected="'e' (electrons) or 'dn' (DN above black)")
        shape = (len(self.names), len(self.channels))
        mean = np.asarray(self.mean, dtype=np.float64)
        error = np.asarray(self.standard_error, dtype=np.float64)
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


@dataclass(frozen=True, eq=False)
class PatchComparison:
    """Patch values of another tool against a reference: photosite's simulation or a second file.

    Parameters
    ----------
    level
        False-alarm rate of the verdict, where values have standard errors.
    tolerance_percent
        Relative tolerance in percent.
    other, reference
        The values, with the same patches and channels in the same order.
    used
        (patches, channels), false where either is saturated.
    beyond
        Number of values without a standard error that differ by more than the tolerance.
    means
        Chi-square of the excess over the tolerance, of values with a standard error; None where there are none.
    regression, regression_by_channel
        Regression of other on reference; None with fewer than three distinct points.
    color
        Colour differences, or None; `notes` says why.
    notes
        What was left out and why.
    """

    level: float
    tolerance_percent: float
    other: PatchValues
    reference: PatchValues
    used: NDArray[np.bool_]
    beyond: int
    means: ChiSquare | None
    regression: Regression | None
    regression_by_channel: Mapping[str, Regression | None]
    color: ColorComparison | None
    notes: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether exact values agree within the tolerance, and others within the tolerance and their noise."""
        return self.beyond == 0 and (self.means is None or self.means.p_value >= self.level)

    @property
    def relative_difference(self) -> np.ma.MaskedArray[Any, np.dtype[np.float64]]:
        """(patches, channels): (other - reference) / reference, masked where the reference is not above 0."""
        base = np.ma.masked_less_equal(self.reference.mean, 0.0)
        return (self.other.mean - base) / base

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
        for name, line in self.regression_by_channel.items():
            if line is not None:
                ratio = line.slope_through_origin
                lines.append(
                    f"channel {name}: other is {ratio.value:.8g} of reference "
                    f"({ratio.lower_95:.8g} to {ratio.upper_95:.8g})"
                )
        return tuple(lines)

    def _largest(self) -> str:
        difference = self.relative_difference
        size = np.ma.abs(np.ma.array(difference, mask=~self.used | np.ma.getmaskarray(difference)))
        if not size.count():
            return "unknown, because the reference is nowhere above 0"
        patch, channel = np.unravel_index(int(size.argmax()), size.shape)
        percent = 100 * float(difference[patch, channel])
        return f"{percent:+.3g} % ({self.other.names[patch]}, {self.other.channels[channel]})"

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings for JSON, with None for masked values."""
        lines = self.regression_by_channel.items()
        return {
            "agrees": self.agrees,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "level": self.level,
            "tolerance_percent": self.tolerance_percent,
            "unit": self.other.unit,
            "patches": list(self.other.names),
            "channels": list(self.other.channels),
            "used": self.used.tolist(),
            "other": {"mean": self.other.mean.tolist(), "standard_error": self.other.standard_error.tolist()},
            "reference": {
                "mean": self.reference.mean.tolist(),
                "standard_error": self.reference.standard_error.tolist(),
            },
            "relative_difference": self.relative_difference.tolist(),
            "beyond": self.beyond,
            "means": None if self.means is None else asdict(self.means),
            "regression": None if self.regression is None else asdict(self.regression),
            "regression_by_channel": {name: None if line is None else asdict(line) for name, line in lines},
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
    Regressions are weighted by the standard errors, or as for shot noise where there are none. Their intervals come
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
    used = ~(other.saturated | reference.saturated)
    if not used.any():
        raise InputError("every patch is saturated", hint="Use a shorter exposure time")
    if not used.all():
        lost = [f"{other.names[p]} ({other.channels[c]})" for p, c in np.argwhere(~used)]
        notes.append(f"left out as saturated: {', '.join(lost)}")
    excess = np.abs(other.mean - reference.mean) - tolerance_percent / 100 * np.abs(reference.mean)
    # Differences in the last bit are rounding: 3030 and 1.01 x 3000 agree within 1 %.
    excess = np.where(excess > 1e-12 * np.abs(reference.mean), excess, 0.0)
    noisy = _noisy(other, reference)
    color, no_color = _compare_colors(other, reference, used)
    if no_color is not None:
        notes.append(no_color)
    return PatchComparison(
        level=level,
        tolerance_percent=tolerance_percent,
        other=other,
        reference=reference,
        used=used,
        beyond=int((used & ~noisy & (excess > 0)).sum()),
        means=_chi_square(other, reference, used & noisy, excess),
        regression=_line(other, reference, used, "all channels", notes),
        regression_by_channel={
            name: _line(other, reference, used & (np.arange(used.shape[1]) == k), f"channel {name}", notes)
            for k, name in enumerate(other.channels)
        },
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
    for what, mine, theirs in (
        ("patch", other.names, reference.names),
        ("channel", other.channels, reference.channels),
    ):
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


def _chi_square(
    other: PatchValues, reference: PatchValues, which: NDArray[np.bool_], excess: NDArray[np.float64]
) -> ChiSquare | None:
    from scipy.stats import chi2

    if not which.any():
        return None
    error = np.hypot(other.standard_error[which], reference.standard_error[which])
    total, freedom = float(np.sum((excess[which] / error) ** 2)), int(which.sum())
    return ChiSquare(total, freedom, float(chi2.sf(total, freedom)))


def _line(
    other: PatchValues, reference: PatchValues, which: NDArray[np.bool_], what: str, notes: list[str]
) -> Regression | None:
    errors = other.standard_error**2 + reference.standard_error**2
    if (errors[which] > 0).all():
        variance = errors
    else:
        variance, which = reference.mean, which & (reference.mean > 0)
    if which.sum() < 3 or np.ptp(reference.mean[which]) == 0:
        notes.append(f"no regression of {what}: it needs three different patches above 0")
        return None
    return regress(reference.mean[which], other.mean[which], variance[which])


def _compare_colors(
    other: PatchValues, reference: PatchValues, used: NDArray[np.bool_]
) -> tuple[ColorComparison | None, str | None]:
    try:
        true = chart_xyz_d65("macbeth", other.names)
    except InputError:
        true = None
    return compare_patch_colors(other.names, other.channels, (other.mean, reference.mean), used, true)
