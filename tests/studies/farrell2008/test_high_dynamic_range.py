"""The scene of high dynamic range: light, wedge and dynamic range."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from photosite.scene.scene import Scene
from photosite.studies.farrell2008.high_dynamic_range import SHADE, STEPS, hdr_scene, high_dynamic_range


def test_light_of_the_scene() -> None:
    scene = hdr_scene()
    left, right = scene.weights[:, :300, :256], scene.weights[:, :300, 256:]
    np.testing.assert_allclose(right, SHADE * left, rtol=1e-6)
    for step, region in enumerate(scene.regions):
        inside = scene.weights[:, region.r0 : region.r1, region.c0 : region.c1]
        assert (inside == 0.5**step).all()
    white = Scene.uniform(scene.basis.sum(axis=0), scene.wavelength_nm)
    assert white.mean_luminance_cd_m2() == pytest.approx(2000.0, rel=1e-6)


def test_dynamic_range_by_hand(hdr) -> None:
    # Saturation: the converter's range above black, 4063 and 959 DN. Threshold: S^2 (1 - p^2) - S - floor = 0.
    by_hand = ((4063 * 7.98, (520 / 30) ** 2 + (550 / 30) ** 2, 0.01126), (959e4 / 1024, 45.8**2 + 60.0**2, 0.017))
    for shot, (range_e, floor_e2, prnu) in zip(hdr.shots, by_hand, strict=True):
        threshold = max(np.roots([1 - prnu**2, -1.0, -floor_e2]))
        assert shot.dynamic_range_db == pytest.approx(20 * math.log10(range_e / threshold), abs=1e-3)


def test_the_wedge_follows_the_noise_budget(hdr) -> None:
    # About 20 steps; one seed in 800 exceeds 4 standard errors by chance.
    for shot in hdr.shots:
        wedge = shot.wedge
        pairs = [
            (snr_db, error_db, expected_db)
            for snr_db, error_db, expected_db in zip(
                wedge.snr_db, wedge.standard_error_db, wedge.expected_db, strict=True
            )
            if snr_db is not None
        ]
        assert len(pairs) >= 9
        assert all(abs(s - x) < 4 * e for s, e, x in pairs if e < 1.0)
        np.testing.assert_allclose(wedge.mean_e[:8] / wedge.mean_e[0], 0.5 ** np.arange(8), rtol=0.02)
    d200, vendor = hdr.shots
    assert d200.steps_above(20.0) > vendor.steps_above(20.0) + 3
    assert d200.wedge.level.size == STEPS


def test_white_in_the_bright_light_is_just_below_saturation(hdr) -> None:
    for shot in hdr.shots:
        # Another channel than green may have the largest signal.
        fraction = shot.wedge.mean_e[0] / shot.sensor.saturation_capacity_e
        assert 0.4 < fraction <= 0.85 + 1e-3


def test_results_are_finite_numbers_that_depend_on_the_seed_only(hdr) -> None:
    text = json.dumps(hdr.to_dict(), allow_nan=False)
    assert text == json.dumps(high_dynamic_range(2008).to_dict(), allow_nan=False)
