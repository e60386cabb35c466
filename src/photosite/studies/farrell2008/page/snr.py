"""Figure 6 on the page: which noise source limits the signal-to-noise ratio of the two sensors."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.report.figures.sensor import draw_noise_budget
from photosite.report.numbers import format_number
from photosite.report.page import Column, Listing, Paragraph, Table
from photosite.report.style import BLACK, GRAY, styled
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.snr import PAPER_D200_AT_SWING_DB, PARTS, SensorSnr, SnrChapter
from photosite.values.measured import COVERAGE_95


def snr_part(chapter: SnrChapter) -> Part:
    """Return Figure 6, the table at full swing, and the ranges of the noise sources."""
    return (
        Drawing.of(
            "figure6-snr",
            snr_figure(chapter),
            "Signal-to-noise ratio against volts, total and by noise source, of the D200 and the vendor sensor",
            "Figure 6: signal-to-noise ratio of one frame of a uniform surface, from Table 1. Each line except the "
            "total is that of one noise source alone. Circles are uniform fields of the virtual cameras, with 95 % "
            "intervals, most of them smaller than the circle.",
        ),
        _table(chapter),
        Listing(tuple(line for sensor in chapter.sensors.values() for line in _words(sensor))),
        Paragraph(_difference_in_words(chapter)),
    )


@styled()
def snr_figure(chapter: SnrChapter) -> Figure:
    """Draw the noise budgets of both sensors (Figure 6)."""
    figure = Figure(figsize=(8.6, 4.7))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, sensor in zip(panels, chapter.sensors.values(), strict=True):
        draw_noise_budget(axes, sensor.curves)
        _draw_fields(axes, sensor)
        _mark_limit(axes, sensor.curves.prnu_limited_above_volts, "PRNU dominates above {} V →", 83.0)
        _mark_limit(axes, sensor.curves.dark_limited_below_volts, "← read noise and DSNU\ndominate below {} V", 72.0)
        axes.set_title(f"{sensor.case.title}, {sensor.swing_v:g} V swing", loc="left")
    panels[0].set_ylim(min(axes.get_ylim()[0] for axes in panels), 88.0)
    panels[1].set_ylabel("")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles) // 2)
    return figure


def _draw_fields(axes: Axes, sensor: SensorSnr) -> None:
    fields = sensor.fields
    axes.errorbar(
        fields.volts,
        fields.snr_db,
        COVERAGE_95 * fields.standard_error_db,
        fmt="o",
        color=BLACK,
        markerfacecolor="white",
        markersize=5.0,
        elinewidth=1.0,
        label="uniform fields, virtual camera",
    )


def _mark_limit(axes: Axes, volts: float, text: str, height_db: float) -> None:
    axes.axvline(volts, color=GRAY, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.annotate(
        text.format(format_number(volts, 3)),
        (volts, height_db),
        xytext=(-5, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        color=GRAY,
        fontsize=9,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )


def _table(chapter: SnrChapter) -> Table:
    names = ("total", *PARTS)
    rows = []
    for name in names:
        paper = PAPER_D200_AT_SWING_DB[name]
        here = [float(getattr(sensor.at_swing, f"{name}_db")) for sensor in chapter.sensors.values()]
        rows.append((PARTS.get(name, "total"), f"{paper:.2f}", *(f"{value:.2f}" for value in here)))
    return Table(
        "Signal-to-noise ratio at full swing, dB",
        (
            Column("Noise"),
            Column("D200, 2008 paper", numeric=True),
            *(Column(f"{sensor.case.title}, here", numeric=True) for sensor in chapter.sensors.values()),
        ),
        tuple(rows),
    )


def _words(sensor: SensorSnr) -> tuple[str, ...]:
    budget, title = sensor.curves, sensor.case.title
    floor, prnu = (format_number(v, 3) for v in (budget.dark_limited_below_volts, budget.prnu_limited_above_volts))
    ranges = ", then ".join(
        f"{PARTS[part.noise]} from {format_number(part.from_volts, 3)} to {format_number(part.to_volts, 3)} V"
        for part in sensor.dominant
    )
    shot = "" if any(part.noise == "shot" for part in sensor.dominant) else " Shot noise is never the largest."
    return (
        f"{title}: below {floor} V, read noise and DSNU together exceed shot noise and PRNU; above {prnu} V, PRNU "
        "exceeds all others together.",
        f"{title}: the largest single noise source is {ranges}.{shot}",
        f"{title}: the uniform fields differ from the formula by at most {sensor.fields.largest_deviation:.1f} "
        f"standard errors over {sensor.fields.volts.size} levels.",
    )


def _difference_in_words(chapter: SnrChapter) -> str:
    largest = max(abs(value) for value in chapter.from_paper_db.values())
    return (
        f"At full swing the five curves of the D200 differ from those of the paper by at most {largest:.3f} dB, which "
        "is rounding: both are Table 1 in the formula of the paper’s footnote, SNR = 10 log10(S² / N) in electrons, "
        "not a measurement. The paper states that read noise and DSNU dominate dim signals; the voltages above "
        "quantify it. The vendor curves assume a conversion gain of 100 µV/e⁻ and a swing of 1 V, which are "
        "confidential in the paper."
    )
