"""Section 3: the fill factor, fitted to patch means as the simulation's one free parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.scene.charts import macbeth_regions
from photosite.studies.farrell2008.cameras import CASES, Case, MeasuredCamera, frame_key
from photosite.validation.fill_factor import FillFactorFit, fit_fill_factor


@dataclass(frozen=True, eq=False)
class CaseFit:
    """The fill factor of one camera.

    Parameters
    ----------
    case
        Which.
    true
        The hidden fill factor, which the fit was not told.
    fits
        By mean luminance of the chart in cd/m2, dimmest first. They see one lamp from the same side, so that they are
        no repeats of each other: a fill factor does not depend on the light, and they check that.
    """

    case: Case
    true: float
    fits: Mapping[float, FillFactorFit]

    @property
    def fit(self) -> FillFactorFit:
        """The one that counts: of the brightest chart, where noise matters least."""
        return self.fits[self.case.luminances_cd_m2[-1]]

    @property
    def pull(self) -> float:
        """Fitted less hidden, in standard errors."""
        return (self.fit.value - self.true) / self.fit.standard_error

    def to_dict(self) -> dict[str, Any]:
        """Its numbers for `results.json`."""
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
    """The fill factors of both cameras, by the case's key."""

    cameras: Mapping[str, CaseFit]

    def to_dict(self) -> dict[str, Any]:
        """Its numbers for `results.json`."""
        return {key: found.to_dict() for key, found in self.cameras.items()}


def fit_fill_factors(seed: int) -> FillFactors:
    """Fit both cameras' fill factors to one frame of the chart at each luminance.

    Parameters
    ----------
    seed
        Of the study.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3: the fill factor was the one number that they could not measure, and
    the least squared difference between measured and simulated patch means gave 0.9 (D200) and 0.5 (vendor). The
    simulation here begins at these; where it begins does not matter (`photosite.validation.fill_factor`).
    """
    return FillFactors(MappingProxyType({case.key: fit_case(case, seed) for case in CASES}))


def fit_case(case: Case, seed: int) -> CaseFit:
    """Shoot one camera's chart at each luminance, simulate it, and fit."""
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
    """The simulation's frame of the chart, with some fill factor; chip and noise are none of the measured camera's."""
    key = frame_key(seed, f"simulated chart of {case.key} at {luminance_cd_m2:g} cd/m2")
    camera = case.camera(fill_factor)
    # One chip for all seeds would give all of them the same error: its fixed pattern's mean over each patch.
    camera = replace(camera, sensor=camera.sensor.with_(serial=f"{case.key}, simulated {seed}"))
    return camera.capture(case.chart(luminance_cd_m2), case.exposure_s, seed=key)
