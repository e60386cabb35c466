"""Section 3: the fill factor, the one free parameter of the simulation, fitted to patch means.

`recovery_study` repeats the fit over many seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.report.numbers import format_interval, format_number, format_uncertain
from photosite.report.page import Column, Listing, Table
from photosite.report.style import BLACK, channel_style, styled
from photosite.scene.charts import macbeth_regions
from photosite.studies.farrell2008.cameras import (
    CASES,
    CHART_COLS,
    CHART_ROWS,
    FILL_FACTOR_BELOW,
    UNEVENNESS,
    Case,
    MeasuredCamera,
    frame_key,
)
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, bare, paragraph, text
from photosite.validation.fill_factor import FillFactorFit, fit_fill_factor
from photosite.values.uncertain import COVERAGE_95

_CHART = (4, 6)
"""Rows and columns of patches."""

_MAP_PERCENT = 2.0
"""Ends of the color scale of the map."""

_LARGEST_BAR_PERCENT = 2.0
"""Residuals with larger error bars are not drawn by channel."""


@dataclass(frozen=True, eq=False)
class CaseFit:
    """Hidden fill factor of one camera, and the fits by mean luminance of the chart in cd/m2, dimmest first.

    The fits share one lamp and are not independent; they show that the fill factor does not depend on the light level.
    """

    case: Case
    true: float
    fits: Mapping[float, FillFactorFit]

    @property
    def fit(self) -> FillFactorFit:
        """Fit of the brightest chart, where noise is smallest."""
        return self.fits[self.case.luminances_cd_m2[-1]]

    @property
    def pull(self) -> float:
        """Fitted minus hidden value in standard errors."""
        return (self.fit.value - self.true) / self.fit.standard_error

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "paper": self.case.paper_fill_factor,
            "hidden": self.true,
            "fitted": self.fit.value,
            "standard_error": self.fit.standard_error,
            "interval_95": list(self.fit.interval_95),
            "fitted_less_hidden_in_standard_errors": self.pull,
            "by_luminance_cd_m2": {f"{level:g}": fit.to_dict() for level, fit in self.fits.items()},
        }


@dataclass(frozen=True, eq=False)
class FillFactors:
    """Fill factors of both cameras, by key of the case."""

    cameras: Mapping[str, CaseFit]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {key: found.to_dict() for key, found in self.cameras.items()}

    def part(self) -> Part:
        """Return the table, the residuals, and the differences in words."""
        hidden = " and ".join(
            f"{int((found.fit.used & ~_known(found.fit)).sum())} of 72 ({found.case.title})"
            for found in self.cameras.values()
        )
        return (
            paragraph("fill_factor", percent=100 * UNEVENNESS),
            self._table(),
            Drawing.of(
                "fill-factor-residuals", residuals_figure(self), largest_bar=_LARGEST_BAR_PERCENT, hidden=hidden
            ),
            Listing(tuple(line for found in self.cameras.values() for line in _words(found))),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return a line for each camera."""
        rows = []
        for found in self.cameras.values():
            fit = found.fit
            inside = "inside" if abs(fit.value - found.true) <= COVERAGE_95 * fit.standard_error else "outside"
            too_large = text("fill_factor_error")
            rows.append(
                (
                    f"Fill factor, {found.case.title}",
                    f"{found.case.paper_fill_factor:g}",
                    f"{format_uncertain(fit.value, fit.standard_error)}; hidden: {format_number(found.true, 4)}",
                    text("fill_factor_summary", away=abs(found.pull), inside=inside, too_large=too_large),
                )
            )
        return tuple(rows)

    def _table(self) -> Table:
        def channel(fit: FillFactorFit, name: str) -> str:
            found = fit.by_channel.get(name)
            return "–" if found is None else format_uncertain(found.value, found.standard_error)

        rows = tuple(
            (
                found.case.title,
                f"{level:g}",
                f"{found.case.paper_fill_factor:g}",
                format_number(found.true, 4),
                format_uncertain(fit.value, fit.standard_error),
                format_interval(*fit.interval_95, fit.standard_error),
                *(channel(fit, name) for name in "RGB"),
                f"{100 * fit.patch_scatter:.2f} %",
            )
            for found in self.cameras.values()
            for level, fit in sorted(found.fits.items(), reverse=True)
        )
        columns = ("Chart, cd/m²", "Paper", "Hidden", "Fitted", "95 % interval", "R alone", "G alone", "B alone")
        return Table(
            "Fill factor; the result is that of the brightest chart, dimmer charts verify it",
            (Column("Camera"), *(Column(name, numeric=True) for name in (*columns, "Scatter of patches"))),
            rows,
        )


def fit_fill_factors(seed: int) -> FillFactors:
    """Fit the fill factors of both cameras to one frame of the chart at each luminance.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3: the fill factor was the one value that the authors could not measure.
    The least squared difference between measured and simulated patch means gave 0.9 (D200) and 0.5 (vendor), which are
    the initial values here; the result does not depend on them (`photosite.validation.fill_factor`).
    """
    return FillFactors(MappingProxyType({case.key: fit_case(case, seed) for case in CASES}))


def fit_case(case: Case, seed: int) -> CaseFit:
    """Capture the chart with one camera at each luminance, simulate it, and fit."""
    measured = MeasuredCamera(case, seed)
    fits = {}
    for level in case.luminances_cd_m2:
        (seen,) = measured.shoot(level)
        made = simulate_chart(case, case.paper_fill_factor, seed, level)
        regions = macbeth_regions(*seen.shape)
        fits[level] = fit_fill_factor(
            patch_statistics(seen, regions), patch_statistics(made, regions), case.paper_fill_factor
        )
    return CaseFit(case, measured.truth.fill_factor, MappingProxyType(fits))


def simulate_chart(case: Case, fill_factor: float, seed: int, luminance_cd_m2: float) -> RawFrame:
    """Return the simulated frame of the chart; fixed pattern and noise differ from those of the measured camera."""
    key = frame_key(seed, f"simulated chart of {case.key} at {luminance_cd_m2:g} cd/m2")
    # With one chip for all seeds, its fixed pattern would give all of them the same error.
    camera = case.camera(fill_factor, serial=f"{case.key}, simulated {seed}")
    return camera.capture(case.chart(luminance_cd_m2), case.exposure_s, seed=key)


WITHIN, WANTED = 2.0, 0.95
"""A fit is found within this many standard errors; the share that should be found."""


@dataclass(frozen=True, eq=False)
class Recovery:
    """Fits of one camera over many seeds; arrays are (seeds,). Camera and light differ from seed to seed."""

    case: Case
    true: NDArray[np.float64]
    fitted: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    in_interval: NDArray[np.bool_]

    @property
    def pulls(self) -> NDArray[np.float64]:
        """Fitted minus hidden values in standard errors."""
        return (self.fitted - self.true) / self.standard_error

    @property
    def found(self) -> float:
        """Share within two standard errors."""
        return float(np.mean(np.abs(self.pulls) <= WITHIN))

    @property
    def passes(self) -> bool:
        """Whether `found` is 95 % or more."""
        return self.found >= WANTED

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for JSON."""
        relative = self.fitted / self.true - 1.0
        return {
            "seeds": int(self.true.size),
            "found": self.found,
            "passes": self.passes,
            "in_interval_95": float(self.in_interval.mean()),
            "mean_relative_error": float(np.mean(relative)),
            "rms_relative_error": math.sqrt(float(np.mean(relative**2))),
            "mean_relative_standard_error": float(np.mean(self.standard_error / self.fitted)),
            "mean_pull": float(self.pulls.mean()),
            "rms_pull": math.sqrt(float(np.mean(self.pulls**2))),
            "largest_pull": float(np.abs(self.pulls).max()),
        }


def recovery_study(
    seeds: Sequence[int],
    *,
    rows: int = CHART_ROWS,
    cols: int = CHART_COLS,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Recovery, ...]:
    """Fit the fill factors of both cameras for many seeds.

    Parameters
    ----------
    seeds
        Seeds of the study; each gives one camera of each kind.
    rows, cols
        Frame size. Smaller frames have fewer pixels in a patch, and more noise in its mean.
    progress
        Called with (fits done, fits in total).

    Raises
    ------
    InputError
        If there is no seed.
    """
    if not seeds:
        raise InputError("seeds", value=seeds, expected="one seed or more")
    found = []
    for number, case in enumerate(CASES):
        small = replace(case, chart_rows=rows, chart_cols=cols, luminances_cd_m2=case.luminances_cd_m2[-1:])
        table = []
        for done, seed in enumerate(seeds, start=1):
            result = fit_case(small, seed)
            low, high = result.fit.interval_95
            table.append((result.true, result.fit.value, result.fit.standard_error, low <= result.true <= high))
            if progress is not None:
                progress(number * len(seeds) + done, len(CASES) * len(seeds))
        true, fitted, error, inside = np.array(table, dtype=np.float64).T
        found.append(Recovery(case, true, fitted, error, inside.astype(np.bool_)))
    return tuple(found)


@styled()
def residuals_figure(chapter: FillFactors) -> Figure:
    """Draw the residuals of each camera over the chart and by channel, at the brightest luminance."""
    figure = Figure(figsize=(10.2, 6.0))
    panels = figure.subplots(2, 2, height_ratios=(1.15, 1.0))
    panels[1, 1].sharey(panels[1, 0])
    for column, found in zip(panels.T, chapter.cameras.values(), strict=True):
        image = _draw_map(column[0], found.fit)
        column[0].set_title(f"{found.case.title}: fill factor {found.fit.value:.3f}", loc="left")
        _draw_channels(column[1], found.fit)
    bar = figure.colorbar(image, ax=panels[0].tolist(), extend="both", shrink=0.9)
    bar.set_label("residual, mean of channels (%)")
    panels[1, 0].set_ylabel("residual (%)")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    return figure


def _patch_residuals(fit: FillFactorFit) -> NDArray[np.float64]:
    """Return (patches,) noise-weighted means over the channels in percent; NaN where none is used."""
    weight = np.ma.filled(1.0 / fit.residual_noise**2, 0.0)
    total = weight.sum(axis=1)
    lit = total > 0
    mean = np.full(total.shape, np.nan)
    mean[lit] = 100.0 * (weight * fit.residuals.filled(0.0)).sum(axis=1)[lit] / total[lit]
    return mean


def _draw_map(axes: Axes, fit: FillFactorFit) -> AxesImage:
    percent = _patch_residuals(fit).reshape(_CHART)
    # Purple to orange is distinct for readers of every color vision.
    image = axes.imshow(percent, cmap="PuOr_r", vmin=-_MAP_PERCENT, vmax=_MAP_PERCENT)
    for (row, col), value in np.ndenumerate(percent):
        if np.isfinite(value):
            red, green, blue, _ = image.to_rgba(np.array(value))
            dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.5
            label = f"{value:+.2f}".replace("-", "−")
            axes.text(col, row, label, ha="center", va="center", fontsize=9, color="white" if dark else BLACK)
    bare(axes)
    return image


def _known(fit: FillFactorFit) -> NDArray[np.bool_]:
    """Return (patches, channels) which residuals are drawn by channel."""
    half = 100.0 * COVERAGE_95 * fit.residual_noise
    return np.asarray(fit.used & (half.filled(np.inf) <= _LARGEST_BAR_PERCENT))


def _draw_channels(axes: Axes, fit: FillFactorFit) -> None:
    patches = np.arange(1, len(fit.names) + 1)
    for shift, channel in enumerate("RGB"):
        k = fit.channels.index(channel)
        color, marker, _ = channel_style(channel)
        which = _known(fit)[:, k]
        axes.errorbar(
            patches[which] + 0.22 * (shift - 1),
            100.0 * fit.residuals[which, k],
            100.0 * COVERAGE_95 * fit.residual_noise[which, k],
            fmt=marker,
            color=color,
            markersize=4.0,
            elinewidth=0.9,
            label=channel,
        )
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set_xlim(0.3, len(patches) + 0.7)
    axes.set_xticks(range(1, len(patches) + 1, _CHART[1]))
    axes.set_xticks(patches, minor=True)
    axes.set_xlabel("patch, along the rows of the chart")


def _words(found: CaseFit) -> tuple[str, ...]:
    fit, title, chi = found.fit, found.case.title, found.fit.chi_square
    return (
        text(
            "fill_factor_distance",
            title=title,
            fitted=format_uncertain(fit.value, fit.standard_error),
            away=abs(found.pull),
            hidden=format_number(found.true, 4),
            within="within" if abs(found.pull) <= 2.0 else "not within",
            too_large=text("fill_factor_error"),
            paper=found.case.paper_fill_factor,
            below=FILL_FACTOR_BELOW,
        ),
        text(
            "fill_factor_residuals",
            title=title,
            chi=chi.statistic,
            freedom=chi.degrees_of_freedom,
            scatter=100 * fit.patch_scatter,
        ),
    )
