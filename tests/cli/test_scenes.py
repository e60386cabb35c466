"""`photosite scenes`, and scenes, lenses and cameras from files in `photosite simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.scene.request import FORMULAS

SMALL = ("--rows", 66, "--cols", 98)


def test_lists_every_formula_with_its_options(photosite: Any) -> None:
    said = photosite("scenes", "--json").json["scenes"]
    assert tuple(said) == FORMULAS
    assert said["slanted-edge"]["options"]["contrast"] == 4.0
    text = photosite("scenes").out
    assert "ENVI: .hdr" in text
    assert all(name in text for name in FORMULAS)


def test_shows_what_a_scene_is(photosite: Any, tmp_path: Path) -> None:
    picture = tmp_path / "chart.png"
    said = photosite("scenes", "show", "macbeth", "--luminance", 30, "--picture", picture, "--json").json
    assert (said["rows"], said["cols"], said["spectra"]) == (132, 196, 24)
    chart = ps.charts.macbeth("A", 30)
    assert said["mean_luminance_cd_m2"] == pytest.approx(chart.mean_luminance_cd_m2())
    assert said["darkest_cd_m2"] == 0
    white = chart.with_mean_luminance(chart.mean_luminance_cd_m2())
    region = next(region for region in white.regions if region.name == "white")
    assert said["brightest_cd_m2"] == pytest.approx(
        float(ps.Scene.uniform(white.radiance(region.r0, region.c0), white.wavelength_nm).mean_luminance_cd_m2()),
        rel=1e-4,
    )
    assert Image.open(picture).size == (196, 132)


def test_a_scenes_file_is_simulated_as_the_scene(photosite: Any, tmp_path: Path) -> None:
    scene = ps.charts.zone_plate("D65", 60, rows=66, cols=98)
    scene.save(tmp_path / "plate.h5")
    photosite("simulate", *SMALL, "--scene", tmp_path / "plate.h5", "--seed", 3, "-o", tmp_path / "shot.tif")
    sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98)
    expected = ps.Camera(ps.DiffractionLimited(8, 50), sensor).capture(scene, 1 / 3, seed=3)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, expected.dn)


def test_options_of_a_formula(photosite: Any, tmp_path: Path) -> None:
    told = ("--scene", "slanted-edge", "--scene-option", "contrast=10", "--scene-option", "angle-deg=-7", "--cells", 3)
    photosite("simulate", *SMALL, *told, "--width", 0.05, "-o", tmp_path / "shot.tif")
    sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98)
    edge = ps.charts.slanted_edge("A", 40, contrast=10, angle_deg=-7, width_m=0.05)
    camera = ps.Camera(ps.DiffractionLimited(8, 50), sensor, cells_per_pixel=3)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, camera.capture(edge, 1 / 3).dn)


def test_a_lens_from_its_file(photosite: Any, tmp_path: Path) -> None:
    from photosite.optics.file import load_optics

    lens = tmp_path / "mine.optics.yaml"
    lens.write_text(
        "photosite_optics: 1\nf_number: 2.8\nfocal_length_mm: 50\n"
        "blur: {kind: wavefront, zernike: {7: 40}, unit: nm}\nveiling_glare: {fraction: 0.02}\n"
    )
    photosite("simulate", *SMALL, "--optics", lens, "--exposure", "1/30", "-o", tmp_path / "shot.tif")
    camera = ps.Camera(load_optics(lens), ps.load_sensor("nikon-d200").with_(rows=66, cols=98))
    expected = camera.capture(ps.charts.macbeth("A", 40), 1 / 30)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "shot.tif").dn, expected.dn)
    done = photosite("simulate", "--optics", lens, "--f-number", 4, "-o", tmp_path / "no.tif")
    assert (done.status, done.out) == (2, "")
    assert "--f-number is said by the lens's file" in done.err


def test_a_camera_file_and_what_goes_before_it(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.camera.yaml"
    file.write_text(
        "photosite_camera: 1\nsensor: vendor-2.2um\noptics: {f_number: 4, focal_length_mm: 6}\nexposure: 1/10\n"
        "scene: {source: slanted-edge, illuminant: D65, options: {contrast: 8}, distance_m: 2}\n"
    )
    first = photosite("simulate", "--camera", file, *SMALL, "-o", tmp_path / "a.tif", "--json").json
    assert first["sensor"] == ps.load_sensor("vendor-2.2um").name
    assert (first["exposure_s"], first["scene"]) == (0.1, "slanted edge, 5 degrees, contrast 8 : 1, illuminant D65")
    told = ("--exposure", "1/50", "--f-number", 2, "--scene", "uniform", "--sensor", "nikon-d200")
    second = photosite("simulate", "--camera", file, *SMALL, *told, "-o", tmp_path / "b.tif", "--json").json
    assert (second["exposure_s"], second["sensor"]) == (0.02, "Nikon D200")
    # The other scene has its own light, CIE A, and stands where the file's stood.
    camera = ps.Camera(ps.DiffractionLimited(2, 6), ps.load_sensor("nikon-d200").with_(rows=66, cols=98))
    expected = camera.capture(ps.charts.uniform("A", 40, distance_m=2), 0.02)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "b.tif").dn, expected.dn)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (("--scene", "macbet"), "no scene 'macbet': it is no file, and no formula; did you mean 'macbeth'?"),
        (("--scene", "gone.hdr"), "gone.hdr: cannot be read"),
        (("--scene-option", "contrast"), "expected NAME=VALUE"),
        (("--scene-option", "contrast=3"), "the scene 'macbeth' has no option 'contrast'; it has none"),
        (("--optics", "gone.yaml"), "gone.yaml: there is no such file"),
        (("--camera", "gone.yaml"), "gone.yaml: there is no such file"),
        (("--cells", 2), "cells_per_pixel is odd and positive, not 2"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(photosite: Any, tmp_path: Path, told: tuple[Any, ...], said: str) -> None:
    done = photosite("simulate", *SMALL, *told, "-o", tmp_path / "shot.tif")
    assert (done.status, done.out) == (2, "")
    assert said in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_no_such_subcommand(photosite: Any) -> None:
    done = photosite("scenes", "shw")
    assert (done.status, done.out) == (2, "")
    assert "no command 'scenes shw'; did you mean 'show'?" in done.err
