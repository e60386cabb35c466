"""Figure 7: the two pixels against closed forms, and the presets against the stated assumptions."""

from __future__ import annotations

import json

import numpy as np
import pytest

import photosite as ps
from photosite.studies.farrell2008.drawing import listing
from photosite.studies.farrell2008.pixel_size import LUMINANCES_CD_M2, pixel_sizes

AREAS = (1.4 / 2.2) ** 2


def test_the_small_pixel_is_scaled_as_stated() -> None:
    large, small = ps.load_sensor("vendor-2.2um"), ps.load_sensor("vendor-1.4um")
    for name in ("fill_factor", "conversion_gain_uv_per_e", "voltage_swing_v"):
        assert small.measured(name).value == large.measured(name).value, name
    for name in ("read_noise_mv", "dsnu_mv", "prnu_percent", "dark_voltage_mv_per_s"):
        assert small.measured(name).value == large.measured(name).value, name
    for name, channel in large.channels.items():
        assert small.channels[name].quantum_efficiency == channel.quantum_efficiency
    assert small.pixel.well_capacity_e.value == pytest.approx(large.pixel.well_capacity_e.value * AREAS, rel=2e-4)
    for wanted in ("(2.2 / 1.4)² = 2.47", "0.405", "4050", "66 ms", "f/2.8"):
        assert any(wanted in line for line in listing("pixel_size_assumptions").lines), wanted
    assert (round(1 / AREAS, 2), round(AREAS, 3)) == (2.47, 0.405)


def test_signal_scales_with_the_area(sizes) -> None:
    large, small = sizes.pixel(2.2, False), sizes.pixel(1.4, False)
    assert small.electrons_per_cd_m2 / large.electrons_per_cd_m2 == pytest.approx(AREAS, rel=1e-6)
    # From lens and quantum efficiency, for the green 2.2 um pixel under CIE A.
    from photosite.color.colorimetry import luminance_cd_m2
    from photosite.color.illuminants import illuminant
    from photosite.color.spectrum import photons_from_energy

    grid = np.arange(380.0, 781.0, 10.0)
    light = photons_from_energy(illuminant("A", grid), grid)
    light /= luminance_cd_m2(light, grid)
    m = 4.88e-3 / (1.2 - 4.88e-3)
    irradiance = np.pi * light / (1 + 4 * (2.8 * (1 + m)) ** 2)
    green = large.sensor.channels["G"].quantum_efficiency_at(grid)
    electrons = 0.066 * 0.5 * 2.2e-6**2 * np.trapezoid(irradiance * green, grid)
    assert large.electrons_per_cd_m2 == pytest.approx(electrons, rel=1e-5)


@pytest.mark.parametrize("width", [2.2, 1.4])
@pytest.mark.parametrize("level", LUMINANCES_CD_M2)
def test_curves_follow_the_closed_form(sizes, width, level) -> None:
    # 4.58 and 6 mV at 100 uV per electron; PRNU 1.7 %.
    signal = level * sizes.pixel(2.2, False).electrons_per_cd_m2 * (width / 2.2) ** 2
    quiet = signal + (0.017 * signal) ** 2
    noisy = quiet + 45.8**2 + 60.0**2
    assert sizes.pixel(width, True).snr_at(level) == pytest.approx(10 * np.log10(signal**2 / quiet), abs=1e-6)
    assert sizes.pixel(width, False).snr_at(level) == pytest.approx(10 * np.log10(signal**2 / noisy), abs=1e-6)


def test_limits_of_the_difference_in_dim_light(sizes) -> None:
    # With read noise and DSNU the ratio falls with the square of the area, with photon noise alone with the area, which
    # averaging over the large pixel's area recovers.
    dim = 1e-3
    noisy = sizes.pixel(2.2, False).snr_at(dim) - sizes.pixel(1.4, False).snr_at(dim)
    quiet = sizes.pixel(2.2, True).snr_at(dim) - sizes.pixel(1.4, True).snr_at(dim)
    assert noisy == pytest.approx(-20 * np.log10(AREAS), abs=1e-4)
    assert quiet == pytest.approx(-10 * np.log10(AREAS), abs=1e-4)
    gain = sizes.pixel(1.4, True).equal_area_db - sizes.pixel(1.4, True).snr_db
    np.testing.assert_allclose(gain, -10 * np.log10(AREAS), atol=1e-9)


def test_luminance_of_a_ratio_of_ten(sizes) -> None:
    for curve in sizes.pixels:
        assert curve.snr_at(curve.luminance_of_good_snr_cd_m2) == pytest.approx(20.0, abs=1e-9)
        one_db = curve.snr_at(curve.equal_area_luminance_of_good_snr_cd_m2)
        assert one_db + 20 * np.log10(2.2 / curve.width_um) == pytest.approx(20.0, abs=1e-9)


def test_curves_end_at_saturation(sizes) -> None:
    for curve in sizes.pixels:
        well = curve.luminance_cd_m2[-1] * curve.electrons_per_cd_m2
        # The 2.2 um pixel by its converter, 1023 - 64 of 1024 steps to 10 000 electrons; the 1.4 um pixel by its well.
        assert well == pytest.approx({2.2: 959 / 1024 * 1e4, 1.4: 4050.0}[curve.width_um], rel=1e-9)


def test_noise_on_the_faces_follows_the_noise_model(sizes) -> None:
    # 12 normal deviations; one seed in 1300 exceeds 4 standard errors by chance.
    for picture in sizes.pixels:
        for entry in picture.shot.face.values():
            assert abs(entry.snr_db - entry.expected_db) < 4 * entry.standard_error_db
    areas = {picture.width_um: picture.shot.face["G"].mean_e for picture in sizes.pixels}
    assert areas[1.4] / areas[2.2] == pytest.approx(AREAS, rel=5e-3)  # the regions differ by a few pixels


def test_results_are_finite_numbers_that_depend_on_the_seed_only(sizes) -> None:
    assert json.dumps(sizes.to_dict(), allow_nan=False) == json.dumps(pixel_sizes(2008).to_dict(), allow_nan=False)
