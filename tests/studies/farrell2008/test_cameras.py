"""The virtual cameras of the study, and the parameters that the simulation knows."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene import charts
from photosite.studies.farrell2008.cameras import (
    CASES,
    D200,
    FILL_FACTOR_BELOW,
    UNEVENNESS,
    VENDOR,
    Case,
    DefocusedLens,
    HiddenTruth,
    MeasuredCamera,
    unevenly_lit,
)

IDEAL = DiffractionLimited(f_number=8, focal_length_mm=50)


def test_a_lens_without_wavefront_error_is_ideal() -> None:
    f = np.linspace(0, 1.2 * IDEAL.cutoff_per_m(550.0, 1.2), 201)
    assert DefocusedLens(8, 50, wavefront_error_waves=0.0).otf(f, 550.0, 1.2) == pytest.approx(
        IDEAL.otf(f, 550.0, 1.2), abs=1e-13
    )


@pytest.mark.parametrize("nm", [400.0, 550.0, 700.0])
def test_strehl_ratio_is_that_of_defocus(nm: float) -> None:
    """Strehl ratio of defocus W, in waves at the rim: (sin(pi W) / (pi W))^2, from the volume of the OTF."""
    w = np.sqrt(12) * 0.06 * 550 / nm
    f = np.linspace(0, IDEAL.cutoff_per_m(nm, 1.2), 4001)
    ideal, real = (
        np.sum(entry.otf(f, nm, 1.2) * f) for entry in (IDEAL, DefocusedLens(8, 50, wavefront_error_waves=0.06))
    )
    assert real / ideal == pytest.approx(np.sinc(w) ** 2, abs=2e-6)


def test_defocus_lowers_the_otf_and_keeps_the_light() -> None:
    lens = DefocusedLens(8, 50, wavefront_error_waves=0.06)
    r = np.array([0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0, 1.5]) * IDEAL.cutoff_per_m(550.0, 1.2)
    ideal, real = (entry.otf(r, 550.0, 1.2) for entry in (IDEAL, lens))
    assert real[0] == pytest.approx(1.0, abs=1e-13)
    assert (real[1:6] < ideal[1:6]).all()
    assert (real[6:] == 0).all()
    grid = np.array([500.0, 600.0])
    assert (lens.irradiance_per_radiance(grid, 1.2) == IDEAL.irradiance_per_radiance(grid, 1.2)).all()
    assert lens.magnification(1.2) == IDEAL.magnification(1.2)


@pytest.mark.parametrize("waves", [-0.1, float("nan")])
def test_an_invalid_wavefront_error_is_rejected(waves: float) -> None:
    with pytest.raises(InputError) as caught:
        DefocusedLens(8, 50, wavefront_error_waves=waves)
    assert caught.value.what == "wavefront_error_waves"


@pytest.mark.parametrize("angle", [0.0, 90.0, 200.0])
def test_uneven_light_keeps_its_mean_and_rises_towards_the_lamp(angle: float) -> None:
    even = charts.macbeth()
    lit = unevenly_lit(even, 0.03, angle)
    patches = even.weights.any(axis=0)
    light = lit.weights.sum(axis=0)
    assert (light[~patches] == 0).all()
    assert light[patches].mean() == pytest.approx(1, abs=1e-6)
    assert np.ptp(light[patches]) == pytest.approx(0.03, abs=1e-6)
    rows, cols = np.nonzero(patches)
    side = np.cos(np.radians(angle)) * (cols - cols.mean()) + np.sin(np.radians(angle)) * (rows - rows.mean())
    assert np.corrcoef(side, light[patches])[0, 1] > 0.8
    with pytest.raises(InputError) as caught:
        unevenly_lit(even, 1.0, angle)
    assert caught.value.what == "unevenness"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.key)
def test_the_measured_camera_differs_in_hidden_parameters_only(case: Case) -> None:
    measured = MeasuredCamera(case, 7)
    nominal, real = case.camera(measured.truth.fill_factor).sensor, measured.sensor()
    assert nominal.serial != real.serial
    assert nominal.with_(serial=real.serial) == real
    assert measured.chart().mean_luminance_cd_m2() == pytest.approx(case.chart().mean_luminance_cd_m2(), rel=0.01)
    light, ideal = measured.chart().weights.sum(axis=0), case.chart().weights.sum(axis=0)
    assert np.ptp(light[ideal > 0]) == pytest.approx(UNEVENNESS, abs=1e-6)


def test_hidden_parameters_are_near_the_paper_and_differ_between_seeds() -> None:
    truths = [HiddenTruth.drawn(VENDOR, seed) for seed in range(50)]
    below = 0.5 - np.array([truth.fill_factor for truth in truths])
    assert ((below >= 0) & (below <= FILL_FACTOR_BELOW)).all()
    assert np.ptp(below) > 0.05
    assert len({truth.serial for truth in truths}) == 50
    assert HiddenTruth.drawn(D200, 3).lamp_angle_deg != HiddenTruth.drawn(VENDOR, 3).lamp_angle_deg


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.key)
def test_the_brightest_patch_does_not_saturate(case: Case) -> None:
    """Largest possible fill factor at the brightest spot of the lamp, plus three standard deviations."""
    electrons = float(case.camera(case.paper_fill_factor).mean_electrons(case.chart(), case.exposure_s).max())
    bright, noise = electrons * (1 + UNEVENNESS / 2), case.sensor().noise
    spread = np.hypot(np.sqrt(bright), noise.prnu_percent.value / 100 * bright)
    assert bright + 3 * spread < case.sensor().saturation_capacity_e


def test_signal_is_proportional_to_luminance_and_frames_differ() -> None:
    measured = MeasuredCamera(VENDOR, 7)
    (dim,), bright = measured.shoot(5.0), measured.shoot(40.0, frames=2)
    black = dim.black_level_dn
    assert (bright[0].dn.mean() - black) / (dim.dn.mean() - black) == pytest.approx(8, rel=0.01)
    assert (bright[0].dn != bright[1].dn).any()
