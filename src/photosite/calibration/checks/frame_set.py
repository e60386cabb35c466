"""Checks of a frame set before any frame is read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from statistics import median

from photosite.calibration.diagnostics import Check
from photosite.calibration.reduction.groups import group_label
from photosite.errors import InputError
from photosite.frames.frame_set import STEADY_TEMPERATURE_C, FrameSet, gain_settings_text
from photosite.sensor.model import Sensor
from photosite.values.cfa import tile_text
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

_FALSE = "There is no result."

SEVERAL_GAINS = DiagnosticKind(
    "several-gain-settings",
    "refused",
    "The frames have several gain settings where one is needed.",
    _FALSE,
    "Select one setting, or calibrate all of them as a series.",
    ("*",),
    "number of settings",
)
INVALID_EXPOSURE = DiagnosticKind(
    "invalid-exposure-time",
    "refused",
    "An exposure time is not above zero, or known for some flat fields only.",
    _FALSE,
    "State the exposure time of all frames in seconds, or 0 for all flat fields where it is unknown.",
    ("*",),
)
EQUAL_PHOTONS = DiagnosticKind(
    "equal-photons",
    "refused",
    "All light levels state the same number of photons.",
    _FALSE + " Gain and responsivity are slopes against the photons.",
    "State the photons of each level, or omit them to use the exposure times.",
    ("*",),
)
OTHER_TEMPERATURE = DiagnosticKind(
    "other-temperature",
    "warning",
    "The stated temperatures of dark frames and flat fields differ.",
    "The dark current that is subtracted from the flat fields, which doubles about every 7 degrees Celsius, is not "
    "theirs: PRNU contains the difference, and the responsivity its mean.",
    "Take dark frames and flat fields at one temperature.",
    ("prnu*", "responsivity_*", "quantum_efficiency_*", "dark_current_*"),
    "temperature of the flat fields less that of the dark frames, degrees Celsius",
    "none: the temperatures are those that the frames state",
)


def same_sensor(frames: FrameSet, sensor: Sensor | None) -> None:
    """Check that the sensor can have taken the frames: it has their bit depth and CFA."""
    if sensor is None:
        return
    for field, value, needed in (
        ("bits", sensor.readout.bits, frames.bits),
        ("cfa", tile_text(sensor.array.cfa), tile_text(frames.cfa)),
    ):
        if value != needed:
            raise InputError(
                field,
                where=f"sensor '{sensor.name}'",
                value=value,
                expected=f"{needed}, as in the frames",
                hint="Calibrate with the sensor that took the frames",
            )


def usable_groups(frames: FrameSet, sensor: Sensor | None) -> None:
    """Check gain settings, exposure times and photons of the groups."""
    if len(frames.gain_settings) > 1:
        raise SEVERAL_GAINS.error(
            f"the frames have {len(frames.gain_settings)} gain settings ({gain_settings_text(frames)}), and a "
            f"calibration needs one",
            where=frames.source,
            hint="Select one with FrameSet.at_gain(setting), or calibrate all of them with calibrate",
        )
    lights = frames.of_kind("light")
    # A series of light frames may start at 0, the time of an electronic shutter that is not opened.
    unknown = bool(lights) and all(group.exposure_s == 0 for group in lights)
    for group in frames.groups:
        zero = group.exposure_s == 0 and (group.kind == "dark" or group.photons_per_pixel is not None)
        if not (math.isfinite(group.exposure_s) and (group.exposure_s > 0 or zero)):
            raise INVALID_EXPOSURE.error(
                "exposure_s",
                where=f"{frames.source}: {group_label(group)}",
                value=group.exposure_s,
                expected="above 0",
                hint="Correct the protocol",
            )
        if unknown and group.exposure_s > 0:
            raise INVALID_EXPOSURE.error(
                f"light frames have the exposure time 0, which means unknown, and {group_label(group)} another",
                where=frames.source,
                hint="State the exposure time of all frames, or 0 for all",
            )
    photons = {group.photons_per_pixel for group in lights}
    if len(lights) > 1 and len(photons) == 1 and None not in photons:
        raise EQUAL_PHOTONS.error(
            f"all {len(lights)} light levels state {lights[0].photons_per_pixel:g} photons per pixel, but gain and "
            f"responsivity are slopes against the photons",
            where=frames.source,
            hint="State the photons of each level, or omit them to use the exposure times",
        )


def kinds_at_one_temperature(frames: FrameSet, sensor: Sensor | None) -> Iterator[Diagnostic]:
    """Stated temperatures of flat fields that are not those of the dark frames."""
    stated = {
        kind: [celsius for group in frames.of_kind(kind) for celsius in group.temperatures_c if celsius is not None]
        for kind in ("dark", "light")
    }
    if not (stated["dark"] and stated["light"]):
        return
    dark, light = median(stated["dark"]), median(stated["light"])
    if abs(light - dark) > STEADY_TEMPERATURE_C:
        yield OTHER_TEMPERATURE(
            f"the flat fields were taken at {light:.3g} °C and the dark frames at {dark:.3g} °C, as the frames state: "
            f"the dark current that is subtracted is not that of the flat fields. PRNU contains the difference, and "
            f"the responsivity its mean; take both at one temperature",
            light - dark,
        )


CHECKS = (
    Check("set", 10, same_sensor),
    Check("set", 20, usable_groups),
    Check("set", 30, kinds_at_one_temperature),
)
