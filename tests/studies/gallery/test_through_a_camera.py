"""What the gallery's captions say of pictures that a camera takes, against other ways to it."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Lens
from photosite.optics.veiling_glare import VeilingGlare
from photosite.scene import charts
from photosite.scene.preview import tristimulus
from photosite.studies.gallery import cube_file, depth, door, field, geometry, glare, high_range, low_light
from photosite.studies.gallery.through_a_camera import d200, exposure_for, gray_gains, shot

_LENS = DiffractionLimited(f_number=8, focal_length_mm=50)


def test_gray_is_gray_with_crosstalk_too() -> None:
    kernels = {name: door._plus(leak) for name, leak in door.LEAKS.items()}
    sensor = d200(24, 24).with_(crosstalk={"optical": kernels})
    picture = shot(charts.uniform("A", 100), Camera(_LENS, sensor), "A")
    means = picture.mean(axis=(0, 1))
    assert np.ptp(means) < 0.01
    assert gray_gains(sensor, "A") != gray_gains(d200(24, 24), "A")


def test_an_exposure_brings_the_brightest_to_its_share() -> None:
    camera = Camera(_LENS, d200(24, 24))
    even = charts.uniform("D65", 100)
    electrons = camera.mean_electrons(even, exposure_for(camera, even, 0.5))
    assert electrons.max() == pytest.approx(0.5 * camera.sensor.saturation_capacity_e, rel=1e-3)


def test_crosstalk_mixes_as_the_shares_say() -> None:
    """On an even patch: each colour keeps 1 - 4 leak, red and green pixels side by side trade the rest."""
    chart, sensor = charts.macbeth("D65", 100), d200(150, 222)
    kernels = {name: door._plus(leak) for name, leak in door.LEAKS.items()}
    plain = Camera(_LENS, sensor)
    region = next(region for region in plain.image_regions(chart) if region.name == "red")
    red, green, blue = _means(plain, region)
    leak = door.LEAKS
    mixed_red = red * (1 - 4 * leak["R"]) + 4 * leak["G"] * green
    mixed_green = green * (1 - 4 * leak["G"]) + 2 * leak["R"] * red + 2 * leak["B"] * blue
    found = door.red_over_green(Camera(_LENS, sensor.with_(crosstalk={"optical": kernels})), chart)
    # The patch's rim is taken in too, where the next pixel is darker.
    assert found == pytest.approx(mixed_red / mixed_green, rel=0.01)
    assert found < 0.8 * door.red_over_green(plain, chart)


def _means(camera: Camera, region: object) -> tuple[float, float, float]:
    from photosite.values.cfa import channel_mask

    electrons = camera.mean_electrons(charts.macbeth("D65", 100), 0.1)
    inside = (slice(region.r0, region.r1), slice(region.c0, region.c1))  # type: ignore[attr-defined]
    masks = (channel_mask(camera.sensor.array.cfa, name, electrons.shape)[inside] for name in "RGB")
    red, green, blue = (float(electrons[inside][mask].mean()) for mask in masks)
    return red, green, blue


def test_glare_takes_contrast_as_its_share_says() -> None:
    scene = glare.chart_by_a_window()
    luminance = tristimulus(scene)[..., 1]
    assert luminance.max() == pytest.approx(100 * luminance[:, :196].max(), rel=1e-3)
    assert float(luminance[:, -glare._DARK :].max()) == 0
    rows, cols = glare._SHAPE
    base = DiffractionLimited(f_number=4, focal_length_mm=50)
    sharp, veiled = (
        glare.white_over_black(
            Camera(Lens(base, veiling_glare=veil), d200(rows, round(cols * scene.shape[1] / (scene.shape[1] - 92)))),
            scene,
        )
        for veil in (None, VeilingGlare(0.01))
    )
    # Even glare adds 1 % of the mean to both patches.
    whites = float(luminance[:, :196].max())
    added = 0.01 * float(luminance.mean()) / (0.99 * whites)
    assert veiled == pytest.approx((1 + added) / (1 / sharp + added), rel=0.03)


def test_six_decades_read_light_where_they_can() -> None:
    camera = Camera(DiffractionLimited(f_number=4, focal_length_mm=50), d200(390, 502))
    scene = high_range.chart_amid_dark(camera)
    luminance = tristimulus(scene)[..., 1]
    assert luminance.max() == pytest.approx(35_000, rel=0.03)
    density = np.array([float(region.name.split()[1]) for region in scene.regions])
    assert density[[0, -1]].tolist() == [0, 6]
    read, expected = high_range.patch_levels(camera, scene, 1 / 1000)
    among = (expected > 10) & (expected < 3500)
    assert among.sum() > 10
    assert read[among] == pytest.approx(expected[among], rel=0.03)
    # Light goes with luminance, but for what diffraction brings from brighter patches.
    share = expected[among] / 10 ** -density[among]
    assert share.max() / share.min() < 1.2
    assert read[0] == 4095 - 64


def test_what_fills_the_darkest_patches_is_diffraction() -> None:
    """Airy's wings far out grow as the f-number does."""
    floors = []
    for f_number in (4.0, 8.0):
        camera = Camera(DiffractionLimited(f_number=f_number, focal_length_mm=50), d200(390, 502))
        _, expected = high_range.patch_levels(camera, high_range.chart_amid_dark(camera), 1.0)
        floors.append(float(expected[-1] / expected[0]))
    assert floors[0] > 5e-6  # five times the patch's own millionth
    assert floors[1] / floors[0] == pytest.approx(2, abs=0.3)


def test_the_barrel_and_the_colours_are_what_the_titles_say() -> None:
    lenses = geometry.lenses(1.0)
    barrel = lenses["barrel, 6 % at the corner"].mapping(1.2)
    assert barrel is not None
    assert np.interp(1e-3, barrel.ideal_m, barrel.real_m[0]) == pytest.approx(0.94e-3, rel=1e-4)
    color = lenses["lateral colour, ±0.6 %"].mapping(1.2)
    assert color is not None
    at = [np.interp(1e-3, color.ideal_m, real) for real in color.real_m]
    assert at == pytest.approx([1.006e-3, 1e-3, 0.994e-3], rel=1e-6)


def test_planes_stand_where_they_are_said_to() -> None:
    planes = depth.planes()
    assert [plane.scene.distance_m for plane in planes.planes] == [1.7, 2.0, 3.0]
    alpha = planes.planes[0].alpha
    assert alpha is not None
    assert alpha.mean() == pytest.approx(depth._SLAT / depth._PITCH, rel=0.06)
    assert planes.planes[1].scene.width_m == pytest.approx(0.6 * 300 * 6.05e-6 / (0.05 / 1.95))


def test_disc_of_a_point_out_of_focus_is_as_wide_as_the_text_says() -> None:
    focus_m, lights_m = depth._BOKEH_M
    disc_m = 0.05**2 / (4 * (focus_m - 0.05)) * (1 - focus_m / lights_m)
    assert disc_m / 6.05e-6 == pytest.approx(32, abs=0.5)


def test_a_cube_and_a_face_have_their_numbers_over_them() -> None:
    titles = [axes.get_title() or axes.get_title(loc="left") for axes in cube_file.cube_round_trip().axes]
    error = float(titles[-1].split("RMS error ")[1].split(" ")[0])
    assert 0 < error <= 0.1
    faces = [axes.get_title(loc="left") for axes in low_light.low_light().axes]
    decibels = [float(title.split(", ")[-1].split(" dB")[0]) for title in faces]
    assert decibels == sorted(decibels, reverse=True)
    assert decibels[0] - decibels[-1] > 15


def test_coma_takes_the_corner_s_spokes_and_leaves_the_middle_s() -> None:
    titles, pictures = zip(
        *((axes.get_title(loc="left"), axes.get_images()[0].get_array()) for axes in field.coma_over_the_field().axes),
        strict=True,
    )
    assert "modes, RMS error" in titles[1]
    middle, corner, comatic_middle, comatic_corner = (np.std(part) / np.mean(part) for part in pictures[2:])
    assert comatic_middle == pytest.approx(middle, rel=0.01)
    assert comatic_corner < 0.85 * corner
