"""Figures 1 to 5: the chart captured with each camera and simulated, compared patch by patch and in color."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from photosite.develop.camera_color import ColorMatrix, fit_color_matrix
from photosite.develop.develop import develop_pair
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.metrics.patches import PatchStatistics
from photosite.report.figures.sensor import draw_spectral_sensitivity
from photosite.report.figures.validation import FillStyle, draw_identity, draw_patch_means, draw_patch_snr
from photosite.report.page import Column, Listing, Table, magnified, shrink
from photosite.report.style import BLACK, GRAY, ORANGE, SKY, channel_handles, styled
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import CASES, Case, MeasuredCamera
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, bare, paragraph, text
from photosite.studies.farrell2008.fill_factor import FillFactors, simulate_chart
from photosite.validation.result import ColorComparison, Validation
from photosite.validation.validate import validate

FORMULAS = MappingProxyType({"76": "CIE 1976", "94": "CIE 1994", "2000": "CIEDE2000"})
"""Color difference formulas: suffix of their names in `ColorMatrix`, and label."""

_FILLS: tuple[FillStyle, ...] = ("full", "bottom", "none")
"""Marker fills from the brightest chart to the dimmest."""

_LARGEST_BAR_PERCENT, _LARGEST_BAR_DB = 3.0, 1.0
"""Differences with larger error bars are left out of the lower panels."""

_WIDEST, _WIDEST_DIFFERENCE = 262, 98
_MAGNIFICATION = 10.0
_BINS = 12

_Draw = Callable[[Axes, Axes, Validation, FillStyle, float], None]
_Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Colors:
    """Figure 5 for one camera: accuracy of the best 3 x 3 matrix from camera RGB to XYZ under D65.

    `names` are the patches that saturate no channel. Each matrix is fitted to its own patches; `between` compares
    measured with simulated patches, both with the matrix of the simulation.
    """

    names: tuple[str, ...]
    measured: ColorMatrix
    simulated: ColorMatrix
    between: ColorComparison

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "patches": list(self.names),
            "measured": _matrix_to_dict(self.measured),
            "simulated": _matrix_to_dict(self.simulated),
            "measured_against_simulated": {
                f"delta_e_{key}": getattr(self.between, f"delta_e_{key}").tolist() for key in FORMULAS
            },
        }


def _matrix_to_dict(matrix: ColorMatrix) -> dict[str, Any]:
    found = {key: (differences(matrix, key), differences(matrix, key, True)) for key in FORMULAS}
    return {
        "matrix": matrix.matrix.tolist(),
        **{f"delta_e_{key}": fitted.tolist() for key, (fitted, _) in found.items()},
        **{f"delta_e_{key}_left_out": left_out.tolist() for key, (_, left_out) in found.items()},
        "mean": {
            key: {"fitted": float(fitted.mean()), "left_out": float(left_out.mean())}
            for key, (fitted, left_out) in found.items()
        },
    }


def differences(matrix: ColorMatrix, formula: str, left_out: bool = False) -> _Values:
    """Return (patches,) color differences by a key of `FORMULAS`, fitted or left out of the fit."""
    found: _Values = getattr(matrix, f"delta_e_{formula}" + "_left_out" * left_out)
    return found


@dataclass(frozen=True, eq=False)
class CameraPatches:
    """The chart captured with one camera, and simulated with its fitted fill factor.

    `measured`, `simulated` and `colors` are at the brightest luminance; `comparisons` are by luminance in cd/m2,
    dimmest first.
    """

    case: Case
    fill_factor: float
    measured: RawFrame
    simulated: RawFrame
    comparisons: Mapping[float, Validation]
    colors: Colors

    @property
    def sensor(self) -> Sensor:
        """Sensor whose sensitivities Figure 1 shows."""
        return self.case.sensor()

    @property
    def brightest_first(self) -> list[float]:
        """Luminances in cd/m2."""
        return sorted(self.comparisons, reverse=True)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "fill_factor_of_the_simulation": self.fill_factor,
            "by_luminance_cd_m2": {f"{level:g}": _to_dict(found) for level, found in self.comparisons.items()},
            "colors": self.colors.to_dict(),
        }


def _to_dict(found: Validation) -> dict[str, Any]:
    def side(seen: PatchStatistics) -> dict[str, Any]:
        return {
            "mean_dn": seen.mean_dn.tolist(),
            "standard_error_dn": seen.standard_error_dn.tolist(),
            "snr_db": np.ma.masked_invalid(seen.spatial_snr_db).tolist(),
        }

    return {
        "patches": list(found.measured.names),
        "channels": list(found.measured.channels),
        "used": found.used.tolist(),
        "measured": side(found.measured),
        "simulated": side(found.simulated),
        "median_relative_difference_of_means": _median(found.relative_difference[found.used]),
        "median_snr_difference_db": _median(snr_difference_db(found)),
        "chi_square_of_means": found.means.statistic,
        "chi_square_of_noise": found.noise.statistic,
        "degrees_of_freedom": found.means.degrees_of_freedom,
    }


def _median(values: _Values) -> float:
    """Return the median of the absolute values that are not masked."""
    return float(np.median(np.abs(np.ma.compressed(values))))


def snr_difference_db(found: Validation) -> _Values:
    """Return (points,) SNR of measured minus simulated patches, where both are finite."""
    seen, made = found.measured.spatial_snr_db, found.simulated.spatial_snr_db
    there = found.used & np.isfinite(seen) & np.isfinite(made)
    return np.asarray(seen[there] - made[there])


@dataclass(frozen=True, eq=False)
class Patches:
    """Result of the chapter, by key of the case."""

    cameras: Mapping[str, CameraPatches]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {key: found.to_dict() for key, found in self.cameras.items()}

    def part(self) -> Part:
        """Return figures 1 to 5 and their description in words."""
        red = self.cameras["vendor"].sensor.channels["R"]
        return (
            Drawing.of(
                "figure1-spectral-sensitivity",
                sensitivity_figure(self),
                end_nm=red.wavelength_nm[-1],
                end_percent=100 * red.quantum_efficiency[-1],
            ),
            Drawing.of("figure2-pictures", pictures_figure(self), magnification=_MAGNIFICATION),
            Drawing.of(
                "figure3-patch-means",
                patch_means_figure(self),
                largest_bar=_LARGEST_BAR_PERCENT,
                below_black=self._below_black(),
            ),
            Drawing.of("figure4-patch-snr", patch_snr_figure(self), largest_bar=_LARGEST_BAR_DB),
            Listing(tuple(line for found in self.cameras.values() for line in _words(found))),
            Drawing.of("figure5-color-differences", colors_figure(self)),
            self._color_table(),
            paragraph("colors", increase=" and ".join(map(_increase, self.cameras.values()))),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return two lines for each camera."""
        pictured = "shown in figures; values not published"
        rows: list[SummaryRow] = []
        for found in self.cameras.values():
            brightest = found.comparisons[found.case.luminances_cd_m2[-1]]
            means = abs(brightest.relative_difference[brightest.used]).mean()
            ratios = abs(snr_difference_db(brightest)).mean()
            fitted, left_out = (differences(found.colors.simulated, "2000", out).mean() for out in (False, True))
            seen = differences(found.colors.measured, "2000", True).mean()
            rows += [
                (
                    f"Patch means and SNR, {found.case.title}",
                    pictured,
                    f"{100 * means:.1f} % and {ratios:.2f} dB apart on average over patches and channels",
                    "The measured chart is lit unevenly, which the simulation does not know.",
                ),
                (
                    f"Color differences with the best 3 × 3 matrix, {found.case.title}",
                    pictured,
                    f"mean {FORMULAS['2000']}: {left_out:.2f} simulated, {seen:.2f} measured, patches left out of the "
                    "fit",
                    f"Fitted patches underestimate the error: {fitted:.2f} instead of {left_out:.2f}.",
                ),
            ]
        return tuple(rows)

    def _below_black(self) -> str:
        """Return a sentence on points that a logarithmic axis cannot show, if there are any."""
        every = [both for found in self.cameras.values() for both in found.comparisons.values()]
        count = sum(int((np.minimum(both.measured.mean_dn, both.simulated.mean_dn) <= 0).sum()) for both in every)
        return f" Not shown, because a mean is not above black: {count} points." if count else ""

    def _color_table(self) -> Table:
        rows = []
        for found in self.cameras.values():
            colors = found.colors
            for key, formula in FORMULAS.items():
                between = getattr(colors.between, f"delta_e_{key}")
                means = [
                    f"{differences(matrix, key, left_out).mean():.2f}"
                    for left_out in (False, True)
                    for matrix in (colors.measured, colors.simulated)
                ]
                rows.append((found.case.title, formula, *means, f"{between.mean():.2f}", f"{between.max():.2f}"))
        fits = [f"{side}, {kind}" for kind in ("fitted", "left out") for side in ("Measured", "Simulated")]
        numeric = (Column(title, numeric=True) for title in (*fits, "Measured to simulated", "Largest"))
        return Table(
            "Mean color difference of the patches", (Column("Camera"), Column("Formula"), *numeric), tuple(rows)
        )


def compare_charts(seed: int, fill_factors: FillFactors) -> Patches:
    """Capture and simulate the charts of both cameras, and compare (section 3 of the paper).

    Parameters
    ----------
    seed
        Seed of the study.
    fill_factors
        Result of `fit_fill_factors` for it, which the simulation uses.
    """
    return Patches(
        MappingProxyType({case.key: _compare(case, seed, fill_factors.cameras[case.key].fit.value) for case in CASES})
    )


def _compare(case: Case, seed: int, fill_factor: float) -> CameraPatches:
    camera = MeasuredCamera(case, seed)
    frames = {
        level: (camera.shoot(level)[0], simulate_chart(case, fill_factor, seed, level))
        for level in case.luminances_cd_m2
    }
    comparisons = {level: validate(*pair, chart="macbeth") for level, pair in frames.items()}
    brightest = case.luminances_cd_m2[-1]
    return CameraPatches(
        case, fill_factor, *frames[brightest], MappingProxyType(comparisons), _colors(comparisons[brightest])
    )


def _colors(found: Validation) -> Colors:
    if found.color is None:  # 24 patches in R, G and B always suffice unless the chart saturates
        raise AssertionError(f"no colors to compare: {'; '.join(found.notes)}")
    whole = np.asarray(found.used.all(axis=1), dtype=np.bool_)
    names = tuple(name for name, ok in zip(found.measured.names, whole, strict=True) if ok)
    order = [found.measured.channels.index(name) for name in "RGB"]
    measured = fit_color_matrix(found.measured.mean_dn[whole][:, order], chart_xyz_d65("macbeth", names))
    return Colors(names, measured, found.color.matrix, found.color)


def _words(found: CameraPatches) -> tuple[str, ...]:
    lines = []
    for level in found.brightest_first:
        comparison = found.comparisons[level]
        means, noise = comparison.means, comparison.noise
        line = text(
            "patches",
            title=found.case.title,
            level=level,
            size=100.0 * _median(comparison.relative_difference[comparison.used]),
            means=means.statistic,
            freedom=means.degrees_of_freedom,
            noise=noise.statistic,
            noise_freedom=noise.degrees_of_freedom,
            p=noise.p_value,
            agree="consistent" if noise.p_value >= 0.05 else "inconsistent",
        )
        lines.append(line)
    return tuple(lines)


def _increase(found: CameraPatches) -> str:
    fitted, left_out = (differences(found.colors.measured, "2000", each).mean() for each in (False, True))
    return f"{100.0 * float(left_out / fitted - 1.0):.0f} % ({found.case.title})"


@styled()
def sensitivity_figure(chapter: Patches) -> Figure:
    """Draw the spectral sensitivity of both sensors (Figure 1)."""
    figure = Figure(figsize=(10.2, 4.0))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, found in zip(panels, chapter.cameras.values(), strict=True):
        draw_spectral_sensitivity(axes, found.sensor)
        axes.set_title(found.case.title, loc="left")
    panels[1].set_ylabel("")
    handles = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend([handles[name] for name in "RGB"], list("RGB"), loc="outside upper center", ncols=3)
    return figure


@styled()
def pictures_figure(chapter: Patches) -> Figure:
    """Draw pictures of the chart, a row for each camera (Figure 2)."""
    figure = Figure(figsize=(10.2, 5.0))
    panels = figure.subplots(2, 3)
    titles = ("measured (virtual camera)", "simulated", f"difference × {_MAGNIFICATION:g}")
    for row, found in zip(panels, chapter.cameras.values(), strict=True):
        # The matrix applies to values above black; `develop` sets the scale.
        pair = develop_pair(found.measured, found.simulated, found.colors.simulated)
        measured, simulated = (shrink(picture, _WIDEST_DIFFERENCE) for picture in pair)
        pictures = *(shrink(picture, _WIDEST) for picture in pair), magnified(measured, simulated, _MAGNIFICATION)
        for axes, picture, title in zip(row, pictures, titles, strict=True):
            axes.imshow(np.rint(255.0 * picture).astype(np.uint8), interpolation="none")
            bare(axes).set_title(title, loc="left")
        row[0].set_ylabel(found.case.title)
    return figure


@styled()
def patch_means_figure(chapter: Patches) -> Figure:
    """Draw patch means and their relative differences (Figure 3)."""
    figure, panels = _panels(chapter, draw_patch_means, _LARGEST_BAR_PERCENT)
    for (upper, lower), found in zip(panels, chapter.cameras.values(), strict=True):
        sides = (side for both in found.comparisons.values() for side in (both.measured, both.simulated))
        means = np.concatenate([side.mean_dn.ravel() for side in sides])
        lit = means[means > 0]
        # One range for both axes, so that bars below black do not extend them.
        ends = (float(lit.min()) / 1.4, 1.4 * float(lit.max()))
        upper.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
        draw_identity(upper)
        lower.set_xlabel("patch mean above black, simulated (DN)")
    panels[0][0].set_ylabel("patch mean, virtual camera (DN)")
    panels[0][1].set_ylabel("difference (%)")
    return figure


@styled()
def patch_snr_figure(chapter: Patches) -> Figure:
    """Draw patch signal-to-noise ratios and their differences (Figure 4)."""
    figure, panels = _panels(chapter, draw_patch_snr, _LARGEST_BAR_DB)
    for upper, lower in panels:
        draw_identity(upper)
        lower.set_xlabel("patch SNR, simulated (dB)")
    panels[0][0].set_ylabel("patch SNR, virtual camera (dB)")
    panels[0][1].set_ylabel("difference (dB)")
    return figure


def _panels(chapter: Patches, draw: _Draw, largest_bar: float) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """Draw a column of two axes for each camera."""
    figure = Figure(figsize=(10.2, 6.4))
    grid = figure.subplots(2, 2, sharex="col", height_ratios=(2.4, 1.0))
    looks: dict[float, FillStyle] = {}
    for (upper, lower), found in zip(grid.T, chapter.cameras.values(), strict=True):
        levels = found.brightest_first
        for level, filled in zip(levels, _FILLS, strict=False):
            draw(upper, lower, found.comparisons[level], filled, largest_bar)
            looks.setdefault(level, filled)
        lower.axhline(0.0, color=BLACK, linewidth=0.8)
        upper.set_title(f"{found.case.title}, {', '.join(f'{level:g}' for level in levels)} cd/m²", loc="left")
    look: dict[str, Any] = {"color": GRAY, "marker": "o", "linestyle": "", "markerfacecoloralt": "white"}
    handles = channel_handles(list("RGB"), "", lines=False)
    handles += [Line2D([], [], fillstyle=fill, label=f"{level:g} cd/m²", **look) for level, fill in looks.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.align_ylabels()
    return figure, [(upper, lower) for upper, lower in grid.T]


@styled()
def colors_figure(chapter: Patches) -> Figure:
    """Draw histograms of color differences, a column for each formula (Figure 5)."""
    rows = [(found, left_out) for found in chapter.cameras.values() for left_out in (False, True)]
    figure = Figure(figsize=(10.2, 8.4))
    panels = figure.subplots(len(rows), len(FORMULAS), sharey="row", squeeze=False)
    for line, (found, left_out) in zip(panels, rows, strict=True):
        for axes, formula in zip(line, FORMULAS, strict=True):
            _draw_histograms(axes, found.colors, formula, left_out)
        line[0].set_ylabel("patches")
        line[0].set_title(f"{found.case.title}, {'left out' if left_out else 'fitted'}", loc="left")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    return figure


def _draw_histograms(axes: Axes, colors: Colors, formula: str, left_out: bool) -> None:
    matrices = (colors.measured, colors.simulated)
    # Fitted and left-out patches share one axis range.
    top = float(np.ceil(max(differences(m, formula, each).max() for m in matrices for each in (False, True))))
    sides = [differences(matrix, formula, left_out) for matrix in matrices]
    axes.hist(
        sides,
        np.linspace(0.0, top, _BINS + 1).tolist(),
        color=[SKY, ORANGE],
        label=["measured (virtual camera)", "simulated"],
        edgecolor=BLACK,
        linewidth=0.5,
    )
    axes.set_xlabel(f"ΔE, {FORMULAS[formula]}; means {' and '.join(f'{values.mean():.2f}' for values in sides)}")
    axes.set_xlim(0.0, top)
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
