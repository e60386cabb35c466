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
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.scene.charts import macbeth_regions
from photosite.studies.farrell2008.cameras import CASES, CHART_COLS, CHART_ROWS, Case, MeasuredCamera, frame_key
from photosite.validation.fill_factor import FillFactorFit, fit_fill_factor


@dataclass(frozen=True, eq=False)
class CaseFit:
    """Fitted fill factor of one camera.

    Parameters
    ----------
    case
        Camera.
    true
        Hidden fill factor.
    fits
        By mean luminance of the chart in cd/m2, dimmest first. They share one lamp and are not independent; they show
        that the fill factor does not depend on the light level.
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
    measured = MeasuredCamera.drawn(case, seed)
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
    camera = case.camera(fill_factor)
    # With one chip for all seeds, its fixed pattern would give all of them the same error.
    camera = replace(camera, sensor=camera.sensor.with_(serial=f"{case.key}, simulated {seed}"))
    return camera.capture(case.chart(luminance_cd_m2), case.exposure_s, seed=key)


SEEDS = 100
"""Default number of seeds of the recovery study."""
WITHIN, WANTED = 2.0, 0.95
"""A fit is found within this many standard errors; the share that should be found."""


@dataclass(frozen=True, eq=False)
class Recovery:
    """Fits of one camera over many seeds. Arrays are (seeds,).

    Parameters
    ----------
    case
        Camera; the virtual camera and its light differ from seed to seed.
    true, fitted, standard_error
        Hidden fill factor, fitted value and standard error.
    in_interval
        Whether the 95 % interval contains the hidden value.
    """

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
        return {
            "seeds": int(self.true.size),
            "found": self.found,
            "passes": self.passes,
            "in_interval_95": float(self.in_interval.mean()),
            "mean_relative_error": float(np.mean(self.fitted / self.true - 1.0)),
            "rms_relative_error": math.sqrt(float(np.mean((self.fitted / self.true - 1.0) ** 2))),
            "mean_relative_standard_error": float(np.mean(self.standard_error / self.fitted)),
            "mean_pull": float(self.pulls.mean()),
            "rms_pull": math.sqrt(float(np.mean(self.pulls**2))),
            "largest_pull": float(np.abs(self.pulls).max()),
        }


def recovery_study(
    seeds: Sequence[int] = range(SEEDS),
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
