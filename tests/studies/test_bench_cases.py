"""Benchmark cases that cannot run leave the results of the others."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from photosite.errors import InputError
from photosite.studies.bench import cases
from photosite.studies.bench.timing import Case
from photosite.studies.bench.workers import measure_workers, task_cost


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


def test_the_list_of_benchmarks_has_every_case() -> None:
    text = (Path(__file__).parents[2] / "benchmarks" / "README.md").read_text(encoding="utf-8")
    assert not [name for name in cases.CASES if f"`{name.removesuffix('_cached')}`" not in text]


def test_cases_on_a_gpu_are_left_out_without_one() -> None:
    measured, left_out = cases.run_cases(["gpu_noise"], True, lambda name: None)
    assert measured or "GPU" in left_out["gpu_noise"]


def test_workers_without_the_extra_are_an_error_before_anything_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    begun: list[str] = []
    with pytest.raises(InputError) as caught:
        measure_workers(begun.append)
    assert not begun
    assert "distributed" in (caught.value.hint or "")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/net/dev").exists(), reason="reads the counters of Linux")
def test_a_task_costs_the_scheduler_milliseconds() -> None:
    pytest.importorskip("distributed")
    cost = task_cost(200)
    assert 0.0 < cost.scheduler_cpu_s < cost.seconds < 0.2
    assert 200 < cost.bytes < 50_000
