"""Maps of other programs: units and places by independent readers, round trips, errors, and localization."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from raising import raises
from scipy.io import loadmat, savemat
from scipy.special import erf

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.sensor.io.camera_maps import MAP_FORMS, CameraMaps, camera_maps, sensor_of_chip
from photosite.sensor.io.sensor_file import load_measured_chip, write_sensor
from photosite.sensor.readout import digital_numbers, read_frame
from photosite.sensor.shot import Shot

ROUNDING_DN2 = 1 / 12
SHAPE = (176, 187)


def scmos(shape: tuple[int, int] = SHAPE) -> ps.MeasuredChip:
    """An sCMOS camera as in Huang et al. 2013: variances with a long tail, gains that differ by 10 %."""
    rng = np.random.default_rng(3)
    maps = {
        "offset_dn": rng.normal(0, 4, shape),
        "read_noise_dn": np.sqrt(3 + rng.exponential(60, shape)),
        "pixel_gain_dn_per_e": 2.2 * rng.normal(1, 0.1, shape).clip(0.6, 1.4),
    }
    return ps.MeasuredChip(
        **{name: values.astype(np.float32) for name, values in maps.items()},
        black_level_dn=100.0,
        system_gain_dn_per_e=2.2,
    )


def base() -> ps.Sensor:
    sensor = ps.load_sensor("nikon-d200").with_(
        cfa="mono", channels={"M": {"wavelength_nm": [500], "quantum_efficiency": [0.7]}}, bits=16, prnu_percent=0
    )
    return sensor.with_(dark_voltage_mv_per_s=0)


@pytest.fixture(scope="module")
def chip() -> ps.MeasuredChip:
    return scmos()


def test_units_of_each_form(tmp_path: Path, chip: ps.MeasuredChip) -> None:
    """Each program's own formula gives electrons above the offset and the variance in electrons, for each pixel."""
    offset = 100 + chip.offset_dn.astype(float)
    variance = chip.read_noise_dn.astype(float) ** 2 + ROUNDING_DN2
    gain = chip.pixel_gain_dn_per_e.astype(float)
    numbers = offset + 3 * gain  # 3 electrons in each pixel

    def file(name: str, suffix: str) -> Path:
        path = tmp_path / f"{name}{suffix}"
        ps.write_camera_maps(chip, path, name)
        return path

    # smite, convertToPhotons.m: (RawData - CameraOffset) ./ CameraGain, CameraNoise ./ CameraGain.^2
    params = loadmat(file("smite", ".mat"), simplify_cells=True)["Params"]
    assert_allclose((numbers - params["CCDOffset"]) / params["Gain"], 3, rtol=1e-4)
    assert_allclose(params["CCDVar"] / params["Gain"] ** 2, variance / gain**2, rtol=1e-5)
    assert params["CameraObj"]["ROI"].tolist() == [1, 1, *SHAPE]
    # SMAP, CameraConverter.m and makegainoffsetCMOS.m: (image - offsetmap) * gainmap, varmap .* gainmap.^2
    smap = loadmat(file("smap", ".mat"))
    assert_allclose((numbers - smap["offsetmap"]) * smap["gainmap"], 3, rtol=1e-4)
    assert_allclose(smap["varmap"] * smap["gainmap"] ** 2, variance / gain**2, rtol=1e-5)
    # Accent: row by row, gain in ADU per electron; SMAP takes 1 / gain.
    accent = json.loads(file("accent", ".calb").read_text())
    assert (accent["width"], accent["height"]) == (SHAPE[1], SHAPE[0])
    assert_allclose((numbers.ravel() - accent["baseline"]) / accent["gain"], 3, rtol=1e-4)
    assert_allclose(accent["rnSq"], variance.ravel(), rtol=1e-5)
    # GDSC SMLM, CameraModelManager.java: bias, gain (count/photon), variance (count^2), float slices.
    pages = tifffile.imread(file("gdsc", ".tif"))
    assert pages.dtype == np.float32
    assert_allclose((numbers - pages[0]) / pages[1], 3, rtol=1e-4)
    assert_allclose(pages[2], variance, rtol=1e-5)
    with tifffile.TiffFile(tmp_path / "gdsc.tif") as stack:
        assert stack.imagej_metadata["Labels"] == ["Bias", "Gain", "Variance"]
    # PYME, remFitBuf.py: (image - dark) * flatfield in ADU times ElectronsPerCount; variance in electrons^2.
    folder = file("pyme", "")
    per_count = float((folder / "metadata.yaml").read_text().split("ElectronsPerCount: ")[1].split()[0])
    dark, flat, noise = (tifffile.imread(folder / f"{name}.tif") for name in ("dark", "flatfield", "variance"))
    assert_allclose((numbers - dark) * flat * per_count, 3, rtol=1e-4)
    assert_allclose(noise, variance / gain**2, rtol=1e-5)
    # DECODE, camera.py: noise is added in electrons, then divided by e_per_adu.
    folder = file("decode", "")
    assert_allclose(np.load(folder / "read_sigma.npy"), np.sqrt(variance) / gain, rtol=1e-5)
    assert f"e_per_adu: {float(1 / np.median(gain))!r}" in (folder / "camera.yaml").read_text()


@pytest.mark.parametrize("singly", [False, True])
@pytest.mark.parametrize("form", MAP_FORMS)
def test_round_trip(tmp_path: Path, chip: ps.MeasuredChip, form: str, singly: bool) -> None:
    """The file, the folder, or the files in the folder: the same numbers, with units and signs."""
    path = tmp_path / f"maps{(MAP_FORMS[form].suffixes or ('',))[0]}"
    ps.write_camera_maps(chip, path, form)
    files = [file for file in path.iterdir() if file.suffix != ".yaml"] if singly and path.is_dir() else [path]
    again = ps.read_camera_maps(files).chip()
    offset, gain = 100 + chip.offset_dn.astype(float), chip.pixel_gain_dn_per_e.astype(float)
    noise_e = chip.read_noise_dn / gain
    if form == "decode":  # one offset and one gain
        offset, gain = np.full(SHAPE, np.median(offset)), np.full(SHAPE, np.median(gain))
        noise_e = np.sqrt((chip.read_noise_dn**2 + ROUNDING_DN2) / chip.pixel_gain_dn_per_e**2 - ROUNDING_DN2 / gain**2)
    assert again.black_level_dn == pytest.approx(np.median(offset), rel=1e-6)
    assert_allclose(again.offset_dn + again.black_level_dn, offset, rtol=1e-6)
    assert_allclose(again.read_noise_dn, noise_e * gain, rtol=1e-4)
    assert_allclose(again.pixel_gain_dn_per_e, gain, rtol=1e-6)


@pytest.mark.parametrize("form", MAP_FORMS)
def test_dark_current_of_an_exposure_comes_back_once(tmp_path: Path, form: str) -> None:
    """8 DN/s over 0.5 s: in offset and variance, or beside them where a form has the rate itself."""
    flat = dict.fromkeys(("offset_dn", "read_noise_dn", "dark_rate_dn_per_s"), np.zeros((4, 6), np.float32))
    flat["dark_rate_dn_per_s"] = np.full((4, 6), 8, np.float32)
    warm = ps.MeasuredChip(**flat, black_level_dn=100.0, system_gain_dn_per_e=2.0)
    path = tmp_path / f"maps{(MAP_FORMS[form].suffixes or ('',))[0]}"
    ps.write_camera_maps(warm, path, form, exposure_s=0.5)
    maps = ps.read_camera_maps([path])
    rate = 0.0 if maps.dark_rate_dn_per_s is None else maps.dark_rate_dn_per_s
    assert_allclose(maps.offset_dn + 0.5 * rate, 104, rtol=1e-6)
    assert_allclose(maps.variance_dn2 + 0.5 * rate * maps.gain_dn_per_e, 1 / 12 + 8, rtol=1e-6)


def test_settings_of_pyme_and_decode(tmp_path: Path, chip: ps.MeasuredChip) -> None:
    """The gain is EM gain over electrons per count; a stated gain stands for that of the settings."""
    ps.write_camera_maps(chip, tmp_path / "pyme", "pyme")
    settings = tmp_path / "pyme" / "metadata.yaml"
    maps = [tmp_path / "pyme" / f"{name}.tif" for name in ("variance", "flatfield")]
    stated = ps.read_camera_maps([*maps, settings])
    doubled = ps.read_camera_maps(maps, gain_dn_per_e=2 * float(np.median(stated.gain_dn_per_e)))
    assert_allclose(doubled.gain_dn_per_e, 2 * stated.gain_dn_per_e, rtol=1e-6)
    assert_allclose(doubled.variance_dn2, 4 * stated.variance_dn2, rtol=1e-6)
    settings.write_text(settings.read_text().replace("TrueEMGain: 1.0", "TrueEMGain: 50"))
    assert_allclose(ps.read_camera_maps([settings.parent]).gain_dn_per_e, 50 * stated.gain_dn_per_e, rtol=1e-6)
    settings.write_text("Camera.ElectronsPerCount: -0.5")
    with raises(FileError, "Camera.ElectronsPerCount", value=-0.5):
        ps.read_camera_maps([settings.parent])
    settings.unlink()
    with raises(InputError, "a variance in electrons needs the gain"):
        ps.read_camera_maps(maps)
    ps.write_camera_maps(chip, tmp_path / "decode", "decode")
    (tmp_path / "decode" / "camera.yaml").unlink()
    with raises(InputError, "a variance in electrons needs the gain"):
        ps.read_camera_maps([tmp_path / "decode"])
    with raises(FileError, "has no file of maps"):
        ps.read_camera_maps([tmp_path])


def test_dark_current_adds_to_offset_and_variance(chip: ps.MeasuredChip) -> None:
    from dataclasses import replace

    warm = replace(chip, dark_rate_dn_per_s=np.full(SHAPE, 8, np.float32))
    cold, maps = camera_maps(chip), camera_maps(warm, 0.5)
    assert_allclose(maps.offset_dn - cold.offset_dn, 4, rtol=1e-12)
    assert_allclose(maps.variance_dn2 - cold.variance_dn2, 4 * chip.pixel_gain_dn_per_e, rtol=1e-6)
    without = replace(chip, pixel_gain_dn_per_e=None, system_gain_dn_per_e=None)
    with raises(InputError, "the maps have no gain"):
        camera_maps(without)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_files_of_single_maps(tmp_path: Path, chip: ps.MeasuredChip, version: str) -> None:
    """As in Huang et al.: a file for each map, of any variable name; MATLAB 7.3 stores columns first."""
    maps = {"variance": chip.read_noise_dn**2, "gain": chip.pixel_gain_dn_per_e}
    for name, values in maps.items():
        if version == "5":
            savemat(tmp_path / f"{name}.mat", {"x": values, "n": 3})
            continue
        with h5py.File(tmp_path / f"{name}.mat", "w", userblock_size=512) as file:
            file["x"] = values.T
        with open(tmp_path / f"{name}.mat", "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    found = ps.read_camera_maps([tmp_path / "variance.mat", tmp_path / "gain.mat"])
    assert found.offset_dn is None
    assert_allclose(found.variance_dn2, maps["variance"], rtol=1e-6)
    assert_allclose(found.chip().pixel_gain_dn_per_e, maps["gain"], rtol=1e-6)


def test_files_that_are_no_maps(tmp_path: Path) -> None:
    ones = np.ones((4, 6), np.float32)
    np.save(tmp_path / "abc.npy", ones)
    np.save(tmp_path / "gain.npy", ones)
    np.save(tmp_path / "variance.npy", np.ones((4, 5)))
    np.save(tmp_path / "offset.npy", np.where(ones.cumsum().reshape(4, 6) == 9, np.nan, ones))
    (tmp_path / "gain.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    (tmp_path / "a.calb").write_text('{"width": 3}')
    for names, what in (
        (["abc.npy"], "it is not clear which map it has: abc"),
        (["gain.npy", "variance.npy"], "the map of the variance"),
        (["offset.npy"], "the map of the offset in 1 of 24 pixels, first pixel (1, 2)"),
        (["gain.mat"], "cannot be read as a MATLAB file"),
        (["a.calb"], "is not a calibration of Accent: 'height' is missing"),
    ):
        with raises(FileError, what):
            ps.read_camera_maps([tmp_path / name for name in names])
    with raises(InputError, "the map of the gain"):
        ps.read_camera_maps([tmp_path / "gain.npy"] * 2)
    with raises(InputError, "a chip needs the map of the variance"):
        ps.read_camera_maps([tmp_path / "gain.npy"]).chip()
    with raises(FileError, "the map of the gain in 24 of 24 pixels", value=0.0, expected="above 0"):
        np.save(tmp_path / "gain.npy", 0 * ones)
        ps.read_camera_maps([tmp_path / "gain.npy"])


@pytest.mark.parametrize("base", ["sony-imx174", "nikon-d200"])
@pytest.mark.parametrize("known_gain", [True, False])
def test_sensors_in_volts_and_in_electrons_take_maps(base: str, known_gain: bool) -> None:
    maps = CameraMaps(variance_dn2=np.full((4, 6), 4.0), gain_dn_per_e=np.full((4, 6), 2.5) if known_gain else None)
    stated = ps.load_sensor(base)
    made = sensor_of_chip(maps.chip(), stated)
    gain = 2.5 if known_gain else stated.system_gain_dn_per_e
    assert made.system_gain_dn_per_e == pytest.approx(gain)
    assert made.noise.read_noise_mv.value / made.mv_per_dn == pytest.approx(np.sqrt(4.0 - 1 / 12))


def test_defective_pixels_of_published_maps_have_the_median(tmp_path: Path) -> None:
    gain = np.full((30, 40), 2.2)
    gain[3, 4], gain[5, 6], gain[7, 8] = -0.05, 0.0, np.nan
    variance = np.full((30, 40), 4.0)
    variance[9, 9] = np.inf
    np.save(tmp_path / "calib.npy", np.stack([np.full((30, 40), 100.0), variance, gain]))  # storm-analysis
    found = ps.read_camera_maps([tmp_path / "calib.npy"])
    assert np.array_equal(found.gain_dn_per_e, np.full((30, 40), 2.2))
    assert np.array_equal(found.variance_dn2, np.full((30, 40), 4.0))
    assert "gain: 3 pixels, first pixel (3, 4), have no value that is above 0; they have the median" in found.notes
    assert found.chip().black_level_dn == 100.0


@pytest.mark.parametrize("role", ["variance", "read_sigma"])
def test_no_variance_is_negative(role: str, tmp_path: Path) -> None:
    """A pixel has the median; a whole map of another sign is refused."""
    values = np.full((30, 40), 4.0)
    values[9, 9] = -1.0
    np.save(tmp_path / f"{role}.npy", values)
    found = ps.read_camera_maps([tmp_path / f"{role}.npy"], gain_dn_per_e=1.0)
    assert np.ptp(found.variance_dn2) == 0.0
    assert any("first pixel (9, 9)" in note for note in found.notes)
    np.save(tmp_path / f"{role}.npy", -values)
    with pytest.raises(FileError):
        ps.read_camera_maps([tmp_path / f"{role}.npy"], gain_dn_per_e=1.0)


def mean_frame(sensor: ps.Sensor, chip: ps.MeasuredChip, light_e: NDArray[Any], frames: int) -> tuple[Any, Any]:
    """Mean and variance of each pixel over frames."""
    stack = np.stack([read_frame(sensor, chip, light_e, 0.01, Shot(seed=1, frame=k)) for k in range(frames)])
    return stack.mean(axis=0), stack.var(axis=0, ddof=1)


@pytest.mark.parametrize("effects", [False, True])
def test_frames_have_the_gain_of_each_pixel(effects: bool) -> None:
    """Photon transfer of each pixel: the variance of 400 frames over the mean, by both ways to make a frame."""
    chip = scmos((24, 30))
    sensor = sensor_of_chip(chip, base())
    if effects:
        sensor = sensor.with_(interpixel_capacitance={"coupling_percent": 0})
    light = np.full(chip.shape, 400, np.float32)
    mean, variance = mean_frame(sensor, chip, light, 400)
    gain = chip.pixel_gain_dn_per_e.astype(float)
    signal = mean - 100 - chip.offset_dn
    noise2 = chip.read_noise_dn.astype(float) ** 2 + ROUNDING_DN2
    # 720 pixels of 400 frames: 4.5 standard errors of the mean, and of the regression of relative deviations.
    assert_allclose((signal / gain).mean(), 400, atol=4.5 * np.sqrt(408 / 400 / 720))
    photon = (variance - noise2) / 400 / gain.mean() ** 2
    slope = np.polyfit((gain / gain.mean() - 1).ravel(), photon.ravel(), 1)[0]
    assert slope == pytest.approx(2.0, abs=4.5 * np.sqrt(2 / 400) / (gain.std() / gain.mean()) / np.sqrt(720) * 1.2)
    assert np.corrcoef(signal.ravel(), gain.ravel())[0, 1] > 0.9


def spot(x: Any, y: Any, total: Any, background: Any, sigma: float, cols: Any, rows: Any) -> tuple[Any, Any]:
    """Mean electrons of the pixels of Gaussian spots (spots, pixels), and derivatives by x, y, total, background."""
    root = np.sqrt(2) * sigma

    def line(at: Any, place: Any) -> tuple[Any, Any]:
        low, high = (place[None] - 0.5 - at[:, None]) / root, (place[None] + 0.5 - at[:, None]) / root
        change = (np.exp(-(low**2)) - np.exp(-(high**2))) / (np.sqrt(2 * np.pi) * sigma)
        return 0.5 * (erf(high) - erf(low)), change

    (across, dx), (down, dy) = line(x, cols), line(y, rows)
    mean = total[:, None] * across * down + background[:, None]
    slopes = [total[:, None] * dx * down, total[:, None] * across * dy, across * down, np.ones_like(mean)]
    return mean, np.stack(slopes, axis=1)


def fitted(electrons: Any, noise_e2: Any, start: Any, sigma: float, cols: Any, rows: Any) -> tuple[Any, Any]:
    """Maximum-likelihood fit of Huang et al. 2013, eqs. 5 and 6, by Fisher scoring, and its Cramer-Rao bound of x."""
    found = start.copy()
    data = np.maximum(electrons + noise_e2, 1e-3)
    for _ in range(30):
        mean, slopes = spot(*found.T, sigma, cols, rows)
        weight = 1 / (mean + noise_e2)
        score = ((data * weight - 1)[:, None] * slopes).sum(axis=-1)
        information = np.einsum("spn,sqn,sn->spq", slopes, slopes, weight)
        step = np.linalg.solve(information, score[..., None])[..., 0]
        found += np.clip(step, [-0.5, -0.5, -100, -5], [0.5, 0.5, 100, 5])
        found[:, 2:] = np.maximum(found[:, 2:], [10.0, 0.05])
    return found, np.sqrt(np.linalg.inv(information)[:, 0, 0])


def test_spots_are_localized_to_the_cramer_rao_bound(tmp_path: Path) -> None:
    """Oracle: 5440 spots on a simulated sCMOS camera, fitted with the maps of a file, scatter as the bound says.

    The standard error of a standard deviation of 5440 is 1 %. The same fit with the mean variance and gain of the chip
    scatters by 10 % more than the bound.
    """
    size, sigma, chip = 11, 1.3, scmos()
    sensor_file, file = tmp_path / "scmos.sensor.yaml", tmp_path / "maps.mat"
    write_sensor(sensor_of_chip(chip, base()), sensor_file, chip)
    sensor = ps.load_sensor(sensor_file)
    ps.write_camera_maps(load_measured_chip(sensor), file, "smap")
    maps = loadmat(file)  # as SMAP and its fitter read it
    cells = [(r, c) for r in range(0, SHAPE[0], size) for c in range(0, SHAPE[1], size)]
    rows, cols = (axis.ravel().astype(float) for axis in np.indices((size, size)))
    rng = np.random.default_rng(8)
    errors: dict[str, list[Any]] = {"maps": [], "means": []}
    for frame in range(20):
        truth = np.stack(
            [*rng.uniform(4.5, 5.5, (2, len(cells))), rng.uniform(150, 500, len(cells)), np.full(len(cells), 4.0)]
        )
        mean, _ = spot(*truth, sigma, cols, rows)
        light = np.zeros(SHAPE, np.float32)
        for (r, c), values in zip(cells, mean, strict=True):
            light[r : r + size, c : c + size] = values.reshape(size, size)
        numbers = digital_numbers(sensor, light, 0.01, seed=2, frame=frame).astype(float)
        uniform = {name: np.full(SHAPE, values.mean()) for name, values in maps.items() if not name.startswith("__")}
        for kind, used in (("maps", maps), ("means", uniform)):
            electrons = (numbers - used["offsetmap"]) * used["gainmap"]
            noise_e2 = used["varmap"] * used["gainmap"] ** 2
            cut = [np.stack([m[r : r + size, c : c + size].ravel() for r, c in cells]) for m in (electrons, noise_e2)]
            start = truth.T + rng.normal(0, [0.3, 0.3, 30, 0.5], (len(cells), 4))
            found, bound = fitted(*cut, start, sigma, cols, rows)
            errors[kind].append((found[:, 0] - truth[0]) / (bound if kind == "maps" else errors["bound"][-1]))
            if kind == "maps":
                errors.setdefault("bound", []).append(bound)
    scatter = {kind: float(np.concatenate(errors[kind]).std()) for kind in ("maps", "means")}
    assert scatter["maps"] == pytest.approx(1.0, abs=0.05)
    assert scatter["means"] > 1.05
