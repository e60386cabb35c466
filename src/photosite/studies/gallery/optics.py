"""Plates of what lenses do to a point: aberrations and openings, their point spreads and transfer functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import PlanePsf, RadialPsf
from photosite.optics.pupil import Pupil
from photosite.optics.wavefront import Wavefront
from photosite.report.style import BLUE, GRAY, VERMILION, styled

Array = NDArray[np.float64]

_LENS = DiffractionLimited(f_number=4, focal_length_mm=50)
_WAVELENGTH_NM = 550.0
_HALF_UM = 20.0
_SAMPLES = 256
_DECADES = 4.0

PLATE: tuple[tuple[str, Wavefront], ...] = (
    ("no aberration", Wavefront()),
    ("defocus, 80 nm", Wavefront({4: 80.0})),
    ("coma, 80 nm", Wavefront({8: 80.0})),
    ("astigmatism, 80 nm", Wavefront({6: 80.0})),
    ("spherical, 80 nm", Wavefront({11: 80.0})),
    ("six blades", Wavefront(pupil=Pupil(blades=6))),
    ("obscured by 0.4", Wavefront(pupil=Pupil(obscuration=0.4))),
    ("0.4 and four vanes", Wavefront(pupil=Pupil(0.4, vanes=4, vane_width=0.02))),
)


def transfer(spread: RadialPsf | PlanePsf, fy_per_m: Array, fx_per_m: Array) -> NDArray[np.complex128]:
    """A lens's transfer function in the plane, whichever kind of spread it has."""
    if isinstance(spread, RadialPsf):
        return spread.otf(np.hypot(fy_per_m, fx_per_m), _WAVELENGTH_NM).astype(np.complex128)
    return spread.otf(fy_per_m, fx_per_m, _WAVELENGTH_NM)


def point_image(spread: RadialPsf | PlanePsf, half_m: float, count: int) -> Array:
    """(count, count) point spread over a square of 2 half_m, per m2.

    By the Fourier sum over frequencies so close that what repeats stays eight squares away.
    """
    cutoff = spread.cutoff_per_m(_WAVELENGTH_NM)
    step = 1 / (16 * half_m)
    number = int(np.ceil(cutoff / step))
    f: Array = np.arange(-number, number + 1, dtype=np.float64) * step
    otf = transfer(spread, f[:, None], f[None, :])
    at = (np.arange(count) + 0.5 - count / 2) * (2 * half_m / count)
    wave = np.exp(2j * np.pi * at[:, None] * f)
    image: Array = (wave @ otf @ wave.T).real * step**2
    return image


def optics_plate() -> Figure:
    """Eight lenses of f/4 at 550 nm: the image of a point over four decades, and the MTF across and down.

    Wavefront errors are RMS.
    """
    with styled():
        figure = Figure(figsize=(11.0, 9.4), layout="constrained")
        axes = figure.subplots(4, 4, height_ratios=(1.15, 1, 1.15, 1))
        peak = point_image(Wavefront().point_spread(_LENS, np.inf), _HALF_UM * 1e-6, _SAMPLES).max()
        for k, (title, wavefront) in enumerate(PLATE):
            row, col = 2 * (k // 4), k % 4
            spread = wavefront.point_spread(_LENS, np.inf)
            _draw_image(figure, axes[row, col], spread, title, peak, last=col == 3)
            _draw_curves(axes[row + 1, col], spread, first=col == 0)
        axes[1, 0].legend(loc="upper right", handlelength=1.8, borderaxespad=0.0)
    return figure


def _draw_image(
    figure: Figure, axes: Any, spread: RadialPsf | PlanePsf, title: str, peak: float, *, last: bool
) -> None:
    image = point_image(spread, _HALF_UM * 1e-6, _SAMPLES) / peak
    # Between two dark rings a value is 0 but for rounding: the scale ends before.
    shown = np.log10(np.maximum(image, 10**-_DECADES))
    colors = LinearSegmentedColormap.from_list("light", ["#000000", "#1B2A6B", "#56B4E9", "#FFFFFF"])
    extent = (-_HALF_UM, _HALF_UM, _HALF_UM, -_HALF_UM)
    drawn = axes.imshow(shown, cmap=colors, vmin=-_DECADES, vmax=0, extent=extent, interpolation="nearest")
    axes.set_title(f"{title}; peak {image.max():.2f}")
    axes.set_xticks([-20, 0, 20], ["−20", "0", "20 µm"])
    axes.set_yticks([])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)
    if last:
        bar = figure.colorbar(drawn, ax=axes, fraction=0.05, ticks=[-4, -3, -2, -1, 0])
        bar.ax.set_yticklabels(["10⁻⁴", "10⁻³", "10⁻²", "0.1", "1"])


def _draw_curves(axes: Any, spread: RadialPsf | PlanePsf, *, first: bool) -> None:
    f = np.linspace(0.0, spread.cutoff_per_m(_WAVELENGTH_NM), 401)
    ideal = _LENS.otf(f, _WAVELENGTH_NM, np.inf)
    zero = np.zeros_like(f)
    axes.plot(f * 1e-3, ideal, color=GRAY, linewidth=1.0, linestyle=":", label="no aberration")
    axes.plot(f * 1e-3, np.abs(transfer(spread, zero, f)), color=BLUE, label="across")
    axes.plot(f * 1e-3, np.abs(transfer(spread, f, zero)), color=VERMILION, linestyle="--", label="down")
    axes.set_xlim(0, f[-1] * 1e-3)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("cycles/mm")
    if first:
        axes.set_ylabel("MTF")
