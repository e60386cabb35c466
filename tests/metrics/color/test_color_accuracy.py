"""Color accuracy against colour-science on pictures and mosaics whose colors are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

from photosite.color.colorimetry import D65_XY, SRGB_FROM_XYZ, colour_science
from photosite.develop.camera_color import fit_color_matrix
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage, chart_image
from photosite.metrics.charts.placed_chart import placed_chart
from photosite.metrics.color.color_accuracy import splits
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result

Array = NDArray[np.float64]

colour = colour_science()
SHAPE = (264, 392)
CHART = placed_chart(chart_image(np.ones(SHAPE)), "macbeth")
D65 = colour.xy_to_XYZ(D65_XY)
REFERENCE = colour.chromatic_adaptation(
    CHART.patch_xyz / CHART.white_xyz[1], CHART.white_xyz / CHART.white_xyz[1], D65, transform="Bradford"
)
BAYER = (("R", "G"), ("G", "B"))


def picture(xyz: Array) -> Array:
    """Return linear sRGB of patches on a dark ground."""
    image = np.full((*SHAPE, 3), 0.05)
    for patch, color in zip(CHART.patches, xyz @ SRGB_FROM_XYZ.T, strict=True):
        image[patch.r0 - 4 : patch.r1 + 4, patch.c0 - 4 : patch.c1 + 4] = color
    return image


def measured(image: object, **options: object) -> Result:
    return measure(image, "macbeth", options={"color-accuracy": options})["color-accuracy"]  # type: ignore[arg-type]


def truth(xyz: Array) -> dict[str, float]:
    """Return figures of colors, by colour-science alone."""
    ours, true = (colour.XYZ_to_Lab(each, np.array(D65_XY)) for each in (xyz, REFERENCE))
    found = {}
    for name, method in (("76", "CIE 1976"), ("94", "CIE 1994"), ("2000", "CIE 2000")):
        values = colour.delta_E(true, ours, method=method)
        found |= {f"delta_e_{name}_mean": values.mean(), f"delta_e_{name}_max": values.max()}
    values = colour.delta_E(*(colour.XYZ_to_ICtCp(100.0 * each) for each in (REFERENCE, xyz)), method="ITP")
    found |= {"delta_e_itp_mean": values.mean(), "delta_e_itp_max": values.max()}
    chroma, true_chroma = (colour.models.Jab_to_JCh(each)[..., 1] for each in (ours, true))
    found["lightness_error_rms"] = np.sqrt(np.mean((ours - true)[:, 0] ** 2))
    found["chroma_error_rms"] = np.sqrt(np.mean((chroma - true_chroma) ** 2))
    found["saturation_percent"] = 100.0 * chroma.mean() / true_chroma.mean()
    found["white_balance_error"] = np.linalg.norm((ours - true)[18:, 1:], axis=1).mean()
    return {name: float(value) for name, value in found.items()}


def with_errors(random: np.random.Generator) -> Array:
    """Return the chart's colors with random errors of a matrix and of each patch."""
    return REFERENCE @ (np.eye(3) + random.normal(0.0, 0.02, (3, 3))) * (1.0 + random.normal(0.0, 0.02, (24, 3)))


def test_differences_are_those_of_colour_science() -> None:
    xyz = with_errors(np.random.default_rng(1))
    found = measured(picture(xyz), match_exposure=False)
    for name, value in truth(xyz).items():
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


@pytest.mark.parametrize("noise", [0.002, 0.03])
def test_intervals_hold_the_truth(noise: float) -> None:
    """Of 40 pictures, the intervals of a figure miss more than 7 in 1 of 1400 runs. Noise is alike in neighbors."""
    random = np.random.default_rng(20261130)
    missed: dict[str, int] = {}
    for _ in range(40):
        xyz = with_errors(random)
        drawn = random.normal(0.0, noise, (SHAPE[0] + 1, SHAPE[1] + 1, 3))
        alike = (drawn[1:, 1:] + drawn[:-1, 1:] + drawn[1:, :-1] + drawn[:-1, :-1]) / 2.0
        found = measured(picture(xyz) + alike, match_exposure=False)
        for name, value in truth(xyz).items():
            low, high = found[name].interval_95 or (np.nan, np.nan)
            missed[name] = missed.get(name, 0) + (not low <= value <= high)
    assert max(missed.values()) <= 7, missed


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
