"""EMVA 1288 results as XML, in the format of the reference implementation.

The structure is `results / section / figure`; a figure has `short`, `symbol`, `unit` and `value`. Names, symbols and
units are those of the reference implementation (github.com/EMVA1288/emva1288, `Results1288.xml`). Its reader needs a
number or "None" for every value and ignores other elements. Uncertainties are in such elements: `standard_uncertainty`,
`interval_95`, `upper_limit_95`, `method`, and `reason` where the value is None. The figures are the
standard's own, by its straight lines (`Calibration.emva1288`). The section `photosite` contains every parameter of the
calibration, and `photosite_R` and so on those of the color channels.
"""

from __future__ import annotations

from os import PathLike
from typing import NamedTuple
from xml.etree import ElementTree

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters
from photosite.calibration.result import Calibration
from photosite.files.writing import atomic_path
from photosite.values.estimate import Estimate

EMVA_XML_LOSS = (
    "not in the file: curves, spectrograms, histograms, covariance between parameters, "
    "warnings, rejected frames, hashes"
)

_UNFILTERED = "without the high-pass filter, as in the reference implementation"


class _Figure(NamedTuple):
    name: str
    short: str
    symbol: str
    unit: str
    key: str
    """Symbol in `EMVA1288`."""


_PER_AREA_P, _PER_AREA_E = r"$p/\mu m^2$", r"$e^-/\mu m^2$"
_SATURATION, _LIMIT = "Saturation Capacity", "Sensitivity threshold"


def _parts(name: str, short: str, unit: str, key: str) -> tuple[_Figure, ...]:
    """Return a nonuniformity with its row, column and pixel parts."""
    return tuple(
        _Figure(f"{name}{tail}", f"{short}{tail[1:]}", f"${short}_{{1288{dot}}}$", unit, f"{key}{tail}")
        for tail, dot in (("", ""), ("_row", ".row"), ("_col", ".col"), ("_pixel", ".pixel"))
    )


# fmt: off
FIGURES: dict[str, tuple[_Figure, ...]] = {
    "dark_current": (
        _Figure("u_I_mean", "Dark Current from mean", r"$\mu_{I.mean}$", "$e^-/s$", "mu_I_mean"),
        _Figure("u_I_mean_DN", "Dark Current from mean", r"$\mu_{I.mean.DN}$", "$DN/s$", "mu_I_mean_DN"),
        _Figure("u_I_var", "Dark Current from variance", r"$\mu_{I.var}$", "$e^-/s$", "mu_I_var"),
        _Figure("u_I_var_DN", "Dark Current from variance", r"$\mu_{I.var.DN}$", "$DN/s$", "mu_I_var_DN"),
    ),
    "linearity": (
        _Figure("LE_min", "Min Linearity error", "$LE_{min}$", r"\%", "LE_min"),
        _Figure("LE_max", "Max Linearity error", "$LE_{max}$", r"\%", "LE_max"),
    ),
    "sensitivity": (
        _Figure("R", "Responsivity", "R", "DN/p", "R"),
        _Figure("K", "System gain", "K", "$DN/e^-$", "K"),
        _Figure("inverse_K", "Inverse of overall system gain", "1/K", "$e^-/DN$", "inverse_K"),
        _Figure("QE", "Quantum efficiency", r"$\eta$", r"\%", "eta"),
        _Figure("sigma_y_dark", "Temporal Dark Noise", r"$\sigma_{y.dark}$", "DN", "sigma_y_dark"),
        _Figure("sigma_d", "Temporal Dark Noise", r"$\sigma_d$", "$e^-$", "sigma_d"),
        _Figure("u_p_min", "Absolute sensitivity threshold", r"$\mu_{p.min}$", "$p$", "mu_p_min"),
        _Figure("u_p_min_area", _LIMIT, r"$\mu_{p.min.area}$", _PER_AREA_P, "mu_p_min_area"),
        _Figure("u_e_min", _LIMIT, r"$\mu_{e.min}$", "$e^-$", "mu_e_min"),
        _Figure("u_e_min_area", _LIMIT, r"$\mu_{e.min.area}$", _PER_AREA_E, "mu_e_min_area"),
        _Figure("u_p_sat", _SATURATION, r"$\mu_{p.sat}$", "$p$", "mu_p_sat"),
        _Figure("u_p_sat_area", _SATURATION, r"$\mu_{p.sat.area}$", _PER_AREA_P, "mu_p_sat_area"),
        _Figure("u_e_sat", _SATURATION, r"$\mu_{e.sat}$", "$e^-$", "mu_e_sat"),
        _Figure("u_e_sat_area", _SATURATION, r"$\mu_{e.sat.area}$", _PER_AREA_E, "mu_e_sat_area"),
        _Figure("SNR_max", "Signal-to-Noise Ratio", "$SNR_{max}$", "", "SNR_max"),
        _Figure("SNR_max_dB", "Maximum Signal to Noise Ratio in Db", "$SNR_{max.dB}$", "dB", "SNR_max_dB"),
        _Figure("SNR_max_bit", "Maximum Signal to Noise Ratio in Bits", "$SNR_{max.bit}$", "bit", "SNR_max_bit"),
        _Figure("inverse_SNR_max", "Inverse Maximum Signal to Noise Ratio", "$SNR_{max}^{-1}$", r"\%",
                "inverse_SNR_max"),
        _Figure("DR", "Dynamic Range", "DR", "", "DR"),
        _Figure("DR_dB", "Dynamic Range", "$DR_{dB}$", "dB", "DR_dB"),
    ),
    "spatial": (
        *_parts("DSNU1288", "DSNU", "$e^-$", "DSNU1288"),
        _Figure("DSNU1288_DN", "DSNU in DN", "$DSNU_{1288.DN}$", "DN", "DSNU1288_DN"),
        *_parts("PRNU1288", "PRNU", r"\%", "PRNU1288_unfiltered"),
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
    found = calibration.emva1288
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
            note = _UNFILTERED if "unfiltered" in figure.key else ""
            _add(section, figure.name, (figure.short, figure.symbol, figure.unit), found[figure.key], note)
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
    parts["value"] = str(None) if entry.value is None else repr(float(entry.shown_value or 0.0))
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
