"""Scene files: formats, options, and round trips through every format."""

from __future__ import annotations

import gc
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from raising import raises, warns
from scene_files import radiance

import photosite as ps
from photosite.color.spectrum import energy_from_photons, photons_from_energy
from photosite.errors import FileError, InputError
from photosite.files.writing import TemporaryFolder
from photosite.scene.io.formats import convert_scene, format_of, open_cube, read_scene, write_scene
from photosite.scene.options import ReadArguments, ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_request import Place, SceneRequest, merged_options
from photosite.scene.weights import MappedWeights
from photosite.values.region import Region

GRID = np.arange(400.0, 701, 10)

WAYS: list[tuple[str, dict[str, Any]]] = [
    ("scene.h5", {}),
    ("cube.h5", {"cube": True}),
    ("cube.hdr", {"interleave": "bsq"}),
    ("cube.hdr", {"interleave": "bil"}),
    ("cube.hdr", {"interleave": "bip"}),
    ("cube.tif", {}),
    ("scene.mat", {"version": "5"}),
    ("scene.mat", {"version": "7.3"}),
]


def some_scene(rows: int = 37, cols: int = 29, width_m: float | None = 0.4) -> Scene:
    rng = np.random.default_rng(2)
    spectra = np.exp(-(((GRID - rng.uniform(400, 700, (12, 1))) / 60) ** 2))
    fractions = rng.random((rows, cols, 12)) * 2.0 ** -np.arange(12)
    return Scene.from_radiance(
        1e15 * fractions @ spectra, GRID, tolerance=1e-6, distance_m=2.5, width_m=width_m, name="twelve lights"
    )


def small_chart() -> Scene:
    """The ColorChecker at a quarter of its samples."""
    chart = ps.charts.macbeth("A", 40, wavelength_nm=GRID)
    regions = tuple(Region(r.name, r.r0 // 4, r.r1 // 4, r.c0 // 4, r.c1 // 4) for r in chart.regions)
    return replace(chart, weights=chart.weights[:, ::4, ::4], regions=regions).with_mean_luminance(40)


def test_every_option_of_reading_has_a_type() -> None:
    assert set(ReadArguments.__annotations__) == set(ReadOptions.model_fields)


def difference(one: Scene, other: Scene) -> float:
    return float(np.sqrt(((radiance(one) - radiance(other)) ** 2).mean() / (radiance(other) ** 2).mean()))


@pytest.mark.parametrize(("name", "how"), WAYS)
def test_scene_to_file_to_scene_within_the_tolerance(tmp_path: Path, name: str, how: dict[str, Any]) -> None:
    scene = some_scene()
    write_scene(scene, tmp_path / name, **how)
    for tolerance in (1e-3, 3e-2):
        again = read_scene(tmp_path / name, tolerance=tolerance)
        assert difference(again, scene) <= tolerance
        assert again.relative_error == pytest.approx(difference(again, scene), rel=1e-3, abs=2e-6)
        assert again.wavelength_nm == pytest.approx(GRID)
        assert (again.distance_m, again.width_m) == pytest.approx((2.5, 0.4))
        if name != "scene.h5":  # which keeps the scene as it is
            assert len(again.basis) < len(scene.basis)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        {name, "cube.img"} if name.endswith("hdr") else {name}
    )


@pytest.mark.parametrize(("name", "how"), WAYS)
def test_reflectance_survives(tmp_path: Path, name: str, how: dict[str, Any]) -> None:
    chart = small_chart()
    write_scene(chart, tmp_path / name, **how)
    again = read_scene(tmp_path / name, illuminant="D65", mean_luminance_cd_m2=25, tolerance=1e-4)
    day = chart.with_illuminant("D65")  # only photosite's own format stores that it is a chart
    expected = day.with_mean_luminance(25) if again.patches else day.with_sample_luminance(25)
    assert again.patches == (name == "scene.h5" and not how)
    assert difference(again, expected) < 2e-3
    assert again.width_m is None


@pytest.mark.parametrize(("name", "how"), WAYS)
def test_negative_radiance_is_not_written(tmp_path: Path, name: str, how: dict[str, Any]) -> None:
    bad = Scene(np.array([[[1.0, -0.01]]], np.float32), np.full((1, GRID.size), 1e15), GRID)
    if name != "scene.h5" and how.get("version") != "5":  # those keep weights and basis
        with raises(InputError, "the scene"):
            write_scene(bad, tmp_path / name, **how)
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "how"), WAYS)
def test_one_sample_and_one_row(tmp_path: Path, name: str, how: dict[str, Any]) -> None:
    for shape in ((1, 1), (1, 7), (7, 1)):
        scene = some_scene(*shape)
        write_scene(scene, tmp_path / name, **how)
        assert difference(read_scene(tmp_path / name), scene) <= 1e-3


def test_a_scene_file_keeps_everything(tmp_path: Path) -> None:
    chart = ps.charts.macbeth("A", 40)
    chart.save(tmp_path / "chart.h5")
    again = read_scene(tmp_path / "chart.h5")
    for name in ("weights", "basis", "wavelength_nm", "reflectance"):
        assert np.array_equal(getattr(again, name), getattr(chart, name))
    assert (again.regions, again.name, again.distance_m) == (chart.regions, chart.name, chart.distance_m)
    assert not again.weights.flags.writeable
    moved = read_scene(tmp_path / "chart.h5", distance_m=3, width_m=0.5, mean_luminance_cd_m2=7)
    assert (moved.distance_m, moved.width_m) == (3, 0.5)
    # The luminance of a chart's file is that of its patches, as for the built-in chart, under any light.
    for light in (None, "D65"):
        again = read_scene(tmp_path / "chart.h5", mean_luminance_cd_m2=7, illuminant=light)
        np.testing.assert_allclose(again.basis, ps.charts.macbeth(light or "A", 7).basis, rtol=1e-9)
    assert moved.mean_luminance_cd_m2() == pytest.approx(7)
    star, dim = (ps.charts.siemens_star("A", luminance, rows=96, cols=96) for luminance in (40, 7))
    star.save(tmp_path / "star.h5")
    again = read_scene(tmp_path / "star.h5", mean_luminance_cd_m2=7)
    np.testing.assert_allclose(again.basis, dim.basis, rtol=1e-9)


@pytest.mark.parametrize(("name", "how"), WAYS[1:])
def test_convert_writes_the_scene_that_read_scene_makes(tmp_path: Path, name: str, how: dict[str, Any]) -> None:
    write_scene(some_scene(), tmp_path / name, **how)
    done = convert_scene(tmp_path / name, tmp_path / "out.h5", tolerance=1e-2)
    read = read_scene(tmp_path / name, tolerance=1e-2)
    kept = read_scene(tmp_path / "out.h5")
    assert np.array_equal(kept.weights, read.weights)
    assert np.array_equal(kept.basis, read.basis)
    assert done.bands == GRID.size
    assert isinstance(done.scene.weights.base, MappedWeights)  # written straight into the file
    assert (kept.relative_error, kept.name, kept.width_m) == (read.relative_error, read.name, read.width_m)
    convert_scene(tmp_path / "out.h5", tmp_path / "back.tif")
    assert (
        difference(read_scene(tmp_path / "back.tif", tolerance=1e-6), read) < 1e-2
    )  # negative radiance is written as 0


def test_convert_does_not_overwrite_its_input(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name, how in (("a.hdr", {}), ("b.hdr", {}), ("c.h5", {"cube": True}), ("d.h5", {}), ("e.tif", {})):
        write_scene(some_scene(), tmp_path / name, **how)
    (tmp_path / "b.img").rename(tmp_path / "b.dat")
    (tmp_path / "link.h5").symlink_to("c.h5")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    same = [(name, name) for name in ("a.hdr", "c.h5", "d.h5", "e.tif")]
    for source, output in [
        *same,
        ("a.img", "a.hdr"),
        ("a.img", "sub/../a.hdr"),
        ("b.dat", "b.hdr"),
        ("c.h5", "link.h5"),
    ]:
        with raises(FileError, "would overwrite the input"):
            convert_scene(tmp_path / source, tmp_path / output)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()} == before


def test_a_tolerance_without_a_reduction_is_an_error(tmp_path: Path) -> None:
    some_scene().save(tmp_path / "scene.h5")
    with raises(FileError, "holds a scene of", arguments={"tolerance": 0.2}):
        convert_scene(tmp_path / "scene.h5", tmp_path / "b.h5", tolerance=0.2)
    assert not (tmp_path / "b.h5").exists()
    assert not convert_scene(tmp_path / "scene.h5", tmp_path / "b.h5").reduced


def test_a_format_is_recognized_by_its_content(tmp_path: Path) -> None:
    scene = some_scene(3, 4)
    for name, other in (("a.h5", "a.dat"), ("a.mat", "a.h5"), ("a.tif", "a.bin")):
        write_scene(scene, tmp_path / name)
        (tmp_path / name).rename(tmp_path / other)
        assert difference(read_scene(tmp_path / other), scene) <= 1e-3


def test_open_cube_reads_block_by_block(tmp_path: Path) -> None:
    write_scene(some_scene(), tmp_path / "cube.tif")
    cube = open_cube(tmp_path / "cube.tif")
    assert (cube.shape, cube.quantity) == ((37, 29, 31), "photon radiance")
    assert [(first, block.shape) for first, block in cube.blocks(20)] == [(0, (20, 29, 31)), (20, (17, 29, 31))]
    some_scene().save(tmp_path / "scene.h5")
    with raises(FileError, "holds a scene"):
        open_cube(tmp_path / "scene.h5")


def test_files_of_no_known_format(tmp_path: Path) -> None:
    with raises(FileError, "there is no such"):
        read_scene(tmp_path / "missing.h5")
    with raises(FileError, "cannot be read"):
        read_scene(tmp_path)
    (tmp_path / "a.xyz").write_text("hello")
    with raises(FileError, "has the unknown suffix") as caught:
        format_of(tmp_path / "a.xyz")
    assert "HDF5 (.h5)" in str(caught.value.hint)
    (tmp_path / "numbers").write_bytes(bytes(64))
    with raises(FileError, "has no suffix") as caught:
        format_of(tmp_path / "numbers")
    assert "give the .hdr" in str(caught.value.hint)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("tolerance", 2),
        ("tolerance", "abc"),
        ("distance_m", -1),
        ("distance_m", "far"),
        ("distance_m", True),
        ("mean_luminance_cd_m2", 1e300),
        ("no_data", "mean"),
        ("sort_bands", "no"),
        ("patch_cols", 2.5),
        ("units", 3),
        ("wavelength_nm", "400:700:10"),
        ("wavelength_nm", []),
        ("band_range_nm", (500, 400)),
        ("method", "smooth"),
    ],
)
def test_invalid_options_of_reading(option: str, value: Any) -> None:
    with raises(InputError, option, value=value):
        read_scene("a.h5", **{option: value})


@pytest.mark.parametrize(("name", "meant"), [("unit", "units"), ("luminance", "mean_luminance_cd_m2")])
def test_unknown_options_of_reading(name: str, meant: str) -> None:
    with raises(InputError, f"reading a scene has no option '{name}'", hint=f"Did you mean '{meant}'?"):
        read_scene("a.h5", **{name: 1})


def test_options_accept_numpy_values() -> None:
    options = ReadOptions(tolerance=np.float32(0.25), patch_cols=np.int64(3), wavelength_nm=GRID[:2], sort_bands=True)
    expected = {"tolerance": 0.25, "patch_cols": 3, "wavelength_nm": (400.0, 410.0), "sort_bands": True}
    assert options.given() == expected


def test_invalid_outputs(tmp_path: Path) -> None:
    with raises(FileError, "cannot be written"):
        some_scene().save(tmp_path / "scene.png")
    with raises(InputError, "writing .hdr has no") as caught:
        write_scene(some_scene(), tmp_path / "a.hdr", interleav="bsq")
    assert caught.value.hint == "Did you mean 'interleave'?"
    with raises(FileError, "cannot be written"):
        some_scene().save(tmp_path / "no" / "scene.h5")


@pytest.mark.parametrize(("name", "how"), [*(way for way in WAYS if way != ("scene.h5", {})), ("a.exr", {})])
def test_given_units_override_the_files_with_a_warning(tmp_path: Path, name: str, how: dict[str, Any]) -> None:
    write_scene(Scene.uniform(np.full(GRID.size, 1e15), GRID), tmp_path / name, **how)
    with warns("the file states the"):
        scene = read_scene(tmp_path / name, units="uW/cm2/sr/nm")
    number = energy_from_photons(1e15, GRID) if name.endswith("exr") else 1e15
    assert scene.radiance(0, 0) == pytest.approx(photons_from_energy(np.full(GRID.size, number * 1e-2), GRID), rel=1e-3)


def test_the_files_own_units_can_be_given_too(tmp_path: Path) -> None:
    some_scene().save(tmp_path / "a.tif")
    read_scene(tmp_path / "a.tif", units="photons/(s m2 sr nm)")


NOT_APPLICABLE = [
    *[("scene.h5", {"no_data": "zero"}), ("scene.h5", {"sort_bands": True}), ("scene.h5", {"patch_cols": 3})],
    *[("cube.hdr", {"patch_cols": 3}), ("cube.hdr", {"variable": "a"}), ("a.mat", {"patch_cols": 3})],
    *[("a.csv", {"tolerance": 0.1}), ("a.csv", {"variable": "a"})],
    *[("a.png", {"tolerance": 0.1}), ("a.png", {"negative": "zero"}), ("a.png", {"band_range_nm": (400, 500)})],
]


@pytest.mark.parametrize(("name", "option"), NOT_APPLICABLE)
def test_options_that_do_not_apply_are_an_error(tmp_path: Path, name: str, option: dict[str, Any]) -> None:
    path = tmp_path / name
    light = {"illuminant": "D65", "mean_luminance_cd_m2": 40.0} if path.suffix in (".png", ".csv") else {}
    if path.suffix == ".png":
        Image.new("RGB", (4, 3), (10, 200, 30)).save(path)
    else:
        write_scene(small_chart(), path)
    read_scene(path, **light)
    for ask in (lambda: read_scene(path, **light, **option), SceneRequest(str(path), {**light, **option}).scene):
        with pytest.raises(FileError) as caught:
            ask()
        assert caught.value.arguments == option
        assert "\n" not in str(caught.value)


def test_options_given_twice_must_agree() -> None:
    grid = [500.0, 600.0]
    assert merged_options({"wavelength_nm": grid, "units": "percent"}, {"wavelength_nm": tuple(grid)})["units"]
    with raises(InputError, "mean_luminance_cd_m2", value=10):
        merged_options({"mean_luminance_cd_m2": 40.0}, {"mean_luminance_cd_m2": 10})


def test_an_error_of_a_camera_file_is_written_with_its_fields(tmp_path: Path) -> None:
    write_scene(ps.charts.macbeth("A", 40), tmp_path / "a.csv")
    place = Place(tmp_path / "camera.yaml", 3)
    with pytest.raises(FileError) as caught:
        SceneRequest(str(tmp_path / "a.csv"), {"tolerance": 0.2}, place).scene()
    assert (caught.value.path, caught.value.line) == (str(tmp_path / "camera.yaml"), 3)
    assert caught.value.where == f"scene: {tmp_path / 'a.csv'}"
    assert caught.value.hint == "Omit tolerance: 0.2"


def test_temporary_folders_are_removed_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    write_scene(some_scene(), tmp_path / "a.mat")
    made = []
    close = TemporaryFolder.close
    monkeypatch.setattr(TemporaryFolder, "close", lambda self: (made.append(self.path), close(self))[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        scene = read_scene(tmp_path / "a.mat", tolerance=1e-3)
        gc.collect()
    assert scene.shape == some_scene().shape
    assert len(made) == 1
    assert not list((tmp_path / "temporary").iterdir())


def test_a_band_range_of_photosites_own_file(tmp_path: Path) -> None:
    chart = small_chart()
    chart.save(tmp_path / "a.h5")
    part = read_scene(tmp_path / "a.h5", band_range_nm=(450, 600))
    assert part.wavelength_nm.tolist() == GRID[5:21].tolist()
    np.testing.assert_allclose(radiance(part), radiance(chart)[..., 5:21], rtol=1e-6)
    assert part.light() == pytest.approx(chart.light()[5:21])
    with pytest.raises(FileError) as caught:
        read_scene(tmp_path / "a.h5", band_range_nm=(401, 409))
    assert caught.value.path == str(tmp_path / "a.h5")
    assert "band_range_nm" in caught.value.what
    light = ps.Spectrum([450.0, 600.0], [1.0, 1.0])
    with pytest.raises(FileError) as caught:
        read_scene(tmp_path / "a.h5", illuminant=light)
    assert caught.value.arguments == {"band_range_nm": (450, 600)}
    assert read_scene(tmp_path / "a.h5", illuminant=light, band_range_nm=(450, 600)).shape == chart.shape


def test_the_error_of_a_band_range_is_not_too_small(tmp_path: Path) -> None:
    fine = some_scene()
    coarse = Scene.from_radiance(radiance(fine), GRID, tolerance=0.05)
    coarse.save(tmp_path / "a.h5")
    for band_range in ((400, 450), (500, 600), (650, 700)):
        part = read_scene(tmp_path / "a.h5", band_range_nm=band_range)
        true = radiance(fine)[..., np.isin(GRID, part.wavelength_nm)]
        error = np.sqrt(((radiance(part) - true) ** 2).mean() / (true**2).mean())
        assert error <= part.relative_error * (1 + 2 * part.relative_error)
        assert part.relative_error > coarse.relative_error / 2
