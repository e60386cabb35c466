"""Benchmark cases that cannot run leave the results of the others."""

from __future__ import annotations

import pytest

from photosite.errors import InputError
from photosite.studies.bench import cases
from photosite.studies.bench.timing import Case


def test_a_case_without_its_extra_is_left_out_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(quick: bool) -> Case:
        raise InputError("the format needs photosite's extra 'spectral'")

    result = Case(1.0, 2.0, 100.0, 10.0)
    monkeypatch.setattr(cases, "CASES", {"first": fails, "second": lambda quick: result})
    seen: list[str] = []
    measured, left_out = cases.run_cases((), True, seen.append)
    assert measured == {"second": result}
    assert seen == ["first", "second"]
    assert "spectral" in left_out["first"]


def test_cases_on_a_gpu_are_left_out_without_one() -> None:
    measured, left_out = cases.run_cases(["gpu_noise"], True, lambda name: None)
    assert measured or "GPU" in left_out["gpu_noise"]
