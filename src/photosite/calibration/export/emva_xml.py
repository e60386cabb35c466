"""EMVA 1288 results as XML, in the format of the reference implementation.

The structure is `results / section / figure`; a figure has `short`, `symbol`, `unit` and `value`. Names, symbols and
units are those of the reference implementation (github.com/EMVA1288/emva1288, `Results1288.xml`). Its reader needs a
number or "None" for every value and ignores other elements. Uncertainties are in such elements: `standard_uncertainty`,
`interval_95`, `upper_limit_95`, `method`, and `reason` where the value is None. The section `photosite` contains every
parameter of the calibration, and `photosite_R` and so on those of the color channels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from typing import NamedTuple
from xml.etree import ElementTree

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters
from photosite.calibration.result import Calibration
from photosite.files.atomic import atomic_path
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Value, derive

EMVA_XML_LOSS = (
    "not in the file: curves, spectrograms, histograms, covariance between parameters, "
    "warnings, rejected frames, hashes"
)

_UNFILTERED = "without the high-pass filter, as in the reference implementation"


@dataclass(frozen=True)
class _Results:
    """Input of the figures."""

    estimates: dict[str, Estimate]
    area_um2: float | None

    def __getitem__(self, name: str) -> Value:
        return self.estimates[name].uncertain

    def per_area(self, value: Value) -> Value:
        area = self.area_um2
        return Missing("the pixel size is unknown") if area is None else derive(lambda v: v * (1.0 / area), value)


class _Figure(NamedTuple):
    name: str
    short: str
    symbol: str
    unit: str
    source: str | Callable[[_Results], Value]
    """A parameter, whose method and upper limit the figure has, or a function that derives the value."""


def _in_dn(parameter_e: str) -> Callable[[_Results], Value]:
    return lambda r: derive(lambda electrons, gain: electrons * gain, r[parameter_e], r[_GAIN])


def _dark_noise_dn(r: _Results) -> Value:
    """Return the temporal dark noise including rounding, as measured in the frames."""
    noise = derive(lambda s, k: s * k, r["temporal_dark_noise_e"], r["system_gain_dn_per_e"])
    return derive(lambda s: (s * s + QUANTISATION_DN2).sqrt(), noise)


def _range(r: _Results) -> Value:
    return derive(
        lambda db: db.apply(lambda x: 10.0 ** (x / 20.0), lambda x: math.log(10.0) / 20.0 * 10.0 ** (x / 20.0)),
        r["dynamic_range_db"],
    )


def _threshold_e(r: _Results) -> Value:
    return derive(lambda capacity, ratio: capacity / ratio, r["saturation_capacity_e"], _range(r))


def _snr(r: _Results) -> Value:
    return derive(lambda e: e.sqrt(), r["saturation_capacity_e"])


_GAIN, _CAPACITY, _CAPACITY_P = "system_gain_dn_per_e", "saturation_capacity_e", "saturation_capacity_photons"
_THRESHOLD, _QE = "sensitivity_threshold_photons", "quantum_efficiency_percent"
_DARK_MEAN, _DARK_VARIANCE = "dark_current_e_per_s", "dark_current_from_variance_e_per_s"
_PER_AREA_P, _PER_AREA_E = r"$p/\mu m^2$", r"$e^-/\mu m^2$"
_SATURATION, _LIMIT = "Saturation Capacity", "Sensitivity threshold"


def _parts(name: str, short: str, unit: str, prefix: str, suffix: str) -> tuple[_Figure, ...]:
    """Return a nonuniformity with its row, column and pixel parts."""
    return tuple(
        _Figure(f"{name}{tail}", f"{short}{part}", f"${short}_{{1288{dot}}}$", unit, f"{prefix}{own}_{suffix}")
        for tail, part, dot, own in (
            ("", "", "", ""),
            ("_row", "row", ".row", "_row"),
            ("_col", "col", ".col", "_column"),
            ("_pixel", "pixel", ".pixel", "_pixel"),
        )
    )


# fmt: off
FIGURES: dict[str, tuple[_Figure, ...]] = {
    "dark_current": (
        _Figure("u_I_mean", "Dark Current from mean", r"$\mu_{I.mean}$", "$e^-/s$", _DARK_MEAN),
        _Figure("u_I_mean_DN", "Dark Current from mean", r"$\mu_{I.mean.DN}$", "$DN/s$", _in_dn(_DARK_MEAN)),
        _Figure("u_I_var", "Dark Current from variance", r"$\mu_{I.var}$", "$e^-/s$", _DARK_VARIANCE),
        _Figure("u_I_var_DN", "Dark Current from variance", r"$\mu_{I.var.DN}$", "$DN/s$", _in_dn(_DARK_VARIANCE)),
    ),
    "linearity": (
        _Figure("LE_min", "Min Linearity error", "$LE_{min}$", r"\%", "linearity_error_min_percent"),
        _Figure("LE_max", "Max Linearity error", "$LE_{max}$", r"\%", "linearity_error_max_percent"),
    ),
    "sensitivity": (
        _Figure("R", "Responsivity", "R", "DN/p", "responsivity_dn_per_photon"),
        _Figure("K", "System gain", "K", "$DN/e^-$", _GAIN),
        _Figure("inverse_K", "Inverse of overall system gain", "1/K", "$e^-/DN$",
                lambda r: derive(lambda k: 1.0 / k, r[_GAIN])),
        _Figure("QE", "Quantum efficiency", r"$\eta$", r"\%", _QE),
        _Figure("sigma_y_dark", "Temporal Dark Noise", r"$\sigma_{y.dark}$", "DN", _dark_noise_dn),
        _Figure("sigma_d", "Temporal Dark Noise", r"$\sigma_d$", "$e^-$", "temporal_dark_noise_e"),
        _Figure("u_p_min", "Absolute sensitivity threshold", r"$\mu_{p.min}$", "$p$", _THRESHOLD),
        _Figure("u_p_min_area", _LIMIT, r"$\mu_{p.min.area}$", _PER_AREA_P, lambda r: r.per_area(r[_THRESHOLD])),
        _Figure("u_e_min", _LIMIT, r"$\mu_{e.min}$", "$e^-$", _threshold_e),
        _Figure("u_e_min_area", _LIMIT, r"$\mu_{e.min.area}$", _PER_AREA_E, lambda r: r.per_area(_threshold_e(r))),
        _Figure("u_p_sat", _SATURATION, r"$\mu_{p.sat}$", "$p$", _CAPACITY_P),
        _Figure("u_p_sat_area", _SATURATION, r"$\mu_{p.sat.area}$", _PER_AREA_P, lambda r: r.per_area(r[_CAPACITY_P])),
        _Figure("u_e_sat", _SATURATION, r"$\mu_{e.sat}$", "$e^-$", _CAPACITY),
        _Figure("u_e_sat_area", _SATURATION, r"$\mu_{e.sat.area}$", _PER_AREA_E, lambda r: r.per_area(r[_CAPACITY])),
        _Figure("SNR_max", "Signal-to-Noise Ratio", "$SNR_{max}$", "", _snr),
        _Figure("SNR_max_dB", "Maximum Signal to Noise Ratio in Db", "$SNR_{max.dB}$", "dB", "snr_max_db"),
        _Figure("SNR_max_bit", "Maximum Signal to Noise Ratio in Bits", "$SNR_{max.bit}$", "bit",
                lambda r: derive(lambda s: s.decibel(1.0 / math.log10(2.0)), _snr(r))),
        _Figure("inverse_SNR_max", "Inverse Maximum Signal to Noise Ratio", "$SNR_{max}^{-1}$", r"\%",
                lambda r: derive(lambda s: 100.0 / s, _snr(r))),
        _Figure("DR", "Dynamic Range", "DR", "", _range),
        _Figure("DR_dB", "Dynamic Range", "$DR_{dB}$", "dB", "dynamic_range_db"),
    ),
    "spatial": (
        *_parts("DSNU1288", "DSNU", "$e^-$", "dsnu1288", "e"),
        _Figure("DSNU1288_DN", "DSNU in DN", "$DSNU_{1288.DN}$", "DN", _in_dn("dsnu1288_e")),
        *_parts("PRNU1288", "PRNU", r"\%", "prnu1288_unfiltered", "percent"),
    ),
}
"""Figures of the reference implementation, by section."""
# fmt: on


def write_emva_results(calibration: Calibration, path: str | PathLike[str]) -> None:
    """Write a calibration as EMVA 1288 results XML. The pixel area is that of its base sensor.

    PRNU1288 and its parts are those without the high-pass filter, as in the reference implementation. The standard's
    own values, with the filter, are in the section `photosite`.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(emva_results(calibration))


def emva_results(calibration: Calibration) -> bytes:
    """Return the XML that `write_emva_results` writes."""
    base = calibration.base
    area = None if base is None else base.pixel_area_m2 * 1e12
    results = _Results(calibration.estimates(), area)
    root = ElementTree.Element(
        "results",
        written_by="photosite",
        standard="EMVA 1288 R4.0",
        source=calibration.source,
        frames=str(calibration.frame_count),
        note=EMVA_XML_LOSS,
    )
    for name, figures in FIGURES.items():
        section = ElementTree.SubElement(root, name)
        for figure in figures:
            if isinstance(figure.source, str):
                entry = results.estimates[figure.source]
                note = _UNFILTERED if "unfiltered" in figure.source else ""
            else:
                entry, note = Estimate.of(figure.source(results), "derived from the other figures"), ""
            _add(section, figure.name, (figure.short, figure.symbol, figure.unit), entry, note)
    _add_parameters(ElementTree.SubElement(root, "photosite"), calibration)
    for channel, parameters in calibration.channels.items():
        _add_parameters(ElementTree.SubElement(root, f"photosite_{channel}"), parameters)
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


def _add_parameters(section: ElementTree.Element, parameters: Parameters) -> None:
    for name, entry in parameters.estimates().items():
        shown = PARAMETER_LABELS[name]
        _add(section, name, (shown.label, "", shown.unit), entry)


def _add(section: ElementTree.Element, name: str, head: tuple[str, str, str], entry: Estimate, note: str = "") -> None:
    short, symbol, unit = head
    parts = {"section": section.tag, "short": short, "symbol": symbol, "unit": unit}
    parts["value"] = str(None) if entry.value is None else repr(float(entry.value))
    if entry.value is not None and entry.standard_uncertainty is not None:
        parts["standard_uncertainty"] = repr(float(entry.standard_uncertainty))
        parts["interval_95"] = " ".join(repr(float(end)) for end in entry.interval_95 or ())
    if entry.upper_limit_95 is not None:
        parts["upper_limit_95"] = repr(float(entry.upper_limit_95))
    parts["method"] = "; ".join(text for text in (entry.method, note) if text)
    parts["reason"] = (entry.reason or "") if entry.value is None else ""
    figure = ElementTree.SubElement(section, name)
    for tag, text in parts.items():
        if text:
            ElementTree.SubElement(figure, tag).text = text
