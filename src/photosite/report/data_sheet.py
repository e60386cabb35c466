"""The summary sheet of EMVA 1288: sensor, operating point, light and the standard's parameters."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.parameters import PARAMETER_LABELS, parameter_label
from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.result import Calibration
from photosite.report.numbers import format_number, format_time
from photosite.report.page import Block, Heading, Paragraph, Table, columns, numeric
from photosite.report.tables import format_estimate, interval_text
from photosite.values.cfa import tile_text

_MODELS = {
    "linear": "EMVA 1288 R4.0 Linear, photon transfer",
    "general": "EMVA 1288 R4.0 General, because the photons are unknown: no quantum efficiency; parameters that need "
    "no photons follow R4.0 Linear",
}

_PAIRS = columns("Property", "Value")
_PARTS = {"row": "row", "column": "col", "pixel": "pixel"}


def _with_parts(name: str, unit: str, symbol: str) -> dict[str, str]:
    """Return a nonuniformity and its row, column and pixel parts."""
    parts = {f"{name}_{part}_{unit}": f"{symbol}.{end}" for part, end in _PARTS.items()}
    return {f"{name}_{unit}": symbol, **parts}


SHEET: dict[str, dict[str, str]] = {
    "Sensitivity": {
        "quantum_efficiency_percent": "η",
        "responsivity_dn_per_photon": "R = K η",
        "system_gain_dn_per_e": "K",
    },
    "Temporal noise and range": {
        "temporal_dark_noise_e": "σd",
        "snr_max_db": "SNRmax",
        "sensitivity_threshold_photons": "μp.min",
        "saturation_capacity_photons": "μp.sat",
        "saturation_capacity_e": "μe.sat",
        "dynamic_range_db": "DR",
    },
    "Linearity": {
        "linearity_error_percent": "LE",
        "linearity_error_min_percent": "LEmin",
        "linearity_error_max_percent": "LEmax",
        "linearity_error_full_scale_percent": "LE, R3.0",
    },
    "Nonuniformity": _with_parts("dsnu1288", "e", "DSNU1288") | _with_parts("prnu1288", "percent", "PRNU1288"),
    "Nonuniformity with the other filter setting: high-pass filter on for DSNU, off for PRNU": (
        _with_parts("dsnu1288_filtered", "e", "DSNU1288")
        | _with_parts("prnu1288_unfiltered", "percent", "PRNU1288")
        | {"prnu1288_unfiltered_percent": "PRNU1288, R3.1"}
    ),
    "Dark signal": {
        "dark_current_e_per_s": "μI.mean",
        "dark_current_from_variance_e_per_s": "μI.var",
        "black_level_dn": "μy.dark",
    },
}
"""Parameters and their symbols in the standard, by heading of the summary sheet."""


def data_sheet_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return tables of the sensor, the operating point, the light and the standard's parameters.

    References
    ----------
    EMVA 1288 R4.0 Linear, summary sheet of an operating point.
    """
    tables = _sensor_table(calibration), _operating_table(calibration), _parameter_table(calibration)
    if not calibration.response_curve:
        return tables
    gain = format_estimate(calibration.system_gain_dn_per_e)
    text = (
        "The response bends. The table of EMVA 1288 follows straight lines, as the standard defines them. The gain at "
        f"small signal is {gain} DN/e⁻: all other tables and the sensor file follow from it and the response curve."
    )
    return *tables, Paragraph(text)


def _sensor_table(calibration: Calibration) -> Table:
    base, tile = calibration.base, tile_text(calibration.cfa)
    rows = [
        ("Camera or sensor", "not stated" if base is None else base.name),
        ("Measurement", calibration.source),
        ("Size", f"{calibration.rows} × {calibration.cols} pixels (rows × columns)"),
        ("Converter", f"{calibration.bits} bits"),
        ("Color filter array", "monochrome" if tile == "M" else tile),
    ]
    if base is not None:
        pixel = base.pixel
        size = f"{pixel.width_um.value:g} × {pixel.height_um.value:g} µm"
        rows += [
            ("Pixel", f"{size}, fill factor {pixel.fill_factor.value:g}"),
            ("From the sensor file", "pixel, voltage swing, analog gain and spectral response"),
        ]
    rows += [("Frames used", str(calibration.frame_count)), ("Frames rejected", str(len(calibration.rejected)))]
    return Table("Sensor and measurement", _PAIRS, tuple(rows))


def _operating_table(calibration: Calibration) -> Table:
    """Return gain setting, exposure times, levels, light and model."""
    gain, temperature = calibration.gain_setting, calibration.temperature_c
    rows = [
        ("Gain setting", "not stated" if gain is None else f"{gain:g}"),
        ("Temperature of the sensor", "not stated" if temperature is None else _range(*temperature)),
    ]
    if (dark := _first(calibration, "dark_signal")) is not None:
        rows.append(("Dark frames", _exposures(dark.x)))
    else:
        rows.append(("Dark frames", "none, or their level is unknown"))
    if calibration.light_unknown:
        levels = max(found.levels_measured for found in calibration.linear_range.values())
        rows.append(("Light", f"{levels} levels of unknown light"))
    elif (response := _first(calibration, "response")) is None:
        rows.append(("Light", "none; all frames are dark frames"))
    else:
        light = f"{len(response.x)} level{'s' * (len(response.x) != 1)}"
        if response.x_label.startswith("photons"):
            ends = " to ".join(format_number(float(x), 4) for x in (response.x.min(), response.x.max()))
            light += f", {ends} photons per pixel, as stated by the measurement"
        else:
            light += f" from {_exposures(response.x)}; the photons are unknown"
        rows += [
            ("Light", light),
            ("Wavelength", "not stated by frames or protocol"),
            ("Model", _MODELS[calibration.model]),
        ]
    return Table("Operating point and light", _PAIRS, tuple(rows))


def _range(low: float, high: float) -> str:
    return f"{low:.1f} °C" if high - low < 0.05 else f"{low:.1f} to {high:.1f} °C"


def _first(calibration: Calibration, kind: str) -> Curve | None:
    """Return a kind of curve, from the first channel that has it."""
    return next((found[kind] for found in calibration.curves.values() if kind in found), None)


def _exposures(exposure_s: NDArray[np.float64]) -> str:
    shortest, longest = (format_time(float(t)) for t in (exposure_s.min(), exposure_s.max()))
    count = len(exposure_s)
    return f"one exposure time, {shortest}" if count == 1 else f"{count} exposure times, {shortest} to {longest}"


def _parameter_table(calibration: Calibration) -> Table:
    """Return the standard's figures, by its straight lines; the table of all parameters says why others are missing."""
    listed = {name for names in SHEET.values() for name in names}
    others = {
        name: "" for name, shown in PARAMETER_LABELS.items() if shown.topic.startswith("EMVA") and name not in listed
    }
    rows: list[tuple[str, ...] | Heading] = []
    for heading, names in (SHEET | {"Other parameters of the standard": others}).items():
        found = [_row(calibration, name, symbol) for name, symbol in names.items()]
        if any(found):
            rows += [Heading(heading), *filter(None, found)]
    titles = columns("Parameter", "Symbol", numeric("Value"), "Unit", "95 % interval", "In other units")
    together = ", all channels combined" if calibration.channels else ""
    lines = ", by the standard's straight lines" if calibration.response_curve else ""
    return Table(f"Parameters of EMVA 1288 R4.0{lines}{together}, ± standard uncertainty", titles, tuple(rows))


def _row(calibration: Calibration, name: str, symbol: str) -> tuple[str, ...] | None:
    """Return a parameter by the standard's lines with its interval; None if it was not estimated."""
    shown, entry = parameter_label(name), getattr(calibration.by_line, name)
    if entry.value is None:
        return None
    others = _OTHER_UNITS[name](calibration, entry.value) if name in _OTHER_UNITS else ""
    straight = ", straight line" if calibration.response_curve and name == "system_gain_dn_per_e" else ""
    return shown.label + straight, symbol, format_estimate(entry), shown.unit, interval_text(entry), others


def _levels(calibration: Calibration, decibel: float) -> str:
    """Return a ratio of amplitudes as a number and in bits."""
    ratio = 10.0 ** (decibel / 20.0)
    return f"{format_number(ratio, 4)} : 1, {format_number(math.log2(ratio), 3)} bit"


def _per_area(calibration: Calibration, count: float) -> str:
    if calibration.base is None:
        return ""
    pixel = calibration.base.pixel
    return f"{format_number(count / (pixel.width_um.value * pixel.height_um.value), 4)} per µm²"


def _in_dn(calibration: Calibration, electrons: float) -> str:
    gain = calibration.by_line.system_gain_dn_per_e.value
    return "" if gain is None else f"{format_number(gain * electrons, 4)} DN"


def _inverse(calibration: Calibration, gain: float) -> str:
    return f"1 / K = {format_number(1.0 / gain, 4)} e⁻/DN"


_OTHER_UNITS: dict[str, Callable[[Calibration, float], str]] = {
    "system_gain_dn_per_e": _inverse,
    "temporal_dark_noise_e": _in_dn,
    "dsnu1288_e": _in_dn,
    "dark_current_e_per_s": lambda calibration, rate: _in_dn(calibration, rate).replace("DN", "DN/s"),
    "snr_max_db": _levels,
    "dynamic_range_db": _levels,
    "sensitivity_threshold_photons": _per_area,
    "saturation_capacity_photons": _per_area,
    "saturation_capacity_e": _per_area,
}
