"""Figures 1 to 5: the chart captured with each camera and simulated, compared patch by patch and in colour."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.develop.color_matrix import ColorMatrix, fit_color_matrix
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import PatchStatistics
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import CASES, Case, MeasuredCamera
from photosite.studies.farrell2008.fill_factor import FillFactors, simulate_chart
from photosite.validation.charts import chart_xyz_d65
from photosite.validation.color import ColorComparison
from photosite.validation.result import Validation
from photosite.validation.validate import validate

FORMULAS = MappingProxyType({"76": "CIE 1976", "94": "CIE 1994", "2000": "CIEDE2000"})
"""Colour difference formulas: suffix of their names in `ColorMatrix`, and label."""


@dataclass(frozen=True, eq=False)
class Colors:
    """Figure 5 for one camera: accuracy of the best 3 x 3 matrix from camera RGB to XYZ under D65.

    Parameters
    ----------
    names
        Patches that saturate no channel.
    measured, simulated
        Matrix of each camera, fitted to its own patches, with the remaining colour differences: of the fitted patches,
        and of each patch with a matrix fitted to the others.
    between
        Measured against simulated patches, both with the matrix of the simulation.
    """

    names: tuple[str, ...]
    measured: ColorMatrix
    simulated: ColorMatrix
    between: ColorComparison

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "patches": list(self.names),
            **{
                which: {
                    "matrix": matrix.matrix.tolist(),
                    **{f"delta_e_{key}": differences(matrix, key).tolist() for key in FORMULAS},
                    **{f"delta_e_{key}_left_out": differences(matrix, key, True).tolist() for key in FORMULAS},
                    "mean": {
                        key: {
                            "fitted": float(differences(matrix, key).mean()),
                            "left_out": float(differences(matrix, key, True).mean()),
                        }
                        for key in FORMULAS
                    },
                }
                for which, matrix in (("measured", self.measured), ("simulated", self.simulated))
            },
            "measured_against_simulated": {
                f"delta_e_{key}": getattr(self.between, f"delta_e_{key}").tolist() for key in FORMULAS
            },
        }


def differences(matrix: ColorMatrix, formula: str, left_out: bool = False) -> NDArray[np.float64]:
    """Return (patches,) colour differences by a key of `FORMULAS`, fitted or left out of the fit."""
    found: NDArray[np.float64] = getattr(matrix, f"delta_e_{formula}" + "_left_out" * left_out)
    return found


@dataclass(frozen=True, eq=False)
class CameraPatches:
    """The chart captured with one camera, and simulated.

    Parameters
    ----------
    case
        Camera.
    fill_factor
        Fitted fill factor, which the simulation uses.
    measured, simulated
        One frame each, at the brightest luminance.
    comparisons
        Patch means and noise, measured against simulated, by luminance in cd/m2, dimmest first.
    colors
        At the brightest luminance.
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

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "fill_factor_of_the_simulation": self.fill_factor,
            "by_luminance_cd_m2": {f"{level:g}": _patches(found) for level, found in self.comparisons.items()},
            "colors": self.colors.to_dict(),
        }


def _patches(found: Validation) -> dict[str, Any]:
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


def _median(values: NDArray[np.float64]) -> float:
    """Return the median of the absolute values that are not masked."""
    return float(np.median(np.abs(np.ma.compressed(values))))


def snr_difference_db(found: Validation) -> NDArray[np.float64]:
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


def compare_charts(seed: int, fill_factors: FillFactors) -> Patches:
    """Capture and simulate the charts of both cameras with the fitted fill factors, and compare.

    Parameters
    ----------
    seed
        Seed of the study.
    fill_factors
        Result of `fit_fill_factors` for it.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3.
    """
    return Patches(
        MappingProxyType({case.key: _compare(case, seed, fill_factors.cameras[case.key].fit.value) for case in CASES})
    )


def _compare(case: Case, seed: int, fill_factor: float) -> CameraPatches:
    camera = MeasuredCamera.drawn(case, seed)
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
        raise AssertionError(f"no colours to compare: {'; '.join(found.notes)}")
    whole = np.asarray(found.used.all(axis=1), dtype=np.bool_)
    names = tuple(name for name, ok in zip(found.measured.names, whole, strict=True) if ok)
    reference = chart_xyz_d65("macbeth", names)
    order = [found.measured.channels.index(name) for name in "RGB"]
    return Colors(
        names,
        measured=fit_color_matrix(found.measured.mean_dn[whole][:, order], reference),
        simulated=found.color.matrix,
        between=found.color,
    )
