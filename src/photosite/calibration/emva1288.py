"""The standard's own figures: EMVA 1288 R4.0 Linear, by straight lines, under the standard's symbols."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from photosite.calibration.parameters import Parameters
from photosite.calibration.withheld import NO_SENSOR_FILE
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Value, derive


@dataclass(frozen=True)
class _Input:
    """Parameters by the standard's lines, and the area of a pixel if it is known."""

    estimates: dict[str, Estimate]
    area_um2: float | None

    def __getitem__(self, name: str) -> Value:
        return self.estimates[name].uncertain


@dataclass(frozen=True)
class Figure:
    """A figure of the standard: what it is, its unit, and the parameter that it is or how it is derived from them."""

    label: str
    unit: str
    source: str | Callable[[_Input], Value]


_GAIN, _CAPACITY, _CAPACITY_P = "system_gain_dn_per_e", "saturation_capacity_e", "saturation_capacity_photons"
_THRESHOLD, _DARK_MEAN, _DARK_VARIANCE = (
    "sensitivity_threshold_photons",
    "dark_current_e_per_s",
    "dark_current_from_variance_e_per_s",
)


def _in_dn(parameter_e: str) -> Callable[[_Input], Value]:
    return lambda of: derive(lambda electrons, gain: electrons * gain, of[parameter_e], of[_GAIN])


def _dark_noise_dn(of: _Input) -> Value:
    """Return the temporal dark noise including rounding, as measured in the frames."""
    noise = derive(lambda s, k: s * k, of["temporal_dark_noise_e"], of[_GAIN])
    return derive(lambda s: (s * s + QUANTIZATION_DN2).sqrt(), noise)


def _range(of: _Input) -> Value:
    return derive(
        lambda db: db.apply(lambda x: 10.0 ** (x / 20.0), lambda x: math.log(10.0) / 20.0 * 10.0 ** (x / 20.0)),
        of["dynamic_range_db"],
    )


def _threshold_e(of: _Input) -> Value:
    return derive(lambda capacity, ratio: capacity / ratio, of[_CAPACITY], _range(of))


def _snr(of: _Input) -> Value:
    return derive(lambda e: e.sqrt(), of[_CAPACITY])


def _per_area(value: str | Callable[[_Input], Value]) -> Callable[[_Input], Value]:
    def divided(of: _Input) -> Value:
        area = of.area_um2
        if area is None:
            return NO_SENSOR_FILE.missing("the pixel size is unknown; give a sensor file that states it")
        return derive(lambda v: v * (1.0 / area), of[value] if isinstance(value, str) else value(of))

    return divided


def _parts(symbol: str, label: str, unit: str, prefix: str) -> dict[str, Figure]:
    """Return a nonuniformity with its row, column and pixel parts."""
    suffix = "e" if unit == "e⁻" else "percent"
    return {f"{symbol}": Figure(label, unit, f"{prefix}_{suffix}")} | {
        f"{symbol}_{short}": Figure(f"{label}, {part}s", unit, f"{prefix}_{part}_{suffix}")
        for short, part in (("row", "row"), ("col", "column"), ("pixel", "pixel"))
    }


EMVA1288: dict[str, Figure] = {
    "K": Figure("System gain", "DN/e⁻", _GAIN),
    "inverse_K": Figure("Inverse of the system gain", "e⁻/DN", lambda of: derive(lambda k: 1.0 / k, of[_GAIN])),
    "R": Figure("Responsivity", "DN/photon", "responsivity_dn_per_photon"),
    "eta": Figure("Quantum efficiency", "%", "quantum_efficiency_percent"),
    "sigma_d": Figure("Temporal dark noise", "e⁻", "temporal_dark_noise_e"),
    "sigma_y_dark": Figure("Temporal dark noise with rounding", "DN", _dark_noise_dn),
    "mu_p_min": Figure("Absolute sensitivity threshold", "photons", _THRESHOLD),
    "mu_p_min_area": Figure("Absolute sensitivity threshold per area", "photons/µm²", _per_area(_THRESHOLD)),
    "mu_e_min": Figure("Sensitivity threshold", "e⁻", _threshold_e),
    "mu_e_min_area": Figure("Sensitivity threshold per area", "e⁻/µm²", _per_area(_threshold_e)),
    "mu_p_sat": Figure("Saturation capacity", "photons", _CAPACITY_P),
    "mu_p_sat_area": Figure("Saturation capacity per area", "photons/µm²", _per_area(_CAPACITY_P)),
    "mu_e_sat": Figure("Saturation capacity", "e⁻", _CAPACITY),
    "mu_e_sat_area": Figure("Saturation capacity per area", "e⁻/µm²", _per_area(_CAPACITY)),
    "SNR_max": Figure("Maximum SNR", "1", _snr),
    "SNR_max_dB": Figure("Maximum SNR", "dB", "snr_max_db"),
    "SNR_max_bit": Figure(
        "Maximum SNR", "bit", lambda of: derive(lambda s: s.decibel(1.0 / math.log10(2.0)), _snr(of))
    ),
    "inverse_SNR_max": Figure("Inverse of the maximum SNR", "%", lambda of: derive(lambda s: 100.0 / s, _snr(of))),
    "DR": Figure("Dynamic range", "1", _range),
    "DR_dB": Figure("Dynamic range", "dB", "dynamic_range_db"),
    "LE": Figure("Linearity error", "%", "linearity_error_percent"),
    "LE_min": Figure("Linearity error, lowest", "%", "linearity_error_min_percent"),
    "LE_max": Figure("Linearity error, highest", "%", "linearity_error_max_percent"),
    **_parts("DSNU1288", "DSNU1288", "e⁻", "dsnu1288"),
    "DSNU1288_DN": Figure("DSNU1288", "DN", _in_dn("dsnu1288_e")),
    **_parts("PRNU1288", "PRNU1288", "%", "prnu1288"),
    **_parts("PRNU1288_unfiltered", "PRNU1288 without high-pass", "%", "prnu1288_unfiltered"),
    "mu_I_mean": Figure("Dark current from the mean", "e⁻/s", _DARK_MEAN),
    "mu_I_mean_DN": Figure("Dark current from the mean", "DN/s", _in_dn(_DARK_MEAN)),
    "mu_I_var": Figure("Dark current from the variance", "e⁻/s", _DARK_VARIANCE),
    "mu_I_var_DN": Figure("Dark current from the variance", "DN/s", _in_dn(_DARK_VARIANCE)),
}
"""The figures by symbol."""


def emva1288_figures(by_line: Parameters, area_um2: float | None) -> dict[str, Estimate]:
    """Return the standard's figures by symbol, from the parameters by the standard's lines and the area of a pixel."""
    given = _Input(by_line.estimates(), area_um2)
    return {
        symbol: given.estimates[figure.source]
        if isinstance(figure.source, str)
        else Estimate.of(figure.source(given), "derived from the other figures")
        for symbol, figure in EMVA1288.items()
    }
