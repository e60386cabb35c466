"""Benchmark cases that cannot run leave the results of the others."""

from __future__ import annotations

from pathlib import Path

import pytest

from photosite.errors import InputError
from photosite.studies.bench import cases
from photosite.studies.bench.timing import Case
from photosite.studies.bench.workers import task_cost


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


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/net/dev").exists(), reason="reads the counters of Linux")
def test_a_task_costs_the_scheduler_milliseconds() -> None:
    pytest.importorskip("distributed")
    cost = task_cost(200)
    assert 0.0 < cost.scheduler_cpu_s < cost.seconds < 0.2
    assert 200 < cost.bytes < 50_000
