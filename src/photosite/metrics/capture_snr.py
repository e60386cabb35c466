"""The signal-to-noise ratio of sensors with several captures: of each capture, and of their combination."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.sensor.combined_noise import CombinedNoise, Transition
from photosite.sensor.model import Sensor
from photosite.values.shown import ResultTable, Tabular, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Curve = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CaptureBudget(Tabular):
    """Signal-to-noise ratio over the light, of each capture and of their combination.

    Parameters
    ----------
    light_e
        Light in electrons of a photodiode of relative sensitivity and exposure 1, any shape.
    combined_db
        Ratio of the combined frame, of the shape of `light_e`; NaN where the frame is saturated.
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


def capture_budget(sensor: Sensor, light_e: ArrayLike, exposure_s: float = 0.0) -> CaptureBudget:
    """Return the signal-to-noise ratio of a sensor with several captures over a range of light.

    SNR = 10 log10(S^2 / N), S the light in electrons and N the variance over the pixels of one frame of a uniform
    surface: shot noise, read noise, DSNU, PRNU, dark current and its nonuniformity, and rounding, with effects and
    transitions as `photosite.sensor.combined_noise` describes it.

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
    noise = CombinedNoise(sensor, exposure_s)
    return CaptureBudget(light, noise.snr_db(light), noise.captures_db(light), noise.transitions)
