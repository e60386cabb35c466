"""Uneven light is reported apart from PRNU; fixed patterns of pixels, rows and columns are not taken for it."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.spatial.nonuniformity import MapPlanes, is_large, shading_variance
from photosite.calibration.spatial.pixel_slopes import PixelSlopes
from photosite.frames.frame_set import FrameSet
from photosite.values.uncertain import Uncertain

MONO = np.zeros((1, 1), np.int64)


def response(rng, *, shape=(120, 160), pixel=0.01, column=0.0, row=0.0, shading=0.0):
    """A map of responses of mean 1; `shading` is the standard deviation of a fall-off towards the corners."""
    rows, cols = (np.linspace(-1.0, 1.0, length) for length in shape)
    fall = -np.add.outer(rows**2, cols**2)
    values = 1.0 + shading * (fall - fall.mean()) / fall.std() + pixel * rng.normal(size=shape)
    return values + column * rng.normal(size=shape[1]) + row * rng.normal(size=(shape[0], 1))


def measured(values, tile=MONO, channel=0):
    slopes = PixelSlopes(values.shape, tile)
    slopes.slopes[:] = values
    none = Uncertain(0.0)
    spread = slopes.spreads([none] * (int(tile.max()) + 1))[channel]
    return shading_variance(MapPlanes(values, tile), channel, spread, none, 1.0), spread.variance


@pytest.mark.parametrize("pattern", [{}, {"column": 0.01}, {"row": 0.005, "column": 0.005}], ids=str)
def test_fixed_patterns_have_no_shading(pattern):
    rng = np.random.default_rng(1)
    found = [measured(response(rng, shape=(64, 80), **pattern)) for _ in range(150)]
    assert not any(is_large(*each) for each in found)
    scores = [shading.value / shading.standard_uncertainty for shading, _ in found]
    assert abs(np.mean(scores)) < 0.3
    assert np.std(scores) < 1.1


@pytest.mark.parametrize("size", [0.004, 0.01, 0.05])
def test_shading_is_measured(size):
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(20):
        shading, total = measured(response(rng, shading=size, column=0.002))
        assert is_large(shading, total)
        low, high = shading.interval_95
        inside += low <= size**2 <= high
    assert inside >= 17


def test_a_channel_of_a_mosaic_has_its_own_shading():
    rng = np.random.default_rng(3)
    values, tile = response(rng), np.array([[0, 1], [1, 0]])
    values[::2, ::2] = response(rng, shape=(60, 80), shading=0.03)
    values[1::2, 1::2] = response(rng, shape=(60, 80), shading=0.03)
    assert measured(values, tile, 0)[0].value == pytest.approx(0.03**2, rel=0.05)
    assert not is_large(*measured(values, tile, 1))


def stack(shading):
    rng = np.random.default_rng(4)
    shape = (64, 80)
    light = response(rng, shape=shape, shading=shading)

    def take(kind, exposure_s, electrons):
        e = np.minimum(rng.poisson(electrons * light, (6, *shape)), 9000)
        frames = np.rint(64.0 + 0.3 * e + rng.normal(0.0, 2.0, e.shape)).astype(np.uint16)
        return [(kind, exposure_s, dn) for dn in frames]

    darks = [take("dark", t, 0.0) for t in (0.01, 0.1)]
    lights = [take("light", t, 1e5 * t) for t in (0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.12)]
    return FrameSet.from_arrays([shot for group in (*darks, *lights) for shot in group], bits=12)


def test_the_warning_names_prnu_with_and_without_shading():
    uneven, even = calibrate(stack(0.03)), calibrate(stack(0.0))
    assert uneven.shading_percent.value == pytest.approx(3.0, rel=0.05)
    assert uneven.prnu_percent.value == pytest.approx(np.hypot(3.0, 1.0), rel=0.05)
    assert uneven.prnu1288_percent.value == pytest.approx(1.0, rel=0.1)
    assert limits(uneven)["uneven-light"] == uneven.shading_percent.value
    assert "uneven-light" not in limits(even)
