"""Polarizers: Malus' law in the simulation, and Stokes parameters measured back."""

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.develop.polarization import stokes, stokes_matrix
from photosite.errors import InputError, PhotositeWarning
from photosite.frames.raw_frame import RawFrame
from photosite.scene.scene import Scene
from photosite.sensor.assumed_channels import assumed_channels
from photosite.values.cfa import NAMED, channel_mask, channel_names

GRID = np.arange(400.0, 701.0, 10.0)


def camera_of(tile="polarization", rows=48, cols=64, **polarizers):
    channels = assumed_channels(channel_names(NAMED[tile]), 0.6)
    for name, changes in polarizers.items():
        channels[name] = channels[name].model_copy(update=changes)
    sensor = ps.load_sensor("sony-imx174").with_(
        rows=rows, cols=cols, cfa=tile, channels=channels, infrared_filter=_only_visible(), black_level_dn=64
    )
    return ps.Camera(ps.DiffractionLimited(f_number=4, focal_length_mm=12), sensor)


def _only_visible():
    return {"wavelength_nm": [350, 400, 401, 699, 700, 1100], "transmittance": [0, 0, 1, 1, 0, 0]}


def field(cd_m2=300.0):
    return ps.charts.uniform("D65", cd_m2)


def channel_means(image, cfa):
    return {name: float(image[channel_mask(cfa, name, image.shape)].mean()) for name in channel_names(cfa)}


def test_pixels_follow_malus_law():
    camera = camera_of(P45={"polarization_angle_deg": 47.0, "extinction_ratio": 9.0})
    cfa, names = camera.sensor.array.cfa, ("P0", "P45", "P90", "P135")
    plain = channel_means(camera.mean_electrons(field(), 0.01), cfa)
    assert plain["P45"] == pytest.approx(plain["P0"], rel=1e-6)
    for angle_deg in (0.0, 20.0, 47.0, 137.0, 160.0):
        seen = channel_means(camera.mean_electrons(field().polarized(1.0, angle_deg), 0.01), cfa)
        for name, axis_deg, ratio in zip(names, (0, 47, 90, 135), (300, 9, 300, 300), strict=True):
            along = np.cos(np.radians(angle_deg - axis_deg)) ** 2
            expected = 2 * (ratio * along + (1 - along)) / (ratio + 1)
            assert seen[name] / plain[name] == pytest.approx(expected, abs=1e-6)


def test_a_map_of_the_polarization_is_blurred_as_the_light_is():
    """Each channel sees an unpolarized scene of the light that its polarizer passes."""
    camera = camera_of(rows=24, cols=32)
    rng = np.random.default_rng(4)
    degree, angle_deg = rng.uniform(0, 1, (6, 8)), rng.uniform(0, 180, (6, 8))
    scene = Scene(rng.uniform(0.2, 1, (1, 6, 8)), np.full((1, GRID.size), 1e16), GRID)
    found = camera.mean_electrons(scene.polarized(degree, angle_deg), 0.01)
    for name, channel in camera.sensor.channels.items():
        turn = np.radians(2 * (angle_deg - channel.polarization_angle_deg))
        passed = scene.weights * (1 + 299 / 301 * degree * np.cos(turn))
        alone = camera.mean_electrons(Scene(passed, scene.basis, GRID), 0.01)
        at = channel_mask(camera.sensor.array.cfa, name, found.shape)
        np.testing.assert_allclose(found[at], alone[at], rtol=1e-4)


@pytest.mark.parametrize("tile", ["polarization", "polarization-rggb"])
def test_degree_and_angle_come_back_within_their_noise(tile):
    changed = {"P0": {"extinction_ratio": 6.0, "polarization_angle_deg": 4.0}} if tile == "polarization" else {}
    camera = camera_of(tile, **changed)
    sensor, color = camera.sensor, "P" if tile == "polarization" else "G"
    cfa, gain = sensor.array.cfa, sensor.system_gain_dn_per_e
    for degree, angle_deg, seed in ((0.0, 0.0, 1), (0.1, 170.0, 2), (0.5, 20.0, 3), (0.9, 65.0, 4)):
        raw = camera.capture(field().polarized(degree, angle_deg), 0.004, seed=seed)
        assert raw.dn.max() < raw.white_level_dn
        seen = stokes(raw, color, sensor)
        s0, s1, s2 = (float(part.mean()) for part in (seen.s0, seen.s1, seen.s2))
        # Error of the means, from the noise of the channels' means; the fixed pattern is part of it.
        masks = {name: channel_mask(cfa, name, raw.shape) for name in channel_names(cfa) if name.startswith(color)}
        variance = np.array([raw.dn[mask].var() / mask.sum() for mask in masks.values()])
        assert s0 > 100 * gain
        matrix = stokes_matrix(
            *zip(
                *[(c.polarization_angle_deg, c.extinction_ratio) for c in (sensor.channels[name] for name in masks)],
                strict=True,
            )
        )
        error = np.sqrt(np.diag(np.linalg.pinv(matrix) @ np.diag(variance) @ np.linalg.pinv(matrix).T))
        true = degree * np.array([np.cos(2 * np.radians(angle_deg)), np.sin(2 * np.radians(angle_deg))])
        assert np.abs(np.array([s1, s2]) - s0 * true).max() < 4 * 1.5 * error[1:].max()
        if degree:
            spread_deg = np.degrees(error[1:].max() / (2 * degree * s0))
            assert abs((np.degrees(np.arctan2(s2, s1)) / 2 - angle_deg + 90) % 180 - 90) < 6 * spread_deg
            assert np.hypot(s1, s2) / s0 == pytest.approx(degree, abs=6 * error[1:].max() / s0)
            middle = np.s_[4:-4, 4:-4]
            assert np.median(seen.dolp[middle]) == pytest.approx(degree, abs=0.05)


def test_saturated_pixels_have_no_polarization():
    dn = np.full((12, 12), 500, np.uint16)
    dn[6, 6] = 4095
    seen = stokes(RawFrame(dn, bits=12, cfa=NAMED["polarization"]))
    assert np.isnan(seen.dolp[5:8, 5:8]).all()
    assert np.isfinite(seen.dolp).sum() == 144 - 9
    np.testing.assert_allclose(seen.dolp[:4], 0, atol=1e-6)
    np.testing.assert_allclose(seen.s0[:4], 1000, rtol=1e-6)


def test_a_sensor_without_the_channels_is_an_error():
    raw = ps.RawFrame(np.full((8, 8), 100, np.uint16), bits=12, cfa=NAMED["polarization"])
    with pytest.raises(InputError) as error:
        ps.stokes(raw, sensor=ps.load_sensor("nikon-d200"))
    assert (error.value.what, error.value.value) == ("sensor", "Nikon D200")


def test_what_has_no_stokes_parameters():
    with raises(InputError, "cfa", where="stokes", value="R, G, B"):
        stokes(RawFrame(np.ones((8, 8), np.uint16), bits=12, cfa=NAMED["rggb"]))
    with raises(InputError, "cfa", where="stokes", value="P0, P90"):
        stokes(RawFrame(np.ones((8, 8), np.uint16), bits=12, cfa=(("P0", "P90"),)))
    with raises(InputError, "color", expected="one of B, G, R"):
        stokes(RawFrame(np.ones((8, 8), np.uint16), bits=12, cfa=NAMED["polarization-rggb"]))
    with raises(InputError, "extinction_ratio", value=20.0):
        ps.load_sensor("sony-imx174").with_(
            channels={"M": {"wavelength_nm": [500], "quantum_efficiency": [0.5], "extinction_ratio": 20.0}}
        )


def test_polarization_of_scenes(tmp_path):
    scene = Scene(np.ones((1, 3, 4)), np.full((1, GRID.size), 1e14), GRID)
    with raises(InputError, "degree", where="polarization"):
        scene.polarized(1.1, 0.0)
    with raises(InputError, "polarization", value=(2, 4)):
        scene.polarized(np.ones((2, 4)), 0.0)
    with raises(InputError, "degree, angle_deg", where="polarization"):
        scene.polarized(np.ones((3, 4)), np.zeros(4))
    for degree in (0.25, np.linspace(0, 1, 12).reshape(3, 4)):
        scene.polarized(degree, 30.0).save(tmp_path / "s.h5")
        kept = ps.read_scene(tmp_path / "s.h5").polarization
        np.testing.assert_array_equal(kept.stokes, scene.polarized(degree, 30.0).polarization.stokes)
    with pytest.warns(PhotositeWarning, match="polarization"):
        scene.polarized(0.5, 0.0).save(tmp_path / "s.tif")
