"""The fit of the fill factor against drawn truths, closed forms and calls that cannot be."""

import json
from dataclasses import replace

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.metrics.patches import PatchStatistics
from photosite.validation.fill_factor import fit_fill_factor

PATCHES, CHANNELS = 24, ("R", "G", "B")
LEVELS = np.outer(np.geomspace(30.0, 900.0, PATCHES), [1.0, 0.9, 0.3])


def statistics(mean_dn, error_dn):
    mean = np.asarray(mean_dn, dtype=np.float64)
    error = np.broadcast_to(np.asarray(error_dn, dtype=np.float64), mean.shape).copy()
    pixels = np.full(mean.shape, 400)
    noise = error * np.sqrt(pixels)
    return PatchStatistics(
        names=tuple(f"patch {i}" for i in range(len(mean))),
        channels=CHANNELS[: mean.shape[1]],
        frames=1,
        pixels=pixels,
        mean_dn=mean,
        standard_error_dn=error,
        spatial_noise_dn=noise,
        spatial_variance_error_dn2=noise**2 * np.sqrt(2 / 399),
        temporal_noise_dn=None,
        saturated_fraction=np.zeros_like(mean),
        mean_e=None,
    )


def drawn(seed, scale, patch_scatter, noise):
    """A measured and a simulated chart: light that differs from patch to patch, and noise of relative size at 900."""
    rng = np.random.default_rng(seed)
    error = noise * np.sqrt(900.0 * LEVELS)
    light = 1.0 + patch_scatter * rng.standard_normal((PATCHES, 1))
    measured = scale * LEVELS * light + error * rng.standard_normal(LEVELS.shape)
    simulated = LEVELS + error * rng.standard_normal(LEVELS.shape)
    return statistics(measured, error), statistics(simulated, error)


def as_if_independent(fit):
    """The interval that 72 independent points would give: what the fit must not do."""
    residuals = fit.residuals.compressed()
    return 1.96 * fit.value * residuals.std(ddof=1) / np.sqrt(residuals.size)


@pytest.mark.parametrize(
    ("patch_scatter", "noise"),
    [
        pytest.param(0.01, 0.0003, id="light"),
        pytest.param(0.0, 0.003, id="noise", marks=pytest.mark.slow),
        pytest.param(0.005, 0.005, id="both", marks=pytest.mark.slow),
    ],
)
def test_the_interval_holds_the_truth_95_times_in_100(patch_scatter, noise):
    # 400 charts: a fraction of 0.95 is found to 0.011. The bounds are 3 of that below and above (false alarms 0.3 %),
    # and would miss an interval of 1.73 times too small a reach (a fraction of 0.74) in less than one of 10^12 runs.
    truth, start = 0.87, 0.9
    fits = [fit_fill_factor(*drawn(seed, truth / start, patch_scatter, noise), start) for seed in range(400)]
    covered = np.mean([fit.interval_95[0] <= truth <= fit.interval_95[1] for fit in fits])
    assert 0.917 <= covered <= 0.983
    pulls = np.array([(fit.value - truth) / fit.standard_error for fit in fits])
    assert abs(pulls.mean()) < 4 * pulls.std() / np.sqrt(len(fits))
    if patch_scatter == 0.01:
        shared = np.array([fit.patch_scatter for fit in fits])
        assert shared.mean() == pytest.approx(0.01, rel=0.03)
        assert np.mean([abs(fit.value - truth) < as_if_independent(fit) for fit in fits]) < 0.85
        assert {fit.degrees_of_freedom for fit in fits} == {23}


def test_chi_square_is_fair_to_noise_and_sees_uneven_light():
    # 300 charts; with noise alone p is even over 0 to 1, so below 0.05 in 5 % of them: 1.3 % is one standard error.
    alike = [fit_fill_factor(*drawn(seed, 0.95, 0.0, 0.002), 0.9).chi_square for seed in range(300)]
    assert np.mean([found.p_value < 0.05 for found in alike]) < 0.10
    assert np.mean([found.statistic for found in alike]) == pytest.approx(71, rel=0.03)
    uneven = [fit_fill_factor(*drawn(seed, 0.95, 0.01, 0.002), 0.9).chi_square for seed in range(20)]
    assert max(found.p_value for found in uneven) < 1e-3


def test_without_scatter_the_answer_is_the_ratio():
    measured, simulated = statistics(0.8 * LEVELS, 0.01), statistics(LEVELS, 0.01)
    fit = fit_fill_factor(measured, simulated, fill_factor=0.5)
    assert fit.value == pytest.approx(0.4, rel=1e-12)
    assert fit.patch_scatter == 0.0
    assert np.abs(fit.residuals).max() < 1e-12
    # v = (1 + 0.8^2) 0.01^2 / level^2, so the residuals in their own noise are in closed form too.
    np.testing.assert_allclose(fit.residual_noise, np.sqrt(1.64) * 0.01 / (0.8 * LEVELS), rtol=1e-9)


def test_weights_and_error_where_noise_rules():
    """Noise of one size in every point: the weighted fit is plain least squares, its error the textbook's."""
    rng = np.random.default_rng(11)
    x = np.geomspace(30.0, 900.0, PATCHES)[:, None]
    y = 0.8 * x + 0.5 * rng.standard_normal(x.shape)
    fit = fit_fill_factor(statistics(y, 0.8), statistics(x, 1e-6), fill_factor=1.0)  # noise stated amply
    assert fit.patch_scatter == 0.0
    slope = float((x * y).sum() / (x * x).sum())
    error = np.sqrt(((y - slope * x) ** 2).sum() / 23 / (x * x).sum())
    assert fit.value == pytest.approx(slope, rel=1e-6)
    assert fit.standard_error == pytest.approx(error, rel=1e-6)
    assert fit.interval_95[1] - fit.value == pytest.approx(2.0686576 * error, rel=1e-6)
    json.dumps(fit.to_dict(), allow_nan=False)


def test_where_it_was_simulated_does_not_matter():
    measured, simulated = drawn(3, 0.95, 0.01, 0.001)
    other = replace(simulated, mean_dn=0.4 * simulated.mean_dn, standard_error_dn=0.4 * simulated.standard_error_dn)
    one, two = fit_fill_factor(measured, simulated, 1.0), fit_fill_factor(measured, other, 0.4)
    for name in ("value", "standard_error", "interval_95", "patch_scatter"):
        assert getattr(one, name) == pytest.approx(getattr(two, name), rel=1e-9)
    np.testing.assert_allclose(one.residuals, two.residuals, atol=1e-12)


def test_residuals_are_the_light_that_was_put_in():
    light = 1 + 0.015 * np.linspace(-1, 1, PATCHES)[:, None]
    fit = fit_fill_factor(statistics(LEVELS * light, 1e-3), statistics(LEVELS, 1e-3), 0.9)
    np.testing.assert_allclose(fit.residuals, np.broadcast_to(light - 1, LEVELS.shape), atol=2e-6)
    # Weights are as good as equal, so the error is that of a mean of 24.
    assert fit.standard_error / fit.value == pytest.approx(light.std(ddof=1) / np.sqrt(24), rel=1e-3)


def test_a_channel_that_differs_shows_in_its_own_fit():
    measured, simulated = drawn(4, 0.9, 0.002, 0.0005)
    blue = replace(measured, mean_dn=measured.mean_dn * [1.0, 1.0, 1.05])
    fit = fit_fill_factor(blue, simulated, 1.0)
    by = fit.by_channel
    assert abs(by["R"].value - by["G"].value) < 0.003
    assert by["B"].value / by["G"].value == pytest.approx(1.05, abs=0.003)


def test_saturated_and_black_points_are_left_out():
    measured, simulated = drawn(5, 0.95, 0.01, 0.001)
    plain = fit_fill_factor(measured, simulated, 0.9)
    spoiled = measured.mean_dn.copy()
    spoiled[20:, 0] = 500.0
    fraction = np.zeros_like(spoiled)
    fraction[20:, 0] = 0.5
    dark = simulated.mean_dn.copy()
    dark[0] = -0.2
    fit = fit_fill_factor(
        replace(measured, mean_dn=spoiled, saturated_fraction=fraction), replace(simulated, mean_dn=dark), 0.9
    )
    assert not fit.used[20:, 0].any()
    assert not fit.used[0].any()
    assert fit.used.sum() == 72 - 4 - 3
    assert fit.residuals.mask.sum() == 7
    assert abs(fit.value - plain.value) < plain.standard_error
    assert fit.chi_square.degrees_of_freedom == 64
    assert fit.to_dict()["residuals"][0] == [None, None, None]


def test_invalid_calls():
    measured, simulated = drawn(6, 0.95, 0.0, 0.001)
    for wrong in (0.0, 1.2, float("nan")):
        with raises(InputError, "fill_factor"):
            fit_fill_factor(measured, simulated, wrong)
    with raises(InputError, "measured and simulated patches"):
        fit_fill_factor(replace(measured, names=measured.names[::-1]), simulated, 0.9)
    with raises(InputError, "measured and simulated patches"):
        fit_fill_factor(measured, replace(simulated, channels=("G", "R", "B")), 0.9)
    with raises(InputError, "usable patches", value=0):
        fit_fill_factor(replace(measured, saturated_fraction=np.ones_like(LEVELS)), simulated, 0.9)
    with raises(InputError, "the measured patches are"):
        fit_fill_factor(replace(measured, mean_dn=-measured.mean_dn), simulated, 0.9)
