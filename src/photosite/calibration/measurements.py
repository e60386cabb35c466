"""What the frames show of one channel, or of all channels together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from photosite.calibration.checks.result_screening import Implausible
from photosite.calibration.photon_transfer.channel import NO_PHOTONS, Channel
from photosite.calibration.photon_transfer.linearity import Linearity
from photosite.calibration.spatial.nonuniformity import VarianceComponents, pool_components
from photosite.calibration.spatial.pixel_slopes import with_chip_sampling
from photosite.calibration.withheld import NO_FLAT_FIELDS, NO_LINE_NOISE
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.uncertain import Missing, Uncertain, Value, derive, weighted_mean

NO_LIGHT = NO_FLAT_FIELDS.missing("no light frames")

NO_LINES = NO_LINE_NOISE.missing(
    "the noise that rows and columns share needs repeated dark frames, of two lines or more, that are not clipped at 0"
)

STRAIGHT = Uncertain(1.0)
"""Electrons, or their change, over those of a straight response, where the response is straight."""


@dataclass(frozen=True, kw_only=True)
class Measurements:
    """What the frames show of one channel, or of all channels together.

    Values are in DN and seconds. Variances are without temporal noise where they are spatial, and may be negative.
    """

    pixels: int
    read_variance: Value  # temporal, of the reference dark frames, without quantization and dark shot noise
    black_level: Value  # intercept of the mean dark signal
    dark_slope: Value  # slope of the mean dark signal against exposure
    dark_slope_variance: Value  # over pixels
    dark_variance: Value  # temporal, at exposure zero, quantization included
    dark_variance_slope: Value  # against exposure
    read_method: str
    # Of the reference dark frames, standard uncertainty where the dark levels do not lie on a line, DN
    charge_uncertainty_dn: float = 0.0
    step: float = 1.0  # distance of the converter's codes in the dark frames, DN
    row_variance: Value = NO_LINES  # temporal, of a frame: the parts of the read variance that rows
    column_variance: Value = NO_LINES  # and columns share
    dsnu_variance: Value = NO_LIGHT  # of the dark level at exposure zero, or of the reference dark frames
    response_variance: Value = NO_LIGHT  # relative, of the per-pixel response: PRNU squared
    shading_variance: Value = NO_LIGHT  # the part of it that the high-pass filter of EMVA 1288 removes
    channel_variance: float = 0.0  # the part of it by readout channels, which all sensors have
    gain: Value = NO_LIGHT  # DN/e-
    saturation_dn: Value = NO_LIGHT  # digital number of clipped pixels
    curved: bool = False  # whether gain and responsivity are those at small signal, with the response curve
    saturation_stretch: Uncertain = STRAIGHT  # electrons of clipped pixels over those of a straight response
    saturation_photons: Value = NO_LIGHT  # at the largest temporal variance
    responsivity: Value = NO_LIGHT  # DN/photon
    saturation_responsivity: Value = NO_LIGHT  # of the channel that `saturation_photons` belongs to
    dsnu1288: VarianceComponents | Missing = NO_LIGHT  # spatial variances of EMVA 1288, DN^2; plain,
    dsnu1288_filtered: VarianceComponents | Missing = NO_LIGHT  # and high-passed
    dsnu1288_exposures_s: tuple[float, ...] = ()  # exposure times of these dark patterns, one a channel
    prnu1288: VarianceComponents | Missing = NO_LIGHT  # relative; high-passed,
    prnu1288_unfiltered: VarianceComponents | Missing = NO_LIGHT  # and plain
    row_offset_variance: Value = NO_LIGHT  # of fixed offsets of rows and columns without readout channels, DN^2
    column_offset_variance: Value = NO_LIGHT
    column_gain_variance: Value = NO_LIGHT  # of the columns' relative gains, behind the response curve
    lines: tuple[int, int] = (1, 1)  # rows and columns that the pixels are in
    gain_method: str = ""  # where it is not that of the flat fields
    saturation_method: str = "fully clipped flat fields"
    dsnu_method: str = ""
    # Variance over pixels of single dark frames, of which read noise and DSNU are unknown parts, each at most the whole
    noise_and_pattern: Uncertain | None = None
    dark_exposure: str = "exposure zero"  # of black level and dark variance
    dark_method: str = ""  # of read noise, DSNU and black level, where dark frames are clipped at 0
    linearity: tuple[Linearity | Missing, ...] = ()  # of the channel, or of each channel
    coupling: Value = NO_LIGHT  # fraction of the signal in each next pixel, of all channels together
    dark_slope_third: float = 0.0  # third central moment over pixels of the dark slope
    # For all channels together: by the name of a measurement, the channels that it comes from if not all.
    from_channels: Mapping[str, str] = field(default_factory=dict)

    def method(self, text: str, *names: str) -> str:
        """Return the text, followed by the channels that the named measurements come from."""
        notes = dict.fromkeys(self.from_channels[name] for name in names if name in self.from_channels)
        return "; ".join((text, *notes))

    def without_noise(self, why: Missing) -> Measurements:
        """Return the measurements without gain and without all noise and fixed pattern."""
        withheld: dict[str, Any] = dict.fromkeys(_NOISE_MEASUREMENTS, why)
        return replace(self, **withheld)

    def without_light(self, why: Missing) -> Measurements:
        """Return the measurements without what the flat fields show, except for saturation in DN and linearity."""
        withheld: dict[str, Any] = dict.fromkeys(_LIGHT_MEASUREMENTS, why)
        return replace(self, **withheld)

    def with_channel(
        self, channel: Channel, responsivity: Value, *, by_line: bool = False, **others: Any
    ) -> Measurements:
        """Return the measurements with gain, saturation and responsivity of a channel, and with other changes.

        The gain is that at small signal, or that of the standard's line.
        """
        return replace(
            self,
            gain=channel.line_gain if by_line else channel.gain,
            curved=channel.curve is not None and not by_line,
            saturation_stretch=STRAIGHT if by_line else channel.stretch_at_saturation(),
            saturation_dn=channel.saturation.level_dn,
            saturation_method=channel.saturation.level_method,
            saturation_photons=channel.saturation.x if channel.levels.photons_known else NO_PHOTONS,
            responsivity=responsivity,
            saturation_responsivity=responsivity,
            **others,
        )

    def without_dark_shot_noise(self, exposure_s: float) -> Measurements:
        """Return the measurements without the shot noise of the dark current, K (dark slope) t, in the read noise.

        A sensor file holds read noise and dark current, and a simulation adds both. Without gain, the slope of the dark
        variance is that of the shot noise. Where the dark slope contradicts the dark variance, the read noise is the
        dark variance at exposure zero. Without both slopes, the measurements are returned unchanged.
        """
        if isinstance(self.dark_slope, Implausible) and isinstance(self.dark_variance_slope, Uncertain):
            at_zero = derive(lambda v: v - QUANTIZATION_DN2, self.dark_variance)
            return replace(self, read_variance=at_zero, read_method="dark temporal variance at exposure zero")
        gain = self.gain
        if isinstance(gain, Missing) and isinstance(self.dark_slope, Uncertain) and self.dark_slope.beyond(3.0):
            gain = derive(lambda noise, slope: noise / slope, self.dark_variance_slope, self.dark_slope)
        read = self.read_variance
        if isinstance(read, Missing):
            return self
        # The shot noise of the charge's uncertainty: at most all of the read noise.
        if self.charge_uncertainty_dn > 0.0:
            shot = math.inf if isinstance(gain, Missing) else gain.value * self.charge_uncertainty_dn
            read += Uncertain.of(0.0, min(shot, max(read.value, 0.0)))
        left = derive(lambda gain, slope: read - gain * slope * exposure_s, gain, self.dark_slope)
        if isinstance(left, Missing):
            return replace(self, read_variance=read)
        method = f"{self.read_method}, shot noise of the dark current subtracted"
        return replace(self, read_variance=left, read_method=method)

    def for_sensor(self, charge_factor: float = 1.0) -> Measurements:
        """Return the measurements for the sensor model, of which the chip's pixels are a sample.

        The spread of the pixels widens the uncertainty of the means over pixels. `charge_factor` is the variance of a
        mean of charges over that of independent pixels of the same spread: pixels that share charge spread less.
        """
        independent = self.pixels / charge_factor
        response = self.responsivity
        # Shading comes from the light and is the same for all sensors, as are readout channels: no samples.
        spread = derive(lambda whole, shading: whole - shading, self.response_variance, self.shading_variance)
        if isinstance(spread, Missing):
            spread = self.response_variance
        spread = derive(lambda variance: variance - self.channel_variance, spread)
        offsets, gains = self._line_variance()
        if isinstance(response, Uncertain) and isinstance(spread, Uncertain):
            pixel_part, column_part = spread * response.value**2, Uncertain.of(0.0, gains * abs(response.value))
            response = mean_for_sensor(response + column_part, pixel_part, independent)
        black, saturation = mean_for_sensor(self.black_level, self.dsnu_variance, self.pixels), self.saturation_dn
        if isinstance(black, Uncertain):
            black = black + offsets
        if isinstance(saturation, Uncertain) and saturation.standard_uncertainty > 0.0:
            # Of a full well, not of the converter
            signal = saturation.value - (black.value if isinstance(black, Uncertain) else 0.0)
            saturation = saturation + offsets + Uncertain.of(0.0, gains * abs(signal))
        slope, slope_variance = self.dark_slope, self.dark_slope_variance
        if isinstance(slope, Uncertain) and isinstance(slope_variance, Uncertain):
            slope, slope_variance = with_chip_sampling(slope, slope_variance, self.dark_slope_third, independent)
        # The pooled measurements of several channels keep another channel's responsivity, already widened.
        same = self.saturation_responsivity is self.responsivity
        return replace(
            self,
            black_level=black,
            saturation_dn=saturation,
            dark_slope=slope,
            dark_slope_variance=slope_variance,
            responsivity=response,
            saturation_responsivity=response if same else self.saturation_responsivity,
        )

    def _line_variance(self) -> tuple[Uncertain, float]:
        """Return the errors of the means by few rows and columns: of the offset in DN, and of the gain, relative."""
        row, column, gain = (
            max(part.value, 0.0) / count if isinstance(part, Uncertain) else 0.0
            for part, count in zip(
                (self.row_offset_variance, self.column_offset_variance, self.column_gain_variance),
                (*self.lines, self.lines[1]),
                strict=True,
            )
        )
        return Uncertain.of(0.0, math.sqrt(row + column)), math.sqrt(gain)


def mean_for_sensor(mean: Value, variance: Value, pixels: float) -> Value:
    """Return a mean over the chip's pixels with variance / pixels added to its squared uncertainty."""
    if isinstance(mean, Missing) or isinstance(variance, Missing):
        return mean
    return mean + Uncertain.of(0.0, math.sqrt(max(variance.value, 0.0) / pixels))


_NOISE_MEASUREMENTS = (
    "gain",
    "read_variance",
    "row_variance",
    "column_variance",
    "dsnu_variance",
    "dark_variance",
    "dark_variance_slope",
    "dark_slope_variance",
    "response_variance",
    "shading_variance",
    "dsnu1288",
    "dsnu1288_filtered",
    "prnu1288",
    "prnu1288_unfiltered",
    "row_offset_variance",
    "column_offset_variance",
    "column_gain_variance",
)

_LIGHT_MEASUREMENTS = (
    *("gain", "response_variance", "saturation_photons", "responsivity", "saturation_responsivity"),
    *("prnu1288", "prnu1288_unfiltered", "column_gain_variance"),
)

_MEANS_OVER_CHANNELS = (
    *("dsnu_variance", "dark_slope_variance", "response_variance", "shading_variance"),
    *("saturation_dn", "responsivity"),
    *("dsnu1288", "dsnu1288_filtered", "prnu1288", "prnu1288_unfiltered"),
    *("row_offset_variance", "column_offset_variance", "column_gain_variance"),
)


def pool_channels(
    names: Sequence[str], channels: Sequence[Measurements], dark: Measurements, gain: Value, exposure_s: float
) -> Measurements:
    """Return all channels as one, weighted by their pixels, with a gain fitted to all of them.

    A channel that lacks a measurement is left out of its mean, and `from_channels` names the others. The responsivity,
    which differs between channels, has no mean then. A measurement that no channel has is missing for the reason of the
    channel with the most measurements. Black level, dark slope, read
    variance (at `exposure_s`) and dark variance come from `dark`, all pixels together, because channels share the drift
    of the black level.
    """
    if len(channels) == 1:
        return replace(channels[0], gain=gain)
    fullest = max(
        channels, key=lambda m: sum(isinstance(value, Uncertain | VarianceComponents) for value in vars(m).values())
    )
    pixels = sum(entry.pixels for entry in channels)
    changed: dict[str, Any] = {"gain": gain, "pixels": pixels}
    notes: dict[str, str] = {}
    by_name = dict(zip(names, channels, strict=True))
    for name in _MEANS_OVER_CHANNELS:
        known = {k: m for k, m in by_name.items() if not isinstance(getattr(m, name), Missing)}
        lacking = [channel for channel in names if channel not in known]
        values, weights = [getattr(m, name) for m in known.values()], [float(m.pixels) for m in known.values()]
        if name == "responsivity" and lacking:
            changed[name] = getattr(by_name[lacking[0]], name)
        elif not known:
            changed[name] = getattr(fullest, name)
        else:
            changed[name] = (pool_components if isinstance(values[0], VarianceComponents) else weighted_mean)(
                values, weights
            )
            if lacking:
                notes[name] = f"channel{'s' * (len(known) > 1)} {', '.join(known)} only, not {', '.join(lacking)}"
    responses = {
        name: m.responsivity.value if isinstance(m.responsivity, Uncertain) else 0.0
        for name, m in by_name.items()
        if isinstance(m.saturation_photons, Uncertain)
    }
    first = fullest
    if responses:  # not by the photons: several channels may saturate at one level
        first_to_saturate = max(responses, key=responses.__getitem__)
        first = by_name[first_to_saturate]
        notes["saturation_photons"] = f"channel {first_to_saturate}, the first to saturate"
    saturated = next((entry for entry in channels if isinstance(entry.saturation_dn, Uncertain)), fullest)
    changed |= {
        "saturation_photons": first.saturation_photons,
        "saturation_responsivity": first.saturation_responsivity,
        "gain_method": fullest.gain_method,
        "saturation_method": saturated.saturation_method,
        "lines": (max(m.lines[0] for m in channels), max(m.lines[1] for m in channels)),
        "curved": any(entry.curved for entry in channels),
        "saturation_stretch": weighted_mean(
            [entry.saturation_stretch for entry in channels], [float(entry.pixels) for entry in channels]
        ),
        "dark_slope_third": sum(entry.pixels * entry.dark_slope_third for entry in channels) / pixels,
        "dsnu_method": fullest.dsnu_method,
        "dsnu1288_exposures_s": tuple(t for entry in channels for t in entry.dsnu1288_exposures_s),
        "linearity": tuple(found for entry in channels for found in entry.linearity),
    }
    pooled = replace(dark, from_channels=notes, **changed).without_dark_shot_noise(exposure_s)
    return replace(pooled.for_sensor(), responsivity=pooled.responsivity)  # each channel's is already for the sensor
