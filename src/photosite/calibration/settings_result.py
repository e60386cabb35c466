"""Calibrations of several settings of one measurement, such as filters, read modes or amplifiers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.result import Calibration
from photosite.errors import CalibrationError
from photosite.frames.conditions import CONDITIONS
from photosite.values.diagnostic import Diagnosed, Diagnostic, DiagnosticKind
from photosite.values.shown import Reported, ResultTable, Tabular

OneSetting = Calibration | GainSeries | CaptureCalibration | CombinedCalibration

SHOWN = (
    "system_gain_dn_per_e",
    "read_noise_e",
    "dsnu_e",
    "prnu_percent",
    "dark_current_e_per_s",
    "saturation_capacity_e",
)

NOT_CALIBRATED = DiagnosticKind(
    "setting-not-calibrated",
    "warning",
    "The frames of a setting cannot be calibrated.",
    "The other settings have results.",
    "Take the dark frames and flat fields of this setting, or leave its frames out.",
    false_alarms="none: the calibration of the setting refuses",
)


@dataclass(frozen=True)
class SettingsCalibration(Diagnosed, Reported, Tabular):
    """The result of `calibrate` for several settings, each calibrated by itself.

    Parameters
    ----------
    settings
        The result of each setting by its conditions, such as "filter=R".
    refused
        Reasons why settings could not be calibrated, in the same form.
    """

    settings: Mapping[str, OneSetting]
    refused: Mapping[str, str]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]
        """The diagnostics of the settings, each with its setting."""
        refused = [NOT_CALIBRATED(reason).within(name) for name, reason in self.refused.items()]
        found = [entry.within(name) for name, each in self.settings.items() for entry in each.diagnostics]
        return (*refused, *found)

    @property
    def calibrations(self) -> dict[str, Calibration]:
        """The calibration of each setting, and of each gain setting of a series, by its conditions."""
        found: dict[str, Calibration] = {}
        for name, each in self.settings.items():
            if isinstance(each, Calibration):
                found[name] = each
            elif isinstance(each, GainSeries):
                found |= {f"{name},gain_setting={step.setting:g}": step.calibration for step in each.steps}
        return found

    def save(self, path: str | PathLike[str]) -> tuple[dict[str, Path], dict[str, str]]:
        """Write a sensor file for each setting, `mine.R.sensor.yaml` beside mine.sensor.yaml, which is not written.

        Returns
        -------
        written, missing
            The file of each setting, and the reasons why others have none.

        Raises
        ------
        CalibrationError
            If no setting gives a sensor file.
        FileError
            If a file cannot be written.
        """
        sensors, missing = {}, dict(self.refused)
        for name, each in self.settings.items():
            try:
                if not isinstance(each, Calibration | GainSeries):
                    raise CalibrationError("several captures do not show all of a sensor")
                sensors[name] = each.sensor
            except CalibrationError as error:
                missing[name] = str(error)
        if not sensors:
            name, reason = next(iter(missing.items()))
            raise CalibrationError(f"no setting gives a sensor file; {name}: {reason}")
        paths = setting_paths(path, (*self.settings, *self.refused))
        for name, sensor in sensors.items():
            result = self.settings[name]
            assert isinstance(result, Calibration | GainSeries)
            result.save(paths[name], f"{sensor.name}, {name}")
        return {name: paths[name] for name in sensors}, missing

    def to_dict(self) -> dict[str, Any]:
        """Return the result of each setting, and the reasons for those without one."""
        return {
            "settings": [
                *({"conditions": name, **each.to_dict()} for name, each in self.settings.items()),
                *({"conditions": name, "error": reason} for name, reason in self.refused.items()),
            ],
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
        }

    def _table(self) -> ResultTable:
        rows = []
        for name, each in self.calibrations.items():
            entries = [getattr(each, parameter) for parameter in SHOWN]
            rows.append(
                (name, each.frame_count, *(part for e in entries for part in (e.value, e.standard_uncertainty)))
            )
        columns = ("setting", "frames", *(part for name in SHOWN for part in (name, f"{name}_standard_uncertainty")))
        return ResultTable("Settings", columns, rows)


def setting_paths(path: str | PathLike[str], settings: Sequence[str]) -> dict[str, Path]:
    """Return a sensor file's name for each setting: the values of its conditions before the suffix.

    Names of files that would be the same, or differ in the case of letters only, get a number.

    Examples
    --------
    >>> paths = setting_paths("mine.sensor.yaml", ["filter=R,binning=2x2", "filter=O III", "filter=O/III"])
    >>> [path.name for path in paths.values()]
    ['mine.R_2x2.sensor.yaml', 'mine.O-III.sensor.yaml', 'mine.O-III-2.sensor.yaml']
    """
    path = Path(path)
    stem = path.name.removesuffix(path.suffix).removesuffix(".sensor")
    suffix = path.name.removeprefix(stem)
    found: dict[str, Path] = {}
    used: set[str] = set()
    for setting in settings:
        values = re.split(rf"(?:^|,)(?:{'|'.join(CONDITIONS)})=", setting)[1:]
        part = "_".join(re.sub(r"[^\w.+-]+", "-", value).strip(".") for value in values)
        number = 1
        while (own := part if number == 1 else f"{part}-{number}").casefold() in used:
            number += 1
        used.add(own.casefold())
        found[setting] = path.with_name(f"{stem}.{own}{suffix}")
    return found
