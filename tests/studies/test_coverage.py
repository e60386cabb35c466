"""A small coverage study: 64 virtual sensors (160 in the slow test) with two frames at each setting.

Limits and false-alarm probabilities for each parameter with correct intervals, for 64 and for 160 sensors:

- coverage below 82 % (53 of 64) or 87.5 % (140 of 160): 10^-4
- mean error beyond 0.55 or 0.35 standard uncertainties: 10^-4. Its standard error is 0.14 or 0.09.
- width above 1.35 or 1.25: 10^-4 or 10^-5

About 30 parameters share their errors: with new seeds fewer than one run in 200 would fail. The seeds are fixed.
Uncertainties a third too small lower the coverage to 81 % and widen to 1.5, which is detected with probability 0.97 or
0.999; a bias of 0.7 uncertainties with 0.85 or 0.999. The full study is `photosite reproduce coverage`, and
docs/validation/coverage.md has its table.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from photosite.calibration.photon_transfer import fit
from photosite.calibration.setting import calibrate_setting
from photosite.errors import CalibrationError, InputError
from photosite.frames.frame_set import FrameSet
from photosite.studies import coverage
from photosite.studies.conditions import CONDITIONS, condition
from photosite.studies.coverage import Coverage, CoverageStudy, _row, coverage_study, measure_sensor
from photosite.studies.outcome import Outcome

LIMITS = {64: (0.82, 0.55, 1.35), 160: (0.875, 0.35, 1.25)}
"""Sensors -> least coverage, largest mean error, largest width."""


@pytest.fixture(scope="module", params=[64, pytest.param(160, marks=pytest.mark.slow)], ids=lambda n: f"{n} sensors")
def study(request: pytest.FixtureRequest) -> CoverageStudy:
    return coverage_study(["few-mono-12"], sensors=request.param, processes=1)


def _off(study: CoverageStudy, sensors: int) -> dict[str, tuple[float, float, float]]:
    covered, bias, width = LIMITS[sensors]
    return {
        row.parameter: (row.covered, row.bias, row.width)
        for row in study.rows
        if row.exact < row.estimated and (row.covered < covered or abs(row.bias) > bias or row.width > width)
    }


def test_intervals_cover_and_errors_are_centred(study: CoverageStudy) -> None:
    sensors = study.rows[0].estimated
    assert sensors in LIMITS
    assert len(study.rows) >= 30
    assert all(row.estimated == sensors and row.wrong == 0 for row in study.rows)
    assert _off(study, sensors) == {}
    assert [(row.parameter, row.remarks) for row in study.rows if not row.passes] == []


@pytest.mark.slow
def test_uncertainties_a_third_too_small_are_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """The study has power: the photon transfer fit is made to state too small an uncertainty."""
    correct = fit._solve

    def overconfident(*arguments: Any) -> Any:
        parameters, normal, estimator, chi_square = correct(*arguments)
        return parameters, normal * (2 / 3) ** 2, estimator, chi_square

    monkeypatch.setattr(fit, "_solve", overconfident)
    study = coverage_study(["few-mono-12"], sensors=80, processes=1)
    wanted = {"system_gain_dn_per_e", "conversion_gain_uv_per_e", "quantum_efficiency_percent"}
    assert wanted <= set(_off(study, 160))
    assert wanted <= {row.parameter for row in study.rows if "coverage too low" in row.remarks}


@pytest.mark.parametrize(
    ("sensors", "covered", "bias", "bias_error", "remarks"),
    [
        (50, 45, 0.2, 0.14, ()),  # P(45 or fewer, or as rare above) = 0.10
        (50, 41, 0.0, 0.14, ("coverage too low",)),  # 0.0007
        (50, 50, 0.0, 0.14, ()),  # 0.95^50 = 0.08
        (800, 735, 0.0, 0.04, ("coverage too low",)),  # 91.9 %
        (800, 800, 0.0, 0.04, ("coverage too high",)),
        (800, 760, 0.3, 0.04, ("biased",)),
        (800, 760, 0.2, 0.04, ()),  # 2.5 standard errors beyond 0.1
        (1, 0, 3.0, 0.0, ()),
    ],
)
def test_only_significant_deviations_are_flagged(
    sensors: int, covered: int, bias: float, bias_error: float, remarks: tuple[str, ...]
) -> None:
    row = Coverage(
        "few-mono-12", "x", sensors, sensors, covered / sensors, bias, 1.0, exact=0, wrong=0, bias_error=bias_error
    )
    assert row.remarks == remarks
    assert row.passes == (not remarks)


def test_standard_error_of_the_mean_error() -> None:
    """Standard normal errors of one uncertainty: 1 / sqrt(n), which has a standard error of 4 % itself."""
    errors = np.random.default_rng(8).normal(0.0, 1.0, 400)
    row = _row("few-mono-12", "x", [Outcome(float(e), 1.0, 1.0, abs(e) < 1.96) for e in errors], [])
    assert row.bias == pytest.approx(errors.mean())
    assert row.bias_error == pytest.approx(1 / 20, rel=0.16)


def test_failed_calibrations_are_counted_by_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    """The frames of the second sensor have no light."""

    def calibrate(frames: FrameSet, **options: Any) -> Any:
        if "sensor 1" in frames.source:
            raise CalibrationError("all frames are 0", where=frames.source)
        return calibrate_setting(frames, **options)

    monkeypatch.setattr(coverage, "calibrate_setting", calibrate)
    study = coverage_study(["clipped-mono-12"], sensors=2, processes=1)
    (entry,) = study.refused["clipped-mono-12"]
    assert entry.sensors == 1
    assert "virtual frames of clipped-mono-12, sensor 1: all frames are 0" in entry.example
    content = study.to_dict()["conditions"]["clipped-mono-12"]
    assert (content["refused"], content["why_refused"]) == (1, [{"sensors": 1, "example": entry.example}])


def test_row_noise_counts_in_the_read_noise_and_its_uncertainty() -> None:
    """12 sensors: the mean error of the read noise without its rows is 30 uncertainties, and its width 20."""
    study = coverage_study(["rows-mono-12"], sensors=12, processes=1)
    (row,) = (row for row in study.rows if row.parameter == "read_noise_dn")
    # A width above 1.75 occurs in 1 of 1000 studies with correct uncertainties.
    assert row.width < 1.75


def test_effects_are_reported_where_they_are_and_not_where_they_are_not() -> None:
    """Sensor 1 of each: the effect is far beyond chance."""
    curve, lines, clean = (
        measure_sensor(CONDITIONS[name].lab(1))[2] for name in ("curve-mono-12", "lines-mono-12", "few-mono-12")
    )
    assert "response_curve" in curve
    assert "line_noise" in lines
    assert clean == ()


def test_processes_do_not_change_the_numbers() -> None:
    alone, together = (coverage_study(["few-mono-12"], sensors=2, processes=n) for n in (1, 2))
    assert alone == together


def test_a_wrong_exact_value_is_flagged() -> None:
    row = Coverage("few-mono-12", "saturation_dn", 10, 10, 0.95, 0.0, 1.0, exact=5, wrong=1)
    assert not row.passes


@pytest.mark.parametrize("field", ["sensors", "processes"])
def test_numbers_below_1_are_rejected(field: str) -> None:
    with pytest.raises(InputError) as caught:
        coverage_study(["few-mono-12"], **{field: 0})
    assert (caught.value.what, caught.value.value) == (field, 0)


def test_an_unknown_condition_is_rejected() -> None:
    with pytest.raises(InputError) as caught:
        condition("few-mono-21")
    assert caught.value.hint == "Did you mean 'few-mono-12'?"


def test_sensors_differ_and_are_reproducible() -> None:
    some = condition("bright-cfa-10")
    assert some.sensor(3) == some.sensor(3)
    assert some.sensor(3).noise != some.sensor(4).noise
    assert some.lab(3).light.mean_luminance_cd_m2() != some.lab(4).light.mean_luminance_cd_m2()
