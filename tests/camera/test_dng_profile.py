"""The color matrix and the noise profile that raw frames carry."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import photosite as ps
from photosite.camera.dng_profile import color_matrix, noise_profile
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM
from photosite.color.tristimulus import color_matching_functions


def test_matrix_of_an_ideal_colorimeter_is_diagonal() -> None:
    """Channels with the responses of the CIE observer (per photon) need no mixing: XYZ to camera is diagonal."""
    grid = DEFAULT_WAVELENGTH_NM
    bars = color_matching_functions(grid) / grid
    bars *= 0.5 / bars.max()
    sensor = ps.load_sensor("nikon-d200")
    channels = {
        name: {"wavelength_nm": grid.tolist(), "quantum_efficiency": bar.tolist()}
        for name, bar in zip("RGB", bars, strict=True)
    }
    matrix = color_matrix(sensor.with_(channels=channels))
    assert matrix is not None
    scale = np.diag(matrix)
    np.testing.assert_allclose(matrix, np.diag(scale), atol=1e-9)
    np.testing.assert_allclose(scale, scale[0], rtol=1e-9)


def test_matrix_keeps_the_order_of_the_mosaic() -> None:
    sensor = ps.load_sensor("nikon-d200")
    rggb, gbrg = color_matrix(sensor), color_matrix(sensor.with_(cfa="gbrg"))
    assert rggb is not None
    assert gbrg is not None
    np.testing.assert_allclose(gbrg, rggb[[1, 2, 0]], rtol=1e-12)


def test_no_matrix_without_three_colours() -> None:
    sensor = ps.load_sensor("nikon-d200")
    gray = sensor.channels["G"].model_dump()
    assert color_matrix(sensor.with_(cfa="mono", channels={"M": gray})) is None
    assert color_matrix(sensor.with_(channels=dict.fromkeys("RGB", gray))) is None


def test_noise_profile_is_the_variance_of_frames() -> None:
    """Variance over the pixels of a flat field, scale s + offset: within 4.5 standard errors of 0.14 % (1e6 pixels).

    PRNU is 0, because the model has none. Three levels, each with a false alarm rate of 1e-5.
    """
    sensor = ps.load_sensor("nikon-d200").with_(rows=1000, cols=1000, prnu_percent=0, black_level_dn=64)
    sensor = sensor.with_(dark_voltage_mv_per_s=2)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    for level_e in (0, 400, 12_000):
        raw = camera.expose(np.full((1000, 1000), level_e, np.float32), 2.0, seed=1)
        assert raw.noise_profile is not None
        signal = (raw.dn - raw.black_level_dn) / (raw.white_level_dn - raw.black_level_dn)
        # The offset holds the dark current's noise; its mean is in the signal of this frame but not of the model's.
        dark = sensor.electrons(2) * 2.0 * sensor.system_gain_dn_per_e / (raw.white_level_dn - raw.black_level_dn)
        scale, offset = raw.noise_profile[0]
        expected = scale * (signal.mean() - dark) + offset
        assert abs(signal.var() / expected - 1) < 4.5 * np.sqrt(2 / signal.size)


def test_dng_contains_both(tmp_path: Path) -> None:
    sensor = ps.load_sensor("nikon-d200").with_(rows=24, cols=32)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    raw = camera.capture(ps.charts.uniform("A", 10), exposure_s=0.1)
    raw.save(tmp_path / "shot.dng")
    again = ps.read_raw(tmp_path / "shot.dng")
    np.testing.assert_allclose(again.color_matrix, color_matrix(sensor), rtol=1e-6)
    np.testing.assert_allclose(again.noise_profile, noise_profile(sensor, 0.1), rtol=1e-12)
