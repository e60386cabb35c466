"""Calibrations of several settings of one measurement, such as filters, read modes or amplifiers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.result import Calibration
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
