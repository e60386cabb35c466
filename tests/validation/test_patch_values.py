"""Patch values of two simulators: verdicts, lines, and calls that cannot be."""

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.validation.patch_values import PatchValues, compare_values

NAMES = tuple(f"patch {i}" for i in range(24))
LEVELS = np.outer(np.geomspace(200.0, 20000.0, 24), [1.0, 0.7, 0.3]) * (1 + 0.2 * np.sin(np.arange(72))).reshape(24, 3)


def exact(mean, names=NAMES, channels=("R", "G", "B")):
    return PatchValues.exact(names, channels, "e", mean)


def noisy(mean, error):
    zeros = np.zeros_like(mean, dtype=bool)
    return PatchValues(NAMES, ("R", "G", "B"), "e", mean, error, zeros)


def test_the_tolerance_is_where_the_verdict_turns():
    reference = exact(LEVELS)
    one_off = LEVELS.copy()
    one_off[5, 1] *= 1.00101
    assert compare_values(exact(LEVELS * 1.001), reference, tolerance_percent=0.1).agrees
    result = compare_values(exact(one_off), reference, tolerance_percent=0.1)
    assert not result.agrees
    assert result.beyond == 1
    assert result.reasons[0] == "largest difference +0.101 % (patch 5, G); allowed 0.1 %"
    assert result.reasons[1] == "1 of 72 values without noise differ by more than the tolerance"


def test_lines_find_scale_and_offset():
    result = compare_values(exact(1.03 * LEVELS + 7), exact(LEVELS))
    assert result.regression.slope.value == pytest.approx(1.03, rel=1e-9)
    assert result.regression.intercept.value == pytest.approx(7, rel=1e-7)
    assert set(result.regression_by_channel) == {"R", "G", "B"}


def test_order_and_missing_patches():
    order = np.random.default_rng(1).permutation(20)
    shuffled = exact(LEVELS[order][:, [2, 0]], tuple(NAMES[i] for i in order), ("B", "R"))
    result = compare_values(shuffled, exact(LEVELS))
    assert result.agrees
    assert result.other.channels == ("R", "B")
    assert result.other.names == NAMES[:20]
    assert "patches patch 20, patch 21, patch 22, patch 23" in result.notes[0]
    assert "channels G" in result.notes[1]


def test_a_dark_reference_has_no_relative_difference_and_still_counts():
    dark = LEVELS.copy()
    dark[3] = 0.0
    off = dark.copy()
    off[3, 0] = 0.5
    assert compare_values(exact(dark), exact(dark)).agrees
    result = compare_values(exact(off), exact(dark))
    assert not result.agrees
    assert result.to_dict()["relative_difference"][3] == [None, None, None]


def test_noise_alone_is_no_difference_in_95_percent_of_seeds():
    """200 seeds at level 0.05: more than 20 alarms, or fewer than 2, come about once in 1 000."""
    error = np.sqrt(LEVELS / 400)
    alarms = 0
    for seed in range(200):
        drawn = LEVELS + error * np.random.default_rng(seed).standard_normal(LEVELS.shape)
        alarms += not compare_values(noisy(drawn, error), exact(LEVELS), tolerance_percent=0).agrees
    assert 2 <= alarms <= 20
    # Half a standard error of light, in all 72 values: seen.
    drawn = LEVELS + error * (1.5 + np.random.default_rng(0).standard_normal(LEVELS.shape))
    result = compare_values(noisy(drawn, error), exact(LEVELS), tolerance_percent=0)
    assert not result.agrees
    assert result.beyond == 0


def test_saturated_values_are_left_out_and_named():
    lost = np.zeros(LEVELS.shape, dtype=bool)
    lost[0, 2] = True
    wrong = LEVELS.copy()
    wrong[0, 2] = 1.0
    other = PatchValues(NAMES, ("R", "G", "B"), "e", wrong, np.zeros_like(LEVELS), lost)
    result = compare_values(other, exact(LEVELS))
    assert result.agrees
    assert "left out as saturated: patch 0 (B)" in result.notes


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"unit": "dn"}, "unit"),
        ({"names": ("white", *NAMES[1:])}, "the reference has no patch 'white'"),
        ({"channels": ("R", "G", "X")}, "the reference has no channel 'X'"),
        ({"names": (NAMES[1], *NAMES[1:])}, "patch names"),
        ({"unit": "mV"}, "unit"),
        ({"mean": LEVELS * np.nan}, "mean"),
        ({"mean": LEVELS[:5]}, "mean"),
    ],
)
def test_values_that_cannot_be_compared(change, what):
    facts = {"names": NAMES, "channels": ("R", "G", "B"), "unit": "e", "mean": LEVELS} | change
    with raises(InputError, what):
        compare_values(PatchValues.exact(**facts), exact(LEVELS))


@pytest.mark.parametrize("wrong", [{"level": 0.0}, {"level": 1.0}, {"tolerance_percent": -1.0}])
def test_invalid_levels_and_tolerances(wrong):
    with pytest.raises(InputError) as caught:
        compare_values(exact(LEVELS), exact(LEVELS), **wrong)
    assert {caught.value.what: caught.value.value} == wrong
