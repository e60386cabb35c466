"""Effects of a drawn sensor are measured, written into the sensor file, and simulated again."""

import numpy as np

from photosite.calibration.calibrate import calibrate
from photosite.sensor.io.sensor_file import dump_sensor, parse_sensor
from photosite.studies.conditions import CONDITIONS, FULL
from photosite.studies.virtual_lab import virtual_lab


def test_measured_curve_is_that_of_the_sensor() -> None:
    """The deviation at all charges within 4 standard uncertainties, which are small against the bend."""
    lab = CONDITIONS["curve-mono-12"].lab(1)
    true = lab.camera.sensor
    measured = parse_sensor(dump_sensor(calibrate(lab.frame_set()).sensor), "measured.sensor.yaml")
    assert true.effects is not None
    assert measured.effects is not None
    drawn, found = true.effects.response_curve, measured.effects.response_curve
    assert drawn is not None
    assert found is not None
    assert found.charge_e is not None
    charge = np.array(found.charge_e[1:])
    charge = charge[charge < 0.95 * true.saturation_capacity_e]
    well = true.pixel.well_capacity_e.value
    expected = 100 * (drawn.signal_e(charge, well) / charge - 1)
    seen = 100 * (found.signal_e(charge, measured.pixel.well_capacity_e.value) / charge - 1)
    uncertainty = np.array(found.standard_uncertainty_percent[1 : charge.size + 1])
    assert (np.abs(seen - expected) < 4 * uncertainty).all()
    assert uncertainty[-1] < 0.5 * abs(expected[-1])


def test_a_plain_sensor_has_no_effects_and_no_noise_of_rows_and_columns() -> None:
    found = calibrate(CONDITIONS["bright-mono-12"].lab(4).frame_set())
    noise = found.sensor.noise
    assert found.sensor.effects is None
    assert noise.row_noise_mv.value == noise.column_noise_mv.value == 0.0
    assert noise.row_noise_mv.standard_uncertainty == found.row_noise_mv.standard_uncertainty > 0.0


def test_readout_channels_are_measured_and_leave_prnu() -> None:
    lab = CONDITIONS["channels-mono-12"].lab(1)
    true = lab.camera.sensor
    measured = calibrate(lab.frame_set()).sensor
    assert true.effects is not None
    assert measured.effects is not None
    drawn, found = true.effects.readout_channels, measured.effects.readout_channels
    assert drawn is not None
    assert found is not None
    assert found.relative_gain is not None
    assert (found.arrangement, found.shape) == ("tile", (1, 2))
    spread = found.relative_gain[0][0].standard_uncertainty
    assert np.abs(found.tables()[0] - drawn.tables()[0]).max() < 4 * spread
    prnu, expected = measured.noise.prnu_percent, true.noise.prnu_percent.value
    assert abs(prnu.value - expected) < 4 * prnu.standard_uncertainty


def test_lines_and_offsets_of_channels_return_to_the_sensor_file() -> None:
    """Alternating columns and random ones at once: all within 4 standard uncertainties, and not in DSNU and PRNU."""
    plain = CONDITIONS["bright-mono-12"].sensor(1).with_(rows=96, cols=120)
    dsnu_e = plain.electrons(plain.noise.dsnu_mv.value)
    truth = {"row_offset_e": 0.4 * dsnu_e, "column_offset_e": 0.6 * dsnu_e, "column_gain_percent": 0.5}
    channels = {"relative_gain": [[1.01, 0.99]], "offset_e": [[dsnu_e, -dsnu_e]]}
    lab = virtual_lab(
        plain.with_(line_pattern=truth, readout_channels=channels), FULL, level=1.25, seed=3, photons_known=True
    )
    measured = parse_sensor(dump_sensor(calibrate(lab.frame_set()).sensor), "measured.sensor.yaml")
    assert measured.effects is not None
    lines, found = measured.effects.line_pattern, measured.effects.readout_channels
    assert lines is not None
    assert found is not None
    for name, expected in truth.items():
        entry = getattr(lines, name)
        assert abs(entry.value - expected) < 4 * entry.standard_uncertainty, name
        assert entry.standard_uncertainty < 0.2 * expected
    assert found.shape == (1, 2)
    assert found.offset_e is not None
    offset = found.offset_e[0][0]
    assert abs(offset.value - dsnu_e) < 4 * offset.standard_uncertainty
    for name in ("dsnu_mv", "prnu_percent"):
        entry, expected = getattr(measured.noise, name), getattr(plain.noise, name).value
        assert abs(entry.value - expected) < 4 * entry.standard_uncertainty, name


def test_glow_and_drift_return_to_the_sensor_file() -> None:
    """Within 4 standard uncertainties, and not in dark current and read noise."""
    plain = CONDITIONS["bright-mono-12"].sensor(1).with_(rows=60, cols=80)
    rate_e, read_e = (plain.electrons(x.value) for x in (plain.noise.dark_voltage_mv_per_s, plain.noise.read_noise_mv))
    glow = {"places": ("left", "top_right"), "peak_e_per_s": 4.0 * rate_e, "decay_pixels": 14.0}
    true = plain.with_(glow=glow, black_level_drift={"standard_deviation_e": 1.5 * read_e})
    calibration = calibrate(virtual_lab(true, FULL, level=1.25, seed=3, photons_known=True).frame_set())
    assert calibration.glow is not None
    measured = parse_sensor(dump_sensor(calibration.sensor), "measured.sensor.yaml")
    assert measured.effects is not None
    found, drift = measured.effects.glow, measured.effects.black_level_drift
    assert found is not None
    assert drift is not None
    assert set(found.places) == set(glow["places"])
    for name in ("peak_e_per_s", "decay_pixels"):
        entry, expected = getattr(calibration.glow, name), glow[name]
        assert abs(entry.value - expected) < 4 * entry.standard_uncertainty, name
    assert 0.75 * read_e < drift.standard_deviation_e < 2.25 * read_e
    dark, read = (
        measured.electrons(x.value) for x in (measured.noise.dark_voltage_mv_per_s, measured.noise.read_noise_mv)
    )
    assert abs(dark / rate_e - 1) < 0.1
    assert abs(read / read_e - 1) < 0.05
