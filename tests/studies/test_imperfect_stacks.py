"""What a calibration answers to stacks of frames that are not clean."""

from __future__ import annotations

import pytest

from photosite.studies.imperfect_stacks import GAIN, KINDS, SATURATION_E, Answer, StackKind, imperfect_stacks

_BY_NAME = {kind.name: kind for kind in KINDS}


def answer(name: str, seed: int = 2) -> Answer:
    (found,) = imperfect_stacks([seed], [_BY_NAME[name]])
    return found


@pytest.mark.parametrize("name", ["crosstalk", "image lag", "flicker of the light"])
def test_the_gain_is_corrected(name: str) -> None:
    found = answer(name)
    assert not isinstance(found.gain, str)
    low, high = found.gain
    # Without the correction the gain is 15 % low, 6 % low and 25 % high.
    assert low <= GAIN <= high
    assert high - low < 0.07 * GAIN
    assert found.right
    assert found.warnings


@pytest.mark.parametrize("name", ["smoothing in the camera", "sharpening in the camera", "noise reduction over time"])
def test_noise_of_filtered_frames_is_withheld(name: str) -> None:
    found = answer(name)
    assert isinstance(found.gain, str)
    assert isinstance(found.prnu, str)


@pytest.mark.parametrize(
    "name", ["bent response", "bent response, 4th power", "knee of the response", "soft saturation"]
)
def test_the_gain_of_a_bent_response_is_that_at_small_signal(name: str) -> None:
    found = answer(name)
    assert found.right
    assert any("bends" in warning for warning in found.warnings)


@pytest.mark.parametrize("factor", [1.8, 2.0])
def test_soft_saturation_with_few_levels_below_withholds_the_gain(factor: float) -> None:
    """One or two levels are below 70 % of the largest variance; with two, a line through them is 25 % low."""
    kind = StackKind("", "", charge=lambda e, rng: e / (1.0 + (factor - 1.0) * e / SATURATION_E))
    (found,) = imperfect_stacks([1], [kind])
    assert isinstance(found.gain, str)
    assert isinstance(found.prnu, str)
    assert any("soft saturation" in warning for warning in found.warnings)


@pytest.mark.parametrize("name", ["mosaic not stated", "wrong phase"])
def test_prnu_of_a_mosaic_stated_otherwise_is_withheld(name: str) -> None:
    found = answer(name)
    assert not isinstance(found.gain, str)
    assert isinstance(found.prnu, str)
    assert "RGGB" in found.prnu


def test_readout_channels_are_named() -> None:
    found = answer("readout channels")
    assert found.right
    assert any("2 columns" in warning for warning in found.warnings)


@pytest.mark.slow
def test_clean_stacks_are_right_and_not_reported() -> None:
    answers = list(imperfect_stacks(range(20), KINDS[:2]))
    # 40 stacks of two 95 % intervals: fewer than 30 right in 1 of 5000.
    assert sum(found.right for found in answers) >= 30
    structure = ("correlated", "flickers", "period")
    assert not [w for found in answers for w in found.warnings if any(word in w for word in structure)]
