"""Stages on the charge and behind the converter, against closed forms, SciPy's distributions and plain NumPy loops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import convolve
from scipy.signal import correlate2d
from scipy.stats import gamma, ks_2samp, kstest
from tests.helpers.raising import raises

import photosite as ps
from photosite.engine.charge_stages import bloom_columns, couple_pixels, multiply_charge, transfer_charge
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure
from photosite.errors import InputError
from photosite.sensor.effects.charge_transfer import late_shares
from photosite.sensor.effects.em_gain import EmGain
from photosite.sensor.effects.interpixel_capacitance import InterpixelCapacitance
from photosite.sensor.effects.output import Output
from photosite.sensor.readout import digital_numbers

SENSOR = ps.load_sensor("nikon-d200").with_(rows=120, cols=150, black_level_dn=64, well_capacity_e=25000)
MEAN = np.tile(np.linspace(0, 60000, 150, dtype=np.float32), (120, 1))
MEAN[20::3] = 500  # room for charge that flows over
EXPOSURE = Exposure(1.0, 1e15, 1.0, 0.0, 65535.0, 0, 0, 400, np.uint32(3), np.uint32(5), np.uint32(6))
EFFECTS: dict[str, dict[str, Any]] = {
    "blooming": {"drained": 0.3},
    "charge_transfer": {"parallel_inefficiency": 1e-4, "serial_inefficiency": 2e-4},
    "em_gain": {"gain": 1.2, "clock_induced_charge_e": 0.1},
    "interpixel_capacitance": {"coupling_percent": 2, "diagonal_percent": 0.2},
    "converter_error": {"error_lsb": [0, 2, -1, 0]},
    "output": {"dropped_bits": 1},
}


def frame(sensor: ps.Sensor, mean: np.ndarray = MEAN, **options: Any) -> np.ndarray:
    return digital_numbers(sensor, mean, 0.5, seed=3, frame=2, **options)


def quiet(**effects: Any) -> ps.Sensor:
    """A sensor with shot noise alone, 1 DN per electron."""
    return SENSOR.with_(
        rows=300, cols=400, bits=16, black_level_dn=100, system_gain_dn_per_e=1.0, well_capacity_e=1e6,
        read_noise_mv=0, dsnu_mv=0, prnu_percent=0, dark_voltage_mv_per_s=0, **effects,
    )  # fmt: skip


@pytest.mark.parametrize("names", [[name] for name in EFFECTS] + [list(EFFECTS)], ids=lambda names: "+".join(names))
def test_regions_are_parts_of_the_frame(names: list[str]) -> None:
    sensor = SENSOR.with_(**{name: EFFECTS[name] for name in names})
    whole = frame(sensor)
    assert (whole != frame(SENSOR)).any()
    for r0, r1, c0, c1 in ((0, 1, 0, 1), (17, 50, 3, 150), (119, 120, 0, 150), (60, 61, 70, 75)):
        assert (frame(sensor, region=(r0, r1, c0, c1)) == whole[r0:r1, c0:c1]).all()


def electrons(values: Any) -> np.ndarray:
    return read_only(np.array(values, np.float32))


def test_blooming_keeps_the_charge_that_is_not_drained() -> None:
    charge = np.zeros((101, 70))
    charge[50, 3], charge[0, 66], charge[:, 40] = 10_500, 5000, 2000
    for kept in (1.0, 0.25):
        found = bloom_columns(electrons(charge), 1000.0, kept).astype(float)
        assert found.max() <= 1000.0
        assert found[:, 3].sum() == 1000 + kept * 9500
        assert (found[:, 3] == found[::-1, 3]).all(), "half each way"
        assert (found[:, 66] == np.minimum(np.maximum(1000 + kept * 4000 - 1000.0 * np.arange(101), 0), 1000)).all()
        assert (found[:, 40] == 1000).all(), "no room in the column"
    assert found.sum() == found[:, [3, 40, 66]].sum(), "no flow between columns"


def clocked(charge: np.ndarray, inefficiency: float, clocks: int) -> np.ndarray:
    """Clock a register, transfer by transfer, in plain loops."""
    register, out = [*charge, *np.zeros(clocks - len(charge))], []
    for _ in range(clocks):
        moved = [(1 - inefficiency) * x for x in register]
        left = [inefficiency * x for x in register]
        out.append(moved[0])
        register = [a + b for a, b in zip(left, [*moved[1:], 0.0], strict=True)]
    return np.array(out)


def test_charge_transfer_equals_a_clocked_register() -> None:
    rng = np.random.default_rng(1)
    charge = rng.uniform(0, 1000, (60, 5)) * (np.arange(60)[:, None] < 40)
    fractions, none = late_shares(1e-3, 60), late_shares(0.0, 5)
    assert none.tolist() == [[1.0] * 5]
    found = transfer_charge(electrons(charge), read_only(fractions), read_only(none))
    for c in range(5):
        np.testing.assert_allclose(found[:, c], clocked(electrons(charge)[:, c].astype(float), 1e-3, 60), atol=1e-4)
    turned = transfer_charge(electrons(charge.T), read_only(none), read_only(fractions))
    np.testing.assert_array_equal(turned, found.T)


def test_extended_pixel_edge_response() -> None:
    """All charge behind the last illuminated row: the signal times its transfers times the inefficiency, exactly."""
    charge = np.full((300, 1), 10_000.0) * (np.arange(300)[:, None] < 250)
    found = transfer_charge(electrons(charge), read_only(late_shares(1e-4, 300)), read_only(np.ones((1, 1))))
    assert found[250:].sum(dtype=float) == pytest.approx(250 * 1e-4 * 10_000, rel=1e-5)
    assert found.sum(dtype=float) == pytest.approx(charge.sum(), rel=1e-7)


@pytest.mark.parametrize("count", [0.3, 1.0, 2.0, 40.0])
def test_multiplied_charge_is_gamma_distributed(count: float) -> None:
    found = EmGain(gain=200, stages=500)
    register = found.register()
    assert register is not None
    excess = found.excess_noise_factor - 1.0
    values = multiply_charge(electrons(np.full((100, 300), count)), register, EXPOSURE)
    assert kstest(values.ravel(), gamma(count / excess, scale=200 * excess).cdf).pvalue > 1e-4
    assert np.unique(values).size > 29_000


def test_excess_noise() -> None:
    """F^2 of a register with 20 stages that multiplies electron by electron, and of the frames."""
    rng = np.random.default_rng(2)
    stages, count, gain = 20, rng.poisson(5.0, 40_000), 30.0
    for _ in range(stages):
        count += rng.binomial(count, gain ** (1 / stages) - 1)
    stated = EmGain(gain=gain, stages=stages)
    assert count.var() / (gain**2 * 5) == pytest.approx(stated.excess_noise_factor, rel=0.03)
    dn = frame(quiet(em_gain={"gain": gain, "stages": stages}), np.full((300, 400), 50, np.float32)) - 100.0
    assert dn.mean() == pytest.approx(50 * gain, rel=4 * np.sqrt(2 / 50 / dn.size))
    assert dn.var() / (gain**2 * 50) == pytest.approx(stated.excess_noise_factor, rel=0.02)
    assert EmGain(gain=1).register() is None


def test_multiplied_frames_are_those_of_numpy() -> None:
    """Few electrons, clock-induced charge and the register's well, against NumPy's Poisson and gamma numbers."""
    sensor = quiet(em_gain={"gain": 50, "clock_induced_charge_e": 0.2, "register_well_e": 400})
    dn = frame(sensor, np.full((300, 400), 0.5, np.float32)) - 100.0
    rng = np.random.default_rng(3)
    count = rng.poisson(0.7, 120_000)
    plain = np.zeros(count.shape)
    plain[count > 0] = rng.gamma(count[count > 0] * 50 / 49, 49.0)
    plain = np.rint(np.minimum(plain, 400))
    assert ks_2samp(dn.ravel(), plain).pvalue > 1e-4
    assert abs((dn == 0).mean() - (plain == 0).mean()) < 4.5 * np.sqrt(2 * 0.25 / dn.size)
    assert dn.max() == 400


COUPLING = InterpixelCapacitance(coupling_percent=2.0, diagonal_percent=0.3)


def test_coupling_is_a_convolution_that_keeps_the_sum() -> None:
    charge = np.random.default_rng(4).uniform(0, 1e4, (40, 31)).astype(np.float32)
    for part in (charge, charge[:1], charge[:, :1]):
        found = couple_pixels(electrons(part), 0.02, 0.003)
        np.testing.assert_allclose(found, convolve(part.astype(float), COUPLING.kernel(), mode="nearest"), rtol=1e-6)
        assert found.sum(dtype=float) == pytest.approx(part.sum(dtype=float), rel=1e-6)


def test_coupling_lowers_the_variance_as_its_kernel_does() -> None:
    """Variance and covariances of frames: the autocorrelation of the kernel; 4.5 standard errors."""
    level = 20_000.0
    dn = frame(quiet(interpixel_capacitance=COUPLING), np.full((300, 400), level, np.float32)) - (100.0 + level)
    expected = level * correlate2d(COUPLING.kernel(), COUPLING.kernel())
    error = 4.5 * level / np.sqrt(dn.size)
    assert dn.var() == pytest.approx(level * COUPLING.variance_factor + 1 / 12, abs=np.sqrt(2) * error)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (2, 0), (0, 3)):
        covariance = (dn[dy:, dx:] * dn[: 300 - dy, : 400 - dx]).mean()
        assert covariance == pytest.approx(expected[2 + dy, 2 + dx] if dx < 3 else 0.0, abs=error)


def test_converter_error_moves_the_codes() -> None:
    mean = np.full((300, 400), 16_284, np.float32)
    plain, bent = (
        frame(quiet(**effects), mean) for effects in ({}, {"converter_error": {"error_lsb": [0, 8, 0, 0, 0]}})
    )
    difference = bent.astype(float) - plain
    assert difference.mean() == pytest.approx(8.0, abs=0.1), "the table's second entry lies at 16 383.75"
    assert set(np.unique(difference)) <= {7.0, 8.0}


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ({"subtract_black_level": True}, [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]),
        ({"dropped_bits": 2}, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3]),
        ({"companding": "square_root"}, [0, 4, 5, 7, 8, 9, 9, 10, 11, 12, 12, 13, 13, 14, 14, 15]),
        ({"companding": "square_root", "companded_bits": 2}, [0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3]),
        (
            {"companding": "square_root", "companded_bits": 2, "decoded": True},
            [0, 2, 2, 2, 7, 7, 7, 7, 7, 7, 7, 13, 13, 13, 13, 13],
        ),
        ({"dropped_bits": 3, "companding": [5, 9]}, [5] * 8 + [9] * 8),
    ],
)
def test_output_tables(output: dict[str, Any], expected: list[int]) -> None:
    table = Output(**output).table(white_level_dn=15, black_level_dn=3)
    assert table.dtype == np.uint16
    assert table.tolist() == expected


def test_output_is_applied_to_the_codes() -> None:
    stages = {"subtract_black_level": True, "dropped_bits": 1, "rescaled": True}
    assert (
        frame(SENSOR.with_(output=stages)) == np.maximum(frame(SENSOR.with_(output={})).astype(int) - 64, 0) // 2 * 2
    ).all()


@pytest.mark.parametrize(
    ("effects", "what", "where"),
    [
        ({"output": {"companding": [1, 2, 3]}}, "companding", "effects.output"),
        ({"output": {"companding": [3, 2]}}, "companding", "effects.output"),
        ({"output": {"companded_bits": 3}}, "companded_bits", "effects.output"),
        ({"output": {"dropped_bits": 12}}, "dropped_bits", "effects.output"),
        ({"output": {"decoded": True}}, "decoded", "effects.output"),
        ({"interpixel_capacitance": {"coupling_percent": 20}}, "coupling_percent", "effects.interpixel_capacitance"),
        ({"em_gain": {"gain": 0.5}}, "gain", "effects.em_gain"),
    ],
)
def test_invalid_effects(effects: dict[str, Any], what: str, where: str) -> None:
    with raises(InputError, what, where=where):
        SENSOR.with_(**effects)


def test_file_keeps_effects(tmp_path: Any) -> None:
    SENSOR.with_(**EFFECTS).save(tmp_path / "all.sensor.yaml")
    assert ps.load_sensor(tmp_path / "all.sensor.yaml").effects == SENSOR.with_(**EFFECTS).effects


def test_captures_have_no_charge_stages() -> None:
    sensor = ps.load_sensor("dual-gain-phone")
    with raises(InputError, "effects.blooming"):
        sensor.with_(blooming={})
