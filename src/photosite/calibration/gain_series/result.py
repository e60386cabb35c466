"""What a gain series gives: each setting's calibration, the conversion-gain switch, and read noise in two parts."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.gain_series.gain_law import LawName
from photosite.calibration.result import Calibration
from photosite.errors import InputError
from photosite.values.estimate import Estimate


@dataclass(frozen=True)
class GainStep:
    """One gain setting of a series and its calibration."""

    setting: float
    calibration: Calibration


@dataclass(frozen=True)
class GainMode:
    """Settings of one conversion gain, and the two parts of their read noise: sigma_dn^2 = (pre_e K)^2 + post_dn^2.

    Parameters
    ----------
    settings
        In rising order.
    pre_amplifier_noise_e, post_amplifier_noise_dn
        Noise before the amplifier, in electrons, and after it, in DN, rounding taken off.
    chi_square, degrees_of_freedom
        Of the fit, sampling alone; None where there was none.
    scatter_percent
        Relative scatter of the read noise's variance about the model beyond sampling, in the uncertainties too.
    """

    settings: tuple[float, ...]
    pre_amplifier_noise_e: Estimate
    post_amplifier_noise_dn: Estimate
    chi_square: float | None = None
    degrees_of_freedom: int | None = None
    scatter_percent: float = 0.0

    def read_noise_dn(self, gain_dn_per_e: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The model's read noise, DN, at system gains; None where there is no fit."""
        pre, post = self.pre_amplifier_noise_e.value, self.post_amplifier_noise_dn.value
        if pre is None or post is None:
            return None
        variance = pre * abs(pre) * gain_dn_per_e**2 + post * abs(post)
        return np.asarray(np.sign(variance) * np.sqrt(np.abs(variance)))


@dataclass(frozen=True)
class ConversionGainSwitch:
    """Where the pixel's conversion gain switches to a higher one.

    Parameters
    ----------
    between
        The settings on either side: the last of the low and the first of the high conversion gain.
    between_95
        The same for the lowest and highest place that the data allow: the switch is between these two with 95 %.
    gain_ratio
        Gain per unit of setting above it over that below; 1 where the maker keeps settings proportional to the gain.
    read_noise_ratio
        Noise before the amplifier in electrons, above over below.
    p_value
        Chance of such evidence in a series without a switch.
    seen_in
        What shows it: "gain per setting", "read noise".
    """

    between: tuple[float, float]
    between_95: tuple[float, float]
    gain_ratio: Estimate
    read_noise_ratio: Estimate
    p_value: float
    seen_in: tuple[str, ...]


@dataclass(frozen=True)
class GainSeries:
    """The outcome of `calibrate_series`.

    Parameters
    ----------
    steps
        The settings in rising order, each with its `Calibration`.
    law
        How settings are counted: "proportional" (ISO, plain gain), "decibels" or "tenths of a decibel".
    switch
        The conversion-gain switch, or None where none was found.
    modes
        The settings by conversion gain, one entry or two, with the read noise's two parts.
    unity_gain
        The setting at which an electron is one digital number.
    warnings
        What the reader should know.
    """

    steps: tuple[GainStep, ...]
    law: LawName
    switch: ConversionGainSwitch | None
    modes: tuple[GainMode, ...]
    unity_gain: Estimate
    warnings: tuple[str, ...]
    source: str

    @property
    def settings(self) -> tuple[float, ...]:
        """The gain settings, in rising order."""
        return tuple(step.setting for step in self.steps)

    def at(self, setting: float) -> Calibration:
        """The calibration of one setting.

        Raises
        ------
        InputError
            If there is none.
        """
        for step in self.steps:
            if step.setting == setting:
                return step.calibration
        raise InputError(f"the series has no setting {setting:g}; it has {', '.join(f'{s:g}' for s in self.settings)}")

    def report(self, path: str | PathLike[str]) -> None:
        """Write one self-contained HTML file: the series' table and figures.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        from photosite.report.gain_series import write_gain_series_report

        write_gain_series_report(self, path)

    def to_dict(self) -> dict[str, Any]:
        """What `photosite calibrate --json` prints of several gain settings."""
        switch = self.switch
        return {
            "law": self.law,
            "settings": [{"setting": step.setting, **step.calibration.to_dict()} for step in self.steps],
            "conversion_gain_switch": None
            if switch is None
            else {
                "between": list(switch.between),
                "between_95": list(switch.between_95),
                "gain_ratio": switch.gain_ratio.to_dict(),
                "read_noise_ratio": switch.read_noise_ratio.to_dict(),
                "p_value": switch.p_value,
                "seen_in": list(switch.seen_in),
            },
            "modes": [
                {
                    "settings": list(mode.settings),
                    "pre_amplifier_noise_e": mode.pre_amplifier_noise_e.to_dict(),
                    "post_amplifier_noise_dn": mode.post_amplifier_noise_dn.to_dict(),
                    "chi_square": mode.chi_square,
                    "degrees_of_freedom": mode.degrees_of_freedom,
                    "scatter_percent": mode.scatter_percent,
                }
                for mode in self.modes
            ],
            "unity_gain": self.unity_gain.to_dict(),
            "warnings": list(self.warnings),
        }
