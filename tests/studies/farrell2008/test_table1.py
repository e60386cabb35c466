"""Table 1 of the 2008 paper, estimated with virtual sensors."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from short_protocol import short_d200_protocol

from photosite.calibration.calibrate import calibrate
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.farrell2008.cameras import CASES, VENDOR, MeasuredCamera
from photosite.studies.farrell2008.table1 import PROTOCOLS, EightFrames, Table1, Table1Row, eight_frames, measure_table1
from photosite.studies.protocol import ShootingProtocol, Step, paper_vendor_protocol
from photosite.studies.virtual_lab import virtual_lab

SMALL = {"d200": (32, 48), "vendor": (96, 128)}

ROWS, COLS = 256, 384


@pytest.fixture(scope="module", params=[6, pytest.param(16, marks=pytest.mark.slow)], ids=lambda n: f"{n} seeds")
def tables(request: pytest.FixtureRequest) -> list[Table1]:
    """Tables of virtual cameras; the six take a quarter of the D200's frames."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == 6:
            patch.setitem(PROTOCOLS, "d200", short_d200_protocol)
        return [measure_table1(seed, sizes=SMALL) for seed in range(request.param)]


def rows_of(tables: list[Table1]) -> dict[tuple[str, str], list[Table1Row]]:
    found: dict[tuple[str, str], list[Table1Row]] = defaultdict(list)
    for table in tables:
        for key, camera in table.cameras.items():
            for row in camera.rows:
                found[key, row.name].append(row)
    return found


def test_estimates_are_centred_and_intervals_cover(tables: list[Table1]) -> None:
    """Mean within 3.3 standard errors of the truth, expected spread, 4 of 6 or 12 of 16 intervals cover.

    By chance a correct parameter fails in 0.1 % (mean), 0.2 % (chi-square of 5 or 15 degrees of freedom, 0.1 and
    99.9 %) and 0.2 % or 0.1 % (3 or more of 6, 5 or more of 16 outside). 10 parameters are independent, so 5 % or 4 %
    in total. The seeds are fixed. Twice the true read noise, for example, is off by hundreds of uncertainties.
    """
    seeds = len(tables)
    low, high = stats.chi2.ppf((0.001, 0.999), seeds - 1)
    for name, rows in rows_of(tables).items():
        away = np.array([(row.estimate.value - row.true) / row.estimate.standard_uncertainty for row in rows])
        assert abs(away.mean()) < 3.3 / np.sqrt(seeds), name
        assert low < np.sum((away - away.mean()) ** 2) < high, name
        covered = sum(row.estimate.interval_95[0] <= row.true <= row.estimate.interval_95[1] for row in rows)
        assert covered >= {6: 4, 16: 12}[seeds], name


def test_the_values_of_the_paper(tables: list[Table1]) -> None:
    d200, vendor = (tables[0].cameras[case.key] for case in CASES)
    assert {row.name: row.paper for row in d200.rows} == {
        "read_noise_mv": 0.52,
        "dsnu_mv": 0.55,
        "prnu_percent": 1.126,
        "dark_voltage_mv_per_s": 0.0,
        "conversion_gain_uv_per_e": 30.0,
        "electrons_per_dn": 7.98,
        "saturation_capacity_e": 36000.0,
    }
    papers = {row.name: row.paper for row in vendor.rows}
    assert papers["read_noise_mv"] == 4.58
    assert papers["dsnu_mv"] == 6.0
    assert papers["conversion_gain_uv_per_e"] is papers["saturation_capacity_e"] is papers["electrons_per_dn"] is None


def test_the_converter_limits_the_range_of_the_d200(tables: list[Table1]) -> None:
    """(4095 - 32) DN x 7.98 electrons; the table of the paper lists the well."""
    row = tables[0].cameras["d200"].row("saturation_capacity_e")
    assert row.true == pytest.approx(4063 * 7.98, rel=1e-5)
    assert "4063 DN above black, below the well capacity" in row.words
    assert "% below the paper’s value" in row.words


def test_protocols_have_the_frames_of_the_paper() -> None:
    """190 and 150 dark frames and 65 flat fields; 8 and 10 dark frames and 10 flat fields; the ends of each range."""

    def count(steps: tuple[Step, ...], kind: str) -> int:
        return sum(step.count for step in steps if step.kind == kind)

    d200, vendor = (PROTOCOLS[case.key]().steps for case in CASES)
    assert (count(d200, "dark"), count(d200, "light")) == (190 + 150, 65)
    assert (count(vendor, "dark"), count(vendor, "light")) == (8 + 10, 10)
    assert (vendor[0].exposure_s, vendor[0].count) == (0.01, 8)
    for kind in ("dark", "light"):
        times = [step.exposure_s for step in vendor[1:] if step.kind == kind]
        assert (min(times), max(times)) == (1e-3, 0.3)


def test_the_calibrations_do_not_know_the_truth(tables: list[Table1]) -> None:
    """Parameters to be measured are placeholders beforehand, not Table 1."""
    for case in CASES:
        base = tables[0].cameras[case.key].calibration.base
        assert base is not None
        assert base.noise.read_noise_mv.value == 0
        assert base.pixel.conversion_gain_uv_per_e.value == 1
        assert load_sensor(case.preset).noise.read_noise_mv.value > 0


def evaluated(count: int, dsnu_mv: float = 6.0) -> EightFrames:
    steps = paper_vendor_protocol().steps
    protocol = ShootingProtocol("darks", (replace(steps[0], count=count), *steps[1:]))
    sensor = MeasuredCamera(VENDOR, 5).sensor(ROWS, COLS).with_(dsnu_mv=dsnu_mv)
    lab = virtual_lab(sensor, protocol, seed=5)
    return eight_frames(lab, calibrate(lab.frame_set()))


@pytest.fixture(scope="module")
def eight() -> EightFrames:
    return evaluated(8)


def test_residual_read_noise(eight: EightFrames) -> None:
    """Closed forms with 4.58 and 6 mV and rounding of 0.977 mV; each measured value within 4 standard errors (0.01 %).

    98 304 pixels give a standard deviation to 0.23 %, a correlation to (1 - 0.965^2) / 313 = 0.0002, and the relative
    standard deviation of chi-square values with 7 degrees of freedom to 0.5 %.
    """
    left = (4.58**2 + (1000 / 1024) ** 2 / 12) / 8
    assert eight.frames == 8
    assert eight.pixels == ROWS * COLS
    assert eight.naive_dsnu_mv == pytest.approx((36 + left) ** 0.5, rel=0.01)
    assert eight.naive_dsnu_mv == pytest.approx(eight.naive_expected_mv, rel=1e-3)
    assert eight.noise_left_share == pytest.approx(left / (36 + left), rel=0.02)
    assert eight.pixel_offset_error_mv == pytest.approx(left**0.5, rel=0.01)
    assert eight.map_correlation == pytest.approx((36 / (36 + left)) ** 0.5, abs=8e-4)
    assert eight.map_correlation_expected == pytest.approx((36 / (36 + left)) ** 0.5, abs=8e-4)
    assert eight.pixel_variance_scatter == pytest.approx((2 / 7) ** 0.5, rel=0.02)
    assert eight.frames_for_a_tenth in (58, 59, 60)
    assert abs(eight.dsnu_mv - eight.chip_spread_mv) < 4 * eight.dsnu_uncertainty_mv


def test_chi_square_limits(eight: EightFrames) -> None:
    """7 degrees of freedom: 1.690 and 16.013 at 2.5 and 97.5 %, 24.322 at 99.9 %."""
    assert eight.frame_level_low == pytest.approx((7 / 16.013) ** 0.5, rel=1e-3)
    assert eight.frame_level_high == pytest.approx((7 / 1.690) ** 0.5, rel=1e-3)
    assert eight.noisy_pixel_factor == pytest.approx((24.322 / 7) ** 0.5, rel=1e-3)


def test_more_frames_determine_pixels_better_but_hardly_the_chip(eight: EightFrames) -> None:
    many = evaluated(64)
    assert many.pixel_offset_error_mv == pytest.approx(eight.pixel_offset_error_mv / 8**0.5, rel=0.02)
    assert many.pixel_offset_error_mv < 0.1 * 6.0
    assert many.map_correlation > 0.99
    assert 0.9 < many.dsnu_uncertainty_mv / eight.dsnu_uncertainty_mv < 1


def test_a_tenth_of_the_dsnu_is_detected(eight: EightFrames) -> None:
    """0.6 mV is above the detection limit, although the mean frame is mostly noise."""
    faint = evaluated(8, dsnu_mv=0.6)
    assert eight.smallest_dsnu_mv < 0.2
    assert faint.dsnu_mv == pytest.approx(0.6, abs=4 * faint.dsnu_uncertainty_mv)
    assert faint.dsnu_mv > 5 * faint.dsnu_uncertainty_mv
    assert faint.map_correlation < 0.5


def test_the_words_contain_the_numbers(eight: EightFrames) -> None:
    content = eight.to_dict()
    whole = " ".join((*content["can"], *content["cannot"]))
    for number in (f"{eight.dsnu_mv:.4f}", f"{eight.map_correlation:.3f}", f"{eight.frames_for_a_tenth} frames"):
        assert number in whole
    assert Step("dark", 0.01, 8) == paper_vendor_protocol().steps[0]
