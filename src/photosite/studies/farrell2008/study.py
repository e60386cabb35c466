"""The 2008 paper from its calibration to its applications: which chapters there are, and how they are run.

A chapter computes and does not draw; what is drawn of it stands in `photosite.studies.farrell2008.page`, under the
same key.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

from photosite.errors import InputError, did_you_mean
from photosite.studies.closed_loop.study import Silence, Watcher
from photosite.studies.farrell2008.cameras import CASES, HiddenTruth
from photosite.studies.farrell2008.dim_face import dim_face
from photosite.studies.farrell2008.fill_factor import fit_fill_factors
from photosite.studies.farrell2008.high_dynamic_range import high_dynamic_range
from photosite.studies.farrell2008.patches import compare_charts
from photosite.studies.farrell2008.pixel_size import pixel_sizes
from photosite.studies.farrell2008.snr import snr_against_volts
from photosite.studies.farrell2008.table1 import measure_table1


class Result(Protocol):
    """What a chapter gives."""

    def to_dict(self) -> dict[str, Any]:
        """Its numbers for `results.json`: plain values, the same for the same seed, no time that anything took."""
        ...


@dataclass(frozen=True)
class Run:
    """What a chapter is given.

    Parameters
    ----------
    seed
        Of the study; `cameras.frame_key` makes a key of its own for each use.
    watch
        Is told of stages, and of frames within one.
    results
        What earlier chapters gave, by key.
    """

    seed: int
    watch: Watcher
    results: Mapping[str, Any]


@dataclass(frozen=True)
class Chapter:
    """A part of the paper.

    Parameters
    ----------
    key
        In `results.json`, and in `photosite.studies.farrell2008.page.page.PARTS`.
    title
        Its heading.
    compute
        What makes its result.
    needs
        Earlier chapters whose results it uses.
    """

    key: str
    title: str
    compute: Callable[[Run], Result]
    needs: tuple[str, ...] = ()


CHAPTERS: tuple[Chapter, ...] = (
    # Section 2.
    Chapter("table1", "Section 2: Table 1 measured", lambda run: measure_table1(run.seed, watch=run.watch)),
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
"""In the order of the paper. A chapter is registered here, and its drawing in `report.farrell2008.page.PARTS`."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The paper, reproduced.

    Parameters
    ----------
    seed
        What it was drawn from.
    results
        By chapter.
    seconds
        Wall-clock time of each.
    """

    seed: int
    results: Mapping[str, Any]
    seconds: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """`results.json`: the same for the same seed, apart from `seconds`."""
        return {
            "study": "Farrell, Okincha and Parmar, Sensor calibration and simulation, Proc. SPIE 6817 (2008)",
            "seed": self.seed,
            "measured": (
                "virtual cameras, because the paper's frames were never published; hidden_truth is what the "
                "simulation was not told"
            ),
            "hidden_truth": {case.key: HiddenTruth.drawn(case, self.seed).to_dict() for case in CASES},
            "chapters": {key: result.to_dict() for key, result in self.results.items()},
            "seconds": dict(self.seconds),
        }


def reproduce(seed: int = 2008, keys: Iterable[str] | None = None, watch: Watcher | None = None) -> Reproduction:
    """Run the study.

    Parameters
    ----------
    seed
        Everything that is drawn follows from it.
    keys
        Chapters to run, with those they need; all if None.
    watch
        Is told of stages and frames.

    Raises
    ------
    InputError
        If a chapter is unknown.
    """
    watch = watch or Silence()
    wanted = _with_needs([chapter.key for chapter in CHAPTERS] if keys is None else list(keys))
    results: dict[str, Any] = {}
    seconds: dict[str, float] = {}
    for chapter in CHAPTERS:
        if chapter.key in wanted:
            begin = time.perf_counter()
            watch.stage(chapter.title)
            results[chapter.key] = chapter.compute(Run(seed, watch, MappingProxyType(results)))
            seconds[chapter.key] = time.perf_counter() - begin
    return Reproduction(seed, results, seconds)


def _with_needs(keys: list[str]) -> set[str]:
    known = {chapter.key: chapter for chapter in CHAPTERS}
    wanted: set[str] = set()
    while keys:
        key = keys.pop()
        if key not in known:
            raise InputError(f"the study has no chapter '{key}'. {did_you_mean(key, known)}")
        if key not in wanted:
            wanted.add(key)
            keys += known[key].needs
    return wanted
