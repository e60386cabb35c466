"""Detection of targets against closed forms of a Gaussian blur and white noise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.studies.measurements.target_detection import CONTRAST, DIAMETER_PX
from photosite.studies.measurements.target_detection import noisy_edge as edge

Array = NDArray[np.float64]


def measured(frame: Array) -> Result:
    own = {"contrast": CONTRAST, "diameter_px": DIAMETER_PX, "focal_length_mm": 50.0, "pitch_um": 5.0}
    found = measure(frame, "slanted-edge", only=["target-detection"], options={"target-detection": own})
    return found["target-detection"]


def test_ranges_are_those_of_the_cycles() -> None:
    """A target of 2.3 m with N cycles at the resolved frequency: range = size focal length frequency / (N pitch)."""
    found = measured(edge(np.random.default_rng(32), 1.0, 500, 2000, 20))
    resolved = found["resolved"].value or 0.0
    for task, cycles in (("detection", 1), ("recognition", 4), ("identification", 8)):
        assert found[f"{task}_range"].value == pytest.approx(2.3 * 0.05 * resolved / (cycles * 5e-6))


def test_spectrum_of_the_noise_is_used() -> None:
    """Blurring noise and target alike leaves the ideal observer's SNR; taking the noise as white would raise it."""
    random = np.random.default_rng(33)
    sharp, smooth = [], []
    for _ in range(6):
        frame = edge(random, 1.0, 500, 3000, 60)
        sharp.append(measured(frame)["snr_gaussian"].value)
        found = measured(gaussian_filter(frame, 0.7, mode="reflect"))
        smooth.append(found["snr_gaussian"].value)
        assert "colored-noise-beside-edge" in {entry.id for entry in found.diagnostics}
    assert np.mean(smooth) == pytest.approx(np.mean(sharp), rel=0.05)
