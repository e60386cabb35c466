"""How often the fit of the fill factor finds the hidden one: the study of section 3 over many seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.studies.farrell2008.cameras import CASES, CHART_COLS, CHART_ROWS, Case
from photosite.studies.farrell2008.fill_factor import fit_case

SEEDS = 100

WITHIN = 2.0
"""Standard errors that count as found."""
WANTED = 0.95

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Recovery:
    """One camera, fitted over many seeds. Arrays are (seeds,).

    Parameters
    ----------
    case
        Which camera; every seed is another one of it, in another light.
    true, fitted, standard_error
        The hidden fill factor, and what was found.
    in_interval
        Whether the 95 % interval holds the hidden one.
    """

    case: Case
    true: NDArray[np.float64]
    fitted: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    in_interval: NDArray[np.bool_]

    @property
    def pulls(self) -> NDArray[np.float64]:
        """Errors in standard errors."""
        return (self.fitted - self.true) / self.standard_error

    @property
    def found(self) -> float:
        """Share within two standard errors."""
        return float(np.mean(np.abs(self.pulls) <= WITHIN))

    @property
    def holds(self) -> bool:
        """Whether that is 95 % or more."""
        return self.found >= WANTED

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "seeds": int(self.true.size),
            "found": self.found,
            "holds": self.holds,
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
    progress: Progress | None = None,
) -> tuple[Recovery, ...]:
    """Fit the fill factor of both cameras for many seeds: other fill factors, chips, noises and sides of the lamp.

    Parameters
    ----------
    seeds
        Of the study; one camera of each kind for each.
    rows, cols
        Size of the frames. Smaller ones have fewer pixels in a patch, and so more noise in its mean.
    progress
        Called with (fits done, fits to do).

    Raises
    ------
    InputError
        If there is no seed.
    """
    if not seeds:
        raise InputError("the recovery of the fill factor is studied over one seed or more, not none")
    found = []
    for number, case in enumerate(CASES):
        # The brightest chart is the one that counts.
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
