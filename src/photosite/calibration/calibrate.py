"""Frames of darkness and of flat light become the parameters of the sensor that took them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike

from photosite.calibration.checks import frame_set_checks as judge
from photosite.calibration.checks import result_screening as plausible
from photosite.calibration.checks.stated_levels import stated_level_warnings
from photosite.calibration.fixed_pattern import PatternReader
from photosite.calibration.measure import (
    NO_LIGHT,
    DarkSide,
    clipped_parts,
    dark_patterns,
    darkness,
    measure_channels,
    measure_together,
    read_channel,
    read_darks,
    read_lights,
)
from photosite.calibration.measurements import LEAST_DARK_VARIANCE, Measurements, parameters
from photosite.calibration.photon_transfer.channel import Channel, curvature_warning, with_curvature
from photosite.calibration.photon_transfer.curves import channel_curves, linear_range
from photosite.calibration.photon_transfer.general_model import general_model
from photosite.calibration.photon_transfer.photon_transfer import GainFit, fit_gain, gain_value
from photosite.calibration.photon_transfer.response_curvature import gain_with_curvature
from photosite.calibration.photon_transfer.snr import snr_curve
from photosite.calibration.reduction.checkpoint import Checkpoint
from photosite.calibration.reduction.frame_reader import FrameReader, Progress
from photosite.calibration.result import Calibration
from photosite.calibration.spatial.spatial_analysis import FarThresholds
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Uncertain, Value

SCATTER = 4.0
"""Chi square per degree of freedom of the photon transfer above which a warning says so."""

FAR_APART = 3.29
"""Standard uncertainties that two figures of one quantity differ by in one of 1000 ideal measurements."""

FAR_BELOW_ZERO = 4.75
"""A signed spread below this many of its uncertainties has a variance more than three of its own below zero."""


def calibrate(
    frames: FrameSet,
    sensor: Sensor | None = None,
    *,
    far: FarThresholds | None = None,
    maps: bool = False,
    progress: Progress | None = None,
    partial: str | PathLike[str] | None = None,
) -> Calibration:
    """Estimate a sensor's parameters, with standard uncertainties, from dark and flat frames.

    Every group of frames is reduced to exact integer sums; the next frames are read meanwhile, and memory does
    not grow with their number. The per-pixel slopes need the light levels of the linear range once more: their
    mean frames are kept in a fixed room, and those that it does not hold are read again. Methods: EMVA 1288 R4.0, and
    for read noise, DSNU, PRNU and dark voltage Farrell, Okincha and Parmar, Proc. SPIE 6817 (2008); each estimate
    names its own.

    Parameters
    ----------
    frames
        The measurement: dark frames, at least two of them at one exposure, and flat frames at two or more levels.
    sensor
        What is known beforehand, for millivolts and for `Calibration.sensor`; `frames.sensor` if None.
    far
        Beyond which deviations from the mean pixels are listed in `Calibration.spatial`.
    maps
        Measure the chip itself, too: `Calibration.chip` and `Calibration.temporal`
        (`photosite.calibration.chip_maps.chip`). The
        frames are read once more for it, the darks of the read noise twice. Darks clipped at 0 show no chip: then
        `Calibration.no_chip` and a warning say so.
    progress
        Called with (frames read, frames to read) after each frame; the second number grows where frames
        must be read again, and for maps both begin again.
    partial
        A folder for partial sums, three times the size of a frame for each exposure: a run that is broken off goes on
        from them when it is called again with the same frames, with the same result to the last bit. They are removed
        at the end.

    Returns
    -------
    Calibration
        What could not be estimated has no value and a reason.

    Raises
    ------
    CalibrationError
        If the frames cannot support a calibration: several gain settings, one exposure only, no repeated darks, blacks
        so clipped that too little is left, light frames darker than the dark ones, flats that do not go with the
        light stated for them, numbers of other bits than stated.
    FileError
        If a frame cannot be read or has another size, or the folder of partial sums holds something else.
    InputError
        If `frames` is not a FrameSet, or `sensor` cannot have taken these frames.

    Examples
    --------
    >>> from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> def group(kind, exposure_s, electrons):
    ...     stack = 64 + 0.5 * rng.poisson(electrons, (8, 32, 32)) + rng.normal(0, 2, (8, 32, 32))
    ...     sources = [FrameSource(f"{kind}-{i}", lambda dn=dn: dn) for i, dn in enumerate(np.uint16(stack + 0.5))]
    ...     return FrameGroup(kind, exposure_s, tuple(sources))
    >>> groups = [group("dark", 0.01, 0), *(group("light", t, 1e5 * t) for t in (0.01, 0.02, 0.03))]
    >>> cal = calibrate(FrameSet(tuple(groups), rows=32, cols=32, bits=12))
    >>> low, high = cal.system_gain_dn_per_e.interval_95
    >>> low < 0.5 < high, cal.quantum_efficiency_percent.reason
    (True, 'the photons per pixel are not known; a descriptor or a protocol says them')
    """
    if not isinstance(frames, FrameSet):
        hint = (
            f"open_frames({str(frames)!r}) makes one" if isinstance(frames, str | PathLike) else "open_frames makes one"
        )
        raise InputError(f"calibrate takes a FrameSet; {hint}")
    base = sensor if sensor is not None else frames.sensor
    judge.check_sensor(frames, base)
    judge.check_plan(frames)
    kept = Checkpoint(partial, frames) if partial is not None else None
    with FrameReader(frames, progress, kept) as reader:
        calibration = _calibrate(frames, base, reader, far)
    if maps:
        calibration = _with_chip(frames, calibration, progress)
    if kept is not None:
        kept.remove()
    return calibration


def _with_chip(frames: FrameSet, calibration: Calibration, progress: Progress | None) -> Calibration:
    """With the chip's maps, or the reason that there are none: what else was measured does not need them."""
    from photosite.calibration.chip_maps.chip import ClippedChipError, measure_chip

    try:
        chip, temporal = measure_chip(frames, calibration, progress)
    except ClippedChipError as error:
        warning = f"the chip was not measured, there are no maps: {error}"
        return replace(calibration, no_chip=str(error), warnings=(*calibration.warnings, warning))
    return replace(calibration, chip=chip, temporal=temporal)


def _calibrate(frames: FrameSet, base: Sensor | None, reader: FrameReader, far: FarThresholds | None) -> Calibration:
    dark = read_darks(reader)
    judge.check_darks(frames, dark.groups, reader.rejected)
    lights = read_lights(reader)
    judge.check_lights(frames, lights, [level.mean for level in dark.as_read[0].levels])

    names = channel_names(frames.cfa)
    channels: list[Channel] = []
    measured: list[Measurements]
    gain_fit: GainFit | None = None
    if lights:
        channels = with_curvature([read_channel(k, dark, lights, reader.white) for k in range(len(names))])
        tops = [reader.tops[id(entry.group)] for entry in lights]
        plausible.check_flats(frames, names, dark.as_read, channels, tops)
        gain_fit = fit_gain([c.levels for c in channels], [c.used for c in channels])
        patterns = PatternReader(
            reader, dark.as_read, lights, dark.reference, dark.mean, channels, dark.slopes, dark.noise, dark.scatter,
            clipped_parts(dark),
        ).read(far)  # fmt: skip
        measured = measure_channels(dark, channels, patterns)
        spatial = [entry.spatial for entry in patterns]
    else:
        measured = measure_channels(dark, (), ())
        spatial = dark_patterns(dark, far)
    together = measure_together(
        dark,
        names,
        measured,
        gain_with_curvature(gain_value(gain_fit), [c.curvature for c in channels]) if lights else NO_LIGHT,
    )

    known = _known_scale(base)
    mv_per_dn = _mv_per_dn(base, known)
    estimates = parameters(together, mv_per_dn).estimates()
    return Calibration(
        **estimates,
        channels=(
            {name: parameters(m, mv_per_dn) for name, m in zip(names, measured, strict=True)} if len(names) > 1 else {}
        ),
        curves={
            name: channel_curves(darkness(dark, k), channels[k] if channels else None) for k, name in enumerate(names)
        },
        snr={name: snr_curve(c) for name, c in zip(names, channels, strict=False)},
        spatial=dict(zip(names, spatial, strict=True)),
        model="linear" if _photons_known(frames) else "general",
        general={name: general_model(c) for name, c in zip(names, channels, strict=False)},
        linearity={name: m.linearity[0] for name, m in zip(names, measured, strict=True) if m.linearity},
        linear_range={name: linear_range(c) for name, c in zip(names, channels, strict=False) if c.used.any()},
        warnings=tuple(
            list(frames.notes)
            + ([] if dark.clipped is None else [dark.clipped.warning(names)])
            + plausible.warnings(frames, dark.groups, channels)
            + curvature_warning(names, channels)
            + plausible.implausible_warnings(
                (("dark current", together.dark_slope), ("quantum efficiency", together.responsivity))
            )
            + judge.frame_warnings(frames, dark.groups, lights)
            + stated_level_warnings(frames, dark.groups, lights)
            + _warnings(names, reader, dark, channels, together, gain_fit)
            + _negative(estimates)
        ),
        rejected=tuple(reader.rejected),
        frames_used=tuple(reader.used_frames),
        source=frames.source,
        rows=frames.rows,
        cols=frames.cols,
        bits=frames.bits,
        cfa=frames.cfa,
        base=base,
        chip=None,
        temporal=None,
        no_chip=None,
        known=known,
        gain_setting=frames.gain_settings[0],
        temperature_c=_temperatures(frames),
    )


def _photons_known(frames: FrameSet) -> bool:
    lights = frames.of_kind("light")
    return bool(lights) and all(group.photons_per_pixel is not None for group in lights)


def _temperatures(frames: FrameSet) -> tuple[float, float] | None:
    """The lowest and the highest temperature of the sensor, where files or protocol say any."""
    known = [group.temperature_c for group in frames.groups if group.temperature_c is not None]
    return (min(known), max(known)) if known else None


def _known_scale(base: Sensor | None) -> dict[str, Uncertain]:
    """The electrical scale known beforehand, by the names of its fields: what all volts share."""
    names = () if base is None else ("voltage_swing_v", "analog_gain")
    values = {name: base.measured(name) for name in names if base is not None}
    return {name: Uncertain.of(entry.value, entry.standard_uncertainty) for name, entry in values.items()}


def _mv_per_dn(base: Sensor | None, known: Mapping[str, Uncertain]) -> Value:
    """Millivolts at the pixel per digital number, from the electrical scale known beforehand."""
    if base is None:
        return Missing(
            "volts need the sensor's voltage swing and analog gain; give a sensor file of this sensor beforehand"
        )
    return known["voltage_swing_v"] / known["analog_gain"] * (1e3 / (1 << base.readout.bits))


def _negative(estimates: Mapping[str, Estimate]) -> list[str]:
    """Spreads whose variance came out negative by more than chance explains: three standard uncertainties."""
    names = [
        name
        for name, entry in estimates.items()
        if entry.value is not None
        and entry.upper_limit_95 is not None
        and entry.standard_uncertainty is not None
        and entry.value < -FAR_BELOW_ZERO * entry.standard_uncertainty
    ]
    if not names:
        return []
    return [
        f"{', '.join(names)}: the variance came out negative by more than chance explains; the noise of these frames "
        f"is not independent from pixel to pixel or from frame to frame (row noise, say)"
    ]


def _dark_currents(m: Measurements) -> list[str]:
    """Whether the dark current of the mean and that of the variance are one."""
    if isinstance(m.dark_slope, Missing) or isinstance(m.dark_variance_slope, Missing) or isinstance(m.gain, Missing):
        return []
    of_mean, of_variance = m.dark_slope / m.gain, m.dark_variance_slope / (m.gain * m.gain)
    difference = of_variance - of_mean
    apart = abs(difference.value) / difference.standard_uncertainty
    if apart <= FAR_APART:
        return []
    return [
        f"the dark current from the mean, {of_mean.value:.3g} e-/s, and that from the variance, "
        f"{of_variance.value:.3g} e-/s, are {apart:.2g} standard uncertainties apart: a camera that holds its dark "
        f"level shows its dark current in the variance alone; one whose level drifts shows the drift in the mean"
    ]


def _warnings(
    names: Sequence[str],
    reader: FrameReader,
    dark: DarkSide,
    channels: Sequence[Channel],
    together: Measurements,
    gain_fit: GainFit | None,
) -> list[str]:
    """What the analysis showed that its reader should know."""
    warnings: list[str] = []
    if reader.rejected:
        warnings.append(f"{len(reader.rejected)} repeated or broken frames were left out, first: {reader.rejected[0]}")
    if not channels:
        return [*warnings, "no light frames: gain, electrons, PRNU and saturation could not be estimated"]
    longest_dark = max(entry.group.exposure_s for entry in dark.groups)
    longest_light = max(float(c.levels.exposure_s.max()) for c in channels)
    if longest_light > longest_dark * (1.0 + 1e-6):
        warnings.append(
            f"the longest dark exposure, {longest_dark:g} s, is shorter than the longest flat, {longest_light:g} s; "
            f"the dark of the longer ones was extrapolated"
        )
    if unsaturated := [n for n, c in zip(names, channels, strict=True) if c.saturation.signal is None]:
        of_channel = f" in channel{'s' * (len(unsaturated) > 1)} {', '.join(unsaturated)}" if len(names) > 1 else ""
        warnings.append(f"no flat reached saturation{of_channel}; all unclipped levels were taken as linear")
    for name, channel in zip(names, channels, strict=True):
        if channel.used.sum() < 3:
            warnings.append(
                f"channel {name} has {int(channel.used.sum())} light levels in its linear range; "
                f"nothing checks that it is linear"
            )
    if gain_fit is not None and gain_fit.degrees_of_freedom:
        scatter = gain_fit.chi_square / gain_fit.degrees_of_freedom
        if scatter > SCATTER:
            warnings.append(
                f"the photon transfer points scatter {math.sqrt(scatter):.2g} times as much as sampling explains; "
                f"uncertainties were widened accordingly"
            )
    warnings += _dark_currents(together)
    if isinstance(together.dark_variance, Uncertain) and together.dark_variance.value < LEAST_DARK_VARIANCE:
        warnings.append(
            f"the dark temporal variance, {together.dark_variance.value:.3g} DN², is below "
            f"{LEAST_DARK_VARIANCE} DN²: quantisation hides the read noise, take its upper limit"
        )
    return warnings
