"""Plans of measurements against stacks of other seeds, the geometry of the lens, and what is out of reach."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.registry import measurement
from photosite.studies.measurement_planning import MeasurementPlan, PlannedChart, Planner, WantedInterval, distance_of
from photosite.studies.simulated_charts import ChartConditions

DRAWS = 30
WITHIN = 0.03
"""Relative difference of planned half widths from those of other seeds."""


@pytest.fixture(scope="module")
def camera() -> ps.Camera:
    sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
    return ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)


@pytest.fixture(scope="module")
def planner(camera: ps.Camera) -> Planner:
    return Planner(camera, ChartConditions())


def _measured(
    planner: Planner, plan: MeasurementPlan, setting: PlannedChart, frames: int, draws: int = 4
) -> tuple[float, float]:
    """Return the standard deviation of the values of other seeds, and the root mean square of the half widths."""
    entry = measurement(plan.want.name.measurement)
    seen = planner.seen(entry, setting.chart, (setting.rows, setting.cols), setting.exposure_s)
    key = plan.want.name.quantity, setting.part
    found = [entry(seen.image(seen.frames(frames, 1000 + draw)), seen.placed)[key] for draw in range(draws)]
    half = [0.5 * (high - low) for low, high in (each.interval_95 or (0.0, 0.0) for each in found)]
    return float(np.std([each.value for each in found], ddof=1)), float(np.sqrt(np.mean(np.square(half))))


@pytest.mark.parametrize(
    ("want", "chart"),
    [
        ("noise.snr_18_db.G=0.15dB", "macbeth"),  # the fixed pattern remains
        ("noise.snr_18_temporal_db.G=0.1", "macbeth"),  # nothing remains
        ("star-sfr.mtf50.G=0.0006", "siemens-star"),
    ],
)
def test_planned_frames_reach_the_interval(planner: Planner, want: str, chart: str) -> None:
    """Of other seeds, the planned frames reach the interval, one frame less does not, and values scatter as planned."""
    plan = planner.plan(want, [chart])
    best = plan.best
    assert best is not None
    assert best.frames is not None
    assert best.half_width is not None
    assert best.single is not None
    spread, half = _measured(planner, plan, best, best.frames, DRAWS)
    assert half == pytest.approx(best.half_width, rel=WITHIN)
    assert half <= plan.want.half_width * (1 + WITHIN)
    assert best.frames > 1
    assert _measured(planner, plan, best, best.frames - 1)[1] > plan.want.half_width * (1 - WITHIN)
    # The scatter of the values is the part that falls with the frames, within its own 99.8 % interval.
    ratio = spread / (best.single / 1.96 / math.sqrt(best.frames))
    low, high = np.sqrt(chi2.ppf([0.001, 0.999], DRAWS - 1) / (DRAWS - 1))
    assert low / 1.1 < ratio < high * 1.1


def test_extrapolated_frames_reach_the_interval(planner: Planner) -> None:
    plan = planner.plan("noise.snr_18_temporal_db.G=0.025", ["macbeth"])
    first = plan.settings[0]
    assert first.extrapolated
    assert first.frames is not None
    half = _measured(planner, plan, first, first.frames)[1]
    assert half == pytest.approx(0.025, rel=0.05)


def test_what_frames_do_not_reduce_is_told_from_what_they_do(planner: Planner) -> None:
    """A chart twice as large has four times the pixels: the fixed pattern's part of the interval is half as wide."""
    plan = planner.plan("noise.snr_18_db.G=0.02", ["macbeth"])
    assert plan.best is None
    assert "no number of frames reaches it" in plan.advice
    remains = plan.settings[0].systematic or 0.0
    assert remains > 0.02
    many = _measured(planner, plan, plan.settings[0], 100)[1]
    assert many == pytest.approx(math.hypot(remains, (plan.settings[0].single or 0.0) / math.sqrt(100)), rel=WITHIN)
    large = ps.Camera(planner.camera.optics, planner.camera.sensor.with_(rows=528, cols=784))
    larger = Planner(large, ChartConditions()).plan("noise.snr_18_db.G=0.02", ["macbeth"]).settings[0]
    assert larger.systematic == pytest.approx(remains / 2, rel=0.1)
    cols = int(plan.advice.split("about ")[1].split()[0])
    assert cols == pytest.approx(plan.settings[0].cols * remains / 0.02, rel=0.02)


def test_light_that_is_missing_is_named(camera: ps.Camera) -> None:
    dim = ChartConditions(exposure_s=1 / 2000)
    plan = ps.plan_measurement(camera, "noise.snr_18_db.G=0.11", charts=["macbeth"], conditions=dim)
    assert "times the light reaches it" in plan.advice
    bright = ps.plan_measurement(camera, "noise.snr_18_db.G=0.11", charts=["macbeth"]).best
    assert bright is not None
    assert f"with {bright.frames} frames" in plan.advice


def test_distance_is_that_of_the_magnification(planner: Planner) -> None:
    """f (1 + 1 / m), where the width of the chart fills the pixels."""
    plan = planner.plan("edge-sfr.mtf50.G=0.05")
    best = plan.best
    assert best is not None
    width_um = planner.camera.sensor.pixel.width_um.value
    magnification = best.cols * width_um * 1e-3 / 200.0
    assert best.magnification == pytest.approx(magnification)
    assert best.distance_m == pytest.approx(0.05 * (1 + 1 / magnification))
    farthest = plan.farthest
    assert farthest is not None
    assert farthest.distance_m >= best.distance_m
    with pytest.raises(InputError):
        planner.plan("edge-sfr.mtf50.G=0.05", ["macbeth"])


def test_distance_of_a_lens_with_a_fixed_focus() -> None:
    """Image distance over magnification."""
    lens = ps.Lens(ps.DiffractionLimited(f_number=4, focal_length_mm=50), focus_distance_m=2.0)
    assert distance_of(lens, 0.01) == pytest.approx(lens.image_distance_m(3.0) / 0.01)


def test_charts_that_are_too_small_say_so(planner: Planner) -> None:
    plan = planner.plan("noise.snr_18_temporal_db.G=0.4", ["macbeth"])
    small = [each for each in plan.settings if each.value is None]
    assert small
    assert all("pixels of channel" in each.reason for each in small)


@pytest.mark.parametrize(
    "text",
    [
        *("noise.snr_18_db", "noise.snr_18_db=", "noise.snr_18_db=0", "noise.snr_18_db=-1"),
        *("noise.snr_18_db=0.1e", "noise.loudness=1", "mtf50.center=0.01"),
    ],
)
def test_unknown_wants_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        WantedInterval.parse(text)


def test_values_without_interval_are_refused(planner: Planner) -> None:
    with pytest.raises(InputError):
        planner.plan("moving-edge.velocity=1")
    with pytest.raises(InputError):
        planner.plan("noise.snr_18_db.Q=1", ["macbeth"])
