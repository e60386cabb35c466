"""S-CIELAB differences of pictures from their chart, against CIEDE2000 of even patches and other pictures."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.color.colorimetry import delta_e_2000
from photosite.errors import InputError
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.studies.measurements.scielab_difference import SHAPE, VIEWING, picture_of, reference_xyz

Array = NDArray[np.float64]

REFERENCE = reference_xyz()


def measured(image: Array, **options: float | bool) -> Result:
    options = VIEWING | {"match_exposure": False} | options
    return measure(image, "macbeth", only=["scielab-difference"], options={"scielab-difference": options})[
        "scielab-difference"
    ]


def test_even_patches_have_the_plain_differences() -> None:
    """Patches are wide: what surrounds them changes the mean by the weak and wide part of the filters only."""
    assert measured(picture_of(REFERENCE))["mean"].value == pytest.approx(0.0, abs=0.02)
    changed = REFERENCE * [1.04, 1.0, 0.94]
    expected = delta_e_2000(REFERENCE, changed)
    found = measured(picture_of(changed), distance_mm=250.0)
    assert found["mean"].value == pytest.approx(expected.mean(), rel=0.03)
    assert found.curves[0].y == pytest.approx(expected, rel=0.12)
    assert found["percentile_95"].value == pytest.approx(np.percentile(expected, 95), rel=0.06)
    brighter = picture_of(1.2 * REFERENCE)
    assert measured(brighter, match_exposure=True)["mean"].value == pytest.approx(0.0, abs=0.02)
    assert (measured(brighter)["mean"].value or 0) > 3


def test_fine_patterns_are_not_seen_from_afar() -> None:
    image = picture_of(REFERENCE)
    image = image * (1 + 0.1 * (-1) ** np.arange(SHAPE[1])[None, :, None])
    near, far = (measured(image, distance_mm=distance)["mean"].value or 0 for distance in (100.0, 800.0))
    assert near > 2 > 0.2 > far


def test_raw_frames_are_refused() -> None:
    with pytest.raises(InputError):
        measured(np.full(SHAPE, 100.0))


def test_uncertainty_is_the_scatter_of_pictures_where_the_eye_blurs_over_patches() -> None:
    """The eye shares noise over 39 pixels of patches of 60. Variances of 24 patches in 10 pictures scatter by 10 %."""
    random = np.random.default_rng(20261129)
    clean = picture_of(REFERENCE * [1.04, 1.0, 0.94])
    noise = 0.01 * np.sqrt(clean.clip(0.01))
    curves = [
        measured(clean + noise * random.standard_normal(clean.shape), distance_mm=700.0).curves[0] for _ in range(10)
    ]
    scatter = np.var([curve.y for curve in curves], axis=0, ddof=1)
    stated = np.mean([np.square(curve.standard_uncertainty) for curve in curves], axis=0)
    assert float(np.mean(scatter / stated)) == pytest.approx(1.0, abs=0.35)
