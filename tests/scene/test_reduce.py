"""The reduction of cubes: compared with a full singular value decomposition, in blocks of any size; invalid values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from raising import raises
from scene_files import radiance

import photosite.scene.weights as weights_module
from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import FileError, InputError
from photosite.scene.cube import ArrayCube, Block, SpectralCube
from photosite.scene.options import ReadOptions
from photosite.scene.scene_cube import reduce_cube
from photosite.scene.weights import MappedWeights

GRID = np.arange(400.0, 701, 10)
RNG = np.random.default_rng(8)


def values(rows: int = 23, cols: int = 17, materials: int = 9) -> np.ndarray:
    """(rows, cols, bands): materials of decreasing weight, so that the tolerance decides how many are kept."""
    spectra = RNG.random((materials, GRID.size)) * 10.0 ** -np.arange(materials)[:, None]
    return RNG.random((rows, cols, materials)) @ spectra


def cube_of(array: np.ndarray, quantity: str = "photon radiance", **more: object) -> ArrayCube:
    given = {"name": "cube", "wavelength_nm": GRID, "values": array, "quantity": quantity} | more
    return ArrayCube(shape=array.shape, **given)  # type: ignore[arg-type]


def rms(array: np.ndarray) -> float:
    return float(np.sqrt((array**2).mean()))


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-3, 1e-5])
def test_fewest_spectra_keep_the_tolerance_and_the_error_is_measured(tolerance: float) -> None:
    array = values()
    scene = reduce_cube(cube_of(array), ReadOptions(tolerance=tolerance)).scene
    singular = np.linalg.svd(array.reshape(-1, GRID.size), compute_uv=False)
    left_over = np.sqrt((singular[::-1] ** 2).cumsum()[::-1] / (singular**2).sum())
    assert len(scene.basis) == int((left_over > tolerance).sum())
    error = rms(radiance(scene) - array) / rms(array)
    assert scene.relative_error == pytest.approx(error, rel=1e-3)
    assert error == pytest.approx(left_over[len(scene.basis)], rel=1e-2, abs=1e-7)  # Eckart and Young; float32 weights


@pytest.mark.parametrize("block_bytes", [1, 17 * GRID.size * 8 * 5, 1 << 30])
def test_blocks_of_any_size_make_the_same_scene(monkeypatch: pytest.MonkeyPatch, block_bytes: int) -> None:
    array = values()
    whole = radiance(reduce_cube(cube_of(array)).scene)
    monkeypatch.setattr(weights_module, "_BLOCK_BYTES", block_bytes)
    np.testing.assert_allclose(radiance(reduce_cube(cube_of(array)).scene), whole, rtol=1e-5)


def test_large_weights_are_stored_in_a_file_and_mapped(monkeypatch: pytest.MonkeyPatch) -> None:
    array = values()
    in_memory = reduce_cube(cube_of(array)).scene
    monkeypatch.setattr(weights_module, "_LARGE_BYTES", 100)
    monkeypatch.setattr(weights_module, "_BLOCK_BYTES", 17 * GRID.size * 8 * 4)
    mapped = reduce_cube(cube_of(array)).scene
    assert isinstance(mapped.weights.base, MappedWeights)
    np.testing.assert_allclose(mapped.weights, in_memory.weights, rtol=1e-6, atol=1e-12)
    monkeypatch.setattr(weights_module.shutil, "disk_usage", lambda _: type("Usage", (), {"free": 10})())
    with raises(ValueError, "the scene"):
        reduce_cube(cube_of(array))


def test_energy_becomes_photons() -> None:
    array = values()
    scene = reduce_cube(cube_of(array, "energy radiance"), ReadOptions(tolerance=1e-6)).scene
    wanted = photons_from_energy(array, GRID)
    assert rms(radiance(scene) - wanted) <= 1.1e-6 * rms(wanted)


def test_relative_values_need_a_luminance() -> None:
    with raises(FileError, "holds relative values", arguments={"mean_luminance_cd_m2": 100}) as caught:
        reduce_cube(cube_of(values(), "relative"))
    assert list(caught.value.arguments) == ["mean_luminance_cd_m2"]
    array = values()
    scene = reduce_cube(cube_of(array, "relative"), ReadOptions(tolerance=1e-6, mean_luminance_cd_m2=55)).scene
    assert scene.mean_luminance_cd_m2() == pytest.approx(55, rel=1e-6)
    wanted = photons_from_energy(array, GRID)
    wanted *= 55 / luminance_cd_m2(wanted, GRID).mean()
    assert rms(radiance(scene) - wanted) <= 1.1e-6 * rms(wanted)


def test_reflectances_stay_exact_under_any_light() -> None:
    array = values() / 10
    with raises(FileError, "holds reflectances") as caught:
        reduce_cube(cube_of(array, "reflectance"))
    assert list(caught.value.arguments) == ["illuminant", "mean_luminance_cd_m2"]
    with raises(FileError, "holds reflectances", arguments={"mean_luminance_cd_m2": 100}) as caught:
        reduce_cube(cube_of(array, "reflectance"), ReadOptions(illuminant="A"))
    assert list(caught.value.arguments) == ["mean_luminance_cd_m2"]
    options = ReadOptions(illuminant="A", mean_luminance_cd_m2=40, tolerance=1e-3)
    scene = reduce_cube(cube_of(array, "reflectance"), options).scene
    assert scene.reflectance is not None
    again = np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), scene.reflectance)
    assert rms(again - array) <= 1e-3 * rms(array)
    for light in ("A", "D65"):
        lit = scene.with_illuminant(light, 40)
        wanted = array * photons_from_energy(illuminant(light, GRID), GRID)
        wanted *= 40 / luminance_cd_m2(wanted, GRID).mean()
        assert rms(radiance(lit) - wanted) <= 2e-3 * rms(wanted)
        if light == "A":
            assert rms(radiance(scene) - wanted) <= 1.01e-3 * rms(wanted)


def test_a_radiance_under_a_known_light_can_be_relit() -> None:
    array = values() / 10
    light = photons_from_energy(illuminant("A", GRID), GRID) * 1e-3
    cube = cube_of(array * light, light=light)
    scene = reduce_cube(cube, ReadOptions(illuminant="D65", mean_luminance_cd_m2=40, tolerance=1e-4)).scene
    wanted = array * photons_from_energy(illuminant("D65", GRID), GRID)
    wanted *= 40 / luminance_cd_m2(wanted, GRID).mean()
    assert rms(radiance(scene) - wanted) <= 1e-3 * rms(wanted)
    with raises(FileError, "holds radiance under an", arguments={"illuminant": "D65", "units": "reflectance"}):
        reduce_cube(cube_of(array), ReadOptions(illuminant="D65"))


def test_bands_are_sorted_where_wanted() -> None:
    array, order = values(), RNG.permutation(GRID.size)
    mixed = cube_of(array[:, :, order], wavelength_nm=GRID[order])
    with raises(FileError, "its wavelengths are not", arguments={"sort_bands": True}):
        reduce_cube(mixed)
    scene = reduce_cube(mixed, ReadOptions(sort_bands=True, tolerance=1e-5)).scene
    assert scene.wavelength_nm.tolist() == GRID.tolist()
    assert rms(radiance(scene) - array) <= 1.01e-5 * rms(array)
    assert scene.relative_error <= 1.01e-5


def test_the_error_of_mixed_bands_of_energy_is_that_of_photons() -> None:
    array, order = values(), RNG.permutation(GRID.size)
    mixed = cube_of(array[:, :, order], "energy radiance", wavelength_nm=GRID[order])
    scene = reduce_cube(mixed, ReadOptions(sort_bands=True, tolerance=0.02)).scene
    wanted = photons_from_energy(array, GRID)
    assert scene.relative_error == pytest.approx(rms(radiance(scene) - wanted) / rms(wanted), rel=1e-3)
    assert scene.relative_error > 1e-3


def test_reflectances_keep_the_tolerance_under_their_light_too() -> None:
    """A weak paint reflects only where the light is strong and the other paint is dark."""
    blue, red = (GRID < 450).astype(float), (GRID > 650).astype(float)
    fraction = RNG.random((2, 30, 20, 1))
    array = fraction[0] * blue + 1e-3 * fraction[1] * red
    lines = Spectrum(GRID, np.where(blue > 0, 1e-3, 1.0))
    scene = reduce_cube(
        cube_of(array, "reflectance"), ReadOptions(illuminant=lines, mean_luminance_cd_m2=10, tolerance=0.01)
    ).scene
    wanted = array * photons_from_energy(lines.values, GRID)
    wanted *= 10 / luminance_cd_m2(wanted, GRID).mean()
    assert rms(radiance(scene) - wanted) <= 0.01 * rms(wanted)
    assert len(scene.basis) == 2


@pytest.mark.parametrize("bad", [np.nan, -0.5])
def test_missing_and_negative_values_are_an_error_or_replaced_by_0(bad: float) -> None:
    array = values()
    array[5, 3, 7] = bad
    option = "no_data" if np.isnan(bad) else "negative"
    with pytest.raises(FileError) as caught:
        reduce_cube(cube_of(array))
    assert caught.value.arguments == {option: "zero"}
    assert "row 5, column 3, band 8" in caught.value.what
    done = reduce_cube(cube_of(array), ReadOptions(tolerance=1e-5, **{option: "zero"}))
    assert (done.no_data_values, done.negative_values) == ((1, 0) if np.isnan(bad) else (0, 1))
    array[5, 3, 7] = 0.0
    assert rms(radiance(done.scene) - array) <= 1.01e-5 * rms(array)


def test_infinite_values_are_always_an_error() -> None:
    array = values()
    array[0, 0, 0] = np.inf
    for no_data in ("refuse", "zero"):
        with raises(FileError, "has an infinite value") as caught:
            reduce_cube(cube_of(array), ReadOptions(no_data=no_data))  # type: ignore[arg-type]
        assert not caught.value.arguments


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e99, 1e200, 1.7e308])
@pytest.mark.parametrize("quantity", ["photon radiance", "energy radiance"])
def test_values_too_large_to_be_squared_or_summed(size: float, quantity: str) -> None:
    with raises(FileError, "holds values far above"):
        reduce_cube(cube_of(np.full((20, 30, GRID.size), size), quantity))


def test_a_dark_cube_is_dark() -> None:
    scene = reduce_cube(cube_of(np.zeros((4, 5, GRID.size)))).scene
    assert not scene.weights.any()
    assert scene.relative_error == 0.0
    with raises(FileError, "is dark", arguments={"mean_luminance_cd_m2": 3.0}):
        reduce_cube(cube_of(np.zeros((4, 5, GRID.size))), ReadOptions(mean_luminance_cd_m2=3))


@dataclass(frozen=True, eq=False, kw_only=True)
class FailingCube(SpectralCube):
    """A cube on a disk that fails."""

    def blocks(self, rows: int) -> Iterator[Block]:
        raise OSError(5, "Input/output error")
        yield


def test_a_disk_that_fails_is_an_error() -> None:
    cube = FailingCube(name="cube.hdr", shape=(2, 2, GRID.size), wavelength_nm=GRID, quantity="photon radiance")
    with raises(FileError, "cannot be read"):
        reduce_cube(cube)


def test_progress_counts_both_passes() -> None:
    calls: list[tuple[int, int]] = []
    reduce_cube(cube_of(values()), progress=lambda done, total, unit: calls.append((done, total)))
    assert calls[-1] == (46, 46)


def test_small_differences_survive_double_precision() -> None:
    """A spectrum some 3e-6 as strong as another is kept by a tolerance of 1e-6: float32 sums would have lost it."""
    strong, weak = RNG.random(GRID.size), RNG.random(GRID.size)
    fraction = RNG.random((300, 40, 1))
    array = 1e3 + fraction * strong + 3e-2 * RNG.random((300, 40, 1)) * weak
    scene = reduce_cube(cube_of(array), ReadOptions(tolerance=1e-6)).scene
    assert len(scene.basis) == 3
    assert replace(scene).relative_error < 1e-7  # what float32 weights leave


@pytest.mark.parametrize("tolerance", [1e-9, 9e-7])
def test_tolerances_below_single_precision_are_an_error(tolerance: float) -> None:
    with raises(InputError, "tolerance", value=tolerance):
        ReadOptions(tolerance=tolerance)
