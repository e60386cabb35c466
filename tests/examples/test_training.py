"""The training example: calibrated noise beats Gaussian noise on held-out virtual raw frames."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "training" / "train_denoiser.py"


@pytest.mark.slow
def test_calibrated_noise_beats_gaussian_noise() -> None:
    pytest.importorskip("torch", reason="torch (extra ml) is not installed")
    left_db = runpy.run_path(str(SCRIPT))["main"](steps=300)
    calibrated, gaussian = left_db["calibrated"][0], left_db["gaussian"][0]
    assert calibrated < gaussian - 0.1
    assert calibrated < -2
