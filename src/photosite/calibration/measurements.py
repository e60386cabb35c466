"""From what was measured to the parameters: units, the figures of EMVA 1288, and how each was obtained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

from photosite.calibration.parameters import Parameters
from photosite.calibration.photon_transfer.linearity import Linearity, linearity_estimates
from photosite.calibration.spatial.parts import Parts, pool_parts
from photosite.values.estimate import Estimate
from photosite.values.standard_deviation import standard_deviation, standard_deviation_interval_95, upper_limit_95
from photosite.values.uncertain import (
    Missing,
    Uncertain,
    Value,
    derive,
    weighted_mean,
)

QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole numbers, DN^2."""

COARSEST_STEP = 0.10
"""Of the exposure at saturation: EMVA 1288 wants 50 equal steps or more; where neighbours leave the largest variance
more uncertain than this, it does not say where saturation is."""

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
    dark_slope_third
        Third central moment over pixels of the dark slope, DN^3/s^3.
    dark_variance, dark_variance_slope
        Temporal variance at exposure zero, quantisation in it, DN^2; its slope against exposure, DN^2/s.
    response_variance
        Relative variance over pixels of the per-pixel response: PRNU squared.
    gain
        System gain, DN per electron.
    saturation_dn, saturation_photons
        What clipped pixels read; photons at the largest temporal variance.
    responsivity, saturation_responsivity
        DN per photon; of the channel that `saturation_photons` is of.
    dsnu1288, dsnu1288_filtered, prnu1288, prnu1288_unfiltered
        Spatial variances after EMVA 1288: DN^2, plain and high-passed; relative, high-passed and plain.
    read_method, saturation_method
        How those were read.
    dark_method
        How read noise, DSNU and black level were read off darks that clip at 0; "" where none do.
    linearity
        Of the channel, or of each of all together.
    from_channels
        Of all channels together: which channels a figure above is from, by its name, where not all share in it.
    """

    pixels: int
    read_variance: Value
    dsnu_variance: Value
    black_level: Value
    dark_slope: Value
    dark_slope_variance: Value
    dark_variance: Value
    dark_variance_slope: Value
    response_variance: Value
    gain: Value
    saturation_dn: Value
    saturation_photons: Value
    responsivity: Value
    saturation_responsivity: Value
    dsnu1288: Parts | Missing
    dsnu1288_filtered: Parts | Missing
    prnu1288: Parts | Missing
    prnu1288_unfiltered: Parts | Missing
    read_method: str
    saturation_method: str
    dark_method: str = ""
    linearity: tuple[Linearity | Missing, ...] = ()
    dark_slope_third: float = 0.0
    from_channels: Mapping[str, str] = field(default_factory=dict)

    def method(self, text: str, *figures: str) -> str:
        """How a parameter was estimated: the text, and of which channels the figures behind it are."""
        notes = dict.fromkeys(self.from_channels[name] for name in figures if name in self.from_channels)
        return "; ".join((text, *notes))


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


def pool(names: Sequence[str], channels: Sequence[Measurements], darkness: Measurements, gain: Value) -> Measurements:
    """All channels as one, weighted by their pixels; a channel that lacks a figure is left out of it, and it says so.

    What no channel has is missing for the reason of the channel that got furthest: the most figures of its own.

    Parameters
    ----------
    names, channels
        Each channel's name and measurements.
    darkness
        Where black level, dark slope, read and dark variance come from: measured on all pixels together, because
        channels share the drift of the black level.
    gain
        Fitted to all channels together.
    """
    furthest = max(channels, key=_figures_known)
    changed: dict[str, object] = {"gain": gain, "pixels": sum(entry.pixels for entry in channels)}
    notes: dict[str, str] = {}
    for figure in _MEANS_OVER_CHANNELS:
        known = {
            name: entry
            for name, entry in zip(names, channels, strict=True)
            if not isinstance(getattr(entry, figure), Missing)
        }
        changed[figure] = _mean_over([*known.values()], figure) if known else getattr(furthest, figure)
        if 0 < len(known) < len(names):
            notes[figure] = _only([*known], [name for name in names if name not in known])
    name, first = min(zip(names, channels, strict=True), key=lambda pair: _photons_at_saturation(pair[1]))
    if isinstance(first.saturation_photons, Uncertain):
        notes["saturation_photons"] = f"channel {name}, the first to saturate"
    else:
        first = furthest
    changed["saturation_photons"] = first.saturation_photons
    changed["saturation_responsivity"] = first.saturation_responsivity
    seen = next((entry for entry in channels if isinstance(entry.saturation_dn, Uncertain)), furthest)
    changed["saturation_method"] = seen.saturation_method
    changed["dark_slope_third"] = sum(m.pixels * m.dark_slope_third for m in channels) / sum(m.pixels for m in channels)
    changed["linearity"] = tuple(found for entry in channels for found in entry.linearity)
    return replace(darkness, from_channels=notes, **changed)  # type: ignore[arg-type]


def _mean_over(channels: Sequence[Measurements], figure: str) -> Uncertain | Parts:
    values = [getattr(entry, figure) for entry in channels]
    weights = [float(entry.pixels) for entry in channels]
    return pool_parts(values, weights) if isinstance(values[0], Parts) else weighted_mean(values, weights)


def _only(used: Sequence[str], lacking: Sequence[str]) -> str:
    """Which channels a mean is over: "channel G only, not R, B"."""
    return f"channel{'s' * (len(used) > 1)} {', '.join(used)} only, not {', '.join(lacking)}"


def _figures_known(m: Measurements) -> int:
    """How many figures a channel has."""
    return sum(isinstance(getattr(m, entry.name), Uncertain | Parts) for entry in fields(m))


def _photons_at_saturation(m: Measurements) -> float:
    """To find the channel that saturates first; those of which it is not known come last."""
    return m.saturation_photons.value if isinstance(m.saturation_photons, Uncertain) else math.inf


def _spread(variance: Value, scale: Value, method: str) -> Estimate:
    """A standard deviation in the unit that `scale` turns it into."""
    if isinstance(variance, Missing) or isinstance(scale, Missing):
        missing = variance if isinstance(variance, Missing) else scale
        return Estimate.of(missing, method)
    limit = upper_limit_95(variance)
    return Estimate.of(
        standard_deviation(variance) * scale,
        method,
        None if limit is None else limit * scale.value,
        standard_deviation_interval_95(variance * scale * scale),
    )


def _part_estimates(parts: Parts | Missing, scale: Value, method: str) -> dict[str, Estimate]:
    """Estimates for total, row, column and pixel."""
    if isinstance(parts, Missing):
        return {entry.name: Estimate.of(parts, method) for entry in fields(Parts)}
    return {entry.name: _spread(getattr(parts, entry.name), scale, method) for entry in fields(Parts)}


def _noise_and_pattern(m: Measurements, mv: Value, per_e: Value) -> dict[str, Estimate]:
    one = Uncertain(1.0)
    read = "; ".join((m.read_method, m.dark_method or "mean over pixels of the temporal variance, 1/12 DN² taken off"))
    dsnu = m.method(
        m.dark_method or "spread over pixels of the mean repeated dark, temporal variance / n taken off",
        "dsnu_variance",
    )
    slope = "slope of the mean dark level against exposure"
    dcnu = m.method(
        "spread of per-pixel dark slopes, their noise taken off, relative to the mean slope", "dark_slope_variance"
    )
    return {
        "read_noise_dn": _read_noise(m, one, read),
        "read_noise_e": _read_noise(m, per_e, read),
        "read_noise_mv": _read_noise(m, mv, read),
        "dsnu_dn": _spread(m.dsnu_variance, one, dsnu),
        "dsnu_e": _spread(m.dsnu_variance, per_e, dsnu),
        "dsnu_mv": _spread(m.dsnu_variance, mv, dsnu),
        "prnu_percent": _spread(
            m.response_variance,
            Uncertain(100.0),
            m.method(
                "spread of per-pixel slopes against exposure in the linear range, their noise taken off, relative",
                "response_variance",
            ),
        ),
        "dark_voltage_mv_per_s": Estimate.of(derive(lambda a, b: a * b, m.dark_slope, mv), slope),
        "dark_current_e_per_s": Estimate.of(derive(lambda a, b: a * b, m.dark_slope, per_e), slope),
        "dark_current_from_variance_e_per_s": Estimate.of(
            derive(lambda a, b: a * b * b, m.dark_variance_slope, per_e),
            "slope of the dark temporal variance against exposure / K² (EMVA 1288 R4.0, dark current)",
        ),
        "dcnu_percent": _spread(m.dark_slope_variance, _percent_of_dark(m.dark_slope), dcnu),
        "black_level_dn": Estimate.of(m.black_level, m.dark_method or "mean dark level at exposure zero"),
    }


def _percent_of_dark(slope: Value) -> Value:
    if isinstance(slope, Missing):
        return slope
    if slope.value < 3.0 * slope.standard_uncertainty:
        return Missing("the dark current is not distinguishable from zero; take longer dark exposures")
    return 100.0 / slope


def _read_noise(m: Measurements, scale: Value, method: str) -> Estimate:
    """Read noise in the unit that `scale` turns it into; where rounding hides it, its upper limit alone."""
    dark, found = m.dark_variance, _spread(m.read_variance, scale, method)
    if not isinstance(dark, Uncertain) or dark.value >= LEAST_DARK_VARIANCE or found.value is None:
        return found
    assert isinstance(scale, Uncertain) and found.interval_95  # noqa: PT018
    limit = max(math.sqrt(LEAST_DARK_VARIANCE - QUANTISATION) * scale.value, found.interval_95[1])
    return Estimate(
        reason=f"the dark temporal variance, {dark.value:.3g} DN², is below {LEAST_DARK_VARIANCE} DN²: rounding to "
        f"whole numbers hides the read noise; its 95 % upper limit is {limit:.3g}",
        upper_limit_95=limit,
        method=method,
    )


def _temporal_dark_noise(dark_variance: Value, per_e: Value, clipped: str) -> Estimate:
    method = f"dark temporal variance at exposure zero{clipped}, 1/12 DN² taken off (EMVA 1288 R4.0, dark noise)"
    result = _spread(derive(lambda v: v - QUANTISATION, dark_variance), per_e, method)
    if (
        isinstance(dark_variance, Uncertain)
        and isinstance(per_e, Uncertain)
        and dark_variance.value < LEAST_DARK_VARIANCE
    ):
        limit = math.sqrt(LEAST_DARK_VARIANCE - QUANTISATION) * per_e.value
        return replace(result, upper_limit_95=max(limit, result.upper_limit_95 or 0.0))
    return result


@dataclass(frozen=True)
class _Capacity:
    """Saturation in electrons and in photons, how it was found, and the measurement it rests on."""

    electrons: Value
    photons: Value
    text: str
    photons_text: str
    figure: str


def _capacity(m: Measurements) -> _Capacity:
    """Saturation by EMVA's variance maximum where the exposures locate it, else by what clipped pixels read."""
    efficiency = derive(lambda r, k: r / k, m.saturation_responsivity, m.gain)
    peak = m.saturation_photons
    known = isinstance(peak, Uncertain) and isinstance(efficiency, Uncertain)
    fine = isinstance(peak, Uncertain) and peak.standard_uncertainty <= COARSEST_STEP * peak.value
    if known and (fine or isinstance(m.saturation_dn, Missing)):
        text = "photons at the largest temporal variance (EMVA 1288 R4.0, photon transfer)"
        electrons = derive(lambda q, photons: q * photons, efficiency, peak)
        return _Capacity(electrons, peak, f"quantum efficiency times {text}", text, "saturation_photons")
    electrons = derive(lambda top, black, k: (top - black) / k, m.saturation_dn, m.black_level, m.gain)
    text = f"(saturation less black level) / system gain; saturation: {m.saturation_method}"
    if not known:
        return _Capacity(electrons, peak, text, text, "saturation_dn")
    photons = derive(lambda e, q: e / q, electrons, efficiency)
    coarse = "the exposures are too far apart for EMVA's largest variance"
    return _Capacity(
        electrons,
        photons,
        f"{text}; {coarse}",
        f"saturation in electrons / quantum efficiency; {coarse}",
        "saturation_dn",
    )


def _threshold_e(dark_variance: Value, gain: Value) -> Value:
    """Electrons at which the SNR is 1, quantisation in it: sqrt(var / K^2 + 1/4) + 1/2."""
    if isinstance(dark_variance, Uncertain) and dark_variance.value < 0.0:
        return Missing("the dark temporal variance is negative at exposure zero; take shorter darks")
    return derive(lambda v, k: (v / (k * k) + 0.25).sqrt() + 0.5, dark_variance, gain)


def _emva(m: Measurements, per_e: Value) -> dict[str, Estimate]:
    efficiency = derive(lambda r, k: r / k, m.responsivity, m.gain)
    threshold_e = _threshold_e(m.dark_variance, m.gain)
    threshold = derive(lambda e, q: e / q, threshold_e, efficiency)
    saturation = _capacity(m)
    capacity, of_capacity = saturation.electrons, saturation.figure
    range_db = derive(lambda top, low: (top / low).decibel(20.0), capacity, threshold_e)
    texts: dict[str, tuple[Value, str, str]] = {
        "responsivity_dn_per_photon": (
            m.responsivity,
            "slope through the origin of signal against photons (EMVA 1288 R4.0, photon transfer)",
            "responsivity",
        ),
        "quantum_efficiency_percent": (
            derive(lambda q: q * 100.0, efficiency),
            "responsivity / system gain (EMVA 1288 R4.0, photon transfer)",
            "responsivity",
        ),
        "sensitivity_threshold_photons": (
            threshold,
            "photons at SNR 1: (sqrt(dark variance / K² + 1/4) + 1/2) / QE (EMVA 1288 R4.0)",
            "responsivity",
        ),
        "saturation_capacity_photons": (saturation.photons, saturation.photons_text, saturation.figure),
        "snr_max_db": (
            derive(lambda e: e.decibel(10.0), capacity),
            "20 log10 sqrt(saturation capacity) (EMVA 1288 R4.0)",
            of_capacity,
        ),
        "dynamic_range_db": (
            range_db,
            "20 log10(saturation capacity / sensitivity threshold) (EMVA 1288 R4.0)",
            of_capacity,
        ),
    }
    return {
        **{name: Estimate.of(value, m.method(text, figure)) for name, (value, text, figure) in texts.items()},
        "temporal_dark_noise_e": _temporal_dark_noise(m.dark_variance, per_e, _turned_back(m)),
        "saturation_capacity_e": Estimate.of(capacity, m.method(saturation.text, saturation.figure)),
    }


def _turned_back(m: Measurements) -> str:
    return ", brought back to what it is without clipping" if m.dark_method else ""


def _emva_pattern(m: Measurements, per_e: Value) -> dict[str, Estimate]:
    dark = f"spatial variance of the mean dark less temporal variance / n{_turned_back(m)}, {{}} (EMVA 1288 R4.0, DSNU)"
    light = "spatial variance at half saturation less the dark's, {} (EMVA 1288 {}, PRNU)"
    percent = Uncertain(100.0)
    result: dict[str, Estimate] = {}
    for prefix, unit, parts, scale, text in (
        ("dsnu1288", "e", m.dsnu1288, per_e, dark.format("no high-pass")),
        ("dsnu1288_filtered", "e", m.dsnu1288_filtered, per_e, dark.format("high-passed")),
        ("prnu1288", "percent", m.prnu1288, percent, light.format("high-passed", "R4.0")),
        ("prnu1288_unfiltered", "percent", m.prnu1288_unfiltered, percent, light.format("no high-pass", "R3.1")),
    ):
        entries = _part_estimates(parts, scale, m.method(text, prefix))
        result[f"{prefix}_{unit}"] = entries["total"]
        for part in ("row", "column", "pixel"):
            result[f"{prefix}_{part}_{unit}"] = entries[part]
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
        **linearity_estimates(m.linearity),
        system_gain_dn_per_e=Estimate.of(m.gain, gain_method),
        conversion_gain_uv_per_e=Estimate.of(
            derive(lambda k, mv: k * mv * 1e3, m.gain, mv_per_dn), "system gain times volts per digital number"
        ),
        saturation_dn=Estimate.of(m.saturation_dn, m.method(m.saturation_method, "saturation_dn")),
    )
