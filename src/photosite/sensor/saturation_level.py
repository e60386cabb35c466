"""The digital number at which pixels saturate: the converter's highest, or that of a full well less its noise."""

from __future__ import annotations

import math

import numpy as np

from photosite.sensor.capture_readout import capture_scale, captures_of, largest_light_e, part_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2, NoiseTerms

NOISE_SIGMAS = 3.0
"""Standard deviations below the level of a full well: one in 740 full pixels is read below it."""


def saturation_level_dn(sensor: Sensor) -> float:
    """Return the number at and above which pixels of a frame are saturated; the same for all channels.

    Where the converter saturates first, it is the highest number. Where a well does, full pixels have a mean below it,
    and read noise, DSNU and the gains of columns scatter them: the level is `NOISE_SIGMAS` below their mean.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> saturation_level_dn(sensor), saturation_level_dn(sensor.with_(well_capacity_e=16000, dsnu_mv=0))
    (4095.0, 1998.0)
    >>> split = ps.load_sensor("split-pixel-automotive")  # companded to 16 bits
    >>> saturation_level_dn(split), largest_light_e(split)
    (60870.0, 790000.0)
    """
    if sensor.captures is not None:
        return _combined_level_dn(sensor)
    _, white = sensor.output_levels_dn
    level, noise = _full_well_dn(sensor)
    if level >= sensor.white_level_dn:
        return white
    black = sensor.readout.black_level_dn.value
    level = math.floor(max(level - NOISE_SIGMAS * noise, 0.5 * (black + level)))
    if sensor.effects is None or sensor.effects.output is None:
        return float(level)
    return float(sensor.effects.output.table(sensor.white_level_dn, black)[level])


def capture_level_dn(sensor: Sensor, name: str) -> float:
    """Return the number at and above which pixels are saturated in one of several captures."""
    return saturation_level_dn(part_sensor(sensor, name))


def _full_well_dn(sensor: Sensor) -> tuple[float, float]:
    """Return mean and standard deviation over full pixels, without the limit of the converter."""
    terms, well_e, effects = NoiseTerms(sensor), sensor.pixel.well_capacity_e.value, sensor.effects
    signal_e, variance_e2 = well_e, float(terms.read_e2 + terms.dsnu_e2) * terms.multiplication**2
    if effects is not None:
        variance_e2 += effects.line_variances[1] * signal_e**2
        if effects.response_curve is not None:
            signal_e = float(effects.response_curve.signal_e(well_e, well_e))
        if (em := effects.em_gain) is not None:
            register_e = math.inf if em.register_well_e is None else em.register_well_e
            if (signal_e := well_e * em.gain.value) < register_e:
                variance_e2 += (em.excess_noise_factor - 1.0) * em.gain.value**2 * well_e
            signal_e = min(signal_e, register_e)
    gain = sensor.system_gain_dn_per_e
    noise_dn = math.sqrt(gain**2 * variance_e2 + QUANTIZATION_DN2)
    return sensor.readout.black_level_dn.value + gain * signal_e, noise_dn


def _combined_level_dn(sensor: Sensor) -> float:
    """Return the level of the frame that combines captures: that of the capture that saturates last."""
    captures, rule = captures_of(sensor), captures_of(sensor).combination
    white = float((1 << rule.bits) - 1)
    level = rule.black_level_dn.value + rule.dn_per_e.value * largest_light_e(sensor)
    if level < white:
        noise_e = 0.0
        for part in captures.parts:
            scale = capture_scale(sensor, part.name)
            if scale.saturation_dn < sensor.white_level_dn - sensor.readout.black_level_dn.value:
                _, noise_dn = _full_well_dn(part_sensor(sensor, part.name))
                noise_e = max(noise_e, noise_dn / scale.dn_per_light_e)
        level = max(level - NOISE_SIGMAS * rule.dn_per_e.value * noise_e, 0.5 * (rule.black_level_dn.value + level))
    if rule.companding is not None:
        return float(math.floor(np.interp(level, rule.companding.linear_dn, rule.companding.companded_dn)))
    return float(math.floor(min(level, white)))
