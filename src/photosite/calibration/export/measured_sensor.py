"""A calibration as a sensor: the description of a sensor with the measured values."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.calibration.effect import Findings
from photosite.calibration.effects.response_curve import ResponseCurves
from photosite.calibration.finding import Finding, SensorChanges, why_zero
from photosite.calibration.parameters import Parameters
from photosite.calibration.photon_transfer.response_curve import ResponseCurve
from photosite.calibration.reduction.provenance import UsedFrame, frames_sha256
from photosite.calibration.withheld import NO_SENSOR_FILE
from photosite.errors import PhotositeWarning, printable
from photosite.sensor.chip import MeasuredChip
from photosite.sensor.file_units import CONVERSION
from photosite.sensor.model import Sensor
from photosite.sensor.quantity import Covariance
from photosite.values.estimate import Estimate
from photosite.values.saved import write
from photosite.values.uncertain import JointCovariance, Measured, Uncertain, Value

_MEASURED_FIELDS = (
    *("read_noise_mv", "row_noise_mv", "column_noise_mv", "dsnu_mv", "prnu_percent"),
    *("dark_voltage_mv_per_s", "dcnu_percent", "black_level_dn", "conversion_gain_uv_per_e"),
)
"""Fields of a sensor file that have the names of measured parameters."""


@dataclass(frozen=True, kw_only=True)
class MeasuredSensor(Parameters):
    """Measured parameters with what a sensor file needs besides; the fields are those of `Calibration`."""

    findings: Findings = field(repr=False)
    clipped_electrons: Value
    frames_used: tuple[UsedFrame, ...]
    source: str
    rows: int
    cols: int
    bits: int
    base: Sensor | None = None
    electrical_scale: Mapping[str, Uncertain] = field(default_factory=dict)
    chip: MeasuredChip | None = None
    gain_setting: float | None = None
    temperature_c: tuple[float, float] | None = None

    @property
    def response_curve(self) -> Mapping[str, ResponseCurve]:
        """Electrons against the signal, for each channel whose response bends."""
        found = self.findings["response_curve"]
        return found.curves if isinstance(found, ResponseCurves) else {}

    @property
    def frame_count(self) -> int:
        """Number of frames used."""
        return len(self.frames_used)

    @cached_property
    def frame_digests(self) -> tuple[str, ...]:
        """One SHA-256 per frame of `frames_used` (`frames_sha256`), computed from the frames on first access.

        Raises
        ------
        FileError
            If a frame is missing or has changed since.
        """
        return frames_sha256(self.frames_used)

    @property
    def frames_sha256(self) -> tuple[str, ...]:
        """`frame_digests`, sorted, as stored in a sensor file."""
        return tuple(sorted(self.frame_digests))

    @property
    def sensor(self) -> Sensor:
        """The measured sensor: `base` with the measured values in place of the assumed ones.

        A base that is a preset does not give its name: the sensor is named after the folder or file of the frames.
        Parameters that could not be estimated keep their value. A negative estimate of a noise or nonuniformity is
        written as 0 with its uncertainty, because a sensor file cannot hold a negative one, and so is noise of rows or
        columns within chance; the source states the estimate or its upper limit.

        Raises
        ------
        CalibrationError
            If `base` is None: frames do not show pixel size, spectral response or volts.
        """
        base = self.base
        if base is None:
            raise NO_SENSOR_FILE.error(
                "frames alone do not give pixel size, fill factor, spectral response and voltages",
                where=self.source,
                hint="Calibrate with a sensor file that states them: {sensor}",
                arguments={"sensor": "nominal.sensor.yaml"},
            )
        source = f"measured from {self.frame_count} frames"
        changes, covariance = self._changes(base, source)
        if base.is_preset:
            base = base.with_(name=_name_of_frames(self.source))
        # The values in volts are those at the base's analog gain, so the base stays at its own setting.
        measured_at = base.gain_setting if self.gain_setting is None else self.gain_setting
        base = base.with_(gain_settings=(), gain_setting=measured_at)
        if "dark_voltage_mv_per_s" in changes:
            spread = self.temperature_c
            base = base.with_(dark_current_temperature_c=None if spread is None else 0.5 * (spread[0] + spread[1]))
        return base.with_(
            **changes,
            covariance=covariance,
            source=f"{source} ({self.source}); the rest as in: {base.provenance.source or base.name}",
            created=date.today().isoformat(),
            frames_sha256=self.frames_sha256,
            maps=None,  # `save` adds the maps of this measurement
        )

    def _changes(self, base: Sensor, source: str) -> tuple[dict[str, Any], Covariance | None]:
        """Return the changed fields of a sensor file, and the covariance of their errors."""
        changes: dict[str, Any] = {CONVERSION: base.pixel.conversion_gain_uv_per_e}  # kept unless it is measured
        uncertain: dict[str, Value] = dict(self.electrical_scale)
        for name in _MEASURED_FIELDS:
            estimate: Estimate = getattr(self, name)
            if estimate.value is None:
                continue
            changes[name] = value = estimate.measured(source)
            if estimate.value < 0.0:
                changes[name] = Measured(0.0, value.standard_uncertainty, f"{source}; {why_zero(estimate)}")
            uncertain[name] = estimate.uncertain
        found = [entry for entry in self.findings.values() if isinstance(entry, Finding)]
        for entry in found:
            changes |= entry.section(base, source)
        changed = SensorChanges(base, source, changes)
        for entry in found:
            changed = changed.updated(entry.subtract(changed))
        changes = dict(changed.fields)
        well = self.well_capacity
        if well.value is not None:
            changes["well_capacity_e"] = well.measured(f"{source}{self._at_least()}")
            uncertain["well_capacity_e"] = well.uncertain
        joint = JointCovariance.of({name: value for name, value in uncertain.items() if isinstance(value, Uncertain)})
        return changes, Covariance.of(joint.names, joint.matrix)

    @property
    def well_capacity(self) -> Estimate:
        """Electrons between black level and clipped flat fields.

        This is the capacity of the well if it saturates before the converter. Otherwise it is a lower limit, and no
        measurement of a well that is known to be larger. The saturation capacity of EMVA 1288 is a different parameter,
        at the largest variance.
        """
        capacity, base = self.clipped_electrons, self.base
        way = ", along the response curve" if self.response_curve else ""
        method = f"(saturation less black level) / system gain{way}{self._at_least()}"
        larger = isinstance(capacity, Uncertain) and (
            base is None or base.pixel.well_capacity_e.value >= capacity.value
        )
        if isinstance(capacity, Uncertain) and larger and self._at_least():
            why = f"the converter saturates before the well; the well holds at least {capacity.value:.4g} electrons"
            return Estimate(reason=why, method=method)
        return Estimate.of(capacity, method)

    def _at_least(self) -> str:
        limited = (self.saturation_dn.value or 0.0) > (1 << self.bits) - 1.5
        return "; a lower limit, set by the converter's range" if limited else ""

    def save(self, path: str | PathLike[str], name: str | None = None) -> None:
        """Write the sensor file, and the chip's maps beside it if there are any.

        Warns of values that the base sensor assumes and these frames do not give: the file keeps them.

        Parameters
        ----------
        path
            The sensor file.
        name
            Name of the sensor, by default that of `sensor`.

        Raises
        ------
        CalibrationError
            If `base` is None.
        FileError
            If a file cannot be written.
        """
        sensor = self.sensor if name is None else self.sensor.with_(name=name)
        write(sensor, path, self.chip)
        sections = sensor.pixel, sensor.noise, sensor.readout
        entries = (entry for section in sections for entry in section)
        assumed = {name for name, value in entries if isinstance(value, Measured) and value.assumed}
        if kept := [name for name in (*_MEASURED_FIELDS, "well_capacity_e") if name in assumed]:
            problem = f"{path} has assumed values that these frames do not give: {', '.join(kept)}"
            warnings.warn(PhotositeWarning(problem), stacklevel=2)


def _name_of_frames(source: str) -> str:
    """Return the name of the folder or file that frames are in; a protocol or descriptor lies beside them."""
    path = Path(source).absolute()
    return printable(path.parent.name if path.suffix.lower() in (".yaml", ".yml", ".txt") else path.stem)
