"""Result of a gain series: each setting's calibration, the conversion-gain switch, and the two parts of read noise."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.gain_series.series_statistics import SettingScale
from photosite.calibration.result import Calibration
from photosite.errors import InputError
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Shown, Tabular, clipped, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from photosite.sensor.model import Sensor


_COLUMNS = ("system_gain_dn_per_e", "read_noise_e", "saturation_capacity_e", "dynamic_range_db")
"""The parameters that the table of a series shows."""


@dataclass(frozen=True)
class GainStep(Shown):
    """One gain setting of a series and its calibration."""

    setting: float
    calibration: Calibration


@dataclass(frozen=True)
class GainMode(Shown):
    """Settings with one conversion gain, and the two parts of their read noise: sigma_dn^2 = (pre_e K)^2 + post_dn^2.

    Parameters
    ----------
    settings
        Settings, ascending.
    pre_amplifier_noise_e, post_amplifier_noise_dn
        Noise before the amplifier, in electrons, and after it, in DN, without rounding.
    chi_square, degrees_of_freedom
        Of the fit, with sampling errors only; None without a fit.
    scatter_percent
        Relative scatter of the read noise variance about the model beyond sampling. The uncertainties include it.
    """

    settings: tuple[float, ...]
    pre_amplifier_noise_e: Estimate
    post_amplifier_noise_dn: Estimate
    chi_square: float | None = None
    degrees_of_freedom: int | None = None
    scatter_percent: float = 0.0

    def read_noise_dn(self, gain_dn_per_e: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the model's read noise, DN, at the given system gains; None without a fit."""
        pre, post = self.pre_amplifier_noise_e.value, self.post_amplifier_noise_dn.value
        if pre is None or post is None:
            return None
        variance = pre * abs(pre) * gain_dn_per_e**2 + post * abs(post)
        return np.asarray(np.sign(variance) * np.sqrt(np.abs(variance)))


@dataclass(frozen=True)
class ConversionGainSwitch(Shown):
    """The setting at which the pixel switches to a higher conversion gain.

    Parameters
    ----------
    between
        The last setting with the low and the first setting with the high conversion gain.
    between_95
        The same for the 95 % range of the position: the switch lies between these two settings.
    gain_ratio, read_noise_ratio
        Above the switch, relative to below: gain per unit of setting, 1 if settings stay proportional to the gain, and
        pre-amplifier noise in electrons.
    p_value, seen_in
        Probability of such evidence in a series without a switch; the evidence: "gain per setting", "read noise".
    """

    between: tuple[float, float]
    between_95: tuple[float, float]
    gain_ratio: Estimate
    read_noise_ratio: Estimate
    p_value: float
    seen_in: tuple[str, ...]


@dataclass(frozen=True)
class GainSeries(Diagnosed, Reported, Tabular):
    """Result of `calibrate_series`.

    Parameters
    ----------
    steps
        The settings, ascending, each with its `Calibration`.
    scale
        Scale of the settings: "proportional" (ISO, plain gain), "decibels" or "tenths of a decibel".
    switch, modes
        The conversion-gain switch, None if none was found; one or two groups of settings with one conversion gain, with
        the two parts of the read noise.
    unity_gain
        Setting at which the system gain is 1 DN per electron.
    diagnostics, source
        Limitations of the result; what was opened.
    """

    steps: tuple[GainStep, ...]
    scale: SettingScale
    switch: ConversionGainSwitch | None
    modes: tuple[GainMode, ...]
    unity_gain: Estimate
    diagnostics: tuple[Diagnostic, ...]
    source: str

    @property
    def settings(self) -> tuple[float, ...]:
        """The gain settings, ascending."""
        return tuple(step.setting for step in self.steps)

    def at(self, setting: float) -> Calibration:
        """Return the calibration of one setting.

        Raises
        ------
        InputError
            If the series does not contain the setting.
        """
        if setting in self.settings:
            return self.steps[self.settings.index(setting)].calibration
        expected = f"one of {', '.join(f'{known:g}' for known in self.settings)}"
        raise InputError("setting", value=setting, expected=expected)

    @property
    def sensor(self) -> Sensor:
        """The measured sensor with all gain settings that have a system gain, at the lowest.

        Raises
        ------
        CalibrationError
            If there is no base sensor.
        """
        measured = [step for step in self.steps if step.calibration.system_gain_dn_per_e.value is not None]
        lowest, *others = (step.calibration.sensor.with_(gain_setting=step.setting) for step in measured)
        is_iso = lowest.gain_setting_is_iso and self.scale == "proportional"
        return lowest.with_(gain_settings=[other.own_gain_setting for other in others], gain_setting_is_iso=is_iso)

    def save(self, path: str | PathLike[str], name: str | None = None) -> None:
        """Write the sensor file with all gain settings, named as `sensor` is or as given.

        Raises as `sensor`, and `FileError` if it cannot be written.
        """
        (self.sensor if name is None else self.sensor.with_(name=name)).save(path)

    def plot(self, parameter: str = "read_noise_e", ax: Axes | None = None) -> Axes:
        """Draw a parameter against the gain setting on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax, parameter)

    def _table(self) -> ResultTable:
        switch = "none found" if self.switch is None else "between {:g} and {:g}".format(*self.switch.between)
        title = f"GainSeries of {clipped(self.source, 40)}: switch of the conversion gain {switch}"
        rows = [
            (step.setting, *(getattr(step.calibration, name).value for name in _COLUMNS), step.calibration.frame_count)
            for step in self.steps
        ]
        return ResultTable(title, ("setting", *_COLUMNS, "frames"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `photosite calibrate --json` for several gain settings."""
        return {
            "scale": self.scale,
            "settings": [{"setting": step.setting, **step.calibration.to_dict()} for step in self.steps],
            "conversion_gain_switch": None if self.switch is None else _plain(vars(self.switch)),
            "modes": [_plain(vars(mode)) for mode in self.modes],
            "unity_gain": self.unity_gain.to_dict(),
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
        }


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields with estimates as dictionaries and tuples as lists."""
    return {
        name: value.to_dict() if isinstance(value, Estimate) else list(value) if isinstance(value, tuple) else value
        for name, value in fields.items()
    }
