"""The dimly lit face: its light, and the noise on it."""

from __future__ import annotations

import json

import pytest

from photosite.studies.farrell2008.dim_face import dim_face


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
