"""Color accuracy against colour-science on pictures and mosaics whose colors are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

from photosite.develop.camera_color import fit_color_matrix
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.color.color_accuracy import splits
from photosite.metrics.color.color_matrices import best_strength
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.studies.measurements.color_accuracy import color_errors, picture, reference, with_errors
from photosite.studies.virtual_patches import color_checker

Array = NDArray[np.float64]

CHART, REFERENCE = color_checker(), reference()
SHAPE = CHART.shape
BAYER = (("R", "G"), ("G", "B"))


def measured(image: object, **options: object) -> Result:
    return measure(image, "macbeth", options={"color-accuracy": options})["color-accuracy"]  # type: ignore[arg-type]


def test_differences_are_those_of_colour_science() -> None:
    xyz = with_errors(np.random.default_rng(1))
    found = measured(picture(xyz), match_exposure=False)
    for name, value in color_errors(xyz).items():
        assert found[name].value == pytest.approx(value, rel=1e-6), name


def test_splits_add_up() -> None:
    random = np.random.default_rng(2)
    one, other = random.uniform(-60, 60, (2, 100, 3))
    parts = splits(one, other)
    assert sum(part**2 for part in parts) == pytest.approx(np.sum((one - other) ** 2, axis=-1))


def test_exposure_is_matched() -> None:
    xyz = with_errors(np.random.default_rng(3))
    bright, normal = measured(picture(1.5 * xyz)), measured(picture(xyz))
    difference = (bright["exposure_stops"].value or 0) - (normal["exposure_stops"].value or 0)
    assert difference == pytest.approx(np.log2(1.5))
    assert bright["delta_e_2000_mean"].value == pytest.approx(normal["delta_e_2000_mean"].value, abs=1e-4)
    assert "off-exposure" in {entry.id for entry in bright.diagnostics}
    assert "off-exposure" not in {entry.id for entry in normal.diagnostics}


def mosaic(camera: Array) -> Array:
    """Return a Bayer mosaic of (24, 3) channels."""
    planes = np.full((*SHAPE, 3), 50.0)
    for patch, color in zip(CHART.patches, camera, strict=True):
        planes[patch.r0 - 4 : patch.r1 + 4, patch.c0 - 4 : patch.c1 + 4] = color
    sites = np.array([[0, 1], [1, 2]])[np.arange(SHAPE[0])[:, None] % 2, np.arange(SHAPE[1]) % 2]
    return np.take_along_axis(planes, sites[..., None], axis=-1)[..., 0]


def test_a_camera_that_follows_the_color_matching_functions_has_no_errors() -> None:
    camera = 4000.0 * REFERENCE @ np.array([[0.8, 0.1, 0.1], [0.3, 0.8, 0.0], [0.0, 0.1, 0.9]])
    exact = measured(ChartImage((mosaic(camera),), "electrons", BAYER))
    for part in ("matrix", "matrix, patch left out", "regularized, patch left out"):
        assert exact["delta_e_2000_max", part].value == pytest.approx(0.0, abs=0.01), part
    random = np.random.default_rng(4)
    missed: dict[str, int] = {}
    for _ in range(10):
        noisy = measured(ChartImage((random.poisson(mosaic(camera)),), "electrons", BAYER))
        for name in ("delta_e_2000_mean", "delta_e_76_max", "white_balance_error"):
            low, high = noisy[name, "matrix, patch left out"].interval_95 or (1.0, 1.0)
            missed[name] = missed.get(name, 0) + (low > 0.0)
            assert low < high < 3.0, name
    assert max(missed.values()) <= 2, missed


def test_matrices_are_those_of_the_developer() -> None:
    random = np.random.default_rng(5)
    camera = 4000.0 * np.abs(REFERENCE @ random.uniform(0.0, 1.0, (3, 3)) * random.uniform(0.9, 1.1, (24, 3)))
    found = measured(ChartImage((mosaic(camera),), "electrons", BAYER))
    fit = fit_color_matrix(camera, REFERENCE)
    assert found["delta_e_2000_mean", "matrix"].value == pytest.approx(fit.delta_e_2000.mean(), rel=1e-6)
    left_out = found["delta_e_2000_mean", "matrix, patch left out"].value
    assert left_out == pytest.approx(fit.delta_e_2000_left_out.mean(), rel=1e-6)


def test_regularized_intervals_hold_the_truth() -> None:
    """Of 30 noisy mosaics, the intervals of a figure miss more than 6 in 1 of 1600 runs."""
    random = np.random.default_rng(6)
    missed = dict.fromkeys(("matrix", "matrix, patch left out", "regularized, patch left out"), 0)
    for _ in range(30):
        camera = 400.0 * np.abs(REFERENCE @ (np.eye(3) + 0.2 * random.uniform(0.0, 1.0, (3, 3))))
        camera *= random.uniform(0.9, 1.1, (24, 3))
        exact = measured(ChartImage((mosaic(camera),), "electrons", BAYER))
        found = measured(ChartImage((random.poisson(mosaic(camera)),), "electrons", BAYER))
        for part in missed:
            low, high = found["delta_e_2000_mean", part].interval_95 or (np.nan, np.nan)
            missed[part] += not low <= (exact["delta_e_2000_mean", part].value or 0) <= high
    assert max(missed.values()) <= 6, missed


def test_saturated_patches_are_left_out() -> None:
    camera = 1000.0 * REFERENCE
    values = np.minimum(np.random.default_rng(7).poisson(mosaic(camera)), 800)
    found = measured(ChartImage((values,), "raw", BAYER, white=800.0))
    (entry,) = (entry for entry in found.diagnostics if entry.id == "saturated-patches")
    assert entry.size == 1


def test_wrong_charts_are_refused() -> None:
    turned = picture(REFERENCE)[::-1, ::-1]
    with raises(InputError, what="color-accuracy"):
        measured(turned)
    with raises(InputError, what="color-accuracy"):
        measured(picture(REFERENCE)[..., 0])


def test_regularization_follows_the_colors_without_steps() -> None:
    """A strength from a list of strengths would jump by the factor 1.8 between them."""
    rng = np.random.default_rng(3)
    mixing = np.array([[0.7, 0.2, 0.1], [0.2, 0.7, 0.2], [0.0, 0.1, 0.8]])
    xyz = rng.uniform(0.05, 0.9, (24, 3))
    prior = np.linalg.inv(mixing) + 0.05
    path = np.linspace(0.0, 1.0, 200)[:, None, None]
    camera = xyz @ mixing + 0.004 * ((1.0 - path) * rng.normal(size=(24, 3)) + 4.0 * path * rng.normal(size=(24, 3)))
    strength = np.log10(best_strength(camera, xyz, prior))
    assert np.ptp(strength) > 0.4
    assert np.abs(np.diff(strength)).max() < 0.05
