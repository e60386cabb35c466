"""Chapters and the order in which they run."""

from __future__ import annotations

import pytest

from photosite.errors import InputError
from photosite.studies.farrell2008 import study
from photosite.studies.farrell2008.study import CHAPTERS, Chapter, Run, reproduce


class Number:
    def __init__(self, value: int) -> None:
        self.value = value

    def to_dict(self) -> dict[str, int]:
        return {"value": self.value}


def test_chapters_follow_those_they_need() -> None:
    keys = [chapter.key for chapter in CHAPTERS]
    assert len(set(keys)) == len(keys)
    for place, chapter in enumerate(CHAPTERS):
        assert set(chapter.needs) <= set(keys[:place]), chapter.key


def test_chapters_run_in_order_with_the_results_they_need(monkeypatch: pytest.MonkeyPatch) -> None:
    def second(run: Run) -> Number:
        return Number(run.results["first"].value + 1)

    chapters = (
        Chapter("first", "First", lambda run: Number(run.seed)),
        Chapter("other", "Other", lambda run: Number(0)),
        Chapter("second", "Second", second, needs=("first",)),
    )
    monkeypatch.setattr(study, "CHAPTERS", chapters)
    found = reproduce(5, ["second"]).to_dict()
    assert found["chapters"] == {"first": {"value": 5}, "second": {"value": 6}}
    assert list(found["seconds"]) == ["first", "second"]
    assert set(reproduce(5).results) == {"first", "other", "second"}


def test_an_unknown_chapter_is_rejected() -> None:
    with pytest.raises(InputError) as caught:
        reproduce(5, ["tabel1"])
    assert caught.value.hint == "Did you mean 'table1'?"
