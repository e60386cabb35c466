"""Coarse converters: intervals hold at any phase of the mean; below a third of a step there is only a limit."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.quantization import (
    remaining_fraction,
    rounding_error,
    rounding_uncertainty,
    with_rounding,
)
from photosite.calibration.spatial.nonuniformity import VarianceComponents
from photosite.frames.frame_set import FrameSet
from photosite.values.uncertain import Uncertain

GAIN, SHAPE = 0.02, (60, 80)


def coarse(noise, black, seed=0):
    """An 8-bit camera of 50 electrons a step."""
    rng = np.random.default_rng([seed, 71, round(1e3 * noise), round(1e3 * black)])
    response, frames = 1.0 + 0.01 * rng.standard_normal(SHAPE), []
    for i in range(12):
        for kind, electrons in (("dark", 0.0), ("light", 900.0 * i + 300.0)):
            for _ in range(16 if i == 5 else 2):
                signal = GAIN * rng.poisson(electrons * response) if electrons else 0.0
                dn = np.clip(np.rint(black + signal + noise * rng.standard_normal(SHAPE)), 0, 255).astype(np.uint16)
                frames.append((kind, 1e-3 * (i + 1), dn, 2.0 * electrons))
    return calibrate(FrameSet.from_arrays(frames, bits=8))


@pytest.mark.parametrize("mean", [6.0, 6.2, 6.35, 6.5])
@pytest.mark.parametrize("sd", [0.1, 0.3, 0.5, 0.8])
def test_the_series_is_that_of_rounded_normals(mean, sd):
    """Against the sum over the whole numbers, weighted by their probability."""
    from scipy.special import ndtr

    steps = np.arange(-5, 20)
    fraction = ndtr((steps + 0.5 - mean) / sd) - ndtr((steps - 0.5 - mean) / sd)
    read = float(fraction @ steps)
    of_mean, of_variance = rounding_error(mean, sd)
    assert float(of_mean) == pytest.approx(read - mean, abs=1e-9)
    assert float(of_variance) == pytest.approx(float(fraction @ (steps - read) ** 2) - sd**2 - 1 / 12, abs=1e-9)


@pytest.mark.parametrize("black", [6.0, 6.25, 6.5])
@pytest.mark.parametrize("noise", [0.3, 0.5, 0.8])
def test_intervals_hold_at_any_phase(noise, black):
    """The effect is systematic, so the truth must lie inside at every phase (five parameters, 9 sets: the ends allow
    3.3 / 1.96 of the half-widths, exceeded once in 1000)."""
    found = coarse(noise, black)

    def held(estimate, truth):
        low, high = estimate.interval_95
        middle = estimate.value
        return middle - 1.68 * (middle - low) <= truth <= middle + 1.68 * (high - middle)

    assert held(found.black_level_dn, black)
    assert held(found.system_gain_dn_per_e, GAIN)
    for estimate, truth in (
        (found.read_noise_dn, noise),
        (found.read_noise_e, noise / GAIN),
        (found.temporal_dark_noise_e, noise / GAIN),
    ):
        if estimate.value is None:
            assert noise < 0.45
            assert estimate.upper_limit_95 > truth
            assert estimate.reason_id == "noise-hidden-by-quantization"
        else:
            assert held(estimate, truth)


def test_a_hidden_read_noise_has_a_limit_and_no_value():
    """A fifth of a step, the mean on a whole number: one number in 80 differs, and its variance shows nothing."""
    found = coarse(0.2, 6.0)
    assert found.read_noise_dn.value is None
    assert found.read_noise_dn.upper_limit_95 > 0.2
    for estimate in (found.read_noise_e, found.temporal_dark_noise_e):
        assert estimate.value is None
        assert estimate.upper_limit_95 > 0.2 / GAIN
    assert limits(found)["noise-hidden-by-quantization"] < 0.24
    assert not {"lines-alike", "negative-variance"} & set(limits(found))


def test_nothing_changes_above_one_step():
    of_mean, of_variance, of_pixel = rounding_uncertainty(1.0 + 1 / 12, 1e-3, 0.0)
    assert of_mean == of_pixel < 1e-8
    assert of_variance < 1e-6
    assert rounding_uncertainty(float("nan"), float("nan"), 0.0) == (0.0, 0.0, 0.0)


def test_pixels_of_many_phases_reduce_the_uncertainty():
    assert rounding_uncertainty(0.2, 1e-3, 1.0)[1] < 0.15 * rounding_uncertainty(0.2, 1e-3, 0.0)[1]
    assert remaining_fraction(-1.0) == 1.0
    assert 0.0 < remaining_fraction(100.0) < remaining_fraction(0.01) < 1.0


@pytest.mark.parametrize("black", [4.3, 4.4, 4.47, 4.5, 4.6])
def test_rounding_between_two_numbers_enlarges_the_spread_of_dark_frames(black):
    """A DSNU of 0.066 DN at a noise of 0.09 DN measures up to 0.23 DN."""
    rng, frames = np.random.default_rng([9, round(100 * black)]), []
    offset = rng.normal(black, 0.066, SHAPE)
    for kind, electrons in (("dark", 0.0), *(("light", 1000.0 * i) for i in range(1, 9))):
        for _ in range(8):
            dn = offset + GAIN * rng.poisson(electrons, SHAPE) + rng.normal(0.0, 0.09, SHAPE)
            frames.append((kind, 1e-3, np.clip(np.rint(dn), 0, 255).astype(np.uint16), 2.0 * electrons))
    found = calibrate(FrameSet.from_arrays(frames, bits=8))
    for estimate in (found.dsnu_e, found.dsnu1288_e):
        low, high = estimate.interval_95
        assert low < 0.066 / GAIN < high


def test_the_interval_of_a_rounded_spread_ends_at_the_largest_change():
    """0.2 DN of spread whose pixels have errors of 0.1 DN at most, in proportion to their means."""
    error = 0.1 / np.sqrt(2.0)
    low, high = with_rounding(Uncertain(0.2**2), error).interval_95
    assert high == pytest.approx(0.2**2 + (2.0 * 0.2 + error) * error)
    assert low == pytest.approx(0.2**2 - (2.0 * 0.2 + error) * error)


@pytest.mark.parametrize("sd", [0.1, 0.2, 0.3])
def test_means_of_lines_are_rounded_as_means_of_all_pixels(sd):
    """400 rows of 200 pixels with 0.15 DN of DSNU: the errors of the rows' means, which differ by 0.05 DN."""
    rng = np.random.default_rng(3)
    analog = 64.3 + 0.05 * rng.normal(size=(400, 1)) + 0.15 * rng.normal(size=(400, 200))
    shift = rounding_error(analog, sd)[0]
    rows = (analog + shift).mean(axis=1).var(ddof=1) - (analog + shift).var(axis=1, ddof=1).mean() / 200
    before = analog.mean(axis=1).var(ddof=1) - analog.var(axis=1, ddof=1).mean() / 200
    mean_error, _, pixel_error = rounding_uncertainty(sd**2 + 1.0 / 12.0, 1e-4, 0.15**2)
    none = Uncertain(0.0)
    row = VarianceComponents(none, Uncertain(rows), none, none).with_rounding(pixel_error, mean_error).row
    assert abs(row.value - before) < row.interval_95[1] - row.value
    assert row.standard_uncertainty <= with_rounding(Uncertain(rows), pixel_error).standard_uncertainty
