"""The sensor description that results from a calibration, and its noise profile."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from datetime import date
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from photosite.calibration.converter_error import ConverterCodes
from photosite.calibration.parameters import Parameters
from photosite.errors import CalibrationError, PhotositeWarning, printable
from photosite.sensor.effects.glow import Glow
from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.effects.model import Effects
from photosite.sensor.effects.read_noise_spread import ReadNoiseSpread
from photosite.sensor.effects.response_curve import ResponseCurve
from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.sensor.file_units import CONVERSION
from photosite.sensor.io.sensor_file import write_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import NoiseProfile
from photosite.sensor.noise_terms import QUANTISATION_DN2
from photosite.sensor.quantity import Covariance
from photosite.values.estimate import Estimate
from photosite.values.region import Border
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

_EFFECTS = ("row_noise_mv", "column_noise_mv")
"""Those that most sensors do not show: in a sensor file they are 0 unless they are found beyond chance."""


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
        raise CalibrationError(
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
            if estimate.value < 0.0 or (field in _EFFECTS and not estimate.beyond_chance):
                changes[field] = Measured(0.0, changes[field].standard_uncertainty, f"{source}; {_within(estimate)}")
            uncertain[field] = estimate.uncertain
    changes["line_pattern"] = lines = _line_pattern(calibration, source)
    hot = _take_off_hot_pixels(calibration, changes, source)
    if calibration.blooming is not None and (blooming := calibration.blooming.section(source)) is not None:
        changes["blooming"] = blooming
    if isinstance(calibration.converter, ConverterCodes):
        changes["converter_error"] = calibration.converter.section()
    if calibration.black_level_drift is not None:
        changes["black_level_drift"] = calibration.black_level_drift.section()
    if (glow := calibration.glow) is not None and not glow.unclear:
        changes["glow"] = glow.section()
        if not hot:  # whose dark current is that without glow
            _take_off_glow(changes["glow"], (calibration.rows, calibration.cols), changes)
    _take_off_lines(Effects(readout_channels=calibration.readout_channels, line_pattern=lines), changes)
    _take_off_telegraph_noise(calibration, changes)
    well = well_capacity(calibration)
    if well.value is not None:
        changes["well_capacity_e"] = well.measured(f"{source}{_at_least(calibration)}")
        uncertain["well_capacity_e"] = well.uncertain
    if calibration.coupling is not None and (coupling := calibration.coupling.section(source)) is not None:
        changes["interpixel_capacitance"] = coupling
        # The coupling averages the response of the pixels, before which a sensor file states it.
        for field in {"prnu_percent", "dcnu_percent"} & changes.keys():
            spread, size = changes[field], math.sqrt(coupling.variance_share)
            note = f"{spread.source}, before the coupling of pixels"
            changes[field] = Measured(spread.value / size, spread.standard_uncertainty / size, note)
    joint = JointCovariance.of({name: value for name, value in uncertain.items() if isinstance(value, Uncertain)})
    if base.is_preset:
        base = base.with_(name=_name_of_frames(calibration.source))
    # The values in volts are those at the base's analog gain, so the base stays at its own setting.
    measured_at = base.gain_setting if calibration.gain_setting is None else calibration.gain_setting
    base = base.with_(gain_settings=(), gain_setting=measured_at)
    if calibration.system_gain_dn_per_e.value is not None:
        base = base.with_(
            response_curve=_response_curve(calibration, source), readout_channels=calibration.readout_channels
        )
    if calibration.charge_transfer is not None and base.effects is not None and base.effects.charge_transfer:
        changes["charge_transfer"] = calibration.charge_transfer.section(base.effects.charge_transfer, source)
    top, bottom, left, right = _border_of(calibration)
    if not any((top, bottom, left, right)) and base.effects is not None:
        base = base.with_(optical_black=None)
    if "dark_voltage_mv_per_s" in changes:
        spread = calibration.temperature_c
        base = base.with_(dark_current_temperature_c=None if spread is None else 0.5 * (spread[0] + spread[1]))
    return base.with_(
        **changes,
        covariance=Covariance.of(joint.names, joint.matrix),
        rows=calibration.rows + top + bottom,
        cols=calibration.cols + left + right,
        source=f"{source} ({calibration.source}); the rest as in: {base.provenance.source or base.name}",
        created=date.today().isoformat(),
        frames_sha256=calibration.frames_sha256,
        maps=None,  # `save_measured_sensor` adds the maps of this measurement
    )


def _within(estimate: Estimate) -> str:
    """Return how a noise or nonuniformity that the file states as 0 was estimated."""
    if (limit := estimate.upper_limit_95) is not None:
        return f"not distinguishable from 0, 95 % upper limit {limit:.3g}"
    if (estimate.value or 0.0) < 0.0:
        return "the variance is negative"
    return f"the estimate, {estimate.value:.3g}, is within chance of 0"


def _border_of(calibration: Calibration) -> Border:
    """Return the border that the base states around the calibrated pixels; none for maps, which are of these alone."""
    base = calibration.base
    border = None if base is None or base.effects is None else base.effects.border
    if base is None or border is None or calibration.chip is not None:
        return 0, 0, 0, 0
    size = calibration.rows + border[0] + border[1], calibration.cols + border[2] + border[3]
    return border if size == (base.array.rows, base.array.cols) else (0, 0, 0, 0)


BEYOND_CHANCE = 6.0
"""Value over standard uncertainty of the spread of lines above which a sensor file has it: a variance of about 3.6
uncertainties. Of 1000 sensors without a pattern, two have one of the three by chance."""


def _line_pattern(calibration: Calibration, source: str) -> LinePattern | None:
    """Return the fixed pattern of rows and columns that is beyond chance; parts that are missing are the base's."""
    assumed = None if calibration.base is None or (base := calibration.base.effects) is None else base.line_pattern
    found = {}
    for name, usual in assumed or LinePattern():
        entry: Estimate = getattr(calibration, name)
        if entry.value is None:
            found[name] = usual
        elif entry.value > BEYOND_CHANCE * (entry.standard_uncertainty or 0.0):
            found[name] = entry.measured(source)
    return LinePattern(**found) if any(part.value for part in found.values()) else None


def _take_off_lines(effects: Effects, changes: dict[str, Any]) -> None:
    """Subtract the variances of lines and readout channels, which the file states, from the patterns with them."""
    offset_e2, gain = effects.line_variances
    square_mv = (1e-3 * changes[CONVERSION].value) ** 2
    taken = {"prnu_percent": 1e4 * gain, "dcnu_percent": 1e4 * gain, "dsnu_mv": square_mv * offset_e2}
    for name, variance in taken.items():
        if name in changes and variance > 0.0:
            whole = changes[name]
            left = Uncertain.of(whole.value**2 - variance, 2.0 * whole.value * whole.standard_uncertainty)
            rest = Estimate.of_variance(left, "")
            note = f"{whole.source}; without rows, columns and readout channels"
            if (rest.value or 0.0) < 0.0:
                note += f": {_within(rest)}"
            changes[name] = Measured(max(rest.value or 0.0, 0.0), rest.standard_uncertainty or 0.0, note)


def _take_off_telegraph_noise(calibration: Calibration, changes: dict[str, Any]) -> None:
    """State the spread of the read noise and blinking pixels; the read noise is then that of the other pixels.

    Without maps that give them, those of the base stay.
    """
    temporal, gain = calibration.temporal, calibration.system_gain_dn_per_e.value
    if gain is None or "read_noise_mv" not in changes:
        return
    whole, mv_per_e = changes["read_noise_mv"], 1e-3 * changes[CONVERSION].value
    lines_mv2 = sum(changes[name].value ** 2 for name in _EFFECTS if name in changes)
    if temporal is not None and (spread := temporal.read_noise_log_spread).value is not None:
        seen = spread.upper_limit_95 is None
        changes["read_noise_spread"] = ReadNoiseSpread(log_spread=spread.value) if seen else None
    names = "blinking_fraction", "blinking_amplitude_dn", "steady_noise_dn"
    share, amplitude, steady = (None if temporal is None else _plain(getattr(temporal, name)) for name in names)
    if share and amplitude and steady:
        changes["telegraph_noise"] = TelegraphNoise(fraction=min(share.value, 1.0), amplitude_e=amplitude.value / gain)
        read_mv = steady * (mv_per_e / gain)
        rest = (read_mv * read_mv + lines_mv2).sqrt()
        note = (
            f"of pixels without telegraph noise: share {share.value:.3g} ± {share.standard_uncertainty:.2g}, "
            f"mean amplitude {amplitude.value:.3g} ± {amplitude.standard_uncertainty:.2g} DN"
        )
    elif calibration.base and calibration.base.effects and (assumed := calibration.base.effects.telegraph_noise):
        taken = mv_per_e**2 * assumed.variance_e2
        if taken > whole.value**2 - lines_mv2:
            changes["telegraph_noise"] = None  # the frames have less
            return
        rest = Uncertain.of(whole.value**2 - taken, 2.0 * whole.value * whole.standard_uncertainty).sqrt()
        note = "without the telegraph noise stated before"
    else:
        return
    changes["read_noise_mv"] = Measured(rest.value, rest.standard_uncertainty, f"{whole.source}, {note}")


def _plain(estimate: Estimate) -> Uncertain | None:
    """Return a positive value with its standard uncertainty; None without one."""
    if estimate.value is None or estimate.standard_uncertainty is None or estimate.value <= 0.0:
        return None
    return Uncertain.of(estimate.value, estimate.standard_uncertainty)


def _take_off_hot_pixels(calibration: Calibration, changes: dict[str, Any], source: str) -> bool:
    """State hot pixels apart from mean and spread of the dark current; return whether there are any."""
    found, current = calibration.dark_distribution, calibration.dark_current_dn_per_s
    if found is None or current.value is None or "dark_voltage_mv_per_s" not in changes:
        return False
    section = found.section(calibration.system_gain_dn_per_e.uncertain, source)
    mean, dcnu = found.mean_dn_per_s, found.dcnu_percent
    if section is None or mean.value is None or mean.value <= 0.0:
        return False
    note = f"{source}, without hot pixels and glow"
    whole, share = changes["dark_voltage_mv_per_s"], mean.value / current.value
    spread = math.hypot(
        share * whole.standard_uncertainty, whole.value * (mean.standard_uncertainty or 0.0) / current.value
    )
    changes |= {"hot_pixels": section, "dark_voltage_mv_per_s": Measured(share * whole.value, spread, note)}
    if dcnu.value is not None:
        changes["dcnu_percent"] = Measured(max(dcnu.value, 0.0), dcnu.standard_uncertainty or 0.0, note)
    return True


def _take_off_glow(glow: Glow | None, shape: tuple[int, int], changes: dict[str, Any]) -> None:
    """Subtract a glow from the dark current and its nonuniformity, because the file states both."""
    if glow is None or (whole := changes.get("dark_voltage_mv_per_s")) is None:
        return
    rate_e_per_s = glow.map(*shape)
    mv_per_e = 1e-3 * changes[CONVERSION].value
    rest = max(whole.value - mv_per_e * float(rate_e_per_s.mean()), 0.0)
    changes["dark_voltage_mv_per_s"] = replace(whole, value=rest, source=f"{whole.source}; without glow")
    if (spread := changes.get("dcnu_percent")) is not None:
        variance = (0.01 * spread.value * whole.value) ** 2 - (mv_per_e * float(rate_e_per_s.std())) ** 2
        percent = 100.0 * math.sqrt(max(variance, 0.0)) / rest if rest > 0.0 else 0.0
        scale = whole.value / rest if rest > 0.0 else 1.0
        changes["dcnu_percent"] = Measured(
            percent, spread.standard_uncertainty * scale, f"{spread.source}; without glow"
        )


def _response_curve(calibration: Calibration, source: str) -> ResponseCurve | None:
    """Return the response curve: the channels' weighted mean at the charges of the one with the widest range."""
    curves = list(calibration.response_curve.values())
    if not curves:
        return None
    tables = []
    for curve in curves:
        charge = np.array([entry.value for entry in curve.electrons])
        order = np.argsort(charge)
        deviation = np.array([entry.value for entry in curve.deviation_percent])
        spread = np.array([entry.standard_uncertainty for entry in curve.deviation_percent])
        tables.append((charge[order], deviation[order], spread[order]))
    grid = max((charge for charge, _, _ in tables), key=lambda charge: float(charge[-1]))
    grid = grid[np.append(True, np.diff(grid) > 1e-3 * grid[-1])]
    values, weights = np.zeros((2, grid.size))
    spread = np.full(grid.size, np.inf)
    for charge, deviation, own in tables:
        covered = grid <= charge[-1]
        at, u = (np.interp(grid, np.append(0.0, charge), np.append(0.0, part)) for part in (deviation, own))
        weight = covered / np.maximum(u, 1e-9) ** 2
        values += weight * at
        weights += weight
        # The channels share the gain, so that their mean is not better known than the best of them.
        spread = np.minimum(spread, np.where(covered, u, np.inf))
    return ResponseCurve(
        charge_e=(0.0, *grid.tolist()),
        deviation_percent=(0.0, *(values / weights).tolist()),
        standard_uncertainty_percent=(0.0, *spread.tolist()),
        source=source,
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
        raise CalibrationError(f"a noise profile needs {name}, which could not be estimated ({entry.reason})")
    return entry.measured("")


def _square(spread: Measured) -> Measured:
    """Return the variance of a signed standard deviation."""
    value = spread.value * abs(spread.value)
    return Measured(value, 2 * abs(spread.value) * spread.standard_uncertainty + spread.standard_uncertainty**2)
