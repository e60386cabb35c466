"""Images of charts: what measurements share."""

from __future__ import annotations

import numpy as np

from photosite.metrics.chart_image import chart_image
from photosite.metrics.measure import measure
from photosite.metrics.plane_fit import without_plane


def test_what_a_key_holds_is_made_once() -> None:
    image, made = chart_image(np.ones((8, 8))), []
    for _ in range(3):
        assert image.shared("dots", lambda: made.append(1) or len(made)) == 1
    assert image.shared("lines", lambda: len(made) + 1) == 2


def test_results_with_other_options_are_not_shared() -> None:
    y, x = np.mgrid[:128, :128] + 0.5
    image = chart_image(np.random.default_rng(1).poisson(100 + 300 / (1 + np.exp(-(x - 64 + 0.09 * (y - 64)) / 0.8))))
    one, other = (measure(image, "slanted-edge", options={"edge-sfr": {"order": order}}) for order in (1, 3))
    assert one["edge-sfr"]["mtf50"].value != other["edge-sfr"]["mtf50"].value


def test_weighted_planes_are_those_of_repeated_values() -> None:
    random = np.random.default_rng(2)
    row, col, values = random.normal(size=(3, 20))
    count = random.integers(1, 5, 20)
    once = without_plane(values, row, col, count.astype(float))
    repeated = without_plane(np.repeat(values, count), np.repeat(row, count), np.repeat(col, count))
    assert np.allclose(np.repeat(once, count), repeated, atol=1e-12)
    assert abs(count @ once) < 1e-12
    assert abs((count * row) @ once) < 1e-12
