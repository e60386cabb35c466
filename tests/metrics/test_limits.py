"""Limits of image quality: their verdicts, and files that are wrong."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from photosite.errors import FileError, InputError
from photosite.metrics.limits import Limit, Limits, load_limits
from photosite.metrics.measure import measure
from photosite.studies.virtual_charts import virtual_edge
from photosite.values.estimate import Estimate


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        (Estimate(0.35, 0.01), ("pass", "pass")),
        (Estimate(0.31, 0.01), ("undecided", "pass")),
        (Estimate(0.29, 0.01), ("undecided", "fail")),
        (Estimate(0.25, 0.01), ("fail", "fail")),
        (Estimate(0.35), ("pass", "pass")),
        (Estimate(reason="no edge"), ("missing", "missing")),
    ],
)
def test_verdict_with_and_without_the_interval(estimate: Estimate, expected: tuple[str, str]) -> None:
    limit = Limit.parse("edge-sfr.mtf50.G >= 0.3")
    assert (limit.verdict(estimate, "interval"), limit.verdict(estimate, "value")) == expected
    upper = Limit.parse("edge-sfr.mtf50 <= 0.3")
    assert upper.verdict(Estimate(0.25, 0.01), "interval") == "pass"


def test_every_part_and_missing_measurements() -> None:
    edge = virtual_edge(np.random.default_rng(1)).electrons
    picture = np.stack([edge] * 3, axis=-1) / edge.max() / 1.1
    limits = Limits((Limit.parse("edge-sfr.mtf50 >= 0.01"), Limit.parse("noise.snr_18_db >= 20")))
    judged = limits.judge(measure(picture, "slanted-edge"))
    assert [(row.part, row.verdict) for row in judged.rows] == [
        *((part, "pass") for part in "RGBY"),
        ("", "missing"),
    ]
    assert not judged.passed
    assert pickle.loads(pickle.dumps(judged)).to_dict() == judged.to_dict()
    assert Limits(limits.limits[:1]).judge(measure(picture, "slanted-edge")).passed


@pytest.mark.parametrize(
    "text",
    ["mtf50 >= 0.3", "edge-sfr.mtf50 > 0.3", "edge-sfr.mtf50 >= wide", "edgesfr.mtf50 >= 1", "edge-sfr.mtf51 >= 1"],
)
def test_wrong_limits_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        Limit.parse(text)
    file = tmp_path / "a.limits.yaml"
    file.write_text(f"photosite_limits: 1\nlimits:\n  - edge-sfr.mtf50 >= 0.1\n  - {text}\n", encoding="utf-8")
    with pytest.raises(FileError) as caught:
        load_limits(file)
    assert caught.value.line == 4
