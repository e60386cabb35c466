"""Nonlinearity of the analog-to-digital converter, from how often each code occurs in flat fields.

Noise spreads the signal of a flat field over many codes with a smooth density. A code that occurs more often than its
neighbors is wider: this is the code density (histogram) test of IEEE Std 1241-2010, 4.1.6, with the measured density in
place of that of a sine wave (J. Doernberg, H.-S. Lee and D. A. Hodges, IEEE J. Solid-State Circuits 19 (1984) 820).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.signal import savgol_filter

from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.reduction.reduce import Reduction
from photosite.engine.site_planes import count_numbers
from photosite.sensor.effects.converter_error import ConverterError
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain

Array = NDArray[np.float64]

PIXELS = 1 << 25
"""Pixels, over all flat fields, that are counted."""

LEAST_COUNT, LEAST_CODES = 300, 64
"""Mean count of the codes, and number of codes, below which nothing is told of a converter."""

LEAST_NOISE_DN = 4.0
"""Noise below which the density of a flat field is not smooth over enough codes."""

SIGNIFICANT = 5.0
"""Standard uncertainties of the variance of the codes' widths above which there is an error: fewer than 1 of 10 000
ideal converters."""

SMOOTH_DNL_LSB, SMOOTH_INL_LSB = 0.003, 0.02
"""Errors of the smooth density, as standard uncertainties: those of exact counts of an ideal converter are below. A
smaller error of a converter is not found. They are too small for widths that err independently of each other."""

LEAST_SHARE = 0.8
"""Share of the codes between the dimmest and the brightest flat field that a sensor file's table must cover."""

_WIDTH, _DEGREE, _ROUNDS = 1.0, 4, 8
_EXPECTED, _OF_PEAK, _AVERAGED = 25.0, 0.1, 4
_METHOD = "code density of flat fields against a smooth one (IEEE 1241), {}"


class Density(NamedTuple):
    """Counts of the codes in one group of flat fields, in two halves of its frames."""

    counts: NDArray[np.int64]  # (2, codes)
    noise_dn: float  # least temporal noise of the channels


@dataclass(frozen=True, eq=False)
class ConverterCodes(Shown):
    """Differential and integral nonlinearity of the converter, without what changes slowly over the codes.

    Parameters
    ----------
    code
        (n,) covered codes.
    dnl_lsb, dnl_uncertainty_lsb
        Width of each code less 1, and its standard uncertainty.
    inl_lsb, inl_uncertainty_lsb
        Error of the codes, from the sum of the widths up to each, and its standard uncertainty.
    smooth_codes
        Number of codes over which a slower error cannot be distinguished from the density of the light.
    dnl_rms_lsb, inl_rms_lsb
        Root mean squares over the covered codes, noise taken off.
    significant
        Whether there is an error beyond chance.
    white_dn, share
        Highest code; share of the codes between the dimmest and the brightest flat field that are covered.
    """

    code: NDArray[np.int64]
    dnl_lsb: Array
    dnl_uncertainty_lsb: Array
    inl_lsb: Array
    inl_uncertainty_lsb: Array
    smooth_codes: int
    dnl_rms_lsb: Estimate
    inl_rms_lsb: Estimate
    significant: bool
    white_dn: int
    share: float

    def section(self) -> ConverterError | None:
        """Return the error for a sensor file, 0 at codes that are not covered.

        None within chance, where fewer codes are covered, or where the errors are smaller than their uncertainty.
        """
        rms, noise = self.inl_rms_lsb.value or 0.0, float(np.sqrt((self.inl_uncertainty_lsb**2).mean()))
        if not self.significant or self.share < LEAST_SHARE or rms < noise:
            return None
        error = np.zeros(self.white_dn + 2)
        error[self.code + 1] = self.inl_lsb  # at the upper end of each code
        return ConverterError(error_lsb=tuple((0.5 * (error[:-1] + error[1:])).round(4).tolist()))

    def to_dict(self) -> dict[str, Any]:
        """Return the root mean squares, and the errors by code."""
        return {
            "dnl_rms_lsb": self.dnl_rms_lsb.to_dict(),
            "inl_rms_lsb": self.inl_rms_lsb.to_dict(),
            "significant": self.significant,
            "smooth_codes": self.smooth_codes,
            "code": self.code.tolist(),
            "dnl_lsb": self.dnl_lsb.round(5).tolist(),
            "inl_lsb": self.inl_lsb.round(5).tolist(),
        }


def measure_converter(reduction: Reduction, reader: FrameReader) -> ConverterCodes | Missing:
    """Return the error of the converter, or why the flat fields do not tell it; some frames are read again."""
    if any(found is not None for found in (*reduction.steps, *reduction.sums)):
        return Missing("the numbers are not the converter's codes: some are left out, doubled or summed")
    chosen = [entry for entry in reduction.lights if entry.frames > 1 and _smooth(entry)]
    if not chosen:
        return Missing(f"no repeated flat field below saturation has {LEAST_NOISE_DN:g} DN of noise or more")
    pixels = reduction.frames.rows * reduction.frames.cols
    levels = [level.mean for entry in chosen for level in entry.levels]
    codes = max(levels) - min(levels) + 1.0
    known = pixels * sum(entry.frames for entry in chosen)
    if known < LEAST_COUNT * max(codes, LEAST_CODES):
        return Missing(
            f"the flat fields have {known:.2g} pixels below saturation, {known / codes:.2g} for each code; "
            f"{LEAST_COUNT} are needed: take more frames"
        )
    each = max(2, -(-PIXELS // (pixels * len(chosen))))
    reader.expect(sum(min(each, entry.frames) for entry in chosen))
    densities = []
    for entry in chosen:
        found = np.array(reader.each(reader.used_sources(entry.group)[:each], count_numbers))[:, : reader.white + 1]
        counts = np.stack([found[half::2].sum(axis=0) for half in (0, 1)])
        densities.append(Density(counts, min(math.sqrt(level.variance) for level in entry.levels)))
    return converter_codes(densities, (min(levels), max(levels)))


def _smooth(entry: GroupStatistics) -> bool:
    return all(level.variance >= LEAST_NOISE_DN**2 and level.high_fraction == 0.0 for level in entry.levels)


def converter_codes(densities: Sequence[Density], levels_dn: tuple[float, float]) -> ConverterCodes | Missing:
    """Return the error of the converter from the counts of the codes in each group of flat fields.

    Each group's smooth density is a moving polynomial of the counts over the codes' widths, found in turns with these.
    The widths of two halves of the frames have independent noise: their mean product is the variance without it.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> even_are_wide = lambda x: 2 * np.floor(x / 2) + (x % 2 >= 1.1)
    >>> counts = [np.bincount(even_are_wide(rng.normal(300, 30, 1 << 18)).astype(int), minlength=600) for _ in "ab"]
    >>> found = converter_codes([Density(np.array(counts), 30.0)], (300, 300))
    >>> round(found.dnl_rms_lsb.value, 1), found.significant
    (0.1, True)
    """
    halves = [_widths([(density.counts[half], density.noise_dn) for density in densities]) for half in (0, 1)]
    total = sum(density.counts.sum(axis=0) for density in densities)
    covered = np.isfinite(halves[0]) & np.isfinite(halves[1])
    code = np.flatnonzero(covered)
    if len(code) < LEAST_CODES:
        return Missing(f"the flat fields cover {len(code)} codes well enough; {LEAST_CODES} are needed")
    first, second = (half[covered] for half in halves)
    noise = 0.5 * (first - second)
    spread = np.sqrt(1.0 / total[covered])
    spread *= float(np.sqrt((noise**2).mean() / (spread**2).mean()))
    smooth_codes = max(2 * _reach(density.noise_dn) + 1 for density in densities)
    errors = [_summed(code, half, smooth_codes) for half in (first, second)]
    # Of the sums: the scatter of the halves, over several of the smooth parts
    of_sums = np.sqrt(uniform_filter1d(0.25 * (errors[0] - errors[1]) ** 2, _AVERAGED * smooth_codes))
    dnl, inl = (_product(*pair) for pair in ((first, second), errors))
    inside = (code >= levels_dn[0]) & (code <= levels_dn[1])
    return ConverterCodes(
        code=code,
        dnl_lsb=0.5 * (first + second),
        dnl_uncertainty_lsb=np.hypot(spread, SMOOTH_DNL_LSB),
        inl_lsb=0.5 * (errors[0] + errors[1]),
        inl_uncertainty_lsb=np.hypot(of_sums, SMOOTH_INL_LSB),
        smooth_codes=smooth_codes,
        dnl_rms_lsb=_root(dnl, SMOOTH_DNL_LSB, "differential nonlinearity"),
        inl_rms_lsb=_root(inl, SMOOTH_INL_LSB, "integral nonlinearity"),
        significant=dnl.value > SIGNIFICANT * dnl.standard_uncertainty + SMOOTH_DNL_LSB**2,
        white_dn=len(total) - 1,
        share=float(inside.sum()) / max(levels_dn[1] - levels_dn[0] + 1.0, 1.0),
    )


def _reach(noise_dn: float) -> int:
    return round(_WIDTH * noise_dn)


def _widths(groups: Sequence[tuple[NDArray[np.int64], float]]) -> Array:
    """Return the width of each code less 1, NaN where too few pixels have it."""
    size = len(groups[0][0])
    widths = np.zeros(size)
    for _ in range(_ROUNDS):
        seen, expected = np.zeros(size), np.zeros(size)
        for counts, noise_dn in groups:
            reach = _reach(noise_dn)
            inside = np.flatnonzero(counts)
            low, high = max(inside[0] - reach, 0), min(inside[-1] + reach + 1, size)
            if high - low <= 2 * reach:
                continue
            part = slice(low, high)
            smooth = savgol_filter(counts[part] / (1.0 + widths[part]), 2 * reach + 1, _DEGREE)
            # Whole windows only, and not the tails, where a polynomial does not follow the density
            peak = maximum_filter1d(smooth, 8 * reach + 1)
            often = (smooth >= _EXPECTED) & (smooth >= _OF_PEAK * peak)
            often[:reach] = often[-reach:] = False
            seen[part] += np.where(often, counts[part], 0.0)
            expected[part] += np.where(often, smooth, 0.0)
        widths = np.where(expected > 0.0, seen / np.maximum(expected, 1.0) - 1.0, 0.0)
        widths = np.maximum(widths, -0.9)
    return np.where(expected > 0.0, widths, np.nan)


def _summed(code: NDArray[np.int64], widths: Array, smooth_codes: int) -> Array:
    """Return the error at the upper end of each code, without its mean over the codes around it, in each run of codes.

    The sum of small errors of the smooth density would grow over a long run.
    """
    parts = []
    for run in np.split(widths, np.flatnonzero(np.diff(code) > 1) + 1):
        total = -np.cumsum(run - run.mean())
        parts.append(total - uniform_filter1d(total, 2 * smooth_codes + 1, mode="reflect"))
    return np.concatenate(parts)


def _product(first: Array, second: Array) -> Uncertain:
    """Return the mean product of two estimates with independent noise: the variance of what they share."""
    noise = float(((first - second) ** 2).mean()) / 2.0
    value, n = float((first * second).mean()), _independent(first - second)
    return Uncertain.of(value, math.sqrt((2.0 * max(value, 0.0) * noise + noise**2) / n))


def _independent(noise: Array) -> float:
    """Return the number of independent values: fewer than there are where neighbors are alike."""
    left = noise - noise.mean()
    power = np.abs(np.fft.rfft(left)) ** 2
    return float(power.sum() ** 2 / (power**2).sum())


def _root(variance: Uncertain, smooth_lsb: float, what: str) -> Estimate:
    return Estimate.of_variance(variance + Uncertain.of(0.0, smooth_lsb**2), _METHOD.format(what))
