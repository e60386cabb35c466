"""The 2008 paper's view of a calibration: its Table 1 with the measured values beside, and its noise budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from photosite.calibration.export.measured_sensor import well_capacity
from photosite.calibration.result import Calibration
from photosite.report.blocks import figure_block
from photosite.report.figures.noise_budget import noise_budget_figure
from photosite.report.figures.spectral_sensitivity import spectral_sensitivity_figure
from photosite.report.html import Block, Column, Paragraph, Table
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.tables import format_estimate, interval_text
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.measured import Measured

PAPER_SENSOR = "nikon-d200"
"""The preset that holds the paper's Table 1."""


@dataclass(frozen=True)
class _Row:
    """A line of Table 1: what it is called, how a sensor file has it, and which parameter measures it."""

    label: str
    unit: str
    known: Callable[[Sensor], Measured | float | None]
    parameter: str | None = None


def _electrons(sensor: Sensor, noise: Measured) -> float | None:
    """A noise in electrons, unless it or what volts are worth is assumed."""
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
    _Row("Quantisation", "bit", lambda s: float(s.readout.bits)),
)
"""Farrell, Okincha and Parmar (2008), Table 1, sensor and pixel. Its analog gain of 7.98 is electrons per number; its
noise stands in millivolts there, and here in electrons too, which need no knowledge of the pixel's volts."""


def paper_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Table 1, the noise budget of the sensor as measured, and its spectral response as known beforehand.

    Parameters
    ----------
    calibration
        What `calibrate` gave. Without a sensor known beforehand there are no millivolts, and the figures are left out
        for a reason that is given.
    """
    blocks: list[Block] = [
        Paragraph(
            "The figures in the form of Table 1 of Farrell, Okincha and Parmar, “Sensor calibration and simulation”, "
            "Proc. SPIE 6817 (2008): what a simulation of the sensor needs. The last column is the paper's own camera, "
            "for comparison. Here DSNU and PRNU are plain spreads over all pixels, without the standard's high-pass."
        ),
        table_1(calibration),
    ]
    if calibration.base is None:
        return (
            *blocks,
            Paragraph(
                "There is no noise budget in volts and no spectral response: both need what frames do not tell, the "
                "pixel's voltage swing and quantum efficiency, from a sensor file given beforehand."
            ),
        )
    return (*blocks, *_figures(calibration, calibration.base))


def table_1(calibration: Calibration) -> Table:
    """Table 1 of the paper with the measured values beside."""
    paper, base = load_sensor(PAPER_SENSOR), calibration.base
    estimates = calibration.estimates() | {"well_capacity_e": well_capacity(calibration)}
    rows = []
    for line in _TABLE_1:
        entry = None if line.parameter is None else estimates[line.parameter]
        if line.unit == "e⁻/DN" and entry is not None:
            entry = _inverse(entry)
        measured = "frames do not tell" if entry is None else format_estimate(entry)
        if line.unit == "bit":
            measured = f"{calibration.bits}"
        known = () if base is None else (_known(line.known(base)),)
        interval = "" if entry is None else interval_text(entry)
        if entry is not None and line.parameter == "well_capacity_e":
            interval = interval or entry.reason or ""
        rows.append((line.label, line.unit, measured, interval, *known, _known(line.known(paper))))
    beforehand = () if base is None else (Column("Known beforehand", numeric=True),)
    columns = (
        Column("Parameter"),
        Column("Unit"),
        Column("Measured here", numeric=True),
        Column("95 % interval"),
        *beforehand,
        Column("Nikon D200, 2008 paper", numeric=True),
    )
    return Table("Table 1 of the 2008 paper, ± one standard uncertainty", columns, tuple(rows))


def _inverse(entry: Estimate) -> Estimate:
    """1 / value, to first order; the ends of the interval are those of the value turned over."""
    if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
        return entry
    low, high = entry.interval_95
    ends = (1.0 / high, 1.0 / low) if low > 0.0 else None
    return Estimate(1.0 / entry.value, entry.standard_uncertainty / entry.value**2, interval_95=ends)


def _known(value: Measured | float | None) -> str:
    """What a sensor file says; nothing where it only assumes."""
    if value is None or (isinstance(value, Measured) and value.assumed):
        return "–"
    if isinstance(value, Measured):
        return format_uncertain(value.value, value.standard_uncertainty)
    return format_number(value, 4) if value % 1 else f"{value:.0f}"


def _figures(calibration: Calibration, base: Sensor) -> tuple[Block, ...]:
    blocks: list[Block] = []
    needed = ("read_noise_mv", "dsnu_mv", "prnu_percent")
    if lacking := [name for name in needed if not (getattr(calibration, name).value or 0.0) > 0.0]:
        reason = getattr(calibration, lacking[0]).reason or "its variance came out not above zero"
        blocks.append(Paragraph(f"There is no noise budget: it needs {lacking[0]}, which is missing; {reason}."))
    else:
        blocks.append(
            figure_block(
                noise_budget_figure(calibration.sensor),
                "Signal-to-noise ratio against signal, total and by cause",
                "Signal-to-noise ratio of one frame of an even surface, from the measured read noise, DSNU and PRNU "
                "(Farrell, Okincha and Parmar 2008, Figure 6). Each line but the total's is that of one noise alone.",
            )
        )
    blocks.append(
        figure_block(
            spectral_sensitivity_figure(base),
            "Quantum efficiency against wavelength",
            "Quantum efficiency as known beforehand; darkness and flat light of one colour do not measure it.",
        )
    )
    return tuple(blocks)
