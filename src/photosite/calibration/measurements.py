"""What the frames show of one channel, or of all channels together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from photosite.calibration.photon_transfer.channel import NO_PHOTONS, Channel
from photosite.calibration.photon_transfer.linearity import Linearity
from photosite.calibration.spatial.parts import Parts, pool_parts
from photosite.calibration.spatial.pixel_slopes import of_one_sample
from photosite.values.uncertain import Missing, Uncertain, Value, weighted_mean

NO_LIGHT = Missing("no light frames")


@dataclass(frozen=True, kw_only=True)
class Measurements:
    """What the frames show of one channel, or of all channels together. Variances may be negative.

    Parameters
    ----------
    pixels
        Number of pixels.
    read_variance, dsnu_variance
        Temporal variance of the reference darks, without quantisation and dark shot noise; spatial variance of their
        mean, without temporal noise; DN^2.
    black_level, dark_slope, dark_slope_variance
        Intercept (DN) and slope (DN/s) of the mean dark signal; variance over pixels of the slope, DN^2/s^2.
    dark_slope_third
        Third central moment over pixels of the dark slope, DN^3/s^3.
    dark_variance, dark_variance_slope
        Dark temporal variance at exposure zero, quantisation included, DN^2; its slope against exposure, DN^2/s.
    response_variance
        Relative variance over pixels of the per-pixel response: PRNU squared.
    gain
        System gain, DN/e-.
    saturation_dn, saturation_photons
        Digital number of clipped pixels; photons at the largest temporal variance.
    responsivity, saturation_responsivity
        DN/photon; of the channel that `saturation_photons` belongs to.
    dsnu1288, dsnu1288_filtered, prnu1288, prnu1288_unfiltered
        Spatial variances of EMVA 1288: DN^2, plain and high-passed; relative, high-passed and plain.
    read_method, saturation_method
        How read noise and saturation were measured.
    dark_method
        How read noise, DSNU and black level were measured on darks clipped at 0; "" where none are.
    linearity
        Linearity of the channel, or of each channel.
    from_channels
        For all channels together: by the name of a measurement, the channels that it comes from if not all.
    """

    pixels: int
    read_variance: Value
    black_level: Value
    dark_slope: Value
    dark_slope_variance: Value
    dark_variance: Value
    dark_variance_slope: Value
    read_method: str
    dsnu_variance: Value = NO_LIGHT
    response_variance: Value = NO_LIGHT
    gain: Value = NO_LIGHT
    saturation_dn: Value = NO_LIGHT
    saturation_photons: Value = NO_LIGHT
    responsivity: Value = NO_LIGHT
    saturation_responsivity: Value = NO_LIGHT
    dsnu1288: Parts | Missing = NO_LIGHT
    dsnu1288_filtered: Parts | Missing = NO_LIGHT
    prnu1288: Parts | Missing = NO_LIGHT
    prnu1288_unfiltered: Parts | Missing = NO_LIGHT
    saturation_method: str = "fully clipped flat fields"
    dark_method: str = ""
    linearity: tuple[Linearity | Missing, ...] = ()
    dark_slope_third: float = 0.0
    from_channels: Mapping[str, str] = field(default_factory=dict)

    def method(self, text: str, *names: str) -> str:
        """Return the text, followed by the channels that the named measurements come from."""
        notes = dict.fromkeys(self.from_channels[name] for name in names if name in self.from_channels)
        return "; ".join((text, *notes))

    def with_channel(self, channel: Channel, responsivity: Value, **others: Any) -> Measurements:
        """Return the measurements with gain, saturation and responsivity of a channel, and with other changes."""
        return replace(
            self,
            gain=channel.gain,
            saturation_dn=channel.saturation.level_dn,
            saturation_method=channel.saturation.level_method,
            saturation_photons=channel.saturation.x if channel.levels.photons_known else NO_PHOTONS,
            responsivity=responsivity,
            saturation_responsivity=responsivity,
            **others,
        )

    def without_dark_shot_noise(self, exposure_s: float) -> Measurements:
        """Return the measurements with the shot noise of the dark current, K (dark slope) t, taken off the read noise.

        A sensor file holds read noise and dark current, and a simulation adds both. Without gain or dark slope, the
        measurements are returned unchanged.
        """
        if isinstance(self.gain, Missing) or isinstance(self.dark_slope, Missing):
            return self
        if isinstance(self.read_variance, Missing):
            return self
        return replace(
            self,
            read_variance=self.read_variance - self.gain * self.dark_slope * exposure_s,
            read_method=f"{self.read_method}, shot noise of the dark current subtracted",
        )

    def for_sensor(self) -> Measurements:
        """Return the measurements for the sensor model, of which the chip's pixels are a sample.

        The spread of the pixels widens the uncertainty of the means over pixels.
        """
        response = self.responsivity
        if isinstance(response, Uncertain) and isinstance(self.response_variance, Uncertain):
            response = mean_for_sensor(response, self.response_variance * response.value**2, self.pixels)
        slope, slope_variance = self.dark_slope, self.dark_slope_variance
        if isinstance(slope, Uncertain) and isinstance(slope_variance, Uncertain):
            slope, slope_variance = of_one_sample(slope, slope_variance, self.dark_slope_third, self.pixels)
        # The pooled measurements of several channels keep another channel's responsivity, already widened.
        same = self.saturation_responsivity is self.responsivity
        return replace(
            self,
            black_level=mean_for_sensor(self.black_level, self.dsnu_variance, self.pixels),
            dark_slope=slope,
            dark_slope_variance=slope_variance,
            responsivity=response,
            saturation_responsivity=response if same else self.saturation_responsivity,
        )


def mean_for_sensor(mean: Value, variance: Value, pixels: int) -> Value:
    """Return a mean over the chip's pixels with variance / pixels added to its squared uncertainty."""
    if isinstance(mean, Missing) or isinstance(variance, Missing):
        return mean
    return mean + Uncertain.of(0.0, math.sqrt(max(variance.value, 0.0) / pixels))


_MEANS_OVER_CHANNELS = (
    "dsnu_variance",
    "dark_slope_variance",
    "response_variance",
    "saturation_dn",
    "responsivity",
    "dsnu1288",
    "dsnu1288_filtered",
    "prnu1288",
    "prnu1288_unfiltered",
)


def pool_channels(
    names: Sequence[str], channels: Sequence[Measurements], dark: Measurements, gain: Value
) -> Measurements:
    """Return all channels as one, weighted by their pixels.

    A channel that lacks a measurement is left out of its mean, and `from_channels` names the others. A measurement that
    no channel has is missing for the reason of the channel with the most measurements. Black level, dark slope, read
    variance and dark variance come from `dark`, all pixels together, because channels share the drift of the black
    level.
    """
    fullest = max(channels, key=_count_measured)
    changed: dict[str, object] = {"gain": gain, "pixels": sum(entry.pixels for entry in channels)}
    notes: dict[str, str] = {}
    for name in _MEANS_OVER_CHANNELS:
        known = {
            channel: entry
            for channel, entry in zip(names, channels, strict=True)
            if not isinstance(getattr(entry, name), Missing)
        }
        changed[name] = _mean_over([*known.values()], name) if known else getattr(fullest, name)
        if 0 < len(known) < len(names):
            others = ", ".join(channel for channel in names if channel not in known)
            notes[name] = f"channel{'s' * (len(known) > 1)} {', '.join(known)} only, not {others}"
    first_name, first = min(zip(names, channels, strict=True), key=lambda pair: _photons_at_saturation(pair[1]))
    if isinstance(first.saturation_photons, Uncertain):
        notes["saturation_photons"] = f"channel {first_name}, the first to saturate"
    else:
        first = fullest
    changed["saturation_photons"] = first.saturation_photons
    changed["saturation_responsivity"] = first.saturation_responsivity
    saturated = next((entry for entry in channels if isinstance(entry.saturation_dn, Uncertain)), fullest)
    changed["saturation_method"] = saturated.saturation_method
    changed["dark_slope_third"] = sum(m.pixels * m.dark_slope_third for m in channels) / sum(m.pixels for m in channels)
    changed["linearity"] = tuple(found for entry in channels for found in entry.linearity)
    return replace(dark, from_channels=notes, **changed)  # type: ignore[arg-type]


def _mean_over(channels: Sequence[Measurements], name: str) -> Uncertain | Parts:
    values = [getattr(entry, name) for entry in channels]
    weights = [float(entry.pixels) for entry in channels]
    return pool_parts(values, weights) if isinstance(values[0], Parts) else weighted_mean(values, weights)


def _count_measured(m: Measurements) -> int:
    return sum(isinstance(getattr(m, entry.name), Uncertain | Parts) for entry in fields(m))


def _photons_at_saturation(m: Measurements) -> float:
    return m.saturation_photons.value if isinstance(m.saturation_photons, Uncertain) else math.inf
