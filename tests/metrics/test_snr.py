"""The noise budget against published values, its closed form and a simulated pixel."""

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.snr import noise_budget, signal_at_snr_e
from photosite.sensor.noise_terms import NoiseTerms
from photosite.sensor.readout import digital_numbers
from photosite.studies.gray_surface import total_variance_e2


@pytest.fixture(scope="module")
def d200():
    return ps.load_sensor("nikon-d200")


def test_the_d200_at_full_swing(d200):
    # Farrell et al. (2008), Table 1 in the footnote's formula, Figure 6: to the two decimals published.
    budget = noise_budget(d200, 1.08)
    for name, wanted in {"total": 38.10, "shot": 45.56, "read": 66.35, "dsnu": 65.86, "prnu": 38.97}.items():
        assert getattr(budget, f"{name}_db") == pytest.approx(wanted, abs=0.005), name


def test_variances_add(d200):
    budget = noise_budget(d200, np.geomspace(1e-4, 1.08, 50))
    parts = (budget.shot_db, budget.read_db, budget.dsnu_db, budget.prnu_db)
    np.testing.assert_allclose(10 ** (-budget.total_db / 10), sum(10 ** (-part / 10) for part in parts), rtol=1e-12)


def test_slopes_of_the_sources(d200):
    # Ten times the signal: shot +10 dB, constant noises +20 dB, PRNU unchanged.
    budget = noise_budget(d200, [0.1, 1.0])
    steps = [float(np.diff(getattr(budget, f"{n}_db"))[0]) for n in ("shot", "read", "dsnu", "prnu")]
    np.testing.assert_allclose(steps, [10, 20, 20, 0], atol=1e-9)


def test_crossings_balance_the_sources(d200):
    budget = noise_budget(d200, 1.0)
    low = noise_budget(d200, budget.dark_limited_below_volts)
    high = noise_budget(d200, budget.prnu_limited_above_volts)

    def variance(at, *names):
        return sum(10 ** (-float(getattr(at, f"{name}_db")) / 10) for name in names)

    assert variance(low, "read", "dsnu") == pytest.approx(variance(low, "shot", "prnu"), rel=1e-9)
    assert variance(high, "prnu") == pytest.approx(variance(high, "read", "dsnu", "shot"), rel=1e-9)
    assert 0 < budget.dark_limited_below_volts < budget.prnu_limited_above_volts < 1.08


def test_absent_noise_gives_infinite_snr(d200):
    budget = noise_budget(d200.with_(read_noise_mv=0, dsnu_mv=0, prnu_percent=0), [0.1, 1.0])
    for part in (budget.read_db, budget.dsnu_db, budget.prnu_db):
        assert (part == np.inf).all()
    np.testing.assert_array_equal(budget.total_db, budget.shot_db)
    assert budget.dark_limited_below_volts == 0.0
    assert budget.prnu_limited_above_volts == np.inf


def test_shape_follows_volts(d200):
    assert noise_budget(d200, np.full((2, 3), 0.5)).total_db.shape == (2, 3)
    assert noise_budget(d200, 0.5).total_db.shape == ()


@pytest.mark.parametrize("volts", [0.0, -0.1, np.nan, np.inf, [0.5, 0.0]])
def test_voltages_must_be_above_0(d200, volts):
    with raises(InputError, "volts"):
        noise_budget(d200, volts)


def test_total_agrees_with_a_simulated_uniform_field(d200):
    # 10^6 pixels: the standard deviation has an error of 0.07 %, 0.006 dB; the bound is five of those.
    rng = np.random.default_rng(38)
    pixels = 1_000_000
    for volts in (0.005, 0.1):
        signal = volts / 30e-6
        seen = rng.poisson(signal * (1 + rng.normal(0, 0.01126, pixels)))
        seen = seen + rng.normal(0, 0.55 / 0.03, pixels) + rng.normal(0, 0.52 / 0.03, pixels)
        shown = 20 * np.log10(signal / seen.std())
        assert noise_budget(d200, volts).total_db == pytest.approx(shown, abs=0.03)


@pytest.mark.parametrize("preset", ["nikon-d200", "vendor-2.2um", "vendor-1.4um"])
@pytest.mark.parametrize("snr_db", [-20.0, 0.0, 20.0, 35.0])
def test_signal_at_a_ratio_inverts_the_budget(preset, snr_db):
    sensor = ps.load_sensor(preset)
    volts = signal_at_snr_e(sensor, snr_db) * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    assert noise_budget(sensor, volts).total_db == pytest.approx(snr_db, abs=1e-9)


def test_ratio_above_the_prnu_limit(d200):
    with pytest.raises(InputError) as caught:
        signal_at_snr_e(d200, 39.0)
    assert (caught.value.what, caught.value.expected) == ("snr_db", "below 38.97, the limit by PRNU")
    assert signal_at_snr_e(d200.with_(prnu_percent=0, read_noise_mv=0, dsnu_mv=0), 40.0) == pytest.approx(1e4)


EFFECTS = {
    "none": {},
    "multiplication": {"em_gain": {"gain": 50, "stages": 500, "clock_induced_charge_e": 0.5}},
    "coupling": {"interpixel_capacitance": {"coupling_percent": 3, "diagonal_percent": 1}},
    "curve": {"polynomial_percent": [0.0, -25.0]},
    "blinking": {"telegraph_noise": {"fraction": 0.5, "amplitude_e": 20}},
    "channels": {"readout_channels": {"relative_gain": [[1.02, 0.98]], "offset_e": [[6, -6]]}},
    "bits": {"output": {"dropped_bits": 4}},
    "companding": {"output": {"companding": "square_root", "companded_bits": 8, "decoded": True}},
}


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS.keys())
@pytest.mark.parametrize("signal_e", [0.0, 60.0, 3000.0])
def test_variance_of_a_simulated_frame_with_an_effect(effect, signal_e) -> None:
    # 60 000 pixels: the standard error of a variance is 0.6 %; 24 comparisons at 5 standard errors, false in 1e-5.
    plain = ps.load_sensor("nikon-d200").with_(
        rows=200,
        cols=300,
        cfa="mono",
        channels={"M": {"wavelength_nm": [550], "quantum_efficiency": [0.5]}},
        bits=14,
        read_noise_e=6,
        dsnu_e=4,
        prnu_percent=1,
        black_level_dn=300,
        well_capacity_e=4000,
        system_gain_dn_per_e=0.05 if "em_gain" in effect else 3.0,
    )
    curve = {"response_curve": effect} if "polynomial_percent" in effect else effect
    sensor = plain.with_(**curve)
    dn = digital_numbers(sensor, np.full((200, 300), signal_e, np.float32), 0.01, seed=3).astype(np.float64)
    terms = NoiseTerms(sensor)
    scale = sensor.system_gain_dn_per_e * terms.multiplication * float(terms.slope(signal_e))
    if sensor.effects is not None and sensor.effects.output is not None and sensor.effects.output.dropped_bits:
        dn *= 2.0**sensor.effects.output.dropped_bits
    assert dn.var() / scale**2 == pytest.approx(float(total_variance_e2(sensor, signal_e, 0.0)), rel=0.03), signal_e
