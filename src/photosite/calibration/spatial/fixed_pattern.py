"""Stage "spatial": the fixed pattern, from mean frames of the linear range.

The linear range is known once all light levels have been read. To limit memory, mean frames are kept up to a fixed size
until then, and those that lie in the linear range are read again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark.dark_frames import measure_alike
from photosite.calibration.dark.dark_lines import same_exposure
from photosite.calibration.dark.dark_result import ComponentsPair, DarkResult, GroupMean
from photosite.calibration.light.light_frames import LightResult
from photosite.calibration.measurements import NO_LIGHT, STRAIGHT, Measurements
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.noise_covariance import SharedCharge
from photosite.calibration.photon_transfer.without_darks import unknown_dark_current
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.channel_tables import measured_channels, without_channels
from photosite.calibration.spatial.far_pixels import FarPixels, find_far_pixels
from photosite.calibration.spatial.hidden_dark_current import HiddenDarkCurrent, hidden_dark_current
from photosite.calibration.spatial.nonuniformity import (
    MapPlanes,
    VarianceComponents,
    shading_variance,
    without_neighbors,
)
from photosite.calibration.spatial.pattern_agreement import NOT_COMPARED, Agreements, PixelLines
from photosite.calibration.spatial.periodic_structure import (
    UNSTATED_MOSAIC,
    PeriodicStructure,
    Taps,
    find_taps,
    periodic_offsets,
    periodic_structure,
)
from photosite.calibration.spatial.pixel_slopes import (
    PixelSlopes,
    SlopeSpread,
    relative_response_variance,
    slope_coefficients,
    slope_noise,
)
from photosite.calibration.spatial.spatial_analysis import (
    MeanPlanes,
    OutlierThresholds,
    SpatialAnalysis,
    spatial_analysis,
)
from photosite.calibration.spatial.unlit_lines import UNLIT_LINES, UnlitLines, find_unlit_lines
from photosite.calibration.withheld import (
    FEW_LEVELS,
    NO_HALF_SATURATION,
    NO_LINEAR_LEVEL,
    NO_SATURATION,
    SINGLE_FLATS,
    UNKNOWN_DARK_NOISE,
)
from photosite.engine.lazy_maps import ConstantMap, Map, held
from photosite.engine.site_planes import mean_of_sites
from photosite.engine.threads import computed_beside
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.uncertain import Missing, Uncertain, Value, combined, derive

T = TypeVar("T")

HALF_SATURATION = (0.3, 0.7)
"""Signal, as a fraction of that at saturation, that counts as EMVA 1288's 50 % where no level is nearer."""


@dataclass(frozen=True)
class FixedPattern:
    """One channel's fixed pattern; the variances are those of `Measurements`.

    `slope_contrast` and `half_contrast` are relative changes of the electrons over those of the signal, for the map of
    slopes and for the half-saturated flats: 1 for a straight response.
    """

    response_variance: Value
    shading_variance: Value
    dsnu1288_exposures_s: tuple[float, ...]
    dsnu1288: VarianceComponents | Missing
    dsnu1288_filtered: VarianceComponents | Missing
    prnu1288: VarianceComponents | Missing
    prnu1288_unfiltered: VarianceComponents | Missing
    spatial: SpatialAnalysis | Missing
    channel_variance: float = 0.0
    lines: tuple[int, int] = (1, 1)  # rows and columns that the channel's pixels are in
    # Of rows and columns, without readout channels: of dark offsets in DN^2, and of relative gains behind the curve
    row_offset_variance: Value = NO_LIGHT
    column_offset_variance: Value = NO_LIGHT
    column_gain_variance: Value = NO_LIGHT
    slope_contrast: Uncertain = STRAIGHT
    half_contrast: Uncertain = STRAIGHT
    alike: Mapping[str, Value] = field(default_factory=dict)  # as with readout channels that are alike

    def in_electrons(self) -> FixedPattern:
        """Return the pattern with the nonuniformity of the electrons in place of that of the signal."""
        squares = self.slope_contrast * self.slope_contrast, self.half_contrast * self.half_contrast
        light = (self.prnu1288, self.prnu1288_unfiltered)
        prnu, unfiltered = (parts if isinstance(parts, Missing) else parts.scaled(squares[1]) for parts in light)
        return replace(
            self,
            response_variance=derive(lambda variance: variance * squares[0], self.response_variance),
            shading_variance=derive(lambda variance: variance * squares[0], self.shading_variance),
            prnu1288=prnu,
            prnu1288_unfiltered=unfiltered,
        )

    def as_alike(self) -> FixedPattern:
        """Return the pattern with the response as with readout channels that are alike."""
        response = self.alike.get("response_variance", self.response_variance)
        return replace(self, response_variance=response, channel_variance=0.0)

    def alike_dark(self, dark: Measurements) -> Measurements:
        """Return what the dark frames show with its variances as with readout channels that are alike."""
        changes: dict[str, Any] = {name: value for name, value in self.alike.items() if name != "response_variance"}
        return replace(dark, **changes)

    @property
    def variances(self) -> dict[str, Any]:
        """The variances and the exposure time of those of the dark, by the names of `Measurements`."""
        dark = ("dsnu1288_exposures_s", "dsnu1288", "dsnu1288_filtered")
        light = ("prnu1288", "prnu1288_unfiltered", "channel_variance", "lines")
        lines = ("row_offset_variance", "column_offset_variance", "column_gain_variance")
        names = ("response_variance", "shading_variance", *dark, *light, *lines)
        return {name: getattr(self, name) for name in names}

    def withheld(self, why: Missing) -> FixedPattern:
        """Return the pattern without what the flat fields show."""
        light = ("response_variance", "shading_variance", "prnu1288", "prnu1288_unfiltered", "column_gain_variance")
        changes: dict[str, Any] = dict.fromkeys(light, why)
        return replace(self, **changes, alike={name: why if name in light else v for name, v in self.alike.items()})


@dataclass(frozen=True)
class FixedPatterns:
    """The fixed pattern of each channel; the periodic structure of flat fields and of dark frames, steps between taps,
    pixels far from the others and lines without light, if any; whether dark frames and flat fields agree."""

    channels: tuple[FixedPattern, ...]
    structure: PeriodicStructure | None = None
    dark_structure: PeriodicStructure | None = None
    taps: tuple[Taps, ...] = ()
    far: tuple[FarPixels, ...] = ()
    agreements: Agreements = NOT_COMPARED
    unlit: UnlitLines | None = None


@dataclass(frozen=True)
class SlopePlan:
    """How a channel's map of slopes is made."""

    coefficients: dict[int, float]  # weight of each light group's mean frame, by the index of the group
    offsets: dict[int, float]  # those of the value at no light in place of the slope
    noise: Uncertain  # variance of the slopes from temporal noise
    seconds_per_unit: float  # exposure time per unit of the light levels' axis


def plan_slopes(
    channel: Channel, lights: Sequence[GroupStatistics], charge: SharedCharge | None = None
) -> SlopePlan | Missing:
    """Plan a channel's map of slopes from the light groups in its linear range.

    `charge` is what frames share, by image lag: less of their noise averages out.
    """
    levels, used = channel.levels, channel.used & channel.levels.trusted
    if len(np.unique(levels.x[used])) < 2:
        return FEW_LEVELS.missing(
            f"{int(used.sum())} light level in the linear range; slopes need two or more: take shorter exposures"
        )
    groups = levels.group[used]
    chosen = [lights[i].levels[channel.index] for i in groups]
    variance = np.array([level.variance for level in chosen])
    uncertainty = np.array([level.variance_uncertainty for level in chosen])
    single = ~levels.repeated[used]
    if single.any():
        # The noise of a single frame is taken from the photon transfer curve.
        gain = channel.line_gain
        if isinstance(gain, Missing):
            return SINGLE_FLATS.missing(f"some light levels have one frame, and their noise is unknown: {gain.reason}")
        dark = channel.dark.variance.weights_at(levels.exposure_s[used]) @ channel.dark.variance.y
        variance[single] = (dark + gain.value * levels.signal[used])[single]
        uncertainty[single] = (gain.standard_uncertainty * levels.signal[used])[single]
    frames = np.array([level.frames for level in chosen])
    if charge is not None:
        more = charge.mean_factors(frames.astype(np.float64))
        variance, uncertainty = more * variance, more * uncertainty
    x, weights = levels.x[used], frames / variance
    coefficients = slope_coefficients(x, weights)
    offsets = weights / weights.sum() - float(x @ weights / weights.sum()) * coefficients
    return SlopePlan(
        dict(zip(groups.tolist(), coefficients.tolist(), strict=True)),
        dict(zip(groups.tolist(), offsets.tolist(), strict=True)),
        slope_noise(coefficients, frames, variance, uncertainty),
        float(coefficients @ levels.exposure_s[used]),
    )


@dataclass(frozen=True)
class _Inputs:
    """What the stages before have established, and the light groups that each channel's fixed pattern comes from."""

    reduction: Reduction
    dark: DarkResult
    light: LightResult
    reader: FrameReader
    outliers: OutlierThresholds | None

    @cached_property
    def half(self) -> list[int | Missing]:
        """Light group near half saturation of each channel."""
        return [_half_saturated(channel, self.reduction.lights) for channel in self.light.channels]

    @cached_property
    def dark_mean(self) -> Map:
        """Mean dark frame; zeros without one."""
        return held(ConstantMap(self.shape)) if self.dark.mean is None else self.dark.mean.mean

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        return self.reduction.frames.rows, self.reduction.frames.cols

    @property
    def charge(self) -> Sequence[SharedCharge] | None:
        """Charge that frames and pixels share, by channel; None where none is seen or it is not known."""
        shared = self.light.noise.shared
        return None if shared is None or isinstance(shared.charge, Missing) else shared.charge

    @cached_property
    def plans(self) -> list[SlopePlan | Missing]:
        """Plan of each channel's map of slopes."""
        lights, charge = self.reduction.lights, self.charge
        return [
            plan_slopes(channel, lights, None if charge is None else charge[channel.index])
            for channel in self.light.channels
        ]

    @cached_property
    def weights(self) -> list[dict[int, float]]:
        """Weights of the light groups in each channel's map of slopes; empty without a plan."""
        return [{} if isinstance(plan, Missing) else plan.coefficients for plan in self.plans]

    def all_pixels(self, planes: MeanPlanes, kind: Literal["dark", "light"]) -> MeanPlanes:
        """Return planes of a mean frame with the defective pixels, which the standard's histograms show."""
        defects = self.reduction.defects
        if defects is None:
            return planes
        groups = (*self.reduction.darks, *self.reduction.lights)
        alike = [i for i, entry in enumerate(groups) if entry.group.kind == kind]
        nearest = min(alike, key=lambda i: abs(groups[i].group.exposure_s - planes.exposure_s))
        return planes.with_pixels(*defects.place, defects.mean_dn[nearest])

    def line_count(self, channel: int) -> tuple[int, int]:
        """Return the numbers of rows and columns that the channel's pixels are in."""
        inside = self.reader.tile == channel
        rows, cols = (
            length * int(inside.any(axis=1 - axis).sum()) // inside.shape[axis]
            for axis, length in enumerate(self.shape)
        )
        return rows, cols


@dataclass(frozen=True)
class _DarkPattern:
    """One channel's dark pattern at the exposure time of its half-saturated flat fields, else of the reference.

    `unaltered` is the high-passed pattern without the readout channels' offsets. Where the noise of the dark frames is
    unknown, both patterns are missing, and the frame itself is the only one.
    """

    components: ComponentsPair
    unaltered: VarianceComponents | Missing
    planes: MeanPlanes | Missing

    @property
    def exposures_s(self) -> tuple[float, ...]:
        """The exposure time, if it is known."""
        return () if isinstance(self.planes, Missing) else (self.planes.exposure_s,)

    def spatial(self, light: MeanPlanes | Missing, outliers: OutlierThresholds | None) -> SpatialAnalysis | Missing:
        """Return the analysis of both mean frames."""
        return self.planes if isinstance(self.planes, Missing) else spatial_analysis(self.planes, light, outliers)


@dataclass
class _FlatPattern:
    """Periods and taps of the brightest flat fields, and by channel the pattern of those near half saturation."""

    slopes: PixelSlopes
    lines: PixelLines
    structure: PeriodicStructure | None = None
    taps: tuple[Taps, ...] = ()
    readout: ReadoutChannels | None = None  # with offsets in DN
    prnu: dict[int, ComponentsPair] = field(default_factory=dict)  # high-passed, and plain
    gains: dict[int, VarianceComponents | Missing] = field(default_factory=dict)  # without readout channels
    spatial: dict[int, SpatialAnalysis | Missing] = field(default_factory=dict)


def measure_fixed_pattern(
    reduction: Reduction, dark: DarkResult, light: LightResult, reader: FrameReader, outliers: OutlierThresholds | None
) -> FixedPatterns:
    """Measure each channel's fixed pattern."""
    inputs = _Inputs(reduction, dark, light, reader, outliers)
    offsets, taps, far = _dark_structure(dark, reader.tile)
    readout = measured_channels(None, offsets, taps, Uncertain(1.0))  # offsets in DN
    darks = _dark_patterns(inputs, readout)
    if not light.channels:
        alike = [] if readout is None else measure_alike(dark, readout)
        channels = tuple(
            replace(_without_light(inputs, k, pattern), alike=alike[k] if alike else {})
            for k, pattern in enumerate(darks)
        )
        return FixedPatterns(channels, dark_structure=offsets, taps=taps, far=far)
    flats = _read_flats(inputs, darks, offsets, taps)
    planes = MapPlanes(flats.slopes.slopes, reader.tile)
    noise = [Uncertain(0.0) if isinstance(plan, Missing) else plan.noise for plan in inputs.plans]
    spreads = flats.slopes.spreads(noise)
    result = [
        _channel_pattern(inputs, k, pattern, flats, planes, spread)
        for k, (pattern, spread) in enumerate(zip(darks, spreads, strict=True))
    ]
    if flats.readout is not None:
        result = _with_alike(inputs, result, noise, flats, flats.readout)
    structure = flats.structure
    if structure is not None and structure.is_mosaic():
        result = [entry.withheld(UNSTATED_MOSAIC.missing(f"{structure}; state it")) for entry in result]
    far += _found([find_far_pixels("PRNU", flats.slopes.slopes, reader.tile.shape)])
    agreements = flats.lines.agreements(dark, light.channels, reduction.lights)
    if (unlit := find_unlit_lines(flats.slopes.slopes, reader.tile.shape)) is not None:
        result = [entry.withheld(UNLIT_LINES.missing(str(unlit))) for entry in result]
    return FixedPatterns(tuple(result), structure, offsets, taps + flats.taps, far, agreements, unlit)


def _without_light(inputs: _Inputs, channel: int, dark: _DarkPattern) -> FixedPattern:
    return FixedPattern(
        NO_LIGHT,
        NO_LIGHT,
        dark.exposures_s,
        *dark.components,
        NO_LIGHT,
        NO_LIGHT,
        dark.spatial(NO_LIGHT, inputs.outliers),
        lines=inputs.line_count(channel),
        **_line_variances(dark.unaltered, NO_LIGHT),
    )


def _read_flats(
    inputs: _Inputs, darks: Sequence[_DarkPattern], offsets: PeriodicStructure | None, taps: tuple[Taps, ...]
) -> _FlatPattern:
    """Read the mean flat fields of the linear range again, the brightest first."""
    lights, weights, reader = inputs.reduction.lights, inputs.weights, inputs.reader
    groups = [i for i in range(len(lights)) if i in inputs.half or any(i in each for each in weights)]
    reader.expect(sum(len(lights[i].group) for i in groups if not reader.kept(lights[i].group)))
    offsets_of = [{} if isinstance(plan, Missing) else plan.offsets for plan in inputs.plans]
    lines = PixelLines(reader.tile, inputs.shape, offsets_of, weights)
    flats = _FlatPattern(PixelSlopes(inputs.shape, reader.tile), lines)
    # A level beyond the linear range of a channel hides differences within it.
    clear = [i for i in groups if all(i in each for each in weights if each)]
    brightest = max(clear or groups, key=lambda i: lights[i].levels[0].mean, default=None)
    # The readout channels are those of the brightest flat fields, and are subtracted from the others. The groups near
    # half saturation come last, because their planes are held.
    order = sorted(groups, key=lambda i: (i != brightest, i in inputs.half, -lights[i].levels[0].mean))
    for i in order:
        mean, values = reader.mean(lights[i].group), None
        if i == brightest:
            values = held(mean)
            with ThreadPoolExecutor(1) as thread:
                structure = computed_beside(thread, periodic_structure, values, inputs.dark_mean, reader.tile)
                step = find_taps(mean_of_sites(values, inputs.dark_mean, reader.tile.shape, relative=True))
            flats.structure, flats.taps = structure.result(), _found([step])
            flats.readout = measured_channels(flats.structure, offsets, taps + flats.taps, Uncertain(1.0))
        channels = [k for k, group in enumerate(inputs.half) if group == i]
        if channels:
            flat = GroupMean.of(reader, lights[i], mean, inputs.dark.scatter, values)
            _measure_half_saturated(
                inputs,
                flats,
                _with_shared_noise(inputs, flat),
                {k: darks[k] for k in channels},
                flats.readout,
                own=i != order[-1],
            )
            del flat
        flats.slopes.add(mean, [each.get(i, 0.0) for each in weights])
        flats.lines.add(i, mean)
        del mean, values  # releases them before the next group is read
    return flats


def _with_shared_noise(inputs: _Inputs, flat: GroupMean) -> GroupMean:
    """Return a mean flat field with the noise of bands, and with that of charge that frames share."""
    if inputs.light.noise.flicker is not None:
        flat = replace(flat, noise=[parts.with_bands() for parts in flat.noise])
    if inputs.charge is not None:
        frames = np.array([float(flat.statistics.frames)])
        more = [float(entry.mean_factors(frames)[0]) for entry in inputs.charge]
        flat = replace(flat, noise=[parts.scaled(m) for parts, m in zip(flat.noise, more, strict=True)])
    return flat


def _measure_half_saturated(
    inputs: _Inputs,
    flats: _FlatPattern,
    flat: GroupMean,
    darks: Mapping[int, _DarkPattern],
    readout: ReadoutChannels | None,
    *,
    own: bool,
) -> None:
    """Add the pattern of the mean flat field near half saturation of some channels; `own` as in `GroupMean.planes`."""
    shared = inputs.light.noise.shared
    for k, dark in darks.items():
        channel = inputs.light.channels[k]
        group = int(inputs.half[k])  # type: ignore[arg-type]
        plain, filtered = (
            _light_less_dark(*pair, channel, group)
            for pair in zip(flat.both_components(k), dark.components, strict=True)
        )
        if shared is not None and shared.neighbors is not None and inputs.reader.tile.size == 1:
            plain, filtered = (
                parts
                if isinstance(parts, Missing)
                else without_neighbors(parts, inputs.shape, shared.neighbors, filtered=high_passed)
                for parts, high_passed in ((plain, False), (filtered, True))
            )
        planes = inputs.all_pixels(flat.planes(k, own=own), "light")
        flats.prnu[k], flats.spatial[k] = (filtered, plain), dark.spatial(planes, inputs.outliers)
        flats.gains[k] = filtered
        if readout is not None:
            alike = replace(flat, mean=held(without_channels(flat.mean, readout, inputs.dark_mean)))
            flats.gains[k] = _light_less_dark(alike.components(k, filtered=True), dark.unaltered, channel, group)


def _with_alike(
    inputs: _Inputs,
    patterns: Sequence[FixedPattern],
    noise: Sequence[Uncertain],
    flats: _FlatPattern,
    readout: ReadoutChannels,
) -> list[FixedPattern]:
    """Return the patterns with the variances as with readout channels that are alike."""
    dark, slopes, result = inputs.dark, flats.slopes, []
    darks = dark.slopes if dark.slope_map is None else dark.slope_map.spreads(readout)
    for k, (spread, alike) in enumerate(zip(slopes.spreads(noise, readout), measure_alike(dark, readout), strict=True)):
        spreads = spread, None if darks is None else darks[k]
        response = _response(inputs, k, spreads, _hidden(inputs, flats, k), patterns[k].column_gain_variance)
        result.append(replace(patterns[k], alike={**alike, "response_variance": response}))
    return result


def _channel_pattern(
    inputs: _Inputs, k: int, pattern: _DarkPattern, flats: _FlatPattern, planes: MapPlanes, spread: SlopeSpread
) -> FixedPattern:
    """Return the fixed pattern of a channel from its dark pattern, its flat fields and its map of slopes."""
    dark, flicker = inputs.dark, inputs.light.noise.flicker
    channel, plan, group, weights = inputs.light.channels[k], inputs.plans[k], inputs.half[k], inputs.weights[k]
    if isinstance(group, Missing):
        flats.gains[k], flats.prnu[k] = group, (group, group)
        flats.spatial[k] = pattern.spatial(group, inputs.outliers)
    spreads = spread, None if dark.slopes is None else dark.slopes[k]
    hidden = _hidden(inputs, flats, k)
    if isinstance(hidden, Missing):
        flats.prnu[k], flats.gains[k] = (hidden, hidden), hidden
    elif hidden is not None:
        flats.prnu[k] = _without_hidden(flats.prnu[k], hidden, channel, group, inputs.reduction.lights)
    lines, count = _line_variances(pattern.unaltered, flats.gains[k]), inputs.line_count(k)
    response = _response(inputs, k, spreads, hidden, lines["column_gain_variance"])
    shading = response if isinstance(response, Missing) else _shading(planes, k, plan, *spreads)
    if flicker is not None:
        shading = derive(lambda variance: variance + _bands(inputs, k, flicker.fraction), shading)
    structure = flats.structure
    return FixedPattern(
        response,
        shading,
        pattern.exposures_s,
        *pattern.components,
        *flats.prnu[k],
        flats.spatial[k],
        channel_variance=0.0 if structure is None or not structure.by_lines else float(structure.relative.var()),
        lines=count,
        slope_contrast=_slope_contrast(channel, weights),
        half_contrast=_half_contrast(channel, group),
        **lines,
    )


def _response(
    inputs: _Inputs,
    k: int,
    spreads: tuple[SlopeSpread, SlopeSpread | None],
    hidden: HiddenDarkCurrent | Missing | None,
    columns: Value,
) -> Value:
    """Return the relative variance of the response, from the spreads of the slopes of flat fields and dark frames."""
    plan, dark, flicker = inputs.plans[k], inputs.dark, inputs.light.noise.flicker
    response = _response_variance(plan, *spreads)
    if dark.noise_unknown and dark.slopes is None:
        response = _dark_current_unknown(inputs.light.channels[k]) or response
    if isinstance(hidden, Missing):
        response = hidden
    elif hidden is not None and isinstance(response, Uncertain) and isinstance(plan, SlopePlan):
        response = hidden.without(response, spreads[0].mean, plan.seconds_per_unit)
    if flicker is not None:
        response = derive(lambda variance: variance + _bands(inputs, k, flicker.fraction), response)
    if isinstance(response, Uncertain) and isinstance(columns, Uncertain):
        # The columns are fewer than the pixels.
        few = max(columns.value, 0.0) * math.sqrt(2.0 / max(inputs.line_count(k)[1] - 1, 1))
        response = response + Uncertain.of(0.0, few)
    return response


def _bands(inputs: _Inputs, k: int, fraction: float) -> Uncertain:
    """Return the uncertainty of variances of the slopes from bands of flicker, a fraction of the light."""
    left = _fraction_left(inputs.light.channels[k], inputs.weights[k], inputs.reduction.lights)
    return Uncertain.of(0.0, fraction**2 * left)


def _hidden(inputs: _Inputs, flats: _FlatPattern, channel: int) -> HiddenDarkCurrent | Missing | None:
    """Return the dark current that dark frames of one exposure time leave open."""
    plan = inputs.plans[channel]
    if inputs.dark.slopes is not None or isinstance(plan, Missing):
        return None
    shared = flats.lines.shared_variance(inputs.dark, channel)
    return hidden_dark_current(inputs.light.channels[channel], plan.seconds_per_unit, shared)


def _without_hidden(
    pair: ComponentsPair,
    hidden: HiddenDarkCurrent,
    channel: Channel,
    group: int | Missing,
    lights: Sequence[GroupStatistics],
) -> ComponentsPair:
    """Return high-passed and plain parts of the flat fields near half saturation without a hidden dark current."""
    if isinstance(group, Missing):
        return pair
    signal = float(channel.levels.signal[int(np.flatnonzero(channel.levels.group == group)[0])])
    exposure_s = lights[group].group.exposure_s
    filtered, plain = (
        parts if isinstance(parts, Missing) else hidden.in_flat(parts, signal, exposure_s) for parts in pair
    )
    return filtered, plain


def _dark_structure(
    dark: DarkResult, tile: NDArray[np.int64]
) -> tuple[PeriodicStructure | None, tuple[Taps, ...], tuple[FarPixels, ...]]:
    if dark.mean is None:
        return None, (), ()
    mean = dark.mean.mean
    with ThreadPoolExecutor(1) as thread:  # medians in NumPy take one core, the rest takes all
        offsets = computed_beside(thread, periodic_offsets, mean) if dark.clipped is None else None
        taps = find_taps(mean_of_sites(mean, None, tile.shape), dark=True)
        far = find_far_pixels(f"DSNU1288 at {dark.reference_exposure_s:g} s", mean, tile.shape)
    return None if offsets is None else offsets.result(), _found([taps]), _found([far])


def _line_variances(dark: VarianceComponents | Missing, light: VarianceComponents | Missing) -> dict[str, Any]:
    """Return the variances of rows and columns from the high-passed parts of dark frames, and of flats less dark."""
    row, column = (dark, dark) if isinstance(dark, Missing) else (dark.row, dark.column)
    gain = light if isinstance(light, Missing) else light.column
    return {"row_offset_variance": row, "column_offset_variance": column, "column_gain_variance": gain}


def _found(findings: Sequence[T | None]) -> tuple[T, ...]:
    return tuple(found for found in findings if found is not None)


def _half_saturated(channel: Channel, lights: Sequence[GroupStatistics]) -> int | Missing:
    """Return the light group for PRNU of EMVA 1288: the most frames near half saturation, then the nearest."""
    levels, saturation = channel.levels, channel.saturation
    if saturation.signal is None:
        return NO_SATURATION.missing("PRNU at 50 % of saturation needs flat fields that reach saturation")
    fraction = levels.signal / saturation.signal
    near = levels.repeated & ~levels.clipped & (fraction >= HALF_SATURATION[0]) & (fraction <= HALF_SATURATION[1])
    if not near.any():
        return NO_HALF_SATURATION.missing(
            "no light level with two frames lies between 30 and 70 % of saturation; take a stack at 50 %, better of 50"
        )
    best = min(np.flatnonzero(near), key=lambda i: (-lights[int(levels.group[i])].frames, abs(fraction[i] - 0.5)))
    return int(levels.group[best])


def _dark_current_unknown(channel: Channel) -> Missing | None:
    """Return why a map of slopes holds an unknown dark current; None where the exposure times differ too little."""
    levels, used = channel.levels, channel.used & channel.levels.trusted
    shortest, longest = levels.exposure_s[used].min(initial=math.inf), levels.exposure_s[used].max(initial=0.0)
    return unknown_dark_current(shortest, longest, channel.dark.variance.reason)


def _dark_patterns(inputs: _Inputs, readout: ReadoutChannels | None) -> list[_DarkPattern]:
    reduction, dark, reader = inputs.reduction, inputs.dark, inputs.reader
    if dark.clipped is not None or dark.noise_unknown:
        stated = [(entry.dsnu1288, entry.dsnu1288_filtered) for entry in dark.channels]
        why = UNKNOWN_DARK_NOISE.missing(dark.noise_unknown)
        return [
            _DarkPattern(parts, parts[1], why if dark.mean is None else inputs.all_pixels(dark.mean.planes(k), "dark"))
            for k, parts in enumerate(stated)
        ]
    exposures = [
        dark.reference_exposure_s if isinstance(light, Missing) else reduction.lights[light].group.exposure_s
        for light in inputs.half
    ] or [dark.reference_exposure_s] * len(reduction.names)
    means: dict[float, GroupMean] = {}
    for exposure_s in dict.fromkeys(exposures):
        same = [
            i for i, e in enumerate(reduction.darks) if e.frames > 1 and same_exposure(e.group.exposure_s, exposure_s)
        ]
        matching = max(same, key=lambda i: reduction.darks[i].frames, default=None)
        if matching is None or matching == reduction.reference:
            moved = dark.at(exposure_s)
            assert moved is not None  # the noise of the dark frames is known
            means[exposure_s] = moved
            continue
        statistics = reduction.darks[matching]
        reader.expect(len(statistics.group))
        means[exposure_s] = GroupMean.of(reader, statistics, reader.mean(statistics.group), dark.scatter)
    result = []
    for k, t in enumerate(exposures):
        parts = lines = means[t].both_components(k)
        if readout is not None:
            lines = replace(means[t], mean=held(without_channels(means[t].mean, readout))).both_components(k)
        result.append(_DarkPattern(parts, lines[1], inputs.all_pixels(means[t].planes(k), "dark")))
    return result


def _response_variance(plan: SlopePlan | Missing, spread: SlopeSpread, dark: SlopeSpread | None) -> Value:
    if isinstance(plan, Missing):
        return plan
    if spread.mean <= 0.0:
        return NO_LINEAR_LEVEL.missing("the light frames do not get brighter with exposure")
    return relative_response_variance(spread, dark, plan.seconds_per_unit)


def _shading(
    slopes: MapPlanes, channel: int, plan: SlopePlan | Missing, spread: SlopeSpread, dark: SlopeSpread | None
) -> Value:
    if isinstance(plan, Missing):
        return plan
    of_light = spread.mean - (0.0 if dark is None else plan.seconds_per_unit * dark.mean)
    return shading_variance(slopes, channel, spread, plan.noise, of_light)


def _fraction_left(channel: Channel, coefficients: Mapping[int, float], lights: Sequence[GroupStatistics]) -> float:
    """Return the fraction of a frame's relative variance that is left in the per-pixel slopes."""
    of_group = {int(i): float(signal) for i, signal in zip(channel.levels.group, channel.levels.signal, strict=True)}
    parts = {i: weight * of_group[i] for i, weight in coefficients.items()}
    return sum(part**2 / lights[i].frames for i, part in parts.items()) / sum(parts.values()) ** 2


def _light_less_dark(
    light: VarianceComponents | Missing, dark: VarianceComponents | Missing, channel: Channel, group: int
) -> VarianceComponents | Missing:
    """Return the parts of a light group less those of the dark, relative to the squared signal."""
    if isinstance(light, Missing) or isinstance(dark, Missing):
        return light if isinstance(light, Missing) else dark
    levels = channel.levels
    place = int(np.flatnonzero(levels.group == group)[0])
    signal = Uncertain.of(float(levels.signal[place]), float(np.sqrt(levels.signal_covariance[place, place])))
    return (light - dark).scaled(1.0 / (signal * signal))


def _half_contrast(channel: Channel, group: int | Missing) -> Uncertain:
    """Return relative change of the electrons over that of the signal in the half-saturated flats."""
    if channel.curve is None or isinstance(group, Missing):
        return STRAIGHT
    return channel.curve.contrast(int(np.flatnonzero(channel.levels.group == group)[0]))


def _slope_contrast(channel: Channel, coefficients: Mapping[int, float]) -> Uncertain:
    """Return relative change of the electrons over that of the slopes against light, for a pixel that responds more.

    A relative change p of the electrons changes a signal y by p y / (1 + y H').
    """
    if channel.curve is None or not coefficients:
        return STRAIGHT
    places = [int(np.flatnonzero(channel.levels.group == group)[0]) for group in coefficients]
    parts = np.array(list(coefficients.values())) * channel.levels.signal[places]
    return float(parts.sum()) / combined([1.0 / channel.curve.contrast(place) for place in places], parts)
