"""Mitsuba's renderings against closed forms, in W/sr/m2/nm, and invalid scenes.

Where paths are random, a mean over pixels must lie within 5 of its standard errors: with the fixed seeds of these tests
the outcome is fixed too; over seeds, one comparison in 1.7 million would fail by chance.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from raising import raises, warns

from photosite.color.illuminants import blackbody
from photosite.color.spectrum import energy_from_photons
from photosite.errors import FileError, InputError
from photosite.scene.render import EXAMPLE, example_scene, render_mitsuba
from photosite.scene.scene import Scene

mitsuba = pytest.importorskip("mitsuba")

GRID = np.arange(400.0, 701.0, 10)
FEW = np.arange(410.0, 701.0, 40)


def ramp(at_400: float, at_700: float) -> dict[str, Any]:
    return {"type": "irregular", "wavelengths": "300, 900", "values": f"{line(300, at_400, at_700)}, "
            f"{line(900, at_400, at_700)}"}  # fmt: skip


def line(wavelength_nm: Any, at_400: float, at_700: float) -> Any:
    return at_400 + (wavelength_nm - 400) / 300 * (at_700 - at_400)


def look(origin: list[float], target: list[float], up: tuple[float, ...] = (0, 1, 0)) -> Any:
    before = mitsuba.variant()
    mitsuba.set_variant("scalar_spectral")
    try:
        return mitsuba.ScalarTransform4f().look_at(origin, target, list(up))
    finally:
        if before is not None:
            mitsuba.set_variant(before)


def seen_by(fov: float = 20.0, rows: int = 12, cols: int = 16, **parts: Any) -> dict[str, Any]:
    """A scene whose camera looks from 5 down the axis at the origin."""
    film = {"type": "hdrfilm", "width": cols, "height": rows}
    camera = {"type": "perspective", "fov": fov, "to_world": look([0, 0, 5], [0, 0, 0]), "film": film}
    return {"type": "scene", "integrator": {"type": "path"}, "camera": camera, **parts}


def matt(reflectance: dict[str, Any], **shape: Any) -> dict[str, Any]:
    return {**shape, "bsdf": {"type": "diffuse", "reflectance": reflectance}}


def energy(scene: Scene) -> NDArray[np.float64]:
    """(rows, cols, bands) W/sr/m2/nm."""
    return energy_from_photons(np.tensordot(scene.weights.astype(float), scene.basis, axes=(0, 0)), scene.wavelength_nm)


def assert_mean(scene: Scene, expected: NDArray[np.float64]) -> None:
    values = energy(scene).reshape(-1, scene.wavelength_nm.size)
    error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    assert (error < 0.01 * expected).all(), "too few paths for this test"
    assert (np.abs(values.mean(axis=0) - expected) < 5 * error + 1e-6 * expected).all()


def test_radiance_of_a_sky() -> None:
    sky = seen_by(light={"type": "constant", "radiance": ramp(1.0, 3.0)})
    assert_mean(render_mitsuba(sky, spp=64, wavelength_nm=FEW), line(FEW, 1.0, 3.0))


def test_wall_under_an_even_sky() -> None:
    """Radiance = reflectance times radiance of the sky, at every wavelength."""
    scene = seen_by(
        light={"type": "constant", "radiance": ramp(2.0, 1.0)},
        wall=matt(ramp(0.2, 0.8), type="rectangle", to_world=look([0, 0, 0], [0, 0, 1])),
    )
    scene["camera"]["fov"] = 5.0
    rendered = render_mitsuba(scene, spp=64, wavelength_nm=FEW)
    assert_mean(rendered, line(FEW, 2.0, 1.0) * line(FEW, 0.2, 0.8))
    # Noise is nearly the same in all bands: one component, and one for where in its band a path's wavelength lies.
    assert len(rendered.basis) <= 2


def test_wall_under_a_disc() -> None:
    """On the axis of an even disc: irradiance pi L r^2 / (r^2 + h^2), radiance that times reflectance / pi."""
    radius, height = 0.7, 2.0
    disc = {
        "type": "disk",
        "to_world": look([0, 0, height], [0, 0, 0]) @ scaled(radius),
        "emitter": {"type": "area", "radiance": ramp(3.0, 5.0)},
        "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
    }
    scene = seen_by(fov=0.1, rows=32, cols=32, disc=disc, wall=matt(ramp(0.6, 0.3), type="rectangle"))
    scene["camera"]["to_world"] = look([0.5, 0, 1.0], [0, 0, 0])  # below the disc, which does not see it
    expected = line(FEW, 0.6, 0.3) * line(FEW, 3.0, 5.0) * radius**2 / (radius**2 + height**2)
    assert_mean(render_mitsuba(scene, spp=64, wavelength_nm=FEW), expected)


def scaled(factor: float) -> Any:
    before = mitsuba.variant()
    mitsuba.set_variant("scalar_spectral")
    try:
        return mitsuba.ScalarTransform4f().scale(float(factor))
    finally:
        if before is not None:
            mitsuba.set_variant(before)


def test_furnace() -> None:
    """Inside an even, glowing sphere of reflectance r: L / (1 - r), the sum over all bounces."""
    ball = {
        "type": "sphere",
        "radius": 10.0,
        "flip_normals": True,
        "emitter": {"type": "area", "radiance": ramp(1.0, 2.0)},
        "bsdf": {"type": "diffuse", "reflectance": ramp(0.5, 0.25)},
    }
    scene = seen_by(ball=ball, rows=40, cols=40)
    scene["integrator"] = {"type": "path", "max_depth": 25, "rr_depth": 1000}  # 0.5^25 is 3e-8
    grid = np.array([450.0, 460.0])
    expected = line(grid, 1, 2) / (1 - line(grid, 0.5, 0.25))
    assert_mean(render_mitsuba(scene, spp=8, wavelength_nm=grid), expected)


def test_blackbody_is_in_the_same_unit() -> None:
    """Mitsuba's Planck spectrum and photosite's, each band the mean over its 10 nm."""
    sky = seen_by(light={"type": "constant", "radiance": {"type": "blackbody", "temperature": 3200.0}})
    inside = (np.arange(100) + 0.5) / 10 - 5
    expected = np.array([blackbody(3200, wavelength + inside).mean() for wavelength in GRID])
    assert_mean(render_mitsuba(sky, spp=256, tolerance=1e-6), expected)


@pytest.mark.parametrize("grid", [[550.0], [450.0, 550.0], [420.0, 460.0, 500.0], np.arange(400.0, 481.0, 20)])
def test_any_number_of_bands(grid: Any) -> None:
    sky = seen_by(light={"type": "constant", "radiance": ramp(1.0, 4.0)})
    scene = render_mitsuba(sky, wavelength_nm=grid, spp=64)
    assert scene.wavelength_nm.tolist() == list(grid)
    assert_mean(scene, line(np.asarray(grid), 1.0, 4.0))


def test_a_sample_is_the_mean_over_its_own_square() -> None:
    """The edge of a bright square is between two columns: the next one is dark, whatever filter the film has."""
    half = 5 * np.tan(np.radians(10)) / 2  # a quarter of the columns on each side
    lamp = {"type": "rectangle", "to_world": scaled(half), "emitter": {"type": "area", "radiance": ramp(1, 1)}}
    scene = seen_by(rows=16, cols=16, lamp=lamp)
    scene["camera"]["film"]["rfilter"] = {"type": "gaussian", "stddev": 1.0}
    values = energy(render_mitsuba(scene, spp=16, wavelength_nm=[500, 510]))[..., 0]
    expected = np.zeros((16, 16))
    expected[4:12, 4:12] = 1
    assert_allclose(values, expected, atol=0.03)
    assert (values[expected == 0] == 0).all()


def test_geometry_is_the_cameras() -> None:
    scene = seen_by(fov=30, light={"type": "constant"}, wall=matt(ramp(0.5, 0.5), type="rectangle", to_world=scaled(9)))
    scene["light"]["radiance"] = ramp(1, 1)
    seen = render_mitsuba(scene, spp=1, wavelength_nm=[500], unit_m=0.1)
    assert seen.distance_m == pytest.approx(0.5, rel=1e-5)
    assert seen.width_m == pytest.approx(2 * 0.5 * np.tan(np.radians(15)), rel=1e-5)
    nearer = render_mitsuba(scene, spp=1, wavelength_nm=[500], distance_m=2, rows=3, cols=4)
    assert (nearer.distance_m, nearer.shape) == (2, (3, 4))
    assert nearer.width_m == pytest.approx(4 * np.tan(np.radians(15)), rel=1e-5)
    scene["camera"] |= {"type": "thinlens", "aperture_radius": 0.01, "focus_distance": 3.5}
    assert render_mitsuba(scene, spp=1, wavelength_nm=[500]).distance_m == pytest.approx(3.5)
    scene["camera"]["film"] |= {"crop_offset_x": 4, "crop_width": 8, "crop_offset_y": 0, "crop_height": 12}
    cropped = render_mitsuba(scene, spp=1, wavelength_nm=[500])
    assert cropped.shape == (12, 8)
    assert cropped.width_m == pytest.approx(3.5 * np.tan(np.radians(15)), rel=1e-5)


def test_without_an_object_in_the_center_the_distance_is_the_default() -> None:
    sky = seen_by(light={"type": "constant", "radiance": ramp(1, 1)})
    scene = render_mitsuba(sky, spp=1, wavelength_nm=[500])
    assert (scene.distance_m, scene.width_m) == (1.2, None)


def test_seed_and_variant() -> None:
    scene = seen_by(light={"type": "constant", "radiance": ramp(1, 1)}, ball=matt(ramp(0.5, 0.5), type="sphere"))
    mitsuba.set_variant("scalar_rgb")
    first, again, other = (
        energy(render_mitsuba(scene, spp=2, wavelength_nm=[500, 520], seed=seed)) for seed in (1, 1, 2)
    )
    assert mitsuba.variant() == "scalar_rgb"
    assert (first == again).all()
    assert (first != other).any()


@pytest.mark.parametrize("light", [{"type": "rgb", "value": [1.0, 0.5, 1.0]}, {"type": "d65"}, 1.0])
def test_lights_without_an_absolute_scale_give_a_warning(light: Any) -> None:
    scene = seen_by(light={"type": "constant", "radiance": light})
    with warns("light of", arguments={"mean_luminance_cd_m2": 100}, where="rendering"):
        render_mitsuba(scene, spp=1, wavelength_nm=[500])
    bright = render_mitsuba(scene, spp=4, mean_luminance_cd_m2=50, wavelength_nm=FEW)
    assert bright.mean_luminance_cd_m2() == pytest.approx(50, rel=1e-6)


def test_example_scene() -> None:
    calls: list[int] = []
    scene = example_scene(rows=16, cols=24, spp=4, progress=lambda done, total, unit: calls.append(done))
    assert calls == [4, 8, 12, 16, 20, 24, 28, 31]
    assert scene.shape == (16, 24)
    assert scene.name == "still_life"
    # The soft box: 0.5 m square, 3200 K, some 9000 cd/m2, 1.3 m away.
    assert 80 < scene.mean_luminance_cd_m2() < 140
    assert scene.distance_m == pytest.approx(1.305, abs=0.02)
    assert scene.width_m == pytest.approx(2 * scene.distance_m * np.tan(np.radians(14)), rel=1e-6)


def test_scene_file_and_its_parameters() -> None:
    scene = render_mitsuba(str(EXAMPLE), spp=1, wavelength_nm=[500], parameters={"rows": 5, "cols": 7})
    assert scene.shape == (5, 7)
    with raises(FileError, "Mitsuba rejects the scene"):
        render_mitsuba(str(EXAMPLE), spp=1, wavelength_nm=[500], parameters={"colums": 7})


SKY = '<emitter type="constant"/>'
CAMERA = '<sensor type="perspective"><film type="hdrfilm"><integer name="%s" value="4"/></film></sensor>'
WALL = '<shape type="rectangle"><bsdf type="diffuse"><spectrum name="%s" value="0.5"/></bsdf></shape>'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("not xml", "Mitsuba rejects the scene: .*Parsing"),
        ('<scene version="3.0.0"><shape type="cubus"/></scene>', "cubus"),
        (f'<scene version="3.0.0">{SKY}</scene>', "has no camera"),
        (f'<scene version="3.0.0">{CAMERA % "width"}</scene>', "has no light"),
        (
            f'<scene version="3.0.0">{SKY}{CAMERA % "widht"}</scene>',
            "film has no property 'widht'.*Did you mean 'width'",
        ),
        (f'<scene version="3.0.0">{SKY}{CAMERA % "width"}{WALL % "reflectence"}</scene>', "reflectence"),
        ('<scene version="3.0.0"><shape type="ply"><string name="filename" value="no.ply"/></shape></scene>', "no.ply"),
    ],
)
def test_invalid_scene_files(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "a.xml"
    file.write_text(content)
    with pytest.raises((FileError, InputError), match=message) as error:
        render_mitsuba(file)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"spp": 0}, "spp"),
        ({"rows": -1}, "rows"),
        ({"unit_m": 0.0}, "unit_m"),
        ({"seed": -1}, "seed"),
        ({"variant": "scalar_rgb"}, "variant"),
        ({"wavelength_nm": [400, 410, 430]}, "wavelength_nm"),
        ({"wavelength_nm": [410, 400]}, "wavelength_nm"),
        ({"sensor": 1}, "sensor"),
        ({"parameters": {"rows": 3}}, "parameters apply to scene files"),
        ({"tolerance": 2.0}, "tolerance"),
    ],
)
def test_invalid_arguments(wrong: dict[str, Any], field: str) -> None:
    sky = seen_by(light={"type": "constant", "radiance": ramp(1, 1)})
    with raises(InputError, field):
        render_mitsuba(sky, **wrong)


def test_missing_file_and_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with raises(FileError, "cannot be read"):
        render_mitsuba(tmp_path / "none.xml")
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with raises(InputError, "the extra"):
        example_scene()
