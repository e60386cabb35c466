"""The camera compared with direct computation and an independent simulator; seeds, regions, errors."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

import photosite as ps
from photosite.camera.color_matrix import color_matrix
from photosite.camera.frame_fields import noise_profile
from photosite.color.colorimetry import color_matching_functions
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM
from photosite.engine.threads import ITEMS_PER_THREAD, thread_count, threads_for
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor

D200 = ps.load_sensor("nikon-d200")
LENS = DiffractionLimited(f_number=8, focal_length_mm=50)


def random_scene(rows: int, cols: int, seed: int = 1, count: int = 5) -> Scene:
    """Blocks of random colors over the D200's wavelengths."""
    rng = np.random.default_rng(seed)
    grid = np.arange(380.0, 781.0, 20)
    weights = np.kron(rng.random((count, rows // 4, cols // 4)), np.ones((4, 4)))
    return Scene(weights.astype(np.float32), 1e14 * rng.random((count, grid.size)), grid)


def per_wavelength(scene: Scene, lens: DiffractionLimited, sensor: Sensor, exposure_s: float) -> NDArray[np.float64]:
    """The oracle: one transform pair per wavelength in double precision, every folded term, no tables.

    The scene's samples are the sensor's pixels, and the frame is taken from its middle: far from the padding's edge.
    """
    rows, cols = scene.shape
    pitch = sensor.pixel.width_um.value * 1e-6
    side = pitch * math.sqrt(sensor.pixel.fill_factor.value)
    fy, fx = np.fft.fftfreq(rows, pitch)[:, None], np.fft.fftfreq(cols, pitch)[None, :]
    step = np.diff(scene.wavelength_nm)
    images = {name: np.zeros((rows, cols)) for name in "RGB"}
    for index, wavelength in enumerate(scene.wavelength_nm):
        radiance = np.tensordot(scene.basis[:, index], scene.weights.astype(np.float64), axes=1)
        transfer = np.zeros((rows, cols))
        for m in range(-4, 5):
            for n in range(-4, 5):
                y, x = fy + m / pitch, fx + n / pitch
                box = np.sinc(y * side) * np.sinc(x * side) * np.sinc(y * pitch) * np.sinc(x * pitch)
                transfer += lens.otf(np.hypot(y, x), wavelength, scene.distance_m) * box
        blurred = np.fft.ifft2(np.fft.fft2(radiance) * transfer).real
        irradiance = blurred * lens.irradiance_per_radiance(np.array([wavelength]), scene.distance_m)
        width = (step[max(index - 1, 0)] if index else 0) / 2 + (step[index] if index < step.size else 0) / 2
        for name, image in images.items():
            efficiency = sensor.channels[name].quantum_efficiency_at([wavelength])
            image += irradiance * efficiency * width * side**2 * exposure_s
    mosaic = np.empty((rows, cols))
    for (r, c), name in {(0, 0): "R", (0, 1): "G", (1, 0): "G", (1, 1): "B"}.items():
        mosaic[r::2, c::2] = images[name][r::2, c::2]
    return mosaic


@pytest.mark.parametrize("f_number", [2.8, 8.0])
def test_mean_electrons_equal_the_sum_over_wavelengths(f_number: float) -> None:
    """Within 1e-5 of full scale. The oracle is periodic, so the scene is repeated and its middle compared."""
    lens = DiffractionLimited(f_number=f_number, focal_length_mm=50)
    scene = random_scene(48, 64)
    tiled = Scene(np.tile(scene.weights, (1, 9, 9)), scene.basis, scene.wavelength_nm)
    oracle = per_wavelength(scene, lens, D200, 1 / 30)
    sensor = D200.with_(rows=9 * 48, cols=9 * 64)
    ours = ps.Camera(lens, sensor).mean_electrons(tiled, 1 / 30)[192:240, 256:320]
    assert np.abs(ours - oracle).max() < 1e-5 * oracle.max()


def test_reduction_of_maps_is_within_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    """The chart's 24 spectra as some ten maps, against all 24 as they are: within 1e-5 of full scale."""
    from photosite.camera import channel_transfers
    from photosite.camera import mean_image as mosaic

    camera = ps.Camera(LENS, D200.with_(rows=66, cols=98))
    made: list[int] = []
    plain = channel_transfers.reduced_transfers

    def counted(*arguments: object) -> object:
        reduced = plain(*arguments)  # type: ignore[arg-type]
        made.append(len(reduced[0].mixing))
        return reduced

    monkeypatch.setattr(mosaic, "reduced_transfers", counted)
    combined = camera.mean_electrons(ps.charts.macbeth(), 1 / 3)
    monkeypatch.setattr(channel_transfers, "TOLERANCE", 0.0)
    apart = camera.mean_electrons(ps.charts.macbeth(), 1 / 3)
    assert made[0] < 16
    assert made[1] == 24
    assert np.abs(combined - apart).max() < 1e-5 * apart.max()


def test_mean_electrons_are_never_negative_beside_an_edge() -> None:
    sensor = D200.with_(rows=64, cols=96)
    edge = ps.charts.slanted_edge("A", 40, contrast=math.inf, rows=64, cols=96)
    mean = ps.Camera(LENS, sensor).mean_electrons(edge, 1 / 3)
    assert mean.min() >= 0
    green = mean[1::2, ::2]
    assert (np.diff(green[10], axis=-1) > -1e-4 * green.max()).all()  # and do not ring: rising from dark to bright


@pytest.mark.parametrize("cells", [1, 3])
def test_light_is_conserved(cells: int) -> None:
    """The sum over pixels of a scene on black is the uniform field's electrons times its area."""
    grid = np.arange(400.0, 701.0, 10)
    weights = np.zeros((1, 64, 64), np.float32)
    weights[0, 24:40, 20:44] = np.random.default_rng(2).random((16, 24))
    mono = D200.with_(
        rows=64, cols=64, cfa="mono", channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}
    )
    camera = ps.Camera(LENS, mono, cells_per_pixel=cells)
    spectrum = np.full(grid.size, 1e15)
    even = camera.mean_electrons(Scene.uniform(spectrum, grid), 0.01)[0, 0]
    got = camera.mean_electrons(Scene(weights, spectrum[None], grid), 0.01).sum(dtype=np.float64)
    # The frame is padded by 32 pixels; the Airy tails that leave it reach the padding's far side, not the frame.
    lost = 1 - got / (even * weights.sum(dtype=np.float64))
    assert 0 <= lost < 2e-2


def test_image_of_a_point_is_the_psf_times_the_pixel() -> None:
    """Against direct integration of the Airy pattern over the photodetector and the source's cell, by fine sampling."""
    from scipy.signal import fftconvolve
    from scipy.special import j1

    wavelength, pitch_um, n = 550.0, 6.05, 15
    mono = D200.with_(
        rows=n, cols=n, cfa="mono", channels={"M": {"wavelength_nm": [wavelength], "quantum_efficiency": [0.5]}}
    )
    weights = np.zeros((1, n, n), np.float32)
    weights[0, 7, 7] = 1
    camera = ps.Camera(LENS, mono)
    scene = Scene(weights, np.array([[1e17]]), np.array([wavelength]))
    got = camera.mean_electrons(scene, 0.01)
    even = camera.mean_electrons(Scene.uniform([1e17], [wavelength]), 0.01)[0, 0]

    fine = 55  # points per pixel on each axis, odd
    x = np.arange(-8 * fine, 8 * fine + 1) * pitch_um / fine
    v = math.pi * np.hypot(x[:, None], x) / (wavelength * 1e-3 * LENS.working_f_number(1.2))
    v[v == 0] = 1e-12
    airy = (2 * j1(v) / v) ** 2 * math.pi / 4 / (wavelength * 1e-3 * LENS.working_f_number(1.2)) ** 2
    box = (np.abs(x) <= pitch_um / 2).astype(float) / fine
    side = math.sqrt(0.9) * pitch_um / 2
    detector = np.clip((side - np.abs(x)) / (pitch_um / fine) + 0.5, 0, 1)
    detector /= detector.sum()
    kernel = np.convolve(box, detector, mode="same")
    spread = fftconvolve(airy, kernel[:, None] * kernel[None, :], mode="same") * pitch_um**2
    expected = spread[8 * fine :: fine, 8 * fine :: fine][:5, :5]
    assert got[7:12, 7:12] / even == pytest.approx(expected, abs=1e-4)


def test_more_cells_converge_to_the_same_image() -> None:
    sensor = D200.with_(rows=48, cols=64)
    smooth = Scene.from_radiance(
        1e14 * (1.2 + np.sin(np.arange(64) / 9)[None, :, None] * np.ones((48, 1, 31))), np.arange(400.0, 701, 10)
    )
    one = ps.Camera(LENS, sensor).mean_electrons(smooth, 0.01)
    five = ps.Camera(LENS, sensor, cells_per_pixel=5).mean_electrons(smooth, 0.01)
    assert one == pytest.approx(five, rel=3e-3)


def test_agrees_with_an_independent_simulator(isetcam_results: Path) -> None:
    """ISETCam's electrons of 24 patches, within 0.1 %; its integrals use the rectangle rule."""
    facts = json.loads(isetcam_results.read_text())
    grid, case = facts["wavelength_nm"], facts["d200"]
    efficiency = np.array(case["quantum_efficiency_rgb"])
    channels = {
        name: {"wavelength_nm": grid, "quantum_efficiency": efficiency[:, i].tolist()} for i, name in enumerate("RGB")
    }
    sensor = D200.with_(rows=2, cols=2, channels=channels)
    lens = DiffractionLimited(case["f_number"], case["focal_length_m"] * 1e3)
    assert lens.irradiance_per_radiance(np.array([550.0]), 1.2)[0] == pytest.approx(
        case["result"]["irradiance_over_radiance"], rel=1e-6
    )
    camera = ps.Camera(lens, sensor, integration="rectangle")
    for radiance, expected in zip(case["patch_photon_radiance"], case["result"]["patch_electrons_rgb"], strict=True):
        scene = Scene.uniform(radiance, grid, distance_m=case["object_distance_m"])
        mean = camera.mean_electrons(scene, case["exposure_s"])
        assert [mean[0, 0], mean[0, 1], mean[1, 1]] == pytest.approx(expected, rel=1e-5)
    for radiance, expected in zip(case["patch_photon_radiance"], case["result"]["patch_luminance_cd_m2"], strict=True):
        assert ps.Scene.uniform(radiance, grid).mean_luminance_cd_m2("rectangle") == pytest.approx(expected, rel=1e-3)


def test_the_d200s_white_patch_fills_85_percent_of_the_well() -> None:
    """How the preset's quantum efficiency was scaled: 40 cd/m2, CIE A, f/8, 1/3 s; a field of the patch's spectrum."""
    chart = ps.charts.macbeth("A", 40)
    white = next(r for r in chart.regions if r.name == "white")
    field = Scene.uniform(chart.radiance(white.r0, white.c0), chart.wavelength_nm, chart.distance_m)
    mean = ps.Camera(LENS, D200.with_(rows=2, cols=2)).mean_electrons(field, 1 / 3)
    assert mean.max() == pytest.approx(0.85 * 36000, rel=1e-5)


def test_cos4_relative_illumination() -> None:
    sensor = D200.with_(rows=200, cols=300, width_um=60, height_um=60)
    lens = DiffractionLimited(8, 50, falloff="cos4")
    field = ps.charts.uniform("A", 40)
    flat = ps.Camera(LENS, sensor).mean_electrons(field, 0.01)
    fallen = ps.Camera(lens, sensor).mean_electrons(field, 0.01)
    image_distance_m = 0.05 * (1 + lens.magnification(field.distance_m))
    corner = math.atan(math.hypot(99.5 * 60e-6, 149.5 * 60e-6) / image_distance_m)
    assert fallen[0, 0] / flat[0, 0] == pytest.approx(math.cos(corner) ** 4, rel=1e-5)


def test_scene_to_scale_has_the_lens_magnification() -> None:
    sensor = D200.with_(rows=60, cols=60)
    grid = np.arange(400.0, 701, 10)
    weights = np.zeros((1, 10, 10), np.float32)
    weights[0, 3:7, 3:7] = 1
    width_m = 24 * 6.05e-6 / LENS.magnification(1.2)  # 24 pixels of image
    scene = Scene(weights, np.full((1, 31), 1e15), grid, width_m=width_m)
    mean = ps.Camera(LENS, sensor).mean_electrons(scene, 0.01)
    green = mean[1::2, ::2]
    bright = np.argwhere(green > green.max() / 2)
    assert abs((np.ptp(bright[:, 1]) + 1) * 2 - 9.6) <= 2


def test_missing_light_is_a_warning() -> None:
    field = Scene.uniform(np.full(11, 1e14), np.arange(500.0, 601, 10))
    with pytest.warns(PhotositeWarning, match="channel R's response lies outside the scene's wavelengths, 500 to"):
        ps.Camera(LENS, D200.with_(rows=2, cols=2)).mean_electrons(field, 0.01)


def test_negative_radiance_is_an_error() -> None:
    weights = np.ones((1, 8, 8), np.float32)
    weights[0, 4:] = -1
    scene = Scene(weights, np.full((1, 41), 1e14), np.arange(380.0, 781, 10))
    with raises(InputError, "the scene's radiance is negative"):
        ps.Camera(LENS, D200.with_(rows=8, cols=8)).mean_electrons(scene, 0.01)


SMALL = D200.with_(rows=40, cols=60, black_level_dn=64, dark_voltage_mv_per_s=1.0)
CAMERA = ps.Camera(LENS, SMALL)
CHART = ps.charts.macbeth(wavelength_nm=np.arange(380, 781, 40))


def test_seed_and_frame_number_determine_the_frame() -> None:
    a = CAMERA.capture(CHART, 1 / 3, seed=7)
    assert (a.dn == CAMERA.capture(CHART, 1 / 3, seed=7).dn).all()
    assert (a.dn != CAMERA.capture(CHART, 1 / 3, seed=8).dn).any()
    assert (a.dn != CAMERA.capture(CHART, 1 / 3, seed=7, frame=1).dn).any()
    assert a.exposure_s == 1 / 3


def test_new_process_gives_the_same_frame() -> None:
    code = (
        "import photosite as ps, hashlib;"
        "s = ps.load_sensor('nikon-d200').with_(rows=40, cols=60, black_level_dn=64, dark_voltage_mv_per_s=1.0);"
        "c = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), s);"
        "chart = ps.charts.macbeth(wavelength_nm=range(380, 781, 40));"
        "print(hashlib.sha256(c.capture(chart, 1 / 3, seed=7).dn.tobytes()).hexdigest())"
    )
    import hashlib

    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert printed == hashlib.sha256(CAMERA.capture(CHART, 1 / 3, seed=7).dn.tobytes()).hexdigest()


def test_automatic_exposure_leaves_room_for_the_dark_current() -> None:
    """1000 e-/s of light and 3000 e-/s of dark current fill 80 % of 10 000 electrons in 2 s, not in 8 s."""
    sensor = ps.load_sensor("vendor-2.2um").with_(rows=2, cols=2, black_level_dn=0)
    light = np.full((2, 2), 1000.0, np.float32)
    times = [ps.Camera(LENS, sensor.with_(dark_current_e_per_s=dark)).auto_exposure_s(light) for dark in (0.0, 3000.0)]
    assert times == [7.9, 1.9]  # (1023 / 1024 * 10 000 electrons), rounded down to two digits


@pytest.mark.parametrize("exposure_s", [0.0, -1.0, math.nan, math.inf])
def test_exposure_must_be_positive_and_finite(exposure_s: float) -> None:
    with raises(InputError, "exposure_s"):
        CAMERA.capture(CHART, exposure_s)


@pytest.mark.parametrize("exposure_s", ["1/3", True, None])
def test_exposure_must_be_a_number(exposure_s: object) -> None:
    with raises(InputError, "exposure_s"):
        CAMERA.capture(CHART, exposure_s)  # type: ignore[arg-type]
    with raises(InputError, "exposure_s"):
        next(CAMERA.stream(CHART, exposure_s))  # type: ignore[arg-type]


def test_too_long_exposure_is_an_error() -> None:
    """An error, without a NumPy warning before it."""
    exposure_s = 1e38
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for call in (lambda: CAMERA.capture(CHART, exposure_s), lambda: next(CAMERA.stream(CHART, [exposure_s]))):
            with pytest.raises(InputError) as caught:
                call()
            assert (caught.value.what, caught.value.value) == ("exposure_s", exposure_s)


@pytest.mark.parametrize("value", [-1, 2**64, 1.5, 1.0, "7", None, True])
@pytest.mark.parametrize("name", ["seed", "frame"])
def test_seed_and_frame_must_be_integers_in_range(name: str, value: object) -> None:
    with pytest.raises(InputError) as caught:
        CAMERA.expose(np.zeros((40, 60), np.float32), 0.01, **{name: value})  # type: ignore[arg-type]
    assert (caught.value.what, caught.value.value) == (name, value)


def test_numpy_integers_are_valid_seeds() -> None:
    for number in (np.uint64(2**64 - 1), np.int32(7)):
        CAMERA.expose(np.zeros((40, 60), np.float32), 0.01, seed=number)  # type: ignore[arg-type]


def test_mean_electrons_must_have_the_sensors_shape_and_be_finite_and_not_negative() -> None:
    mean = np.zeros((40, 60), np.float32)
    with pytest.raises(InputError) as caught:
        CAMERA.expose(mean[:2], 0.01)
    assert (caught.value.what, caught.value.value) == ("mean_electrons", (2, 60))
    for bad in (-1.0, np.nan, np.inf):
        mean[3, 4] = bad
        with pytest.raises(InputError) as caught:
            CAMERA.expose(mean, 0.01)
        assert caught.value.what == "mean_electrons"


def test_invalid_camera_options() -> None:
    with pytest.raises(InputError) as caught:
        ps.Camera(LENS, SMALL, cells_per_pixel=2)
    assert (caught.value.what, caught.value.value) == ("cells_per_pixel", 2)
    with pytest.raises(InputError) as caught:
        ps.Camera(LENS, SMALL, integration="simpson")
    assert caught.value.value == "simpson"


def test_region_equals_that_part_of_the_frame() -> None:
    camera = ps.Camera(LENS, SMALL.with_(dcnu_percent=30))
    mean = camera.mean_electrons(CHART, 1 / 3)
    whole = camera.expose(mean, 1 / 3, seed=7, frame=3)
    for region in ((0, 40, 0, 60), (3, 4, 7, 8), (11, 40, 1, 60), (0, 2, 58, 60)):
        r0, r1, c0, c1 = region
        part = camera.expose(mean, 1 / 3, seed=7, frame=3, region=region)
        assert (part.dn == whole.dn[r0:r1, c0:c1]).all()
        assert part.cfa[0][0] == whole.cfa[r0 % 2][c0 % 2]
    assert (camera.capture(CHART, 1 / 3, seed=7, frame=3, region=region).dn == part.dn).all()


@pytest.mark.parametrize("region", [(0, 41, 0, 60), (-1, 4, 0, 6), (5, 5, 0, 6), (0, 4, 9, 6)])
def test_region_must_be_on_the_chip(region: tuple[int, int, int, int]) -> None:
    with pytest.raises(InputError) as caught:
        CAMERA.expose(np.zeros((40, 60), np.float32), 1 / 3, region=region)
    assert (caught.value.what, caught.value.value) == ("region", region)


def test_stream_equals_captures() -> None:
    frames = list(CAMERA.stream(CHART, [1 / 30, 1 / 3], frames=2, seed=4, first_frame=10, region=(2, 9, 3, 21)))
    for n, (raw, exposure_s) in enumerate(zip(frames, [1 / 30, 1 / 30, 1 / 3, 1 / 3], strict=True)):
        alone = CAMERA.capture(CHART, exposure_s, seed=4, frame=10 + n, region=(2, 9, 3, 21))
        assert (raw.dn == alone.dn).all()
    with pytest.raises(InputError) as caught:
        next(CAMERA.stream(CHART, 0.1, frames=0))
    assert (caught.value.what, caught.value.value) == ("frames", 0)


def test_threads_do_not_change_a_frame() -> None:
    if thread_count() < 2:
        pytest.skip("this machine has one core")
    camera = ps.Camera(LENS, D200.with_(rows=450, cols=460, black_level_dn=64))  # large enough for two threads
    frames = []
    for threads in (1, 2):
        with threads_for(threads * ITEMS_PER_THREAD):
            frames.append(camera.capture(CHART, 1 / 3, seed=7).dn)
    assert (frames[0] == frames[1]).all()


def test_bright_light_saturates_and_too_bright_light_is_an_error() -> None:
    camera = ps.Camera(LENS, D200.with_(rows=24, cols=32))
    for luminance in (1e17, 1e19, 1e25):
        for scene in (ps.charts.uniform("A", luminance), ps.charts.ramp("A", luminance, contrast=2, rows=24, cols=32)):
            assert (camera.capture(scene, 1 / 3).dn == 4095).all()
    for scene in (ps.charts.uniform("A", 1e40), ps.charts.macbeth("A", 1e40)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with raises(InputError, "the scene's electrons per second in a pixel") as caught:
                camera.capture(scene, 1 / 3)
            assert float(str(caught.value.value)) > 1e30


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
