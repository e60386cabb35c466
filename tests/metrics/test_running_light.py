"""Running lights against the overlap of exposures with the steps, drawn by plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result

LAMPS, STEP_MS = 20, 0.5
CHART = ps.charts.led_bar.chart()
WEIGHTS = CHART.weights[0].astype(float)
ROWS, COLS = WEIGHTS.shape


def frame(
    random: np.random.Generator, first: float, exposure: float, per_row: float, lamps: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a frame; times are in steps, `lamps` are the relative lights of lamps by line."""
    start = (first + per_row * (np.arange(ROWS) + 0.5)) % LAMPS
    number = np.arange(LAMPS)
    part = np.zeros((ROWS, LAMPS))
    for turn in (-LAMPS, 0, LAMPS):
        ends = np.minimum(number + 1 + turn, start[:, None] + exposure), np.maximum(number + turn, start[:, None])
        part += np.maximum(ends[0] - ends[1], 0.0)
    light = part * lamps.repeat(ROWS // len(lamps), axis=0)
    mean = 100.0 + 8000.0 * WEIGHTS * light.repeat(COLS // LAMPS, axis=1)
    return random.poisson(mean) + random.normal(0.0, 5.0, mean.shape)


def measured(frames: list[NDArray[np.float64]], **options: float) -> Result:
    image = ChartImage(tuple(frames), "raw", white=5e4, exposure_s=2e-3)
    options = {"step_ms": STEP_MS} | options
    return measure(image, "led-bar", only=["running-light"], options={"running-light": options})["running-light"]


@pytest.mark.parametrize("count", [1, 4])
def test_exposure_and_line_time(count: int) -> None:
    """Of 80 stacks, 95 % intervals miss more than 10 in 1 of 250 runs; lamps differ by 1 %."""
    random = np.random.default_rng(20261207)
    missed = {"exposure_ms": 0, "line_time_us": 0, "exposure_error_percent": 0}
    for _ in range(80):
        exposure, per_row = random.uniform(3.2, 13.0), random.uniform(-0.005, 0.01)
        lamps = 1.0 + random.normal(0.0, 0.01, (5, LAMPS))
        found = measured([frame(random, random.uniform(0, LAMPS), exposure, per_row, lamps) for _ in range(count)])
        truth = {
            "exposure_ms": exposure * STEP_MS,
            "line_time_us": 1e3 * per_row * STEP_MS,
            "exposure_error_percent": 50.0 * exposure * STEP_MS - 100.0,
        }
        for name, value in truth.items():
            low, high = found[name].interval_95 or (np.nan, np.nan)
            missed[name] += not low <= value <= high
        assert (found["exposure_ms"].standard_uncertainty or 1) < 0.02 * exposure * STEP_MS
    print({name: f"{100 * (1 - each / 80):.0f} %" for name, each in missed.items()})
    assert max(missed.values()) <= 10, missed


def test_one_line_of_one_frame() -> None:
    """The uncertainty is that of unequal lamps: of 80 frames, more than 10 miss in 1 of 250 runs."""
    random = np.random.default_rng(20261208)
    missed = 0
    for _ in range(80):
        exposure = random.uniform(4.0, 13.0)
        lamps = 1.0 + random.normal(0.0, 0.01, (5, LAMPS))
        image = ChartImage((frame(random, random.uniform(0, LAMPS), exposure, 0.0, lamps)[96:144],), "raw", white=5e4)
        options = {"running-light": {"step_ms": STEP_MS}}
        line = {"lines": 1, "rows": 48}
        found = measure(image, "led-bar", only=["running-light"], options=options, chart_options=line)["running-light"]
        low, high = found["exposure_ms"].interval_95 or (np.nan, np.nan)
        missed += not low <= exposure * STEP_MS <= high
        assert found["line_time_us"].reason is not None
    print(f"{100 * (1 - missed / 80):.0f} %")
    assert missed <= 10


def test_lights_that_do_not_run() -> None:
    random = np.random.default_rng(3)
    equal = np.ones((5, LAMPS))
    for exposure in (19.5, 1.2):  # nearly a round; too short
        with pytest.raises(InputError, match="lit lamps"):
            measured([frame(random, 3.3, exposure, 0.0, equal)])
    with pytest.raises(InputError):
        measured([random.normal(100.0, 10.0, WEIGHTS.shape)])
    with pytest.raises(InputError, match="step_ms"):
        measure(ChartImage((WEIGHTS,), "electrons"), "led-bar", only=["running-light"])["running-light"]
