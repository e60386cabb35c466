"""Binned sensors: charge against a plain simulation, digital against binned frames of the single pixels."""

import numpy as np
import pytest
from raising import raises
from scipy.stats import chi2, ks_2samp

import photosite as ps
from photosite.errors import InputError
from photosite.frames.binning import bin_frame
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.readout import digital_numbers
from photosite.values.cfa import tile_name

LEVEL_E, READ_E = 90.0, 16.0


def pixels(rows=240, cols=320, **changes):
    """A sensor whose read noise is 2 DN, so that rounding errors are uniform and still matter."""
    values = {"read_noise_e": READ_E, "dsnu_e": 0.0, "prnu_percent": 0.0, "black_level_dn": 64} | changes
    return ps.load_sensor("sony-imx174").with_(rows=rows, cols=cols, **values)


def flat(sensor, level_e, seed, exposure_s=0.01):
    mean = np.full((sensor.array.rows, sensor.array.cols), level_e, np.float32)
    return digital_numbers(sensor, mean, exposure_s, seed=seed)


def test_charge_is_added_before_it_is_read():
    """A plain simulation: four Poisson counts, one reading."""
    single = pixels(dark_current_e_per_s=50.0)
    sensor = single.binned(2, "charge")
    rng, shape = np.random.default_rng(3), (sensor.array.rows, sensor.array.cols)
    electrons = rng.poisson(LEVEL_E + 0.5, (4, *shape)).sum(axis=0) + rng.normal(0.0, READ_E, shape)
    plain = np.floor(sensor.system_gain_dn_per_e * electrons + 64 + 0.5)
    found = flat(sensor, 4 * LEVEL_E, seed=5)
    assert ks_2samp(found.ravel(), plain.ravel()).pvalue > 1e-3
    assert found.mean() == pytest.approx(plain.mean(), abs=5 * plain.std() / np.sqrt(plain.size / 2))


@pytest.mark.parametrize("kind", ["sum", "mean"])
@pytest.mark.parametrize("factor", [2, 3])
def test_digital_binning_of_frames_is_that_of_the_sensor(kind, factor):
    single = pixels(dark_current_e_per_s=50.0)
    sensor = single.binned(factor, kind)
    frame = RawFrame(flat(single, LEVEL_E, seed=6), bits=12, black_level_dn=64)
    made = bin_frame(frame, factor, kind)
    assert made.shape == (sensor.array.rows, sensor.array.cols)
    assert (made.bits, made.black_level_dn) == (sensor.readout.bits, sensor.readout.black_level_dn.value)
    found = flat(sensor, factor**2 * LEVEL_E, seed=7)
    assert ks_2samp(found.ravel(), made.dn.ravel()).pvalue > 1e-3
    # Closed form of the dark noise, in DN: n readings, each rounded.
    dark = bin_frame(RawFrame(flat(single, 0.0, seed=8, exposure_s=1e-6), bits=12), factor, kind).dn
    n, read_dn2 = factor**2, (READ_E * single.system_gain_dn_per_e) ** 2
    rounding = np.arange(n) / n - np.floor(np.arange(n) / n + 0.5)
    closed = n * (read_dn2 + 1 / 12) if kind == "sum" else (read_dn2 + 1 / 12) / n + np.var(rounding)
    black_dn = 64 * n if kind == "sum" else 64 - np.mean(rounding)
    assert sensor.readout.black_level_dn.value == pytest.approx(black_dn, abs=1e-12)
    assert dark.mean() == pytest.approx(black_dn, abs=5 * np.sqrt(closed / dark.size))
    low, high = chi2.ppf([0.001, 0.999], dark.size - 1) / (dark.size - 1)
    assert low * closed < dark.var(ddof=1) < high * closed
    stated = (sensor.noise.read_noise_mv.value / sensor.mv_per_dn) ** 2 + 1 / 12
    assert stated == pytest.approx(closed, rel=1e-9)


def test_fixed_pattern_and_line_noise_follow():
    single = pixels(dsnu_e=4.0, prnu_percent=1.0, read_noise_e=16.0, row_noise_e=6.0, column_noise_e=4.0)
    sensor = single.binned(2, "sum")
    level_e = 2000.0
    frames = [bin_frame(RawFrame(flat(single, level_e, seed=k), bits=12), 2, "sum").dn / 1.0 for k in range(12)]
    own = [flat(sensor, 4 * level_e, seed=100 + k) / 1.0 for k in range(12)]
    for statistic in (
        lambda stack: np.mean(stack, axis=0).std(),
        lambda stack: np.std(np.mean(np.subtract(stack[1:], stack[0]), axis=2)),
        lambda stack: np.std(np.mean(np.subtract(stack[1:], stack[0]), axis=1)),
        lambda stack: np.std(np.subtract(stack[1], stack[0])),
    ):
        assert statistic(own) == pytest.approx(statistic(frames), rel=0.06)
    charge = single.binned(2)
    assert charge.noise.row_noise_mv.value == pytest.approx(single.noise.row_noise_mv.value)
    assert charge.noise.read_noise_mv.value == pytest.approx(single.noise.read_noise_mv.value)
    assert charge.noise.prnu_percent.value == pytest.approx(0.5)


def test_geometry_saturation_and_tile():
    single = ps.load_sensor("nikon-d200").with_(rows=10, cols=14, cfa="quad-rggb", black_level_dn=64)
    for kind, bits, black, gain in (("charge", 12, 64, 1.0), ("sum", 14, 256, 1.0), ("mean", 12, 64.125, 0.25)):
        sensor = single.binned(2, kind)
        assert tile_name(sensor.array.cfa) == "rggb"
        assert (sensor.array.rows, sensor.array.cols) == (5, 7)
        assert sensor.pixel_area_m2 == pytest.approx(4 * single.pixel_area_m2)
        assert (sensor.readout.bits, sensor.readout.black_level_dn.value) == (bits, black)
        assert sensor.system_gain_dn_per_e == pytest.approx(gain * single.system_gain_dn_per_e)
        assert sensor.pixel.well_capacity_e.value == 4 * single.pixel.well_capacity_e.value
    frame = RawFrame(np.full((8, 8), 4095, np.uint16), bits=12, cfa=single.array.cfa, black_level_dn=64)
    total = bin_frame(frame, 2, "sum")
    assert (total.dn == 4 * 4095).all()
    assert (total.white_level_dn, total.bits, tile_name(total.cfa)) == (16380, 14, "rggb")


def test_what_cannot_be_binned():
    with raises(InputError, "cfa", value="RG/GB"):
        ps.load_sensor("nikon-d200").binned(2)
    mono = pixels(8, 8)
    with raises(InputError, "factor", value=1):
        mono.binned(1)
    with raises(InputError, "kind", value="average"):
        mono.binned(2, "average")
    with raises(InputError, "bits", value=16):
        mono.with_(bits=16).binned(2, "sum")
    right = [[0, 0, 0], [0, 0.9, 0.1], [0, 0, 0]]
    with raises(InputError, "a sensor with crosstalk cannot be binned"):
        mono.with_(crosstalk={"optical": {"M": right}}).binned(2)
    with raises(InputError, "factor", value=4):
        bin_frame(RawFrame(np.ones((3, 8), np.uint16), bits=12), 4)
    with raises(InputError, "bits", value=18):
        bin_frame(RawFrame(np.ones((4, 4), np.uint16), bits=16), 2, "sum")
