"""Coverage of the intervals of image quality, and that every measurement with intervals takes part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.metrics.registry import measurements
from photosite.studies.image_quality import image_quality_study, measure_chart
from photosite.studies.measurement_study import WITHOUT_DRAWS, measurement_studies
from photosite.studies.outcome import Outcome

TABLE = Path(__file__).parents[2] / "docs/validation/image-quality-coverage.md"
CHARTS, MOST_MISSED = 12, 4
"""Of 12 charts, correct intervals of a quantity miss 5 or more in 1 of 5000 runs; half as wide ones miss 4."""
SLOW_CHARTS, LEAST_PROBABILITY = 200, 1e-3
"""Correct intervals of a quantity are that far from 95 % in 1 of 1000 runs."""


def test_every_measurement_takes_part_or_has_a_reason() -> None:
    drawn, excused = set(measurement_studies()), set(WITHOUT_DRAWS)
    assert not drawn & excused
    assert drawn | excused == set(measurements())


def test_every_measurement_is_in_the_documented_table() -> None:
    """`photosite reproduce image-quality --measurement ID --table FILE` adds a row."""
    names = [line.split("`")[1] for line in TABLE.read_text(encoding="utf-8").splitlines()[2:]]
    assert names == list(measurements())


@pytest.mark.parametrize("name", measurement_studies())
def test_intervals_contain_the_truth(name: str) -> None:
    study = image_quality_study([name], charts=CHARTS, processes=1)
    assert not study.refused
    missed = {row.quantity: row.charts * (1.0 - row.covered) for row in study.rows}
    assert missed
    assert max(missed.values()) <= MOST_MISSED, missed


@pytest.mark.slow
@pytest.mark.parametrize("name", measurement_studies())
def test_coverage(name: str) -> None:
    study = image_quality_study([name], charts=SLOW_CHARTS)
    outside = {row.quantity: row.covered for row in study.rows if row.probability < LEAST_PROBABILITY}
    assert not outside


def test_intervals_that_are_too_narrow_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fifth of the width holds 31 % of the truths."""
    compare = "photosite.studies.image_quality.compare_estimate"

    def narrow(estimate, truth):  # type: ignore[no-untyped-def]
        low, high = ((end - estimate.value) / 5.0 + estimate.value for end in estimate.interval_95)
        return Outcome.of(estimate.value, estimate.standard_uncertainty, (low, high), truth)

    monkeypatch.setattr(compare, narrow)
    (row, *_) = image_quality_study(["flicker"], charts=CHARTS, processes=1).rows
    assert row.charts * (1.0 - row.covered) > MOST_MISSED


def test_draws_are_repeatable_and_differ() -> None:
    one, again, other = (measure_chart("flicker", number).outcomes for number in (0, 0, 1))
    assert one == again
    assert one != other


def test_measurements_without_draws_are_refused() -> None:
    with raises(InputError, what="measurement"):
        image_quality_study(["chart-light"])
    with raises(InputError, what="measurement"):
        image_quality_study(["sharpness"])


def test_the_table_lists_all_measurements() -> None:
    study = image_quality_study(["flicker"], charts=2, processes=1)
    lines = study.markdown("| `edge-sfr` | kept |").splitlines()[2:]
    assert [line.split("`")[1] for line in lines] == list(measurements())
    assert [line for line in lines if "kept" in line] == ["| `edge-sfr` | kept |"]
    assert np.isclose(study.to_dict()["measurements"]["flicker"]["covered"], study.pooled("flicker"))
