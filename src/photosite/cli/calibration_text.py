"""A calibration on the terminal: ten figures and what limits them on one screen, or all parameters."""

from __future__ import annotations

from collections.abc import Sequence

from photosite.calibration.calibrate import AnyCalibration
from photosite.calibration.chip_maps.defect_groups import group_defects, shapes_text
from photosite.calibration.chip_maps.noise_shape import NORMAL_SHAPE
from photosite.calibration.chip_maps.pixel_gain import PixelGains
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.effect import effects
from photosite.calibration.finding import Finding
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.parameters import PARAMETER_LABELS, parameter_label
from photosite.calibration.result import Calibration
from photosite.calibration.settings_result import SHOWN, SettingsCalibration
from photosite.cli.output import diagnostics_text, table
from photosite.report.numbers import format_uncertain
from photosite.report.tables import format_estimate, interval_text
from photosite.sensor.chip import DefectKind, MeasuredChip
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing

_FIGURES = (
    ("read_noise_e", "read_noise_dn"),
    ("dsnu_e", "dsnu_dn"),
    ("prnu_percent",),
    ("system_gain_dn_per_e",),
    ("dark_current_e_per_s", "dark_current_dn_per_s"),
    ("saturation_capacity_e", "saturation_dn"),
    ("dynamic_range_db",),
    ("snr_max_db",),
    ("quantum_efficiency_percent",),
    ("linearity_error_percent",),
)
"""The figures that are printed, each with the parameter that stands in for it where it is missing."""


def calibration_text(result: AnyCalibration, *, every: bool) -> str:
    """Return a result for the terminal; `every`: all parameters with their methods and all diagnostics."""
    if isinstance(result, Calibration):
        parts = _calibration(result, every)
    elif isinstance(result, GainSeries):
        parts = _series(result)
    elif isinstance(result, SettingsCalibration):
        parts = _settings(result)
    else:
        content = result.to_dict()
        heads = ("parameter", "value", "standard_uncertainty", "lower_95", "upper_95", "reason")
        part = content["part"] if "part" in content else content["capture"]
        cells = zip(part, *(content[name] for name in heads), strict=True)
        parts = [table([("part", *heads), *(tuple(map(_cell, row)) for row in cells)], "<<>>>><")]
    return "\n\n".join([*parts, *diagnostics_text(result.diagnostics, every=every)])


def _settings(result: SettingsCalibration) -> list[str]:
    """Return the main figures of each setting in a table, and those of settings that are no single calibration."""
    single = {name: each for name, each in result.settings.items() if isinstance(each, Calibration)}
    rows: list[Sequence[str]] = [
        ("setting", *(f"{PARAMETER_LABELS[n].label}, {PARAMETER_LABELS[n].unit}" for n in SHOWN))
    ]
    for name, each in single.items():
        entries = [getattr(each, parameter) for parameter in SHOWN]
        rows.append(
            (name, *(format_estimate(entry) if entry.value is not None else entry.reason_id for entry in entries))
        )
    parts = [table(rows, "<" * len(rows[0]))] if single else []
    for name, found in result.settings.items():
        if isinstance(found, GainSeries):
            parts += [f"{name}:", *_series(found)]
    return parts


def _calibration(calibration: Calibration, every: bool) -> list[str]:
    heading = f"{calibration.source}: {calibration.frame_count} frames, EMVA 1288's {calibration.model} model"
    if every:
        own = [_amplifiers(calibration)] if calibration.amplifiers else []
        return [heading, _parameters(calibration), *own, *_effects(calibration), *_chip(calibration)]
    rows = [("parameter", "value", "unit", "95 % interval")]
    for names in _FIGURES:
        name = next((name for name in names if getattr(calibration, name).value is not None), names[0])
        entry, shown = getattr(calibration, name), PARAMETER_LABELS[name]
        rows.append((shown.label, format_estimate(entry), shown.unit, interval_text(entry) or entry.reason_id))
        if (part := calibration.pixel_nonuniformity.get(name)) is not None:
            within = f"{shown.label} within readout channels"
            rows.append((within, format_estimate(part), shown.unit, interval_text(part) or part.reason_id))
    parts = [heading, table(rows, "<<<<")]
    if calibration.chip is not None:
        counts = (f"{kind} {count}" for kind, count in calibration.chip.defects.counts().items() if count)
        parts.append(f"defective pixels: {', '.join(counts) or 'none'}")
    if calibration.amplifiers:
        parts.append(_amplifiers(calibration))
    if isinstance(gains := calibration.pixel_gains, PixelGains):
        parts.append(
            f"gains of the pixels: spread {format_estimate(gains.spread_percent)} %, a pixel's standard uncertainty "
            f"{gains.uncertainty_percent:.2g} % from {gains.frames} flat fields of {gains.levels} levels"
        )
    return parts


def _amplifiers(calibration: Calibration) -> str:
    """Return the table of the amplifiers."""
    shown = ("system_gain_dn_per_e", "read_noise_e", "black_level_dn")
    labels = [parameter_label(name) for name in shown]
    rows: list[Sequence[str]] = [("amplifier", *(f"{one.label}, {one.unit}" for one in labels))]
    for name, each in calibration.amplifiers.items():
        entries = (getattr(each.parameters, parameter) for parameter in shown)
        rows.append((name, *(format_estimate(e) if e.value is not None else e.reason_id for e in entries)))
    return table(rows, "<<<<")


def _parameters(calibration: Calibration) -> str:
    rows = [("parameter", "value", "unit", "95 % interval", "name", "method")]
    for name, entry in calibration.estimates().items():
        if entry.value is not None:
            shown, value = PARAMETER_LABELS[name], format_estimate(entry)
            rows.append((shown.label, value, shown.unit, interval_text(entry), name, entry.method))
    return table(rows, "<<<<<<")


def _effects(calibration: Calibration) -> list[str]:
    """Return the table of what effects have beside the parameters, where they were looked for."""
    rows = [
        _row(label, unit, found.estimates[key])
        for name, effect in effects().items()
        if effect.labels and isinstance(found := calibration.findings.get(name), Finding)
        for key, (label, unit) in effect.labels.items()
        if key in found.estimates
    ]
    head = "effect", "value", "unit", "95 % interval", "method or reason"
    return [table([head, *rows], "<<<<<")] if rows else []


def _row(label: str, unit: str, entry: Estimate) -> tuple[str, ...]:
    return label, format_estimate(entry), unit, interval_text(entry), entry.reason or entry.method


def _chip(calibration: Calibration) -> list[str]:
    """Return the tables of noise, defects and bands, where maps were measured."""
    chip, temporal = calibration.chip, calibration.temporal
    if chip is None or temporal is None:
        return []
    bands: list[Sequence[str]] = [("bands", "cycles per pixel", "amplitude, DN")]
    for name, found in temporal.bands.items():
        for band in found:
            amplitude = format_uncertain(band.amplitude_dn, band.standard_uncertainty_dn)
            bands.append((name, f"{band.cycles_per_pixel:.4f}", amplitude))
    size = (calibration.rows, calibration.cols)
    tables = ((_noise(temporal, calibration.pixel_gains), "<<<<<"), (_defects(chip, size), "<><"), (bands, "<><"))
    return [table(rows, align) for rows, align in tables if len(rows) > 1]


def _noise(temporal: TemporalNoise, gains: PixelGains | Missing | None) -> list[Sequence[str]]:
    shape = temporal.shape
    spread = {("gains of the pixels, spread", "%"): gains.spread_percent} if isinstance(gains, PixelGains) else {}
    entries = {
        ("pixel noise", "DN"): temporal.pixel_noise_dn,
        ("row noise", "DN"): temporal.row_noise_dn,
        ("column noise", "DN"): temporal.column_noise_dn,
        ("frame noise", "DN"): temporal.frame_noise_dn,
        ("read noise, log spread", "1"): temporal.read_noise_log_spread,
        ("read noise, steady pixels", "DN"): temporal.steady_noise_dn,
        ("blinking pixels, fraction", "1"): temporal.blinking_fraction,
        ("  mean amplitude", "DN"): temporal.blinking_amplitude_dn,
        ("excess kurtosis", "1"): shape.excess_kurtosis,
        ("  within pixels", "1"): shape.within_pixels,
        ("  between pixels", "1"): shape.between_pixels,
        (f"Tukey lambda ({NORMAL_SHAPE:.4f}: normal)", "1"): shape.tukey_lambda,
        **spread,
    }
    known = (_row(label, unit, entry) for (label, unit), entry in entries.items() if entry.value is not None)
    return [("dark temporal noise", "value", "unit", "95 % interval", "method"), *known]


def _defects(chip: MeasuredChip, size: tuple[int, int]) -> list[Sequence[str]]:
    rows: list[Sequence[str]] = [("defective pixels", "number", "shapes")]
    for kind, count in chip.defects.counts().items():
        found = chip.defects.of(DefectKind[kind.upper()])
        rows.append((kind, str(count), shapes_text(group_defects(found.row, found.col, size)) if count else ""))
    return rows


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.5g}" if isinstance(value, float) else str(value)


def _series(series: GainSeries) -> list[str]:
    from photosite.report.gain_series import SERIES_PARAMETERS, switch_sentence, unity_sentence  # needs matplotlib

    labels = [parameter_label(name) for name in SERIES_PARAMETERS]
    rows = [("setting", *(f"{shown.label}, {shown.unit}" for shown in labels))]
    for step in series.steps:
        values = [format_estimate(getattr(step.calibration, name)) for name in SERIES_PARAMETERS]
        rows.append((f"{step.setting:g}", *values))
    noise = [("settings", "noise before the amplifier, e⁻", "after it, DN", "chi square", "degrees of freedom")]
    for mode in series.modes:
        noise.append(
            (
                f"{mode.settings[0]:g} to {mode.settings[-1]:g}",
                format_estimate(mode.pre_amplifier_noise_e),
                format_estimate(mode.post_amplifier_noise_dn),
                "" if mode.chi_square is None else f"{mode.chi_square:.3g}",
                "" if mode.degrees_of_freedom is None else str(mode.degrees_of_freedom),
            )
        )
    frames = sum(step.calibration.frame_count for step in series.steps)
    return [
        f"{series.source}: {frames} frames at {len(series.steps)} gain settings ({series.scale})",
        table(rows, ">" * len(rows[0])),
        table(noise, "<>>>>"),
        f"{switch_sentence(series)}\n{unity_sentence(series)}",
    ]
