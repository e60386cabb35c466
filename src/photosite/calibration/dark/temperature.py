"""Doubling temperature of the dark current, from calibrations at several temperatures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.result import Calibration
from photosite.calibration.withheld import NO_DOUBLING_TEMPERATURE, NO_FLAT_FIELDS
from photosite.errors import InputError
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Tabular, drawn
from photosite.values.uncertain import COVERAGE_95, Measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from photosite.sensor.model import Sensor

_SCATTER_P_VALUE = 0.01
"""Probability of so large a scatter about the fit by chance, below which the scatter widens the uncertainty."""
_DOUBLINGS_C = np.geomspace(1.0, 60.0, 241)
"""Doubling temperatures in which the best one is searched for, before it is refined."""
_METHOD = "weighted fit of D0 2^((T - T0) / doubling temperature) to the dark current at {} temperatures"


@dataclass(frozen=True)
class DarkTemperature(Diagnosed, Reported, Tabular):
    """Dark current against temperature: D0 2^((T - T0) / doubling temperature).

    Parameters
    ----------
    doubling_c
        Doubling temperature.
    dark_current_dn_per_s, reference_c
        Dark current D0 of the fit at the reference temperature T0, which is the mean of the temperatures.
    measured
        Temperature in degrees Celsius and dark current in DN/s of each calibration, by temperature.
    chi_square, degrees_of_freedom
        Of the fit. A scatter beyond chance (p < 0.01) widens the uncertainties by its size.
    covariance
        (2, 2), of the logarithm of D0 and of the logarithmic slope per degree.
    calibrations
        The calibrations that it is based on.
    """

    doubling_c: Estimate
    dark_current_dn_per_s: Estimate
    reference_c: float
    measured: tuple[tuple[float, Estimate], ...]
    chi_square: float
    degrees_of_freedom: int
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 2)), repr=False, compare=False)
    calibrations: tuple[Calibration, ...] = field(default=(), repr=False, compare=False)

    def at(self, temperature_c: float) -> float:
        """Return the dark current of the fit at a temperature, DN/s; NaN without a doubling temperature."""
        rate, doubling = self.dark_current_dn_per_s.value, self.doubling_c.value
        if rate is None or doubling is None:
            return math.nan
        return float(rate * 2.0 ** ((temperature_c - self.reference_c) / doubling))

    def interval_95_at(self, temperature_c: float) -> tuple[float, float]:
        """Return the 95 % interval of the fit at a temperature, DN/s, from its logarithm."""
        step = np.array([1.0, temperature_c - self.reference_c])
        reach = math.exp(COVERAGE_95 * math.sqrt(float(step @ self.covariance @ step)))
        return self.at(temperature_c) / reach, self.at(temperature_c) * reach

    def applied_to(self, sensor: Sensor) -> Sensor:
        """Return a sensor with this doubling temperature, and with this dark current at the reference temperature.

        The gain setting of the frames, where they state one, selects that of the sensor for volts.

        Raises
        ------
        CalibrationError
            If the doubling temperature is missing.
        InputError
            If the sensor has no such gain setting.
        """
        doubling = self.doubling_c.measured(self.doubling_c.method)
        settings = {one.gain_setting for one in self.calibrations if one.gain_setting is not None}
        at = sensor
        if len(settings) == 1 and len(sensor.all_gain_settings) > 1:
            at = sensor.at_gain_setting(settings.pop())
        rate = self.dark_current_dn_per_s.measured(doubling.source or "")
        dark = Measured(rate.value * at.mv_per_dn, rate.standard_uncertainty * at.mv_per_dn, rate.source)
        return sensor.with_(
            dark_doubling_c=doubling, dark_voltage_mv_per_s=dark, dark_current_temperature_c=self.reference_c
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what `photosite temperature --json` prints."""
        return {
            "doubling_c": self.doubling_c.to_dict(),
            "dark_current_dn_per_s": self.dark_current_dn_per_s.to_dict(),
            "reference_c": self.reference_c,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees_of_freedom,
            "measured": [
                {"temperature_c": celsius, "dark_current_dn_per_s": entry.to_dict()} for celsius, entry in self.measured
            ],
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
        }

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]
        """Limitations of the result, and of the calibrations at each temperature."""
        own = []
        if self.doubling_c.reason:
            own.append(NO_DOUBLING_TEMPERATURE(f"no doubling temperature: {self.doubling_c.reason}"))
        elif self.degrees_of_freedom == 0:
            text = "two temperatures do not show whether one doubling temperature describes the range; take a third"
            own.append(NO_DOUBLING_TEMPERATURE(text))
        inherited = (
            entry.within(f"{_middle(one):.1f} °C")
            for one in self.calibrations
            for entry in one.diagnostics
            if entry.severity in ("note", "warning") and entry.id != NO_FLAT_FIELDS.id
        )
        return (*own, *inherited)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the dark current against the temperature on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    def _table(self) -> ResultTable:
        low, high = self.doubling_c.interval_95 or (math.nan, math.nan)
        found = self.doubling_c.reason
        if self.doubling_c.value is not None:
            found = f"doubles every {self.doubling_c.value:.3g} deg C, 95 % interval {low:.3g} to {high:.3g}"
        rows = [
            (celsius, entry.value, entry.standard_uncertainty, self.at(celsius)) for celsius, entry in self.measured
        ]
        columns = ("temperature_c", "dark_current_dn_per_s", "standard_uncertainty", "fitted_dn_per_s")
        return ResultTable(f"Dark current against temperature: {found}", columns, rows)


def dark_temperature(
    calibrations: Sequence[Calibration], temperature_c: Sequence[float] | None = None
) -> DarkTemperature:
    """Return the doubling temperature of the dark current.

    Parameters
    ----------
    calibrations
        Calibrations of one camera at one gain setting and different temperatures, each with dark frames at two exposure
        times or more; flat fields are not needed.
    temperature_c
        Temperature of each; by default that of its frames.

    Raises
    ------
    InputError
        If a temperature is missing, or fewer than two different temperatures have a dark current.

    Notes
    -----
    The fit is in the dark current itself, not in its logarithm, so that a dark current close to zero, or below it by
    noise, biases nothing. The interval is that of 1 / doubling temperature. Where the scatter about the fit is beyond
    chance, a single doubling temperature does not describe the range; state a value for each part of it.

    References
    ----------
    EMVA 1288 release 3.1, sections 3.2 and 7.2.
    """
    given: Sequence[float | None] = [_middle(one) for one in calibrations] if temperature_c is None else temperature_c
    if len(given) != len(calibrations):
        raise InputError("temperature_c", value=len(given), expected=f"a value for each of {len(calibrations)}")
    entries: list[tuple[float, Estimate]] = []
    for calibration, celsius in zip(calibrations, given, strict=True):
        if celsius is None:
            hint = "Pass {temperature_c}, or state it in the frames' metadata, their names or protocol.yaml"
            raise InputError("the frames do not state their temperature", hint=hint, arguments={"temperature_c": 25.0})
        if calibration.dark_current_dn_per_s.value is not None:
            entries.append((float(celsius), calibration.dark_current_dn_per_s))
    entries.sort(key=lambda entry: entry[0])
    if len({celsius for celsius, _ in entries}) < 2:
        raise InputError("calibrations", value=len(entries), expected="a dark current at two temperatures or more")
    celsius, rate, uncertainty = np.array(
        [(one, entry.value, entry.standard_uncertainty) for one, entry in entries], float
    ).T
    return replace(_fitted(entries, celsius, rate, uncertainty), calibrations=tuple(calibrations))


def _middle(calibration: Calibration) -> float | None:
    return None if calibration.temperature_c is None else 0.5 * sum(calibration.temperature_c)


def _fitted(
    entries: Sequence[tuple[float, Estimate]],
    celsius: NDArray[np.float64],
    rate: NDArray[np.float64],
    uncertainty: NDArray[np.float64],
) -> DarkTemperature:
    from scipy.optimize import minimize_scalar
    from scipy.stats import chi2

    reference_c = float(celsius.mean())
    above, weight = celsius - reference_c, 1.0 / np.maximum(uncertainty, 1e-12 * np.abs(rate).max()) ** 2

    def model(steepness: float) -> tuple[float, NDArray[np.float64], float]:
        """Return the best rate at the reference, the shape, and chi square, for a logarithmic slope per deg C."""
        shape = np.exp(steepness * above)
        best = float((weight * shape) @ rate / ((weight * shape) @ shape))
        return best, shape, float(weight @ (rate - best * shape) ** 2)

    grid = math.log(2.0) / _DOUBLINGS_C
    start = int(np.argmin([model(one)[2] for one in grid]))
    ends = grid[min(start + 1, len(grid) - 1)], grid[max(start - 1, 0)]
    steepness = float(minimize_scalar(lambda b: model(b)[2], bounds=ends, method="bounded", options={"xatol": 1e-9}).x)
    best, shape, chi_square = model(steepness)
    jacobian = np.column_stack([shape, best * above * shape])
    freedom = len(celsius) - 2
    method = _METHOD.format(len(entries))
    inverse = np.linalg.pinv(jacobian.T @ (weight[:, None] * jacobian))
    if freedom and chi2.sf(chi_square, freedom) < _SCATTER_P_VALUE:
        inverse *= chi_square / freedom
        method += "; the scatter about the fit is beyond chance and widens the uncertainty"
    u_rate, u_steep = np.sqrt(np.diag(inverse)).tolist()
    at_end = start in (0, len(grid) - 1)
    if at_end or steepness < COVERAGE_95 * u_steep:
        reason = "the dark currents do not differ enough; take dark frames over a larger range of temperatures"
        doubling = Estimate(reason=reason, method=method)
    else:
        value = math.log(2.0) / steepness
        interval = (
            math.log(2.0) / (steepness + COVERAGE_95 * u_steep),
            math.log(2.0) / max(steepness - COVERAGE_95 * u_steep, 1e-300),
        )
        doubling = Estimate(value, value * u_steep / steepness, method=method, interval_95=interval)
    scale = np.array([1.0 / best, 1.0])
    logarithmic = inverse * np.outer(scale, scale)
    current = Estimate(best, u_rate, method=method)
    return DarkTemperature(doubling, current, reference_c, tuple(entries), chi_square, freedom, logarithmic)
