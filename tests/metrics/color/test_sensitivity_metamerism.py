"""Spectral sensitivities against the color-matching functions, and lights against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

import photosite as ps
from photosite.color.colorimetry import color_matching_functions, colour_science
from photosite.color.illuminants import daylight
from photosite.errors import InputError
from photosite.metrics.chart_image import chart_image
from photosite.metrics.color.chart_light import spectral_similarity
from photosite.metrics.color.sensitivity_metamerism import luther_residual, vora_value
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.sensor.model import Sensor

Array = NDArray[np.float64]

colour = colour_science()
GRID = np.arange(380.0, 781.0, 5.0)
BARS = color_matching_functions(GRID)
MIX = np.array([[0.7, 0.3, 0.0], [0.2, 0.8, 0.1], [0.0, 0.1, 0.4]])
D200 = ps.load_sensor("nikon-d200")


def with_sensitivities(energy: Array, spread: Array | None = None) -> Sensor:
    """Return a D200 whose channels respond to energy as given, with relative uncertainties."""
    efficiency = energy / GRID
    efficiency = 0.5 * efficiency / efficiency.max()
    channels = {
        name: channel.model_copy(
            update={
                "wavelength_nm": tuple(GRID),
                "quantum_efficiency": tuple(values),
                "standard_uncertainty": None if spread is None else tuple(spread * values),
            }
        )
        for (name, channel), values in zip(D200.channels.items(), efficiency, strict=True)
    }
    return D200.with_(channels=channels)


def measured(sensor: Sensor | None, **options: object) -> Result:
    image = chart_image(np.full((96, 144), 100.0), sensor=sensor)
    return measure(image, "macbeth", only=["sensitivity-metamerism"], options={"sensitivity-metamerism": options})[
        "sensitivity-metamerism"
    ]


@pytest.mark.parametrize("preserve_white", [False, True])
def test_color_matching_functions_are_perfect(preserve_white: bool) -> None:
    found = measured(with_sensitivities(MIX @ BARS), preserve_white=preserve_white)
    assert found["smi"].value == pytest.approx(100.0, abs=1e-6)
    assert found["smi_least_squares"].value == pytest.approx(100.0, abs=1e-6)
    assert found["vora_value"].value == pytest.approx(1.0)
    assert found["luther_residual_percent"].value == pytest.approx(0.0, abs=1e-6)


def test_residuals_of_a_known_space() -> None:
    """Two of three orthogonal directions of the eye leave the third."""
    basis = np.linalg.svd(BARS, full_matrices=True)[2]
    assert vora_value(basis[[0, 1, 5]]) == pytest.approx(2 / 3)
    assert vora_value(basis[5:8]) == pytest.approx(0.0, abs=1e-12)
    sizes = np.linalg.svd(BARS)[1]
    assert luther_residual(basis[[0, 1, 5]]) == pytest.approx(sizes[2] / np.linalg.norm(sizes))


def test_the_best_matrix_is_not_worse_than_least_squares() -> None:
    for preserve_white in (False, True):
        found = measured(D200, preserve_white=preserve_white)
        best, least_squares = found["smi"].value or 0, found["smi_least_squares"].value or 0
        assert 70.0 < least_squares <= best < 95.0


def test_least_squares_by_other_means() -> None:
    """The index by tables and functions of colour-science, which has the reflectances of the standard."""
    shape = colour.SpectralShape(380, 780, 5)
    charts = colour.SDS_COLOURCHECKERS["ISO 17321-1"].values()
    patches = np.array([patch.copy().align(shape).values for patch in charts])[:18]
    light = colour.SDS_ILLUMINANTS["D55"].copy().align(shape).values
    bars = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    xyz, white = patches * light @ bars, light @ bars
    camera = patches * light * GRID @ np.array([c.quantum_efficiency_at(GRID) for c in D200.channels.values()]).T
    d65 = colour.xy_to_XYZ([0.3127, 0.3290])
    adapted = colour.chromatic_adaptation(xyz / white[1], white / white[1], d65, transform="Bradford")
    fitted = camera @ np.linalg.lstsq(camera, adapted)[0]
    labs = [colour.XYZ_to_Lab(each, np.array([0.3127, 0.3290])) for each in (fitted, adapted)]
    expected = 100.0 - 5.5 * np.linalg.norm(labs[0] - labs[1], axis=1).mean()
    assert measured(D200)["smi_least_squares"].value == pytest.approx(expected, abs=0.005)


def test_uncertain_sensitivities() -> None:
    """The uncertainty is the spread of the figures of sensitivities with errors."""
    random = np.random.default_rng(1)
    energy = np.array([c.quantum_efficiency_at(GRID) for c in D200.channels.values()]) * GRID
    relative = 0.02
    found = measured(with_sensitivities(energy, np.full(GRID.size, relative)))
    drawn = [
        measured(with_sensitivities(energy * (1.0 + random.normal(0.0, relative, energy.shape)))) for _ in range(30)
    ]
    for name in ("smi", "vora_value", "luther_residual_percent"):
        spread = np.std([one[name].value for one in drawn])
        # A standard deviation of 30 draws is 13 % uncertain.
        assert found[name].standard_uncertainty == pytest.approx(spread, rel=0.5), name


def test_a_sensor_is_needed() -> None:
    with raises(InputError, what="sensitivity-metamerism"):
        measured(None)


@pytest.mark.parametrize(("illuminant", "cct_k"), [("A", 2856.0), ("D65", 6504.0), ("D50", 5003.0)])
def test_light_of_a_chart(illuminant: str, cct_k: float) -> None:
    image = chart_image(np.full((96, 144), 100.0))
    found = measure(image, "macbeth", illuminant=illuminant, only=["chart-light"])["chart-light"]
    assert found["cct_k"].value == pytest.approx(cct_k, rel=1e-3)
    assert found["duv"].value == pytest.approx(0.0 if illuminant == "A" else 0.0032, abs=4e-4)
    assert found["ssi"].value == pytest.approx(100.0, abs=2.0)


def test_similarity_is_that_of_colour_science() -> None:
    """The value for C against D65 is printed in the documentation of colour-science."""
    grid = np.arange(375.0, 676.0)
    energy = colour.SDS_ILLUMINANTS["C"].copy().align(colour.SpectralShape(375, 675, 1)).values
    d65 = colour.SDS_ILLUMINANTS["D65"].copy().align(colour.SpectralShape(375, 675, 1)).values
    assert round(spectral_similarity(energy, d65)) == 94.0
    assert spectral_similarity(daylight(6504.0).at(grid), d65) == pytest.approx(100.0, abs=0.5)
