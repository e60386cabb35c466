"""`photosite scenes`, and scenes, lenses and cameras from files in `photosite simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.scene.scene_request import BUILT_IN_SCENES, SceneRequest

SMALL = ("--rows", 66, "--cols", 98)


@pytest.mark.smoke("scenes list")
def test_lists_every_built_in_scene_with_its_options(photosite: Any) -> None:
    message = photosite("scenes", "list", "--json").json["scenes"]
    assert tuple(message) == BUILT_IN_SCENES
    assert message["slanted-edge"]["options"]["contrast"] == 4.0
    text = photosite("scenes", "list").out
    assert ["ENVI", ".hdr", ".img", ".bsq", ".bil", ".bip", ".raw", ".dat", ".hdr"] in [
        line.split() for line in text.splitlines()
    ]
    assert all(name in text for name in BUILT_IN_SCENES)


@pytest.mark.smoke("scenes show")
def test_shows_what_a_scene_is(photosite: Any, tmp_path: Path) -> None:
    picture = tmp_path / "chart.png"
    message = photosite("scenes", "show", "macbeth", "--luminance", 30, "--picture", picture, "--json").json
    assert (message["rows"], message["cols"], message["spectra"]) == (132, 196, 24)
    chart = ps.charts.macbeth("A", 30)
    assert message["mean_luminance_cd_m2"] == pytest.approx(chart.mean_luminance_cd_m2())
    assert message["darkest_cd_m2"] == 0
    white = chart.with_mean_luminance(chart.mean_luminance_cd_m2())
    region = next(region for region in white.regions if region.name == "white")
    assert message["brightest_cd_m2"] == pytest.approx(
        float(ps.Scene.uniform(white.radiance(region.r0, region.c0), white.wavelength_nm).mean_luminance_cd_m2()),
        rel=1e-4,
    )
    assert Image.open(picture).size == (196, 132)


@pytest.mark.smoke("scenes print")
@pytest.mark.parametrize("suffix", [".png", ".pdf"])
def test_prints_a_chart_at_its_size(photosite: Any, tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"star{suffix}"
    call = ("scenes", "print", "siemens-star", "--width", 100, "--dpi", 150, "-o", file, "--brightest", 0.8)
    patches = photosite(*call, "--json").json["patches"]
    assert [round(patch["reflectance"], 6) for patch in patches] == [round(0.8 * k / 15, 6) for k in range(16)]
    white = max(patches, key=lambda patch: patch["reflectance"])
    assert white["lightness"] == pytest.approx(116 * 0.8 ** (1 / 3) - 16, abs=1e-6)
    if suffix == ".png":
        with Image.open(file) as picture:
            assert picture.size == (591, 591)
            assert picture.info["dpi"] == pytest.approx((150, 150), abs=0.1)
            codes = np.asarray(picture)
        assert codes.max() == round(255 * (1.055 * 0.8 ** (1 / 2.4) - 0.055))
    else:
        assert file.read_bytes().startswith(b"%PDF")


def test_charts_in_color_are_not_printed(photosite: Any, tmp_path: Path) -> None:
    for name in ("macbeth", "siemensstar"):
        assert photosite("scenes", "print", name, "-o", tmp_path / "a.png").status == 2
        assert not (tmp_path / "a.png").exists()


def test_the_luminance_of_a_chart_file_is_that_of_its_patches(photosite: Any, tmp_path: Path) -> None:
    message = ("--luminance", 50)
    made = photosite("scenes", "show", "macbeth", *message)
    assert "mean luminance 50 cd/m2 of the patches, 36.36 cd/m2 of all samples" in made.out
    ps.charts.macbeth("A", 40).save(tmp_path / "chart.h5")
    assert photosite("scenes", "show", tmp_path / "chart.h5", *message).out == made.out
    done = photosite("convert", tmp_path / "chart.h5", "-o", tmp_path / "again.h5", *message, "--json").json
    assert done["mean_luminance_cd_m2"] == pytest.approx(50)
    assert "mean luminance 50 cd/m2, darkest" in photosite("scenes", "show", "siemens-star", *message).out
    for command in (("simulate",), ("scenes", "show"), ("convert",)):
        assert "of a chart's patches" in " ".join(photosite(*command, "--help").out.split())


def test_a_scene_file_is_simulated_as_the_scene(photosite: Any, tmp_path: Path) -> None:
    scene = ps.charts.zone_plate("D65", 60, rows=66, cols=98)
    scene.save(tmp_path / "plate.h5")
    photosite("simulate", *SMALL, "--scene", tmp_path / "plate.h5", "--seed", 3, "-o", tmp_path / "shot.tif")
    sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98)
    expected = ps.Camera(ps.DiffractionLimited(8, 50), sensor).capture(scene, 1 / 3, seed=3)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, expected.dn)


def test_options_of_a_built_in_scene(photosite: Any, tmp_path: Path) -> None:
    given = ("--scene", "slanted-edge", "--scene-option", "contrast=10", "--scene-option", "angle-deg=-7", "--cells", 3)
    photosite("simulate", *SMALL, *given, "--width", 0.05, "-o", tmp_path / "shot.tif")
    sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98)
    # Drawn with a sample for each of the three cells across a pixel: 0.05 m at 1.2 m is 2.17 mm, 359.3 pixels.
    edge = ps.charts.slanted_edge("A", 40, contrast=10, angle_deg=-7, width_m=0.05, rows=198, cols=1078)
    camera = ps.Camera(ps.DiffractionLimited(8, 50), sensor, cells_per_pixel=3)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, camera.capture(edge, 1 / 3).dn)


def test_a_lens_from_its_file(photosite: Any, tmp_path: Path) -> None:
    from photosite.optics.io.formats import load_optics

    lens = tmp_path / "mine.optics.yaml"
    lens.write_text(
        "photosite_optics: 1\nf_number: 8\nfocal_length_mm: 50\n"
        "blur: {kind: wavefront, zernike: {7: 40}, unit: nm}\nveiling_glare: {fraction: 0.02}\n"
    )
    photosite("simulate", *SMALL, "--optics", lens, "--exposure", "1/30", "-o", tmp_path / "shot.tif")
    camera = ps.Camera(load_optics(lens), ps.load_sensor("nikon-d200").with_(rows=66, cols=98))
    expected = camera.capture(ps.charts.macbeth("A", 40), 1 / 30)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, expected.dn)
    done = photosite("simulate", "--optics", lens, "--f-number", 4, "-o", tmp_path / "no.tif")
    assert (done.status, done.out) == (2, "")
    assert "the optics file defines the lens. Omit --f-number 4" in done.err


def test_options_override_a_camera_file(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.camera.yaml"
    file.write_text(
        "photosite_camera: 1\nsensor: vendor-2.2um\noptics: {f_number: 4, focal_length_mm: 6}\nexposure: 1/10\n"
        "scene: {source: slanted-edge, illuminant: D65, luminance_cd_m2: 90, options: {contrast: 8}, distance_m: 2}\n"
    )
    first = photosite("simulate", "--camera", file, *SMALL, "-o", tmp_path / "a.tif", "--json").json
    assert first["sensor"] == ps.load_sensor("vendor-2.2um").name
    assert (first["exposure_s"], first["scene"]) == (0.1, "slanted edge, 5 degrees, contrast 8 : 1, illuminant D65")
    given = ("--exposure", "1/50", "--f-number", 2, "--scene", "uniform", "--sensor", "nikon-d200")
    second = photosite("simulate", "--camera", file, *SMALL, *given, "-o", tmp_path / "b.tif", "--json").json
    assert (second["exposure_s"], second["sensor"]) == (0.02, "Nikon D200")
    # The other scene is at the distance and in the light of the file's scene.
    camera = ps.Camera(ps.DiffractionLimited(2, 6), ps.load_sensor("nikon-d200").with_(rows=66, cols=98))
    expected = camera.capture(ps.charts.uniform("D65", 90, distance_m=2), 0.02)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "b.tif").dn, expected.dn)


def test_another_file_keeps_its_own_light() -> None:
    light = {"illuminant": "D65", "mean_luminance_cd_m2": 90.0}
    base = SceneRequest("macbeth", {**light, "distance_m": 2.0, "width_m": 0.5})
    assert base.instead("cube.h5").options == {"distance_m": 2.0}
    assert base.instead("ramp").options == {**light, "distance_m": 2.0}


def test_wavelengths_of_a_built_in_scene_and_of_a_file(photosite: Any, tmp_path: Path) -> None:
    message = photosite("scenes", "show", "macbeth", "--wavelengths", "420:680:20", "--json").json
    assert (message["first_nm"], message["last_nm"], message["wavelengths"]) == (420, 680, 14)
    photosite("simulate", *SMALL, "--scene", "macbeth", "--wavelengths", "400:700:50", "-o", tmp_path / "shot.tif")
    camera = ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200").with_(rows=66, cols=98))
    expected = camera.capture(ps.charts.macbeth("A", 40, wavelength_nm=np.arange(400, 701, 50)), 1 / 3)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, expected.dn)
    rng = np.random.default_rng(3)
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        file["cube"] = rng.random((20, 30, 31))
    given = ("--wavelengths", "400:700:10", "--units", "W/sr/m2/nm")
    exact = photosite("scenes", "show", tmp_path / "cube.h5", *given, "--json").json
    rough = photosite("scenes", "show", tmp_path / "cube.h5", *given, "--tolerance", 0.4, "--json").json
    assert (exact["first_nm"], exact["last_nm"]) == (400, 700)
    assert rough["spectra"] < exact["spectra"] == 31


def test_hints_name_the_options_of_the_command(photosite: Any, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        file["cube"] = np.random.default_rng(3).random((20, 30, 31)) - 0.5
    cube, waves = tmp_path / "cube.h5", ("--wavelengths", "400:700:10")
    for call in (
        ("simulate", *SMALL, "-o", tmp_path / "shot.tif", "--scene", cube),
        ("scenes", "show", cube),
        ("convert", cube, "-o", tmp_path / "scene.h5"),
    ):
        negative = "--negative zero" if call[0] == "convert" else "--scene-option negative=zero"
        for more, message in (
            ((), "--units W/sr/m2/nm"),
            (("--units", "W/sr/m2/nm"), "--wavelengths 400,410,420"),
            ((*waves, "--units", "reflectance"), "--illuminant D65 and --luminance 100"),
            ((*waves, "--units", "W/sr/m2/nm"), negative),
        ):
            done = photosite(*call, *more)
            assert (done.status, done.out) == (2, "")
            assert f" {message}" in done.err
            assert "='" not in done.err
            assert "=[" not in done.err


def test_a_picture_is_balanced_by_its_own_light(photosite: Any, tmp_path: Path) -> None:
    Image.new("RGB", (30, 20), (200, 120, 60)).save(tmp_path / "picture.png")
    given = ("--scene", tmp_path / "picture.png", "--luminance", 40)
    photosite("simulate", *SMALL, *given, "-o", tmp_path / "shot.dng")
    camera = ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200").with_(rows=66, cols=98))
    expected = camera.as_shot_neutral(ps.charts.uniform("D65", 1))
    kept = ps.read_raw(tmp_path / "shot.dng").metadata["as_shot_neutral"]
    np.testing.assert_allclose(
        [float(part) for part in kept.split(",")], [float(part) for part in expected.split(",")], rtol=2e-3
    )


def test_the_example_of_the_help_fills_the_range(photosite: Any, tmp_path: Path) -> None:
    message = photosite("simulate", "--help").out
    example = " ".join(message[message.index("Example: photosite simulate") :].split("\n\n")[0].split()).split()[3:]
    given = ("--rows", 132, "--cols", 196, *example[: example.index("-o")], "-o", tmp_path / "shot.dng", "--json")
    done = photosite("simulate", *given).json
    assert done["saturated_fraction"] == 0
    assert done["max_dn"] > 0.4 * done["white_level_dn"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            ("--scene", "macbet"),
            "no scene 'macbet': it is neither a built-in scene nor a file. Did you mean 'macbeth'?",
        ),
        (("--scene", "gone.hdr"), "gone.hdr: there is no such file"),
        (("--scene-option", "contrast"), "must be NAME=VALUE"),
        (("--wavelengths", "700:400:10"), "must be 400,410,420 or first:last:step such as 400:700:10"),
        (("--wavelengths", "1:1e12:1"), "must be 400,410,420 or first:last:step such as 400:700:10"),
        (("--tolerance", 0.1), "does not apply to the built-in scene 'macbeth'. Omit --tolerance 0.1"),
        (("--scene-option", "contrast=3"), "the chart 'macbeth' has no option 'contrast'"),
        (("--optics", "gone.yaml"), "gone.yaml: there is no such file"),
        (("--camera", "gone.yaml"), "gone.yaml: there is no such file"),
        (("--cells", 2), "must be odd and positive"),
    ],
)
def test_errors_are_one_line(photosite: Any, tmp_path: Path, given: tuple[Any, ...], message: str) -> None:
    done = photosite("simulate", *SMALL, *given, "-o", tmp_path / "shot.tif")
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_no_such_subcommand(photosite: Any) -> None:
    done = photosite("scenes", "shw")
    assert (done.status, done.out) == (2, "")
    assert "no command 'scenes shw'. Did you mean 'show'?" in done.err
