"""Scenes: radiance, luminance, light, and invalid values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import InputError
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.values.region import Region

GRID = np.arange(400.0, 701.0, 10)


def cube(rows: int = 12, cols: int = 17, colors: int = 4, seed: int = 3) -> np.ndarray:
    """A radiance cube of `colors` spectra in equal measure."""
    rng = np.random.default_rng(seed)
    return 1e14 * rng.random((rows, cols, colors)) @ rng.random((colors, GRID.size))


def test_from_radiance_keeps_every_sample_within_the_tolerance() -> None:
    radiance = cube()
    for tolerance in (0.2, 1e-2, 1e-6):
        scene = Scene.from_radiance(radiance, GRID, tolerance=tolerance)
        again = np.einsum("kij,kl->ijl", scene.weights, scene.basis)
        rms = np.sqrt(((again - radiance) ** 2).mean() / (radiance**2).mean())
        assert rms <= tolerance + 1e-7  # float32 weights
        assert len(scene.basis) <= 4
    assert len(Scene.from_radiance(radiance, GRID, tolerance=0.2).basis) < 4


def test_from_radiance_of_zeros_is_dark() -> None:
    assert not Scene.from_radiance(np.zeros((3, 4, GRID.size)), GRID).weights.any()


def test_from_radiance_takes_any_memory_order() -> None:
    radiance = cube()
    plain = Scene.from_radiance(radiance, GRID, tolerance=1e-6)
    other = Scene.from_radiance(np.asfortranarray(radiance), GRID, tolerance=1e-6)
    assert plain.radiance(3, 5) == pytest.approx(other.radiance(3, 5), rel=1e-6)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_invalid_radiance(bad: float) -> None:
    radiance = cube()
    radiance[2, 3, 4] = bad
    with raises(InputError, "photon_radiance"):
        Scene.from_radiance(radiance, GRID)


def test_shapes_that_do_not_fit() -> None:
    with raises(InputError, "weights"):
        Scene(np.ones((2, 3, 4)), np.ones((3, 31)), GRID)
    with pytest.raises(InputError) as caught:
        Scene.uniform(np.ones((2, 31)), GRID)
    assert (caught.value.what, caught.value.value) == ("photon_radiance", (2, 31))
    for name in ("distance_m", "width_m"):
        with raises(InputError, name, value=0.0):
            Scene(np.ones((1, 2, 2)), np.ones((1, 31)), GRID, **{name: 0.0})  # type: ignore[arg-type]


def test_mean_luminance_scales_radiance() -> None:
    scene = Scene.from_radiance(cube(), GRID)
    brighter = scene.with_mean_luminance(3 * scene.mean_luminance_cd_m2())
    assert brighter.radiance(1, 1) == pytest.approx(3 * scene.radiance(1, 1), rel=1e-6)
    with raises(InputError, "a dark scene cannot"):
        scene.scaled(0.0).with_mean_luminance(10)


def test_light_outside_is_the_share_of_the_response_outside_the_grid() -> None:
    scene = Scene.uniform(np.ones(GRID.size), GRID)
    assert scene.light_outside([400, 700], [1, 1]) == 0.0
    assert scene.light_outside(np.arange(380.0, 781.0, 10), np.ones(41)) == pytest.approx(100 / 400, rel=1e-9)
    assert scene.light_outside([300, 900], [1, 1]) == pytest.approx(300 / 600, rel=1e-9)
    assert scene.light_outside([710, 720], [1, 1]) == 1.0
    assert scene.light_outside([550], [1]) == 0.0


def reflecting(seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Weights (3, rows, cols) and reflectances (3, wavelengths)."""
    rng = np.random.default_rng(seed)
    return rng.random((3, 6, 7)).astype(np.float32), rng.random((3, GRID.size))


def lit(illuminant: str) -> np.ndarray:
    return 1e-3 * photons_from_energy(relative_energy(illuminant, GRID), GRID)


def test_another_light_on_known_reflectance_is_that_reflectance_under_it() -> None:
    weights, reflectance = reflecting()
    scene = Scene(weights, reflectance * lit("A"), GRID, reflectance=reflectance)
    day = scene.with_illuminant("D65", 12.0)
    direct = Scene(weights, reflectance * lit("D65"), GRID).with_mean_luminance(12.0)
    np.testing.assert_allclose(day.basis, direct.basis, rtol=1e-12)
    assert day.mean_luminance_cd_m2() == pytest.approx(12.0, rel=1e-12)
    kept = scene.with_illuminant("D65")
    assert kept.mean_luminance_cd_m2() == pytest.approx(scene.mean_luminance_cd_m2(), rel=1e-12)
    back = day.with_illuminant("A", scene.mean_luminance_cd_m2())
    np.testing.assert_allclose(back.basis, scene.basis, rtol=1e-12)


def test_another_light_changes_the_name() -> None:
    for chart in (charts.macbeth("D65"), charts.slanted_edge("D65", rows=20, cols=30)):
        assert chart.name.endswith(", illuminant D65")
        even = Spectrum(np.array([300.0, 900.0]), np.ones(2))
        for light, title in (("A", "A"), (3200, "3200 K"), (even, "as given")):
            relit = chart.with_illuminant(light)
            assert relit.name == chart.name.removesuffix("D65") + title
            assert relit.with_illuminant("D65").name == chart.name
    bare = Scene(*reflecting(), GRID, name="illuminant D65, a picture of it", reflectance=reflecting()[1])
    assert bare.with_illuminant("A").name == "illuminant D65, a picture of it"


def test_the_luminance_of_a_chart_is_the_mean_of_its_patches() -> None:
    for chart in (charts.macbeth("A", 30), charts.hdr_patches("A", 30), charts.color_checker_sg("A", 30)):
        assert chart.mean_luminance_cd_m2() == pytest.approx(30, rel=2e-6)
        assert chart.sample_luminance_cd_m2() < 27
        day = chart.with_illuminant("D65").with_mean_luminance(7)
        assert day.mean_luminance_cd_m2() == pytest.approx(7, rel=1e-9)
    chart = charts.macbeth.chart()
    for scene in (chart.under("D65", 40), chart.under("A", 7).with_illuminant("D65", 40)):
        assert scene.mean_luminance_cd_m2() == pytest.approx(40, rel=1e-6)
        assert scene.sample_luminance_cd_m2() == pytest.approx(40 / 1.375, rel=1e-6)
    star = charts.siemens_star("A", 30, rows=96, cols=96)
    assert star.regions
    assert star.mean_luminance_cd_m2() == star.sample_luminance_cd_m2() == pytest.approx(30, rel=1e-6)
    with raises(InputError, "a dark scene"):
        charts.macbeth("A", 0).with_mean_luminance(7)
    with raises(InputError, "regions"):
        Scene(np.ones((1, 4, 4)), np.ones((1, 2)), [500, 600], regions=(Region("p", 0, 5, 0, 4),), patches=True)


def test_the_light_of_a_scene_scales_with_its_luminance() -> None:
    weights, reflectance = reflecting()
    scene = Scene(weights, reflectance * lit("A"), GRID, reflectance=reflectance)
    np.testing.assert_allclose(scene.light(), lit("A"), rtol=1e-12)
    twice = scene.with_mean_luminance(2 * scene.mean_luminance_cd_m2())
    np.testing.assert_allclose(twice.light(), 2 * lit("A"), rtol=1e-12)
    assert twice.reflectance is not None
    assert (twice.reflectance == reflectance).all()


def test_light_that_nothing_reflects_is_unknown() -> None:
    weights, reflectance = reflecting()
    reflectance[:, 4] = 0.0
    light = Scene(weights, reflectance * lit("A"), GRID, reflectance=reflectance).light()
    assert light[4] == 0.0
    assert light[5] == pytest.approx(lit("A")[5])


def test_light_cannot_be_changed_where_reflectance_is_unknown() -> None:
    scene = Scene.from_radiance(cube(), GRID, name="a street")
    for ask in (lambda: scene.with_illuminant("D65"), scene.light):
        with raises(InputError, "the light of"):
            ask()


def test_invalid_reflectance() -> None:
    weights, reflectance = reflecting()
    for wrong in (reflectance[:2], reflectance * np.nan):
        with raises(InputError, "reflectance", value=wrong.shape):
            Scene(weights, reflectance * lit("A"), GRID, reflectance=wrong)
    two_lights = np.stack([reflectance[0] * lit("A"), reflectance[1] * lit("D65"), reflectance[2] * lit("A")])
    with raises(InputError, "basis and reflectance differ"):
        Scene(weights, two_lights, GRID, reflectance=reflectance)


def test_weights_on_disk_are_not_copied(tmp_path: Path) -> None:
    stored = np.lib.format.open_memmap(tmp_path / "weights.npy", mode="w+", dtype=np.float32, shape=(2, 30, 40))
    stored[:] = 0.5
    scene = Scene(np.load(tmp_path / "weights.npy", mmap_mode="r"), np.ones((2, GRID.size)), GRID)
    assert not scene.weights.flags.owndata
    assert not scene.weights.flags.writeable
    stored[1, 3, 4] = np.nan
    stored.flush()
    with raises(InputError, "weights and basis must"):
        Scene(np.load(tmp_path / "weights.npy", mmap_mode="r"), np.ones((2, GRID.size)), GRID)
