"""Coverage with defective pixels: every kind is found, and the pooled intervals contain the truth."""

from __future__ import annotations

import pytest

from photosite.studies.defective_pixels import KINDS, DefectCoverage, defect_coverage, measure_sensor


def pooled(rows: list[DefectCoverage]) -> float:
    return sum(row.covered for row in rows) / sum(row.intervals for row in rows)


def test_each_kind_is_found() -> None:
    rows = defect_coverage(1, fractions=(1e-2,), processes=1)
    assert [row.kind for row in rows] == ["none", *KINDS]
    for row in rows:
        assert row.refused == row.withheld == row.missed == row.others == 0, row
        assert row.largest < 4.5, row


@pytest.mark.slow
def test_intervals_contain_the_truth() -> None:
    """10 sensors of each kind and fraction: 2000 intervals, of which 93 to 97 % contain the truth."""
    rows = defect_coverage(10)
    assert not any(row.refused for row in rows)
    assert 0.93 < pooled(rows) < 0.97


@pytest.mark.parametrize("number", [13, 22, 28])
def test_a_cluster_that_fills_half_of_a_block_is_found(number: int) -> None:
    result = measure_sensor("dead cluster", 0.01, number)
    assert result is not None
    assert result[1] == (123, 0, 0)
