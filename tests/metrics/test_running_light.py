"""Running lights against the overlap of exposures with the steps, drawn by plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.studies.measurements.running_light import (
    STEP_MS,
    STUDY,
    WHITE_E,
    lit_lamps,
    running_light,
    unequal_lamps,
)


def measured(frames: list[NDArray[np.float64]], **chart_options: int) -> Result:
    image = ChartImage(tuple(frames), "raw", white=WHITE_E)
    options = {"running-light": {"step_ms": STEP_MS}}
    found = measure(image, "led-bar", only=["running-light"], options=options, chart_options=chart_options)
    return found["running-light"]


def test_exposure_and_line_time() -> None:
    """Of 120 stacks, 95 % intervals miss more than 13 in 1 of 200 runs; lamps differ by 1 %."""
    random = np.random.default_rng(20261207)
    missed: dict[str, int] = {}
    for number in range(120):
        hidden = STUDY.draw(random, number)
        options = {"running-light": hidden.options}
        found = measure(hidden.frames, hidden.chart, only=["running-light"], options=options)["running-light"]
        for key, value in hidden.truth_of(found).items():
            low, high = found[key].interval_95 or (np.nan, np.nan)
            missed[key[0]] = missed.get(key[0], 0) + (not low <= value <= high)
        assert (found["exposure_ms"].standard_uncertainty or 1) < 0.02 * (found["exposure_ms"].value or 0)
    print({name: f"{100 * (1 - each / 120):.0f} %" for name, each in missed.items()})
    assert len(missed) == 4
    assert max(missed.values()) <= 13, missed


def test_one_line_of_one_frame() -> None:
    """The uncertainty is that of unequal lamps: of 80 frames, more than 10 miss in 1 of 250 runs."""
    random = np.random.default_rng(20261208)
    missed = 0
    for _ in range(80):
        exposure = random.uniform(4.0, 13.0)
        whole = running_light(random, exposure, 0.0, unequal_lamps(random))
        found = measured([whole[96:144]], lines=1, rows=48)
        low, high = found["exposure_ms"].interval_95 or (np.nan, np.nan)
        missed += not low <= exposure * STEP_MS <= high
        assert found["line_time_us"].reason is not None
    print(f"{100 * (1 - missed / 80):.0f} %")
    assert missed <= 10


def test_lights_that_do_not_run() -> None:
    random = np.random.default_rng(3)
    for exposure in (19.5, 1.2):  # nearly a round; too short
        with pytest.raises(InputError, match="lit lamps"):
            measured([running_light(random, exposure, 0.0, unequal_lamps(random))])
    with pytest.raises(InputError):
        measured([random.normal(100.0, 10.0, lit_lamps().shape)])
    with pytest.raises(InputError, match="step_ms"):
        measure(ChartImage((lit_lamps(),), "electrons"), "led-bar", only=["running-light"])["running-light"]
