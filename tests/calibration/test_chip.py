"""Chips measured from simulated frames, simulated from their maps, and measured again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.helpers.diagnosed import limits
from virtual_chips import drawn_maps, plant_blinking, plant_dead, plant_hot

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import FrameSet
from photosite.report.chip import temporal_blocks
from photosite.sensor.chip import DefectKind
from photosite.sensor.io.sensor_file import load_measured_chip, load_sensor
from photosite.sensor.readout import digital_numbers

ROWS, COLS = 120, 160
PIXELS = ROWS * COLS
DARKS, DARK_S = 40, 0.01
MONO = {"M": {"wavelength_nm": [550], "quantum_efficiency": [0.5]}}
SENSOR = load_sensor("nikon-d200").with_(
    rows=ROWS, cols=COLS, cfa=[["M"]], channels=MONO, black_level_dn=64, dark_voltage_mv_per_s=3, dcnu_percent=8
)
MAPS = {
    "offset_dn": "offset_uncertainty_dn",
    "dark_rate_dn_per_s": "dark_rate_uncertainty_dn_per_s",
    "prnu": "prnu_uncertainty",
}


def shoot(sensor, seed, long_darks=(10.0, 20.0), levels=11, stack_s=DARK_S):
    """Simulate a stack of dark frames, dark frames of 12 per exposure time, and flat fields up to 1.2 saturations."""
    shape = sensor.array.rows, sensor.array.cols
    plan = [("dark", stack_s, DARKS, 0.0), *(("dark", t, 12, 0.0) for t in long_darks)]
    plan += [("light", t, 8, 1e6 * t) for t in np.linspace(0.004, 0.044, levels).tolist()]
    frames = []
    for kind, exposure_s, count, electrons in plan:
        mean = np.full(shape, electrons, np.float32)
        for _ in range(count):
            dn = digital_numbers(sensor, mean, exposure_s, seed=seed, frame=len(frames))
            frames.append((kind, exposure_s, dn))
    return FrameSet.from_arrays(frames, bits=12, cfa=sensor.array.cfa, sensor=sensor)


def measured(sensor, seed, **settings):
    frames = shoot(sensor, seed, **settings)
    calibration = calibrate(frames, sensor.with_(maps=None), maps=True)
    return calibration, calibration.chip, calibration.temporal


@pytest.fixture(scope="module")
def trip(tmp_path_factory):
    """The planted chip, and sensor, chip and temporal noise of a first and a second measurement."""
    folder = tmp_path_factory.mktemp("trip")
    rng = np.random.default_rng(2)
    planted = drawn_maps(SENSOR)
    # In units of the spread of the measured map, which includes the measurement noise.
    spread = np.hypot(np.std(planted.dark_rate_dn_per_s), 0.08)
    planted = plant_hot(planted, SENSOR, rng.uniform(5, 12, 300), spread)
    planted = plant_dead(planted, rng.uniform(0, 0.4, 20))
    planted = plant_blinking(planted, rng.uniform(7, 15, 100) * 2.2, rng.uniform(0.3, 0.7, 100))
    planted = replace(planted, row_noise_dn=0.5, column_noise_dn=0.3)
    first = measured(SENSOR.with_(maps=planted.save(folder / "planted.maps.h5")), 1)
    again = first[0].sensor.with_(maps=first[1].save(folder / "first.maps.h5"))
    return planted, first, measured(again, 2)


def squares(true, found):
    """Return, by map, the mean squared deviation in standard uncertainties; responses relative to the channel mean."""
    result = {}
    for name, of_name in MAPS.items():
        wanted = getattr(true, name).astype(float)
        if name == "prnu":
            wanted = (1 + wanted) / np.mean(1 + wanted) - 1
        result[name] = np.mean(((getattr(found, name) - wanted) / getattr(found, of_name)) ** 2)
    return result


def places(chip, kind):
    chosen = chip.defects.of(kind)
    return set(zip(chosen.row.tolist(), chosen.col.tolist(), strict=True))


@pytest.mark.parametrize("leg", [0, 1])
def test_maps_are_those_of_the_chip_within_their_uncertainty(trip, leg) -> None:
    """Chi-square over all pixels, each side outside 1e-5: false alarms 1.2e-4 for the six maps.

    The uncertainties are estimates too, from at least 39 degrees of freedom and the other pixels, and correct on
    average.
    """
    planted, (_, first, _), (_, second, _) = trip
    true, found = ((planted, first), (first, second))[leg]
    low, high = stats.chi2.ppf([1e-5, 1 - 1e-5], PIXELS) / PIXELS
    for name, value in squares(true, found).items():
        assert low < value < high, name


def test_read_noise_of_each_pixel_is_recovered(trip) -> None:
    """For normal noise, the sum of the variance ratios times 39 is chi-square distributed: each side 1e-4."""
    _, (calibration, first, _), (_, second, _) = trip
    gain = calibration.system_gain_dn_per_e.value

    def variance(chip):
        """Return the total variance of a frame, including rounding and the shot noise of the dark current."""
        noise = chip.read_noise_dn.astype(float)
        return noise * abs(noise) + 1 / 12 + gain * DARK_S * np.maximum(chip.dark_rate_dn_per_s, 0)

    normal = np.ones((ROWS, COLS), bool)
    normal[first.blinking.row, first.blinking.col] = False
    ratio = (variance(second) / variance(first))[normal]
    freedom = DARKS - 1
    assert second.read_noise_freedom == freedom
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], freedom * ratio.size)
    assert low < freedom * ratio.sum() < high
    # Row and column noise correlates neighbors, so only one ratio in a hundred is tested.
    assert stats.kstest(freedom * ratio[::101], "chi2", (freedom,)).pvalue > 1e-4


@pytest.mark.parametrize("leg", [0, 1])
def test_defects_are_found_at_precision_and_recall_over_98_percent(trip, leg) -> None:
    """Hot pixels: true dark currents 5 to 12 standard deviations of the measured map above its median."""
    planted, (_, first, _), (_, second, _) = trip
    true, found = ((planted, first), (first, second))[leg]
    for kind in (DefectKind.HOT, DefectKind.DEAD, DefectKind.BLINKING):
        planted_places, listed = places(true, kind), places(found, kind)
        assert len(planted_places & listed) > 0.98 * len(planted_places), f"recall of {kind.name}"
        assert len(planted_places & listed) > 0.98 * len(listed), f"precision of {kind.name}"


def test_blinking_pixels_are_recovered_with_their_levels(trip) -> None:
    """Each amplitude within 5 standard errors: 100 pixels, false alarms 6e-5; fractions within 5 binomial ones."""
    planted, (_, first, _), _ = trip
    wanted = {(r, c): i for i, (r, c) in enumerate(zip(planted.blinking.row, planted.blinking.col, strict=True))}
    found = first.blinking
    for i, place in enumerate(zip(found.row, found.col, strict=True)):
        j = wanted[place]
        visits = DARKS * found.high_fraction[i]
        noise = np.hypot(found.noise_dn[i], 12**-0.5)
        error = noise * np.sqrt(1 / visits + 1 / (DARKS - visits))
        assert abs(found.amplitude_dn[i] - planted.blinking.amplitude_dn[j]) < 5 * error
        fraction = planted.blinking.high_fraction[j]
        assert abs(found.high_fraction[i] - fraction) < 5 * np.sqrt(fraction * (1 - fraction) / DARKS)


def test_row_and_column_noise_are_recovered(trip) -> None:
    planted, (_, first, noise), (_, second, _) = trip
    for one in (first, second):
        assert one.row_noise_dn == pytest.approx(planted.row_noise_dn, abs=4 * 0.0065)  # 4 standard uncertainties
        assert one.column_noise_dn == pytest.approx(planted.column_noise_dn, abs=4 * 0.0045)
    assert 0.005 < noise.row_noise_dn.standard_uncertainty < 0.008
    assert noise.frames == DARKS


def test_channels_of_a_cfa_are_mapped_separately() -> None:
    """Chi-square of each map at 1e-5. Channels differ in response, but no pixel is listed for that."""
    names = {"R": 0.2, "G": 0.5, "B": 0.3}
    channels = {k: {"wavelength_nm": [550], "quantum_efficiency": [q]} for k, q in names.items()}
    sensor = SENSOR.with_(cfa="rggb", channels=channels, rows=60, cols=90)
    calibration, chip, _ = measured(sensor, 3)
    assert set(calibration.linear_range) == set(names)
    true = drawn_maps(sensor)
    for name, (r, c) in {"R": (0, 0), "B": (1, 1)}.items():
        wanted = true.prnu[r::2, c::2].astype(float)
        wanted = (1 + wanted) / np.mean(1 + wanted) - 1
        z = (chip.prnu[r::2, c::2] - wanted) / chip.prnu_uncertainty[r::2, c::2]
        low, high = stats.chi2.ppf([1e-5, 1 - 1e-5], z.size) / z.size
        assert low < np.mean(z**2) < high, name
    assert chip.defects.counts()["response"] == 0


def test_a_stack_of_long_darks_gives_offsets_and_read_noise_without_dark_current() -> None:
    """The dark signal is 125 DN and three quarters of the variance are shot noise.

    Chi-square at 1e-5 on each side; mean read noise variance within 5 standard errors of 60 x 80 pixels and 39 degrees
    of freedom.
    """
    sensor = SENSOR.with_(rows=60, cols=80)
    _, chip, _ = measured(sensor, 7, long_darks=(DARK_S, 20.0), stack_s=10.0)
    assert chip.reference_exposure_s == 10.0
    true = drawn_maps(sensor)
    z = (chip.offset_dn + chip.black_level_dn - 64 - true.offset_dn) / chip.offset_uncertainty_dn
    low, high = stats.chi2.ppf([1e-5, 1 - 1e-5], z.size) / z.size
    assert low < np.mean(z.astype(float) ** 2) < high
    noise = chip.read_noise_dn.astype(float)
    read2, shot = 2.1722**2, 10 * float(true.dark_rate_dn_per_s.mean()) * chip.system_gain_dn_per_e
    assert shot > 2 * read2
    error = (read2 + shot) * np.sqrt(2 / (39 * noise.size))
    assert np.mean(noise * abs(noise)) == pytest.approx(read2, abs=5 * np.hypot(error, 0.01 * shot))


SMALL = SENSOR.with_(rows=40, cols=50)


def test_without_flats_there_is_no_response_and_no_gain() -> None:
    _, chip, noise = measured(SMALL, 4, long_darks=(20.0,), levels=0)
    assert chip.prnu is None
    assert chip.system_gain_dn_per_e is None
    assert noise.shape.excess_kurtosis.value is not None


def test_the_sensor_file_supplies_what_the_chip_lacks(tmp_path) -> None:
    """Without long dark frames there is no dark rate. Means within 5 standard errors."""
    _, chip, _ = measured(SMALL, 4, long_darks=())
    assert chip.dark_rate_dn_per_s is None
    assert chip.prnu.std() == pytest.approx(0.0115, rel=0.15)  # 1.13 % and the measurement's 0.4 %
    chip = replace(chip, prnu=None, prnu_uncertainty=None, system_gain_dn_per_e=None)
    again = SMALL.with_(maps=chip.save(tmp_path / "a.maps.h5"))
    for electrons, exposure_s in ((8000, 1.0), (0, 20.0)):
        dn = digital_numbers(again, np.full((40, 50), electrons, np.float32), exposure_s, seed=1)
        signal_e = electrons + exposure_s * SMALL.electrons(3.0)
        expected = 64 + chip.offset_dn.mean() + signal_e * SMALL.system_gain_dn_per_e
        assert dn.mean() == pytest.approx(expected, abs=5 * dn.std() / np.sqrt(dn.size))


def test_clipped_darks_have_no_maps() -> None:
    """The black level is 2 standard deviations above 0."""
    calibration = calibrate(shoot(SMALL.with_(black_level_dn=6), 5), SMALL, maps=True)
    assert calibration.chip is None
    assert "no-maps" in limits(calibration)


def test_clipped_darks_are_calibrated_without_maps() -> None:
    """All other results are the same as without maps."""
    clipped = SMALL.with_(black_level_dn=4)
    with_maps, without = (calibrate(shoot(clipped, 5, levels=5), clipped, maps=maps) for maps in (True, False))
    assert with_maps.estimates() == without.estimates()
    assert with_maps.read_noise_dn.value is not None
    assert with_maps.chip is None
    assert with_maps.temporal is None
    assert list(limits(with_maps)) == [*limits(without), "no-maps"]
    assert with_maps.no_maps_reason in temporal_blocks(with_maps)[0].text
    assert without.no_maps_reason is None


def test_calibration_saves_its_maps_with_its_sensor(trip, tmp_path) -> None:
    """The maps of the sensor known beforehand are not kept."""
    planted, (calibration, chip, noise), _ = trip
    before = SENSOR.with_(maps=planted.save(tmp_path / "before.maps.h5"))
    with_chip = replace(calibration, base=before, chip=chip, temporal=noise)
    assert with_chip.sensor.maps is None
    with_chip.save(tmp_path / "mine.sensor.yaml")
    again = load_sensor(tmp_path / "mine.sensor.yaml")
    assert (load_measured_chip(again).offset_dn == chip.offset_dn).all()
    assert load_measured_chip(again).defects.counts() == chip.defects.counts()
    content = with_chip.to_dict()
    assert content["defects"]["dead"] == 20
    assert content["temporal"]["frames"] == DARKS


def test_calibrate_with_maps_measures_the_chip() -> None:
    """Progress counts the frames of both readings, and the reference dark frames once more."""
    frames, reported = shoot(SMALL, 6, long_darks=(20.0,), levels=6), []
    calibration = calibrate(frames, SMALL, maps=True, progress=lambda done, total: reported.append((done, total)))
    assert calibration.chip.shape == (40, 50)
    assert calibration.temporal.frames == DARKS
    assert reported[-1][0] == reported[-1][1]
    assert calibrate(frames, SMALL).chip is None
