"""The lens against the thin-lens equations, and its tables against closed forms."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from raising import raises, warns

import photosite as ps
from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor, combined_mapping, image_height
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable, VeilingGlare
from photosite.optics.lens import Lens
from photosite.optics.point_spread import PointSpread, RadialPsf

BASE = DiffractionLimited(f_number=4, focal_length_mm=50)
GRID = np.array([450.0, 550.0, 650.0])


def heights(*values: float) -> FieldPoints:
    return FieldPoints(height_mm=np.array(values))


def angles(*values: float) -> FieldPoints:
    return FieldPoints(angle_deg=np.array(values))


def test_in_focus_the_lens_equals_its_base() -> None:
    lens = Lens(BASE, focus_distance_m=2.0)
    assert lens.magnification(2.0) == pytest.approx(BASE.magnification(2.0), rel=1e-14)
    np.testing.assert_array_equal(lens.irradiance_per_radiance(GRID, 2.0), BASE.irradiance_per_radiance(GRID, 2.0))
    frequency = np.linspace(0, 5e5, 11)
    ours, theirs = lens.point_spread(2.0), BASE.point_spread(2.0)
    assert isinstance(ours, RadialPsf)
    np.testing.assert_array_equal(ours.otf(frequency, 550.0), theirs.otf(frequency, 550.0))
    assert lens.mapping(2.0) is None
    assert lens.veiling_glare is None


@pytest.mark.parametrize("distance_m", [0.03, 0.5, 4.0, math.inf])
def test_the_sensor_does_not_move_for_objects_out_of_focus(distance_m: float) -> None:
    lens = Lens(BASE, focus_distance_m=2.0)
    image_m = 1 / (1 / 0.05 - 1 / 2.0)  # thin-lens equation
    assert lens.image_distance_m(distance_m) == pytest.approx(image_m, rel=1e-14)
    assert lens.magnification(distance_m) == pytest.approx(image_m / distance_m if distance_m < 1e9 else 0, rel=1e-14)
    working = 4 * image_m / 0.05
    assert lens.irradiance_per_radiance(GRID, distance_m) == pytest.approx(math.pi / (1 + 4 * working**2), rel=1e-14)


def test_strong_defocus_is_the_geometrical_disc() -> None:
    """Far out of focus the OTF is that of a uniform disc, 2 J1(x) / x."""
    from scipy.special import j1

    lens = Lens(BASE, focus_distance_m=2.0)
    image_m = lens.image_distance_m(2.0)
    disc_m = 0.05 / 4 * abs(1 - image_m * (1 / 0.05 - 1 / 1.0))  # of an object at 1 m
    spread = lens.point_spread(1.0)
    assert isinstance(spread, RadialPsf)
    frequency = np.linspace(0.05, 2.0, 40) / disc_m
    x = math.pi * disc_m * frequency
    np.testing.assert_allclose(spread.otf(frequency, 550.0), 2 * j1(x) / x, atol=0.01)
    sharp = lens.point_spread(2.0)
    assert isinstance(sharp, RadialPsf)
    assert np.abs(sharp.otf(frequency, 550.0) - 1).max() < 0.1


def test_focused_at_infinity_the_sensor_is_at_the_focal_length() -> None:
    lens = Lens(BASE, focus_distance_m=math.inf)
    assert lens.image_distance_m(3.0) == 0.05
    assert lens.magnification(5.0) == pytest.approx(0.01, rel=1e-14)
    assert lens.magnification(math.inf) == 0


def test_throughput_of_an_obscured_pupil() -> None:
    class Half:
        throughput = 0.5

        def point_spread(
            self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None
        ) -> PointSpread:
            assert focus_distance_m == 2.0
            return base.point_spread(distance_m)

    lens = Lens(BASE, blur=Half(), focus_distance_m=2.0)
    assert lens.irradiance_per_radiance(GRID, 2.0) == pytest.approx(0.5 * BASE.irradiance_per_radiance(GRID, 2.0))
    assert isinstance(lens.point_spread(2.0), RadialPsf)


def test_relative_illumination_by_angle_reproduces_cos4() -> None:
    angle = np.linspace(0, 30, 16)
    table = IlluminationTable(FieldPoints(angle_deg=angle), np.cos(np.radians(angle)) ** 4)
    lens = Lens(BASE, focus_distance_m=2.0, illumination=table)
    cos4 = DiffractionLimited(4, 50, falloff="cos4")
    height = np.linspace(0, lens.image_distance_m(2.0) * math.tan(math.radians(30)), 400)
    ours, theirs = lens.relative_illumination(height, 2.0), cos4.relative_illumination(height, 2.0)
    assert ours is not None
    assert theirs is not None
    np.testing.assert_allclose(ours, theirs, atol=5e-5)  # interpolated between 16 points
    assert ours[0] == 1


def test_illumination_angles_follow_the_distortion() -> None:
    table = IlluminationTable(angles(0, 10, 20), np.array([1, 0.8, 0.5]))
    barrel = Distortion.from_percent(angles(0, 10, 20), [0, -2, -8])
    lens = Lens(BASE, illumination=table, distortion=barrel)
    image_m = lens.image_distance_m(2.0)
    real = image_m * np.tan(np.radians([10, 20])) * [0.98, 0.92]
    assert lens.relative_illumination(real, 2.0) == pytest.approx([0.8, 0.5], rel=1e-12)


def test_beyond_the_table_the_last_value_is_used_with_a_warning() -> None:
    table = IlluminationTable(heights(0, 10), np.array([1, 0.5]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert table.at(np.array([10.1e-3]), table.field.ideal_m(0.05)) == 0.5
    with warns("relative illumination is known"):
        assert table.at(np.array([12e-3]), table.field.ideal_m(0.05)) == 0.5


def test_percent_at_ideal_heights() -> None:
    barrel = Distortion.from_percent(heights(4, 8, 12), [-0.5, -2, -5])
    mapping = Lens(BASE, distortion=barrel).mapping(2.0)
    assert mapping is not None
    curve = image_height(mapping, 550.0)
    np.testing.assert_allclose(
        curve(np.array([0, 4, 8, 12]) * 1e-3), np.array([0, 3.98, 7.84, 11.4]) * 1e-3, rtol=1e-12
    )


def test_real_heights_and_percent_agree() -> None:
    angle = np.array([0.0, 10, 20, 30])
    ideal = 50 * np.tan(np.radians(angle))
    percent = np.array([0, -0.4, -1.7, -4.2])
    points = FieldPoints(angle_deg=angle)
    stated = Distortion.from_real_heights(points, ideal * (1 + percent / 100), 50.0)
    np.testing.assert_allclose(stated.ratio, Distortion.from_percent(points, percent).ratio, rtol=1e-12)


def test_the_polynomial_between_its_nodes() -> None:
    lens = Lens(BASE, distortion=Distortion.polynomial(-0.12, 0.03, -0.002, max_field_deg=35), focus_distance_m=1.0)
    mapping = lens.mapping(1.0)
    assert mapping is not None
    image_m = lens.image_distance_m(1.0)
    u = np.linspace(0, math.tan(math.radians(35)), 1001)
    expected = image_m * u * (1 - 0.12 * u**2 + 0.03 * u**4 - 0.002 * u**6)
    np.testing.assert_allclose(image_height(mapping, 550.0)(image_m * u), expected, atol=1e-12)


def test_magnification_per_wavelength_scales_the_whole_image() -> None:
    color = LateralColor.from_magnification([450, 550, 650], [1.0004, 1, 0.9997])
    mapping = Lens(BASE, lateral_color=color).mapping(2.0)
    assert mapping is not None
    far = np.array([0.3e-3, 5e-3, 20e-3])  # the table's only height is 1 mm
    for wavelength, scale in ((450, 1.0004), (500, 1.0002), (650, 0.9997)):
        np.testing.assert_allclose(image_height(mapping, wavelength)(far), far * scale, rtol=1e-9)


def test_magnification_applies_up_to_any_corner() -> None:
    # Corner at 1.1 mm, beyond the 1 mm of the table.
    sensor = ps.load_sensor("nikon-d200").with_(rows=65, cols=65, width_um=24.2, height_um=24.2)
    scene = ps.charts.macbeth()
    color = LateralColor.from_magnification([450, 650], [1.0004, 0.9997])
    camera = ps.Camera(Lens(DiffractionLimited(8, 50), lateral_color=color), sensor)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera.mean_electrons(scene, 0.1)
    far = LateralColor(np.array([450.0, 650.0]), FieldPoints(height_mm=np.array([1.0])), np.array([[0.4], [-0.3]]))
    with warns("the distortion of the"):
        ps.Camera(Lens(DiffractionLimited(8, 50), lateral_color=far), sensor).mean_electrons(scene, 0.1)


def test_lateral_color_is_added_to_the_distorted_image() -> None:
    barrel = Distortion.from_percent(FieldPoints(height_mm=np.linspace(0, 15, 16)), -4 * np.linspace(0, 1, 16) ** 2)
    height = np.linspace(0, 15, 7)
    shift = np.stack([3 * height / 15, 0 * height, -2 * (height / 15) ** 3])
    color = LateralColor(GRID, FieldPoints(height_mm=height), shift)
    mapping = combined_mapping(barrel, color, 0.05)
    assert mapping is not None
    ideal = np.linspace(0, 15e-3, 301)
    real = ideal * (1 - 0.04 * (ideal / 15e-3) ** 2)
    np.testing.assert_allclose(image_height(mapping, 550.0)(ideal), real, atol=2e-11)
    np.testing.assert_allclose(image_height(mapping, 450.0)(ideal), real * (1 + 0.2e-3), atol=2e-11)
    expected = real - 2e-6 * (real / 15e-3) ** 3
    np.testing.assert_allclose(image_height(mapping, 650.0)(ideal), expected, atol=3e-8)  # between 7 heights, a cubic


def test_a_camera_with_distortion_and_glare() -> None:
    sensor = ps.load_sensor("nikon-d200").with_(rows=60, cols=90)
    lens = ps.Lens(
        BASE,
        distortion=Distortion.polynomial(-0.1, max_field_deg=20),
        illumination=IlluminationTable(heights(0, 20), np.array([1, 0.5])),
        veiling_glare=VeilingGlare(0.02),
    )
    light = ps.charts.uniform("D65", 100)
    through, bare = (ps.Camera(optics, sensor).mean_electrons(light, 0.01) for optics in (lens, BASE))
    corner = lens.relative_illumination(np.array([np.hypot(29.5, 44.5) * 6.05e-6]), light.distance_m)
    assert corner is not None
    assert through[0, 0] / bare[0, 0] == pytest.approx(float(corner[0]), rel=1e-3)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: Lens(BASE, focus_distance_m=0.04), "focus_distance_m"),
        (lambda: Lens(BASE, focus_distance_m=2).magnification(0.0), "distance_m"),
        (
            lambda: Lens(
                DiffractionLimited(4, 50, falloff="cos4"),
                illumination=IlluminationTable(heights(0, 9), np.array([1, 0.5])),
            ),
            "falloff",
        ),
        (lambda: FieldPoints(), "field points need either height_mm or"),
        (lambda: FieldPoints(GRID, GRID), "field points need either height_mm or"),
        (lambda: heights(0, 2, 1), "height_mm"),
        (lambda: angles(-1, 2), "angle_deg"),
        (lambda: angles(0, 90), "angle_deg"),
        (lambda: IlluminationTable(heights(0, 9), np.array([100, 50])), "relative"),
        (lambda: IlluminationTable(heights(1, 9), np.array([1, 0.5])), "relative"),
        (lambda: IlluminationTable(heights(0, 9), np.array([1, 0.0])), "relative"),
        (lambda: IlluminationTable(heights(0, 9), np.array([1, 0.5, 0.2])), "relative"),
        (lambda: Distortion.from_percent(heights(0), [0]), "field"),
        (lambda: Distortion.from_percent(heights(0, 5, 6), [0, 0, -40]), "the distorted image folds back beyond"),
        (lambda: Distortion.from_percent(heights(0, 5), [0, math.nan]), "ratio[1]"),
        (lambda: Distortion.from_real_heights(heights(0, 5), [1, 5], 50), "real_height_mm"),
        (lambda: Distortion.polynomial(-1.0, max_field_deg=40), "the distorted image folds back at"),
        (lambda: Distortion.polynomial(math.nan), "k1"),
        (lambda: LateralColor(GRID, heights(0, 5), np.ones((3, 2))), "shift_um"),
        (lambda: LateralColor(GRID, heights(0, 5), np.full((3, 2), [0, 900.0])), "shift_um"),
        (lambda: LateralColor(GRID, heights(0, 5), np.zeros((2, 2))), "shift_um"),
        (lambda: LateralColor.from_magnification([450, 550], [1.0]), "magnification"),
        (lambda: LateralColor.from_magnification([0.45, 0.55], [1.0, 1.0]), "wavelength_nm"),
        (lambda: Distortion.from_real_heights(heights(0, 7), [0, 7000], 50), "ratio"),
        (lambda: Distortion.from_real_heights(heights(7, 14), [0.007, 0.014], 50), "ratio"),
    ],
)
def test_invalid_parts(make: Callable[[], object], what: str) -> None:
    with raises(InputError, what):
        make()
