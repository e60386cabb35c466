"""S-CIELAB differences of pictures from their chart, against CIEDE2000 of even patches and means of other pictures."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.color.colorimetry import SRGB_FROM_XYZ, adaptation_to_d65, delta_e_2000
from photosite.errors import InputError
from photosite.metrics.chart_image import chart_image
from photosite.metrics.charts.placed_chart import placed_chart
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result

Array = NDArray[np.float64]

SHAPE = (528, 784)
CHART = placed_chart(chart_image(np.ones(SHAPE)), "macbeth")
REFERENCE = CHART.patch_xyz @ adaptation_to_d65(CHART.white_xyz).T
VIEWING = {"pitch_mm": 0.3, "distance_mm": 500.0}


def picture(xyz: Array) -> Array:
    """Return the linear picture of a chart whose patches have these colors, black between them."""
    y, x = CHART.to_scene_grid(np.arange(SHAPE[0]) + 0.5, np.arange(SHAPE[1]) + 0.5)
    image = np.zeros((*SHAPE, 3))
    for region, color in zip(CHART.scene.regions, xyz, strict=True):
        inside = (y > region.r0 - 4) & (y < region.r1 + 4) & (x > region.c0 - 4) & (x < region.c1 + 4)
        image[inside] = color
    return image @ SRGB_FROM_XYZ.T


def measured(image: Array, **options: float | bool) -> Result:
    options = VIEWING | {"match_exposure": False} | options
    return measure(image, "macbeth", only=["scielab-difference"], options={"scielab-difference": options})[
        "scielab-difference"
    ]


def test_even_patches_have_the_plain_differences() -> None:
    """Patches are wide: what surrounds them changes the mean by the weak and wide part of the filters only."""
    assert measured(picture(REFERENCE))["mean"].value == pytest.approx(0.0, abs=0.02)
    changed = REFERENCE * [1.04, 1.0, 0.94]
    expected = delta_e_2000(REFERENCE, changed)
    found = measured(picture(changed), distance_mm=250.0)
    assert found["mean"].value == pytest.approx(expected.mean(), rel=0.03)
    assert found.curves[0].y == pytest.approx(expected, rel=0.12)
    assert found["percentile_95"].value == pytest.approx(np.percentile(expected, 95), rel=0.06)
    brighter = picture(1.2 * REFERENCE)
    assert measured(brighter, match_exposure=True)["mean"].value == pytest.approx(0.0, abs=0.02)
    assert (measured(brighter)["mean"].value or 0) > 3


def test_fine_patterns_are_not_seen_from_afar() -> None:
    image = picture(REFERENCE)
    image = image * (1 + 0.1 * (-1) ** np.arange(SHAPE[1])[None, :, None])
    near, far = (measured(image, distance_mm=distance)["mean"].value or 0 for distance in (100.0, 800.0))
    assert near > 2 > 0.2 > far


def test_intervals_hold_the_means_of_other_pictures() -> None:
    """Of 2 cameras with 40 pictures each, 95 % intervals of 80 miss more than 10 in 1 of 150 runs."""
    random = np.random.default_rng(20261211)
    missed = {"mean": 0, "percentile_95": 0}
    for _ in range(2):
        camera = picture(REFERENCE * (1 + random.normal(0, 0.04, (24, 3))))
        sigma = random.uniform(0.01, 0.04)
        shown = [
            measured(camera + random.normal(0, sigma, camera.shape) * np.sqrt(camera.clip(0.01))) for _ in range(40)
        ]
        for name in missed:
            truth = np.mean([each[name].value for each in shown])
            missed[name] += sum(
                not low <= truth <= high for low, high in (each[name].interval_95 or (0, 0) for each in shown)
            )
    print({name: f"{100 * (1 - each / 80):.0f} %" for name, each in missed.items()})
    assert max(missed.values()) <= 10, missed


def test_raw_frames_are_refused() -> None:
    with pytest.raises(InputError):
        measured(np.full(SHAPE, 100.0))
