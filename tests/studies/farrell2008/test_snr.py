"""Figure 6: published values, ranges of the noise sources, and uniform fields against the formula."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

import photosite as ps
from photosite.metrics.snr import noise_budget
from photosite.studies.farrell2008.snr import (
    PAPER_D200_AT_SWING_DB,
    PARTS,
    SnrChapter,
    dominant_noises,
    snr_against_volts,
)


@pytest.fixture
def chapter(snr) -> SnrChapter:
    return snr


def test_the_d200_at_full_swing_equals_the_paper(chapter) -> None:
    assert PAPER_D200_AT_SWING_DB == {"total": 38.10, "shot": 45.56, "read": 66.35, "dsnu": 65.86, "prnu": 38.97}
    assert chapter.sensors["d200"].swing_v == 1.08
    for name, difference in chapter.from_paper_db.items():
        assert abs(difference) < 0.01, name


def test_the_vendor_sensor_at_full_swing_follows_table_1(chapter) -> None:
    # 1 V is 10 000 electrons of 100 uV; 45.8, 60 and 170 electrons of read noise, DSNU and PRNU.
    noise_e2 = {"read": 45.8**2, "dsnu": 60.0**2, "prnu": 170.0**2, "shot": 10_000.0}
    noise_e2["total"] = sum(noise_e2.values())
    for name, variance in noise_e2.items():
        shown = getattr(chapter.sensors["vendor"].at_swing, f"{name}_db")
        assert shown == pytest.approx(10 * np.log10(1e8 / variance), abs=1e-9), name


@pytest.mark.parametrize("preset", ["nikon-d200", "vendor-2.2um", "vendor-1.4um"])
@pytest.mark.parametrize(
    "changes", [{}, {"read_noise_mv": 7.0}, {"prnu_percent": 0}, {"read_noise_mv": 0, "dsnu_mv": 0}]
)
def test_the_dominant_noise_has_the_lowest_curve(preset, changes) -> None:
    sensor = ps.load_sensor(preset).with_(**changes)
    swing = sensor.pixel.voltage_swing_v.value
    ranges = dominant_noises(sensor)
    assert ranges[0].from_volts == 0.0
    assert ranges[-1].to_volts == swing
    assert all(a.to_volts == b.from_volts for a, b in itertools.pairwise(ranges))
    volts = np.geomspace(1e-5 * swing, 0.999 * swing, 500)
    budget = noise_budget(sensor, volts)
    lowest = np.array(list(PARTS))[np.argmin([getattr(budget, f"{name}_db") for name in PARTS], axis=0)]
    for at, name in zip(volts, lowest, strict=True):
        assert [part.noise for part in ranges if part.from_volts <= at < part.to_volts] == [name]


def test_uniform_fields_follow_the_formula(chapter) -> None:
    # 18 levels with normal deviations, correlated within a sensor: at most one seed in 900 exceeds 4 standard errors.
    for sensor in chapter.sensors.values():
        assert sensor.fields.largest_deviation < 4.0
        assert 0.03 < sensor.fields.standard_error_db.min() < sensor.fields.standard_error_db.max() < 0.2


def test_results_are_finite_numbers_that_depend_on_the_seed_only(chapter) -> None:
    text = json.dumps(chapter.to_dict(), allow_nan=False)
    assert text == json.dumps(snr_against_volts(2008).to_dict(), allow_nan=False)
    assert json.loads(text)["d200"]["read_noise_and_dsnu_dominate_below_volts"] == pytest.approx(0.0178, abs=5e-5)
