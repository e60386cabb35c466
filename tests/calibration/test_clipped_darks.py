"""Cameras without a pedestal, from frames to parameters: the truth is found, and the method is named.

Twelve virtual sensors whose darks are clipped at 0, six of them Bayer, with frames of the simple generator. A pull is
error over standard uncertainty: one in 2000 is beyond 3.5, and the root mean square of 12 lies outside 0.5 to 1.6 once
in 250. Seeds are fixed.
"""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import FrameSet
from photosite.studies.closed_loop import compared_parameters
from photosite.studies.protocol import paper_d200_protocol
from photosite.studies.virtual_lab import virtual_lab

PARAMETERS = (
    "read_noise_dn",
    "dsnu_dn",
    "black_level_dn",
    "dark_current_e_per_s",
    "system_gain_dn_per_e",
    "prnu_percent",
    "quantum_efficiency_percent",
    "temporal_dark_noise_e",
    "dsnu1288_e",
    "dsnu1288_row_e",
    "prnu1288_percent",
)


@pytest.mark.slow
def test_the_truth_is_found(virtual):
    """The black level is between 0 and 1.5 standard deviations of the dark."""
    found = {name: [] for name in PARAMETERS}
    for seed in range(12):
        cfa = "rggb" if seed % 2 else "mono"
        base = virtual.sensor(seed, cfa=cfa, rows=72, cols=80)
        # Normal noise, as in the model: a few electrons of dark signal would have the skew of a Poisson distribution.
        base = base.with_(
            read_noise_mv=max(base.noise.read_noise_mv.value, 6.0 * base.mv_per_dn * base.system_gain_dn_per_e)
        )
        dark_dn = np.hypot(base.noise.read_noise_mv.value, base.noise.dsnu_mv.value) / base.mv_per_dn
        black = float(max(0.0, np.random.default_rng([seed, 5]).uniform(-0.5, 1.5) * dark_dn))
        sensor = base.with_(black_level_dn=black, dark_voltage_mv_per_s=0.1 * dark_dn * base.mv_per_dn)
        calibration = calibrate(virtual.frame_set(sensor, seed, dark_frames=32, repeats=5, levels=8))
        truth = virtual.truth(sensor, photons_known=cfa == "mono")
        for name in PARAMETERS:
            entry = getattr(calibration, name)
            if name not in truth:
                continue
            assert entry.value is not None, (seed, name, entry.reason)
            found[name].append((entry.value - truth[name]) / entry.standard_uncertainty)
        assert "clipped-darks" in limits(calibration)
        assert calibration.dcnu_percent.reason_id == "clipped-darks"
    for name, values in found.items():
        pulls = np.array(values)
        print(name, pulls.round(1))
        assert np.abs(pulls).max() < 3.5, name
        assert 0.4 < np.sqrt(np.mean(pulls**2)) < 1.6, name


def test_table_1_of_a_d200_without_a_pedestal():
    """The paper's protocol on a small chip; pulls as above."""
    lab = virtual_lab(ps.load_sensor("nikon-d200").with_(rows=48, cols=72), paper_d200_protocol(), seed=1)
    calibration = calibrate(lab.frame_set())
    rows = {row.name: row for row in compared_parameters(lab, calibration)}
    for name in ("read_noise_mv", "dsnu_mv", "prnu_percent", "dark_voltage_mv_per_s", "system_gain_dn_per_e"):
        assert abs(rows[name].deviation) < 3.3, rows[name]
    assert rows["read_noise_mv"].standard_uncertainty < 0.002
    assert rows["dsnu_mv"].standard_uncertainty < 0.02


def test_column_parts_are_corrected_for_clipping():
    """Column and pixel offsets, half of the numbers clipped: unscaled, the column part would be half of the truth."""
    gain, rng = 0.25, np.random.default_rng(9)
    columns = rng.normal(0.0, 0.8, 120)
    offset = rng.normal(0.0, 1.6, (100, 120)) + columns

    def shot(electrons):
        dn = gain * rng.poisson(electrons, offset.shape) + offset + rng.normal(0.0, 2.0, offset.shape)
        return np.clip(np.rint(dn), 0, 4095).astype(np.uint16)

    frames = [("dark", 0.01, shot(0.0)) for _ in range(32)]
    frames += [("light", 0.01 * k, shot(1500.0 * k)) for k in (1, 2, 4, 6, 8) for _ in range(4)]
    calibration = calibrate(FrameSet.from_arrays(frames, bits=12))
    for name, spread in (("column", columns.std()), ("row", 0.0), ("pixel", 1.6)):
        low, high = getattr(calibration, f"dsnu1288_{name}_e").interval_95
        assert low <= spread / gain < high, (name, low, spread / gain, high)
    low, high = calibration.dsnu1288_column_e.interval_95
    assert low > 0.65 * columns.std() / gain


def test_darks_on_a_pedestal_need_no_censored_fit(virtual):
    frames = virtual.frame_set(virtual.sensor(1, rows=32, cols=48), 1, dark_frames=8, repeats=3, levels=5)
    calibration = calibrate(frames)
    assert "clipped-darks" not in limits(calibration)
