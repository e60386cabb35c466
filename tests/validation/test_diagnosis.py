"""What explains a difference: ratios against arithmetic, and corners' orders against the group they are."""

import numpy as np
import pytest

from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.validation.diagnosis import corner_orders, diagnose, scale_of
from photosite.validation.validate import compare_patches
from photosite.values.region import Region

NAMES = tuple(f"patch {i}" for i in range(24))
LEVELS = np.random.default_rng(1).uniform(100, 3000, (24, 3))

NOISE_LEVELS = np.geomspace(20, 3000, 12)
PATCHES = [Region(f"gray {i}", 30 * i, 30 * i + 30, 0, 40) for i in range(12)]


def patches(mean, saturated=0.0):
    shape = np.shape(mean)
    return PatchStatistics(
        names=NAMES,
        channels=("R", "G", "B"),
        frames=1,
        pixels=np.full(shape, 400),
        mean_dn=np.asarray(mean, float),
        standard_error_dn=np.full(shape, 0.5),
        spatial_noise_dn=np.full(shape, 10.0),
        spatial_variance_error_dn2=np.full(shape, 7.0),
        temporal_noise_dn=None,
        saturated_fraction=np.full(shape, saturated),
        mean_e=None,
    )


def reasons(measured, others=None):
    return diagnose(compare_patches(patches(measured), patches(LEVELS)), others or {})


def test_ratios_and_scatter_are_those_put_in():
    ratios = np.array([1.2, 1.0, 0.8])
    away = np.where(np.arange(24)[:, None] % 2, 1.03, 0.97) * np.ones(3)
    found = scale_of(patches(LEVELS * ratios * away), patches(LEVELS), np.ones((24, 3), bool))
    for k, ratio in enumerate(found.ratio.values()):
        assert ratio == pytest.approx((LEVELS * ratios * away)[:, k].sum() / LEVELS[:, k].sum())
    assert found.scatter == pytest.approx(0.03, rel=0.05)
    assert scale_of(patches(-LEVELS), patches(LEVELS), np.ones((24, 3), bool)) is None


def test_one_ratio_many_ratios_no_ratio():
    assert reasons(LEVELS) == ()
    assert reasons(1.3 * LEVELS)[-1].startswith("all channels share the ratio 1.3000")
    assert reasons(LEVELS * [1.2, 1.0, 0.8])[-1].startswith("the channels have different ratios")
    assert reasons(LEVELS[::-1])[-1].startswith("patches do not share a common ratio")
    assert reasons(-LEVELS)[0].startswith("the measured patches are not above black")


def test_another_orientation_is_named_only_where_it_explains_much():
    reading = {"the chart is turned": patches(LEVELS * 1.1), "worse": patches(LEVELS[::-1])}
    (line,) = reasons(LEVELS[::-1], reading)
    assert line.startswith("the chart is turned: ")
    assert "from 272 %" in line
    noise = np.random.default_rng(2).normal(1, 0.04, (24, 3))
    nearly = {"nearly as bad": patches(LEVELS * (1 + 0.8 * (noise - 1)))}
    assert reasons(LEVELS * noise, nearly)[0].startswith("measured")


def test_the_other_orders_of_corners_are_the_seven_other_symmetries_of_a_rectangle():
    corners = ((0.0, 0.0), (0.0, 3.0), (2.0, 3.0), (2.0, 0.0))
    orders = corner_orders(corners)
    assert len({*orders.values(), corners}) == 8
    for order in orders.values():  # each goes round: neighbors stay neighbors
        steps = [abs(corners.index(a) - corners.index(b)) for a, b in zip(order, order[1:] + order[:1], strict=True)]
        assert set(steps) <= {1, 3}
    # A chart that was turned clockwise by 90 degrees has its first corner where the second would be.
    assert orders["turned by 90 degrees clockwise"][0] == corners[1]


def test_what_was_fitted_is_not_named():
    result = compare_patches(patches(1.01 * LEVELS), patches(LEVELS))
    assert "light level" in diagnose(result, {})[-1]
    (_, line) = diagnose(result, {}, "light")
    assert line.startswith("the common scale is fitted (light)")
    assert "corners" in line
    assert "light level" not in line


def test_a_ratio_that_may_be_one_is_left_out():
    away = LEVELS * np.where(np.arange(24)[:, None] % 2, 1.05, 0.95)
    assert not any("measured is" in line for line in compare_patches(patches(away), patches(LEVELS)).reasons)
    reasons = compare_patches(patches(1.3 * LEVELS), patches(LEVELS)).reasons
    assert sum("measured is 1.3000 times simulated" in line for line in reasons) == 3


def noisy_patches(seed, read=6.0, prnu=0.01, noise=1.0, frames=3):
    rng = np.random.default_rng(seed)
    mean = np.repeat(NOISE_LEVELS, 30)[:, None] * (1 + prnu * noise * rng.normal(size=(360, 40)))
    spread = noise * np.sqrt(read**2 + 0.2 * np.abs(mean))
    shots = [np.rint(100 + rng.normal(mean, spread)).astype(np.uint16) for _ in range(frames)]
    return patch_statistics([RawFrame(dn, 14, black_level_dn=100) for dn in shots], PATCHES)


def noise_lines(**changes):
    result = compare_patches(noisy_patches(1, **changes), noisy_patches(2))
    assert not result.agrees
    return [line for line in result.reasons if line.startswith("noise") and "chi-square" not in line]


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"read": 9.0}, "dark patches differ most"),
        ({"prnu": 0.02}, "bright patches differ most"),
        ({"noise": 1.2}, "dark and bright patches differ alike"),
    ],
)
def test_the_cause_is_what_was_changed(changes, cause):
    assert any(line.startswith("noise over pixels: " + cause) for line in noise_lines(**changes))


def test_the_ratio_and_the_largest_difference_are_reported():
    line = next(
        line for line in noise_lines(noise=1.2) if line.startswith("noise over pixels, measured over simulated: ")
    )
    value, low, _, high = line.split(": ")[1].split()[1:5]
    assert float(value) == pytest.approx(1.2, abs=0.03)
    assert float(low.strip("(")) < float(value) < float(high.strip("),"))
    assert "the largest difference is +2" in line
    assert "(gray " in line


def test_noise_from_frame_to_frame_is_separate_from_the_pattern():
    lines = noise_lines(prnu=0.02)
    assert not any(line.startswith("noise from frame to frame") for line in lines)
    assert any(line.startswith("noise from frame to frame: dark patches differ most") for line in noise_lines(read=9.0))
    assert not any(line.startswith("noise from") for line in noise_lines(read=9.0, frames=1))


def test_noise_that_agrees_is_not_spoken_of():
    assert not any(
        "measured over simulated: " in line for line in compare_patches(noisy_patches(1), noisy_patches(2)).reasons
    )
