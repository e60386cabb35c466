"""Charge transfer inefficiency of a CCD from the charge behind the last illuminated line of flat fields."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.chip_maps.response_map import light_groups_in_range
from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.withheld import EFFECT_NOT_MEASURED
from photosite.frames.frame_set import FrameGroup
from photosite.sensor.effects.charge_transfer import ChargeTransfer
from photosite.sensor.model import Sensor
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.shown import ResultTable, Shown, Tabular
from photosite.values.uncertain import Measured, Missing, Source, Uncertain

Direction = Literal["parallel", "serial"]
_Floats = NDArray[np.float64]

_METHOD = (
    "charge in {lines} {kind} behind the last illuminated one against its signal, over {transfers} transfers (extended "
    "pixel edge response)"
)
_KINDS: dict[Direction, str] = {"parallel": "rows", "serial": "columns"}


@dataclass(frozen=True)
class EdgeResponse(Shown):
    """Charge behind the last illuminated line, in one direction of transfer.

    Parameters
    ----------
    inefficiency
        Fraction of the charge that stays behind at a transfer.
    transfers, lines
        Transfers of the last illuminated line, and lines without light behind it.
    slope
        Charge behind the last illuminated line over its signal.
    signal_dn, trailing_dn, uncertainty_dn
        (levels,) signal of the last illuminated line in dark frames and flat fields; charge behind it, less what dark
        frames have there; standard uncertainty of that.
    profile
        (lines,) charge in each of the lines over the signal, at the brightest level.
    seen
        Whether the charge is above zero beyond chance.
    """

    inefficiency: Estimate
    transfers: int = 0
    lines: int = 0
    slope: Estimate = field(default_factory=Estimate)
    signal_dn: _Floats = field(default_factory=lambda: np.zeros(0))
    trailing_dn: _Floats = field(default_factory=lambda: np.zeros(0))
    uncertainty_dn: _Floats = field(default_factory=lambda: np.zeros(0))
    profile: _Floats = field(default_factory=lambda: np.zeros(0))
    seen: bool = False


CHARGE_LEFT_BEHIND = DiagnosticKind(
    "charge-left-behind",
    "warning",
    "Charge stays behind at the transfers of a CCD.",
    "Pixels share charge, which lowers the temporal variance of flat fields, and the system gain with it, by half of "
    "the charge that the farthest pixel leaves behind, in each direction. Values in electrons and the quantum "
    "efficiency are too large by as much. Their intervals do not contain this.",
    "Nothing: the sensor file has the inefficiency. Slower clocks or a smaller region leave less charge behind.",
    ("system_gain_dn_per_e", "conversion_gain_*", "quantum_efficiency_percent", "*_e", "*_e_per_s", "dcnu_percent"),
    "relative change of the system gain",
)


@dataclass(frozen=True)
class TransferLoss(Finding, Tabular):
    """Charge transfer inefficiency along the columns (parallel) and along the rows (serial)."""

    parallel: EdgeResponse
    serial: EdgeResponse

    @property
    def present(self) -> bool:
        """Whether charge stays behind in one of the directions beyond chance."""
        return self.parallel.seen or self.serial.seen

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The inefficiency of each direction."""
        return {"parallel": self.parallel.inefficiency, "serial": self.serial.inefficiency}

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The parameters that the charge left behind makes wrong, and by how much."""
        lost = {
            name: edge.transfers * edge.inefficiency.value
            for name, edge in (("parallel", self.parallel), ("serial", self.serial))
            if edge.seen and edge.inefficiency.value is not None
        }
        if not lost:
            return ()
        # Pixel n of N leaves f = n s behind, so that the mean of (1 - f)^2 + f^2 is 1 - N s
        size = -sum(lost.values())
        return (
            CHARGE_LEFT_BEHIND(
                f"charge stays behind at transfers ({' and '.join(lost)}): pixels share charge, and the system gain is "
                f"about {-100.0 * size:.2g} % too low, values in electrons as much too high, which their intervals do "
                f"not contain",
                size,
            ),
        )

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the section of a sensor file; an inefficiency that is not seen is 0 with its uncertainty."""
        assert base.effects is not None
        assert base.effects.charge_transfer is not None
        found = {}
        for name in ("parallel", "serial"):
            edge: EdgeResponse = getattr(self, name)
            if edge.inefficiency.value is not None:
                spread = edge.inefficiency.measured(source).standard_uncertainty
                value = edge.inefficiency.value if edge.seen else 0.0
                found[f"{name}_inefficiency"] = Measured(value, spread, source)
        return {"charge_transfer": base.effects.charge_transfer.model_copy(update=found)}

    def to_dict(self) -> dict[str, Any]:
        """Return both estimates with the number of transfers, for JSON."""
        edges: Mapping[str, EdgeResponse] = {"parallel": self.parallel, "serial": self.serial}
        return {name: edge.inefficiency.to_dict() | {"transfers": edge.transfers} for name, edge in edges.items()}

    def _table(self) -> ResultTable:
        rows = []
        for name, edge in (("parallel", self.parallel), ("serial", self.serial)):
            entry = edge.inefficiency
            ends = entry.interval_95 or (None, None)
            rows.append((name, entry.value, entry.standard_uncertainty, *ends, edge.transfers, entry.reason))
        columns = ("direction", "inefficiency", "standard_uncertainty", "lower_95", "upper_95", "transfers", "reason")
        return ResultTable("Charge transfer inefficiency", columns, rows)


_LEAST_LINES = 2
"""Lines behind the last illuminated one: the charge in the first half is that above the level of the second half."""


def measure_charge_transfer(evidence: Evidence) -> TransferLoss | Missing:
    """Estimate the charge transfer inefficiency from the lines behind the illuminated ones.

    Reads the dark frames and the flat fields of the linear range again, with the border that `FrameSet.border` states.
    The base sensor states the corner of the output.

    Returns
    -------
    TransferLoss or Missing
        Missing where the base sensor states no charge transfer. Where the frames have fewer than two lines behind the
        illuminated ones, the estimate has the reason instead of a value.

    Notes
    -----
    Of a flat field of n lines of signal S, the charge n s S arrives after the last line, where s is the inefficiency:
    the mean number of transfers at which an electron stays behind is n s in n clock cycles, whatever s. The first half
    of the lines behind the last one, less the level of the second half, holds this charge up to a small rest, which the
    same model gives. Over dark frames and flat fields, a straight line of this difference against the signal separates
    the charge from the fixed pattern of these lines, and from dark current, if there are two dark exposure times.
    Uncertainties are those of the scatter over frames of one group, a constant plus a part that grows with the
    signal.

    References
    ----------
    J. R. Janesick, Scientific Charge-Coupled Devices (SPIE Press, 2001), 5.2. A. Snyder and A. Roodman, J. Astron.
    Telesc. Instrum. Syst. 7 (2021) 048002, for the sensors of the LSST camera.
    """
    base, frames = evidence.base, evidence.reduction.frames
    stated = None if base is None or base.effects is None else base.effects.charge_transfer
    if stated is None:
        return EFFECT_NOT_MEASURED.missing("the sensor file states no charge transfer")
    top, bottom, left, right = frames.border or (0, 0, 0, 0)
    sides = [
        pair if order.step > 0 else pair[::-1]
        for pair, order in zip(((top, bottom), (left, right)), stated.order, strict=True)
    ]
    before, behind = (sides[0][0], sides[1][0]), (sides[0][1], sides[1][1])
    lights = light_groups_in_range(frames, evidence.light.channels)
    reason = "" if lights else "there are no flat fields at two levels or more in the linear range"
    if reason or max(behind) < _LEAST_LINES:
        return TransferLoss(_missing("parallel", stated, reason), _missing("serial", stated, reason))
    used = {id(entry.source) for entry in evidence.reduction.used}
    groups = (*frames.of_kind("dark"), *lights)
    lit = slice(before[0], before[0] + frames.rows), slice(before[1], before[1] + frames.cols)
    series = [_edge_lines(group, used, stated.order, lit) for group in groups]
    edges = []
    for axis, direction in enumerate(_KINDS):
        if behind[axis] < _LEAST_LINES:
            edges.append(_missing(direction, stated, ""))
            continue
        lines = [np.array([frame[axis] for frame in entry]) for entry in series]
        edges.append(_edge_response(direction, lines, groups, lit[axis].stop))
    return TransferLoss(edges[0], edges[1])


EFFECT = Effect(
    35,
    measure_charge_transfer,
    labels={name: (f"Charge transfer inefficiency, {name}", "1") for name in ("parallel", "serial")},
)


def _missing(direction: Direction, stated: ChargeTransfer, reason: str) -> EdgeResponse:
    side = stated.output.split("_")[direction == "serial"]
    opposite = {"top": "bottom", "bottom": "top", "left": "right", "right": "left"}[side]
    lines = f"the frames have fewer than {_LEAST_LINES} covered or overscan {_KINDS[direction]} at the {opposite}"
    return EdgeResponse(Estimate(reason=reason or f"{lines}, opposite to the output"))


def _edge_lines(
    group: FrameGroup, used: Collection[int], order: tuple[slice, slice], lit: tuple[slice, slice]
) -> list[tuple[_Floats, _Floats]]:
    """Return the means of the last illuminated line and of those behind it, of rows and of columns, of each frame."""
    found = []
    for source in group.frames:
        if id(source) in used and source.whole is not None:
            dn = source.whole()[order]
            rows, columns = dn[lit[0].stop - 1 :, lit[1]], dn[lit[0], lit[1].stop - 1 :]
            found.append((rows.mean(axis=1, dtype=np.float64), columns.mean(axis=0, dtype=np.float64)))
    return found


_SEEN_P_VALUE = 0.005
"""Probability of so much charge without any inefficiency, below which it is taken for seen."""
_SCATTER_P_VALUE = 0.01
"""Probability of so large a scatter about the line by chance, below which the scatter widens the uncertainty."""


def _edge_response(
    direction: Direction, lines: Sequence[_Floats], groups: Sequence[FrameGroup], transfers: int
) -> EdgeResponse:
    """Fit one direction; `lines` has (frames, 1 + lines) means for each group."""
    from scipy.special import stdtr
    from scipy.stats import f

    behind = lines[0].shape[1] - 1
    near = behind // 2
    # Charge in the first half of the lines behind the last one, above the level of the second half
    charge = [near * (found[:, 1 : near + 1].mean(axis=1) - found[:, near + 1 :].mean(axis=1)) for found in lines]
    signal = np.array([(found[:, 0] - found[:, near + 1 :].mean(axis=1)).mean() for found in lines])
    trailing = np.array([values.mean() for values in charge])
    count = np.array([len(values) for values in charge])
    method = _METHOD.format(lines=behind, kind=_KINDS[direction], transfers=transfers)
    if count.max() < 2:
        reason = "no exposure time has two frames, whose differences would give the uncertainty"
        return EdgeResponse(Estimate(reason=reason, method=method))
    terms = [signal, np.ones_like(signal)]
    if len({group.exposure_s for group in groups if group.kind == "dark"}) > 1:
        terms.append(np.array([group.exposure_s for group in groups]))
    design = np.column_stack(terms)
    if np.linalg.matrix_rank(design / np.abs(design).max(axis=0)) < design.shape[1]:
        return EdgeResponse(
            Estimate(reason="the flat fields have one level, and there are no dark frames", method=method)
        )
    variance, shared = _noise(charge, signal)
    weight = np.sqrt(count / variance)
    scaled = design * weight[:, None]
    solution = np.linalg.lstsq(scaled, trailing * weight)[0]
    spread = math.sqrt(float(np.linalg.inv(scaled.T @ scaled)[0, 0]))
    left = len(signal) - design.shape[1]
    scatter = float(((trailing * weight - scaled @ solution) ** 2).sum()) / max(left, 1)
    if left and f.sf(scatter, left, shared) < _SCATTER_P_VALUE:
        spread *= math.sqrt(scatter)
        shared = min(shared, left)
        method += "; the points scatter about the line beyond chance, which widens the uncertainty"
    slope = Uncertain.of(float(solution[0]), spread, Source.student(shared))
    brightest, darkest = int(np.argmax(signal)), int(np.argmin(signal))
    profile = (lines[brightest] - lines[darkest].mean(axis=0)).mean(axis=0)
    profile = (profile[1:] - profile[near + 1 :].mean()) / (signal[brightest] - signal[darkest])
    return EdgeResponse(
        _inefficiency(slope, transfers, near, behind, method),
        transfers,
        behind,
        Estimate.of(slope, method),
        signal,
        trailing - design[:, 1:] @ solution[1:],
        1.0 / weight,
        profile,
        bool(stdtr(shared, -slope.value / slope.standard_uncertainty) < _SEEN_P_VALUE),
    )


_PASSES, _LEAST_NOISE = 3, 0.1
"""Passes of the fit of the variance over signal, and its least value over the pooled one."""


def _noise(charge: Sequence[_Floats], signal: _Floats) -> tuple[_Floats, int]:
    """Return the variance over the frames of each group, a constant plus a part that grows with the signal.

    The second value is the number of degrees of freedom.
    """
    from scipy.optimize import nnls

    freedom = np.array([len(values) - 1 for values in charge])
    own = np.array([values.var(ddof=1) if len(values) > 1 else 0.0 for values in charge])
    basis = np.column_stack([np.ones_like(signal), np.maximum(signal, 0.0) / max(signal.max(), 1e-300)])
    pooled = float(freedom @ own) / freedom.sum()
    variance = np.full(len(signal), pooled)
    for _ in range(_PASSES):
        weight = np.sqrt(freedom) / variance
        variance = basis @ nnls(basis * weight[:, None], own * weight)[0]
        variance = np.maximum(variance, _LEAST_NOISE * pooled)  # the constant may come out as 0
    return variance, max(int(freedom.sum()) - 1, 1)


def trailing_fraction(inefficiency: ArrayLike, transfers: int, near: int, behind: int) -> _Floats:
    """Return the charge in the first `near` lines behind the last one, above the level of the others, over the signal.

    Of n lines of equal charge, E[max(X - k, 0)] arrives later than k lines behind the last one, where X of the binomial
    distribution of n + k trials is the number of transfers at which an electron stays behind.

    Examples
    --------
    >>> trailing_fraction([1e-5, 1e-3], 2000, 2, 4).round(4).tolist()
    [0.02, 0.991]
    """
    from scipy.special import bdtrc

    s = np.asarray(inefficiency, np.float64)

    def later(k: int) -> _Floats:
        n = transfers + k
        return np.asarray(n * s * bdtrc(k - 1, n - 1, s) - k * bdtrc(k, n, s))

    first, last = transfers * s - later(near), later(near) - later(behind)
    return np.asarray(first - near / (behind - near) * last)


_GRID = np.append(0.0, np.geomspace(1e-9, 1e-2, 2801))


def _inefficiency(slope: Uncertain, transfers: int, near: int, behind: int, method: str) -> Estimate:
    """Return the inefficiency at which the model gives the slope."""
    fractions = trailing_fraction(_GRID, transfers, near, behind)
    # Beyond the peak, the charge comes so late that it raises the level of the second half.
    peak = int(np.argmax(fractions))
    if slope.interval_95[1] >= fractions[peak]:
        reason = f"the charge of {slope.value:.3g} of the signal reaches beyond the {behind} lines behind the last one"
        return Estimate(reason=reason, method=method)

    def inverse(value: float) -> float:
        return value / transfers if value < 0.0 else float(np.interp(value, fractions[: peak + 1], _GRID[: peak + 1]))

    reach = slope.standard_uncertainty
    u = 0.5 * (inverse(slope.value + reach) - inverse(slope.value - reach))
    ends = inverse(slope.interval_95[0]), inverse(slope.interval_95[1])
    return Estimate(inverse(slope.value), u, method=method, interval_95=ends)
