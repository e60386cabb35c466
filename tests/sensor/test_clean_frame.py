"""The frame without noise is the mean of many frames with noise."""

import numpy as np
import pytest

import photosite as ps
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.readout import digital_numbers

EFFECTS = {
    "none": {},
    "curve": {"response_curve": {"polynomial_percent": [0.0, -20.0]}},
    "multiplication": {"em_gain": {"gain": 40, "register_well_e": 60000}},
    "coupling": {"interpixel_capacitance": {"coupling_percent": 4, "diagonal_percent": 1}},
    "transfer": {"charge_transfer": {"parallel_inefficiency": 1e-3, "output": "bottom_right"}},
    "blooming": {"blooming": {"drained": 0.5}},
    "bits": {"output": {"dropped_bits": 4}},
    "subtraction": {"output": {"subtract_black_level": True}},
    "companding": {"output": {"companding": "square_root", "companded_bits": 8}},
    "all": {
        "em_gain": {"gain": 40},
        "interpixel_capacitance": {"coupling_percent": 4},
        "blooming": {},
        "charge_transfer": {"serial_inefficiency": 1e-3},
        "output": {"dropped_bits": 2, "rescaled": True},
    },
}


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS.keys())
def test_mean_of_many_frames(effects) -> None:
    sensor = ps.load_sensor("nikon-d200").with_(
        rows=24,
        cols=40,
        bits=14,
        read_noise_e=3,
        dsnu_e=0,
        prnu_percent=0,
        black_level_dn=200,
        well_capacity_e=3000,
        system_gain_dn_per_e=0.1 if "em_gain" in effects else 4.0,
        **effects,
    )
    light = np.geomspace(60, 2500, 40, dtype=np.float32) * np.ones((24, 1), np.float32)
    light[10:12, 20:24] = 4000.0
    frames = np.array([digital_numbers(sensor, light, 0.01, seed=2, frame=n) for n in range(64)], np.float64)
    error = frames.mean(axis=0) - clean_numbers(sensor, light)
    standard_error = np.sqrt(frames.var(axis=0) / 64 + 1 / 12 / 64)
    if "blooming" in effects:
        # At the brink of a full well the mean of a pixel is not that of its mean charge.
        error, standard_error = error[:8], standard_error[:8]
    # 960 pixels: a deviation of one by 5.5 standard errors is a false alarm in 3e-5 for each effect.
    assert np.abs(error / standard_error).max() < 5.5
    assert abs(error.mean() / np.sqrt((standard_error**2).mean()) * np.sqrt(error.size)) < 5
