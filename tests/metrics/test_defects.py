"""Defective pixels put into even fields, and noise that hides them."""

from __future__ import annotations

import numpy as np

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.studies.virtual_fields import virtual_field

RGGB = (("R", "G"), ("G", "B"))


def test_counts_are_those_put_in() -> None:
    """Deviations of 50 %, of more than six standard deviations of the noise, under falloff, are all found."""
    random = np.random.default_rng(12)
    for _ in range(5):
        field = virtual_field(random)
        noise_free = field.electrons.mean() > 1500
        bright, dark = random.integers(0, 12, 2)
        places = random.choice(field.electrons.size, bright + dark, replace=False)
        pixels = field.electrons.reshape(-1)
        pixels[places[:bright]] *= 1.5
        pixels[places[bright:]] *= 0.5
        image = ChartImage((field.electrons,), "electrons", RGGB)
        found = measure(image, "uniform", only=["defects"])["defects"]
        assert (found["false_alarms"].value or 0) < 1.001e-3
        if noise_free:
            assert (found["bright_pixels"].value, found["dark_pixels"].value) == (bright, dark)
            low, high = found["bright_pixels"].interval_95 or (0, 0)
            assert low <= bright <= high


def test_noise_hides_small_deviations() -> None:
    random = np.random.default_rng(13)
    for level, hidden in ((40.0, True), (4000.0, False)):
        frame = random.poisson(np.full((200, 240), level)).astype(float)
        found = measure(frame, "uniform", only=["defects"])["defects"]
        assert ("noise-hides-defects" in {entry.id for entry in found.diagnostics}) == hidden
        assert (found["bright_pixels"].value or 0) <= 1
