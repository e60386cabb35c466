"""Quantum efficiency under bands of light: closed forms, coverage over virtual runs, and invalid input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.diagnosed import limits
from virtual_monochromator import MonochromatorRun, without_spectra

from photosite.calibration.spectral.bands import (
    Band,
    Passband,
    Photodiode,
    SpectralFrames,
    band_matrix,
    triangular_passband,
)
from photosite.calibration.spectral.monochromator import calibrate_spectral
from photosite.color.spectrum import LIGHT_SPEED_M_S, PLANCK_J_S, Spectrum
from photosite.errors import NOT_GIVEN, CalibrationError, FileError, InputError
from photosite.frames.frame_set import FrameSource
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.virtual_lab import with_pedestal
from photosite.values.uncertain import Measured

GAIN_DN_PER_E = 0.25


def mono(**changes):
    """A monochrome sensor of 0.25 DN per electron, 5 um pixels and fill factor 0.8."""
    description = {
        "name": "plain",
        "array": {"rows": 4, "cols": 4},
        "pixel": {
            "width_um": 5.0,
            "height_um": 5.0,
            "fill_factor": 0.8,
            "conversion_gain_uv_per_e": 1e6 * GAIN_DN_PER_E / 4096,
            "voltage_swing_v": 1.0,
            "well_capacity_e": 100_000,
        },
        "channels": {"M": {"wavelength_nm": (550.0,), "quantum_efficiency": (0.5,)}},
        "noise": {"read_noise_mv": 0.1, "dsnu_mv": 0.0, "prnu_percent": 0.0},
        "readout": {"bits": 12},
    }
    return Sensor.model_validate(description).with_(**changes)


def source(name, mean, spread=1):
    """A frame with an exact mean, whose pixels differ within and between frames."""
    dn = np.full((4, 4), mean, np.uint16)
    flat = dn.ravel()
    flat[: 2 * spread : 2] += 1
    flat[1 : 2 * spread : 2] -= 1
    return FrameSource(name, lambda: dn)


def measurement(bands, sensor=None, darks=(100, 100), exposure_s=0.01, **changes):
    frames = tuple(source(f"dark {n}", mean, 1 + n) for n, mean in enumerate(darks))
    sensor = mono() if sensor is None else sensor
    return SpectralFrames(tuple(bands), {exposure_s: frames}, 4, 4, 12, (("M",),), sensor, **changes)


def line(nm, dn, irradiance, exposure_s=0.01, **changes):
    frames = tuple(source(f"{nm} nm {n}", dn, 1 + n) for n in range(2))
    return Band(f"{nm:g} nm", triangular_passband(nm, 0.0), exposure_s, frames, irradiance, **changes)


def test_a_line_gives_electrons_over_photons_exactly():
    """q = (light - dark) / K / (E t A F lambda / (h c)), each factor computed separately."""
    irradiance = 0.01
    found = calibrate_spectral(measurement([line(500.0, 1100, Measured(irradiance))])).channels["M"]
    electrons = (1100 - 100) / GAIN_DN_PER_E
    photons = irradiance * 0.01 * 25e-12 * 0.8 * 500e-9 / (PLANCK_J_S * LIGHT_SPEED_M_S)
    assert found.quantum_efficiency[0] == pytest.approx(electrons / photons, rel=1e-12)
    assert found.band_mean[0] == pytest.approx(electrons / photons, rel=1e-12)


def test_uncertainties_add_as_the_gum_says():
    """Relative uncertainties of reading, gain, pixel and scale: 3, 4, 12 and 84 per mille combine to 85.05."""
    sensor = mono(
        conversion_gain_uv_per_e=Measured(1e6 * GAIN_DN_PER_E / 4096, 0.004 * 1e6 * GAIN_DN_PER_E / 4096),
        width_um=Measured(5.0, 0.012 * 5.0),
    )
    bands = [line(nm, 4000, Measured(0.04, 0.04 * 0.003)) for nm in (500.0, 600.0)]
    found = calibrate_spectral(measurement(bands, sensor, scale_uncertainty_percent=8.4)).channels["M"]
    q = found.quantum_efficiency
    expected = np.sqrt(0.003**2 + 0.004**2 + 0.012**2 + 0.084**2)
    assert found.standard_uncertainty / q == pytest.approx([expected] * 2, rel=2e-4)
    # All except the reading is common to the bands.
    shared = 0.004**2 + 0.012**2 + 0.084**2
    assert found.covariance[0, 1] / (q[0] * q[1]) == pytest.approx(shared, rel=2e-3)


def test_currents_and_irradiances_agree():
    """A current gives the same result as its irradiance, and an entry's uncertainty affects the bands that use it."""
    grid = np.array([400.0, 500.0, 600.0])
    diode = Photodiode(Spectrum(grid, np.array([0.2, 0.3, 0.4])), np.array([0.0, 0.003, 0.0]), Measured(50.0))
    irradiance = {450.0: 0.01, 500.0: 0.01, 600.0: 0.012}
    response = {450.0: 0.25, 500.0: 0.3, 600.0: 0.4}
    direct = [line(nm, 1100, Measured(e)) for nm, e in irradiance.items()]
    currents = [line(nm, 1100, Measured(e * response[nm] * 50e-6), photodiode=diode) for nm, e in irradiance.items()]
    one = calibrate_spectral(measurement(direct)).channels["M"]
    other = calibrate_spectral(measurement(currents)).channels["M"]
    assert other.quantum_efficiency == pytest.approx(one.quantum_efficiency, rel=1e-12)
    added = np.diag(other.covariance - one.covariance) / one.quantum_efficiency**2
    # The entry at 500 nm contributes half at 450 nm: 0.5 x 0.003 / 0.25.
    assert np.sqrt(np.maximum(added, 0)) == pytest.approx([0.006, 0.01, 0.0], abs=1e-6)


def test_wavelength_uncertainty_is_propagated():
    """A response proportional to 1/lambda, read at a line: q' + q/lambda = 0, so the wavelength does not matter."""
    bands = [line(nm, 1100, Measured(0.01), centre_uncertainty_nm=1.0) for nm in np.arange(500.0, 521.0, 2.0)]
    still = [replace(band, centre_uncertainty_nm=0.0) for band in bands]
    found, without = (calibrate_spectral(measurement(b)).channels["M"] for b in (bands, still))
    # Equal signals at equal irradiance: q falls as 1 / lambda by construction.
    inner = slice(1, -1)
    assert found.covariance[inner, inner] == pytest.approx(without.covariance[inner, inner], rel=1e-3)
    rising = [line(nm, 1000 + 20 * n, Measured(0.01), centre_uncertainty_nm=1.0) for n, nm in enumerate((500.0, 510.0))]
    found = calibrate_spectral(measurement(rising)).channels["M"]
    still = calibrate_spectral(measurement([replace(b, centre_uncertainty_nm=0.0) for b in rising])).channels["M"]
    q = found.quantum_efficiency
    expected = ((q[1] - q[0]) / 10.0 + q / found.wavelength_nm) ** 2
    assert np.diag(found.covariance - still.covariance) == pytest.approx(expected, rel=1e-3)


def test_band_matrix_matches_a_sum():
    """Every entry against a sum over 100 000 points. Rows sum to 1, so a constant response is reproduced."""
    measured = Passband.of_energy(Spectrum(np.array([505.0, 509.0, 516.0, 531.0]), np.array([0.0, 3.0, 2.0, 0.0])))
    bands = (triangular_passband(490.0, 8.0), triangular_passband(500.0, 12.0), measured, triangular_passband(530, 5))
    centres = np.array([band.centre_nm for band in bands])
    fine = 400.0 + (np.arange(100_000) + 0.5) * 0.002  # midpoints, so that jumps fall between them
    for beyond, end in (("level", None), ("zero", 0.0)):
        matrix = band_matrix(bands, beyond=beyond)
        for row, band in zip(matrix, bands, strict=True):
            photons = band.energy.at(fine) * fine
            hats = [np.interp(fine, centres, unit, end, end) @ photons / photons.sum() for unit in np.eye(4)]
            assert row == pytest.approx(hats, abs=2e-6)
    assert band_matrix(bands).sum(axis=1) == pytest.approx(np.ones(4), abs=1e-12)


@pytest.mark.parametrize(
    ("bandwidth_nm", "method"), [(0.0, "bandwidth"), (10.0, "bandwidth"), (25.0, "bandwidth with a smoothness prior")]
)
def test_intervals_cover_the_virtual_d200(bandwidth_nm, method):
    """Pointwise 95 % intervals over 6 runs, each with its own error of the photodiode's scale.

    The scale error is common to a run, so the mean over 6 x 3 x 21 intervals has a standard error near 0.035. Correct
    intervals fall below 0.85 in only 2 of 1000 cases.
    """
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=32, cols=32))
    held, deviations = [], []
    for seed in range(6):
        run = MonochromatorRun(
            sensor, tuple(np.arange(420.0, 621.0, 10.0)), bandwidth_nm, frames=3, dark_frames=4, seed=seed
        )
        for name, channel in calibrate_spectral(run.frame_set()).channels.items():
            assert channel.method.endswith(method)
            truth = sensor.channels[name].quantum_efficiency_at(channel.wavelength_nm)
            low, high = channel.interval_95
            inner = slice(2, -2)
            held.append(np.mean((low <= truth)[inner] & (truth <= high)[inner]))
            deviations.append(((channel.quantum_efficiency - truth) / channel.standard_uncertainty)[inner])
    assert np.mean(held) > 0.85
    # The intervals are not too wide: deviations have the size of the uncertainty.
    assert 0.6 < np.sqrt(np.mean(np.square(deviations))) < 1.5


def test_narrow_bands_are_limited_by_the_reading():
    """0.3 % per reading and 0.5 % scale: 0.58 % where the signal is large."""
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=64, cols=64))
    run = MonochromatorRun(sensor, (520.0, 530.0, 540.0), 0.0)
    green = calibrate_spectral(run.frame_set()).channels["G"]
    assert green.standard_uncertainty / green.quantum_efficiency == pytest.approx([0.00583] * 3, rel=0.05)


def test_flicker_is_found_and_included():
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=64, cols=64))
    steady, flickering = (
        calibrate_spectral(MonochromatorRun(sensor, (530.0, 540.0, 550.0), 0.0, flicker_percent=p).frame_set())
        for p in (0.0, 3.0)
    )
    assert limits(flickering)["varying-light"] == pytest.approx(0.03, rel=0.5)
    u = [
        cal.channels["G"].standard_uncertainty[0] / cal.channels["G"].quantum_efficiency[0]
        for cal in (steady, flickering)
    ]
    # 3 % over 4 frames: 1.5 %, estimated with 9 degrees of freedom.
    assert 0.007 < np.sqrt(u[1] ** 2 - u[0] ** 2) < 0.026


def test_saturated_band_is_omitted_for_its_channel_only():
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=16, cols=16))
    run = MonochromatorRun(sensor, (440.0, 530.0, 540.0), 0.0)
    frames = run.frame_set()
    bright = replace(
        frames.bands[1], frames=tuple(FrameSource(f"x{n}", lambda n=n: _blown(run._light_dn(1, n))) for n in range(2))
    )
    found = calibrate_spectral(replace(frames, bands=(frames.bands[0], bright, frames.bands[2])))
    assert found.channels["G"].wavelength_nm.tolist() == [440.0, 540.0]
    assert list(found.channels["G"].left_out) == ["530 nm"]
    assert found.channels["R"].wavelength_nm.tolist() == [440.0, 530.0, 540.0]
    assert "band-not-used" in limits(found)


def _blown(dn):
    out = dn.copy()
    out[::2, 1::2] = 4095
    out[1::2, ::2] = 4095
    return out


def test_sensor_has_the_measured_values():
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=32, cols=32))
    run = MonochromatorRun(sensor, (450.0, 530.0, 600.0), 0.0)
    found = calibrate_spectral(run.frame_set(without_spectra(sensor)))
    made = found.sensor
    assert made.channels["G"].quantum_efficiency == pytest.approx(found.channels["G"].quantum_efficiency)
    assert made.channels["G"].standard_uncertainty == pytest.approx(found.channels["G"].standard_uncertainty)
    assert not made.channels["G"].assumed
    assert made.noise == sensor.noise
    assert len(made.provenance.frames_sha256) == found.frame_count


def test_impossible_results_and_invalid_input():
    usual = line(500.0, 1100, Measured(0.01))
    unknown = mono(conversion_gain_uv_per_e=Measured(1.0, assumed=True))
    for frames, what, value in (
        (measurement([line(500.0, 1100, Measured(1e-5))]), "the quantum efficiency at 500 nm", 795.0),
        (measurement([line(500.0, 80, Measured(0.01))]), "the quantum efficiency at 500 nm", -0.0159),
        (measurement([usual], unknown), "conversion_gain_uv_per_e", NOT_GIVEN),
    ):
        with pytest.raises(CalibrationError) as caught:
            calibrate_spectral(frames)
        assert (caught.value.what, caught.value.value) == (what, value)
    with pytest.raises(CalibrationError) as clipped:
        calibrate_spectral(measurement([usual], darks=(1, 1)))
    assert clipped.value.id == "unusable-spectral-frames"
    with pytest.raises(InputError) as unnamed:
        calibrate_spectral(replace(measurement([usual]), sensor=None))
    assert list(unnamed.value.arguments) == ["sensor"]
    with pytest.raises(FileError):
        calibrate_spectral(measurement([replace(usual, frames=(usual.frames[0], usual.frames[0]))]))
    with pytest.raises(InputError) as missing:
        measurement([line(500.0, 1100, Measured(0.01), exposure_s=0.02)])
    assert (missing.value.what, missing.value.where) == ("darks", "500 nm")
    with pytest.raises(InputError) as same:
        measurement([usual, line(500.0, 1200, Measured(0.01))])
    assert (same.value.what, same.value.where) == ("centre_nm", "500 nm")
