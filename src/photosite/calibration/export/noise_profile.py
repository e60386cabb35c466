"""The noise profile of a calibration."""

from __future__ import annotations

from photosite.calibration.parameters import Parameters
from photosite.calibration.result import Calibration
from photosite.errors import CalibrationError
from photosite.sensor.noise_profile import NoiseProfile
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Measured


def calibration_noise_profile(calibration: Calibration, gain_setting: float | None = None) -> NoiseProfile:
    """Return the noise profile of a calibrated gain setting, per channel.

    The slope is K / (white - black), with white the converter's largest value. The offset is (read noise^2 + DSNU^2 +
    1/12) / (white - black)^2: the noise of a short exposure. Negative estimates count with their sign. The profile does
    not include the shot noise of the dark current, which depends on the exposure time.

    Raises
    ------
    CalibrationError
        If gain, black level, read noise or DSNU could not be estimated.
    """
    black, gain = (_needed(calibration, name) for name in ("black_level_dn", "system_gain_dn_per_e"))
    white = float((1 << calibration.bits) - 1)
    span = white - black.value
    slope = gain.value / span
    u_span = black.standard_uncertainty / span
    u_slope = slope * ((gain.standard_uncertainty / gain.value) ** 2 + u_span**2) ** 0.5
    channels: dict[str, Parameters] = dict(calibration.channels) or {"M": calibration}
    offsets = []
    for parameters in channels.values():
        squares = [_square(_needed(parameters, name)) for name in ("read_noise_dn", "dsnu_dn")]
        total = sum(s.value for s in squares) + QUANTIZATION_DN2
        u_total = sum(s.standard_uncertainty**2 for s in squares) ** 0.5
        uncertainty = (u_total**2 + (2 * abs(total) * u_span) ** 2) ** 0.5
        offsets.append(Measured(total / span**2, uncertainty / span**2))
    slopes = (Measured(slope, u_slope),) * len(channels)
    name = "" if calibration.base is None else calibration.base.name
    return NoiseProfile(tuple(channels), slopes, tuple(offsets), gain_setting, black.value, white, name)


def _needed(parameters: Parameters, name: str) -> Measured:
    entry: Estimate = getattr(parameters, name)
    if entry.value is None:
        raise CalibrationError(
            id=entry.reason_id, what=f"a noise profile needs {name}, which could not be estimated ({entry.reason})"
        )
    return entry.measured("")


def _square(spread: Measured) -> Measured:
    """Return the variance of a signed standard deviation."""
    value = spread.value * abs(spread.value)
    return Measured(value, 2 * abs(spread.value) * spread.standard_uncertainty + spread.standard_uncertainty**2)
