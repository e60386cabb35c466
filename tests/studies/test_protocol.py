"""Shooting protocols."""

from __future__ import annotations

from itertools import pairwise

import pytest

from photosite.errors import InputError
from photosite.studies.protocol import ShootingProtocol, Step, paper_d200_protocol, series


def test_counts_and_ranges_are_those_of_the_paper() -> None:
    steps = paper_d200_protocol().steps
    ramp, stack, flats = steps[:19], steps[19], steps[20:]
    assert sum(step.count for step in ramp) == 190
    assert {step.kind for step in ramp} == {"dark"}
    assert (ramp[0].exposure_s, ramp[-1].exposure_s) == (1 / 8000, 30)
    assert stack == Step("dark", 1 / 8000, 150)
    assert sum(step.count for step in flats) == 65
    assert {step.kind for step in flats} == {"light"}
    assert (flats[0].exposure_s, flats[-1].exposure_s) == (1 / 8000, 1 / 25)


def test_series_has_equal_ratios() -> None:
    times = [step.exposure_s for step in series("dark", 1e-3, 10, exposures=9, count=2)]
    ratios = [b / a for a, b in pairwise(times)]
    assert ratios == pytest.approx([10**0.5] * 8, rel=1e-9)


def test_longest_light() -> None:
    assert paper_d200_protocol().longest_light_s == 1 / 25
    assert ShootingProtocol("darks", (Step("dark", 30, 2),)).longest_light_s is None


@pytest.mark.parametrize(
    ("kind", "exposure_s", "count"), [("flat", 1.0, 1), ("dark", 0.0, 1), ("dark", float("nan"), 1), ("dark", 1.0, 0)]
)
def test_invalid_steps(kind: str, exposure_s: float, count: int) -> None:
    with pytest.raises(InputError):
        Step(kind, exposure_s, count)  # type: ignore[arg-type]


def test_empty_protocol_and_short_series() -> None:
    with pytest.raises(InputError) as caught:
        ShootingProtocol("nothing", ())
    assert caught.value.what == "steps"
    with pytest.raises(InputError) as caught:
        series("dark", 1e-3, 1, exposures=1, count=2)
    assert (caught.value.what, caught.value.value) == ("exposures", 1)
