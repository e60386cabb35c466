"""Bends of the response are found and taken into account, light and sensor are distinguished, straight ones pass."""

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.photon_transfer.noise_covariance import SharedCharge, SharedNoise
from photosite.calibration.photon_transfer.photon_transfer import LightLevels, fit_gain
from photosite.calibration.photon_transfer.response_curve import fit_bent_gain, unseen_fall
from photosite.frames.frame_set import FrameSet
from photosite.values.uncertain import COVERAGE_95, Source, Uncertain

GAIN, PIXELS, FRAMES, TOP_E, READ_E = 0.3, 17_280, 8, 10_000.0, 6.0


def power(n):
    """A fraction of the signal at the largest signal that grows with a power of the light: response and its slope."""
    return lambda e, size: (e * (1.0 + size * e ** (n - 1)), 1.0 + n * size * e ** (n - 1))


def knee(e, size, at=0.5):
    change = size / (1.0 - at)
    return e + change * np.maximum(e - at, 0.0), 1.0 + change * (e > at)


def soft(e, size):
    return e / (1.0 - size * e), 1.0 / (1.0 - size * e) ** 2


SHAPES = {"2nd power": power(2), "3rd power": power(3), "4th power": power(4), "knee": knee, "soft saturation": soft}


def light_levels(rng, shape="2nd power", size=0.0, *, levels=12, lamp=0.0, scatter=0.0, delay=0.0):
    """Levels of a sensor with a bend of a size at the largest signal, under light with errors."""
    x = np.arange(1, levels + 1) / levels
    e = x * (1.0 + lamp * x) * (1.0 + scatter * rng.normal(size=levels)) - delay
    response, slope = SHAPES[shape](e, size)
    dark = (GAIN * READ_E) ** 2
    noise = (GAIN * slope) ** 2 * e * TOP_E + dark
    relative = np.sqrt(2.0 / (PIXELS * (FRAMES - 1)))
    signal_u, dark_u = np.sqrt(noise / (PIXELS * FRAMES)), np.sqrt(dark / (PIXELS * FRAMES))
    everything = dict.fromkeys(LightLevels.__dataclass_fields__)
    seen = noise * (1.0 + relative * rng.normal(size=levels))
    return LightLevels(
        **everything
        | {
            "abscissa": "photons_per_pixel",
            "x": x * TOP_E,
            "exposure_s": x,
            "signal": GAIN * TOP_E * response + signal_u * rng.normal(size=levels) + dark_u * rng.normal(),
            "signal_covariance": np.diag(signal_u**2) + dark_u**2,
            "shot": seen - dark,
            "shot_covariance": np.diag((relative * seen) ** 2),
            "noise": seen,
            "noise_uncertainty": relative * seen,
            "noise_rounding": np.zeros(levels),
            "dark_fraction": np.zeros((levels, 1)),
            "dark_noise": (Uncertain(0.0),),
            "frame_scatter": np.zeros(levels),
            "trusted": np.ones(levels, np.bool_),
        }
    )


def analyzed(levels):
    use = [np.ones(len(levels.x), np.bool_)]
    return fit_gain([levels], use).uncertain[0], fit_bent_gain([levels], use, [None])


def pull(value, truth):
    return (value.value - truth) / value.standard_uncertainty


@pytest.mark.parametrize("size", [-0.1, -0.02, 0.005, 0.02, 0.1])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_gain_at_small_signal_is_found(shape, size):
    """To 3.3 uncertainties, where the line is wrong by the size of the bend at least."""
    levels = light_levels(np.random.default_rng(1), shape, size)
    line, bent = analyzed(levels)
    assert abs(line.value / GAIN - 1.0) > abs(size)
    assert abs(pull(bent.gain, GAIN)) < 3.3
    assert bent.gain.relative < max(0.7 * abs(size), 0.006)
    curve = bent.curves[0]
    use = np.ones(len(levels.x), np.bool_)
    assert abs(pull(curve.responsivity(levels, use), GAIN)) < 3.3  # DN per stated unit of light
    stretch = SHAPES[shape](np.ones(1), size)[0]
    assert abs(pull(curve.deviation_percent[-1], 100.0 * (stretch[0] - 1.0))) < 3.5


def test_straight_responses_keep_the_line():
    """One of 500 may be analyzed as bent: of 300, more than four are once in 2500."""
    rng = np.random.default_rng(2)
    assert sum(analyzed(light_levels(rng, levels=8))[1] is not None for _ in range(300)) <= 4


def test_non_linear_light_leaves_the_gain():
    """The means are bent against the stated light, but the variance is proportional to the signal."""
    levels = light_levels(np.random.default_rng(3), lamp=-0.04)
    line, bent = analyzed(levels)
    assert abs(pull(bent.gain, GAIN)) < 3.3
    assert bent.gain.standard_uncertainty < 3.0 * line.standard_uncertainty
    curve = bent.curves[0]
    assert not curve.bend[-1].beyond(3.29)
    assert curve.bend[-1].standard_uncertainty < 0.01
    assert abs(pull(curve.light_deviation_percent[-1], -4.0)) < 3.3


def test_a_bend_that_the_light_hides_is_found_in_the_variances():
    """Light and sensor bend against each other: the means are straight to 0.04 %, or to their noise."""
    for seed, to_noise in ((4, False), (5, True)):
        levels = light_levels(np.random.default_rng(seed), size=-0.02, lamp=0.02)
        if to_noise:
            levels = replace(levels, x=levels.signal / GAIN)
        line, bent = analyzed(levels)
        assert pull(line, GAIN) < -8.0
        assert abs(pull(bent.gain, GAIN)) < 3.3
    curve = bent.curves[0]
    assert curve.shape is None
    assert curve.bend[-1].value == 0.0
    assert 0.01 < curve.bend[-1].standard_uncertainty < 0.03


def test_a_shutter_delay_is_no_bend():
    line, bent = analyzed(light_levels(np.random.default_rng(5), delay=0.003))
    assert abs(pull(bent.gain, GAIN)) < 3.3
    assert bent.gain.standard_uncertainty < 1.5 * line.standard_uncertainty


def test_small_bends_that_could_be_either_widen_the_interval():
    """A bend of 0.1 %: gain with the sensor, and with the light as its cause, both within two uncertainties."""
    line, bent = analyzed(light_levels(np.random.default_rng(6), size=0.001, levels=5))
    assert abs(bent.gain.value - line.value) < 2.0 * bent.gain.standard_uncertainty
    assert 1.05 * line.standard_uncertainty < bent.gain.standard_uncertainty < 3.0 * line.standard_uncertainty
    assert not bent.curves[0].bend[-1].beyond(3.29)
    assert not bent.curves[0].light_bend(4).beyond(3.29)


def test_light_that_scatters_hides_a_bend_of_its_size_only():
    """The interval contains the truth, for steady and for scattering light."""
    rng = np.random.default_rng(7)
    pulls = [
        pull(analyzed(light_levels(rng, size=size, scatter=0.005, levels=8))[1].gain, GAIN)
        for size in (0.0, -0.02)
        for _ in range(8)
    ]
    assert np.abs(pulls).max() < 3.5


def test_channels_are_fitted_together():
    rng = np.random.default_rng(8)
    channels = [light_levels(rng, size=-0.03), light_levels(rng, size=-0.03, levels=8), light_levels(rng, size=-0.03)]
    used = [np.ones(len(levels.x), np.bool_) for levels in channels]
    bent, alone = fit_bent_gain(channels, used, [None] * 3), analyzed(channels[0])[1]
    assert abs(pull(bent.gain, GAIN)) < 3.3
    assert bent.gain.standard_uncertainty < 0.75 * alone.gain.standard_uncertainty
    assert [len(curve.bend) for curve in bent.curves] == [12, 8, 12]


@pytest.mark.parametrize("size", [-0.05, -0.03, 0.03])
@pytest.mark.parametrize("count", [2, 3])
def test_a_bend_that_two_or_three_levels_show_is_in_the_uncertainty(count, size):
    """The line through the origin is 7 to 13 standard errors off. 95 % of 80 intervals, less 4 standard deviations."""
    rng, held = np.random.default_rng(14), 0
    for _ in range(80):
        low, high = analyzed(light_levels(rng, size=size, levels=count))[1].gain.interval_95
        held += low <= GAIN <= high < 1.15 * low
    assert held >= 69


@pytest.mark.parametrize("count", [2, 3])
def test_few_levels_of_a_straight_response_keep_the_line(count):
    """One in 1000 sets is analyzed as bent: three of 80 or more in 1 of 12 000 tests."""
    rng = np.random.default_rng(15)
    assert sum(analyzed(light_levels(rng, levels=count))[1] is not None for _ in range(80)) <= 2


def brighter_fatter(levels, fraction):
    """Levels whose shot variance falls by a fraction for 10 000 electrons."""
    factor, dark = 1.0 - fraction * levels.signal / (GAIN * 1e4), (GAIN * READ_E) ** 2
    return replace(levels, shot=levels.shot * factor, noise=(levels.noise - dark) * factor + dark)


@pytest.mark.parametrize(("fraction", "least"), [(0.0, 107), (0.005, 68), (0.01, 88)])
def test_a_fall_of_the_variances_that_is_not_excluded_is_in_the_uncertainty(fraction, least):
    """95, 69 and 84 % of intervals hold, less 3 standard deviations of 120; 94, 36 and 14 % without the fall."""
    rng, held, widened = np.random.default_rng(16), 0, 0
    for _ in range(120):
        levels = brighter_fatter(light_levels(rng), fraction)
        line, bent = analyzed(levels)
        fall = unseen_fall([levels], [np.ones(len(levels.x), np.bool_)], line.value)
        wider = Uncertain.of(0.0, fall * line.value, Source(0.0, COVERAGE_95))
        gain = line + wider if bent is None else bent.gain
        low, high = gain.interval_95
        held, widened = held + (low <= GAIN <= high), widened + (fall > 0.0)
    assert held >= least
    if fraction == 0.0:
        assert widened <= 30  # 15 % of 120 and 3 standard deviations


@pytest.mark.parametrize("correlation", [0.03, -0.03])
def test_a_suspected_correlation_widens_the_gain_to_one_side(correlation):
    """Charge that pixels share makes the gain of variances too low, never too high."""
    levels = replace(light_levels(np.random.default_rng(17)), frames=np.full(12, FRAMES))
    charge = SharedCharge(Uncertain.of(1.0, 0.03), np.empty(0))
    _, factor = SharedNoise(None, None, (charge,), suspected=correlation).summed_covariances([levels], [0])
    assert factor.interval_95 == pytest.approx(sorted((1.0, 1.0 + 1.96 * correlation)), abs=1e-4)


@pytest.mark.parametrize("lights", [1, 2, 3])
def test_few_different_levels_show_no_bend_of_the_means(lights):
    levels = light_levels(np.random.default_rng(9), levels=20)
    levels = replace(levels, x=TOP_E * (1.0 + np.arange(20) % lights), shot=GAIN * levels.signal)
    assert analyzed(levels)[1] is None


def stack(seed, shape="2nd power", size=0.0, *, levels=8, rows=120, cols=144, lamp=0.0):
    """Frames whose electrons, noise included, pass a bend before the converter; photons are 2 per electron."""
    rng = np.random.default_rng(seed)
    response, offset = 1.0 + 0.008 * rng.normal(size=(rows, cols)), 64.0 + 0.6 * rng.normal(size=(rows, cols))

    def take(kind, exposure_s, electrons, photons=None):
        shots = []
        for _ in range(FRAMES):
            charge = rng.poisson(electrons * response) / 14_000.0
            signal = 14_000.0 * SHAPES[shape](charge, size)[0] + rng.normal(0.0, READ_E, (rows, cols))
            dn = np.clip(np.rint(offset + GAIN * signal), 0, 4095).astype(np.uint16)
            shots.append((kind, exposure_s, dn, photons))
        return shots

    darks = [take("dark", t, 0.0) for t in (0.01, 0.1, 1.0)]
    x = np.linspace(0.1, 1.1, levels)
    lights = [take("light", 0.1 * t, 14_000.0 * t * (1.0 + lamp * t), 28_000.0 * t) for t in x]
    return FrameSet.from_arrays([shot for group in (*darks, *lights) for shot in group], bits=12)


@pytest.fixture(scope="module")
def bent():
    return calibrate(stack(1, size=-0.03))


def test_a_bent_stack_is_corrected(bent):
    """Gain, quantum efficiency, PRNU, read noise and well, where the line is 4 % off at 12 of its uncertainties."""
    truths = {
        "system_gain_dn_per_e": GAIN,
        "quantum_efficiency_percent": 50.0,
        "responsivity_dn_per_photon": GAIN / 2,
        "read_noise_e": READ_E,
        "prnu_percent": 0.8,
        "prnu1288_percent": 0.8,
    }
    for name, truth in truths.items():
        entry = getattr(bent, name)
        assert abs(entry.value - truth) < 3.3 * entry.standard_uncertainty, name
    line = bent.by_line.system_gain_dn_per_e
    assert "response curve" in bent.system_gain_dn_per_e.method
    assert "slope through the origin" in line.method
    assert (GAIN - line.value) / line.standard_uncertainty > 5.0
    e = np.linspace(0.0, 1.2, 1000)
    well = 14_000.0 * float(np.interp(4031.0 / GAIN / 14_000.0, power(2)(e, -0.03)[0], e))
    assert abs(pull(bent.clipped_electrons, well)) < 3.3
    assert bent.clipped_electrons.standard_uncertainty < 0.005 * well


def test_the_warning_names_the_bend_and_its_size(bent):
    top = max(s for s in bent.response_curve["M"].signal_dn if s <= bent.linear_range["M"].highest_dn)
    place = list(bent.response_curve["M"].signal_dn).index(top)
    deviation = bent.response_curve["M"].deviation_percent[place].value
    assert limits(bent)["bent-response"] == pytest.approx(deviation / 100.0)


def test_the_standard_s_figures_stay_those_of_lines(bent):
    found = bent.emva1288
    assert found["K"].value == pytest.approx(bent.curves["M"]["photon_transfer"].slope, rel=1e-12)
    assert found["R"].value == pytest.approx(bent.curves["M"]["response"].slope, rel=1e-12)
    assert found["eta"].value == pytest.approx(100.0 * found["R"].value / found["K"].value, rel=1e-12)
    entry = bent.to_dict()["emva1288"]["mu_e_sat"]
    assert entry["unit"] == "e⁻"
    assert entry["value"] == found["mu_e_sat"].value != bent.saturation_capacity_e.value
    assert "reason" in bent.to_dict()["emva1288"]["mu_e_sat_area"]
    assert bent.to_dict()["response_curve"]["M"]["electrons"][-1] == pytest.approx(bent.clipped_electrons.value)


def test_both_agree_where_the_response_is_straight():
    clean = calibrate(stack(2, rows=64, cols=64))
    # The standard weights all levels equally, and its saturation is at the largest variance.
    for name, line in clean.by_line.estimates().items():
        best = clean.estimates()[name]
        if best.value is None or name.startswith("saturation_capacity") or name in {"snr_max_db", "dynamic_range_db"}:
            continue
        assert abs(line.value - best.value) <= 2.0 * line.standard_uncertainty, name
    assert clean.by_line.saturation_capacity_e.value < clean.saturation_capacity_e.value
    assert clean.response_curve == {}
    assert not clean.warnings


def test_errors_of_the_light_are_named():
    found = calibrate(stack(3, lamp=-0.03))
    assert set(limits(found)) == {"nonlinear-light"}
    gain, efficiency = found.system_gain_dn_per_e, found.quantum_efficiency_percent
    assert abs(gain.value - GAIN) < 3.3 * gain.standard_uncertainty
    assert efficiency.standard_uncertainty > 2.0 * found.by_line.quantum_efficiency_percent.standard_uncertainty
    assert efficiency.interval_95[0] < 50.0 < efficiency.interval_95[1]


@pytest.mark.slow
def test_pulls_of_small_stacks():
    """Of 120 stacks with bends of all kinds, fewer than 108 intervals of 95 % hold the truth in 1 of 100 by chance."""
    sizes = (-0.05, -0.02, -0.005, 0.005, 0.02, 0.05)
    inside = {"system_gain_dn_per_e": [], "quantum_efficiency_percent": [], "prnu_percent": []}
    truth = {"system_gain_dn_per_e": GAIN, "quantum_efficiency_percent": 50.0, "prnu_percent": 0.8}
    for k, (shape, size) in enumerate((shape, size) for shape in SHAPES for size in sizes for _ in range(4)):
        found = calibrate(stack(100 + k, shape, size, rows=64, cols=72, levels=12))
        for name, covered in inside.items():
            low, high = getattr(found, name).interval_95
            covered.append(low <= truth[name] <= high)
    for name, covered in inside.items():
        assert np.mean(covered) >= 0.9, name
