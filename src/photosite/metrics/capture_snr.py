"""The signal-to-noise ratio of sensors with several captures: of each capture, and of their combination."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.sensor.capture_readout import capture_scale, captures_of, part_sensor
from photosite.sensor.captures import Combination
from photosite.sensor.model import Sensor
from photosite.values.shown import ResultTable, Tabular, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Curve = NDArray[np.float64]

# The distribution of the more sensitive capture in a transition: 7 standard deviations to each side.
_DEVIATES = np.linspace(-7.0, 7.0, 281)
_DEVIATE_WEIGHTS = np.exp(-0.5 * _DEVIATES**2)
_DEVIATE_WEIGHTS /= _DEVIATE_WEIGHTS.sum()


class Transition(NamedTuple):
    """A transition from one capture to the next: light at its middle, and the ratio of either capture there."""

    above: str
    below: str
    light_e: float
    before_db: float
    after_db: float


@dataclass(frozen=True, eq=False)
class CaptureBudget(Tabular):
    """Signal-to-noise ratio over the light, of each capture and of their combination.

    Parameters
    ----------
    light_e
        Light in electrons of a photodiode of relative sensitivity and exposure 1, any shape.
    combined_db
        Ratio of the combined frame, of the shape of `light_e`; NaN where the last capture is saturated.
    captures_db
        Ratio of each capture by name; NaN where it is saturated.
    transitions
        The transitions, from the dark to the bright; the ratio dips by before_db - after_db.
    """

    light_e: _Curve
    combined_db: _Curve
    captures_db: Mapping[str, _Curve]
    transitions: tuple[Transition, ...]

    def plot(self, ax: Axes | None = None, *, electrons_per_cd_m2: float | None = None) -> Axes:
        """Draw the curves and the dips on Matplotlib axes, new ones by default, and return them.

        With the electrons of 1 cd/m2 in the exposure time, `Camera.mean_electrons(charts.uniform(light, 1.0), t)`, the
        abscissa is the luminance.
        """
        return drawn(self, ax, electrons_per_cd_m2)

    def to_dict(self) -> dict[str, Any]:
        """Return the curves as lists, and the transitions."""
        return {**self._table().to_dict(), "transitions": [each._asdict() for each in self.transitions]}

    def _table(self) -> ResultTable:
        dips = (f"{t.before_db - t.after_db:.1f} dB at {t.light_e:.4g} e-" for t in self.transitions)
        title = "SNR of the captures and of their combination, dips: " + (", ".join(dips) or "none")
        names = ("light_e", "combined_db", *(f"{name}_db" for name in self.captures_db))
        columns = (np.ravel(curve).tolist() for curve in (self.light_e, self.combined_db, *self.captures_db.values()))
        return ResultTable(title, names, list(zip(*columns, strict=True)))


@dataclass(frozen=True)
class _Noise:
    """Moments of a capture in units of light: mean, variance that its charge has, and variance of its reading."""

    charge: str
    mean: _Curve
    charge_variance: _Curve
    reading_variance: float
    parent_reading_variance: float
    # Light at which the capture begins to fill, and from there to its saturation
    start_e: float
    range_e: float

    @property
    def saturation_e(self) -> float:
        return self.start_e + self.range_e


def capture_budget(sensor: Sensor, light_e: ArrayLike, exposure_s: float = 0.0) -> CaptureBudget:
    """Return the signal-to-noise ratio of a sensor with several captures over a range of light.

    SNR = 10 log10(S^2 / N), S the light in electrons and N the variance over the pixels of one frame of a uniform
    surface: shot noise, read noise, DSNU, PRNU, dark current and its nonuniformity, and rounding. For captures with
    `charge` "own", shot noise and PRNU are independent; captures that share a charge share them. In a transition the
    variance of w x + (1 - w) y is integrated over the distribution of x, on which w depends. Transitions must not
    overlap.

    Parameters
    ----------
    sensor
        A sensor with captures.
    light_e
        Light in electrons of a photodiode of relative sensitivity and exposure 1, above 0: `Camera.mean_electrons`.
    exposure_s
        Exposure time of the frame, for the dark current.

    Raises
    ------
    InputError
        If the sensor has no captures, or light is not above 0.

    Examples
    --------
    >>> import photosite as ps
    >>> parts = [{"name": "long"}, {"name": "short", "relative_exposure": 0.0625}]
    >>> sensor = ps.load_sensor("nikon-d200").with_(captures={"parts": parts, "combination": {"dn_per_e": 1}})
    >>> budget = capture_budget(sensor, [1000, 20000, 100000])
    >>> budget.combined_db.round(1), round(budget.transitions[0].light_e)
    (array([27.5, 37.5, 35.2]), 26142)
    """
    light = np.asarray(light_e, np.float64)
    if not (np.isfinite(light) & (light > 0)).all():
        raise InputError("light_e", value=light.tolist(), expected="above 0")
    captures = captures_of(sensor)
    combination = captures.combination
    noises = {name: _noise(sensor, name, light, exposure_s) for name in captures.names}
    ratios = {name: np.where(n.mean < n.saturation_e, _db(light, _variance(n)), np.nan) for name, n in noises.items()}
    mean, variance = _combine(list(noises.values()), combination)
    rounding = _rounding(combination, mean)
    last = noises[captures.names[-1]]
    total = np.where(last.mean < last.saturation_e, _db(light, variance + rounding), np.nan)
    return CaptureBudget(light, total, ratios, _transitions(sensor, exposure_s))


def _db(light: _Curve, variance: _Curve) -> _Curve:
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(light**2 / variance))


def _variance(noise: _Noise) -> _Curve:
    return noise.charge_variance + noise.reading_variance + noise.parent_reading_variance


def _noise(sensor: Sensor, name: str, light: _Curve, exposure_s: float) -> _Noise:
    captures, one = captures_of(sensor), part_sensor(sensor, name)
    owner, factor = captures.owner(name), captures.light(name)
    values = part_sensor(sensor, owner.name).noise
    dark_e = one.electrons(values.dark_voltage_mv_per_s.value) * exposure_s * owner.relative_exposure.value
    fixed = (values.prnu_percent.value / 100.0 * light * factor) ** 2 + (values.dcnu_percent.value / 100 * dark_e) ** 2
    charge = light * factor + dark_e
    parent, well_e = 0.0, 0.0
    if captures[name].charge == "overflow":
        parent = _reading_variance(part_sensor(sensor, owner.name)) / factor**2
        well_e = part_sensor(sensor, owner.name).pixel.well_capacity_e.value / factor
    scale = capture_scale(sensor, name)
    coupling = None if sensor.effects is None else sensor.effects.interpixel_capacitance
    fraction = 1.0 if coupling is None else coupling.variance_factor
    return _Noise(
        owner.name,
        charge / factor,
        fraction * (charge + fixed) / factor**2,
        _reading_variance(one) / factor**2,
        parent,
        well_e,
        scale.saturation_dn / scale.dn_per_light_e,
    )


def _reading_variance(sensor: Sensor) -> float:
    """Return the variance of read noise, DSNU and rounding, in electrons squared."""
    reading = (sensor.electrons(part.value) for part in (sensor.noise.read_noise_mv, sensor.noise.dsnu_mv))
    return sum(part**2 for part in reading) + 1.0 / (12.0 * sensor.system_gain_dn_per_e**2)


def _combine(noises: list[_Noise], combination: Combination) -> tuple[_Curve, _Curve]:
    """Return mean and variance of the light by the combination, from the least sensitive capture on."""
    rest = noises[-1]
    mean, variance = rest.mean, _variance(rest)
    loading = {noise.charge: np.zeros_like(mean) for noise in noises} | {rest.charge: np.ones_like(mean)}
    for position in range(len(noises) - 2, -1, -1):
        noise, following = noises[position], noises[position + 1]
        own = _variance(noise)
        both = noise.charge_variance * loading[noise.charge]
        if following.parent_reading_variance and following.charge == noise.charge:
            both = both + noise.reading_variance
        spread = np.sqrt(own)[..., None] * _DEVIATES
        weight = combination.weight((noise.mean[..., None] + spread - noise.start_e) / noise.range_e)
        other = mean[..., None] + (both / own)[..., None] * spread
        value = weight * (noise.mean[..., None] + spread) + (1.0 - weight) * other
        expected = value @ _DEVIATE_WEIGHTS
        left = ((1.0 - weight) ** 2 @ _DEVIATE_WEIGHTS) * np.maximum(variance - both**2 / own, 0.0)
        fraction = weight @ _DEVIATE_WEIGHTS
        mean, variance = expected, ((value - expected[..., None]) ** 2) @ _DEVIATE_WEIGHTS + left
        loading = {name: (1.0 - fraction) * part + fraction * (name == noise.charge) for name, part in loading.items()}
    return mean, variance


def _rounding(combination: Combination, mean: _Curve) -> _Curve:
    """Return the variance of rounding to linear and companded numbers, in units of light."""
    dn_per_e = combination.dn_per_e.value
    steps = np.ones_like(mean)
    if combination.companding is not None:
        linear = mean * dn_per_e + combination.black_level_dn.value
        steps = np.sqrt(1.0 + combination.companding.step_dn(linear) ** 2)
    return np.asarray((steps / dn_per_e) ** 2 / 12.0)


def _transitions(sensor: Sensor, exposure_s: float) -> tuple[Transition, ...]:
    """Return the light in the middle of each transition, and the ratios of the captures on either side there."""
    captures, found = captures_of(sensor), []
    for above, below in zip(captures.names, captures.names[1:], strict=False):
        dark = _noise(sensor, above, np.zeros(1), exposure_s)
        level = dark.start_e + captures.combination.switch_percent / 100 * dark.range_e - dark.mean
        before, after = (
            float(_db(level, _variance(_noise(sensor, name, level, exposure_s)))[0]) for name in (above, below)
        )
        found.append(Transition(above, below, float(level[0]), before, after))
    return tuple(found)
