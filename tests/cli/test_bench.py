"""`photosite bench`."""

from __future__ import annotations

from typing import Any

import pytest

from photosite.studies.bench import cases, memory
from photosite.studies.bench.memory import MemoryUse
from photosite.studies.bench.timing import Case


@pytest.mark.smoke("bench")
def test_table_and_json_of_a_case(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(1.0, 2.0, 100.0, 10.0)
    monkeypatch.setattr(cases, "CASES", {"one": lambda quick: case})
    assert photosite("bench", "--case", "one", "--json").json["cases"] == {"one": case.to_dict()}
    assert photosite("bench", "--case", "one").out.splitlines()[1].split()[:4] == ["one", "1.000", "2.000", "2.00"]
    assert photosite("bench", "--case", "two").status == 2


def test_table_and_json_of_memory(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    use = MemoryUse("simulate", "nikon-d200", (0.0, 20.0), (300.0, 500.0))
    monkeypatch.setattr(memory, "measure_memory", lambda commands, sizes, report: [use])
    (found,) = photosite("bench", "--memory", "--json").json["memory"]
    assert (found["peak_mb"], found["bytes_per_pixel"]) == ([300, 500], [10])
    row = photosite("bench", "--memory").out.splitlines()[1].split()
    assert row == ["simulate", "nikon-d200", "300", "10.0"]
    assert photosite("bench", "--memory", "--case", "one").status == 2
