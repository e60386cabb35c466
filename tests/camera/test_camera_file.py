"""Camera files: what they say, whose defaults hold, and what is wrong with them in one line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.camera.file import SetUp, load_camera
from photosite.errors import FileError, InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.lights import mixed
from photosite.scene.request import FORMULAS, SceneRequest


def written(folder: Path, text: str) -> Path:
    file = folder / "mine.camera.yaml"
    file.write_text("photosite_camera: 1\n" + text)
    return file


def test_an_empty_file_is_the_papers_set_up(tmp_path: Path) -> None:
    told, paper = load_camera(written(tmp_path, "")), SetUp()
    assert (told.sensor, told.optics, told.exposure_s) == (paper.sensor, paper.optics, 1 / 3)
    assert told.optics == DiffractionLimited(8, 50)
    np.testing.assert_array_equal(told.scene.scene().basis, ps.charts.macbeth("A", 40).basis)


def test_everything_can_be_said(tmp_path: Path) -> None:
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
    told = load_camera(file)
    assert (told.name, told.exposure_s, told.integration, told.cells_per_pixel) == ("phone", 1 / 50, "rectangle", 3)
    assert (told.sensor.array.rows, told.sensor.name) == (40, ps.load_sensor("vendor-2.2um").name)
    assert told.optics == DiffractionLimited(2.8, 4.88, 0.9)
    scene = told.scene.scene()
    assert (scene.shape, scene.distance_m, scene.width_m) == ((80, 120), 0.5, 0.3)
    assert scene.mean_luminance_cd_m2() == pytest.approx(100)
    expected = ps.charts.slanted_edge("D65", 100, contrast=10, rows=80, cols=120, distance_m=0.5, width_m=0.3)
    np.testing.assert_array_equal(
        told.camera.mean_electrons(scene, told.exposure_s),
        ps.Camera(told.optics, told.sensor, "rectangle", 3).mean_electrons(expected, 1 / 50),
    )


def test_files_are_named_from_the_camera_files_folder(tmp_path: Path) -> None:
    ps.load_sensor("nikon-d200").with_(rows=10, cols=12).save(tmp_path / "chip.sensor.yaml")
    scene = ps.charts.uniform("A", 7)
    scene.save(tmp_path / "field.h5")
    told = load_camera(written(tmp_path, "sensor: chip.sensor.yaml\nscene: field.h5\n"))
    assert told.sensor.array.rows == 10
    assert told.scene.scene().mean_luminance_cd_m2() == pytest.approx(7, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sensr: nikon-d200\n", "mine.camera.yaml:2: a camera file has no key 'sensr'; did you mean 'sensor'?"),
        ("sensor: nikon-d20\n", "mine.camera.yaml:2: unknown sensor 'nikon-d20'"),
        ("sensor: none.sensor.yaml\n", "none.sensor.yaml: there is no such file"),
        ("exposure: soon\n", "mine.camera.yaml:2: exposure: "),
        ("integration: simpson\n", "mine.camera.yaml:2: integration is 'trapezoid' or 'rectangle', not 'simpson'"),
        ("cells_per_pixel: 2\n", "mine.camera.yaml:2: cells_per_pixel is 1, 3, 5, ..., not 2"),
        ("optics: 8\n", "mine.camera.yaml:2: optics is an optics file, or its fields, not 8"),
        ("optics: {f_number: 8}\n", "focal_length_mm"),
        ("optics: gone.yaml\n", "gone.yaml: there is no such file"),
        ("scene: [1]\n", "mine.camera.yaml:2: scene is a formula's name, a file, or fields"),
        ("scene:\n  sorce: macbeth\n", "mine.camera.yaml:3: scene has no key 'sorce'; did you mean 'source'?"),
        ("scene:\n  source: macbth\n", "mine.camera.yaml:3: scene.source 'macbth' is neither a formula nor a file"),
        ("scene:\n  luminance_cd_m2: -3\n", "mine.camera.yaml:3: scene.luminance_cd_m2 is a number above 0, not -3"),
        ("scene:\n  wavelength_nm: 400\n", "mine.camera.yaml:3: scene.wavelength_nm is a list of numbers"),
        ("scene:\n  wavelength_nm: [500, 400]\n", "mine.camera.yaml:3: wavelengths must increase"),
        ("scene:\n  wavelength_nm: []\n", "mine.camera.yaml:3: wavelengths are a list of positive numbers"),
        ("scene:\n  illuminant: D66\n", "mine.camera.yaml:3: unknown illuminant 'D66'"),
        ("scene:\n  illuminant: -5\n", "mine.camera.yaml:3: a blackbody's temperature must be above 0 K, not -5"),
        ("scene:\n  source: uniform\n  illuminant: lamp.csv\n", "mine.camera.yaml:4: "),
        ("scene:\n  luminance_cd_m2: .inf\n", "mine.camera.yaml:3: scene.luminance_cd_m2 is a number above 0, not inf"),
        ("scene:\n  distance_m: .inf\n", "mine.camera.yaml:3: scene.distance_m is a number above 0, not inf"),
        ("scene:\n  tolerance: 0.1\n", "mine.camera.yaml:3: scene.tolerance is said of a scene's file; 'macbeth'"),
        ("scene:\n  units: W\n", "mine.camera.yaml:3: scene.units is said of a scene's file; 'macbeth'"),
        ("scene:\n  source: slanted-edg\n", "mine.camera.yaml:3: scene.source 'slanted-edg' is neither"),
        ("scene:\n  source: slanted-edg\n", "did you mean 'slanted-edge'?"),
        ("optics: gone.yaml\n", "mine.camera.yaml:2: optics: "),
        ("sensor: none.sensor.yaml\n", "mine.camera.yaml:2: sensor: "),
        (
            "scene:\n  source: siemens-star\n  options:\n    patches: no\n",
            "mine.camera.yaml:5: the scene 'siemens-star': ",
        ),
        (
            "scene:\n  source: slanted-edge\n  options: {contras: 3}\n",
            "mine.camera.yaml:4: the scene 'slanted-edge' has no option 'contras'; did you mean 'contrast'?",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(FileError) as error:
        load_camera(written(tmp_path, text))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tolerance: 3", "mine.camera.yaml:4: the tolerance is a fraction of the RMS radiance"),
        ("options: {foo: 1}", "mine.camera.yaml:4: reading a scene knows no option 'foo'"),
        ("options: {method: smooth}", "mine.camera.yaml:4: no method 'smooth'"),
        ("options: {sort_bands: no}", "mine.camera.yaml:4: sort_bands is true or false, not 'no'"),
    ],
)
def test_how_a_file_is_read_is_checked_on_load(tmp_path: Path, text: str, said: str) -> None:
    ps.charts.uniform("A", 7).save(tmp_path / "field.h5")
    with pytest.raises(FileError) as error:
        load_camera(written(tmp_path, f"scene:\n  source: field.h5\n  {text}\n"))
    assert said in str(error.value)


def test_a_pictures_method_is_said_among_its_options(tmp_path: Path) -> None:
    codes = np.random.default_rng(1).integers(30, 220, (4, 6, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    text = "scene: {source: a.png, luminance_cd_m2: 40, options: {method: jakob-hanika}}\n"
    told = load_camera(written(tmp_path, text)).scene.scene()
    np.testing.assert_array_equal(told.weights, ps.pictures.from_srgb(codes, method="jakob-hanika").weights)


def test_what_comes_up_when_the_scene_is_made_has_the_camera_files_line(tmp_path: Path) -> None:
    told = load_camera(written(tmp_path, "scene:\n  options: {contrast: 0.1}\n  source: slanted-edge\n"))
    with pytest.raises(FileError, match=r"mine\.camera\.yaml:4: scene: .*contrast.* is above 1, not 0\.1"):
        told.scene.scene()
    (tmp_path / "field.h5").write_text("no scene")
    told = load_camera(written(tmp_path, "name: x\nscene: field.h5\n"))
    with pytest.raises(FileError, match=r"mine\.camera\.yaml:3: scene: .*field\.h5: "):
        told.scene.scene()
    text = "scene:\n  - {source: uniform, distance_m: 3}\n  - {source: uniform, distance_m: 1}\n"
    with pytest.raises(FileError, match=r"mine\.camera\.yaml:2: scene: "):
        load_camera(written(tmp_path, text)).scene.scene()


def test_a_lamps_file_lies_beside_the_camera_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    grid = np.arange(380, 781, 10)
    rows = [f"{nm},{nm - 300}" for nm in grid]
    (tmp_path / "lamp.csv").write_text("wavelength_nm,relative_energy\n" + "\n".join(rows) + "\n")
    file = written(tmp_path, "scene: {source: uniform, illuminant: lamp.csv, luminance_cd_m2: 20}\n")
    monkeypatch.chdir(tmp_path / "elsewhere")
    expected = ps.charts.uniform(ps.Spectrum(grid, grid - 300.0), 20)
    np.testing.assert_allclose(load_camera(file).scene.scene().basis, expected.basis, rtol=1e-12)


@pytest.mark.parametrize("first", ["photosite_sensor: 1", "photosite_camera: true"])
def test_no_camera_file(tmp_path: Path, first: str) -> None:
    file = tmp_path / "sensor.yaml"
    file.write_text(first + "\n")
    with pytest.raises(FileError, match="does not describe a camera: expected 'photosite_camera: 1'"):
        load_camera(file)


class TestSceneRequest:
    @pytest.mark.parametrize("name", FORMULAS)
    def test_every_formula_is_made_with_its_defaults(self, name: str) -> None:
        width_m = None if name == "uniform" else 1.5  # an even field is as wide as one likes
        grid = np.arange(400, 701, 20)
        scene = SceneRequest(name, "D65", 25.0, distance_m=2.0, width_m=width_m, wavelength_nm=grid).scene()
        assert (scene.distance_m, scene.width_m, scene.wavelength_nm.size) == (2.0, width_m, 16)
        assert scene.mean_luminance_cd_m2() > 0

    def test_a_formula_is_not_asked_what_files_are(self) -> None:
        with pytest.raises(InputError, match="units is said of a scene's file"):
            SceneRequest("macbeth", units="W").scene()

    def test_a_file_takes_the_options_of_reading_and_no_others(self, tmp_path: Path) -> None:
        ps.charts.uniform("A", 7).save(tmp_path / "field.h5")
        file = str(tmp_path / "field.h5")
        assert SceneRequest(
            file, options={"mean_luminance_cd_m2": 9.0}
        ).scene().mean_luminance_cd_m2() == pytest.approx(9)
        with pytest.raises(InputError, match="reading a scene knows no option 'contrast'"):
            SceneRequest(file, options={"contrast": 3}).scene()

    def test_options_that_cannot_be_are_the_formulas_error(self) -> None:
        with pytest.raises(InputError, match="is above 1"):
            SceneRequest("slanted-edge", options={"contrast": 0.5}).scene()
        with pytest.raises(InputError, match="'slanted-edge'"):
            SceneRequest("slanted-edge", options={"contrast": "high"}).scene()

    @pytest.mark.parametrize(
        ("name", "option", "value", "said"),
        [
            ("ramp", "logarithmic", "no", "logarithmic is true or false, not 'no'"),
            ("siemens-star", "patches", "maybe", "patches is true or false, not 'maybe'"),
            ("siemens-star", "waveform", 3, "waveform is text, such as 'sine', not 3"),
            ("siemens-star", "contrast", "abc", "the scene 'siemens-star': contrast is a number, not 'abc'"),
            ("ramp", "rows", 2.5, "rows is a whole number, not 2.5"),
            ("ramp", "contrast", True, "contrast is a number, not True"),
            ("ramp", "contrast", None, "contrast is a number, not nothing"),
            ("dead-leaves", "largest_radius", "wide", "largest_radius is a number, not 'wide'"),
        ],
    )
    def test_options_of_another_kind_are_refused(self, name: str, option: str, value: Any, said: str) -> None:
        with pytest.raises(InputError, match=re.escape(said)):
            SceneRequest(name, options={option: value}).scene()

    def test_no_text_counts_as_yes_in_charts(self) -> None:
        with pytest.raises(InputError, match="patches is true or false, not 'no'"):
            ps.charts.siemens_star(patches="no")  # type: ignore[arg-type]
        with pytest.raises(InputError, match="logarithmic is true or false, not 'no'"):
            ps.charts.ramp(logarithmic="no")  # type: ignore[arg-type]

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            ({"sort_bands": "no"}, "sort_bands is true or false, not 'no'"),
            ({"tolerance": "abc"}, "tolerance is a number, not 'abc'"),
            ({"distance_m": "far"}, "distance_m is a number, not 'far'"),
            ({"patch_cols": 2.5}, "patch_cols is a whole number, not 2.5"),
            ({"units": 3}, "units is text, not 3"),
            ({"wavelength_nm": "400:700:10"}, "wavelength_nm is a list of numbers, such as"),
            ({"wavelength_nm": []}, "wavelength_nm is a list of numbers, such as"),
        ],
    )
    def test_what_reading_is_told_is_of_the_right_kind(
        self, tmp_path: Path, options: dict[str, Any], said: str
    ) -> None:
        ps.charts.uniform("A", 7).save(tmp_path / "field.h5")
        with pytest.raises(InputError, match=re.escape(said)):
            SceneRequest(str(tmp_path / "field.h5"), options=options).scene()
        with pytest.raises(InputError, match=re.escape(said)):
            ps.read_scene(tmp_path / "field.h5", **options)

    def test_lights_that_are_none(self) -> None:
        chart = ps.charts.macbeth()
        with pytest.raises(InputError, match="illuminant must be a name, a temperature in K or a Spectrum, got None"):
            chart.with_illuminant(None)  # type: ignore[arg-type]
        with pytest.raises(InputError, match=r"a light is \(illuminant, luminance in cd/m2, spread or None\)"):
            mixed(chart, [("A", 10)])  # type: ignore[list-item]


class TestDrawnForTheCamera:
    @pytest.mark.parametrize("name", ["slanted-edge", "edge-star", "siemens-star", "ramp"])
    def test_edges_have_a_sample_for_each_cell(self, tmp_path: Path, name: str) -> None:
        """A scene of 400 samples on a larger frame would be a staircase, whatever the cells."""
        file = written(tmp_path, f"scene: {name}\ncells_per_pixel: 3\n")
        told = load_camera(file)
        small = replace(told, sensor=told.sensor.with_(rows=200, cols=300))
        assert small.seen.scene().shape == (600, 900)

    def test_a_size_that_is_said_is_kept(self, tmp_path: Path) -> None:
        told = load_camera(written(tmp_path, "scene: {source: slanted-edge, options: {rows: 20, cols: 30}}\n"))
        assert told.seen.scene().shape == (20, 30)

    def test_an_edge_is_measured_as_sharp_as_lens_and_pixel_are(self, tmp_path: Path) -> None:
        """docs/cameras.md's set-up on a small chip: modulation within 0.01 of optics times aperture times cells."""
        from photosite.metrics.sharpness import slanted_edge_mtf

        file = written(
            tmp_path,
            "optics: {f_number: 4, focal_length_mm: 50}\ncells_per_pixel: 3\n"
            "scene: {source: slanted-edge, illuminant: D65, luminance_cd_m2: 100, distance_m: 2, width_m: 0.9}\n",
        )
        told = load_camera(file)
        small = replace(told, sensor=told.sensor.with_(rows=120, cols=120))
        mean = small.camera.mean_electrons(small.seen.scene(), 0.01)
        found = slanted_edge_mtf(mean, channel="G", cfa=small.sensor.array.cfa)
        f = np.array([0.1, 0.25, 0.4, 0.5])
        pitch_m = 6.05e-6
        lens = told.optics.otf(f / pitch_m, 540.0, 2.0)
        expected = lens * np.sinc(f * np.sqrt(0.9)) * np.sinc(f / 3) ** 2
        assert found.at(f) == pytest.approx(expected, abs=0.01)

    def test_planes_too_but_for_those_with_a_picture_of_opacity(self, tmp_path: Path) -> None:
        Image.new("L", (400, 400), 255).save(tmp_path / "mask.png")
        file = written(
            tmp_path,
            "scene:\n"
            "  - {source: slanted-edge, alpha: mask.png, distance_m: 1}\n"
            "  - {source: edge-star, distance_m: 2}\n",
        )
        told = load_camera(file)
        planes = replace(told, sensor=told.sensor.with_(rows=450, cols=500)).seen.scene().planes
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
        told = load_camera(file)
        near = ps.charts.checkerboard("A", 40, rows=40, cols=60, distance_m=1, width_m=0.4)
        alpha = (mask / 255).astype(np.float32)
        expected = ps.Planes((ps.Plane(near, alpha), ps.Plane(ps.charts.uniform("D65", 100, distance_m=4))))
        camera = ps.Camera(told.optics, told.sensor.with_(rows=48, cols=72))
        np.testing.assert_array_equal(
            camera.mean_electrons(told.scene.scene(), 0.01), camera.mean_electrons(expected, 0.01)
        )
        assert told.scene.light is None  # two lights: no white balance is known

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("scene: []\n", "mine.camera.yaml:2: scene lists no planes"),
            ("scene:\n  - {source: uniform, alpha: no.png}\n", "mine.camera.yaml:3: scene.alpha 'no.png' is no file"),
            ("scene:\n  - {source: uniform, alfa: no.png}\n", "has no key 'alfa'; did you mean 'alpha'?"),
        ],
    )
    def test_what_is_wrong_is_said_in_one_line(self, tmp_path: Path, text: str, said: str) -> None:
        with pytest.raises(FileError) as error:
            load_camera(written(tmp_path, text))
        assert said in str(error.value)

    @pytest.mark.parametrize("mode", ["1", "L", "I;16", "LA", "RGBA"])
    def test_opacity_from_pictures(self, tmp_path: Path, mode: str) -> None:
        from photosite.scene.io.alpha import read_alpha

        share = np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
        codes = (share * (65535 if mode == "I;16" else 255)).astype(np.uint16 if mode == "I;16" else np.uint8)
        picture = Image.fromarray(codes) if mode in ("L", "I;16") else Image.new(mode, (3, 2))
        if mode == "1":
            picture = Image.fromarray(codes).convert("1")
        if "A" in mode:
            picture.putalpha(Image.fromarray(codes))
        picture.save(tmp_path / "mask.png")
        np.testing.assert_array_equal(read_alpha(tmp_path / "mask.png"), share.astype(np.float32))

    def test_opacity_in_colour_or_of_another_size_is_refused(self, tmp_path: Path) -> None:
        Image.new("RGB", (3, 2)).save(tmp_path / "mask.png")
        file = written(tmp_path, "scene:\n  - {source: checkerboard, alpha: mask.png}\n")
        with pytest.raises(FileError, match=r"mask\.png: is in colour; opacity is a gray picture"):
            load_camera(file).scene.scene()
        Image.new("L", (3, 2)).save(tmp_path / "mask.png")
        with pytest.raises(FileError, match=r"mask\.png: a plane's alpha has the scene's shape"):
            load_camera(file).scene.scene()
