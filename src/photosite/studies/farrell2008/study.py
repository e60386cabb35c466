"""The chapters of the 2008 paper, and how they are run.

A chapter computes its result; `photosite.studies.farrell2008.page` draws it under the same key.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

from photosite.errors import InputError, did_you_mean
from photosite.studies.farrell2008.cameras import CASES, HiddenTruth
from photosite.studies.farrell2008.dim_face import dim_face
from photosite.studies.farrell2008.fill_factor import fit_fill_factors
from photosite.studies.farrell2008.high_dynamic_range import high_dynamic_range
from photosite.studies.farrell2008.patches import compare_charts
from photosite.studies.farrell2008.pixel_size import pixel_sizes
from photosite.studies.farrell2008.snr import snr_against_volts
from photosite.studies.farrell2008.table1 import measure_table1
from photosite.studies.progress import NoProgress, Progress


class Result(Protocol):
    """Result of a chapter."""

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`: plain values that depend on the seed only."""
        ...


@dataclass(frozen=True)
class Run:
    """Input of a chapter.

    Parameters
    ----------
    seed
        Seed of the study; `cameras.frame_key` derives a key for each purpose.
    progress
        Receives stages and frame counts.
    results
        Results of earlier chapters by key.
    """

    seed: int
    progress: Progress
    results: Mapping[str, Any]


@dataclass(frozen=True)
class Chapter:
    """A part of the paper.

    Parameters
    ----------
    key
        Key in `results.json` and in `photosite.studies.farrell2008.page.page.PARTS`.
    title
        Heading.
    compute
        Function that computes the result.
    needs
        Keys of earlier chapters whose results it uses.
    """

    key: str
    title: str
    compute: Callable[[Run], Result]
    needs: tuple[str, ...] = ()


CHAPTERS: tuple[Chapter, ...] = (
    # Section 2.
    Chapter("table1", "Section 2: Table 1 measured", lambda run: measure_table1(run.seed, progress=run.progress)),
    # Section 3.
    Chapter("fill_factor", "Section 3: the fill factor", lambda run: fit_fill_factors(run.seed)),
    Chapter(
        "patches",
        "Figures 1 to 5: the chart, measured and simulated",
        lambda run: compare_charts(run.seed, run.results["fill_factor"]),
        needs=("fill_factor",),
    ),
    # Sections 4 and 5.
    Chapter("snr", "Figure 6: what limits the signal-to-noise ratio", lambda run: snr_against_volts(run.seed)),
    Chapter("pixel_size", "Figure 7: 1.4 µm against 2.2 µm", lambda run: pixel_sizes(run.seed)),
    Chapter("dim_face", "Section 5: a dimly lit face", lambda run: dim_face(run.seed)),
    Chapter("high_dynamic_range", "Section 5: high dynamic range", lambda run: high_dynamic_range(run.seed)),
)
"""In the order of the paper. A new chapter is added here and in `page.page.PARTS`."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Result of the study.

    Parameters
    ----------
    seed
        Seed of the study.
    results
        Results by chapter.
    seconds
        Wall-clock time by chapter.
    """

    seed: int
    results: Mapping[str, Any]
    seconds: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `results.json`, which depends on the seed only, except for `seconds`."""
        return {
            "study": "Farrell, Okincha and Parmar, Sensor calibration and simulation, Proc. SPIE 6817 (2008)",
            "seed": self.seed,
            "measured": (
                "virtual cameras, because the paper's frames were never published; hidden_truth is unknown to the "
                "simulation"
            ),
            "hidden_truth": {case.key: HiddenTruth.drawn(case, self.seed).to_dict() for case in CASES},
            "chapters": {key: result.to_dict() for key, result in self.results.items()},
            "seconds": dict(self.seconds),
        }


def reproduce(seed: int = 2008, keys: Iterable[str] | None = None, progress: Progress | None = None) -> Reproduction:
    """Run the study.

    Parameters
    ----------
    seed
        Seed of all random draws.
    keys
        Chapters to run, with those they need; all by default.
    progress
        Receives stages and frame counts.

    Raises
    ------
    InputError
        If a chapter is unknown.
    """
    progress = progress or NoProgress()
    wanted = _with_needs([chapter.key for chapter in CHAPTERS] if keys is None else list(keys))
    results: dict[str, Any] = {}
    seconds: dict[str, float] = {}
    for chapter in CHAPTERS:
        if chapter.key in wanted:
            begin = time.perf_counter()
            progress.stage(chapter.title)
            results[chapter.key] = chapter.compute(Run(seed, progress, MappingProxyType(results)))
            seconds[chapter.key] = time.perf_counter() - begin
    return Reproduction(seed, results, seconds)


def _with_needs(keys: list[str]) -> set[str]:
    known = {chapter.key: chapter for chapter in CHAPTERS}
    wanted: set[str] = set()
    while keys:
        key = keys.pop()
        if key not in known:
            raise InputError("chapter", value=key, expected="a known name", hint=did_you_mean(key, known))
        if key not in wanted:
            wanted.add(key)
            keys += known[key].needs
    return wanted
