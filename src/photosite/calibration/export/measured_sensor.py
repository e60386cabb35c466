"""The sensor description that results from a calibration, and its noise profile."""

from __future__ import annotations

import warnings
from datetime import date
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from photosite.calibration.finding import Finding, SensorChanges, why_zero
from photosite.calibration.parameters import Parameters
from photosite.calibration.withheld import NO_SENSOR_FILE
from photosite.errors import CalibrationError, PhotositeWarning, printable
from photosite.sensor.file_units import CONVERSION
from photosite.sensor.io.sensor_file import write_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import NoiseProfile
from photosite.sensor.noise_terms import QUANTISATION_DN2
from photosite.sensor.quantity import Covariance
from photosite.values.estimate import Estimate
from photosite.values.uncertain import JointCovariance, Measured, Uncertain, Value

if TYPE_CHECKING:
    from photosite.calibration.result import Calibration

_MEASURED_FIELDS = (
    *(
        "read_noise_mv",
        "row_noise_mv",
        "column_noise_mv",
        "dsnu_mv",
        "prnu_percent",
        "dark_voltage_mv_per_s",
        "dcnu_percent",
    ),
    *("black_level_dn", "conversion_gain_uv_per_e"),
)
"""Fields of a sensor file that have the names of measured parameters."""


def measured_sensor(calibration: Calibration) -> Sensor:
    """Return the base sensor with the measured values in place of the assumed ones.

    A base that is a preset does not give its name: the sensor is named after the folder or file of the frames.
    Parameters that could not be estimated keep their value. A negative estimate of a noise or nonuniformity is written
    as 0 with its uncertainty, because a sensor file cannot hold a negative one, and so is noise of rows or columns
    within chance; the source states the estimate or its upper limit.

    Raises
    ------
    CalibrationError
        If the calibration has no base sensor.
    """
    base = calibration.base
    if base is None:
        raise NO_SENSOR_FILE.error(
            "frames alone do not give pixel size, fill factor, spectral response and voltages",
            where=calibration.source,
            hint="Calibrate with a sensor file that states them: {sensor}",
            arguments={"sensor": "nominal.sensor.yaml"},
        )
    source = f"measured from {calibration.frame_count} frames"
    changes: dict[str, Any] = {CONVERSION: base.pixel.conversion_gain_uv_per_e}  # of the volts, unless it is measured
    uncertain: dict[str, Value] = dict(calibration.electrical_scale)
    for field in _MEASURED_FIELDS:
        estimate: Estimate = getattr(calibration, field)
        if estimate.value is not None:
            changes[field] = estimate.measured(source)
            if estimate.value < 0.0:
                changes[field] = Measured(0.0, changes[field].standard_uncertainty, f"{source}; {why_zero(estimate)}")
            uncertain[field] = estimate.uncertain
    found = [entry for entry in calibration.findings.values() if isinstance(entry, Finding)]
    for entry in found:
        changes |= entry.section(base, source)
    changed = SensorChanges(base, source, changes)
    for entry in found:
        changed = changed.updated(entry.subtract(changed))
    changes = dict(changed.fields)
    well = well_capacity(calibration)
    if well.value is not None:
        changes["well_capacity_e"] = well.measured(f"{source}{_at_least(calibration)}")
        uncertain["well_capacity_e"] = well.uncertain
    joint = JointCovariance.of({name: value for name, value in uncertain.items() if isinstance(value, Uncertain)})
    if base.is_preset:
        base = base.with_(name=_name_of_frames(calibration.source))
    # The values in volts are those at the base's analog gain, so the base stays at its own setting.
    measured_at = base.gain_setting if calibration.gain_setting is None else calibration.gain_setting
    base = base.with_(gain_settings=(), gain_setting=measured_at)
    if "dark_voltage_mv_per_s" in changes:
        spread = calibration.temperature_c
        base = base.with_(dark_current_temperature_c=None if spread is None else 0.5 * (spread[0] + spread[1]))
    return base.with_(
        **changes,
        covariance=Covariance.of(joint.names, joint.matrix),
        source=f"{source} ({calibration.source}); the rest as in: {base.provenance.source or base.name}",
        created=date.today().isoformat(),
        frames_sha256=calibration.frames_sha256,
        maps=None,  # `save_measured_sensor` adds the maps of this measurement
    )


def _name_of_frames(source: str) -> str:
    """Return the name of the folder or file that frames are in; a protocol or descriptor lies beside them."""
    path = Path(source).absolute()
    return printable(path.parent.name if path.suffix.lower() in (".yaml", ".yml", ".txt") else path.stem)


def save_measured_sensor(calibration: Calibration, path: str | PathLike[str]) -> None:
    """Write a calibration's sensor file with the maps of the chip, if any. Raises as `Calibration.save`."""
    sensor = measured_sensor(calibration)
    write_sensor(sensor, path, calibration.chip)
    sections = sensor.pixel, sensor.noise, sensor.readout
    assumed = {name for section in sections for name, value in section if isinstance(value, Measured) and value.assumed}
    if kept := [name for name in (*_MEASURED_FIELDS, "well_capacity_e") if name in assumed]:
        problem = f"{path} has assumed values that these frames do not give: {', '.join(kept)}"
        warnings.warn(PhotositeWarning(problem), stacklevel=3)


def well_capacity(calibration: Calibration) -> Estimate:
    """Return the electrons between black level and clipped flat fields.

    This is the capacity of the well if it saturates before the converter. Otherwise it is a lower limit, and no
    measurement of a well that is known to be larger. The saturation capacity of EMVA 1288 is a different parameter, at
    the largest variance.
    """
    capacity, curved = calibration.clipped_electrons, bool(calibration.response_curve)
    base = calibration.base
    way = ", along the response curve" if curved else ""
    method = f"(saturation less black level) / system gain{way}{_at_least(calibration)}"
    larger = isinstance(capacity, Uncertain) and (base is None or base.pixel.well_capacity_e.value >= capacity.value)
    if isinstance(capacity, Uncertain) and larger and _converter_is_the_limit(calibration):
        why = f"the converter saturates before the well; the well holds at least {capacity.value:.4g} electrons"
        return Estimate(reason=why, method=method)
    return Estimate.of(capacity, method)


def _converter_is_the_limit(calibration: Calibration) -> bool:
    return (calibration.saturation_dn.value or 0.0) > (1 << calibration.bits) - 1.5


def _at_least(calibration: Calibration) -> str:
    return "; a lower limit, set by the converter's range" if _converter_is_the_limit(calibration) else ""


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
        total = sum(s.value for s in squares) + QUANTISATION_DN2
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
