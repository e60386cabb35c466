"""Soft dark spots put into even fields, and noise that hides them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.studies.measurements.dust import SHAPE, random_spots, spotted
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]
RGGB = (("R", "G"), ("G", "B"))


def measured(frame: Array) -> Result:
    image = ChartImage((frame,), "raw", RGGB, black=0.0, white=1e6)
    return measure(image, "uniform", only=["dust"])["dust"]


def test_spots_are_those_put_in() -> None:
    random = np.random.default_rng(61)
    for number in range(12):
        spots = random_spots(random, number % 4)
        found = measured(spotted(random, spots, 10 ** random.uniform(3.7, 4.3)))
        assert found["spots"].value == len(spots)
        if spots:
            area = sum(np.pi * radius**2 for _, _, radius, _ in spots) / np.prod(SHAPE)
            assert found["area_percent"].value == pytest.approx(100 * area, rel=0.25)


def test_clean_noisy_and_structured_fields() -> None:
    random = np.random.default_rng(62)
    assert measured(spotted(random, [], 20000.0))["spots"].value == 0
    noisy = measured(spotted(random, [(240, 320, 8, 0.05)], 60.0))
    assert "noise-hides-dust" in {entry.id for entry in noisy.diagnostics}
    edge = np.where(np.mgrid[: SHAPE[0], : SHAPE[1]][1] > 320, 4000.0, 1000.0)
    image = ChartImage((random.poisson(edge).astype(float),), "raw", white=1e6)
    assert isinstance(measure(image, "uniform", only=["dust"]).results["dust"], Missing)
