"""Nonlinearity of the analog-to-digital converter, from how often each code occurs in flat fields.

Noise spreads the signal of a flat field over many codes with a smooth density. A code that occurs more often than its
neighbors is wider: this is the code density (histogram) test of IEEE Std 1241-2010, 4.1.6, with the measured density in
place of that of a sine wave (J. Doernberg, H.-S. Lee and D. A. Hodges, IEEE J. Solid-State Circuits 19 (1984) 820).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.withheld import EFFECT_NOT_MEASURED
from photosite.engine.site_planes import count_numbers
from photosite.errors import InputError
from photosite.sensor.effects.converter_error import ConverterError
from photosite.sensor.model import Sensor
from photosite.values.deferred import Deferred
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain

Array = NDArray[np.float64]

PIXELS = 1 << 25
"""Pixels, over all flat fields, that are counted."""


_METHOD = "code density of flat fields against a smooth one (IEEE 1241), {}"


class Density(NamedTuple):
    """Counts of the codes in one group of flat fields, in two halves of its frames."""

    counts: NDArray[np.int64]  # (2, codes)
    noise_dn: float  # least temporal noise of the channels


class _Codes(NamedTuple):
    """Counts of the codes of ``part`` in one group, and the half width of its moving polynomial."""

    counts: NDArray[np.int64] | Array
    part: slice
    reach: int


class SmoothDensity(NamedTuple):
    """Smooth density of one group over the codes of ``part``, and where it is known."""

    density: Array
    known: NDArray[np.bool_]
    part: slice
    reach: int


LEAST_FRACTION = 0.8
"""Fraction of the codes between the dimmest and the brightest flat field that a sensor file's table must cover."""
_AVERAGED, _AVERAGED_POWERS, _TABLE_TURNS = 4, 9, 4
"""Smooth parts and frequencies over which scatter and powers are averaged, and passes of the table's correction."""


CONVERTER_CODES = DiagnosticKind(
    "unequal-codes",
    "warning",
    "Codes of the converter have different widths.",
    "Dark frames cover few codes. The mean width of these scales read noise, noise of rows and columns, and DSNU; "
    "their errors change the black level and the dark current. The intervals do not contain this.",
    "Raise the gain before the converter, so that dark frames cover more codes. The sensor file has the errors of the "
    "codes that flat fields cover.",
    (
        *("read_noise_*", "row_noise_*", "column_noise_*", "temporal_dark_noise_*", "dsnu*", "*_offset_e"),
        *("black_level_dn", "dark_current_*", "dark_voltage_*", "dcnu_percent"),
        *("sensitivity_threshold_photons", "dynamic_range_db", "responsivity_dn_per_photon"),
    ),
    "relative error of the noise of dark frames, as a standard deviation over the codes",
    "below 1 of 10 000 ideal converters",
)


@dataclass(frozen=True, eq=False)
class ConverterCodes(Finding, Shown):
    """Differential and integral nonlinearity of the converter, without what changes slowly over the codes.

    A slow change of the widths cannot be distinguished from the density of the light. What is smooth is a moving
    polynomial of degree 4 over one standard deviation of the noise to either side, weighted by the densities of the
    groups. `fast_part` takes it off a known error in the same way.

    Parameters
    ----------
    code
        (n,) covered codes.
    dnl_lsb, dnl_uncertainty_lsb
        Width of each code less 1, and its standard uncertainty.
    inl_lsb, inl_uncertainty_lsb
        Error at the upper end of each code: minus the sum of ``dnl_lsb``, its mean 0 in each run of codes. And its
        standard uncertainty.
    smooth_codes
        Number of codes over which the moving polynomial extends, at the level with the most noise.
    dnl_rms_lsb, inl_rms_lsb
        Root mean squares over the covered codes, without noise.
    significant
        Whether there is an error beyond chance.
    white_dn, fraction
        Highest code; fraction of the codes between the dimmest and the brightest flat field that are covered.
    densities
        Densities of the groups over the codes.
    dark_dn
        Standard deviation of the numbers of the dark frames, noise and DSNU; NaN without dark frames.
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
    fraction: float
    densities: tuple[SmoothDensity, ...] = field(repr=False)
    dark_dn: float = math.nan

    def fast_part(self, dnl_lsb: Array) -> tuple[Array, Array]:
        """Return the part of a known error that these flat fields can show, as DNL and INL of the covered codes.

        Parameters
        ----------
        dnl_lsb
            (white_dn + 1,) width less 1 of each code from 0, from another measurement or a simulation.

        Returns
        -------
        dnl_lsb, inl_lsb
            (n,) what this measurement would find of it without noise.

        Raises
        ------
        InputError
            If there is not one width for each code.

        Examples
        --------
        >>> counts = np.random.default_rng(1).multinomial(1 << 18, np.full(600, 1 / 600), size=2)
        >>> found = converter_codes([Density(counts, 30.0)], (100, 500))
        >>> code = np.arange(600)
        >>> fast, slow = (found.fast_part(0.1 * np.sin(2 * np.pi * code / period))[0] for period in (8, 200))
        >>> float(abs(fast).max().round(2)), float(abs(slow).max().round(2))
        (0.1, 0.0)
        """
        if np.shape(dnl_lsb) != (self.white_dn + 1,):
            raise InputError("dnl_lsb", value=np.shape(dnl_lsb), expected=f"an array of shape ({self.white_dn + 1},)")
        found = _fast(np.asarray(dnl_lsb, dtype=np.float64), self.densities)
        covered = np.zeros(len(found), dtype=bool)
        for entry in self.densities:
            covered[entry.part] |= entry.known
        dnl = _fast(np.where(covered, found, 0.0), self.densities)[self.code]
        return dnl, _summed(self.code, dnl)

    @property
    def present(self) -> bool:
        """Whether there is an error beyond chance."""
        return self.significant

    @property
    def dark_scale_error(self) -> float:
        """Relative error of the noise of dark frames over the codes, as a standard deviation, if theirs are like these.

        By Stein's lemma, the covariance of a normal input of standard deviation s with the error of its code is s^2
        times the mean width, less 1, of the codes under the normal density. Sampling noise of the widths is included;
        what changes too slowly over the codes for flat fields to show it is not.
        """
        reach = math.ceil(4.0 * self.dark_dn)
        weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / self.dark_dn) ** 2)
        return float(np.convolve(self.dnl_lsb, weight / weight.sum(), mode="same").std())

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The parameters of dark frames, which cover few codes."""
        if not self.significant or not self.dark_dn > 0.0:
            return ()
        size = self.dark_scale_error
        return (
            CONVERTER_CODES(
                f"the converter's codes differ in width by {self.dnl_rms_lsb.value:.2g} LSB: read noise, DSNU and what "
                f"follows from them, of the few codes that dark frames cover, are off by about {100.0 * size:.1g} % "
                f"(standard deviation over the codes), which their intervals do not contain, and black level and dark "
                f"current by the errors of these codes",
                size,
            ),
        )

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the error for a sensor file, 0 at codes that are not covered.

        None within chance, where fewer codes are covered, or where the errors are smaller than their uncertainty.
        """
        rms, noise = self.inl_rms_lsb.value or 0.0, float(np.sqrt((self.inl_uncertainty_lsb**2).mean()))
        if not self.significant or self.fraction < LEAST_FRACTION or rms < noise:
            return {"converter_error": None}
        upper = np.zeros(self.white_dn + 2)
        upper[self.code + 1] = self.inl_lsb
        error = np.zeros(self.white_dn + 1)
        for _ in range(_TABLE_TURNS):  # the ends of the codes lie halfway between the values of the table
            left = upper.copy()
            left[1:-1] -= 0.5 * (error[:-1] + error[1:])
            error += 0.5 * (left[:-1] + left[1:])
        return {"converter_error": ConverterError(error_lsb=tuple(error.round(4).tolist()))}

    def to_dict(self) -> dict[str, Any]:
        """Return the root mean squares, and the errors by code."""
        return {
            **super().to_dict(),
            "significant": self.significant,
            "smooth_codes": self.smooth_codes,
            "code": self.code.tolist(),
            "dnl_lsb": self.dnl_lsb.round(5).tolist(),
            "inl_lsb": self.inl_lsb.round(5).tolist(),
        }


def measure_converter(reduction: Reduction) -> Deferred[ConverterCodes | Missing]:
    """Return the error of the converter, or why it cannot be estimated.

    Some frames are read again when it is first needed. It is a `FileError` if one has changed since it was calibrated.
    """
    chosen = _chosen(reduction)
    if isinstance(chosen, Missing):
        return Deferred(lambda: chosen)
    frames, levels = reduction.frames, [level.mean for entry in chosen for level in entry.levels]
    each = max(2, -(-PIXELS // (frames.rows * frames.cols * len(chosen))))
    used = {id(frame.source): frame for frame in reduction.used}
    dark = [] if reduction.reference_group is None else reduction.reference_group.levels
    dark_dn = min((math.sqrt(level.variance + level.spatial_variance) for level in dark), default=math.nan)
    counted = [
        (
            [found for source in entry.group.frames if (found := used.get(id(source)))][:each],
            min(math.sqrt(level.variance) for level in entry.levels),
        )
        for entry in chosen
    ]

    def codes() -> ConverterCodes | Missing:
        with FrameReader(frames) as reader:
            densities = [Density(_counts(reader, group), noise) for group, noise in counted]
        found = converter_codes(densities, (min(levels), max(levels)))
        return found if isinstance(found, Missing) else replace(found, dark_dn=dark_dn)

    return Deferred(codes)


def _measure(evidence: Evidence) -> Deferred[ConverterCodes | Missing]:
    return measure_converter(evidence.reduction)


EFFECT = Effect(38, _measure, key="converter", missing="reason")


LEAST_COUNT, LEAST_CODES = 300, 64
"""Mean count of the codes, and number of codes, below which no error of a converter is estimated."""
LEAST_NOISE_DN = 4.0
"""Noise below which the density of a flat field is not smooth over enough codes."""


def _chosen(reduction: Reduction) -> list[GroupStatistics] | Missing:
    """Return the groups whose codes are counted, or why flat fields do not show the error."""
    if any(found is not None for found in (*reduction.steps, *reduction.sums)):
        return EFFECT_NOT_MEASURED.missing(
            "the numbers are not the converter's codes: some are left out, doubled or summed"
        )
    limits = _full_wells(reduction.lights)
    chosen = [entry for entry in reduction.lights if entry.frames > 1 and _smooth(entry, limits)]
    if not chosen:
        return EFFECT_NOT_MEASURED.missing(
            f"no repeated flat field below saturation has {LEAST_NOISE_DN:g} DN of noise or more"
        )
    levels = [level.mean for entry in chosen for level in entry.levels]
    codes = max(levels) - min(levels) + 1.0
    known = reduction.frames.rows * reduction.frames.cols * sum(entry.frames for entry in chosen)
    if known < LEAST_COUNT * max(codes, LEAST_CODES):
        return EFFECT_NOT_MEASURED.missing(
            f"the flat fields have {known:.2g} pixels below saturation, {known / codes:.2g} for each code; "
            f"{LEAST_COUNT} are needed: take more frames"
        )
    return chosen


def _counts(reader: FrameReader, frames: Sequence[UsedFrame]) -> NDArray[np.int64]:
    """Return (2, codes) how often each code occurs in two halves of some frames."""
    found = np.sum(reader.each_in_strips([frame.source for frame in frames], count_numbers), axis=1)
    for frame, total in zip(frames, found @ np.arange(found.shape[1]), strict=True):
        frame.check_total(int(total))
    return np.stack([found[half::2, : reader.white + 1].sum(axis=0) for half in (0, 1)])


OF_WELL = 0.9
"""Part of the signal of full wells up to which a flat field has a smooth density: its brightest pixels are not full."""


def _full_wells(lights: Sequence[GroupStatistics]) -> Sequence[float]:
    """Return for each channel the mean number of full wells, where the variance is no longer the largest; or infinity.

    Numbers at the end of the converter's range are no sign of full wells.
    """
    below = [entry.levels for entry in lights if all(level.high_fraction == 0.0 for level in entry.levels)]
    limits = []
    for levels in zip(*below, strict=True):
        brightest, noisiest = max(level.mean for level in levels), max(levels, key=lambda level: level.variance)
        limits.append(OF_WELL * brightest if noisiest.mean < brightest else math.inf)
    return limits


def _smooth(entry: GroupStatistics, limits: Sequence[float]) -> bool:
    return all(
        level.variance >= LEAST_NOISE_DN**2 and level.high_fraction == 0.0 and level.mean <= limit
        for level, limit in zip(entry.levels, limits, strict=False)
    )


SIGNIFICANT = 5.0
"""Standard uncertainties of the variance of the codes' widths above which there is an error: fewer than 1 of 10 000
ideal converters."""
SMOOTH_DNL_LSB, SMOOTH_INL_LSB = 0.003, 0.005
"""Errors of the smooth density, as standard uncertainties; a smaller error of a converter is not found."""


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
    from scipy.ndimage import uniform_filter1d

    total = np.sum([density.counts.sum(axis=0) for density in densities], axis=0)
    usable = [found for density in densities if (found := _codes(density))]
    both, *single = ([found[i] for found in usable] for i in range(3))
    halves = [_widths(half, len(total)) for half in single]
    covered = np.isfinite(halves[0]) & np.isfinite(halves[1])
    halves = [np.where(covered, half, 0.0) for half in halves]
    smooth = tuple(
        entry._replace(known=entry.known & covered[entry.part])
        for entry in _smooth_densities(both, 0.5 * (halves[0] + halves[1]))
    )
    code = _well_inside(smooth, len(total))
    if len(code) < LEAST_CODES:
        return EFFECT_NOT_MEASURED.missing(
            f"the flat fields cover {len(code)} codes well enough; {LEAST_CODES} are needed"
        )
    first, second = (_fast(half, smooth)[code] for half in halves)
    noise = 0.5 * (first - second)
    spread = np.sqrt(1.0 / np.maximum(total[code], 1))
    spread *= float(np.sqrt((noise**2).mean() / (spread**2).mean()))
    smooth_codes = max(2 * _reach(density.noise_dn) + 1 for density in densities)
    errors = [_summed(code, half) for half in (first, second)]
    # Of the sums: the scatter of the halves, over several of the smooth parts
    sum_uncertainty = np.sqrt(uniform_filter1d(0.25 * (errors[0] - errors[1]) ** 2, _AVERAGED * smooth_codes))
    dnl, inl = (_product(*pair) for pair in ((first, second), errors))
    inside = (code >= levels_dn[0]) & (code <= levels_dn[1])
    return ConverterCodes(
        code=code,
        dnl_lsb=0.5 * (first + second),
        dnl_uncertainty_lsb=np.hypot(spread, SMOOTH_DNL_LSB),
        inl_lsb=0.5 * (errors[0] + errors[1]),
        inl_uncertainty_lsb=np.hypot(sum_uncertainty, SMOOTH_INL_LSB),
        smooth_codes=smooth_codes,
        dnl_rms_lsb=_root(dnl, SMOOTH_DNL_LSB, len(code), "differential nonlinearity"),
        inl_rms_lsb=_root(inl, SMOOTH_INL_LSB, len(code) / smooth_codes, "integral nonlinearity"),
        significant=dnl.value > SIGNIFICANT * dnl.standard_uncertainty + SMOOTH_DNL_LSB**2,
        white_dn=len(total) - 1,
        fraction=float(inside.sum()) / max(levels_dn[1] - levels_dn[0] + 1.0, 1.0),
        densities=smooth,
    )


_WIDTH, _DEGREE, _ROUNDS = 1.0, 4, 8
"""Half width of the moving polynomial in standard deviations of the noise, its degree, and rounds of the smoothing."""


def _reach(noise_dn: float) -> int:
    return round(_WIDTH * noise_dn)


def _codes(density: Density) -> tuple[_Codes, _Codes, _Codes] | None:
    """Return the counts of both halves together and of each; None where the codes are too few for the polynomial."""
    reach = _reach(density.noise_dn)
    total = density.counts.sum(axis=0)
    inside = np.flatnonzero(total)
    if len(inside) == 0:
        return None
    part = slice(max(inside[0] - reach, 0), min(inside[-1] + reach + 1, len(total)))
    if part.stop - part.start <= 2 * reach:
        return None
    total, first, second = (_Codes(counts[part], part, reach) for counts in (total, *density.counts))
    return total, first, second


def _widths(groups: Sequence[_Codes], size: int) -> Array:
    """Return the width of each code less 1, NaN where too few pixels have it."""
    widths, densities = _rounds(groups, size)
    if not len(code := np.flatnonzero(np.isfinite(widths))):
        return widths
    fast = _fast(np.nan_to_num(widths), densities)[code]
    center = np.zeros(size)
    center[code] = _summed(code, fast) + 0.5 * fast
    moved = [_without_move(group, smooth, center) for group, smooth in zip(groups, densities, strict=True)]
    return _rounds(moved, size)[0]


def _without_move(group: _Codes, smooth: SmoothDensity, center: Array) -> _Codes:
    """Return the counts if each code had the density at its number, not that at the input that its error leads to."""
    slope = _moving(smooth.density, group.reach, slope=True) / np.maximum(smooth.density, 1.0)
    return group._replace(counts=group.counts / np.where(smooth.known, 1.0 - slope * center[group.part], 1.0))


def _rounds(groups: Sequence[_Codes], size: int) -> tuple[Array, list[SmoothDensity]]:
    widths = np.zeros(size)
    for _ in range(_ROUNDS):
        seen, expected = np.zeros(size), np.zeros(size)
        densities = _smooth_densities(groups, widths)
        for group, smooth in zip(groups, densities, strict=True):
            seen[group.part] += np.where(smooth.known, group.counts, 0.0)
            expected[group.part] += np.where(smooth.known, smooth.density, 0.0)
        widths = np.where(expected > 0.0, seen / np.maximum(expected, 1.0) - 1.0, 0.0)
        widths = np.maximum(widths, -0.9)
    return np.where(expected > 0.0, widths, np.nan), densities


_EXPECTED, _PEAK_FRACTION = 25.0, 0.1
"""Count, and fraction of the peak of the counts, from which a polynomial follows a density."""


def _smooth_densities(groups: Sequence[_Codes], widths: Array) -> list[SmoothDensity]:
    from scipy.ndimage import maximum_filter1d

    found = []
    for counts, part, reach in groups:
        density = _moving(counts / (1.0 + widths[part]), reach)
        # Whole windows only, and not the tails, where a polynomial does not follow the density
        peak = maximum_filter1d(density, 8 * reach + 1)
        known = (density >= _EXPECTED) & (density >= _PEAK_FRACTION * peak)
        known[:reach] = known[-reach:] = False
        found.append(SmoothDensity(density, known, part, reach))
    return found


def _moving(values: Array, reach: int, *, slope: bool = False) -> Array:
    """Return the moving polynomial at its center, or its slope there, which hold where the window is whole."""
    return np.convolve(values, _coefficients(reach, slope), mode="same")


@lru_cache(maxsize=64)
def _coefficients(reach: int, slope: bool) -> Array:
    from scipy.signal import savgol_coeffs  # takes 0.3 s to import

    return np.asarray(savgol_coeffs(2 * reach + 1, _DEGREE, deriv=int(slope)))


def _fast(widths: Array, densities: Sequence[SmoothDensity]) -> Array:
    """Return the widths without what the rounds of `_widths` take for a change of the density.

    A round subtracts the moving polynomial of what earlier rounds left: after n rounds, its n-th power is
    missing.
    """
    slow = widths
    for _ in range(_ROUNDS):
        above, below = np.zeros_like(widths), np.zeros_like(widths)
        for density, known, part, reach in densities:
            moving = _moving(density * slow[part], reach)
            above[part] += np.where(known, moving, 0.0)
            below[part] += np.where(known, density, 0.0)
        slow = np.where(below > 0.0, above / np.maximum(below, 1.0), widths)  # not known outside
    return widths - slow


def _well_inside(densities: Sequence[SmoothDensity], size: int) -> NDArray[np.int64]:
    """Return the codes whose moving polynomial, in at least one group, extends over codes of known density alone."""
    from scipy.ndimage import minimum_filter1d

    found = np.zeros(size, dtype=bool)
    for _, known, part, reach in densities:
        found[part] |= minimum_filter1d(known, 2 * reach + 1)
    return np.flatnonzero(found)


def _summed(code: NDArray[np.int64], widths: Array) -> Array:
    """Return the error at the upper end of each code, its mean 0 in each run of codes."""
    parts = [-np.cumsum(run) for run in np.split(widths, np.flatnonzero(np.diff(code) > 1) + 1)]
    return np.concatenate([part - part.mean() for part in parts])


def _product(first: Array, second: Array) -> Uncertain:
    """Return the mean product of two estimates with independent noise: the variance of what they share.

    Its uncertainty adds over frequencies, because what they share and their noise are both largest at the slow ones.
    """
    from scipy.ndimage import uniform_filter1d

    one, other = np.fft.rfft(first), np.fft.rfft(second)
    shared, noise = (
        uniform_filter1d(power, _AVERAGED_POWERS)
        for power in ((one * other.conj()).real, np.abs(one - other) ** 2 / 2.0)
    )
    variance = 2.0 * float((2.0 * np.maximum(shared, 0.0) * noise + noise**2).sum())
    return Uncertain.of(float((first * second).mean()), math.sqrt(variance) / len(first) ** 2)


def _root(variance: Uncertain, smooth_lsb: float, independent: float, what: str) -> Estimate:
    """Return the square root of a variance to which the errors of the smooth density add their square and product."""
    product = 2.0 * math.sqrt(max(variance.value, 0.0) / independent) * smooth_lsb
    return Estimate.of_variance(
        variance + Uncertain.of(0.0, smooth_lsb**2) + Uncertain.of(0.0, product), _METHOD.format(what)
    )
