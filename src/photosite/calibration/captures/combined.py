"""Calibration of a sensor with several captures from its combined frames alone.

Frames in which capture k is used have the numbers y = K_k n_k above black, with n_k its electrons and K_k the output
per electron of it; K_k is the output per electron of the first capture over the relative sensitivity of capture k.
Their temporal variance is K_k y + K_k^2 read_k^2. So the pieces of the photon transfer curve show K_k, the ratios
K_1 / K_k of the sensitivities, and the read noise of the first capture; that of the others where it is not hidden by
shot noise. Captures that read one charge have the same K_k; the distance of their codes in the output tells them apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.calibration.photon_transfer.knees import (
    OTHER_CODES,
    Piece,
    find_noise_step,
    find_pieces,
    line_through,
    linear_end,
)
from photosite.calibration.reduction.groups import CLIPPED_FRACTION
from photosite.calibration.withheld import (
    CLIPPED_TOO_FAR,
    COMPANDED_FRAMES,
    FEW_COMBINED_LEVELS,
    HIDDEN_CAPTURE,
    HIDDEN_LEVELS,
    NO_KNEE,
    NO_PHOTON_TRANSFER,
    NO_SATURATION,
)
from photosite.errors import InputError
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.sensor.captures import Companding
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.cfa import channel_mask, channel_names
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Tabular, drawn
from photosite.values.uncertain import Source, Uncertain, Value, derive

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Array = NDArray[np.float64]


_SWITCHED = HIDDEN_CAPTURE.missing("the frames change to the next capture before this one saturates")

_UNSEEN = HIDDEN_CAPTURE.missing(
    "the output shows no steps of the capture's converter; its gain needs the frames of the capture"
)


@dataclass(frozen=True)
class CombinedCapture:
    """One capture as far as combined frames show it.

    Parameters
    ----------
    output_gain_dn_per_e
        Linear output per electron of this capture.
    system_gain_dn_per_e
        Number of this capture's converter per electron, where the output shows the steps of this converter.
    read_noise_e
        Temporal dark noise, less the quantization of its converter where this is known. For a capture that adds the
        charge beyond the well of another one, that of both readings.
    sensitivity_ratio
        Electrons of this capture over those of the first at the same light; None for the first.
    saturation_capacity_e
        Electrons at which it saturates.
    levels
        Levels of light, or channels of them, that show it.
    """

    output_gain_dn_per_e: Estimate
    system_gain_dn_per_e: Estimate
    read_noise_e: Estimate
    sensitivity_ratio: Estimate | None
    saturation_capacity_e: Estimate
    levels: int

    def estimates(self) -> dict[str, Estimate]:
        """Return the estimates by name."""
        return {name: entry for name, entry in vars(self).items() if isinstance(entry, Estimate)}


@dataclass(frozen=True)
class Knee:
    """Where the frames change from one capture to the next.

    Parameters
    ----------
    signal_dn, signal_e
        Linear output above black in the middle of the transition, and in electrons of the first capture.
    dip_db
        Decrease of the temporal signal-to-noise ratio, 10 log10(S^2 / N).
    """

    signal_dn: Estimate
    signal_e: Estimate
    dip_db: Estimate


@dataclass(frozen=True, eq=False)
class CombinedCalibration(Diagnosed, Reported, Tabular):
    """The result of `calibrate` for frames that combine captures.

    Parameters
    ----------
    captures, knees
        The captures, from the most sensitive one, and the transitions between them.
    black_level_dn
        Linear output without light and dark current.
    signal_dn, variance_dn2, variance_uncertainty_dn2
        (points,) photon transfer curve: linear output above black, temporal variance without rounding, and its standard
        uncertainty, of each channel at each level.
    piece
        (points,) index of the capture that a point belongs to; -1 in a transition or beyond saturation.
    diagnostics, source
        Limitations of the result; what was opened.
    """

    captures: tuple[CombinedCapture, ...]
    knees: tuple[Knee, ...]
    black_level_dn: Estimate
    signal_dn: _Array
    variance_dn2: _Array
    variance_uncertainty_dn2: _Array
    piece: NDArray[np.intp]
    diagnostics: tuple[Diagnostic, ...]
    source: str

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the photon transfer curve with its knees on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimates as columns, and the photon transfer curve."""
        curve = ("signal_dn", "variance_dn2", "variance_uncertainty_dn2", "piece")
        arrays: dict[str, _Array] = {name: getattr(self, name) for name in curve}
        return {
            **self._table().to_dict(),
            "photon_transfer": {name: values.tolist() for name, values in arrays.items()},
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
            "source": self.source,
        }

    def _table(self) -> ResultTable:
        named = [(f"capture {k}", each.estimates()) for k, each in enumerate(self.captures, start=1)]
        named += [(f"knee {k}", dict(vars(each))) for k, each in enumerate(self.knees, start=1)]
        named.append(("frames", {"black_level_dn": self.black_level_dn}))
        rows = []
        for what, entries in named:
            for name, entry in entries.items():
                ends = entry.interval_95 or (None, None)
                rows.append((what, name, entry.value, entry.standard_uncertainty, *ends, entry.reason))
        columns = ("part", "parameter", "value", "standard_uncertainty", "lower_95", "upper_95", "reason")
        count = len(self.captures)
        title = f"Combined frames of {self.source}: {count} capture{'s' * (count > 1)} distinguished by their noise"
        return ResultTable(title, columns, rows)


_LEAST_NOISE_STEPS = 0.5
"""Standard deviation in steps of the numbers below which rounding hides the noise."""


class _Level(NamedTuple):
    """A channel of a group of frames, in linear numbers: mean, temporal variance and its uncertainty."""

    kind: str
    exposure_s: float
    mean: float
    mean_uncertainty: float
    variance: float
    uncertainty: float
    step: float  # linear numbers per number of the frame
    top_fraction: float  # of the numbers that are the highest of all frames
    codes: float | None  # distance of the codes, where the numbers are linear

    @property
    def noise_shown(self) -> bool:
        """Whether the noise is more than the rounding of the numbers."""
        return self.variance > (_LEAST_NOISE_STEPS * self.step) ** 2 - QUANTIZATION_DN2 and self.uncertainty > 0.0


def calibrate_combined(
    frames: FrameSet, sensor: Sensor | None = None, *, companding: Companding | None = None
) -> CombinedCalibration:
    """Estimate what the combined frames of a sensor with several captures show of each of them.

    The frames may have up to 24 bits, or be companded by a known table. The knees of the photon transfer curve are
    found by dynamic programming (`find_pieces`). Captures that read one charge with two gains have the same electrons:
    they are distinguished by read noise that is seen beside the shot noise, or in linear frames by the distance of
    codes.

    Parameters
    ----------
    frames
        Dark frames and flat fields, each level with two frames or more. A capture needs three levels with no other.
    sensor
        The sensor as known before, for its companding table; default `frames.sensor`.
    companding
        Companding table of the frames; default that of the sensor, None for linear frames.

    Raises
    ------
    InputError
        If the frames have several gain settings.
    CalibrationError
        If there are no dark frames or too few levels, dark frames are clipped at 0, or the variance falls where the
        signal rises: the numbers are companded by another table.

    Examples
    --------
    >>> from photosite.frames.frame_set import FrameSet
    >>> rng = np.random.default_rng(1)
    >>> def frame(light_e):
    ...     part = 1.0 if light_e < 3000 else 0.1  # a small photodiode above 3000 electrons
    ...     electrons = rng.poisson(part * light_e, (48, 48)) + rng.normal(0, 3, (48, 48))
    ...     return np.uint32(4 * electrons / part + 100.5)
    >>> levels = [("dark", 0.1, 0)] + [("light", e / 1e6, e) for e in np.geomspace(100, 60000, 24)]
    >>> taken = [(kind, t, frame(mean)) for kind, t, mean in levels for _ in range(4)]
    >>> found = calibrate_combined(FrameSet.from_arrays(taken, bits=20))
    >>> low, high = found.captures[1].sensitivity_ratio.interval_95
    >>> len(found.captures), low < 0.1 < high, found.captures[0].saturation_capacity_e.reason
    (2, True, 'the frames change to the next capture before this one saturates')
    """
    if len(frames.gain_settings) > 1:
        raise InputError("frames", where=frames.source, value="several gain settings", expected="one gain setting")
    if companding is None:
        companding = _known_companding(frames, sensor if sensor is not None else frames.sensor)
    levels = [level for group in frames.groups if len(group) > 1 for level in _reduced(frames, group, companding)]
    darks, lights = ([level for level in levels if level.kind == kind] for kind in ("dark", "light"))
    if not darks or len(lights) < 3:
        what = "combined frames need repeated dark frames, and repeated flat fields of three levels or more"
        raise FEW_COMBINED_LEVELS.error(what, where=frames.source)
    black = _black_level(darks)
    used = sorted((level for level in (*darks, *lights) if level.noise_shown), key=lambda level: level.mean)
    diagnostics = _hidden_levels(len(levels) - len(used), len(levels))
    signal = np.array([level.mean for level in used]) - black.value
    variance = np.array([level.variance for level in used])
    uncertainty = np.array([level.uncertainty for level in used])
    if len(used) < 3:
        raise HIDDEN_LEVELS.error(diagnostics[0].text, where=frames.source)
    end, reached = linear_end(signal, variance, np.array([level.top_fraction > CLIPPED_FRACTION for level in used]))
    pieces = find_pieces(signal[:end], variance[:end], uncertainty[:end])
    if not pieces:
        raise NO_PHOTON_TRANSFER.error("the temporal variance does not rise with the signal", where=frames.source)
    _check_companding(frames, signal, pieces)
    parts = [
        ends
        for piece in pieces
        for by_codes in _split(used, piece)
        for ends in _split_by_noise(used, signal, variance, uncertainty, *by_codes)
    ]
    pieces = [line_through(signal, variance, uncertainty, *ends)[0] for ends in parts]
    index = np.full(len(used), -1, np.intp)
    for number, piece in enumerate(pieces):
        index[piece.first : piece.last + 1] = number
    lines = [_fit(signal, variance, uncertainty, piece) for piece in pieces]
    if len(pieces) == 1:
        text = "no knee: the frames show one capture, or captures that read one charge, their read noise hidden"
        diagnostics.append(NO_KNEE(text))
    saturations = [*[_SWITCHED] * (len(pieces) - 1), _saturation(used, signal, variance, reached)]
    return CombinedCalibration(
        tuple(
            _capture(used, piece, line.uncertain, lines[0].uncertain if k else None, saturation)
            for k, (piece, line, saturation) in enumerate(zip(pieces, lines, saturations, strict=True))
        ),
        tuple(
            _knee(signal, before, after, lines[k].uncertain, lines[k + 1].uncertain, lines[0].uncertain[1])
            for k, (before, after) in enumerate(pairwise(pieces))
        ),
        Estimate.of(black, "mean of the dark frames at exposure zero" if len(darks) > 1 else "mean of the dark frames"),
        signal,
        variance,
        uncertainty,
        index,
        tuple(diagnostics),
        frames.source,
    )


def _hidden_levels(hidden: int, total: int) -> list[Diagnostic]:
    text = (
        f"{hidden} of {total} levels have less noise than {_LEAST_NOISE_STEPS:g} steps of the numbers and are left "
        f"out: rounding or clipping hides it"
    )
    return [HIDDEN_LEVELS(text, hidden)] if hidden else []


def _known_companding(frames: FrameSet, sensor: Sensor | None) -> Companding | None:
    """Return a sensor's companding table, if it is that of the frames."""
    table = None if sensor is None or sensor.captures is None else sensor.captures.combination.companding
    return table if table is not None and table.bits == frames.bits else None


def _reduced(frames: FrameSet, group: FrameGroup, companding: Companding | None) -> list[_Level]:
    linear: Callable[[NDArray[Any]], _Array] = (
        (lambda dn: dn.astype(np.float64)) if companding is None else companding.decompand
    )
    first = next(iter(group))
    shift = linear(first).mean()
    total, squares, zeros = np.zeros(first.shape), np.zeros(first.shape), np.zeros(first.shape)
    top = (1 << frames.bits) - 1 if companding is None else companding.companded_dn[-1]
    tops = np.zeros(first.shape)
    for dn in group:
        values = linear(dn) - shift
        total += values
        squares += values**2
        zeros += dn == 0
        tops += dn >= top
    count = len(group)
    own = (squares - total**2 / count) / (count - 1)
    if group.kind == "dark" and zeros.mean() > CLIPPED_FRACTION * count:
        fraction = 100.0 * zeros.mean() / count
        raise CLIPPED_TOO_FAR.error(
            f"the dark frames are clipped: {fraction:.3g} % of the numbers are 0",
            where=frames.source,
            hint="Raise the black level of the output",
        )
    found = []
    for channel in channel_names(frames.cfa):
        site = channel_mask(frames.cfa, channel, first.shape)
        pixels, mean = int(site.sum()), shift + total[site].mean() / count
        step = 1.0 if companding is None else float(companding.step_dn(mean))
        rounding = QUANTIZATION_DN2 * (1.0 + (step**2 if step > 1.0 else 0.0))
        found.append(
            _Level(
                group.kind,
                group.exposure_s,
                float(mean),
                math.sqrt(max(float(own[site].mean()), 0.0) / (pixels * count)),
                float(own[site].mean()) - rounding,
                float(own[site].std()) / math.sqrt(pixels),
                step,
                float(tops[site].mean()) / count,
                _distance_of_codes(linear(first[site])) if step == 1.0 else None,
            )
        )
    return found


def _distance_of_codes(dn: NDArray[Any]) -> float | None:
    """Return the distance of evenly spaced codes in output numbers; None where they are not evenly spaced."""
    codes, counts = np.unique(dn, return_counts=True)
    middle = codes[(np.cumsum(counts) > 0.05 * dn.size) & (np.cumsum(counts) < 0.95 * dn.size)].astype(np.float64)
    if len(middle) < 5 or dn.size < 10 * len(codes):
        return None
    steps = np.diff(middle)
    return float(steps.mean()) if np.ptp(steps) <= 1.0 else None


def _split(levels: Sequence[_Level], piece: Piece) -> Iterator[tuple[int, int]]:
    """Yield the first and last level of the captures of a piece, which the distances of the codes tell apart."""
    first, last, own = piece.first, piece.last, None
    for k in range(piece.first, piece.last + 1):
        codes = levels[k].codes
        if codes is None:
            continue
        if own is not None and abs(codes / own - 1.0) > OTHER_CODES and min(last - first, piece.last - k) > 1:
            yield first, last
            first = k
        own, last = codes, k
    yield first, piece.last


def _split_by_noise(
    levels: Sequence[_Level], signal: _Array, variance: _Array, uncertainty: _Array, first: int, last: int
) -> tuple[tuple[int, int], ...]:
    """Return the first and last level of two captures that read one charge with different read noise, or of one."""
    part = slice(first, last + 1)
    darks = max((k + 1 for k, level in enumerate(levels[part]) if level.kind == "dark"), default=0)
    codes = [level.codes for level in levels[part] if level.codes is not None]
    known = np.array([level.codes or min(codes) for level in levels[part]]) if codes else None
    place = find_noise_step(signal[part], variance[part], uncertainty[part], max(darks, 1), 1, known)
    if place is None:
        return ((first, last),)
    return (first, first + place - 1), (first + place, last)


def _black_level(darks: Sequence[_Level]) -> Uncertain:
    """Return the output at exposure zero: the intercept of the dark levels' line, or their mean at one exposure."""
    times = np.array([level.exposure_s for level in darks])
    means = np.array([level.mean for level in darks])
    variance = np.array([max(level.mean_uncertainty, 1e-6) ** 2 for level in darks])
    if len(np.unique(times)) < 2:
        weights = 1.0 / variance
        return Uncertain.of(float((weights * means).sum() / weights.sum()), float(weights.sum() ** -0.5))
    return fit_linear(np.stack([np.ones_like(times), times], axis=1), means, np.diag(variance)).uncertain[0]


_STILL = 0.02
"""Fraction of the largest variance below which a level is fully saturated."""


def _saturation(levels: Sequence[_Level], signal: _Array, variance: _Array, reached: bool) -> Value:
    if not reached:
        return NO_SATURATION.missing(
            "no flat field reached saturation; take brighter flat fields, up to where they stop rising"
        )
    last = levels[-1]
    if last.top_fraction < 1.0 - CLIPPED_FRACTION and variance[-1] > _STILL * variance.max():
        return NO_SATURATION.missing("no flat field is fully saturated")
    return Uncertain.of(float(signal[-1]), last.mean_uncertainty)


def _check_companding(frames: FrameSet, signal: _Array, pieces: Sequence[Piece]) -> None:
    for before, after in pairwise(pieces):
        at = 0.5 * float(signal[before.last] + signal[after.first])
        if after.at(at) < before.at(at):
            raise COMPANDED_FRAMES.error(
                f"the temporal variance falls by a factor of {before.at(at) / after.at(at):.3g} near {at:.4g} DN above "
                f"black while the signal rises: the numbers are companded",
                where=frames.source,
                hint="Pass companding, the table of the frames, or a sensor with captures.combination.companding",
            )


def _fit(signal: _Array, variance: _Array, uncertainty: _Array, piece: Piece) -> Fit:
    """Return the line of a piece, weighted by its own variances: one that is low by chance has a low uncertainty."""
    part = slice(piece.first, piece.last + 1)
    x, y, relative = signal[part], variance[part], uncertainty[part] / variance[part]
    line, fit = piece.intercept + piece.slope * x, None
    for _ in range(3):
        line = np.maximum(line, 1e-3 * y)
        fit = fit_linear(np.stack([1.0 / line, x / line], axis=1), y / line, np.diag(relative**2))
        line = fit.parameters[0] + fit.parameters[1] * x
    assert fit is not None
    return fit


_STEPS_SHOWN = 1.5
"""Least distance of the codes of a capture, in output numbers, that shows its converter's steps."""


def _capture(
    levels: Sequence[_Level],
    piece: Piece,
    line: tuple[Uncertain, ...],
    first_line: tuple[Uncertain, ...] | None,
    saturation: Value,
) -> CombinedCapture:
    own = levels[piece.first : piece.last + 1]
    intercept, gain = line
    seen = [level.codes for level in own if level.codes is not None]
    codes = float(np.median(seen)) if seen and np.median(seen) > _STEPS_SHOWN else None
    method, ratio = "slope of the photon transfer curve", "ratio of the slopes of the photon transfer curve"
    variance = intercept if codes is None else intercept - QUANTIZATION_DN2 * codes**2
    noise = variance / (gain * gain)
    how = "intercept of the photon transfer curve"
    read = Estimate.of_variance(noise, how if codes is None else f"{how}, quantization of the converter subtracted")
    own_gain: Value = _UNSEEN if codes is None else gain / codes
    return CombinedCapture(
        Estimate.of(gain, method),
        Estimate.of(own_gain, f"{method}, over the distance of the codes"),
        read,
        None if first_line is None else Estimate.of(first_line[1] / gain, ratio),
        Estimate.of(derive(lambda top: top / gain, saturation), "saturated output over the output per electron"),
        len(own),
    )


def _knee(
    signal: _Array,
    before: Piece,
    after: Piece,
    line: tuple[Uncertain, ...],
    next_line: tuple[Uncertain, ...],
    first_gain: Uncertain,
) -> Knee:
    """Return the knee between two pieces: anywhere between the levels on either side, with equal probability."""
    low, high = float(signal[before.last]), float(signal[after.first])
    reach = 0.95 * math.sqrt(3.0)
    at = Uncertain.of(0.5 * (low + high), (high - low) / math.sqrt(12.0), Source(reach, reach))
    dip = ((next_line[0] + next_line[1] * at) / (line[0] + line[1] * at)).decibel(10.0)
    return Knee(
        Estimate.of(at, "between the levels on either side of the step of the variance"),
        Estimate.of(at / first_gain, "signal over the output per electron of the first capture"),
        Estimate.of(dip, "ratio of the variances of the two captures"),
    )
