"""The plate of lenses shows what it says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import j1

from photosite.optics.wavefront import Wavefront
from photosite.studies.gallery import optics


def test_the_image_of_a_point_is_airys_pattern() -> None:
    lens = optics._LENS
    half_m, count = 10e-6, 41
    image = optics.point_image(Wavefront().point_spread(lens, math.inf), half_m, count)
    at = (np.arange(count) + 0.5 - count / 2) * (2 * half_m / count)
    v = math.pi * np.hypot(at[:, None], at) / (550e-9 * 4)
    airy = np.where(v > 0, (2 * j1(np.where(v > 0, v, 1)) / np.where(v > 0, v, 1)) ** 2, 1.0)
    peak = (math.pi / 4) / (550e-9 * 4) ** 2
    assert image / peak == pytest.approx(airy, abs=2e-5)


def test_every_lens_of_the_plate_is_drawn_with_its_peak() -> None:
    figure = optics.optics_plate()
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert len(titles) == len(optics.PLATE)
    assert titles[0] == "no aberration; peak 1.00"
    peaks = dict(title.split("; peak ") for title in titles)
    # Normalised to its own light a peak goes with the open area: of a hexagon, and of a ring.
    assert float(peaks["six blades"]) == pytest.approx(3 * math.sqrt(3) / (2 * math.pi), abs=0.006)
    assert float(peaks["obscured by 0.4"]) == pytest.approx(0.84, abs=0.006)
