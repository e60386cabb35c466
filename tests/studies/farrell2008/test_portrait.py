"""The portrait: its scene, its distance, and noise on the face against the noise model."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from photosite.camera.camera import Camera
from photosite.metrics.snr import noise_budget
from photosite.scene.pictures import from_rgb
from photosite.studies.farrell2008.cameras import D200, VENDOR
from photosite.studies.farrell2008.drawing import text
from photosite.studies.farrell2008.portrait import (
    FACE,
    dim_face,
    filling,
    portrait_scene,
    portrait_source,
    region_luminance_cd_m2,
    region_noise,
    shoot_portrait,
    white_surface_electrons,
)
from photosite.values.region import Region


def test_the_file_names_its_source() -> None:
    import io
    from pathlib import Path

    import matplotlib
    from PIL import Image

    content = (Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg").read_bytes()
    assert Image.open(io.BytesIO(content)).info["comment"].endswith(b"commons.wikimedia.org/wiki/File:Grace_Hopper.jpg")
    assert "public domain" in text("portrait_source")
    assert len(portrait_source()["file_sha256"]) == 64


def test_luminances() -> None:
    scene = portrait_scene(5.0)
    assert scene.mean_luminance_cd_m2() == pytest.approx(5.0, rel=1e-6)
    # From the spectrum of each sample.
    from photosite.color.colorimetry import luminance_cd_m2

    radiance = np.einsum("kij,kl->ijl", scene.weights[:, FACE.r0 : FACE.r1 : 9, FACE.c0 : FACE.c1 : 9], scene.basis)
    thinned = luminance_cd_m2(radiance, scene.wavelength_nm).mean()
    assert region_luminance_cd_m2(scene, FACE) == pytest.approx(thinned, rel=0.02)


@pytest.mark.parametrize("case", [D200, VENDOR])
def test_the_scene_fills_the_chip(case) -> None:
    camera = Camera(case.lens, case.sensor(30, 26))
    placed = filling(portrait_scene(5.0), camera, 0.4)
    chip_m = 26 * camera.sensor.pixel.width_um.value * 1e-6
    assert camera.optics.magnification(placed.distance_m) * 0.4 == pytest.approx(chip_m, rel=1e-12)


def test_noise_of_a_region_follows_the_noise_model() -> None:
    # 3 channels on 24 independent chips: z is standard normal. Its mean over 72 is within 4 / sqrt(72) except in 6e-5
    # of seeds, its standard deviation within 0.66 and 1.34 except in 1e-4 (4 standard errors).
    mean_e = np.full((64, 64), 500.0, np.float32)
    whole = Region("all", 0, 64, 0, 64)
    z = []
    for number in range(24):
        sensor = VENDOR.sensor(64, 64).with_(serial=f"chip {number}")
        raw = Camera(VENDOR.lens, sensor).expose(mean_e, 0.066, seed=number)
        for entry in region_noise(raw, mean_e, sensor, whole).values():
            # The budget omits rounding, 1/12 DN^2 at 9.77 e-/DN: 7.9 e-^2 of 6270.
            assert entry.expected_db == pytest.approx(noise_budget(sensor, 0.05).total_db, abs=0.01)
            z.append((entry.snr_db - entry.expected_db) / entry.standard_error_db)
    assert abs(np.mean(z)) < 4 / np.sqrt(len(z))
    assert 0.66 < np.std(z) < 1.34


@pytest.mark.parametrize("case", [D200, VENDOR])
def test_a_white_surface_is_developed_white_and_a_gray_one_gray(case) -> None:
    # Photon noise only, at a third of saturation; the gray is 0.5 in linear light.
    for code, wanted in ((255, 1.0), (188, 188 / 255)):
        scene = replace(
            from_rgb(np.full((60, 60, 3), code, np.uint8), "A", 40.0), regions=(Region("all", 5, 55, 5, 55),)
        )
        sensor = case.sensor(60, 60).with_(read_noise_mv=0, dsnu_mv=0, prnu_percent=0)
        camera = Camera(case.lens, sensor)
        exposure_s = 0.33 * sensor.saturation_capacity_e / white_surface_electrons(camera, scene, 1.0)
        picture = shoot_portrait(camera, scene, exposure_s, 1).picture
        assert np.median(picture) == pytest.approx(wanted, abs=0.01)


def test_irradiance_follows_the_f_number(face) -> None:
    vendor, d200, wide = face.shots
    assert [shot.case.key for shot in face.shots] == ["vendor", "d200", "d200_f2.8"]

    def opening(shot) -> float:
        # The portrait's 0.5 m fills 256 pixels.
        m = 256 * shot.case.sensor().pixel.width_um.value * 1e-6 / 0.5
        return 1 / (1 + 4 * (shot.case.f_number * (1 + m)) ** 2)

    assert wide.white_e / d200.white_e == pytest.approx(opening(wide) / opening(d200), rel=1e-3)
    assert face.face_luminance_cd_m2 > 2 * 5.0
    assert vendor.shot.picture.shape == d200.shot.picture.shape == (300, 256, 3)


def test_noise_on_the_face_follows_the_noise_model(face) -> None:
    # 9 normal deviations; one seed in 1700 exceeds 4 standard errors by chance.
    for shot in face.shots:
        for entry in shot.shot.face.values():
            assert abs(entry.snr_db - entry.expected_db) < 4 * entry.standard_error_db
    vendor, d200, wide = (shot.shot.face["G"].snr_db for shot in face.shots)
    assert vendor + 15 < d200 < wide - 5


def test_dominant_noise_on_the_face(face) -> None:
    for shot in face.shots:
        signal, sensor = shot.shot.face["G"].mean_e, shot.shot.camera.sensor
        floor = (
            sensor.electrons(sensor.noise.read_noise_mv.value) ** 2 + sensor.electrons(sensor.noise.dsnu_mv.value) ** 2
        )
        light = signal + (sensor.noise.prnu_percent.value / 100 * signal) ** 2
        assert shot.read_dsnu_dominate_on_the_face == (floor > light)
    assert [shot.read_dsnu_dominate_on_the_face for shot in face.shots] == [True, True, False]


def test_results_are_finite_numbers_that_depend_on_the_seed(face) -> None:
    text = json.dumps(face.to_dict(), allow_nan=False)
    assert text == json.dumps(dim_face(2008).to_dict(), allow_nan=False)
    assert text != json.dumps(dim_face(2009).to_dict(), allow_nan=False)
