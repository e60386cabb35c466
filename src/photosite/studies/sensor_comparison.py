"""Sensors behind the same lens: signal-to-noise ratio against luminance, SNR10 and dynamic range."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.metrics.registry import axis_label
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.page import Page, Paragraph, Section, Table, columns, figure_block, numeric
from photosite.report.pages import page
from photosite.report.style import BLACK, GRAY, line_style, new_figure, styled
from photosite.sensor.combined_noise import CombinedNoise, Transition
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import NoiseTerms
from photosite.studies.gray_surface import (
    electron_rates,
    light_capacity_e,
    sensitivity_threshold_e,
    total_variance_e2,
    transitions,
)
from photosite.studies.simulated_charts import brief_columns, compared_quality, quality_cells, quality_to_dict
from photosite.values.estimate import Estimate
from photosite.values.exposure import check_exposure, format_exposure
from photosite.values.shown import Cell, Reported, ResultTable, Tabular, cell_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

SNR10_DB = 20.0
GRAY_REFLECTANCE = 0.18
"""Of the gray chart whose illuminance SNR10 is."""
SWITCHES = "captures_switch_cd_m2"
"""Column of the luminances at which a combined frame changes to the next capture."""
_POINTS = 200
_LOWEST_DB = -10.0
_FOCAL_LENGTH_MM = 50.0  # of no effect: the surface is far away


@dataclass(frozen=True, eq=False)
class SensorFacts(Tabular):
    """One sensor under the conditions of a comparison.

    Parameters
    ----------
    sensor
        The sensor.
    channel
        The channel with the largest signal, which all ratios are of.
    electrons_per_cd_m2
        Electrons in the exposure time from a surface of 1 cd/m2.
    exposure_s
        Exposure time.
    """

    sensor: Sensor
    channel: str
    electrons_per_cd_m2: float
    exposure_s: float

    @property
    def saturation_cd_m2(self) -> float:
        """Luminance at which the pixel saturates."""
        return light_capacity_e(self.sensor, self.exposure_s) / self.electrons_per_cd_m2

    def snr_db(self, luminance_cd_m2: Array) -> Array:
        """Return the ratio of signal to total noise over the pixels of a frame, in dB; NaN above saturation."""
        signal = luminance_cd_m2 * self.electrons_per_cd_m2
        ratio = 20.0 * np.log10(signal / np.sqrt(total_variance_e2(self.sensor, signal, self.exposure_s)))
        return np.where(luminance_cd_m2 <= self.saturation_cd_m2 * (1 + 1e-9), ratio, np.nan)

    @property
    def snr10_cd_m2(self) -> float | None:
        """Lowest luminance at which the ratio is 10; None if the pixel saturates or PRNU limits the ratio before."""
        if self.sensor.captures is not None:
            signal = CombinedNoise(self.sensor, self.exposure_s).signal_at_snr_e(SNR10_DB)
        else:
            dark_e2 = float(total_variance_e2(self.sensor, 0.0, self.exposure_s))
            terms = NoiseTerms(self.sensor)
            signal = terms.signal_at_snr_e(SNR10_DB, other_e2=dark_e2 - float(terms.floor_e2()))
        if signal is None:
            return None
        luminance = signal / self.electrons_per_cd_m2
        return luminance if luminance <= self.saturation_cd_m2 else None

    @property
    def snr10_lux(self) -> float | None:
        """Illuminance on an 18 % gray chart at which the ratio is 10."""
        return None if self.snr10_cd_m2 is None else self.snr10_cd_m2 * math.pi / GRAY_REFLECTANCE

    @property
    def snr_max_db(self) -> float:
        """The ratio at saturation; of several captures, the highest ratio of the combined frame."""
        if self.sensor.captures is not None:
            return CombinedNoise(self.sensor, self.exposure_s).snr_max_db
        return float(self.snr_db(np.array([self.saturation_cd_m2]))[0])

    @property
    def dynamic_range_db(self) -> float:
        """Signal at saturation over that at which a pixel's ratio over time is 1 (EMVA 1288 R4.0), in dB."""
        threshold_e = sensitivity_threshold_e(self.sensor, self.exposure_s)
        return 20.0 * math.log10(light_capacity_e(self.sensor, self.exposure_s) / threshold_e)

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """The transitions between captures, from the dark to the bright; none for a single capture."""
        return transitions(self.sensor, self.exposure_s)

    @property
    def switches_cd_m2(self) -> tuple[float, ...]:
        """Luminances at the middle of the transitions between captures."""
        return tuple(each.light_e / self.electrons_per_cd_m2 for each in self.transitions)

    def to_dict(self) -> dict[str, Cell]:
        """Return the numbers of the table."""
        sensor = self.sensor
        capacity_e = sensor.saturation_capacity_e if sensor.captures is None else light_capacity_e(sensor, 0.0)
        peak = max(float(sensor.response(name)[1].max()) for name in sensor.channel_names)
        return {
            "name": sensor.name,
            "channel": self.channel,
            "pixel_width_um": sensor.pixel.width_um.value,
            "quantum_efficiency_peak_percent": 100.0 * peak,
            "electrons_per_cd_m2": self.electrons_per_cd_m2,
            "saturation_capacity_e": capacity_e,
            "read_noise_e": sensor.electrons(sensor.noise.read_noise_mv.value),
            "dynamic_range_db": self.dynamic_range_db,
            "snr_max_db": self.snr_max_db,
            "snr10_cd_m2": self.snr10_cd_m2,
            "snr10_lux": self.snr10_lux,
            "saturation_cd_m2": self.saturation_cd_m2,
            SWITCHES: ", ".join(f"{each:.4g}" for each in self.switches_cd_m2) or "one capture",
        }

    def _table(self) -> ResultTable:
        return ResultTable(f"Sensor '{self.sensor.name}'", ("figure", "value"), list(self.to_dict().items()))


@dataclass(frozen=True, eq=False)
class SensorComparison(Reported, Tabular):
    """Result of `compare_sensors`.

    Parameters
    ----------
    sensors
        By label.
    luminance_cd_m2
        (points,) of the curves, from a ratio of about -10 dB to the highest saturation.
    f_number, exposure_s, illuminant
        The conditions.
    quality
        Values of image quality of simulated charts, by label and name.
    """

    sensors: Mapping[str, SensorFacts]
    luminance_cd_m2: Array
    f_number: float
    exposure_s: float
    illuminant: str
    quality: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)

    def facts(self) -> dict[str, dict[str, Cell]]:
        """Return the numbers of each sensor, and its image quality."""
        cells = {label: quality_cells(each) for label, each in self.quality.items()}
        return {label: each.to_dict() | cells.get(label, {}) for label, each in self.sensors.items()}

    @property
    def quality_names(self) -> tuple[str, ...]:
        """Names of the values of image quality."""
        return tuple(next(iter(self.quality.values()), {}))

    @property
    def conditions(self) -> str:
        """The conditions in words."""
        return f"f/{self.f_number:g}, {format_exposure(self.exposure_s)} s, illuminant {self.illuminant}"

    def snr_db(self) -> dict[str, Array]:
        """Return the curves (points,) by label, NaN above saturation."""
        return {label: facts.snr_db(self.luminance_cd_m2) for label, facts in self.sensors.items()}

    def to_dict(self) -> dict[str, Any]:
        """Return conditions, figures and curves as plain values; None above saturation."""
        curves = {label: [x if math.isfinite(x) else None for x in y.tolist()] for label, y in self.snr_db().items()}
        return {
            "f_number": self.f_number,
            "exposure_s": self.exposure_s,
            "illuminant": self.illuminant,
            "sensors": self.facts(),
            "quality": quality_to_dict(self.quality),
            "transitions": transitions_to_dict(self.sensors),
            "luminance_cd_m2": self.luminance_cd_m2.tolist(),
            "snr_db": curves,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the ratios against luminance on Matplotlib axes, new ones by default, and return them."""
        from photosite.report.plots import new_or_given

        axes = new_or_given(ax)
        draw_snr(axes, self.sensors, self.luminance_cd_m2)
        return axes

    def _table(self) -> ResultTable:
        facts = self.facts()
        names = (*_TITLES, *quality_cells(next(iter(self.quality.values()), {})))
        rows = [(label, *(each[name] for name in names)) for label, each in facts.items()]
        return ResultTable(f"Sensors at {self.conditions}", ("sensor", *names), rows)

    def _brief_table(self) -> ResultTable:
        brief = ["pixel_width_um", "saturation_capacity_e", "read_noise_e", "dynamic_range_db", "snr10_lux"]
        if any(facts.transitions for facts in self.sensors.values()):
            brief.append(SWITCHES)
        return self._table().only(("sensor", *brief, *brief_columns(self.quality)))


def transitions_to_dict(sensors: Mapping[str, SensorFacts]) -> dict[str, list[dict[str, Any]]]:
    """Return the transitions between captures by label, with their luminance."""
    return {
        label: [
            each._asdict() | {"luminance_cd_m2": at}
            for each, at in zip(facts.transitions, facts.switches_cd_m2, strict=True)
        ]
        for label, facts in sensors.items()
    }


def compare_sensors(
    sensors: Mapping[str, Sensor],
    *,
    f_number: float = 2.8,
    exposure_s: float = 1 / 15,
    illuminant: str | float = "3200K",
    values: Sequence[str] = (),
    on_progress: Callable[[str], None] | None = None,
) -> SensorComparison:
    """Compare sensors behind the same lens, each by the channel with the largest signal.

    Parameters
    ----------
    sensors
        By label.
    f_number, exposure_s, illuminant
        The common conditions: f-number of a lens without losses, exposure time, light on an even, distant surface.
    values
        Names of image quality, such as "edge-sfr.mtf50.G", as for `photosite.studies.simulated_charts.image_quality`:
        of charts in the same light, exposed to just below saturation.
    on_progress
        Called with what is measured of image quality.

    Raises
    ------
    InputError
        If there are no sensors, or a condition is invalid.

    Notes
    -----
    The ratio is that of one pixel of the raw frame, before demosaicing and color correction, with the whole noise of a
    frame: photons, dark current, read noise, rounding, DSNU and PRNU. Values that makers call SNR10 often include a
    color correction, which lowers the ratio. Sensors with several captures are judged by their combined frame, in
    electrons of a photodiode of relative sensitivity and exposure 1; read noise is that of the first capture.

    Examples
    --------
    >>> import photosite as ps
    >>> names = "vendor-2.2um", "vendor-1.4um"
    >>> found = ps.studies.compare_sensors({name: ps.load_sensor(name) for name in names})
    >>> [round(facts.snr10_lux, 1) for facts in found.sensors.values()]
    [310.9, 767.8]
    """
    if not sensors:
        raise InputError("sensors", value=sensors, expected="at least one sensor by its label")
    time_s = check_exposure(exposure_s)
    lens = DiffractionLimited(f_number=f_number, focal_length_mm=_FOCAL_LENGTH_MM)
    facts = {
        label: sensor_facts(Camera(lens, sensor), time_s, illuminant, f"sensor '{label}'")
        for label, sensor in sensors.items()
    }
    quality = compared_quality(
        {label: Camera(lens, sensor) for label, sensor in sensors.items()},
        values,
        on_progress,
        illuminant=illuminant,
    )
    return SensorComparison(facts, luminance_grid(facts), float(f_number), time_s, f"{illuminant}", quality)


def luminance_grid(facts: Mapping[str, SensorFacts]) -> Array:
    """Return luminances in cd/m2 of curves: from a ratio of about -10 dB to the highest saturation."""
    dark_e = {label: math.sqrt(float(total_variance_e2(f.sensor, 0.0, f.exposure_s))) for label, f in facts.items()}
    lowest = min(0.3 * dark_e[label] / f.electrons_per_cd_m2 for label, f in facts.items())
    return np.geomspace(lowest, max(f.saturation_cd_m2 for f in facts.values()), _POINTS)


def sensor_facts(camera: Camera, time_s: float, illuminant: str | float, name: str) -> SensorFacts:
    """Return the facts of a sensor behind its own lens; errors have the name."""
    rates = electron_rates(camera, illuminant)
    best = int(rates.argmax())
    if not rates[best] > 0:
        raise InputError("illuminant", value=illuminant, expected=f"light that {name} responds to")
    if not light_capacity_e(camera.sensor, time_s) > 0:
        expected = f"short enough that the dark current does not saturate {name}"
        raise InputError("exposure_s", value=time_s, expected=expected)
    return SensorFacts(camera.sensor, camera.sensor.channel_names[best], float(rates[best]) * time_s, time_s)


def sensor_figures(
    camera: Camera, *, exposure_s: float = 1 / 15, illuminant: str | float = "3200K"
) -> dict[str, float]:
    """Return the figures of a sensor behind its lens as in `compare_sensors`, for `sweep`.

    Examples
    --------
    >>> import photosite as ps
    >>> lens = ps.DiffractionLimited(f_number=2.8, focal_length_mm=4)
    >>> figures = sensor_figures(ps.Camera(lens, ps.load_sensor("vendor-2.2um")))
    >>> round(figures["snr10_lux"], 1), round(figures["dynamic_range_db"], 1)
    (310.9, 46.1)
    """
    facts = sensor_facts(camera, check_exposure(exposure_s), illuminant, "the sensor")
    found: dict[str, Any] = facts.to_dict()
    switches = {f"switch_{number}_cd_m2": at for number, at in enumerate(facts.switches_cd_m2, start=1)}
    return {name: math.nan if (value := found[name]) is None else value for name in _FIGURES} | switches


_FIGURES = (
    "electrons_per_cd_m2",
    "saturation_capacity_e",
    "dynamic_range_db",
    "snr_max_db",
    "snr10_cd_m2",
    "snr10_lux",
    "saturation_cd_m2",
)
"""Those of the figures that are numbers and no fields of the sensor."""


_TITLES = {
    "channel": "Channel",
    "pixel_width_um": "Pixel (µm)",
    "quantum_efficiency_peak_percent": "Peak QE (%)",
    "electrons_per_cd_m2": "Signal (e⁻ per cd/m²)",
    "saturation_capacity_e": "Saturation capacity (e⁻)",
    "read_noise_e": "Read noise (e⁻)",
    "dynamic_range_db": "Dynamic range (dB)",
    "snr_max_db": "Highest SNR (dB)",
    "snr10_cd_m2": "SNR10 (cd/m²)",
    "snr10_lux": "SNR10 (lux)",
    "saturation_cd_m2": "Saturates at (cd/m²)",
    SWITCHES: "Captures switch at (cd/m²)",
}


@page.register(SensorComparison)
def comparison_page(found: SensorComparison) -> Page:
    """Return the comparison as a page."""
    several = any(facts.transitions for facts in found.sensors.values())
    rows = tuple(
        (title, *(_text(facts.to_dict()[name]) for facts in found.sensors.values()))
        for name, title in _TITLES.items()
        if several or name != SWITCHES
    )
    rows += tuple(
        (axis_label(name), *(_interval_text(each[name]) for each in found.quality.values()))
        for name in found.quality_names
    )
    table = Table(f"At {found.conditions}, without losses in the lens", columns("", *map(numeric, found.sensors)), rows)
    figure = figure_block(
        comparison_figure(found),
        "Signal-to-noise ratio of each sensor against the luminance of an even surface",
        "Ratio of signal to total noise of one pixel. Curves end at saturation; points mark SNR10, a ratio of 10.",
    )
    sections = (
        Section("Signal-to-noise ratio", (figure,)),
        Section("Figures", (table,)),
        Section("Definitions", tuple(Paragraph(text) for text in _WORDS)),
    )
    names = ", ".join(found.sensors)
    lead = f"The same even surface seen through the same lens: {found.conditions}."
    note = "Computed from the sensor files; no frames were simulated."
    if found.quality:
        note = "Computed from the sensor files, and from simulated charts: values of image quality with 95 % intervals."
    return Page(f"Comparison of {names}", lead, sections, note)


_WORDS = (
    "The ratio is that of one pixel of the raw frame, of the channel with the largest signal, before demosaicing and "
    "color correction. The noise is that over the pixels of one frame: photons, dark current, read noise, rounding, "
    "DSNU, dark current nonuniformity and PRNU.",
    "SNR10 is the luminance of the surface at which the ratio is 10 (20 dB), and the illuminance on an 18 % gray chart "
    "of that luminance, E = π L / 0.18. Makers who include a color correction report larger values.",
    "The dynamic range is that of EMVA 1288 R4.0: the signal at saturation over the signal at which the temporal ratio "
    "is 1. The dark current takes its share of the saturation capacity. Signals assume a lens without losses.",
    "Several captures of one exposure are judged by the frame that they combine to, in electrons of a photodiode of "
    "relative sensitivity and exposure 1. It dips where the frame changes to a capture with fewer electrons or more "
    "read noise; dotted lines mark the switches. SNR10 is the lowest luminance with that ratio.",
    "A sensor without an infrared-cut filter also collects near-infrared light, which luminance does not count: under "
    "tungsten light it has more signal at the same luminance.",
    "Pixels of different sizes see different areas of the picture. Over the same area of the chip, the ratio of a "
    "pixel of width w rises by 20 log10(W / w) dB when it is averaged to a width W.",
)


def _text(value: Cell) -> str:
    if value is None:
        return "not reached"
    return cell_text(value)


def _interval_text(estimate: Estimate) -> str:
    """Return a value with its 95 % interval, or why it is missing."""
    if estimate.value is None:
        return f"missing: {estimate.reason}"
    ends = estimate.interval_95
    return cell_text(estimate.shown_value) + ("" if ends is None else f" ({' to '.join(map(cell_text, ends))})")


@styled()
def comparison_figure(found: SensorComparison) -> Figure:
    """Draw the ratios against luminance."""
    figure, axes = new_figure(height_in=4.6)
    draw_snr(axes, found.sensors, found.luminance_cd_m2)
    return figure


@styled()
def draw_snr(axes: Axes, sensors: Mapping[str, SensorFacts], luminance_cd_m2: Array) -> None:
    """Draw the ratios against luminance, with a point at SNR10."""
    for position, (label, facts) in enumerate(sensors.items()):
        color, marker, line = line_style(position)
        inside = luminance_cd_m2 < facts.saturation_cd_m2
        x = np.append(luminance_cd_m2[inside], facts.saturation_cd_m2)
        axes.plot(x, facts.snr_db(x), line, color=color, label=label)
        if facts.snr10_cd_m2 is not None:
            axes.plot([facts.snr10_cd_m2], [SNR10_DB], marker, color=color)
        for at in facts.switches_cd_m2:
            axes.axvline(at, color=color, linewidth=0.8, linestyle=":")
    axes.axhline(SNR10_DB, color=GRAY, linewidth=0.8, linestyle=":")
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set(xscale="log", xlabel="luminance (cd/m²)", ylabel="signal-to-noise ratio (dB)")
    axes.set_ylim(bottom=_LOWEST_DB)
    axes.legend(loc="upper left")
