"""Closed loop: simulate measurements, calibrate them, and find the parameters inside their intervals.

20 monochrome sensors with known photons (EMVA 1288's protocol) and 20 Bayer sensors without (the 2008 paper's), each
with different parameters and a different chip, half of them limited by the converter and half by the well.

For each parameter, at least 85 % of the 95 % intervals must contain the truth, and the pulls (error over standard
uncertainty) must be centered and of normal width. With intervals that contain it in exactly 95 % of cases, 40 sensors
pass the first with probability 99.7 % and 20 sensors with 98.4 %; a mean pull beyond 3.5 standard errors has
probability 0.05 %. Many parameters share their errors, so new seeds would raise a false alarm over all of them in
roughly one run of ten; these seeds are fixed. With 100 seeds (200 sensors; 100 for parameters in photons) 93 to 100 %
of the intervals contain the truth, for every parameter. This prints them:

    PHOTOSITE_LOOP_SEEDS=100 python -m pytest -rP tests/calibration/test_closed_loop.py -k contain
"""

import os

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate

pytestmark = pytest.mark.slow

MONO = BAYER = int(os.environ.get("PHOTOSITE_LOOP_SEEDS", "20"))


@pytest.fixture(scope="module")
def outcomes(virtual):
    """Lists of (error, standard uncertainty) by (cfa, parameter); and the calibrations."""
    errors, calibrations = {}, []
    for cfa, count in (("mono", MONO), ("rggb", BAYER)):
        known = cfa == "mono"
        for index in range(count):
            seed = index + (0 if known else 1000)
            sensor = virtual.sensor(seed, cfa=cfa, rows=80, cols=96, limited_by=("converter", "well")[index % 2])
            top = 1.15 + 0.15 * ((0.618 * index) % 1)
            calibration = calibrate(virtual.frame_set(sensor, seed, photons_known=known, top=top))
            calibrations.append((sensor, calibration))
            exposures = [calibration.spatial[name].dark.exposure_s for row in sensor.array.cfa for name in row]
            truth = virtual.truth(sensor, photons_known=known, dark_exposures_s=exposures)
            truth["interpixel_coupling_percent"] = 0.0
            for name, estimate in calibration.estimates().items():
                if name in truth:
                    assert estimate.value is not None, (name, estimate.reason)
                    pair = (estimate.value - truth[name], estimate.standard_uncertainty)
                    errors.setdefault((cfa, name), []).append(pair)
                elif name == "shading_percent":
                    assert abs(estimate.value) < 3.0 * estimate.standard_uncertainty
                elif name.startswith(("row_", "column_")):
                    # The sensors have no such noise, offsets or gains: four uncertainties of the variance.
                    assert abs(estimate.value) < 7.0 * estimate.standard_uncertainty, name
                elif name.startswith("linearity_error"):
                    # Straight responses: noise widens the extremes, but to five uncertainties only once in 500 runs.
                    assert abs(estimate.value) < (
                        5.0 * estimate.standard_uncertainty if name.endswith(("min_percent", "max_percent")) else 0.1
                    ), name
                else:
                    assert estimate.value is None, name
                    assert "photons per pixel are not known" in estimate.reason
    return errors, calibrations


def names(errors):
    return dict.fromkeys(name for _, name in errors)


def test_intervals_contain_the_truth(outcomes):
    errors, _ = outcomes
    covered = {}
    for name in names(errors):
        pairs = np.array(errors.get(("mono", name), []) + errors.get(("rggb", name), []))
        # 1e-9 of rounding: the level of an ideal converter's top is exact.
        covered[name] = np.mean(np.abs(pairs[:, 0]) <= 1.959964 * pairs[:, 1] + 1e-9)
        print(f"{name}: {100 * covered[name]:.1f} % of {len(pairs)} intervals contain the truth")
    assert {name: fraction for name, fraction in covered.items() if fraction < 0.85} == {}


def test_errors_are_centred_and_uncertainties_right(outcomes):
    """That of a full well includes the gains of other chips' columns, of which noise shows some in 96 columns."""
    errors, _ = outcomes
    wrong = {}
    for name in names(errors):
        pairs = np.array(errors.get(("mono", name), []) + errors.get(("rggb", name), []))
        pairs = pairs[pairs[:, 1] > 0] if pairs.size else pairs
        if not pairs.size:
            continue
        pulls = pairs[:, 0] / pairs[:, 1]
        mean, width = pulls.mean() * np.sqrt(len(pulls)), np.sqrt((pulls**2).mean())
        if abs(mean) > 3.5 or not (0.4 if name == "saturation_dn" else 0.5) < width < 1.5:
            wrong[name] = (mean, width)
    assert not wrong


def test_saturation_of_the_standard_is_between_the_exposures(outcomes, virtual):
    """The largest variance lies within a step of the exposures, which is the rectangular uncertainty."""
    _, calibrations = outcomes
    for sensor, calibration in calibrations[:MONO]:
        found = calibration.by_line.saturation_capacity_photons
        error = found.value - virtual.variance_peak_photons(sensor)
        assert abs(error) < 1.2 * np.sqrt(3) * found.standard_uncertainty


def test_channels_agree_with_the_truth(outcomes):
    """Gain and PRNU of 60 color channels: 95 % coverage expected, 85 % is 3.5 standard errors below."""
    _, calibrations = outcomes
    covered = {"system_gain_dn_per_e": [], "prnu_percent": [], "read_noise_dn": [], "dsnu_dn": []}
    for sensor, calibration in calibrations[MONO:]:
        assert set(calibration.channels) == {"R", "G", "B"}
        gain = sensor.system_gain_dn_per_e
        wanted = {
            "system_gain_dn_per_e": gain,
            "prnu_percent": sensor.noise.prnu_percent.value,
            "read_noise_dn": sensor.electrons(sensor.noise.read_noise_mv.value) * gain,
            "dsnu_dn": sensor.electrons(sensor.noise.dsnu_mv.value) * gain,
        }
        for parameters in calibration.channels.values():
            for name, truth in wanted.items():
                low, high = getattr(parameters, name).interval_95
                covered[name].append(low < truth < high)
    assert {name: np.mean(hits) for name, hits in covered.items() if np.mean(hits) < 0.85} == {}


def test_the_measured_sensor_simulates_like_the_true_one(outcomes, virtual):
    """The sensor file of a calibration agrees with the true one within its uncertainties."""
    sensor, calibration = outcomes[1][MONO]
    measured = calibration.sensor
    assert measured.channels == sensor.channels
    assert measured.array == sensor.array
    for section, field in (
        ("noise", "read_noise_mv"),
        ("noise", "dsnu_mv"),
        ("noise", "prnu_percent"),
        ("noise", "dark_voltage_mv_per_s"),
        ("noise", "dcnu_percent"),
        ("pixel", "conversion_gain_uv_per_e"),
        ("readout", "black_level_dn"),
    ):
        quantity = getattr(getattr(measured, section), field)
        true = getattr(getattr(sensor, section), field).value
        assert quantity.standard_uncertainty > 0
        assert abs(quantity.value - true) < 4 * quantity.standard_uncertainty, field
        assert quantity.source.startswith("measured from ")
    assert measured.pixel.well_capacity_e == sensor.pixel.well_capacity_e  # the converter is the limit here
    assert len(measured.provenance.frames_sha256) == calibration.frame_count

    by_well, calibration = outcomes[1][MONO + 1]
    well = calibration.sensor.pixel.well_capacity_e
    assert abs(well.value - by_well.pixel.well_capacity_e.value) < 4 * well.standard_uncertainty
