"""The closed loop: virtual sensors with known parameters, and calibrations of their frames."""

from __future__ import annotations

import io
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import stats
from short_protocol import short_d200_protocol

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.frames.raw_frame import RawFrame
from photosite.report.page import WIDEST, Images
from photosite.sensor.model import Sensor
from photosite.studies.closed_loop import (
    HEADLINE,
    ClosedLoop,
    ParameterRow,
    closed_loop,
    compared_parameters,
    parameter_blocks,
)
from photosite.studies.protocol import paper_d200_protocol
from photosite.studies.virtual_lab import virtual_lab, with_pedestal

NEED_PHOTONS = {"quantum_efficiency_percent", "sensitivity_threshold_photons", "saturation_capacity_photons"}
"""Parameters that need metered light, which the paper's protocol does not have."""


def _some_sensor(number: int) -> Sensor:
    """Return a sensor whose parameters are drawn log-uniformly around those of the D200."""
    rng = np.random.default_rng(number)

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    sensor = ps.load_sensor("nikon-d200").with_(
        rows=72,
        cols=104,
        serial=f"closed loop {number}",
        read_noise_mv=between(0.2, 2),
        dsnu_mv=between(0.2, 2),
        prnu_percent=between(0.5, 3),
        dark_voltage_mv_per_s=between(0.01, 1),
        conversion_gain_uv_per_e=between(15, 60),
        analog_gain=between(0.9, 1.5),
    )
    return with_pedestal(sensor)


SENSORS = 20


@pytest.fixture(scope="module")
def rows() -> dict[str, list[ParameterRow]]:
    """True and estimated value of every parameter, for each sensor."""
    found: dict[str, list[ParameterRow]] = defaultdict(list)
    for number in range(SENSORS):
        lab = virtual_lab(_some_sensor(number), paper_d200_protocol(), seed=number)
        for row in compared_parameters(lab, calibrate(lab.frame_set())):
            found[row.name].append(row)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in HEADLINE if name not in NEED_PHOTONS])
def test_estimates_are_centred_and_intervals_cover(rows: dict[str, list[ParameterRow]], name: str) -> None:
    """Mean deviation within 3.3 standard errors of 0, expected spread, 17 of 20 intervals cover.

    For correct intervals, false alarms per parameter: mean 0.1 %, spread (chi-square of 19 degrees of freedom, 0.1 %
    and 99.9 %) 0.2 %, coverage 1.6 %; the seeds are fixed. A bias of one standard uncertainty moves the mean by 4.5
    standard errors. Uncertainties half as large as they should be raise chi-square to 76, beyond the limit of 44.
    """
    sensors = SENSORS
    exact = [row for row in rows[name] if row.standard_uncertainty == 0]
    assert [row.estimated for row in exact] == pytest.approx([row.true for row in exact], rel=1e-12)
    deviations = np.array([row.deviation for row in rows[name] if row.deviation is not None])
    assert deviations.size + len(exact) == sensors
    if exact:
        return
    assert abs(deviations.mean()) < 3.3 / np.sqrt(sensors)
    low, high = stats.chi2.ppf((0.001, 0.999), sensors - 1)
    assert low < np.sum((deviations - deviations.mean()) ** 2) < high
    assert np.count_nonzero(np.abs(deviations) < 1.96) >= 17


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(NEED_PHOTONS))
def test_a_missing_estimate_has_a_reason(rows: dict[str, list[ParameterRow]], name: str) -> None:
    assert {(row.estimated, row.standard_uncertainty) for row in rows[name]} == {(None, None)}
    assert all(row.reason for row in rows[name])
    assert all(row.true > 0 for row in rows[name])


def test_metered_light_gives_the_quantum_efficiency() -> None:
    """4.5 standard uncertainties: false alarms 10^-5 each."""
    lab = virtual_lab(_some_sensor(0), short_d200_protocol(), seed=1, photons_known=True)
    found = {row.name: row for row in compared_parameters(lab, calibrate(lab.frame_set()))}
    for name in ("quantum_efficiency_percent", "sensitivity_threshold_photons"):
        row = found[name]
        assert row.deviation is not None
        assert abs(row.deviation) < 4.5
        assert row.standard_uncertainty is not None
        assert row.standard_uncertainty < 0.01 * row.true


def test_frames_on_disk_and_in_memory_give_the_same_result(loop: ClosedLoop, tmp_path: Path) -> None:
    disk = closed_loop(loop.true_sensor, loop.protocol, seed=5, folder=tmp_path / "stack")
    assert disk.parameters == loop.parameters
    assert disk.calibration.frames_sha256 == loop.calibration.frames_sha256
    np.testing.assert_array_equal(disk.calibrated_raw.dn, loop.calibrated_raw.dn)


def test_the_calibrated_sensor_agrees_with_the_true_one(loop: ClosedLoop) -> None:
    assert loop.validation.agrees
    assert list(loop.seconds) == ["shoot", "calibrate", "simulate", "compare"]


def _noise(raw: RawFrame) -> NDArray[np.float64]:
    """Return the normalized noise of the green pixels of all patches."""
    patches = [
        raw.dn[r.r0 + r.r0 % 2 : r.r1 : 2, r.c0 + 1 - r.c0 % 2 : r.c1 : 2].astype(float).ravel()
        for r in ps.charts.macbeth_regions(*raw.shape)
    ]
    return np.concatenate([(patch - patch.mean()) / patch.std() for patch in patches])


def test_the_two_captures_share_no_noise(loop: ClosedLoop) -> None:
    """Neither temporal noise nor fixed pattern: the correlation is 0 within 5 standard errors, 0.1."""
    a, b = _noise(loop.true_raw), _noise(loop.calibrated_raw)
    assert a.size > 2000
    assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(a.size)


def test_a_wrong_sensor_does_not_agree(loop: ClosedLoop) -> None:
    """The comparison has power: it detects 3 % of sensitivity."""
    sensor = loop.calibration.sensor
    wrong = sensor.with_(conversion_gain_uv_per_e=1.03 * sensor.pixel.conversion_gain_uv_per_e.value)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), wrong)
    raw = camera.capture(loop.scene, 1 / 3, seed=8)
    assert not ps.validate(loop.true_raw, raw, chart="macbeth", tolerance_percent=1).agrees


def test_clipped_dark_frames_are_calibrated_with_a_warning() -> None:
    """A D200 with its own black level: read noise and DSNU within 4.5 standard uncertainties (10^-5 each)."""
    loop = closed_loop(ps.load_sensor("nikon-d200").with_(rows=66, cols=98), short_d200_protocol())
    assert any("clip" in warning for warning in loop.calibration.warnings)
    rows = {row.name: row for row in loop.parameters}
    for name in ("read_noise_mv", "dsnu_mv"):
        deviation = rows[name].deviation
        assert deviation is not None
        assert abs(deviation) < 4.5


@pytest.fixture(scope="module")
def path(loop, undrawn, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page with its pictures; tests/report has the figures."""
    path = tmp_path_factory.mktemp("demo") / "demo.html"
    with undrawn():
        loop.report(path)
    assert path.stat().st_size < 3_000_000
    return path


@pytest.fixture(scope="module")
def page(path: Path, read_page):
    return read_page(path.read_text(encoding="utf-8"))


def test_page_needs_no_other_file(page) -> None:
    assert all(address.startswith("#") for address in page.values("href"))
    assert all(source.startswith("data:image/") for source in page.values("src"))
    assert not {tag for tag, _ in page.elements} & {"link", "iframe"}


def test_page_states_that_the_camera_is_virtual(page) -> None:
    assert "All images on this page come from a virtual camera." in page.text


def test_every_parameter_is_listed_with_its_truth(loop, page) -> None:
    rows = {(row[0], row[1]): row for row in page.rows}
    for parameter in loop.parameters:
        row = rows[parameter.label, parameter.unit]
        if parameter.estimated is None:
            assert row[2] == parameter.reason
        elif parameter.deviation is not None:
            assert float(row[4].replace("−", "-")) == pytest.approx(parameter.deviation, abs=0.0051)
    assert any(parameter.estimated is None for parameter in loop.parameters), "photons are not known in this loop"


def test_estimates_inside_the_band_are_counted(loop) -> None:
    far = tuple(
        replace(p, estimated=p.true + 5 * p.standard_uncertainty) if p.name == "read_noise_mv" else p
        for p in loop.parameters
    )
    drawn = [p for p in far if p.deviation is not None]
    inside = sum(abs(p.deviation) <= 1.96 for p in drawn)
    assert inside < len(drawn)
    figure = parameter_blocks(far)[-1]
    assert isinstance(figure, Images)
    assert f"here {inside} of {len(drawn)}." in figure.caption


def test_pictures_fit_the_page(page) -> None:
    pictures = [np.asarray(Image.open(io.BytesIO(content))) for content in page.images("image/jpeg")]
    assert len(pictures) == 5, "two charts, two details, their difference"
    assert all(picture.shape[1] <= WIDEST for picture in pictures)
    chart, calibrated, *_, difference = pictures
    assert chart.shape == calibrated.shape == difference.shape
    # The two cameras agree to well within a just visible difference; the difference picture is gray on average.
    assert np.abs(chart.mean(axis=(0, 1)) - calibrated.mean(axis=(0, 1))).max() < 1.0
    assert np.abs(difference.mean(axis=(0, 1)) - 127.5).max() < 4.0
    assert chart.std() > 30


def test_same_loop_gives_the_same_bytes(loop, undrawn, path: Path, tmp_path: Path) -> None:
    with undrawn():
        loop.report(tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == path.read_bytes()
