"""The noise budget: the signal-to-noise ratio over the signal, in total and by noise source."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.sensor.combined_noise import NOISE_SOURCES, CombinedNoise, Transition
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import NoiseTerms
from photosite.values.shown import ResultTable, Tabular, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class NoiseBudget(Tabular):
    """Signal-to-noise ratio over the signal, in total and by noise source.

    Parameters
    ----------
    volts, signal_e
        Signal at the pixel, any shape, and in electrons; the other arrays have the same shape.
    total_db, shot_db, read_db, dsnu_db, prnu_db
        With all four noise sources, and with one alone; +inf if the sensor has none of it.
    dark_limited_below_volts
        Signal below which read noise and DSNU together exceed shot noise and PRNU together; 0 if the sensor has
        neither. Of several captures, the lowest such signal.
    prnu_limited_above_volts
        Signal above which PRNU exceeds the other sources together; +inf if the sensor has none. Of several captures,
        the highest such signal.
    transitions
        The transitions between captures, from the dark to the bright; none for a single capture.
    """

    volts: NDArray[np.float64]
    signal_e: NDArray[np.float64]
    total_db: NDArray[np.float64]
    shot_db: NDArray[np.float64]
    read_db: NDArray[np.float64]
    dsnu_db: NDArray[np.float64]
    prnu_db: NDArray[np.float64]
    dark_limited_below_volts: float
    prnu_limited_above_volts: float
    transitions: tuple[Transition, ...] = ()

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the curves on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """Return the curves as lists, the two limits, and the transitions between captures."""
        limits = ("dark_limited_below_volts", "prnu_limited_above_volts")
        found = {**self._table().to_dict(), **{name: getattr(self, name) for name in limits}}
        return found | {"transitions": [each._asdict() for each in self.transitions]}

    def _table(self) -> ResultTable:
        title = (
            f"Noise budget: dark noise dominates below {self.dark_limited_below_volts:.3g} V, "
            f"PRNU above {self.prnu_limited_above_volts:.3g} V"
        )
        if self.transitions:
            title += f"; captures switch from {', from '.join(map(str, self.transitions))}"
        names = ("volts", "signal_e", "total_db", "shot_db", "read_db", "dsnu_db", "prnu_db")
        columns = (np.ravel(getattr(self, name)).tolist() for name in names)
        return ResultTable(title, names, list(zip(*columns, strict=True)))


def noise_budget(sensor: Sensor, volts: ArrayLike) -> NoiseBudget:
    """Return the noise budget of a sensor over a range of signals.

    SNR = 10 log10(S^2 / N), S = volts / conversion gain in electrons and N the variance in electrons squared:
    S for shot noise, (read noise)^2, DSNU^2, (PRNU S)^2, and their sum for the total. Effects of the sensor count as
    `photosite.sensor.noise_terms` describes it. Saturation is ignored: levels above the voltage swing extrapolate. The
    total is that of one frame of a uniform surface, where the fixed pattern counts as noise; for a single pixel over
    many frames it does not. Of several captures it is the budget of the combined frame, S in electrons of a photodiode
    of relative sensitivity and exposure 1; `capture_budget` has each capture too.

    Parameters
    ----------
    sensor, volts
        The sensor, and the signal at the pixel in volts, above 0.

    Raises
    ------
    InputError
        If a voltage is not above 0.

    References
    ----------
    Farrell, Okincha and Parmar (2008), Figure 6.

    Examples
    --------
    >>> import photosite as ps
    >>> budget = noise_budget(ps.load_sensor("nikon-d200"), [0.01, 1.08])
    >>> budget.total_db.round(2), round(budget.dark_limited_below_volts * 1e3, 1)
    (array([20.53, 38.1 ]), 17.8)
    """
    signal_v = np.asarray(volts, dtype=np.float64)
    if not (np.isfinite(signal_v) & (signal_v > 0)).all():
        raise InputError("volts", value=signal_v.tolist(), expected="above 0")
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    if sensor.captures is not None:
        return _combined_budget(sensor, signal_v, v_per_e)
    signal_e, terms = signal_v / v_per_e, NoiseTerms(sensor)
    steep = terms.slope(signal_e) ** 2
    read_e2, dsnu_e2 = terms.read_e2 / steep + terms.induced_e2, terms.dsnu_e2 / steep
    prnu2 = terms.prnu2

    def snr_db(variance_e2: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return _db(signal_e, variance_e2)

    dark_limited_e, prnu_limited_e = 0.0, math.inf
    # The floor depends on the signal by the slope of the response curve alone, and little.
    for _ in range(_ITERATIONS):
        # The positive roots of prnu^2 S^2 + linear S = floor and of prnu^2 S^2 = linear S + floor.
        floor_e2 = float(terms.floor_e2(dark_limited_e))
        dark_limited_e = 2.0 * floor_e2 / (terms.linear + math.sqrt(terms.linear**2 + 4.0 * prnu2 * floor_e2))
        if prnu2:
            floor_e2 = float(terms.floor_e2(min(prnu_limited_e, sensor.pixel.well_capacity_e.value)))
            prnu_limited_e = (terms.linear + math.sqrt(terms.linear**2 + 4.0 * prnu2 * floor_e2)) / (2.0 * prnu2)
    return NoiseBudget(
        volts=signal_v,
        signal_e=signal_e,
        total_db=snr_db(terms.linear * signal_e + read_e2 + dsnu_e2 + prnu2 * signal_e**2),
        shot_db=snr_db(terms.shot * signal_e),
        read_db=snr_db(read_e2),
        dsnu_db=snr_db(dsnu_e2),
        prnu_db=snr_db(prnu2 * signal_e**2),
        dark_limited_below_volts=v_per_e * dark_limited_e,
        prnu_limited_above_volts=v_per_e * prnu_limited_e,
    )


_BUDGET_SOURCES = NOISE_SOURCES - {"rounding", "dcnu"}
_LIMIT_POINTS = 2000


def _combined_budget(sensor: Sensor, signal_v: NDArray[np.float64], v_per_e: float) -> NoiseBudget:
    """Return the budget of combined frames; each curve is that of the combination with these noise sources alone."""
    signal_e = signal_v / v_per_e

    def variance_e2(light_e: NDArray[np.float64], *sources: str) -> NDArray[np.float64]:
        return CombinedNoise(sensor, sources=frozenset(sources)).variance_e2(light_e)

    whole = CombinedNoise(sensor, sources=_BUDGET_SOURCES)
    grid = np.geomspace(1e-6, 1.0, _LIMIT_POINTS) * whole.light_capacity_e
    dark, prnu = variance_e2(grid, "read", "dsnu"), variance_e2(grid, "prnu")
    light_limited = np.flatnonzero(dark <= variance_e2(grid, "shot", "prnu"))
    others = np.flatnonzero(prnu <= variance_e2(grid, "shot", "read", "dsnu"))
    return NoiseBudget(
        volts=signal_v,
        signal_e=signal_e,
        total_db=_db(signal_e, whole.variance_e2(signal_e)),
        shot_db=_db(signal_e, variance_e2(signal_e, "shot")),
        read_db=_db(signal_e, variance_e2(signal_e, "read")),
        dsnu_db=_db(signal_e, variance_e2(signal_e, "dsnu")),
        prnu_db=_db(signal_e, variance_e2(signal_e, "prnu")),
        dark_limited_below_volts=v_per_e * float(grid[light_limited[0]]) if dark.any() else 0.0,
        prnu_limited_above_volts=v_per_e * float(grid[others[-1]]) if others[-1] < grid.size - 1 else math.inf,
        transitions=whole.transitions,
    )


def _db(signal_e: NDArray[np.float64], variance_e2: NDArray[np.float64] | float) -> NDArray[np.float64]:
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(signal_e**2 / np.asarray(variance_e2)))


def signal_at_snr_e(sensor: Sensor, snr_db: float) -> float:
    """Return the signal in electrons at which the total signal-to-noise ratio has a given value.

    Parameters
    ----------
    sensor, snr_db
        The sensor, and the ratio, as `NoiseBudget.total_db`; at 0 dB signal and noise are equal.

    Raises
    ------
    InputError
        If PRNU limits the ratio to less at any signal, or the combined frame of several captures saturates before.

    Notes
    -----
    The positive root of S^2 = R (S + read^2 + DSNU^2 + PRNU^2 S^2), R = 10^(snr_db / 10), in electrons, with effects as
    in `noise_budget`. Saturation is ignored.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> signal_e = signal_at_snr_e(sensor, 20.0)
    >>> round(signal_e, 1), float(noise_budget(sensor, signal_e * 30e-6).total_db.round(9))
    (309.6, 20.0)
    """
    if sensor.captures is not None:
        combined = CombinedNoise(sensor, sources=_BUDGET_SOURCES)
        if (light_e := combined.signal_at_snr_e(snr_db)) is None:
            raise InputError("snr_db", value=snr_db, expected=f"at most {combined.snr_max_db:.4g}, the highest ratio")
        return light_e
    terms = NoiseTerms(sensor)
    signal_e = terms.signal_at_snr_e(snr_db)
    if signal_e is None:
        limit = -10.0 * math.log10(terms.prnu2)
        raise InputError("snr_db", value=snr_db, expected=f"below {limit:.4g}, the limit by PRNU")
    return signal_e
