"""Amplifier glow, from the map of the dark current: light that falls off from edges or corners of the chip."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding, SensorChanges
from photosite.calibration.withheld import EFFECT_NOT_MEASURED, EFFECT_NOT_SEEN
from photosite.engine.block_means import block_means
from photosite.sensor.effects.glow import Glow, Place
from photosite.sensor.model import Sensor
from photosite.values.deferred import Deferred
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import NORMAL_MAD, Measured, Missing, Value, correlated

Array = NDArray[np.float64]

PLACES: tuple[Place, ...] = get_args(Place)


_METHOD = "fit of a uniform dark current and of a glow that falls off from its places to the map of the dark current"


@dataclass(frozen=True, eq=False)
class GlowMap(Finding, Shown):
    """The dark current in blocks of the chip, and the glow in it.

    Parameters
    ----------
    rate_dn_per_s
        Mean dark current of each block without outlier pixels, (blocks, blocks) DN/s.
    uncertainty_dn_per_s
        Standard uncertainty of a block.
    shape
        Rows and columns of the chip.
    places
        Edges and corners that glow, empty within chance.
    peak_dn_per_s, peak_e_per_s, decay_pixels
        Glow at each of the places, and distance at which it has fallen to 1/e.
    """

    rate_dn_per_s: Array
    uncertainty_dn_per_s: float
    shape: tuple[int, int]
    places: tuple[Place, ...]
    peak_dn_per_s: Estimate
    peak_e_per_s: Estimate
    decay_pixels: Estimate

    @property
    def unclear(self) -> bool:
        """Whether there is a glow whose place and size the map does not tell."""
        return bool(self.places) and self.decay_pixels.value is None

    @property
    def present(self) -> bool:
        """Whether there is a glow of known place and size."""
        return bool(self.places) and self.peak_e_per_s.value is not None and self.decay_pixels.value is not None

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the glow for a sensor file: none within chance, that of the base where its place is unclear."""
        if self.unclear:
            return {}
        peak, decay = self.peak_e_per_s.value, self.decay_pixels.value
        if not self.places or peak is None or decay is None:
            return {"glow": None}
        return {"glow": Glow(places=self.places, peak_e_per_s=peak, decay_pixels=decay)}

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return dark current and its nonuniformity without the glow, unless they are those without hot pixels."""
        glow, dark = changes.fields.get("glow"), changes.measured("dark_voltage_mv_per_s")
        if glow is None or dark is None or "hot_pixels" in changes.fields:
            return {}
        rate_e_per_s, mv_per_e = glow.map(*self.shape), changes.mv_per_e
        rest = max(dark.value - mv_per_e * float(rate_e_per_s.mean()), 0.0)
        found = {"dark_voltage_mv_per_s": replace(dark, value=rest, source=f"{dark.source}; without glow")}
        if (spread := changes.measured("dcnu_percent")) is not None:
            variance = (0.01 * spread.value * dark.value) ** 2 - (mv_per_e * float(rate_e_per_s.std())) ** 2
            percent = 100.0 * math.sqrt(max(variance, 0.0)) / rest if rest > 0.0 else 0.0
            scale = dark.value / rest if rest > 0.0 else 1.0
            note = f"{spread.source}; without glow"
            found["dcnu_percent"] = Measured(percent, spread.standard_uncertainty * scale, note)
        return found

    def without(self, rate_dn_per_s: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a (rows, cols) map of the dark current, DN/s, without the glow, if its size is known."""
        if not self.places or self.peak_dn_per_s.value is None or self.decay_pixels.value is None:
            return rate_dn_per_s
        glow = Glow(places=self.places, peak_e_per_s=self.peak_dn_per_s.value, decay_pixels=self.decay_pixels.value)
        flat = glow.map(*rate_dn_per_s.shape)
        return np.subtract(rate_dn_per_s, flat, out=flat)

    def to_dict(self) -> dict[str, Any]:
        """Return places and estimates."""
        return {"places": list(self.places), **super().to_dict()}


LEAST_SIDE = 32
"""Rows and columns of a chip below which no glow is looked for."""


def deferred_glow(evidence: Evidence) -> Missing | Deferred[GlowMap | Missing]:
    """Return the glow in the map of the dark current, which is computed when it is first needed."""
    if evidence.dark.slope_map is None:
        return EFFECT_NOT_MEASURED.missing(
            "a glow shows in a map of the dark current, which needs repeated dark frames at two exposures"
        )
    slopes, gain = evidence.dark.slope_map.slopes.slopes, evidence.light.gain
    return Deferred(
        lambda: (
            find_glow(slopes, gain)
            or EFFECT_NOT_MEASURED.missing(f"the chip has fewer than {LEAST_SIDE} rows or columns")
        )
    )


EFFECT = Effect(50, deferred_glow)


MOST_BLOCKS = 48
"""Blocks of pixels along the longer side of the map."""
SIGNIFICANT = 30.0
"""Drop of chi square by a glow, beside a tilted plane, beyond which it is one: fewer than 1 of 10 000 maps without it,
of 255 sets of places and 24 decays."""
AMBIGUOUS = 12.0
"""Difference of chi square between two sets of places below which the map does not tell which of them it is."""
CLIPPED = 4.0
"""Standard deviations about the median of a block beyond which pixels, such as hot ones, are left out of its mean."""
_DECAYS, _ITERATIONS = 24, 30
"""Lengths of the decay that are searched, and steps of the fit from the best of them."""


def find_glow(rate_dn_per_s: Array, gain: Value) -> GlowMap | None:
    """Find the glow in a (rows, cols) map of the dark current; None where the chip is too small.

    All sets of the eight edges and corners are compared, with a common peak and decay as in the effect's own model
    (`photosite.sensor.effects.glow`). The scatter of the blocks about the fit is the uncertainty.

    Parameters
    ----------
    rate_dn_per_s
        Slope of each pixel's dark level against the exposure time.
    gain
        System gain, DN per electron.

    Examples
    --------
    >>> from photosite.values.uncertain import Uncertain
    >>> rng = np.random.default_rng(1)
    >>> flat = rng.gamma(4.0, 1.0, (80, 120))
    >>> find_glow(flat, Uncertain(0.5)).places
    ()
    >>> lit = Glow(places=("left",), peak_e_per_s=10.0, decay_pixels=20.0).map(80, 120)
    >>> found = find_glow(flat + 0.5 * lit, Uncertain(0.5))
    >>> found.places, 17 < found.decay_pixels.value < 23
    (('left',), True)
    """
    rows, cols = rate_dn_per_s.shape
    if min(rows, cols) < LEAST_SIDE:
        return None
    side = max(2, -(-max(rows, cols) // MOST_BLOCKS))
    # One spread for all blocks, which are small
    values = block_means(rate_dn_per_s, side, CLIPPED * NORMAL_MAD)
    y, count = values.ravel(), values.size
    decays = np.geomspace(side, 0.5 * max(rows, cols), _DECAYS)
    maps = _maps(tuple(decays), (rows, cols), side)
    sets = [chosen for n in range(1, len(PLACES) + 1) for chosen in combinations(range(len(PLACES)), n)]
    members = np.zeros((len(sets), len(PLACES)))
    for i, chosen in enumerate(sets):
        members[i, chosen] = 1.0
    r, c = np.indices(values.shape)
    plane = np.stack([np.ones(count), r.ravel() - r.mean(), c.ravel() - c.mean()], axis=1)
    scatter = float(np.std(y, ddof=1))
    if _drops(y, plane, maps, members).max() < SIGNIFICANT:
        no = EFFECT_NOT_SEEN.missing("the dark current falls off from no edge or corner beyond chance")
        return GlowMap(values, scatter, (rows, cols), (), *(Estimate.of(no, _METHOD),) * 3)
    # The same without the plane: a uniform dark current
    drops = _drops(y, plane[:, :1], maps, members)
    best_drops = drops.max(axis=0)
    first, second = np.argsort(best_drops)[:-3:-1]
    at = int(drops[:, first].argmax())
    places, others = (tuple(PLACES[k] for k in np.flatnonzero(members[n])) for n in (first, second))
    if best_drops[first] - best_drops[second] < AMBIGUOUS:
        named = " or ".join(" and ".join(found).replace("_", " ") for found in (places, others))
        reason = EFFECT_NOT_MEASURED.missing(f"the map of the dark current does not tell where the glow is: {named}")
        return GlowMap(values, scatter, (rows, cols), places, *(Estimate.of(reason, _METHOD),) * 3)
    theta, covariance, scatter = _fit(y, places, float(decays[at]), (rows, cols), side)
    peak, log_decay = correlated(theta[1:], covariance[1:, 1:], count - 3.0)
    decay = log_decay.apply(math.exp, math.exp)
    low, high = (math.exp(end) for end in log_decay.interval_95)
    return GlowMap(
        values,
        scatter,
        (rows, cols),
        places,
        Estimate.of(peak, _METHOD),
        Estimate.of(gain if isinstance(gain, Missing) else peak / gain, _METHOD),
        Estimate.of(decay, _METHOD, interval_95=(low, high)),
    )


@lru_cache(maxsize=2)
def _maps(decays: tuple[float, ...], shape: tuple[int, int], side: int) -> Array:
    """Return the glow of 1 at each place with each decay, (decays, places, blocks)."""
    return np.array([[_basis(place, decay, shape, side).ravel() for place in PLACES] for decay in decays])


def _basis(place: Place, decay: float, shape: tuple[int, int], side: int) -> Array:
    """Return the means over blocks of a glow of 1 at one place."""
    rows, cols = shape
    r, c = (np.arange(length // side * side, dtype=np.float64) for length in shape)
    from_line = {"top": r, "bottom": rows - 1.0 - r, "left": c, "right": cols - 1.0 - c}
    lines = place.split("_")
    if len(lines) == 1:
        means = np.exp(-from_line[place] / decay).reshape(-1, side).mean(axis=1)
        down = lines[0] in ("top", "bottom")
        block_shape = (len(r) // side, len(c) // side)
        return np.broadcast_to(means[:, None] if down else means[None], block_shape)
    # Of a corner, at the centers of quarters of the blocks
    inner = [from_line[line].reshape(-1, side) for line in lines]
    quarters = [np.stack([half.mean(axis=1) for half in np.array_split(part, 2, axis=1)], axis=1) for part in inner]
    distance = np.hypot(quarters[0][:, None, :, None], quarters[1][None, :, None, :])
    return np.asarray(np.exp(-distance / decay).mean(axis=(2, 3)))


def _drops(y: Array, usual: Array, maps: Array, members: Array) -> Array:
    """Return the drops of chi square, (decays, sets), by a glow beside the usual terms."""
    projector, _ = np.linalg.qr(usual)
    left = y - projector @ (projector.T @ y)
    drops = np.zeros((len(maps), len(members)))
    for k, place_maps in enumerate(maps):
        rest = place_maps - (place_maps @ projector) @ projector.T
        along = members @ (rest @ left)
        gram, own = (((members @ (part @ part.T)) * members).sum(axis=1) for part in (rest, place_maps))
        # Positive, and not nearly the usual terms themselves
        usable = (along > 0.0) & (gram > 1e-4 * own)
        drops[k, usable] = along[usable] ** 2 / gram[usable]
    variance = (float(left @ left) - drops.max()) / (len(y) - usual.shape[1] - 2)
    return drops / variance if variance > 0.0 else np.zeros_like(drops)


def _fit(
    y: Array, places: tuple[Place, ...], decay: float, shape: tuple[int, int], side: int
) -> tuple[Array, Array, float]:
    """Return level, peak and logarithm of the decay, their covariance, and the scatter of the blocks: Gauss-Newton."""

    def total(log_decay: float) -> Array:
        return np.asarray(sum(_basis(place, math.exp(log_decay), shape, side).ravel() for place in places))

    log_decay, step = math.log(decay), 1e-4
    for _ in range(_ITERATIONS):
        glow = total(log_decay)
        slope = (total(log_decay + step) - total(log_decay - step)) / (2.0 * step)
        linear = np.linalg.lstsq(np.stack([np.ones_like(y), glow], axis=1), y, rcond=None)[0]
        design = np.stack([np.ones_like(y), glow, linear[1] * slope], axis=1)
        change = float(np.linalg.lstsq(design, y - design[:, :2] @ linear, rcond=None)[0][2])
        log_decay += max(-0.3, min(change, 0.3))
        if abs(change) < 1e-6:
            break
    residual = y - design[:, :2] @ linear
    variance = float(residual @ residual) / (len(y) - 3)
    covariance = np.linalg.inv(design.T @ design) * variance
    return np.array([*linear, log_decay]), covariance, math.sqrt(variance)
