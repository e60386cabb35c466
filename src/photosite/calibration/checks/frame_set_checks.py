"""Checks of a frame set before any frame is read."""

from __future__ import annotations

import math
from os import PathLike

from photosite.calibration.reduction.groups import group_label
from photosite.errors import CalibrationError, InputError
from photosite.frames.frame_set import FrameSet, gain_settings_text
from photosite.sensor.model import Sensor
from photosite.values.cfa import tile_text


def check_frame_set(frames: FrameSet, sensor: Sensor | None) -> Sensor | None:
    """Raise an error where a frame set cannot support a calibration; return its sensor (default `frames.sensor`).

    Raises
    ------
    InputError
        If `frames` is not a FrameSet, or the sensor has another bit depth or CFA.
    CalibrationError
        If there are several gain settings, equal photons at all light levels, or an exposure time that is not above
        zero.
    """
    if not isinstance(frames, FrameSet):
        path = repr(str(frames)) if isinstance(frames, str | PathLike) else "..."
        hint = f"Open the frames with open_frames({path})"
        raise InputError("frames", value=frames, expected="a FrameSet", hint=hint)
    if frames.bits > 16:
        hint = "Use calibrate_combined, or calibrate the frames of each capture"
        raise InputError("bits", where=frames.source, value=frames.bits, expected="at most 16", hint=hint)
    sensor = sensor if sensor is not None else frames.sensor
    if sensor is not None:
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
    _check_groups(frames)
    return sensor


def _check_groups(frames: FrameSet) -> None:
    def error(what: str, hint: str) -> CalibrationError:
        return CalibrationError(what, where=frames.source, hint=hint)

    if len(frames.gain_settings) > 1:
        raise error(
            f"the frames have {len(frames.gain_settings)} gain settings ({gain_settings_text(frames)}), and a "
            f"calibration needs one",
            "Select one with FrameSet.at_gain(setting), or calibrate all with calibrate_series",
        )
    lights = frames.of_kind("light")
    unknown = any(group.exposure_s == 0 for group in lights)
    for group in frames.groups:
        zero = group.exposure_s == 0 and (group.kind == "dark" or group.photons_per_pixel is not None)
        if not (math.isfinite(group.exposure_s) and (group.exposure_s > 0 or zero)):
            raise CalibrationError(
                "exposure_s",
                where=f"{frames.source}: {group_label(group)}",
                value=group.exposure_s,
                expected="above 0",
                hint="Correct the protocol",
            )
        if unknown and group.exposure_s > 0:
            raise error(
                f"light frames have the exposure time 0, which means unknown, and {group_label(group)} another",
                "State the exposure time of all frames, or 0 for all",
            )
    photons = {group.photons_per_pixel for group in lights}
    if len(lights) > 1 and len(photons) == 1 and None not in photons:
        raise error(
            f"all {len(lights)} light levels state {lights[0].photons_per_pixel:g} photons per pixel, but gain and "
            f"responsivity are slopes against the photons",
            "State the photons of each level, or omit them to use the exposure times",
        )
