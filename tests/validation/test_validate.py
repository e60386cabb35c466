"""Validation of synthetic cameras: the right one agrees at the stated level, wrong ones do not, with the reasons."""

import json
from functools import lru_cache

import numpy as np
import pytest
from raising import raises
from scipy.stats import kstest

from photosite.color.colorimetry import delta_e_76, delta_e_2000
from photosite.errors import InputError, PhotositeWarning
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.charts.color_checker import chart_regions, chart_xyz_d65
from photosite.scene.charts import MACBETH_NAMES
from photosite.validation.validate import validate
from photosite.values.cfa import NAMED, channel_mask
from photosite.values.region import Region

SHAPE = (112, 166)
GAIN_DN_PER_E = 0.114
BLACK_DN = 64.0

# Electrons of the three channels for the tristimulus values 1, 0, 0 and so on: any camera near enough to one.
ELECTRONS_FROM_XYZ = 20_000 * np.array([[0.84, -0.10, -0.10], [-0.25, 1.05, 0.20], [-0.05, 0.10, 0.75]])


@lru_cache
def chart_electrons(cfa="rggb", warm=False, turned=False):
    """(rows, cols) mean electrons of a chart that fills the frame."""
    names = MACBETH_NAMES[::-1] if turned else MACBETH_NAMES
    camera = ELECTRONS_FROM_XYZ * ([[1.02], [1.0], [0.98]] if warm else 1.0)
    patches = chart_xyz_d65("macbeth", names) @ camera.T
    mean = np.full(SHAPE, 20.0)
    for region, rgb in zip(chart_regions("macbeth", *SHAPE), patches, strict=True):
        color = sum(v * channel_mask(NAMED[cfa], c, SHAPE) for c, v in zip("RGB", rgb, strict=True))
        mean[region.r0 : region.r1, region.c0 : region.c1] = color[region.r0 : region.r1, region.c0 : region.c1]
    return mean


def shoot(seed, mean=None, *, light=1.0, read_e=12.0, dsnu_e=15.0, prnu=0.011, cfa="rggb", chip=None, **more):
    """A frame of a chip with fixed pattern: the sensor model, in a few lines of its own."""
    rng, fixed = np.random.default_rng(seed), np.random.default_rng((seed, 1) if chip is None else chip)
    mean = chart_electrons() if mean is None else mean
    response, offset = fixed.normal(1, prnu, mean.shape), fixed.normal(0, dsnu_e, mean.shape)
    electrons = rng.poisson(light * mean * response) + offset + rng.normal(0, read_e, mean.shape)
    dn = np.clip(np.rint(BLACK_DN + GAIN_DN_PER_E * electrons), 0, 4095).astype(np.uint16)
    return RawFrame(dn, bits=12, cfa=NAMED[cfa], black_level_dn=BLACK_DN, **more)


@pytest.mark.parametrize(("pairs", "most_alarms"), [(50, 8), pytest.param(200, 22, marks=pytest.mark.slow)])
def test_two_chips_of_one_kind_agree_at_the_stated_level(pairs, most_alarms):
    # At level 0.05, 9 of 50 pairs disagree by chance once in 500, 23 of 200 once in 10 000. And the p-values must be
    # those of a true chi-square, uniform (Kolmogorov-Smirnov at 0.001).
    results = [validate(shoot(2 * i), shoot(2 * i + 1)) for i in range(pairs)]
    assert sum(not result.agrees for result in results) <= most_alarms
    assert kstest([result.means.p_value for result in results], "uniform").pvalue > 1e-3
    assert kstest([result.noise.p_value for result in results], "uniform").pvalue > 1e-3


def test_what_agreement_looks_like():
    result = validate(shoot(1), shoot(2))
    assert result.agrees
    assert len(result.reasons) == 2
    assert result.used.all()
    assert result.notes == ()
    assert result.means.degrees_of_freedom == 72
    assert abs(result.regression.slope_through_origin.value - 1) < 5e-3
    assert result.color.names == MACBETH_NAMES
    assert np.median(result.color.delta_e_2000) < 0.5


WRONG = {
    "1 % more light": lambda seed: shoot(seed, light=1.01),
    "another light": lambda seed: shoot(seed, chart_electrons(warm=True)),
    "chart turned": lambda seed: shoot(seed, chart_electrons(turned=True)),
    "tile named in another order": lambda seed: shoot(seed, chart_electrons("bggr")),
    "twice the read noise and DSNU": lambda seed: shoot(seed, read_e=36, dsnu_e=45),
    "more PRNU": lambda seed: shoot(seed, prnu=0.016),
    "black level off by 2 DN": lambda seed: shoot(seed, chart_electrons() + 2 / GAIN_DN_PER_E),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_camera_does_not_agree(wrong):
    for seed in range(100, 103):
        result = validate(WRONG[wrong](seed), shoot(seed + 1000))
        assert not result.agrees, seed
        assert any("differ" in line for line in result.reasons)


def test_the_reasons_say_by_how_much():
    result = validate(shoot(3, light=1.25, exposure_s=0.05), shoot(4, exposure_s=0.04))
    text = "; ".join(result.reasons)
    assert "patch means differ" in text
    assert "the exposure times differ: measured 0.05 s, simulated 0.04 s" in text
    for name in "RGB":
        line = result.regression_by_channel[name].slope_through_origin
        # Patch means are good to a few parts in a thousand, and nothing else separates the slope from 1.25.
        assert line.value == pytest.approx(1.25, abs=0.01)
        assert f"channel {name}: measured is {line.value:.4f} times simulated" in text


def test_a_wrong_noise_is_separate_from_a_wrong_mean():
    noisy = validate(shoot(5, read_e=40, dsnu_e=40), shoot(6))
    assert noisy.noise.p_value < 1e-6
    assert noisy.means.p_value > 1e-3
    bright = validate(shoot(5, light=1.02), shoot(6))
    assert bright.means.p_value < 1e-6
    assert bright.noise.p_value > 1e-3


def test_a_tolerance_lets_small_differences_pass_and_no_larger_ones():
    for seed in range(5):
        assert validate(shoot(seed, light=1.03), shoot(seed + 500), tolerance_percent=3).agrees
        assert not validate(shoot(seed, light=1.06), shoot(seed + 500), tolerance_percent=3).agrees


def test_with_a_tolerance_the_reasons_say_the_largest_difference_and_the_tolerance():
    for seed, light in ((1, 1.02), (2, 1.2)):
        result = validate(shoot(seed, light=light), shoot(seed + 500), tolerance_percent=10)
        assert result.agrees == (light < 1.1)
        for line, name in zip(result.reasons, ("mean_dn", "spatial_noise_dn"), strict=False):
            one, other = getattr(result.measured, name), getattr(result.simulated, name)
            difference = one / other - 1
            patch, channel = max(np.ndindex(*difference.shape), key=lambda at: abs(difference[at]))
            where = f"{MACBETH_NAMES[patch]}, {result.measured.channels[channel]}"
            wanted = f"largest difference {100 * difference[patch, channel]:+.2f} % ({where}), tolerance 10 %"
            assert wanted in line
        assert "; ".join(result.reasons).count("largest difference") == 2


def test_the_largest_difference_is_not_that_of_a_saturated_patch():
    result = validate(shoot(7, light=3.0), shoot(8, light=2.0), tolerance_percent=10)
    difference = result.relative_noise_difference
    patch, channel = np.unravel_index(int(np.abs(difference).argmax()), difference.shape)
    assert not result.used[patch, channel]  # clipped, and without noise: it differs most
    lost = [f"({MACBETH_NAMES[i]}, {result.measured.channels[k]})" for i, k in np.argwhere(~result.used)]
    assert not any(where in line for where in lost for line in result.reasons)


def test_one_chips_two_stacks_agree():
    # The pattern is shared, so the means differ by less than the standard errors allow for.
    measured = [shoot(i, chip=77) for i in range(4)]
    result = validate(measured, [shoot(i, chip=77) for i in range(10, 14)])
    assert result.agrees
    assert result.measured.frames == 4
    assert result.means.statistic < result.means.degrees_of_freedom
    assert (result.measured.temporal_noise_dn < result.measured.spatial_noise_dn).mean() > 0.9


def test_saturated_patches_are_named_and_left_out():
    result = validate(shoot(7, light=2.0), shoot(8, light=2.0))
    lost = {name for name, row in zip(MACBETH_NAMES, result.used, strict=True) if not row.all()}
    assert "white" in lost
    assert len(lost) < 12
    assert all(name in result.notes[0] for name in lost)
    assert result.means.degrees_of_freedom == result.used.sum() == result.regression.points
    assert result.agrees
    assert not lost & set(result.color.names)


def test_colors_are_those_of_the_matrix_fitted_to_the_simulated_patches():
    result = validate(shoot(9, light=1.1), shoot(10))
    reference = chart_xyz_d65("macbeth", MACBETH_NAMES)
    order = [result.measured.channels.index(name) for name in "RGB"]
    rgb, other = (side.mean_dn[:, order] for side in (result.simulated, result.measured))
    matrix = np.linalg.solve(rgb.T @ rgb, rgb.T @ reference)
    np.testing.assert_allclose(result.color.delta_e_76, delta_e_76(other @ matrix, rgb @ matrix), rtol=1e-6)
    np.testing.assert_allclose(result.color.delta_e_2000, delta_e_2000(other @ matrix, rgb @ matrix), rtol=1e-6)
    np.testing.assert_allclose(result.color.matrix.matrix, matrix.T, rtol=1e-6)
    # The camera is linear in XYZ but for its noise, so the matrix fits well.
    assert np.median(result.color.matrix.delta_e_2000) < 0.5


def test_monochrome_and_charts_of_ones_own():
    rng = np.random.default_rng(11)
    level = np.repeat([200.0, 800.0, 2400.0], 30)[:, None] * np.ones(40)
    frames = [RawFrame(rng.poisson(level).astype(np.uint16), bits=12) for _ in range(2)]
    regions = [Region(f"gray {i}", 30 * i, 30 * i + 30, 0, 40) for i in range(3)]
    result = validate(*frames, chart=None, regions=regions)
    assert result.agrees
    assert result.color is None
    assert result.notes == ("no color differences: the channels are not R, G and B",)


def test_some_patches_of_the_chart_will_do():
    regions = chart_regions("macbeth", *SHAPE)[12:18]
    result = validate(shoot(12), shoot(13), regions=regions)
    assert result.color.names == MACBETH_NAMES[12:18]
    two = validate(shoot(12), shoot(13), regions=regions[:2])
    assert two.color is None
    assert two.regression is not None
    assert two.regression.points == 6
    assert two.regression_by_channel == {"R": None, "G": None, "B": None}
    assert two.notes == (
        "no regression of channel R: it needs three different patches",
        "no regression of channel G: it needs three different patches",
        "no regression of channel B: it needs three different patches",
        "no color differences: rgb must be 4 patches or more, got '2 patches'",
    )


def test_the_dictionary_is_strict_json():
    dark = np.full(SHAPE, 0.0)
    dark[60:] = 4000.0
    regions = [Region("dark", 0, 30, 0, 60), Region("light", 70, 100, 0, 60)]
    # Without light or noise the mean is 0 DN and its logarithm and ratio do not exist.
    flat = RawFrame(np.rint(BLACK_DN + GAIN_DN_PER_E * dark).astype(np.uint16), 12, NAMED["rggb"], BLACK_DN)
    with pytest.warns(PhotositeWarning):
        same = validate(flat, flat, chart=None, regions=regions)
    data = json.loads(json.dumps(same.to_dict(), allow_nan=False))
    assert data["agrees"] is True
    assert data["relative_difference"] == [[None] * 3, [0.0] * 3]
    assert data["simulated"]["spatial_snr_db"] == [[None] * 3, [None] * 3]
    full = json.loads(json.dumps(validate(shoot(14), shoot(15)).to_dict(), allow_nan=False))
    assert len(full["color"]["delta_e_2000"]) == len(full["measured"]["mean_dn"]) == 24


def test_frames_of_two_kinds_are_not_compared():
    frame = shoot(16)
    with raises(InputError, "measured and simulated frames"):
        validate(frame, RawFrame(frame.dn[:110], 12, frame.cfa))
    with raises(InputError, "measured and simulated frames"):
        validate(frame, RawFrame(frame.dn, 12, NAMED["gbrg"]))
    with raises(InputError, "measured and simulated frames"):
        validate(frame, RawFrame(frame.dn, 14, frame.cfa))


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"chart": "makbeth"}, "chart"),
        ({"chart": None}, "regions"),
        ({"level": 0.0}, "level"),
        ({"tolerance_percent": -1}, "tolerance_percent"),
        ({"reference_xyz": np.ones((3, 3))}, "reference_xyz"),
        ({"reference_xyz": np.full((24, 3), np.nan)}, "reference_xyz"),
        ({"regions": [Region("withe", 0, 20, 0, 20)]}, "names"),
        ({"regions": [Region("white", 0, 2, 0, 4)]}, "patches hold too few pixels to compare"),
    ],
)
def test_invalid_calls(arguments, what):
    with raises(InputError, what):
        validate(shoot(17), shoot(18), **arguments)


def test_nothing_to_compare():
    with raises(InputError, "measured", value=0):
        validate([], shoot(19))
    with raises(InputError, "every patch is saturated"):
        validate(shoot(20, light=1e3), shoot(21))


@pytest.mark.parametrize("wrong", [1, None, "frame.dng", [1, 2], np.zeros((4, 4))])
def test_only_raw_frames_are_accepted(wrong):
    for arguments, what in (((wrong, shoot(22)), "measured"), ((shoot(22), wrong), "simulated")):
        with raises(InputError, what):
            validate(*arguments)
