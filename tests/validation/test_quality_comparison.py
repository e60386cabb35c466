"""Tables of image quality compared: values that differ are named, equal cameras agree."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.metrics.measure import ImageQuality, measure
from photosite.studies.virtual_charts import VirtualEdge, virtual_edge
from photosite.validation.quality_comparison import compare_quality, compare_results
from photosite.values.estimate import Estimate

PAIRS = 30


def quality(image: Any) -> ImageQuality:
    return measure(image, "slanted-edge", only=["edge-sfr", "information-capacity"])


def noisy(edge: VirtualEdge, random: np.random.Generator) -> Any:
    """Return the edge with more noise: another frame of one camera has noise of its own."""
    return edge.electrons + random.normal(0.0, 5.0, edge.electrons.shape)


def test_equal_cameras_agree() -> None:
    """Of 30 tables, more than 6 differ by chance in fewer than 1 of 1000 runs."""
    differ = 0
    for seed in range(PAIRS):
        one, other = (quality(virtual_edge(np.random.default_rng(k)).electrons) for k in (seed, seed))
        assert compare_quality(one, other).agrees
        edge = virtual_edge(np.random.default_rng(seed))
        random = np.random.default_rng(1000 + seed)
        differ += not compare_quality(quality(noisy(edge, random)), quality(noisy(edge, random))).agrees
    assert differ <= 6


def test_a_blurred_edge_differs_where_it_should() -> None:
    edge = virtual_edge(np.random.default_rng(3)).electrons
    smooth = np.pad(edge, ((0, 0), (1, 1)), mode="edge")
    blurred = (smooth[:, :-2] + edge + smooth[:, 2:]) / 3.0
    found = {each.name: each for each in compare_quality(quality(edge), quality(blurred)).values}
    assert found["edge-sfr.mtf50.M"].verdict == "differs"
    assert (found["edge-sfr.mtf50.M"].difference or 0.0) > 0.0
    assert found["edge-sfr.mtf50_standard.M"].verdict == "no interval"
    tolerant = compare_quality(quality(edge), quality(blurred), tolerance_percent=300.0)
    assert {each.name: each for each in tolerant.values}["edge-sfr.mtf50.M"].verdict == "agrees"


def test_a_value_that_neither_side_shows_is_missing() -> None:
    result = quality(virtual_edge(np.random.default_rng(3)).electrons)["edge-sfr"]
    hidden = replace(result, values=dict(result.values) | {("mtf50", "M"): Estimate(reason="too blurred")})
    found = {each.name: each.verdict for each in compare_results({"edge": ({"edge-sfr": hidden},) * 2}).values}
    assert found["edge-sfr.mtf50.M"] == "missing"
    assert "agrees" in found.values()


def test_other_charts_and_settings_are_refused() -> None:
    edge = quality(virtual_edge(np.random.default_rng(4)).electrons)
    even = measure(np.random.default_rng(5).poisson(1000.0, (120, 160)), "uniform")
    with raises(InputError, what="chart"):
        compare_quality(edge, even)
    with pytest.raises(InputError):
        compare_quality(edge, edge, level=2.0)
