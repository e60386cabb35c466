"""The 2008 paper's view of a calibration: its Table 1 with the measured values, and its noise budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from photosite.calibration.result import Calibration
from photosite.report.figures.sensor import noise_budget_figure, spectral_sensitivity_figure
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Block, Paragraph, Table, columns, figure_block, numeric
from photosite.report.tables import format_estimate, interval_text
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Measured


@dataclass(frozen=True)
class _Row:
    """A row of Table 1: label, unit, value in a sensor file, and the parameter that measures it."""

    label: str
    unit: str
    known: Callable[[Sensor], Measured | float | None]
    parameter: str | None = None


def _electrons(sensor: Sensor, noise: Measured) -> float | None:
    """Return a noise in electrons; None if the noise or the conversion gain is only assumed."""
    if noise.assumed or sensor.pixel.conversion_gain_uv_per_e.assumed:
        return None
    return float(sensor.electrons(noise.value))


def _electrons_per_dn(sensor: Sensor) -> float | None:
    return None if sensor.pixel.conversion_gain_uv_per_e.assumed else 1.0 / sensor.system_gain_dn_per_e


_TABLE_1 = (
    _Row("Pixel width", "µm", lambda s: s.pixel.width_um),
    _Row("Pixel height", "µm", lambda s: s.pixel.height_um),
    _Row("Fill factor", "1", lambda s: s.pixel.fill_factor),
    _Row("Dark voltage", "mV/s", lambda s: s.noise.dark_voltage_mv_per_s, "dark_voltage_mv_per_s"),
    _Row("Read noise", "mV", lambda s: s.noise.read_noise_mv, "read_noise_mv"),
    _Row("Read noise", "e⁻", lambda s: _electrons(s, s.noise.read_noise_mv), "read_noise_e"),
    _Row("Conversion gain", "µV/e⁻", lambda s: s.pixel.conversion_gain_uv_per_e, "conversion_gain_uv_per_e"),
    _Row("Voltage swing", "V", lambda s: s.pixel.voltage_swing_v),
    _Row("Well capacity", "e⁻", lambda s: s.pixel.well_capacity_e, "well_capacity_e"),
    _Row("DSNU", "mV", lambda s: s.noise.dsnu_mv, "dsnu_mv"),
    _Row("DSNU", "e⁻", lambda s: _electrons(s, s.noise.dsnu_mv), "dsnu_e"),
    _Row("PRNU", "%", lambda s: s.noise.prnu_percent, "prnu_percent"),
    _Row("Analog gain, as system gain", "e⁻/DN", _electrons_per_dn, "system_gain_dn_per_e"),
    _Row("Quantization", "bit", lambda s: float(s.readout.bits)),
)
"""Farrell, Okincha and Parmar (2008), Table 1, sensor and pixel.

Its analog gain of 7.98 is in electrons per DN. Its noise is in millivolts; the table here adds electrons, which do not
depend on the conversion gain.
"""


def paper_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return Table 1, the measured noise budget and the spectral response of the base sensor, if there is one."""
    form = Paragraph(
        "The parameters in the form of Table 1 of Farrell, Okincha and Parmar, “Sensor calibration and simulation”, "
        "Proc. SPIE 6817 (2008), as needed to simulate the sensor. The last column is the camera of the paper, for "
        "comparison. DSNU and PRNU are standard deviations over all pixels, without the high-pass filter of EMVA 1288."
    )
    no_base = Paragraph(
        "Noise budget and spectral response are not shown: they need voltage swing and quantum efficiency, from a "
        "sensor file given for the calibration."
    )
    figures = (no_base,) if calibration.base is None else _figures(calibration, calibration.base)
    return form, table_1(calibration), *figures


def table_1(calibration: Calibration) -> Table:
    """Return Table 1 of the paper with the measured values."""
    paper, base = load_sensor("nikon-d200"), calibration.base
    estimates = calibration.estimates() | {"well_capacity_e": calibration.well_capacity}
    rows = []
    for line in _TABLE_1:
        entry = None if line.parameter is None else estimates[line.parameter]
        if line.unit == "e⁻/DN" and entry is not None:
            entry = _inverse(entry)
        measured = "not measurable" if entry is None else format_estimate(entry)
        if line.unit == "bit":
            measured = f"{calibration.bits}"
        known = () if base is None else (_known(line.known(base)),)
        interval = "" if entry is None else interval_text(entry)
        if entry is not None and line.parameter == "well_capacity_e":
            interval = interval or entry.reason or ""
        rows.append((line.label, line.unit, measured, interval, *known, _known(line.known(paper))))
    sides = ["Nikon D200, 2008 paper"] if base is None else ["Sensor file", "Nikon D200, 2008 paper"]
    titles = columns("Parameter", "Unit", numeric("Measured"), "95 % interval", *map(numeric, sides))
    return Table("Table 1 of the 2008 paper, ± standard uncertainty", titles, tuple(rows))


def _inverse(entry: Estimate) -> Estimate:
    """Return 1 / value to first order, with inverted interval ends."""
    if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
        return entry
    low, high = entry.interval_95
    ends = (1.0 / high, 1.0 / low) if low > 0.0 else None
    return Estimate(1.0 / entry.value, entry.standard_uncertainty / entry.value**2, interval_95=ends)


def _known(value: Measured | float | None) -> str:
    """Format a value of a sensor file; a dash for assumed values."""
    if value is None or (isinstance(value, Measured) and value.assumed):
        return "–"
    if isinstance(value, Measured):
        return format_uncertain(value.value, value.standard_uncertainty)
    return format_number(value, 4) if value % 1 else f"{value:.0f}"


def _figures(calibration: Calibration, base: Sensor) -> tuple[Block, ...]:
    needed = ("read_noise_mv", "dsnu_mv", "prnu_percent")
    budget: Block
    if lacking := [name for name in needed if not (getattr(calibration, name).value or 0.0) > 0.0]:
        reason = getattr(calibration, lacking[0]).reason or "its variance is not above zero"
        budget = Paragraph(f"The noise budget is not shown, because {lacking[0]} is missing: {reason}.")
    else:
        budget = figure_block(
            noise_budget_figure(calibration.sensor),
            "Signal-to-noise ratio against signal, total and by cause",
            "Signal-to-noise ratio of one frame of a uniform surface, from the measured read noise, DSNU and PRNU "
            "(Farrell, Okincha and Parmar 2008, Figure 6). Each line except the total shows one noise source alone.",
        )
    sensitivity = figure_block(
        spectral_sensitivity_figure(base),
        "Quantum efficiency against wavelength",
        "Quantum efficiency from the sensor file; dark frames and flat fields of one light do not measure it.",
    )
    return budget, sensitivity
