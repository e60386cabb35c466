"""Prediction of a measurement's precision: the fits of the calibration, applied to the expected levels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photosite.calibration.chip_maps.pixel_gain import pixel_gain_uncertainty
from photosite.calibration.chip_maps.response_map import light_in_range
from photosite.calibration.dark.dark_frames import dark_lines, measure_dark_level
from photosite.calibration.dark.dark_lines import DarkLines
from photosite.calibration.measurements import NO_LIGHT, Measurements, pool_channels
from photosite.calibration.parameters import Parameters, estimate_parameters
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.photon_transfer import fit_gain, gain_value
from photosite.calibration.reduction.groups import (
    CLIPPED_DARK_FRACTION,
    GroupStatistics,
    Level,
    label_tile,
    pooled_level,
    reference_dark,
)
from photosite.calibration.spatial.fixed_pattern import plan_slopes
from photosite.calibration.spatial.pixel_slopes import (
    SlopeSpread,
    relative_response_variance,
    slope_coefficients,
    slope_noise,
)
from photosite.engine.map_statistics import label_pixels
from photosite.errors import InputError
from photosite.frames.frame_set import FrameGroup
from photosite.frames.frame_settings import Kind
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Uncertain, Value

NOT_PREDICTED = Missing("not predicted by a plan; DSNU1288 and PRNU1288 are about as precise as DSNU and PRNU")

_PIXEL_GAIN_METHOD = "slope of a pixel's variance against its mean"

_FAR = 4.0
"""Standard deviations past the middle of the clipping beyond which all pixels of a level count as clipped."""


@dataclass(frozen=True)
class PlannedGroup:
    """Frames to be taken with one setting."""

    kind: Kind
    exposure_s: float
    frames: int  # number of frames
    electrons: tuple[float, ...]  # mean from light in a pixel of each channel, in the order of `channel_names`
    photons_per_pixel: float | None = None  # mean, where the light is metered


def predict(sensor: Sensor, groups: Sequence[PlannedGroup]) -> Parameters:
    """Return the parameters that a calibration of these frames will give on average, with their uncertainties.

    The expected mean, variance and sampling error of each group pass through the fits and the propagation of
    `calibrate`. The sampling error of a variance over n frames of P pixels is (2 v^2 / (n - 1) + k4 / n) / P, with k4
    the fourth cumulant of a Poisson count, plus the effect of the pixels' different sensitivities. Row, column and
    high-passed parts are not predicted, nor is the scatter of a real laboratory (drifting lamp, uneven converter
    steps). The sensor's noise, gain and fixed pattern are those of its file.

    Raises
    ------
    InputError
        If no dark exposure has two frames, or dark frames would clip at 0.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=100, cols=100, black_level_dn=32)
    >>> darks = PlannedGroup("dark", 0.01, 50, (0.0, 0.0, 0.0))
    >>> lights = [PlannedGroup("light", 0.01 * k, 4, (1e3 * k, 2e3 * k, 1e3 * k)) for k in range(1, 20)]
    >>> found = predict(sensor, [darks, *lights])
    >>> round(100 * found.read_noise_dn.standard_uncertainty / found.read_noise_dn.value, 2)  # 1 / sqrt(2 * 49 * 10^4)
    0.1
    """
    darks, lights = _expected_groups(sensor, groups)
    pixels = [level.pixels for level in darks[0].levels]
    reference = darks[reference_dark(darks)]
    lines = [dark_lines(darks, k) for k in range(len(pixels))]
    channels = _channels(sensor, lights, lines)
    gain: Value = NO_LIGHT
    if lights:
        gain = gain_value(fit_gain([channel.levels for channel in channels], [channel.used for channel in channels]))
    measured = []
    for k, line in enumerate(lines):
        m, slopes = _dark_measurements(sensor, line, darks, reference, k)
        if channels:
            response_variance = _response_variance(sensor, channels[k], lights, slopes)
            m = m.with_channel(channels[k], channels[k].responsivity(), response_variance=response_variance)
        measured.append(m.without_dark_shot_noise(reference.group.exposure_s).for_sensor())
    dark = measure_dark_level(dark_lines(darks, None), pooled_level(reference.levels), reference.label)
    names = channel_names(sensor.array.cfa)
    together = pool_channels(names, measured, dark, gain, reference.group.exposure_s)
    return estimate_parameters(together, Uncertain(sensor.mv_per_dn))


def predict_pixel_gain(sensor: Sensor, groups: Sequence[PlannedGroup]) -> Estimate:
    """Return the gain of one pixel, DN per electron, with its standard uncertainty in the least precise channel.

    It is the closed form of `pixel_gain_uncertainty`, of the dark frames of the read noise and the light levels of the
    linear range with two frames or more. Arguments and errors are those of `predict`.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=100, cols=100, black_level_dn=32)
    >>> darks = PlannedGroup("dark", 0.01, 400, (0.0, 0.0, 0.0))
    >>> lights = [PlannedGroup("light", 0.01 * k, 200, (2e3 * k, 2e3 * k, 2e3 * k)) for k in range(1, 9)]
    >>> found = predict_pixel_gain(sensor, [darks, *lights])
    >>> round(100 * found.standard_uncertainty / found.value, 1)  # about sqrt(2 / (8 * 199))
    3.7
    """
    darks, lights = _expected_groups(sensor, groups)
    dark = darks[reference_dark(darks)]
    found = []
    for k, channel in enumerate(_channels(sensor, lights, [dark_lines(darks, k) for k in range(len(dark.levels))])):
        used = [lights[i].levels[k] for i in light_in_range(channel)]
        levels = [dark.levels[k], *(level for level in used if level.repeated)]
        if len(levels) > 1:
            signal, variance, frames = np.array([(level.mean, level.variance, level.frames) for level in levels]).T
            found.append(pixel_gain_uncertainty(signal, variance, frames))
    if not found:
        return Estimate(reason="no light level of the linear range has two frames", method=_PIXEL_GAIN_METHOD)
    return Estimate(sensor.system_gain_dn_per_e, max(found), method=_PIXEL_GAIN_METHOD)


def _channels(sensor: Sensor, lights: Sequence[GroupStatistics], lines: Sequence[DarkLines]) -> list[Channel]:
    if not lights:
        return []
    return [Channel.of(k, lights, line, int(sensor.white_level_dn)) for k, line in enumerate(lines)]


def _expected_groups(
    sensor: Sensor, groups: Sequence[PlannedGroup]
) -> tuple[list[GroupStatistics], list[GroupStatistics]]:
    """Return the expected statistics of dark frames and flat fields."""
    tile = label_tile(sensor.array.cfa)
    pixels = label_pixels((sensor.array.rows, sensor.array.cols), tile).tolist()
    if min(pixels) == 0:
        size = f"{sensor.array.rows} x {sensor.array.cols} pixels"
        expected = "at least one pixel of each filter of the color filter array"
        raise InputError("the chip", value=size, expected=expected)
    statistics = [
        GroupStatistics(
            FrameGroup(group.kind, group.exposure_s, (), group.photons_per_pixel),
            tuple(_level(sensor, group, k, count) for k, count in enumerate(pixels)),
        )
        for group in sorted(groups, key=lambda group: group.exposure_s)
    ]
    darks, lights = ([entry for entry in statistics if entry.group.kind == kind] for kind in ("dark", "light"))
    if not any(entry.frames > 1 for entry in darks):
        hint = "Plan several dark frames at one exposure time: they show the read noise"
        raise InputError("groups", expected="a plan with at least two dark frames at one exposure", hint=hint)
    for entry in darks:
        low = max(level.low_fraction for level in entry.levels)
        if low > CLIPPED_DARK_FRACTION:
            raise InputError(
                f"with this black level {100 * low:.3g} % of the pixels of the {entry.label} would be clipped at 0 DN",
                hint="Use a black level (pedestal) of at least five standard deviations of the dark frames",
            )
    return darks, lights


def _level(sensor: Sensor, group: PlannedGroup, channel: int, pixels: int) -> Level:
    """Return the expected level of one channel of a group."""
    from scipy.special import ndtr

    gain, noise, n = sensor.system_gain_dn_per_e, sensor.noise, group.frames
    dark_e = sensor.electrons(noise.dark_voltage_mv_per_s.value) * group.exposure_s
    mean_e = group.electrons[channel] + dark_e
    read_e, dsnu_e = sensor.electrons(noise.read_noise_mv.value), sensor.electrons(noise.dsnu_mv.value)
    uneven_e = math.hypot(
        noise.prnu_percent.value / 100 * group.electrons[channel], noise.dcnu_percent.value / 100 * dark_e
    )
    black, capacity = sensor.readout.black_level_dn.value, sensor.saturation_capacity_e
    well_limited = sensor.pixel.well_capacity_e.value <= capacity
    spread_e = math.sqrt(mean_e + read_e**2 + uneven_e**2 + dsnu_e**2)
    beyond = (mean_e - capacity) / spread_e if spread_e > 0.0 else -math.inf
    unclipped_share = float(ndtr(-beyond)) if beyond < _FAR else 0.0
    variance_e = mean_e * unclipped_share + read_e**2 * (1.0 if well_limited else unclipped_share)
    variance = gain**2 * variance_e + (1.0 / 12.0 if unclipped_share or well_limited else 0.0)
    fourth = gain**4 * mean_e * unclipped_share
    scatter = (fourth / n + (gain**2 * uneven_e * unclipped_share) ** 2 + 2.0 * variance**2 / max(n - 1, 1)) / pixels
    spatial = gain**2 * (uneven_e**2 * unclipped_share + dsnu_e**2) + variance / n
    mean = black + gain * (mean_e * unclipped_share + capacity * (1.0 - unclipped_share))
    sigma = gain * spread_e
    return Level(
        pixels=pixels,
        frames=n,
        mean=mean,
        mean_variance=variance / (n * pixels),
        variance=variance if n > 1 else math.nan,
        variance_uncertainty=math.sqrt(scatter) if n > 1 else math.nan,
        spatial_variance=spatial,
        low_fraction=float(ndtr((0.5 - mean) / sigma)) if sigma > 0.0 else 0.0,
        high_fraction=0.0 if well_limited else 1.0 - unclipped_share,
        frame_shift=0.0,
    ).with_rounding()


def _dark_measurements(
    sensor: Sensor, lines: DarkLines, darks: Sequence[GroupStatistics], reference: GroupStatistics, index: int
) -> tuple[Measurements, SlopeSpread | None]:
    """Return the expected dark measurements of a channel, and its dark slopes; None with one dark exposure."""
    level = reference.levels[index]
    spread = Uncertain.of_variance(level.spatial_variance, level.spatial_variance * math.sqrt(2.0 / level.pixels))
    measured = replace(
        measure_dark_level(lines, level, reference.label),
        row_variance=NOT_PREDICTED,
        column_variance=NOT_PREDICTED,
        dsnu_variance=spread - level.noise * (1.0 / level.frames),
        dsnu1288=NOT_PREDICTED,
        dsnu1288_filtered=NOT_PREDICTED,
        prnu1288=NOT_PREDICTED,
        prnu1288_unfiltered=NOT_PREDICTED,
        linearity=(NOT_PREDICTED,),
    )
    slopes = _dark_slopes(sensor, darks, index)
    return measured if slopes is None else replace(measured, dark_slope_variance=slopes.variance), slopes


def _dark_slopes(sensor: Sensor, darks: Sequence[GroupStatistics], index: int) -> SlopeSpread | None:
    exposure = np.array([entry.group.exposure_s for entry in darks])
    if len(np.unique(exposure)) < 2:
        return None
    levels = [entry.levels[index] for entry in darks]
    frames = np.array([level.frames for level in levels])
    coefficients = slope_coefficients(exposure, frames.astype(float))
    variance = np.array([level.variance for level in levels])
    known = np.isfinite(variance)
    variance = np.where(known, variance, variance[known].mean())
    uncertainty = np.array([level.variance_uncertainty if level.repeated else 0.0 for level in levels])
    noise = slope_noise(coefficients, frames, variance, uncertainty)
    rate = sensor.system_gain_dn_per_e * sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value)
    true = (rate * sensor.noise.dcnu_percent.value / 100) ** 2
    # The log-normal's fourth cumulant, of a relative variance w - 1.
    w = 1.0 + (sensor.noise.dcnu_percent.value / 100) ** 2
    excess = true**2 * (w**4 + 2.0 * w**3 + 3.0 * w**2 - 6.0)
    total, pixels = true + noise.value, levels[0].pixels
    sampled = Uncertain.of_variance(total, math.sqrt((2.0 * total**2 + excess) / pixels))
    return SlopeSpread(pixels, rate, sampled - noise)


def _response_variance(
    sensor: Sensor, channel: Channel, lights: Sequence[GroupStatistics], dark: SlopeSpread | None
) -> Value:
    plan = plan_slopes(channel, lights)
    if isinstance(plan, Missing):
        return plan
    levels = channel.levels
    place = {int(group): k for k, group in enumerate(levels.group)}
    slope = sum(c * float(levels.signal[place[group]]) for group, c in plan.coefficients.items())
    seconds = plan.seconds_per_unit
    true = (slope * sensor.noise.prnu_percent.value / 100) ** 2
    true += 0.0 if dark is None else max(dark.variance.value, 0.0) * seconds**2
    total, pixels = true + plan.noise.value, lights[0].levels[channel.index].pixels
    sampled = Uncertain.of_variance(total, total * math.sqrt(2.0 / pixels))
    rate = 0.0 if dark is None else dark.mean
    return relative_response_variance(SlopeSpread(pixels, slope + rate * seconds, sampled - plan.noise), dark, seconds)
