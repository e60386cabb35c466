"""`photosite bench`."""

from __future__ import annotations

from typing import Any

import pytest

from photosite.studies.bench import cases
from photosite.studies.bench.timing import Case


@pytest.mark.smoke("bench")
def test_table_and_json_of_a_case(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(1.0, 2.0, 100.0, 10.0)
    monkeypatch.setattr(cases, "CASES", {"one": lambda quick: case})
    assert photosite("bench", "--case", "one", "--json").json["cases"] == {"one": case.to_dict()}
    assert photosite("bench", "--case", "one").out.splitlines()[1].split()[:4] == ["one", "1.000", "2.000", "2.00"]
    assert photosite("bench", "--case", "two").status == 2
