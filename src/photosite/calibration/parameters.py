"""The parameters of a sensor, each with its label and unit, and their estimates from measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, get_type_hints

from photosite.calibration.measurements import Measurements
from photosite.calibration.photon_transfer.linearity import linearity_estimates
from photosite.calibration.reduction.groups import LEAST_DARK_VARIANCE
from photosite.calibration.withheld import HIDDEN_NOISE, NEGATIVE_DARK_VARIANCE, NO_DARK_CURRENT
from photosite.errors import InputError, did_you_mean
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.shown import ResultTable, Tabular
from photosite.values.uncertain import Missing, Uncertain, Value, derive

_NOISE = "Noise and fixed pattern (2008 paper)"
_DARK = "Dark signal"
_GAIN = "Gain and saturation"
_EMVA = "EMVA 1288"


_PRINCIPAL = (
    *("read_noise_e", "dsnu_e", "prnu_percent", "dark_current_e_per_s", "black_level_dn", "system_gain_dn_per_e"),
    *("saturation_capacity_e", "quantum_efficiency_percent", "snr_max_db", "dynamic_range_db"),
)
"""The parameters that `repr` shows."""


@dataclass(frozen=True, slots=True)
class Label:
    """How a parameter is shown: its name in words, its unit, and the heading it stands under in long tables."""

    label: str
    unit: str
    topic: str


@dataclass(frozen=True, kw_only=True)
class Parameters(Tabular):
    """The parameters of a sensor or of one color channel, named after EMVA 1288 and the 2008 paper.

    Noise and nonuniformity are standard deviations. `_dn`, `_e` and `_mv` are the same quantity in digital numbers,
    electrons and millivolts at the pixel.
    """

    read_noise_dn: Annotated[Estimate, Label("Read noise", "DN", _NOISE)]
    read_noise_e: Annotated[Estimate, Label("Read noise", "e⁻", _NOISE)]
    read_noise_mv: Annotated[Estimate, Label("Read noise", "mV", _NOISE)]
    row_noise_dn: Annotated[Estimate, Label("Row noise", "DN", _NOISE)]
    row_noise_e: Annotated[Estimate, Label("Row noise", "e⁻", _NOISE)]
    row_noise_mv: Annotated[Estimate, Label("Row noise", "mV", _NOISE)]
    column_noise_dn: Annotated[Estimate, Label("Column noise", "DN", _NOISE)]
    column_noise_e: Annotated[Estimate, Label("Column noise", "e⁻", _NOISE)]
    column_noise_mv: Annotated[Estimate, Label("Column noise", "mV", _NOISE)]
    dsnu_dn: Annotated[Estimate, Label("DSNU", "DN", _NOISE)]
    dsnu_e: Annotated[Estimate, Label("DSNU", "e⁻", _NOISE)]
    dsnu_mv: Annotated[Estimate, Label("DSNU", "mV", _NOISE)]
    prnu_percent: Annotated[Estimate, Label("PRNU", "%", _NOISE)]
    row_offset_e: Annotated[Estimate, Label("Fixed offsets of rows", "e⁻", _NOISE)]
    column_offset_e: Annotated[Estimate, Label("Fixed offsets of columns", "e⁻", _NOISE)]
    column_gain_percent: Annotated[Estimate, Label("Gains of columns", "%", _NOISE)]
    shading_percent: Annotated[Estimate, Label("Shading", "%", _NOISE)]
    interpixel_coupling_percent: Annotated[Estimate, Label("Interpixel coupling", "%", _NOISE)]
    dark_voltage_mv_per_s: Annotated[Estimate, Label("Dark voltage", "mV/s", _DARK)]
    dark_current_dn_per_s: Annotated[Estimate, Label("Dark current", "DN/s", _DARK)]
    dark_current_e_per_s: Annotated[Estimate, Label("Dark current", "e⁻/s", _DARK)]
    dark_current_from_variance_e_per_s: Annotated[Estimate, Label("Dark current from variance", "e⁻/s", _DARK)]
    dcnu_percent: Annotated[Estimate, Label("Dark current nonuniformity", "%", _DARK)]
    black_level_dn: Annotated[Estimate, Label("Black level", "DN", _DARK)]
    system_gain_dn_per_e: Annotated[Estimate, Label("System gain K", "DN/e⁻", _GAIN)]
    conversion_gain_uv_per_e: Annotated[Estimate, Label("Conversion gain", "µV/e⁻", _GAIN)]
    saturation_dn: Annotated[Estimate, Label("Saturation", "DN", _GAIN)]
    saturation_capacity_e: Annotated[Estimate, Label("Saturation capacity", "e⁻", _GAIN)]
    responsivity_dn_per_photon: Annotated[Estimate, Label("Responsivity", "DN/photon", _EMVA)]
    quantum_efficiency_percent: Annotated[Estimate, Label("Quantum efficiency", "%", _EMVA)]
    temporal_dark_noise_e: Annotated[Estimate, Label("Temporal dark noise", "e⁻", _EMVA)]
    sensitivity_threshold_photons: Annotated[Estimate, Label("Absolute sensitivity threshold", "photons", _EMVA)]
    saturation_capacity_photons: Annotated[Estimate, Label("Saturation capacity", "photons", _EMVA)]
    snr_max_db: Annotated[Estimate, Label("Maximum SNR", "dB", _EMVA)]
    dynamic_range_db: Annotated[Estimate, Label("Dynamic range", "dB", _EMVA)]
    linearity_error_percent: Annotated[Estimate, Label("Linearity error LE", "%", _EMVA)]
    linearity_error_min_percent: Annotated[Estimate, Label("Linearity error LE, lowest", "%", _EMVA)]
    linearity_error_max_percent: Annotated[Estimate, Label("Linearity error LE, highest", "%", _EMVA)]
    linearity_error_full_scale_percent: Annotated[Estimate, Label("Linearity error of full scale (R3.0)", "%", _EMVA)]
    dsnu1288_e: Annotated[Estimate, Label("DSNU1288", "e⁻", _EMVA)]
    dsnu1288_row_e: Annotated[Estimate, Label("DSNU1288, rows", "e⁻", _EMVA)]
    dsnu1288_column_e: Annotated[Estimate, Label("DSNU1288, columns", "e⁻", _EMVA)]
    dsnu1288_pixel_e: Annotated[Estimate, Label("DSNU1288, pixels", "e⁻", _EMVA)]
    dsnu1288_filtered_e: Annotated[Estimate, Label("DSNU1288 after high-pass", "e⁻", _EMVA)]
    dsnu1288_filtered_row_e: Annotated[Estimate, Label("DSNU1288 after high-pass, rows", "e⁻", _EMVA)]
    dsnu1288_filtered_column_e: Annotated[Estimate, Label("DSNU1288 after high-pass, columns", "e⁻", _EMVA)]
    dsnu1288_filtered_pixel_e: Annotated[Estimate, Label("DSNU1288 after high-pass, pixels", "e⁻", _EMVA)]
    prnu1288_percent: Annotated[Estimate, Label("PRNU1288", "%", _EMVA)]
    prnu1288_row_percent: Annotated[Estimate, Label("PRNU1288, rows", "%", _EMVA)]
    prnu1288_column_percent: Annotated[Estimate, Label("PRNU1288, columns", "%", _EMVA)]
    prnu1288_pixel_percent: Annotated[Estimate, Label("PRNU1288, pixels", "%", _EMVA)]
    prnu1288_unfiltered_percent: Annotated[Estimate, Label("PRNU1288 without high-pass", "%", _EMVA)]
    prnu1288_unfiltered_row_percent: Annotated[Estimate, Label("PRNU1288 without high-pass, rows", "%", _EMVA)]
    prnu1288_unfiltered_column_percent: Annotated[Estimate, Label("PRNU1288 without high-pass, columns", "%", _EMVA)]
    prnu1288_unfiltered_pixel_percent: Annotated[Estimate, Label("PRNU1288 without high-pass, pixels", "%", _EMVA)]

    def _table(self) -> ResultTable:
        rows = [
            (
                name,
                entry.shown_value,
                entry.standard_uncertainty,
                *(entry.interval_95 or (None, None)),
                PARAMETER_LABELS[name].unit,
                entry.reason,
            )
            for name, entry in self.estimates().items()
        ]
        columns = ("parameter", "value", "standard_uncertainty", "lower_95", "upper_95", "unit", "reason")
        return ResultTable("Parameters", columns, rows)

    def _brief_table(self) -> ResultTable:
        rows = []
        for name in _PRINCIPAL:
            entry: Estimate = getattr(self, name)
            if entry.upper_limit_95 is None:
                numbers, remark = (entry.value, entry.standard_uncertainty), entry.reason
            else:
                numbers, remark = (None, None), f"below {entry.upper_limit_95:.3g} with 95 % probability"
            rows.append((name, *numbers, PARAMETER_LABELS[name].unit, remark))
        columns = ("parameter", "value", "standard_uncertainty", "unit", "remark")
        return ResultTable(self._table().title, columns, rows)

    def estimates(self) -> dict[str, Estimate]:
        """Return all parameters by name, in the order above."""
        return {name: getattr(self, name) for name in PARAMETER_LABELS}


PARAMETER_LABELS: dict[str, Label] = {
    name: hint.__metadata__[0] for name, hint in get_type_hints(Parameters, include_extras=True).items()
}
"""Label and unit by the parameter's name, in the order of `Parameters`."""


def parameter_label(name: str) -> Label:
    """Return the label of a parameter, by its name in `Parameters`.

    Raises
    ------
    InputError
        If the name is unknown.
    """
    if name not in PARAMETER_LABELS:
        raise InputError("parameter", value=name, expected="a known name", hint=did_you_mean(name, PARAMETER_LABELS))
    return PARAMETER_LABELS[name]


COARSEST_STEP = 0.10
"""Largest uncertainty of the saturation exposure, relative, at which the largest variance locates saturation.

EMVA 1288 asks for 50 equal exposure steps or more."""


def least_dark_variance(m: Measurements) -> float:
    """Return `LEAST_DARK_VARIANCE` for the step of the converter's codes, with the quantization noise of 1 DN."""
    return (LEAST_DARK_VARIANCE - QUANTIZATION_DN2) * m.step**2 + QUANTIZATION_DN2


def estimate_parameters(m: Measurements, mv_per_dn: Value, *, standard: bool = False) -> Parameters:
    """Return all parameters with their uncertainties, in every unit that is known.

    The saturation capacity is that of fully clipped pixels; with `standard`, it is EMVA 1288's at the largest temporal
    variance where the exposures locate it.
    """
    per_e = derive(lambda k: 1.0 / k, m.gain)
    gain_method = "slope through the origin of temporal variance against signal (EMVA 1288 R4.0, photon transfer)"
    if m.gain_method:
        gain_method = m.gain_method
    elif m.curved:
        gain_method = "gain at small signal, fitted with the response curve to means and temporal variances"
    elif isinstance(m.dark_variance, Missing):
        gain_method = "slope of temporal variance against mean with a free constant, from the flat fields alone"
    volts = derive(lambda k, mv: k * mv * 1e3, m.gain, mv_per_dn)
    return Parameters(
        **_noise_and_pattern(m, mv_per_dn, per_e),
        **_emva(m, per_e, standard=standard),
        **_emva_pattern(m, per_e, standard=standard),
        **linearity_estimates(m.linearity),
        system_gain_dn_per_e=Estimate.of(m.gain, gain_method),
        conversion_gain_uv_per_e=Estimate.of(volts, "system gain times volts per digital number"),
        saturation_dn=Estimate.of(m.saturation_dn, m.method(m.saturation_method, "saturation_dn")),
    )


def _deviation(variance: Value, scale: Value, method: str) -> Estimate:
    """Return the estimate of a standard deviation, multiplied by a scale."""
    if isinstance(variance, Missing) or isinstance(scale, Missing):
        return Estimate.of(variance if isinstance(variance, Missing) else scale, method)
    return Estimate.of_variance(variance, method, scale)


def _noise_and_pattern(m: Measurements, mv: Value, per_e: Value) -> dict[str, Estimate]:
    scales = {"dn": Uncertain(1.0), "e": per_e, "mv": mv}
    read = "; ".join((m.read_method, m.dark_method or "mean over pixels of the temporal variance less 1/12 DN²"))
    dsnu = m.method(m.dsnu_method, "dsnu_variance")
    prnu = "relative spread of per-pixel slopes against exposure in the linear range, less their noise"
    shading = "part of PRNU that the high-pass filter of EMVA 1288 removes: uneven light, vignetting"
    dcnu = "spread of per-pixel dark slopes, less their noise, relative to the mean slope"
    slope = "slope of the mean dark level against exposure"
    noise_slope = "slope of the dark temporal variance against exposure / K² (EMVA 1288 R4.0, dark current)"
    from_variance = derive(lambda a, b: a * b * b, m.dark_variance_slope, per_e)
    return {
        **{f"read_noise_{unit}": _limited(_read_noise(m, scale, read), m, scale) for unit, scale in scales.items()},
        **{f"row_noise_{unit}": _line_noise(m, m.row_variance, scale) for unit, scale in scales.items()},
        **{f"column_noise_{unit}": _line_noise(m, m.column_variance, scale) for unit, scale in scales.items()},
        **{
            f"dsnu_{unit}": _limited(_deviation(m.dsnu_variance, scale, dsnu), m, scale)
            for unit, scale in scales.items()
        },
        "prnu_percent": _deviation(m.response_variance, Uncertain(100.0), m.method(prnu, "response_variance")),
        **_lines(m, per_e),
        "shading_percent": _deviation(m.shading_variance, Uncertain(100.0), m.method(shading, "shading_variance")),
        "interpixel_coupling_percent": Estimate.of(
            derive(lambda fraction: 100.0 * fraction, m.coupling),
            "fraction of the signal in each next pixel, from the covariances of the shot noise of neighboring pixels",
        ),
        "dark_voltage_mv_per_s": Estimate.of(derive(lambda a, b: a * b, m.dark_slope, mv), slope),
        "dark_current_dn_per_s": Estimate.of(m.dark_slope, slope),
        "dark_current_e_per_s": Estimate.of(derive(lambda a, b: a * b, m.dark_slope, per_e), slope),
        "dark_current_from_variance_e_per_s": Estimate.of(from_variance, noise_slope),
        "dcnu_percent": _deviation(
            m.dark_slope_variance, _percent_of_dark(m.dark_slope), m.method(dcnu, "dark_slope_variance")
        ),
        "black_level_dn": Estimate.of(m.black_level, m.dark_method or f"mean dark level at {m.dark_exposure}"),
    }


def _lines(m: Measurements, per_e: Value) -> dict[str, Estimate]:
    """Return the fixed offsets and gains of lines, which have no difference between readout channels."""
    dark = "{} part of DSNU1288 after the high-pass, without differences that repeat or halve the frame"
    light = "column part of PRNU1288, without differences that repeat or halve the frame"
    return {
        "row_offset_e": _deviation(m.row_offset_variance, per_e, m.method(dark.format("row"), "row_offset_variance")),
        "column_offset_e": _deviation(
            m.column_offset_variance, per_e, m.method(dark.format("column"), "column_offset_variance")
        ),
        "column_gain_percent": _deviation(
            m.column_gain_variance, Uncertain(100.0), m.method(light, "column_gain_variance")
        ),
    }


def _limited(entry: Estimate, m: Measurements, scale: Value) -> Estimate:
    """Return a missing part of the spread of single dark frames with its upper limit, the whole."""
    if entry.value is not None or m.noise_and_pattern is None or isinstance(scale, Missing):
        return entry
    limit = math.sqrt(max(m.noise_and_pattern.interval_95[1], 0.0)) * scale.interval_95[1]
    return replace(entry, reason=f"{entry.reason}; its 95 % upper limit is {limit:.3g}", upper_limit_95=limit)


def _percent_of_dark(slope: Value) -> Value:
    if isinstance(slope, Missing):
        return slope
    if slope.value < 3.0 * slope.standard_uncertainty:
        return NO_DARK_CURRENT.missing("the dark current is not distinguishable from zero; take longer dark exposures")
    return 100.0 / slope


def _measurable(m: Measurements, found: Estimate, scale: Value, *, standard: bool = False) -> Estimate:
    """Return the noise of a dark frame, multiplied by a scale; only its upper limit where quantization hides it.

    The limit of the standard is the same for all such sensors; else a larger one of the interval is taken.
    """
    dark, least = m.dark_variance, least_dark_variance(m)
    if not isinstance(dark, Uncertain) or dark.value >= least or found.value is None:
        return found
    assert isinstance(scale, Uncertain) and found.interval_95  # noqa: PT018
    limit = math.sqrt(least - QUANTIZATION_DN2) * scale.value
    if not standard:
        limit = max(limit, found.interval_95[1])
    return Estimate(
        reason=f"the dark temporal variance, {dark.value:.3g} DN², is below {least:.3g} DN²: quantization "
        f"hides the noise; its 95 % upper limit is {limit:.3g}",
        upper_limit_95=limit,
        method=found.method,
        reason_id=HIDDEN_NOISE.id,
    )


def _read_noise(m: Measurements, scale: Value, method: str) -> Estimate:
    """Return the read noise, multiplied by a scale."""
    return _measurable(m, _deviation(m.read_variance, scale, method), scale)


def _line_noise(m: Measurements, variance: Value, scale: Value) -> Estimate:
    """Return the noise that the pixels of a line share, multiplied by a scale."""
    method = "what the pixels of a line share in a dark frame and not in the next: two-way analysis of variance"
    return _measurable(m, _deviation(variance, scale, method), scale)


def _temporal_dark_noise(m: Measurements, per_e: Value, *, standard: bool) -> Estimate:
    method = (
        f"dark temporal variance at {m.dark_exposure}{_clipping_note(m)}, less 1/12 DN² (EMVA 1288 R4.0, dark noise)"
    )
    noise = derive(lambda v: v - QUANTIZATION_DN2, m.dark_variance)
    return _measurable(m, _deviation(noise, per_e, method), per_e, standard=standard)


def _clipping_note(m: Measurements) -> str:
    return ", corrected for clipping" if m.dark_method else ""


_Capacity = tuple[tuple[Value, str], tuple[Value, str], str]
"""Saturation in electrons and in photons, each with its method, and the measurement that both are based on."""


def _capacity(m: Measurements, efficiency: Value) -> _Capacity:
    """Return the saturation of fully clipped pixels."""
    electrons = saturated_electrons(m)
    text = f"(saturation less black level) / system gain; saturation: {m.saturation_method}"
    photons = derive(lambda e, q: e / q, electrons, efficiency)
    return (electrons, text), (photons, "saturation in electrons / quantum efficiency"), "saturation_dn"


def _standard_capacity(m: Measurements, efficiency: Value) -> _Capacity:
    """Return the saturation at EMVA's variance maximum where the exposures locate it, else that of clipped pixels."""
    peak = m.saturation_photons
    if isinstance(peak, Missing) or isinstance(efficiency, Missing):
        return _capacity(m, efficiency)
    if peak.standard_uncertainty > COARSEST_STEP * peak.value and isinstance(m.saturation_dn, Uncertain):
        return _capacity(m, efficiency)
    text = "photons at the largest temporal variance (EMVA 1288 R4.0, photon transfer)"
    electrons = efficiency * peak
    return (electrons, f"quantum efficiency times {text}"), (peak, text), "saturation_photons"


def saturated_electrons(m: Measurements) -> Value:
    """Return the electrons of fully clipped pixels."""
    inputs = m.saturation_dn, m.black_level, m.gain
    return derive(lambda top, black, k: (top - black) / k * m.saturation_stretch, *inputs)


def _threshold_e(m: Measurements) -> tuple[Value, str]:
    """Return the electrons at SNR 1, quantization included: sqrt(var / K^2 + 1/4) + 1/2; and what stands for var.

    Where quantization hides the noise, it is the least variance that can be measured, as EMVA 1288 has it.
    """
    dark, least, text = m.dark_variance, least_dark_variance(m), "dark variance"
    # At the exposure of the frames; at exposure zero, rounding errors are extrapolated.
    hidden = isinstance(m.read_variance, Uncertain) and m.read_variance.value + QUANTIZATION_DN2 < least
    if isinstance(dark, Uncertain) and dark.value < least:
        if dark.value < 0.0 and dark.standard_uncertainty > least and not hidden:
            return NEGATIVE_DARK_VARIANCE.missing(
                "the dark temporal variance is negative at exposure zero; take shorter dark frames"
            ), text
        dark, text = Uncertain(least), f"{least:.3g} DN², the least dark variance that can be measured,"
    return derive(lambda v, k: (v / (k * k) + 0.25).sqrt() + 0.5, dark, m.gain), text


def _emva(m: Measurements, per_e: Value, *, standard: bool) -> dict[str, Estimate]:
    threshold_e, noise = _threshold_e(m)
    efficiency = derive(lambda r, k: r / k, m.responsivity, m.gain)
    at_saturation = derive(lambda r, k: r / k, m.saturation_responsivity, m.gain)
    electrons, photons, measurement = (_standard_capacity if standard else _capacity)(m, at_saturation)
    range_db = derive(lambda top, low: (top / low).decibel(20.0), electrons[0], threshold_e)
    by_response = {
        "responsivity_dn_per_photon": (
            m.responsivity,
            f"slope through the origin of {'straightened ' * m.curved}signal against photons (EMVA 1288 R4.0, photon "
            "transfer)",
        ),
        "quantum_efficiency_percent": (
            derive(lambda q: q * 100.0, efficiency),
            "responsivity / system gain (EMVA 1288 R4.0, photon transfer)",
        ),
        "sensitivity_threshold_photons": (
            derive(lambda e, q: e / q, threshold_e, efficiency),
            f"photons at SNR 1: (sqrt({noise} / K² + 1/4) + 1/2) / QE (EMVA 1288 R4.0)",
        ),
    }
    by_saturation = {
        "saturation_capacity_e": electrons,
        "saturation_capacity_photons": photons,
        "snr_max_db": (
            derive(lambda e: e.decibel(10.0), electrons[0]),
            "20 log10 sqrt(saturation capacity) (EMVA 1288 R4.0)",
        ),
        "dynamic_range_db": (range_db, "20 log10(saturation capacity / sensitivity threshold) (EMVA 1288 R4.0)"),
    }
    return {
        **{name: Estimate.of(value, m.method(text, "responsivity")) for name, (value, text) in by_response.items()},
        **{name: Estimate.of(value, m.method(text, measurement)) for name, (value, text) in by_saturation.items()},
        "temporal_dark_noise_e": _temporal_dark_noise(m, per_e, standard=standard),
    }


def _emva_pattern(m: Measurements, per_e: Value, *, standard: bool) -> dict[str, Estimate]:
    clipping = _clipping_note(m)
    times = ", ".join(f"{t:g}" for t in sorted(set(m.dsnu1288_exposures_s)))
    dark = f"spatial variance of the dark level at {times} s less temporal noise{clipping}, {{}} (EMVA 1288 R4.0, DSNU)"
    light = "spatial variance at half saturation less that of the dark frames, {} (EMVA 1288 {}, PRNU)"
    percent = Uncertain(100.0)
    result: dict[str, Estimate] = {}
    for prefix, unit, parts, scale, text in (
        ("dsnu1288", "e", m.dsnu1288, per_e, dark.format("no high-pass")),
        ("dsnu1288_filtered", "e", m.dsnu1288_filtered, per_e, dark.format("high-passed")),
        ("prnu1288", "percent", m.prnu1288, percent, light.format("high-passed", "R4.0")),
        ("prnu1288_unfiltered", "percent", m.prnu1288_unfiltered, percent, light.format("no high-pass", "R3.1")),
    ):
        method = m.method(text, prefix)
        for part in ("total", "row", "column", "pixel"):
            name = f"{prefix}_{unit}" if part == "total" else f"{prefix}_{part}_{unit}"
            variance = parts if isinstance(parts, Missing) else getattr(parts.by_standard if standard else parts, part)
            result[name] = _deviation(variance, scale, method)
    return result
