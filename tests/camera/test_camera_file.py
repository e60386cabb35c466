"""Camera files: fields, defaults, and errors with the line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from raising import raises

import photosite as ps
from photosite.camera.file import SetUp, load_camera
from photosite.errors import FileError, InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.lights import mixed
from photosite.scene.scene_request import BUILT_IN_SCENES, SceneRequest


def written(folder: Path, text: str) -> Path:
    file = folder / "mine.camera.yaml"
    file.write_text("photosite_camera: 1\n" + text)
    return file


def test_empty_file_is_the_set_up_of_the_paper(tmp_path: Path) -> None:
    set_up, paper = load_camera(written(tmp_path, "")), SetUp()
    assert (set_up.sensor, set_up.optics, set_up.exposure_s) == (paper.sensor, paper.optics, 1 / 3)
    assert set_up.optics == DiffractionLimited(8, 50)
    np.testing.assert_array_equal(set_up.scene.scene().basis, ps.charts.macbeth("A", 40).basis)


def test_every_field(tmp_path: Path) -> None:
    ps.load_sensor("vendor-2.2um").with_(rows=40, cols=60).save(tmp_path / "chip.sensor.yaml")
    file = written(
        tmp_path,
        """name: phone
sensor: chip.sensor.yaml
optics: {f_number: 2.8, focal_length_mm: 4.88, transmittance: 0.9}
scene:
  source: slanted-edge
  illuminant: D65
  luminance_cd_m2: 100
  distance_m: 0.5
  width_m: 0.3
  options: {contrast: 10, rows: 80, cols: 120}
exposure: 1/50
integration: rectangle
cells_per_pixel: 3
""",
    )
    set_up = load_camera(file)
    others = set_up.name, set_up.exposure_s, set_up.integration, set_up.cells_per_pixel
    assert others == ("phone", 1 / 50, "rectangle", 3)
    assert (set_up.sensor.array.rows, set_up.sensor.name) == (40, ps.load_sensor("vendor-2.2um").name)
    assert set_up.optics == DiffractionLimited(2.8, 4.88, 0.9)
    scene = set_up.scene.scene()
    assert (scene.shape, scene.distance_m, scene.width_m) == ((80, 120), 0.5, 0.3)
    assert scene.mean_luminance_cd_m2() == pytest.approx(100)
    expected = ps.charts.slanted_edge("D65", 100, contrast=10, rows=80, cols=120, distance_m=0.5, width_m=0.3)
    np.testing.assert_array_equal(
        set_up.camera.mean_electrons(scene, set_up.exposure_s),
        ps.Camera(set_up.optics, set_up.sensor, "rectangle", 3).mean_electrons(expected, 1 / 50),
    )


def test_file_names_are_relative_to_the_camera_file(tmp_path: Path) -> None:
    ps.load_sensor("nikon-d200").with_(rows=10, cols=12).save(tmp_path / "chip.sensor.yaml")
    scene = ps.charts.uniform("A", 7)
    scene.save(tmp_path / "field.h5")
    set_up = load_camera(written(tmp_path, "sensor: chip.sensor.yaml\nscene: field.h5\n"))
    assert set_up.sensor.array.rows == 10
    assert set_up.scene.scene().mean_luminance_cd_m2() == pytest.approx(7, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensr: nikon-d200\n", "mine.camera.yaml:2: "),
        ("sensor: nikon-d20\n", "mine.camera.yaml:2: "),
        ("sensor: none.sensor.yaml\n", "mine.camera.yaml:2: sensor: "),
        ("exposure: soon\n", "mine.camera.yaml:2: exposure: "),
        ("integration: simpson\n", "mine.camera.yaml:2: integration "),
        ("cells_per_pixel: 2\n", "mine.camera.yaml:2: cells_per_pixel "),
        ("optics: 8\n", "mine.camera.yaml:2: optics "),
        ("optics: {f_number: 8}\n", "focal_length_mm"),
        ("optics: gone.yaml\n", "mine.camera.yaml:2: optics: "),
    ],
)
def test_errors_name_the_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError) as caught:
        load_camera(written(tmp_path, text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "field"),
    [
        ("scene: [1]\n", 2, "scene"),
        ("scene: []\n", 2, "scene"),
        ("scene:\n  source: macbth\n", 3, "source"),
        ("scene:\n  source: uniform\n  illuminant: lamp.csv\n", 4, None),
        ("scene:\n  luminance_cd_m2: -3\n", 3, "luminance_cd_m2"),
        ("scene:\n  luminance_cd_m2: .inf\n", 3, "luminance_cd_m2"),
        ("scene:\n  distance_m: .inf\n", 3, "distance_m"),
        ("scene:\n  wavelength_nm: [500, 400]\n", 3, "wavelength_nm"),
        ("scene:\n  wavelength_nm: []\n", 3, "wavelength_nm"),
        ("scene:\n  wavelength_nm: 400\n", 3, "wavelength_nm"),
        ("scene:\n  illuminant: D66\n", 3, "illuminant"),
        ("scene:\n  illuminant: yes\n", 3, "illuminant"),
        ("scene:\n  illuminant: -5\n", 3, None),
        ("scene:\n  tolerance: 0.1\n", 3, None),
        ("scene:\n  units: W\n", 3, None),
        ("scene:\n  source: siemens-star\n  options:\n    patches: no\n", 5, "patches"),
        ("scene:\n  source: slanted-edge\n  options: {contras: 3}\n", 4, None),
        ("scene:\n  source: slanted-edge\n  width_m: 1\n  options: {width_m: 3}\n", 5, "width_m"),
        ("scene:\n  source: field.h5\n  tolerance: 3\n", 4, "tolerance"),
        ("scene:\n  source: field.h5\n  options: {foo: 1}\n", 4, None),
        ("scene:\n  source: field.h5\n  options: {method: smooth}\n", 4, "method"),
        ("scene:\n  source: field.h5\n  options: {sort_bands: no}\n", 4, "sort_bands"),
        ("scene:\n  - {source: uniform, alpha: no.png}\n", 3, "alpha"),
    ],
)
def test_errors_of_the_scene_name_line_and_field(tmp_path: Path, text: str, line: int, field: str | None) -> None:
    ps.charts.uniform("A", 7).save(tmp_path / "field.h5")
    with pytest.raises(FileError) as caught:
        load_camera(written(tmp_path, text))
    assert (caught.value.path, caught.value.line) == (str(tmp_path / "mine.camera.yaml"), line)
    if field is not None:
        assert caught.value.what == field
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("sensr: nikon-d200\n", "sensor"),
        ("scene:\n  sorce: macbeth\n", "source"),
        ("scene:\n  source: slanted-edg\n", "slanted-edge"),
        ("scene:\n  source: slanted-edge\n  options: {contras: 3}\n", "contrast"),
        ("scene:\n  - {source: uniform, alfa: no.png}\n", "alpha"),
    ],
)
def test_misspelled_names_get_the_similar_one(tmp_path: Path, text: str, meant: str) -> None:
    with pytest.raises(FileError, match=f"Did you mean '{meant}'"):
        load_camera(written(tmp_path, text))


def test_method_for_pictures_is_an_option(tmp_path: Path) -> None:
    codes = np.random.default_rng(1).integers(30, 220, (4, 6, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    text = "scene: {source: a.png, luminance_cd_m2: 40, options: {method: jakob-hanika}}\n"
    set_up = load_camera(written(tmp_path, text)).scene.scene()
    np.testing.assert_array_equal(set_up.weights, ps.pictures.from_rgb(codes, method="jakob-hanika").weights)


def test_errors_of_the_scene_itself_name_the_line(tmp_path: Path) -> None:
    ps.charts.uniform("A", 7).save(tmp_path / "field.h5")
    set_up = load_camera(written(tmp_path, "scene:\n  options: {variable: a}\n  source: field.h5\n  units: percent\n"))
    with pytest.raises(FileError) as caught:
        set_up.scene.scene()
    assert (caught.value.line, caught.value.where) == (4, f"scene: {tmp_path / 'field.h5'}")
    (tmp_path / "field.h5").write_text("no scene")
    set_up = load_camera(written(tmp_path, "name: x\nscene: field.h5\n"))
    with pytest.raises(FileError) as caught:
        set_up.scene.scene()
    assert (caught.value.line, caught.value.where) == (3, f"scene: {tmp_path / 'field.h5'}")
    text = "scene:\n  - {source: uniform, distance_m: 3}\n  - {source: uniform, distance_m: 1}\n"
    with pytest.raises(FileError) as caught:
        load_camera(written(tmp_path, text)).scene.scene()
    assert caught.value.line == 2


def test_illuminant_file_is_relative_to_the_camera_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    grid = np.arange(380, 781, 10)
    rows = [f"{nm},{nm - 300}" for nm in grid]
    (tmp_path / "lamp.csv").write_text("wavelength_nm,relative_energy\n" + "\n".join(rows) + "\n")
    file = written(tmp_path, "scene: {source: uniform, illuminant: lamp.csv, luminance_cd_m2: 20}\n")
    monkeypatch.chdir(tmp_path / "elsewhere")
    expected = ps.charts.uniform(ps.Spectrum(grid, grid - 300.0), 20)
    np.testing.assert_allclose(load_camera(file).scene.scene().basis, expected.basis, rtol=1e-12)


@pytest.mark.parametrize(
    ("first", "what"),
    [
        ("photosite_sensor: 1", "is a sensor file, not a camera file"),
        ("photosite_camera: true", "photosite_camera"),
        ("rows: 3", "is not a camera file"),
    ],
)
def test_file_that_is_not_a_camera_file(tmp_path: Path, first: str, what: str) -> None:
    file = tmp_path / "sensor.yaml"
    file.write_text(first + "\n")
    with pytest.raises(FileError) as caught:
        load_camera(file)
    assert caught.value.what == what


class TestSceneRequest:
    @pytest.mark.parametrize("name", BUILT_IN_SCENES)
    def test_every_built_in_scene_has_defaults(self, name: str) -> None:
        light = {"illuminant": "D65", "mean_luminance_cd_m2": 25.0, "wavelength_nm": np.arange(400, 701, 20)}
        scene = SceneRequest(name, {**light, "distance_m": 2.0, "width_m": 1.5}).scene()
        assert (scene.distance_m, scene.width_m, scene.wavelength_nm.size) == (2.0, 1.5, 16)
        assert scene.mean_luminance_cd_m2() > 0

    def test_options_of_files_do_not_apply_to_built_in_scenes(self) -> None:
        with pytest.raises(InputError) as caught:
            SceneRequest("macbeth", {"units": "W"})
        assert caught.value.arguments == {"units": "W"}

    def test_files_have_the_options_of_reading_only(self, tmp_path: Path) -> None:
        ps.charts.uniform("A", 7).save(tmp_path / "field.h5")
        file = str(tmp_path / "field.h5")
        assert SceneRequest(file, {"mean_luminance_cd_m2": 9.0}).scene().mean_luminance_cd_m2() == pytest.approx(9)
        with raises(InputError, "reading a scene has no option 'contrast'"):
            SceneRequest(file, {"contrast": 3})

    @pytest.mark.parametrize(
        ("name", "option", "value"),
        [
            ("ramp", "logarithmic", "no"),
            ("siemens-star", "patches", "maybe"),
            ("siemens-star", "waveform", 3),
            ("siemens-star", "contrast", "abc"),
            ("slanted-edge", "contrast", 0.5),
            ("ramp", "rows", 2.5),
            ("ramp", "contrast", True),
            ("ramp", "contrast", None),
            ("dead-leaves", "largest_radius", "wide"),
        ],
    )
    def test_invalid_options_of_built_in_scenes(self, name: str, option: str, value: Any) -> None:
        with pytest.raises(InputError) as caught:
            SceneRequest(name, {option: value}).scene()
        assert (caught.value.what, caught.value.value) == (option, value)
        with pytest.raises(InputError) as caught:
            getattr(ps.charts, name.replace("-", "_"))(**{option: value})
        assert (caught.value.what, caught.value.value) == (option, value)

    def test_invalid_lights(self) -> None:
        chart = ps.charts.macbeth()
        with pytest.raises(InputError) as caught:
            chart.with_illuminant(None)  # type: ignore[arg-type]
        assert caught.value.what == "illuminant"
        with pytest.raises(InputError):
            mixed(chart, [("A", 10)])  # type: ignore[list-item]


class TestDrawnForTheCamera:
    @pytest.mark.parametrize("name", ["slanted-edge", "edge-star", "siemens-star", "ramp"])
    def test_edges_have_a_sample_for_each_cell(self, tmp_path: Path, name: str) -> None:
        """An edge of 400 samples on a larger frame would have visible steps, whatever the number of cells."""
        file = written(tmp_path, f"scene: {name}\ncells_per_pixel: 3\n")
        set_up = load_camera(file)
        small = replace(set_up, sensor=set_up.sensor.with_(rows=200, cols=300))
        assert small.seen.scene().shape == (600, 900)

    def test_given_size_is_kept(self, tmp_path: Path) -> None:
        set_up = load_camera(written(tmp_path, "scene: {source: slanted-edge, options: {rows: 20, cols: 30}}\n"))
        assert set_up.seen.scene().shape == (20, 30)

    def test_measured_mtf_is_that_of_lens_and_pixel(self, tmp_path: Path) -> None:
        """The set-up of formats/camera.md on a small chip: MTF within 0.01 of lens times photodetector times cells."""
        from photosite.metrics.sharpness.slanted_edge import slanted_edge_mtf

        file = written(
            tmp_path,
            "optics: {f_number: 4, focal_length_mm: 50}\ncells_per_pixel: 3\n"
            "scene: {source: slanted-edge, illuminant: D65, luminance_cd_m2: 100, distance_m: 2, width_m: 0.9}\n",
        )
        set_up = load_camera(file)
        small = replace(set_up, sensor=set_up.sensor.with_(rows=120, cols=120))
        mean = small.camera.mean_electrons(small.seen.scene(), 0.01)
        found = slanted_edge_mtf(mean, channel="G", cfa=small.sensor.array.cfa)
        f = np.array([0.1, 0.25, 0.4, 0.5])
        pitch_m = 6.05e-6
        lens = set_up.optics.otf(f / pitch_m, 540.0, 2.0)
        expected = lens * np.sinc(f * np.sqrt(0.9)) * np.sinc(f / 3) ** 2
        assert found.at(f) == pytest.approx(expected, abs=0.01)

    def test_planes_with_an_opacity_picture_keep_its_size(self, tmp_path: Path) -> None:
        Image.new("L", (400, 400), 255).save(tmp_path / "mask.png")
        file = written(
            tmp_path,
            "scene:\n"
            "  - {source: slanted-edge, alpha: mask.png, distance_m: 1}\n"
            "  - {source: edge-star, distance_m: 2}\n",
        )
        set_up = load_camera(file)
        planes = replace(set_up, sensor=set_up.sensor.with_(rows=450, cols=500)).seen.scene().planes
        assert [plane.scene.shape for plane in planes] == [(400, 400), (450, 500)]


class TestPlanes:
    def test_planes_near_to_far(self, tmp_path: Path) -> None:
        mask = np.zeros((40, 60), np.uint8)
        mask[:, :20], mask[:, 20:25] = 255, 51
        Image.fromarray(mask).save(tmp_path / "mask.png")
        file = written(
            tmp_path,
            "optics: {f_number: 2.8, focal_length_mm: 50, focus_distance_m: 1}\n"
            "scene:\n"
            "  - {source: checkerboard, alpha: mask.png, options: {rows: 40, cols: 60}, distance_m: 1, width_m: 0.4}\n"
            "  - {source: uniform, illuminant: D65, luminance_cd_m2: 100, distance_m: 4}\n",
        )
        set_up = load_camera(file)
        near = ps.charts.checkerboard("A", 40, rows=40, cols=60, distance_m=1, width_m=0.4)
        alpha = (mask / 255).astype(np.float32)
        expected = ps.scenes.Planes(
            (ps.scenes.Plane(near, alpha), ps.scenes.Plane(ps.charts.uniform("D65", 100, distance_m=4)))
        )
        camera = ps.Camera(set_up.optics, set_up.sensor.with_(rows=48, cols=72))
        np.testing.assert_array_equal(
            camera.mean_electrons(set_up.scene.scene(), 0.01), camera.mean_electrons(expected, 0.01)
        )
        assert set_up.scene.light is None  # two lights: no white balance is known

    @pytest.mark.parametrize("mode", ["1", "L", "I;16", "LA", "RGBA"])
    def test_opacity_from_pictures(self, tmp_path: Path, mode: str) -> None:
        from photosite.scene.io.picture import read_alpha

        fraction = np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
        codes = (fraction * (65535 if mode == "I;16" else 255)).astype(np.uint16 if mode == "I;16" else np.uint8)
        picture = Image.fromarray(codes) if mode in ("L", "I;16") else Image.new(mode, (3, 2))
        if mode == "1":
            picture = Image.fromarray(codes).convert("1")
        if "A" in mode:
            picture.putalpha(Image.fromarray(codes))
        picture.save(tmp_path / "mask.png")
        np.testing.assert_array_equal(read_alpha(tmp_path / "mask.png"), fraction.astype(np.float32))

    def test_opacity_in_colour_or_of_another_size_is_an_error(self, tmp_path: Path) -> None:
        Image.new("RGB", (3, 2)).save(tmp_path / "mask.png")
        file = written(tmp_path, "scene:\n  - {source: checkerboard, alpha: mask.png}\n")
        with pytest.raises(FileError) as caught:
            load_camera(file).scene.scene()
        assert (caught.value.what, caught.value.value) == ("opacity", "RGB")
        Image.new("L", (3, 2)).save(tmp_path / "mask.png")
        with pytest.raises(FileError, match=r"mask\.png: "):
            load_camera(file).scene.scene()
