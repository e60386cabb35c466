"""From dark frames and flat fields of one gain setting to the sensor's parameters: one pipeline of named stages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from os import PathLike
from typing import Any, Literal, NamedTuple, TypeAlias

from photosite.calibration.amplifiers import AMPLIFIER_UNKNOWN, Amplifier
from photosite.calibration.chip_maps.chip import ClippedChipError, measure_chip
from photosite.calibration.dark.dark_frames import measure_dark_frames
from photosite.calibration.diagnostics import collected, run_checks
from photosite.calibration.effect import Findings, Found
from photosite.calibration.effects.glow import GlowMap, deferred_glow
from photosite.calibration.effects.optical_black import without_covered_lines
from photosite.calibration.evidence import Evidence, collect_evidence
from photosite.calibration.light.light_frames import measure_light_frames
from photosite.calibration.parameters import Parameters, saturated_electrons
from photosite.calibration.photon_transfer.general_model import general_model
from photosite.calibration.photon_transfer.noise_structure import measure_noise_structure
from photosite.calibration.photon_transfer.snr import snr_curve
from photosite.calibration.reduction.checkpoint import Checkpoint
from photosite.calibration.reduction.defective_pixels import PixelSurvey
from photosite.calibration.reduction.fading_light import LightFades
from photosite.calibration.reduction.frame_reader import FrameReader, Progress
from photosite.calibration.reduction.reduce import Reduction, reduce_frames
from photosite.calibration.reduction.shared_sums import SharedSums
from photosite.calibration.result import Calibration
from photosite.calibration.spatial.fixed_pattern import measure_fixed_pattern
from photosite.calibration.spatial.spatial_analysis import OutlierThresholds, SpatialAnalysis
from photosite.errors import CalibrationError, InputError
from photosite.frames.frame_set import FrameSet, of_amplifier
from photosite.sensor.model import Sensor
from photosite.values.deferred import Deferred
from photosite.values.diagnostic import Diagnostic
from photosite.values.uncertain import Missing

MapsWanted: TypeAlias = bool | Literal["gain"]
"""Whether the chip is mapped, and with the gains of its pixels."""


def calibrate_setting(
    frames: FrameSet,
    sensor: Sensor | None = None,
    *,
    outliers: OutlierThresholds | None = None,
    maps: MapsWanted = False,
    progress: Progress | None = None,
    checkpoint: str | PathLike[str] | None = None,
    processes: int | None = 1,
    scheduler: str | None = None,
) -> Calibration:
    """Estimate the parameters of one gain setting and capture; options and errors are those of `calibrate`."""
    while True:
        try:
            return _calibrate(frames, sensor, outliers, maps, progress, _Saving(checkpoint, processes, scheduler))
        except LightFades as found:
            frames = found.frames


class _Saving(NamedTuple):
    """Where sums are kept or computed, as the options of `calibrate`."""

    checkpoint: str | PathLike[str] | None
    processes: int | None
    scheduler: str | None


def _calibrate(
    frames: FrameSet,
    sensor: Sensor | None,
    outliers: OutlierThresholds | None,
    maps: MapsWanted,
    progress: Progress | None,
    saving: _Saving,
) -> Calibration:
    sensor = sensor if sensor is not None else frames.sensor
    raised = [*run_checks("set", frames, sensor)]
    frames = without_covered_lines(frames, sensor)
    with _saved_sums(frames, *saving) as saved:
        with _removed_if_light_fades(saved), reduced(frames, progress, saved) as (reader, reduction):
            raised += run_checks("levels", reduction)
            dark = measure_dark_frames(reduction, reader)
            noise = measure_noise_structure(reduction, reader)
            light = measure_light_frames(reduction, dark, noise, reader, sensor)
            if light.tone is None:
                raised += run_checks("channels", reduction, light.channels)
            patterns = measure_fixed_pattern(reduction, dark, light, reader, outliers)
        amplifiers, unknown = _amplifiers(frames, sensor, progress)
        raised += unknown
        evidence = collect_evidence(reduction, dark, light, patterns, sensor, amplifiers)
        del reduction, dark, noise, light, patterns
        findings: dict[str, Found] = {}
        if maps:
            glow = _glow(evidence)
            evidence, findings = evidence.without_dark_maps(), {"glow": glow}
            evidence = _with_maps(evidence, glow, progress, pixel_gain=maps == "gain")
        calibration = _calibration(evidence, Findings.measure(evidence, findings), raised)
        if isinstance(saved, Checkpoint):
            saved.remove()
    return calibration


@contextmanager
def _removed_if_light_fades(saved: object) -> Iterator[None]:
    """Remove a checkpoint's files of groups that are divided."""
    try:
        yield
    except LightFades:
        if isinstance(saved, Checkpoint):
            saved.remove()
        raise


@contextmanager
def reduced(
    frames: FrameSet, progress: Progress | None, saved: Checkpoint | SharedSums | None
) -> Iterator[tuple[FrameReader, Reduction]]:
    """Yield the reduced frames, without defective pixels, and their reader."""
    with FrameReader(frames, progress, saved) as reader:
        yield reader, reduce_frames(reader, PixelSurvey(frames, reader.tile))


def _saved_sums(
    frames: FrameSet, checkpoint: str | PathLike[str] | None, processes: int | None, scheduler: str | None
) -> AbstractContextManager[Checkpoint | SharedSums | None]:
    """Return the sums that the reader need not compute: those of an interrupted run, or of workers."""
    alone = scheduler is None and processes == 1
    if checkpoint is None:
        return nullcontext() if alone else SharedSums(frames, processes=processes, scheduler=scheduler)
    if not alone:
        raise InputError("checkpoint", value=checkpoint, expected="omitted with several workers")
    return Checkpoint(checkpoint, frames)


def _amplifiers(
    frames: FrameSet, sensor: Sensor | None, progress: Progress | None
) -> tuple[dict[str, Amplifier], list[Diagnostic]]:
    """Return the amplifiers that the files name, each calibrated by itself, and why others are missing."""
    found: dict[str, Amplifier] = {}
    problems = []
    for part in frames.amplifiers if len(frames.amplifiers) > 1 else ():
        own = of_amplifier(frames, part)
        known = sensor if own.cfa == frames.cfa else None
        try:
            result = calibrate_setting(replace(own, sensor=None), known, progress=progress)
        except CalibrationError as error:
            problems.append(AMPLIFIER_UNKNOWN(f"amplifier {part.name} was not calibrated by itself: {error}"))
        else:
            found[part.name] = Amplifier(part, Parameters(**result.estimates()))
    return ({} if problems else found), problems


def _glow(evidence: Evidence) -> GlowMap | Missing:
    """Return the glow in the map of the dark current, after all else that needs the maps of the dark frames."""
    for pattern in evidence.patterns.channels:
        if isinstance(pattern.spatial, SpatialAnalysis):
            pattern.spatial.compute()
    glow = deferred_glow(evidence)
    return glow.value if isinstance(glow, Deferred) else glow


def _with_maps(evidence: Evidence, glow: GlowMap | Missing, progress: Progress | None, *, pixel_gain: bool) -> Evidence:
    """Return the evidence with the chip's maps, or with the reason why they are missing."""
    reason = evidence.dark.noise_unknown
    try:
        if not reason:
            known = None if isinstance(glow, Missing) else glow
            evidence = measure_chip(evidence, known, progress, pixel_gain=pixel_gain)
    except ClippedChipError as error:
        reason = str(error)
    if reason:
        evidence = replace(evidence, no_maps=reason, maps_failed=True)
    return evidence


def _calibration(evidence: Evidence, findings: Findings, raised: Sequence[Diagnostic]) -> Calibration:
    reduction, channels = evidence.reduction, evidence.channels
    frames, names = reduction.frames, reduction.names
    patterns = dict(zip(names, evidence.patterns.channels, strict=True))
    photons_known = bool(channels) and all(entry.group.photons_per_pixel is not None for entry in reduction.lights)
    stated = [(group.kind, group.temperature_c) for group in frames.groups if group.temperature_c is not None]
    # The dark current is that of the dark frames.
    temperatures = [t for kind, t in stated if kind == "dark"] or [t for _, t in stated]
    raised = [*raised, *run_checks("result", evidence, linear=evidence.light.tone is None)]
    estimates: dict[str, Any] = evidence.parameters.estimates()
    return Calibration(
        **estimates,
        by_line=evidence.by_line,
        channels=evidence.channel_parameters if len(names) > 1 else {},
        clipped_electrons=saturated_electrons(evidence.pooled),
        findings=findings,
        curves=evidence.curves,
        linear_range=evidence.linear_range,
        snr={name: snr_curve(channel) for name, channel in channels.items()},
        linearity={name: m.linearity[0] for name, m in zip(names, evidence.measured, strict=True) if m.linearity},
        spatial={name: pattern.spatial for name, pattern in patterns.items()},
        dsnu1288_exposure_s={name: t for name, pattern in patterns.items() for t in pattern.dsnu1288_exposures_s},
        model="linear" if photons_known else "general",
        general={name: general_model(channel) for name, channel in channels.items()},
        raised=collected(raised, reduction.rejected, evidence.parameters),
        frames_used=reduction.as_taken.used,
        source=frames.source,
        rows=frames.rows,
        cols=frames.cols,
        bits=frames.bits,
        cfa=frames.cfa,
        base=evidence.base,
        electrical_scale=evidence.electrical_scale,
        chip=evidence.chip,
        temporal=evidence.temporal,
        pixel_gains=evidence.pixel_gains,
        amplifiers=evidence.amplifiers,
        no_maps_reason=evidence.no_maps if evidence.maps_failed else None,
        gain_setting=frames.gain_settings[0],
        temperature_c=(min(temperatures), max(temperatures)) if temperatures else None,
    )
