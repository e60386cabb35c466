"""Plates of scenes: every panel shows something, in the places it should."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.figure import Figure

from photosite.studies.gallery.patterns import colour_charts_plate, patterns_plate
from photosite.studies.gallery.pictures import lights_plate, pictures_plate


@pytest.mark.parametrize(
    ("plate", "panels", "lines"),
    [(patterns_plate, 12, 0), (colour_charts_plate, 2, 0), (lights_plate, 5, 4), (pictures_plate, 3, 15)],
)
def test_every_panel_shows_something(plate: Callable[[], Figure], panels: int, lines: int) -> None:
    figure = plate()
    pictures = [np.asarray(image.get_array()) for axes in figure.axes for image in axes.get_images()]
    assert len(pictures) == panels
    assert all(np.ptp(picture) > 0.4 and np.isfinite(picture).all() for picture in pictures)
    drawn = [np.asarray(line.get_ydata()) for axes in figure.axes for line in axes.get_lines()]
    assert len(drawn) == lines
    assert all(np.isfinite(values).all() and values.min() > -1e-3 for values in drawn)
