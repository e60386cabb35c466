"""Plots of values on Matplotlib axes, by type, as their `plot` methods return them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.calibration.dark.temperature import DarkTemperature
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.result import Calibration
from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.capture_snr import CaptureBudget
from photosite.metrics.measurement import Result
from photosite.metrics.snr import NoiseBudget
from photosite.optics.plot import LensBlur, cutoff_per_m, mtf, sampled_psf
from photosite.report.figures.captures import draw_captures_snr, draw_knees
from photosite.report.figures.measurement import draw_curves_of, draw_map, figures_of
from photosite.report.figures.response import draw_curves
from photosite.report.figures.sensor import draw_noise_budget, draw_spectral_sensitivity
from photosite.report.figures.validation import draw_identity, draw_patch_means
from photosite.report.style import BAND, BLUE, GRAY, line_style, styled
from photosite.scene.scene import Scene, thumbnail
from photosite.sensor.model import Sensor
from photosite.validation.result import Validation

_WIDEST_PX = 1200
"""Larger images are drawn from every n-th pixel."""
_FREQUENCIES = 200
"""Points of an MTF."""


@singledispatch
def draw(value: Any, ax: Axes | None = None, *options: Any) -> Axes:
    """Draw a value on Matplotlib axes, new ones for None, as its type registers."""
    raise TypeError(f"there is no plot of a {type(value).__name__}")


def new_or_given(ax: Axes | None) -> Axes:
    """Return the given axes, or those of a new figure of pyplot, which notebooks show."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    axes: Axes = pyplot.subplots()[1]
    return axes


@draw.register(Calibration)
@styled()
def _(calibration: Calibration, ax: Axes | None = None, kind: str = "photon_transfer") -> Axes:
    """Draw one kind of curve of all channels, with the fitted lines."""
    curves = {channel: found[kind] for channel, found in calibration.curves.items() if kind in found}
    if not curves:
        kinds = sorted({name for found in calibration.curves.values() for name in found})
        raise InputError(
            "kind", value=kind, expected=f"a curve of this calibration: {', '.join(kinds) or 'it has none'}"
        )
    axes = new_or_given(ax)
    handles = draw_curves(axes, curves)
    axes.legend(handles=handles)
    axes.set_title(next(iter(curves.values())).title)
    return axes


@draw.register(GainSeries)
@styled()
def _(series: GainSeries, ax: Axes | None = None, parameter: str = "read_noise_e") -> Axes:
    """Draw a parameter with 95 % intervals against the gain setting."""
    from photosite.calibration.parameters import parameter_label

    label = parameter_label(parameter)
    entries = [(step.setting, getattr(step.calibration, parameter)) for step in series.steps]
    known = [(setting, entry) for setting, entry in entries if entry.value is not None]
    axes = new_or_given(ax)
    values = np.array([entry.value for _, entry in known])
    ends = np.array([entry.interval_95 for _, entry in known]).reshape(-1, 2)
    bars = np.clip([values - ends[:, 0], ends[:, 1] - values], 0.0, None)
    axes.errorbar([setting for setting, _ in known], values, bars, fmt="o-", color=BLUE, elinewidth=0.9)
    axes.set(xlabel="gain setting", ylabel=f"{label.label} ({label.unit})")
    if series.scale == "proportional":
        axes.set_xscale("log")
        axes.set_xticks(series.settings, [f"{setting:g}" for setting in series.settings])
        axes.minorticks_off()
    return axes


@draw.register(DarkTemperature)
@styled()
def _(found: DarkTemperature, ax: Axes | None = None) -> Axes:
    """Draw the dark current against the temperature on a logarithmic axis, and the fit, with 95 % intervals."""
    axes = new_or_given(ax)
    celsius = np.array([one for one, _ in found.measured])
    ends = np.array([(entry.value, *(entry.interval_95 or ())) for _, entry in found.measured], float)
    bars = ends[:, 0] - ends[:, 1], ends[:, 2] - ends[:, 0]
    axes.errorbar(celsius, ends[:, 0], bars, fmt="o", color=BLUE, elinewidth=0.9, label="measured")
    grid = np.linspace(celsius.min(), celsius.max(), 101)
    fit = np.array([(found.at(one), *found.interval_95_at(one)) for one in grid])
    axes.plot(grid, fit[:, 0], color=BLUE, label="fit")
    axes.fill_between(grid, fit[:, 1], fit[:, 2], color=BLUE, alpha=BAND, linewidth=0)
    axes.set(xlabel="temperature (°C)", ylabel="dark current (DN/s)")
    axes.set_yscale("log", nonpositive="clip")
    if np.isfinite(fit).all():
        axes.set_ylim(0.5 * fit[:, 1].min(), 2.0 * max(fit[:, 2].max(), ends[:, 2].max()))
    axes.set_title("Dark current against temperature")
    axes.legend()
    return axes


@draw.register(Sensor)
@styled()
def _(sensor: Sensor, ax: Axes | None = None) -> Axes:
    """Draw the quantum efficiency of each channel."""
    axes = new_or_given(ax)
    draw_spectral_sensitivity(axes, sensor)
    axes.legend(title="channel")
    axes.set_title(sensor.name)
    return axes


@draw.register(NoiseBudget)
@styled()
def _(budget: NoiseBudget, ax: Axes | None = None) -> Axes:
    """Draw the signal-to-noise ratio against the signal, in total and by noise source."""
    axes = new_or_given(ax)
    draw_noise_budget(axes, budget)
    axes.legend()
    return axes


_LEAST_DIP_DB = 0.1


@draw.register(CombinedCalibration)
@styled()
def _(found: CombinedCalibration, ax: Axes | None = None) -> Axes:
    """Draw the photon transfer curve of combined frames with its knees."""
    axes = new_or_given(ax)
    draw_knees(axes, found)
    axes.legend()
    return axes


@draw.register(CaptureCalibration)
@styled()
def _(found: CaptureCalibration, ax: Axes | None = None) -> Axes:
    """Draw the signal-to-noise ratio of calibrated captures against the light."""
    axes = new_or_given(ax)
    draw_captures_snr(axes, found)
    axes.legend()
    return axes


@draw.register(CaptureBudget)
@styled()
def _(budget: CaptureBudget, ax: Axes | None = None, electrons_per_cd_m2: float | None = None) -> Axes:
    """Draw the signal-to-noise ratio against the light, of each capture and of their combination, with the dips."""
    axes = new_or_given(ax)
    scale = electrons_per_cd_m2 or 1.0
    light = budget.light_e / scale
    axes.plot(light, budget.combined_db, color=BLUE, linewidth=4.0, alpha=0.5, label="combined")
    for position, (name, level) in enumerate(budget.captures_db.items()):
        color, _, style = line_style(position + 1)
        axes.plot(light, level, color=color, linestyle=style, label=name)
    for step in budget.transitions:
        at = step.light_e / scale
        if light.min() < at < light.max() and step.before_db - step.after_db >= _LEAST_DIP_DB:
            axes.plot([at, at], [step.before_db, step.after_db], "o", color=GRAY, markersize=4.0)
            text = f"{step.before_db - step.after_db:.1f} dB"
            middle = (at, 0.5 * (step.before_db + step.after_db))
            axes.annotate(text, middle, xytext=(6, 0), textcoords="offset points", va="center", color=GRAY, fontsize=9)
    unit = "light (electrons of the most sensitive photodiode)" if electrons_per_cd_m2 is None else "luminance (cd/m²)"
    axes.set(xscale="log", xlabel=unit)
    axes.set(ylabel="signal-to-noise ratio (dB)")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return axes


@draw.register(Validation)
@styled()
def _(validation: Validation, ax: Axes | None = None) -> Axes:
    """Draw measured against simulated patch means."""
    axes = new_or_given(ax)
    draw_patch_means(axes, None, validation)
    if min(float(found.mean_dn[validation.used].min()) for found in (validation.measured, validation.simulated)) > 0:
        axes.set(xscale="log", yscale="log")
    draw_identity(axes)
    axes.set(xlabel="patch mean above black, simulated (DN)", ylabel="measured (DN)")
    axes.legend(title="channel")
    return axes


@draw.register(Spectrum)
@styled()
def _(spectrum: Spectrum, ax: Axes | None = None) -> Axes:
    """Draw a spectrum."""
    axes = new_or_given(ax)
    axes.plot(spectrum.wavelength_nm, spectrum.values, color=BLUE)
    axes.set(xlabel="wavelength (nm)", ylabel="value")
    return axes


@styled()
def plot_lines(lines: Mapping[str, Sequence[tuple[float, ...]]], x: str, y: str, ax: Axes | None = None) -> Axes:
    """Draw lines of points (x, y) or, with bars, (x, y, lower end, upper end) by label.

    The axis of x is logarithmic over more than a decade, or made of texts.
    """
    axes = new_or_given(ax)
    for position, (label, points) in enumerate(lines.items()):
        color, marker, style = line_style(position)
        across, up, *ends = zip(*points, strict=True)
        axes.plot(across, up, color=color, marker=marker, linestyle=style, label=label or None)
        if ends:
            axes.vlines(across, *ends, color=color, linewidth=1)
    places = [point[0] for points in lines.values() for point in points]
    if all(isinstance(place, int | float) for place in places) and 0 < 10 * min(places) < max(places):
        axes.set_xscale("log")
    axes.set(xlabel=x, ylabel=y)
    if any(lines):
        axes.legend()
    return axes


@draw.register(RawFrame)
@styled()
def _(raw: RawFrame, ax: Axes | None = None) -> Axes:
    """Draw the digital numbers as shades of gray."""
    step = -(-max(raw.shape) // _WIDEST_PX)
    axes = new_or_given(ax)
    image = axes.imshow(raw.dn[::step, ::step], cmap="gray", extent=_pixels(*raw.shape))
    _without_grid(axes, "column", "row")
    axes.figure.colorbar(image, ax=axes, label="digital number")
    return axes


@draw.register(Scene)
@styled()
def _(scene: Scene, ax: Axes | None = None) -> Axes:
    """Draw the scene in display sRGB."""
    axes = new_or_given(ax)
    axes.imshow(thumbnail(scene), extent=_pixels(*scene.shape))
    _without_grid(axes, "column", "row")
    return axes


def _pixels(rows: int, cols: int) -> tuple[float, float, float, float]:
    """Return the extent of an image in pixels, row 0 at the top."""
    return -0.5, cols - 0.5, rows - 0.5, -0.5


@draw.register(LensBlur)
@styled()
def _(
    lens: LensBlur,
    ax: Axes | None,
    kind: str,
    wavelength_nm: float | Sequence[float],
    distance_m: float,
    at_mm: tuple[float, float],
) -> Axes:
    """Draw the MTF or the PSF of a lens."""
    waves = [float(wave) for wave in np.atleast_1d(np.asarray(wavelength_nm, np.float64))]
    spread, at_m = lens.point_spread(distance_m), (1e-3 * at_mm[0], 1e-3 * at_mm[1])
    if kind == "mtf":
        frequency = np.linspace(0.0, max(cutoff_per_m(spread, wave) for wave in waves), _FREQUENCIES)
        curves = {f"{wave:g} nm": mtf(spread, frequency, wave, at_m) for wave in waves}
        return draw_mtf(new_or_given(ax), frequency * 1e-3, curves)
    if kind == "psf":
        psf, step_m = sampled_psf(spread, waves[len(waves) // 2], at_m)
        return draw_psf(new_or_given(ax), psf, 1e6 * step_m, f"{waves[len(waves) // 2]:g} nm")
    raise InputError("kind", value=kind, expected="'mtf' or 'psf'")


def draw_mtf(axes: Axes, frequency_per_mm: NDArray[np.float64], curves: Mapping[str, NDArray[np.float64]]) -> Axes:
    """Draw MTFs, by label: the first along the columns, dashed the one along the rows."""
    for position, (label, both) in enumerate(curves.items()):
        color = line_style(position)[0]
        axes.plot(frequency_per_mm, both[0], color=color, label=label)
        if not np.allclose(both[0], both[1], atol=1e-6):
            axes.plot(frequency_per_mm, both[1], color=color, linestyle="--", label=f"{label}, vertical")
    axes.set(xlabel="frequency (cycles/mm)", ylabel="modulation", ylim=(0.0, 1.02))
    axes.set_xlim(left=0.0)
    axes.legend()
    return axes


def draw_psf(axes: Axes, psf: NDArray[np.float64], step_um: float, title: str) -> Axes:
    """Draw a PSF on a logarithmic scale of four decades."""
    half = 0.5 * step_um * psf.shape[0]
    level = np.log10(np.maximum(psf / psf.max(), 1e-4))
    image = axes.imshow(level, extent=(-half, half, half, -half), cmap="magma", vmin=-4.0, vmax=0.0)
    _without_grid(axes, "x (µm)", "y (µm)")
    axes.figure.colorbar(image, ax=axes, label="log10 of the intensity, relative to the peak")
    axes.set_title(title)
    return axes


def _without_grid(axes: Axes, x_label: str, y_label: str) -> None:
    axes.grid(visible=False)
    axes.set(xlabel=x_label, ylabel=y_label)


@draw.register(Result)
@styled()
def _(result: Result, ax: Axes | None = None) -> Axes:
    """Draw the first figure of a measurement: curves, or a map."""
    if result.curves:
        return draw_curves_of(new_or_given(ax), next(iter(figures_of(result).values())))
    if result.maps:
        return draw_map(new_or_given(ax), result.maps[0])
    raise InputError("plot", expected="a result with curves or maps")
