"""Figure 6: signal-to-noise ratio against the signal in volts, in total and by noise source, for both sensors of Table
1.

The curves follow from Table 1. Uniform fields of the measured cameras verify the formula.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.metrics.snr import NoiseBudget, noise_budget
from photosite.report.figures.sensor import draw_noise_budget
from photosite.report.numbers import format_number
from photosite.report.page import Column, Listing, Table
from photosite.report.style import BLACK, GRAY, styled
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import CASES, Case, MeasuredCamera, frame_key
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, paragraph, text
from photosite.values.region import Region
from photosite.values.uncertain import COVERAGE_95

PARTS = MappingProxyType({"shot": "shot noise", "read": "read noise", "dsnu": "DSNU", "prnu": "PRNU"})
"""Noise sources: name of the curve in `NoiseBudget`, and label."""

PAPER_D200_AT_SWING_DB = MappingProxyType({"total": 38.10, "shot": 45.56, "read": 66.35, "dsnu": 65.86, "prnu": 38.97})
"""Curves of the D200 at its full swing of 1.08 V, as in the paper."""

FIELD_PIXELS = 256
"""Rows and columns of the uniform fields: 32768 green pixels give a standard deviation to 0.4 %, 0.034 dB."""

FIELDS = 9
_LOWEST_SHARE, _LOWEST_FIELD_SHARE, _HIGHEST_FIELD_SHARE = 5e-4, 2e-3, 0.8
"""Relative to the voltage swing: start of the curves, and range of the fields, which stay below saturation."""
_CURVE_POINTS = 300


def in_db(budget: NoiseBudget) -> dict[str, NDArray[np.float64]]:
    """Return the curves of a noise budget: "total" and the keys of `PARTS`."""
    return {name: getattr(budget, f"{name}_db") for name in ("total", *PARTS)}


@dataclass(frozen=True)
class NoiseRange:
    """A range of signals, within 0 and the voltage swing, in which one noise source (a key of `PARTS`) is largest."""

    noise: str
    from_volts: float
    to_volts: float


@dataclass(frozen=True, eq=False)
class UniformFields:
    """Uniform fields of a measured camera, one frame per level; arrays are (levels,).

    `volts` is the mean signal at the pixel as read, `snr_db` 20 log10 of the mean over the standard deviation over
    pixels, without the 1/12 DN^2 of rounding, and `expected_db` follows from the noise budget. All levels share one
    fixed pattern, so that their errors are correlated.
    """

    volts: NDArray[np.float64]
    snr_db: NDArray[np.float64]
    standard_error_db: NDArray[np.float64]
    expected_db: NDArray[np.float64]

    @property
    def largest_deviation(self) -> float:
        """Largest difference from the formula, in standard errors."""
        return float(np.abs((self.snr_db - self.expected_db) / self.standard_error_db).max())

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        arrays = {name: values.tolist() for name, values in asdict(self).items()}
        return {**arrays, "largest_deviation_in_standard_errors": self.largest_deviation}


@dataclass(frozen=True, eq=False)
class SensorSnr:
    """Figure 6 for one sensor: noise budgets from 0.05 % of the voltage swing to the swing and at the swing, the
    largest single noise source by range of signals, and uniform fields of a virtual chip."""

    case: Case
    swing_v: float
    curves: NoiseBudget
    at_swing: NoiseBudget
    dominant: tuple[NoiseRange, ...]
    fields: UniformFields

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`, with every tenth point of the curves."""
        return {
            "voltage_swing_v": self.swing_v,
            "at_swing_db": {name: float(value) for name, value in in_db(self.at_swing).items()},
            "read_noise_and_dsnu_dominate_below_volts": self.curves.dark_limited_below_volts,
            "prnu_dominates_above_volts": self.curves.prnu_limited_above_volts,
            "largest_noise": [asdict(part) for part in self.dominant],
            "curves": {
                "volts": self.curves.volts[::10].tolist(),
                **{f"{name}_db": curve[::10].tolist() for name, curve in in_db(self.curves).items()},
            },
            "uniform_fields_of_the_virtual_camera": self.fields.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class SnrChapter:
    """Figure 6 for both sensors, by key of the case."""

    sensors: MappingProxyType[str, SensorSnr]

    @property
    def from_paper_db(self) -> dict[str, float]:
        """Curves of the D200 at full swing minus those of the paper."""
        here = in_db(self.sensors["d200"].at_swing)
        return {name: float(here[name]) - paper for name, paper in PAPER_D200_AT_SWING_DB.items()}

    @property
    def _largest_from_paper_db(self) -> float:
        return max(abs(value) for value in self.from_paper_db.values())

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            **{key: sensor.to_dict() for key, sensor in self.sensors.items()},
            "d200_at_swing_less_paper_db": self.from_paper_db,
        }

    def part(self) -> Part:
        """Return Figure 6, the table at full swing, and the ranges of the noise sources."""
        return (
            Drawing.of("figure6-snr", snr_figure(self)),
            self._table(),
            Listing(tuple(line for sensor in self.sensors.values() for line in _words(sensor))),
            paragraph("snr_from_paper", largest=self._largest_from_paper_db),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the line of Figure 6."""
        d200 = self.sensors["d200"]
        return (
            (
                f"Figure 6, SNR of the {d200.case.title} at {d200.swing_v:g} V",
                f"{PAPER_D200_AT_SWING_DB['total']:.2f} dB in total",
                f"{float(d200.at_swing.total_db):.2f} dB in total",
                f"The five curves differ by at most {self._largest_from_paper_db:.3f} dB.",
            ),
        )

    def _table(self) -> Table:
        here = [in_db(sensor.at_swing) for sensor in self.sensors.values()]
        titles = ("D200, 2008 paper", *(f"{sensor.case.title}, here" for sensor in self.sensors.values()))
        return Table(
            "Signal-to-noise ratio at full swing, dB",
            (Column("Noise"), *(Column(title, numeric=True) for title in titles)),
            tuple(
                (PARTS.get(name, name), f"{paper:.2f}", *(f"{float(levels[name]):.2f}" for levels in here))
                for name, paper in PAPER_D200_AT_SWING_DB.items()
            ),
        )


def snr_against_volts(seed: int) -> SnrChapter:
    """Compute Figure 6 of the paper for both sensors, with the formula of `photosite.metrics.snr`, and measure uniform
    fields."""
    return SnrChapter(MappingProxyType({case.key: _sensor_snr(case, seed) for case in CASES}))


def _sensor_snr(case: Case, seed: int) -> SensorSnr:
    sensor = case.sensor()
    swing = sensor.pixel.voltage_swing_v.value
    curves = noise_budget(sensor, np.geomspace(_LOWEST_SHARE * swing, swing, _CURVE_POINTS))
    fields = _uniform_fields(case, sensor, seed)
    return SensorSnr(case, swing, curves, noise_budget(sensor, swing), dominant_noises(sensor), fields)


def dominant_noises(sensor: Sensor) -> tuple[NoiseRange, ...]:
    """Return the largest single noise source by range of signals, up to the voltage swing.

    Read noise and DSNU are constant, shot noise grows with the square root of the signal S, and PRNU with S: in
    electrons c, sqrt(S) and p S. The larger constant is exceeded by shot noise at S = c^2, and shot noise by PRNU at 1
    / p^2. If c p > 1, PRNU exceeds the constant at c / p and shot noise is never the largest.

    Examples
    --------
    >>> import photosite as ps
    >>> [(part.noise, round(part.to_volts, 3)) for part in dominant_noises(ps.load_sensor("vendor-2.2um"))]
    [('dsnu', 0.353), ('prnu', 1.0)]
    """
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    swing = sensor.pixel.voltage_swing_v.value
    read, dsnu = (sensor.electrons(value.value) for value in (sensor.noise.read_noise_mv, sensor.noise.dsnu_mv))
    constant, prnu = max(read, dsnu), sensor.noise.prnu_percent.value / 100.0
    prnu_from = math.inf if prnu == 0 else (1 / prnu**2 if constant * prnu <= 1 else constant / prnu)
    shot_from = min(constant**2, prnu_from)
    # A range that does not exist starts where the next one does.
    begins = ("read" if read > dsnu else "dsnu", 0.0), ("shot", v_per_e * shot_from), ("prnu", v_per_e * prnu_from)
    ends = (*(start for _, start in begins[1:]), swing)
    dominant = (
        NoiseRange(noise, start, min(end, swing))
        for (noise, start), end in zip(begins, ends, strict=True)
        if start < swing
    )
    return tuple(part for part in dominant if part.to_volts > part.from_volts)


def _uniform_fields(case: Case, nominal: Sensor, seed: int) -> UniformFields:
    """Expose uniform fields with the chip of the measured camera, without lens and lamp."""
    sensor = MeasuredCamera(case, seed).sensor(FIELD_PIXELS, FIELD_PIXELS)
    camera = Camera(case.lens, sensor)
    swing, v_per_dn = sensor.pixel.voltage_swing_v.value, sensor.mv_per_dn * 1e-3
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    everywhere = [Region("field", 0, FIELD_PIXELS, 0, FIELD_PIXELS)]
    rows = []
    for number, level in enumerate(np.geomspace(_LOWEST_FIELD_SHARE * swing, _HIGHEST_FIELD_SHARE * swing, FIELDS)):
        mean_e = np.full((FIELD_PIXELS, FIELD_PIXELS), level / v_per_e, np.float32)
        raw = camera.expose(mean_e, case.exposure_s, seed=frame_key(seed, f"even fields of {case.key}"), frame=number)
        mean_dn, snr_db, error_db = uniform_snr(patch_statistics(raw, everywhere), 0, "G")
        rows.append((mean_dn * v_per_dn, snr_db, error_db))
    volts, snrs_db, errors_db = np.array(rows).T
    return UniformFields(volts, snrs_db, errors_db, noise_budget(nominal, volts).total_db)


def uniform_snr(statistics: PatchStatistics, patch: int, channel: str) -> tuple[float, float, float]:
    """Return the signal-to-noise ratio of a uniform patch in one frame, as the noise budget defines it.

    The mean of the channel in the patch must be above black.

    Returns
    -------
    tuple of float
        Mean above black in DN; 20 log10 of the mean over the standard deviation over pixels, without the 1/12 DN^2 of
        rounding; its standard error in dB, to first order.
    """
    at = patch, statistics.channels.index(channel)
    mean = float(statistics.mean_dn[at])
    variance = float(statistics.spatial_noise_dn[at]) ** 2 - 1.0 / 12.0
    relative = math.hypot(
        float(statistics.standard_error_dn[at]) / mean,
        0.5 * float(statistics.spatial_variance_error_dn2[at]) / variance,
    )
    return mean, 10 * math.log10(mean**2 / variance), 20 / math.log(10) * relative


@styled()
def snr_figure(chapter: SnrChapter) -> Figure:
    """Draw the noise budgets of both sensors (Figure 6)."""
    figure = Figure(figsize=(8.6, 4.7))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, sensor in zip(panels, chapter.sensors.values(), strict=True):
        draw_noise_budget(axes, sensor.curves)
        axes.errorbar(
            sensor.fields.volts,
            sensor.fields.snr_db,
            COVERAGE_95 * sensor.fields.standard_error_db,
            fmt="o",
            color=BLACK,
            markerfacecolor="white",
            markersize=5.0,
            elinewidth=1.0,
            label="uniform fields, virtual camera",
        )
        _mark_limit(axes, sensor.curves.prnu_limited_above_volts, "PRNU dominates above {} V →", 83.0)
        _mark_limit(axes, sensor.curves.dark_limited_below_volts, "← read noise and DSNU\ndominate below {} V", 72.0)
        axes.set_title(f"{sensor.case.title}, {sensor.swing_v:g} V swing", loc="left")
    panels[0].set_ylim(min(axes.get_ylim()[0] for axes in panels), 88.0)
    panels[1].set_ylabel("")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles) // 2)
    return figure


def _mark_limit(axes: Axes, volts: float, label: str, height_db: float) -> None:
    axes.axvline(volts, color=GRAY, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.annotate(
        label.format(format_number(volts, 3)),
        (volts, height_db),
        xytext=(-5, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        color=GRAY,
        fontsize=9,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )


def _words(sensor: SensorSnr) -> tuple[str, ...]:
    budget, title = sensor.curves, sensor.case.title
    floor, prnu = (format_number(v, 3) for v in (budget.dark_limited_below_volts, budget.prnu_limited_above_volts))
    ranges = ", then ".join(
        f"{PARTS[part.noise]} from {format_number(part.from_volts, 3)} to {format_number(part.to_volts, 3)} V"
        for part in sensor.dominant
    )
    shot = "" if any(part.noise == "shot" for part in sensor.dominant) else " Shot noise is never the largest."
    fields = sensor.fields
    return (
        text("snr_limits", title=title, floor=floor, prnu=prnu),
        f"{title}: the largest single noise source is {ranges}.{shot}",
        text("snr_fields", title=title, largest=fields.largest_deviation, levels=fields.volts.size),
    )
