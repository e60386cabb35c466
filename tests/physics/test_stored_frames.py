"""Stored hashes of three frames: the same seed gives the same frame on every machine and in every version.

From mean electrons to digital numbers, only IEEE arithmetic is used (`engine/random_numbers.py`), so that no library
version may change a frame. Mean electrons of a structured scene use SciPy's transforms and LAPACK, whose rounding
differs between versions and processors by 1e-7 of full scale. These frames therefore start from given means.
"""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.readout import digital_numbers

SENSOR = load_sensor("nikon-d200").with_(rows=120, cols=2050, black_level_dn=64, dark_voltage_mv_per_s=2.0)
RAMP = (np.arange(120 * 2050, dtype=np.float64) ** 2 / 1.2e6).astype(np.float32).reshape(120, 2050)  # 0 to 50 000


@pytest.mark.parametrize(
    ("mean", "seed", "frame", "sha256"),
    [
        (np.zeros_like(RAMP), 1, 0, "bf0fa7254b203229f4b9995146853e93595ab6f1c66ab1c677d4ee52e1aaae3b"),
        (np.full_like(RAMP, 5000.0), 2**40 + 5, 7, "8e6419e9278d9d9de980c4a992eb6f74fd2cef717dda637338e33ae6d37e88c0"),
        (RAMP[::-1], 2008, 2**32 - 1, "14bf6be5aff77995de2e64a6ae305b360f39a3835376f710d94a9ba3a38f6cb9"),
    ],
    ids=["dark", "even", "ramp"],
)
def test_frames_match_stored_hashes(mean: np.ndarray, seed: int, frame: int, sha256: str) -> None:
    dn = digital_numbers(SENSOR, mean, 0.25, seed=seed, frame=frame)
    assert hashlib.sha256(dn.astype("<u2").tobytes()).hexdigest() == sha256
