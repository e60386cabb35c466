"""Results as pages, by type, as their `report` methods write them. Only the modules of the page are imported."""

from __future__ import annotations

from functools import singledispatch
from importlib import import_module

from photosite.report.page import Page

_PAGES = {
    "Calibration": "calibration.calibration_page",
    "CaptureCalibration": "captures.captures_page",
    "CombinedCalibration": "captures.combined_page",
    "DarkTemperature": "dark_temperature.dark_temperature_page",
    "EmGainResult": "em_gain.em_gain_page",
    "FrameValidation": "validation.validation_page",
    "GainSeries": "gain_series.gain_series_page",
    "ImageQuality": "image_quality.image_quality_page",
    "CameraQuality": "image_quality.camera_quality_page",
    "Judged": "image_quality.judged_page",
    "QualityComparison": "quality_comparison.quality_comparison_page",
    "SettingsCalibration": "settings.settings_page",
}
"""Module of `photosite.report` and function, by the name of the result's type."""


@singledispatch
def page(result: object) -> Page:
    """Return the report of a result as a page, as its type registers, or by the table.

    Raises
    ------
    TypeError
        If there is no report of the type.
    """
    for kind in type(result).__mro__:
        if kind.__name__ in _PAGES:
            module, name = _PAGES[kind.__name__].split(".")
            made: Page = getattr(import_module(f"photosite.report.{module}"), name)(result)
            return made
    raise TypeError(f"there is no report of a {type(result).__name__}")
