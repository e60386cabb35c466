"""Electron multiplication: gain and excess noise of a register, from two calibrations in metered light."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.calibration.result import Calibration
from photosite.errors import CalibrationError
from photosite.sensor.effects.em_gain import EmGain
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain, Value, derive


@dataclass(frozen=True)
class EmGainResult:
    """Gain and excess noise of a multiplication register.

    Parameters
    ----------
    gain
        Mean electrons behind the register per electron in front of it.
    excess_noise_factor
        F^2, the variance of the signal over gain^2 times that of the charge.
    read_noise_e
        Read noise in electrons in front of the register.
    """

    gain: Estimate
    excess_noise_factor: Estimate
    read_noise_e: Estimate


def measure_em_gain(unity: Calibration, multiplied: Calibration) -> EmGainResult:
    """Estimate the gain of a multiplication register, and its excess noise.

    Parameters
    ----------
    unity
        Calibration of the camera with a multiplication gain of 1.
    multiplied
        Calibration with the gain to measure; temperature and readout as before.

    Raises
    ------
    CalibrationError
        If responsivity or system gain of one of them is unknown.

    Notes
    -----
    The gain g is the ratio of the responsivities in DN per photon. Photon transfer behind the register measures the
    slope K g F^2, where K is the system gain at a gain of 1.
    """
    slopes: list[Uncertain] = []
    for name, calibration in (("unity", unity), ("multiplied", multiplied)):
        for parameter in ("responsivity_dn_per_photon", "system_gain_dn_per_e"):
            value = getattr(calibration, parameter).uncertain
            if not isinstance(value, Uncertain):
                hint = "Give the photons per pixel of the flat fields, in a protocol"
                raise CalibrationError(f"{name}: {parameter} is unknown: {value.reason}", hint=hint)
            slopes.append(value)
    response, k, response_multiplied, k_multiplied = slopes
    gain = response_multiplied / response
    noise: Value = multiplied.read_noise_dn.uncertain
    return EmGainResult(
        Estimate.of(gain, "ratio of the responsivities"),
        Estimate.of(k_multiplied / (gain * k), "ratio of the slopes of photon transfer over the gain"),
        Estimate.of(
            derive(lambda sigma: sigma / (gain * k), noise),
            "read noise in DN over the gain and the system gain in front of it",
        ),
    )


def stated_gain_warning(em_gain: EmGain, system_gain: Estimate) -> str | None:
    """Return what a stated multiplication gain means for a calibration; None without system gain."""
    if system_gain.value is None:
        return None
    g, factor, slope = em_gain.gain, em_gain.excess_noise_factor, system_gain.value
    return (
        f"the sensor file states an electron multiplication gain of {g:g}: the system gain of photon transfer, "
        f"{slope:.4g} DN/e-, contains this gain and the excess noise factor, {factor:.3g}. It is "
        f"{slope / factor:.4g} DN per electron in front of the register, and {slope / factor / g:.4g} DN behind it. "
        f"Values in electrons and the quantum efficiency are too low by the excess noise factor"
    )
