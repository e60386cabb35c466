"""Results as pages, by type, as their `report` methods write them."""

from __future__ import annotations

from functools import singledispatch

from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.calibration.dark.temperature import DarkTemperature
from photosite.calibration.effects.em_gain import EmGainResult
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.result import Calibration
from photosite.calibration.settings_result import SettingsCalibration
from photosite.metrics.camera_quality import CameraQuality
from photosite.metrics.measure import ImageQuality
from photosite.report.calibration import calibration_page
from photosite.report.captures import captures_page, combined_page
from photosite.report.dark_temperature import dark_temperature_page
from photosite.report.em_gain import em_gain_page
from photosite.report.gain_series import gain_series_page
from photosite.report.image_quality import camera_quality_page, image_quality_page
from photosite.report.page import Page
from photosite.report.settings import settings_page
from photosite.report.validation import validation_page
from photosite.validation.frame_validation import FrameValidation


@singledispatch
def page(result: object) -> Page:
    """Return the report of a result as a page, as its type registers."""
    raise TypeError(f"there is no report of a {type(result).__name__}")


page.register(Calibration, calibration_page)
page.register(CaptureCalibration, captures_page)
page.register(CombinedCalibration, combined_page)
page.register(DarkTemperature, dark_temperature_page)
page.register(EmGainResult, em_gain_page)
page.register(FrameValidation, validation_page)
page.register(GainSeries, gain_series_page)
page.register(ImageQuality, image_quality_page)
page.register(CameraQuality, camera_quality_page)
page.register(SettingsCalibration, lambda result: settings_page(result, page))
