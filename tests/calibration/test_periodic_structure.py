"""Mosaics and readout channels are found in a mean flat field; fixed patterns of a chip are not taken for them."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.spatial.periodic_structure import MOSAIC_FRACTION, periodic_offsets, periodic_structure
from photosite.frames.frame_set import FrameSet
from photosite.sensor.readout import digital_numbers
from photosite.values.cfa import NAMED, shifted

MONO = np.zeros((1, 1), np.int64)


def flat(rng, *, shape=(72, 96), pixel=0.01, column=0.0, row=0.0, shading=0.0):
    rows, cols = shape
    response = 1.0 + pixel * rng.normal(size=shape) + column * rng.normal(size=cols)
    response = response + row * rng.normal(size=(rows, 1)) + shading * np.linspace(-0.5, 0.5, cols)
    return 1000.0 * response


def found(values, tile=MONO):
    return periodic_structure(values, np.zeros_like(values), tile)


def tiled(values, cell):
    cell = np.array(cell)
    rows, cols = (-(-length // size) for length, size in zip(values.shape, cell.shape, strict=True))
    return values * np.tile(cell, (rows, cols))[: values.shape[0], : values.shape[1]]


@pytest.mark.parametrize(
    "pattern",
    [{}, {"pixel": 0.0005}, {"column": 0.01}, {"row": 0.01}, {"column": 0.02, "row": 0.02}, {"shading": 0.5}],
    ids=str,
)
def test_fixed_patterns_are_no_structure(pattern):
    rng = np.random.default_rng(1)
    for shape in [(48, 48), (24, 120), (72, 96)] * 20:
        assert found(flat(rng, shape=shape, **pattern)) is None


def test_cells_of_large_frames_are_sampled_with_their_shading():
    """Every second cell of 1560 rows and every third of 1600 columns is compared."""
    values = flat(np.random.default_rng(12), shape=(1560, 1600), pixel=0.005, shading=0.5)
    assert found(values) is None
    assert found(tiled(values, [[1.0, 1.004]])).difference == pytest.approx(0.004, rel=0.1)


@pytest.mark.parametrize("axis", ["columns", "rows"])
def test_readout_channels_are_found_with_their_size(axis):
    rng = np.random.default_rng(2)
    for period in (2, 4, 6):
        size = rng.uniform(0.006, 0.015)
        cell = np.ones((1, period))
        cell[0, rng.integers(period)] += size
        seen = found(tiled(flat(rng, shape=(144, 192)), cell if axis == "columns" else cell.T))
        assert seen is not None
        assert seen.period == period
        assert seen.by_lines == axis
        assert seen.difference == pytest.approx(size, rel=0.35)
        assert not seen.is_mosaic()
        assert "color filter" not in str(seen)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_gain_of_readout_channels_has_its_uncertainty(axis):
    """60 chips: a width of 1.35 or a mean error of 0.5 uncertainties by chance in 1 of 10 000."""
    rng = np.random.default_rng(11)
    scores = []
    for gain in (0.99, 1.02) * 30:
        cell = [[gain, 2.0 - gain]]
        seen = found(tiled(flat(rng, shape=(96, 96)), cell if axis else np.transpose(cell)))
        scores.append((seen.relative.mean(axis=1 - axis)[0] - gain) / seen.uncertainty * np.sign(gain - 1.0))
    assert abs(np.mean(scores)) < 0.5
    assert 0.65 < np.sqrt(np.mean(np.square(scores))) < 1.35


def test_gains_of_lines_need_a_mosaic_in_which_they_differ():
    """In a Bayer mosaic the two greens differ in row and column; in a Quad Bayer one, every color is in both."""
    values = tiled(flat(np.random.default_rng(11), shape=(144, 192)), [[1.004, 0.996]])
    bayer = found(values, np.array([[0, 1], [1, 2]]))
    assert (bayer.separable, bayer.by_lines) == ((), "")
    assert not bayer.is_mosaic()
    quad = found(values, np.kron(np.array([[0, 1], [1, 2]]), np.ones((2, 2), np.int64)))
    assert quad.by_lines == "columns"
    assert quad.uncertainty < 0.001
    np.testing.assert_allclose(quad.channel_table, [[1.004, 0.996]], atol=6 * quad.uncertainty)


def test_greens_that_differ_are_named_where_green_saturates_first():
    """The brightest level of red and blue shows green saturated, and no difference."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=48, cols=72, black_level_dn=100)
    uneven = sensor.with_(readout_channels={"relative_gain": [[1.009, 0.991]]})
    light = np.where(np.add.outer(np.arange(48), np.arange(72)) % 2 == 1, 1.0, 0.5).astype(np.float32)
    plan = [("dark", 0.01, 0.0)] * 6 + [("light", 0.01 * n, 7000.0 * n) for n in range(1, 9) for _ in range(3)]
    frames = [
        (kind, t, digital_numbers(uneven, level * light, t, seed=1, frame=n)) for n, (kind, t, level) in enumerate(plan)
    ]
    found = ps.calibrate(FrameSet.from_arrays(frames, bits=12, sensor=sensor, cfa=sensor.array.cfa))
    assert limits(found)["periodic-gain"] == pytest.approx(0.018, rel=0.1)
    assert "uneven-light" not in limits(found)
    assert found.readout_channels is None


def test_small_differences_of_a_clean_chip_are_found():
    rng = np.random.default_rng(3)
    shape, sizes = (192, 240), rng.uniform(0.0035, 0.0045, 20)
    assert all(found(tiled(flat(rng, shape=shape), [[1.0, 1.0 + size]])) is not None for size in sizes)


def test_a_mosaic_is_found_in_its_phase():
    rng = np.random.default_rng(4)
    for cell, patterns in (([[0.5, 1.0], [1.0, 0.7]], "RGGB BGGR"), ([[1.0, 0.5], [0.7, 1.0]], "GRBG GBRG")):
        seen = found(tiled(flat(rng), cell))
        assert seen is not None
        assert seen.is_mosaic()
        assert " ".join(seen.bayer_patterns()) == patterns


@pytest.mark.parametrize("name", ["quad-rggb", "rgbw", "rgb-ir", "x-trans"])
def test_other_mosaics_are_named_in_any_phase(name):
    rng, signal = np.random.default_rng(6), {"R": 0.5, "G": 0.8, "B": 0.35, "W": 1.0, "Ir": 0.2}
    for row, col in ((0, 0), (1, 0), (1, 3)):
        cell = np.array([[signal[channel] for channel in line] for line in shifted(NAMED[name], row, col)])
        seen = found(tiled(flat(rng, shape=(120, 144)), cell))
        assert seen.tiles() == (name,)
        assert str(seen).endswith(f"; {name} fits")


def test_an_unknown_mosaic_is_not_named():
    rng = np.random.default_rng(7)
    cell = rng.uniform(0.3, 1.0, (4, 4))
    assert found(tiled(flat(rng, shape=(120, 144)), cell)).tiles() == ()


def test_the_stated_mosaic_is_no_structure_and_its_wrong_phase_is():
    rng = np.random.default_rng(5)
    values = tiled(flat(rng), [[0.5, 1.0], [1.0, 0.7]])
    assert found(values, np.array([[0, 1], [1, 2]])) is None
    wrong = found(values, np.array([[1, 0], [2, 1]]))
    assert wrong is not None
    assert wrong.is_mosaic()


def test_lines_far_apart_belong_to_a_striped_filter():
    rng = np.random.default_rng(6)
    stripes = found(tiled(flat(rng), [[0.5, 1.0, 0.7]]))
    assert stripes is not None
    assert stripes.by_lines == "columns"
    assert stripes.is_mosaic()
    between = found(tiled(flat(rng), [[1.0, 1.0 + 2.0 * MOSAIC_FRACTION]]))
    assert between is not None
    assert not between.is_mosaic()


@pytest.mark.parametrize("level", [0.0, -3.0])
def test_parts_without_light_are_left_out(level):
    rng = np.random.default_rng(7)
    values = tiled(flat(rng), [[1.0, 1.1]])
    values[:12, :12] = level  # a corner
    values[:, -12:] = level  # covered columns
    with np.errstate(all="raise"):
        seen = found(values)
        assert seen is not None
        assert seen.difference == pytest.approx(0.1, rel=0.1)
        assert found(np.full((72, 96), level)) is None


def test_defects_do_not_look_like_a_period():
    rng = np.random.default_rng(8)
    values = flat(rng)
    values[::5, ::7] = 4000.0
    assert found(values) is None


def test_offsets_of_alternating_lines_are_found_in_dark_frames():
    """Of 20 frames each: none by chance, with random lines, hot pixels and glow; 0.4 standard deviations are found."""
    rng = np.random.default_rng(31)
    glow = 5.0 * np.exp(-np.arange(192) / 30.0)
    for _ in range(20):
        dark = (
            64.0 + rng.normal(0.0, 1.0, (144, 192)) + rng.normal(0.0, 0.3, 192) + rng.normal(0.0, 0.3, (144, 1)) + glow
        )
        dark[rng.integers(144, size=40), rng.integers(192, size=40)] += 300.0
        assert periodic_offsets(dark) is None
    for _ in range(20):
        dark = 64.0 + rng.normal(0.0, 1.0, (144, 192)) + rng.normal(0.0, 0.1, 192)
        dark[:, 1::2] += 0.4
        seen = periodic_offsets(dark)
        assert seen is not None
        assert (seen.period, seen.by_lines, seen.channel_table.shape) == (2, "columns", (1, 2))
        assert seen.channel_table[0, 1] == pytest.approx(0.2, abs=5 * seen.uncertainty)
