"""Row, column and pixel parts against the standard's equations; the high-pass filter against simulation and SciPy."""

import numpy as np
import pytest
from scipy import ndimage

from photosite.calibration.spatial.line_noise import TemporalComponents
from photosite.calibration.spatial.nonuniformity import (
    MapPlanes,
    channel_components,
    high_pass,
    line_gain,
    pixel_gain,
    without_neighbors,
)
from photosite.engine.site_planes import MARGIN
from photosite.values.uncertain import Missing, Uncertain

NONE = Uncertain(0.0)
NO_NOISE = TemporalComponents(NONE, NONE, NONE)


def whole_parts(plane, noise, *, filtered):
    return channel_components(MapPlanes(plane, np.zeros((1, 1), np.int64)), 0, noise, filtered=filtered)


def test_high_pass_matches_scipy():
    plane = np.random.default_rng(0).normal(100.0, 5.0, (45, 60))
    smooth = ndimage.uniform_filter(plane, 7)
    smooth = ndimage.uniform_filter(smooth, 11)
    smooth = ndimage.convolve(smooth, np.outer([1, 2, 1], [1, 2, 1]) / 16)
    inner = (slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN))
    np.testing.assert_allclose(high_pass(plane), (plane - smooth)[inner], atol=1e-10)


def test_filter_gains_for_white_noise():
    """2000 x 2000 pixels and 40 000 columns; tolerance four standard errors, sqrt(2 / n)."""
    rng = np.random.default_rng(1)
    pixels = rng.normal(0.0, 1.0, (2000, 2000))
    assert high_pass(pixels).var() == pytest.approx(pixel_gain(), rel=4 * np.sqrt(2 / 2000**2))
    columns = np.broadcast_to(rng.normal(0.0, 1.0, 40_000), (20, 40_000))
    assert high_pass(columns).var() == pytest.approx(line_gain(), rel=4 * np.sqrt(2 / 40_000) * 1.2)


def test_unfiltered_parts_match_the_standard():
    """The equations of EMVA 1288 R4.0; they differ from the code by terms of 1 / rows and 1 / cols."""
    rng = np.random.default_rng(2)
    rows, cols = 400, 700
    plane = rng.normal(0, 1, (rows, cols)) + rng.normal(0, 2, cols) + rng.normal(0, 3, (rows, 1))
    total, cav, rav = plane.var(ddof=1), plane.mean(0).var(), plane.mean(1).var()
    m, n = rows, cols
    d = m * n - m - n
    parts = whole_parts(plane, NO_NOISE, filtered=False)
    assert parts.column.value == pytest.approx((m * n - n) / d * cav - n / d * (total - rav), rel=4e-3)
    assert parts.row.value == pytest.approx((m * n - m) / d * rav - m / d * (total - cav), rel=4e-3)
    assert parts.pixel.value == pytest.approx(m * n / d * (total - cav - rav), rel=4e-3)
    assert parts.total.value == pytest.approx(total, rel=4e-3)


def test_unfiltered_parts_match_the_analysis_of_variance():
    """The mean squares of the two-way table."""
    plane = np.random.default_rng(2).normal(0, 1, (12, 17)) + np.arange(17.0)
    rows, cols = plane.shape
    residual = plane - plane.mean(0) - plane.mean(1)[:, None] + plane.mean()
    pixel = (residual**2).sum() / ((rows - 1) * (cols - 1))
    column = (rows * plane.mean(0).var(ddof=1) - pixel) / rows
    row = (cols * plane.mean(1).var(ddof=1) - pixel) / cols
    parts = whole_parts(plane, NO_NOISE, filtered=False)
    for name, value in (("pixel", pixel), ("column", column), ("row", row), ("total", pixel + row + column)):
        assert getattr(parts, name).value == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("truth", [(1.0, 0.0, 0.0), (1.0, 0.3, 0.0), (1.0, 0.2, 0.5), (0.2, 1.0, 1.0)])
def test_parts_are_unbiased_and_covered(filtered, truth):
    """200 planes per case: means within four standard errors, and coverage above 88 %, 4.5 standard errors below 95 %.

    False alarms over all eight cases: under 0.5 %.
    """
    pixel, column, row = truth
    rng = np.random.default_rng([3, int(10 * column), int(10 * row)])
    found = {"pixel": [], "column": [], "row": [], "total": []}
    for _ in range(200):
        plane = rng.normal(0, pixel, (60, 80)) + rng.normal(0, column, 80) + rng.normal(0, row, (60, 1))
        noise = rng.normal(0, 0.5, plane.shape)
        parts = whole_parts(plane + noise, TemporalComponents(Uncertain.of(0.25), NONE, NONE), filtered=filtered)
        for name, values in found.items():
            part = getattr(parts, name)
            values.append((part.value, part.standard_uncertainty))
    wanted = {"pixel": pixel**2, "column": column**2, "row": row**2}
    wanted["total"] = sum(wanted.values())
    for name, pairs in found.items():
        values, uncertainty = np.array(pairs).T
        error = values - wanted[name]
        assert abs(error.mean()) < 4 * values.std() / np.sqrt(200), name
        assert np.mean(np.abs(error) < 1.96 * uncertainty) > 0.88, name


def test_filter_removes_shading():
    rng = np.random.default_rng(5)
    y, x = np.mgrid[-1:1:200j, -1:1:300j]
    plane = 1000.0 * (1 - 0.2 * (x**2 + y**2)) + rng.normal(0, 2.0, x.shape)
    assert whole_parts(plane, NO_NOISE, filtered=True).total.value == pytest.approx(4.0, rel=0.03)
    assert whole_parts(plane, NO_NOISE, filtered=False).total.value > 1000.0


def test_each_site_of_a_mosaic_is_a_separate_plane():
    """Different levels of the two greens are not nonuniformity."""
    rng = np.random.default_rng(6)
    mosaic = rng.normal(0.0, 1.0, (120, 160))
    mosaic[0::2, 1::2] += 50.0
    tile = np.array([[0, 1], [1, 2]])
    parts = channel_components(MapPlanes(mosaic, tile), 1, NO_NOISE, filtered=True)
    assert parts.total.value == pytest.approx(1.0, rel=0.1)


def test_too_small_plane_is_missing():
    result = channel_components(MapPlanes(np.zeros((60, 160)), np.array([[0, 1], [1, 2]])), 0, NO_NOISE, filtered=True)
    assert isinstance(result, Missing)
    assert result.id == "small-frames"


@pytest.mark.parametrize("filtered", [False, True])
def test_pixels_that_share_charge_with_neighbors_make_no_rows_and_columns(filtered):
    """4 % to each next pixel. 40 planes: standard errors of 0.00015 to 0.0002 for rows and columns."""
    rng, a = np.random.default_rng(4), 0.04
    correlation = 2 * a * (1 - 4 * a) / ((1 - 4 * a) ** 2 + 4 * a**2)
    plain, corrected = [], []
    for _ in range(40):
        own = rng.standard_normal((98, 130))
        shared = own[:-2, 1:-1] + own[2:, 1:-1] + own[1:-1, :-2] + own[1:-1, 2:]
        plane = (1 - 4 * a) * own[1:-1, 1:-1] + a * shared
        parts = whole_parts(plane, NO_NOISE, filtered=filtered)
        after = without_neighbors(parts, plane.shape, (correlation, correlation), filtered=filtered)
        assert after.total.value == parts.total.value == pytest.approx(sum(part.value for part in after.values[1:]))
        plain.append((parts.row.value, parts.column.value))
        corrected.append((after.row.value, after.column.value))
    assert (np.mean(plain, axis=0) > 0.0007).all()
    assert (np.abs(np.mean(corrected, axis=0)) < 0.0006).all()
