"""Noise that interpolated pixels share, against closed forms of bilinear interpolation."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.develop.demosaic import demosaic
from photosite.metrics.shared_noise import SharedNoise
from photosite.studies.virtual_charts import RGGB
from photosite.studies.virtual_patches import BILINEAR_VARIANCE

# A quarter of the mosaic's pixels is red, half of them green.
PIXELS_PER_SAMPLE = {"R": 4.0, "G": 2.0, "B": 4.0}


@pytest.mark.parametrize("channel", "RGB")
def test_interpolated_pixels_share_the_noise_of_the_mosaic(channel: str) -> None:
    """Of 120 parts with 8 lines each, the estimates scatter by 3 %."""
    random = np.random.default_rng(11)
    parts = [demosaic(random.normal(5.0, 1.0, (66, 66)), RGGB)[1:-1, 1:-1, "RGB".index(channel)] for _ in range(120)]
    found = SharedNoise.of(np.asarray(part, np.float64) for part in parts)
    variance = float(np.mean([np.var(part) for part in parts]))
    assert variance == pytest.approx(BILINEAR_VARIANCE[channel], rel=0.03)
    assert found.of_mean == pytest.approx(PIXELS_PER_SAMPLE[channel] / BILINEAR_VARIANCE[channel], rel=0.12)
    variances = np.array([np.var(part) for part in parts])
    scatter = float(variances.var(ddof=1)) * parts[0].size / (2.0 * variance**2)
    assert found.of_variance == pytest.approx(scatter, rel=0.5)


def test_independent_pixels_share_nothing() -> None:
    random = np.random.default_rng(12)
    found = SharedNoise.of(random.normal(5.0, 1.0, (60, 60)) for _ in range(120))
    assert (found.of_mean, found.of_variance) == pytest.approx((1.0, 1.0), rel=0.12)
    assert SharedNoise.of([np.ones((60, 60))]) == SharedNoise()
