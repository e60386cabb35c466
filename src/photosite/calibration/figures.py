"""From what was measured to the parameters: units, the figures of EMVA 1288, and how each was obtained."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from photosite.calibration.result import Estimate, Parameters
from photosite.calibration.spatial import Parts, pool_parts
from photosite.calibration.uncertain import (
    Missing,
    Uncertain,
    Value,
    derive,
    spread,
    upper_limit_95,
    weighted_mean,
)

QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole numbers, DN^2."""

LEAST_DARK_VARIANCE = 0.24
"""DN^2; EMVA 1288: below it quantisation hides the temporal dark noise, and this is its upper limit."""


@dataclass(frozen=True)
class Measurements:
    """What the frames say of one channel, or of all together. Variances may come out negative.

    Parameters
    ----------
    pixels
        How many it was measured on.
    read_variance, dsnu_variance
        Temporal (quantisation and dark shot noise off) and spatial (temporal off) variance of the repeated darks,
        DN^2.
    black_level, dark_slope, dark_slope_variance
        Intercept DN and slope DN/s of the dark mean; variance over pixels of the slope, DN^2/s^2.
    dark_variance
        Temporal variance at exposure zero, quantisation in it, DN^2.
    response_variance
        Relative variance over pixels of the per-pixel response: PRNU squared.
    gain
        System gain, DN per electron.
    saturation_dn, saturation_photons
        What clipped pixels read; photons at the largest temporal variance.
    responsivity, saturation_responsivity
        DN per photon; of the channel that `saturation_photons` is of.
    dsnu1288, prnu1288, prnu1288_unfiltered
        Spatial variances after EMVA 1288: DN^2; relative; relative.
    read_method, saturation_method, gain_method
        How those were read.
    """

    pixels: int
    read_variance: Value
    dsnu_variance: Value
    black_level: Value
    dark_slope: Value
    dark_slope_variance: Value
    dark_variance: Value
    response_variance: Value
    gain: Value
    saturation_dn: Value
    saturation_photons: Value
    responsivity: Value
    saturation_responsivity: Value
    dsnu1288: Parts | Missing
    prnu1288: Parts | Missing
    prnu1288_unfiltered: Parts | Missing
    read_method: str
    saturation_method: str


_MEANS_OVER_CHANNELS = (
    "dsnu_variance",
    "dark_slope_variance",
    "response_variance",
    "saturation_dn",
    "responsivity",
)


def pool(channels: list[Measurements], darkness: Measurements, gain: Value) -> Measurements:
    """All channels as one, weighted by their pixels; a channel that lacks a figure is left out of it.

    Parameters
    ----------
    channels
        Each channel's.
    darkness
        Where black level, dark slope, read and dark variance come from: measured on all pixels together, because
        channels share the drift of the black level.
    gain
        Fitted to all channels together.
    """
    changed: dict[str, object] = {"gain": gain, "pixels": sum(entry.pixels for entry in channels)}
    for name in _MEANS_OVER_CHANNELS:
        values = [(getattr(entry, name), float(entry.pixels)) for entry in channels]
        known = [(value, pixels) for value, pixels in values if isinstance(value, Uncertain)]
        changed[name] = (
            weighted_mean([value for value, _ in known], [pixels for _, pixels in known]) if known else values[0][0]
        )
    for name in ("dsnu1288", "prnu1288", "prnu1288_unfiltered"):
        parts = [(getattr(entry, name), float(entry.pixels)) for entry in channels]
        there = [(value, pixels) for value, pixels in parts if isinstance(value, Parts)]
        changed[name] = (
            pool_parts([value for value, _ in there], [pixels for _, pixels in there]) if there else parts[0][0]
        )
    first = min(channels, key=_photons_at_saturation)
    changed["saturation_photons"] = first.saturation_photons
    changed["saturation_responsivity"] = first.saturation_responsivity
    seen = next((entry for entry in channels if isinstance(entry.saturation_dn, Uncertain)), channels[0])
    changed["saturation_method"] = seen.saturation_method
    return replace(darkness, **changed)  # type: ignore[arg-type]


def _photons_at_saturation(m: Measurements) -> float:
    """To find the channel that saturates first; those of which it is not known come last."""
    return m.saturation_photons.value if isinstance(m.saturation_photons, Uncertain) else math.inf


def _spread(variance: Value, scale: Value, method: str) -> Estimate:
    """A standard deviation in the unit that `scale` turns it into."""
    if isinstance(variance, Missing) or isinstance(scale, Missing):
        missing = variance if isinstance(variance, Missing) else scale
        return Estimate.of(missing, method)
    limit = upper_limit_95(variance)
    return Estimate.of(spread(variance) * scale, method, None if limit is None else limit * scale.value)


def _part_estimates(parts: Parts | Missing, scale: Value, method: str) -> dict[str, Estimate]:
    """Estimates for total, row, column and pixel."""
    if isinstance(parts, Missing):
        return {entry.name: Estimate.of(parts, method) for entry in fields(Parts)}
    return {entry.name: _spread(getattr(parts, entry.name), scale, method) for entry in fields(Parts)}


def _noise_and_pattern(m: Measurements, mv: Value, per_e: Value) -> dict[str, Estimate]:
    one = Uncertain(1.0)
    read = f"{m.read_method}; mean over pixels of the temporal variance, 1/12 DN^2 taken off"
    dsnu = "spread over pixels of the mean repeated dark, temporal variance / n taken off"
    slope = "slope of the mean dark level against exposure"
    dcnu = "spread of per-pixel dark slopes, their noise taken off, relative to the mean slope"
    return {
        "read_noise_dn": _spread(m.read_variance, one, read),
        "read_noise_e": _spread(m.read_variance, per_e, read),
        "read_noise_mv": _spread(m.read_variance, mv, read),
        "dsnu_dn": _spread(m.dsnu_variance, one, dsnu),
        "dsnu_e": _spread(m.dsnu_variance, per_e, dsnu),
        "dsnu_mv": _spread(m.dsnu_variance, mv, dsnu),
        "prnu_percent": _spread(
            m.response_variance,
            Uncertain(100.0),
            "spread of per-pixel slopes against exposure in the linear range, their noise taken off, relative",
        ),
        "dark_voltage_mv_per_s": Estimate.of(derive(lambda a, b: a * b, m.dark_slope, mv), slope),
        "dark_current_e_per_s": Estimate.of(derive(lambda a, b: a * b, m.dark_slope, per_e), slope),
        "dcnu_percent": _spread(m.dark_slope_variance, _percent_of_dark(m.dark_slope), dcnu),
        "black_level_dn": Estimate.of(m.black_level, "mean dark level at exposure zero"),
    }


def _percent_of_dark(slope: Value) -> Value:
    if isinstance(slope, Missing):
        return slope
    if slope.value < 3.0 * slope.standard_uncertainty:
        return Missing("the dark current is not distinguishable from zero; take longer dark exposures")
    return 100.0 / slope


def _temporal_dark_noise(dark_variance: Value, per_e: Value) -> Estimate:
    method = "dark temporal variance at exposure zero, 1/12 DN^2 taken off (EMVA 1288 R4.0, temporal dark noise)"
    result = _spread(derive(lambda v: v - QUANTISATION, dark_variance), per_e, method)
    if (
        isinstance(dark_variance, Uncertain)
        and isinstance(per_e, Uncertain)
        and dark_variance.value < LEAST_DARK_VARIANCE
    ):
        limit = math.sqrt(LEAST_DARK_VARIANCE - QUANTISATION) * per_e.value
        return replace(result, upper_limit_95=max(limit, result.upper_limit_95 or 0.0))
    return result


def _capacity(m: Measurements) -> tuple[Value, str]:
    """Electrons at saturation."""
    efficiency = derive(lambda r, k: r / k, m.saturation_responsivity, m.gain)
    if isinstance(m.saturation_photons, Uncertain) and isinstance(efficiency, Uncertain):
        return (
            efficiency * m.saturation_photons,
            "quantum efficiency times photons at the largest temporal variance (EMVA 1288 R4.0, photon transfer)",
        )
    value = derive(lambda top, black, k: (top - black) / k, m.saturation_dn, m.black_level, m.gain)
    return value, f"(saturation less black level) / system gain; saturation: {m.saturation_method}"


def _threshold_e(dark_variance: Value, gain: Value) -> Value:
    """Electrons at which the SNR is 1, quantisation in it: sqrt(var / K^2 + 1/4) + 1/2."""
    if isinstance(dark_variance, Uncertain) and dark_variance.value < 0.0:
        return Missing("the dark temporal variance is negative at exposure zero; take shorter darks")
    return derive(lambda v, k: (v / (k * k) + 0.25).sqrt() + 0.5, dark_variance, gain)


def _emva(m: Measurements, per_e: Value) -> dict[str, Estimate]:
    efficiency = derive(lambda r, k: r / k, m.responsivity, m.gain)
    threshold_e = _threshold_e(m.dark_variance, m.gain)
    threshold = derive(lambda e, q: e / q, threshold_e, efficiency)
    capacity, capacity_method = _capacity(m)
    return {
        "responsivity_dn_per_photon": Estimate.of(
            m.responsivity, "slope through the origin of signal against photons (EMVA 1288 R4.0, photon transfer)"
        ),
        "quantum_efficiency_percent": Estimate.of(
            derive(lambda q: q * 100.0, efficiency), "responsivity / system gain (EMVA 1288 R4.0, photon transfer)"
        ),
        "temporal_dark_noise_e": _temporal_dark_noise(m.dark_variance, per_e),
        "sensitivity_threshold_photons": Estimate.of(
            threshold, "photons at SNR 1: (sqrt(dark variance / K^2 + 1/4) + 1/2) / QE (EMVA 1288 R4.0)"
        ),
        "saturation_capacity_photons": Estimate.of(
            m.saturation_photons, "photons at the largest temporal variance (EMVA 1288 R4.0, photon transfer)"
        ),
        "saturation_capacity_e": Estimate.of(capacity, capacity_method),
        "snr_max_db": Estimate.of(
            derive(lambda e: e.decibel(10.0), capacity), "20 log10 sqrt(saturation capacity) (EMVA 1288 R4.0)"
        ),
        "dynamic_range_db": Estimate.of(
            derive(lambda top, low: (top / low).decibel(20.0), capacity, threshold_e),
            "20 log10(saturation capacity / sensitivity threshold) (EMVA 1288 R4.0)",
        ),
    }


def _emva_pattern(m: Measurements, per_e: Value) -> dict[str, Estimate]:
    dark = "spatial variance of the mean dark less temporal variance / n (EMVA 1288 R4.0, DSNU)"
    light = "spatial variance at half saturation less the dark's, high-passed (EMVA 1288 R4.0, PRNU)"
    plain = "spatial variance at half saturation less the dark's, no high-pass (EMVA 1288 R3.0)"
    percent = Uncertain(100.0)
    result: dict[str, Estimate] = {}
    for prefix, unit, entries in (
        ("dsnu1288", "e", _part_estimates(m.dsnu1288, per_e, dark)),
        ("prnu1288", "percent", _part_estimates(m.prnu1288, percent, light)),
    ):
        result[f"{prefix}_{unit}"] = entries["total"]
        for part in ("row", "column", "pixel"):
            result[f"{prefix}_{part}_{unit}"] = entries[part]
    result["prnu1288_unfiltered_percent"] = _part_estimates(m.prnu1288_unfiltered, percent, plain)["total"]
    return result


def parameters(m: Measurements, mv_per_dn: Value) -> Parameters:
    """All parameters with their uncertainties, in every unit that can be given.

    Parameters
    ----------
    m
        What was measured.
    mv_per_dn
        Millivolts at the pixel per digital number.
    """
    per_e = derive(lambda k: 1.0 / k, m.gain)
    gain_method = "slope through the origin of temporal variance against signal (EMVA 1288 R4.0, photon transfer)"
    return Parameters(
        **_noise_and_pattern(m, mv_per_dn, per_e),
        **_emva(m, per_e),
        **_emva_pattern(m, per_e),
        system_gain_dn_per_e=Estimate.of(m.gain, gain_method),
        conversion_gain_uv_per_e=Estimate.of(
            derive(lambda k, mv: k * mv * 1e3, m.gain, mv_per_dn), "system gain times volts per digital number"
        ),
        saturation_dn=Estimate.of(m.saturation_dn, m.saturation_method),
    )
