"""Cases about training pairs of 512 x 512: noise on given electrons, and pictures through a lens.

The baselines are the same physics in NumPy and SciPy: a patch of the light, one transform pair per wavelength for the
lens, Poisson and normal draws, fixed pattern, gain, converter, and the clean frame.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import integration_weights, photons_from_energy
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.picture_colors import plain_srgb
from photosite.scene.pictures import PICTURE_WAVELENGTH_NM, srgb_reflectance
from photosite.sensor.chip import draw_chip
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.timing import Case, in_turn, peak_mb
from photosite.training.dataset import PairDataset
from photosite.training.light import Electrons
from photosite.training.scenes import Scenes
from photosite.values.cfa import channel_sites

SIZE = 512
EXPOSURE_S, WHITE_CD_M2, MARGIN = 1 / 50, 100.0, 16
LENS = DiffractionLimited(f_number=2.8, focal_length_mm=4)

What = Literal["noise", "lens"]
Frames = tuple[NDArray[np.float32], NDArray[np.uint16]]


@lru_cache(maxsize=2)
def dataset(what: What, count: int = 1 << 20) -> PairDataset:
    """Return the dataset of a case: patches of an array of electrons, or of a picture through a lens."""
    rng, sensor = np.random.default_rng(1), load_sensor("vendor-2.2um")
    settings: dict[str, Any] = {
        "crop": (SIZE, SIZE),
        "crops": count,
        "flips": True,
        "seed": 1,
        "exposure_s": EXPOSURE_S,
    }
    if what == "noise":
        light = Electrons([rng.uniform(0, 4000, (1024, 1024)).astype(np.float32)])
        return PairDataset(light, sensor, light=(0.1, 1.0), **settings)
    picture = rng.integers(0, 256, (1024, 1024, 3)).astype(np.uint8)
    return PairDataset(Scenes([picture], LENS, white_luminance_cd_m2=WHITE_CD_M2), sensor, **settings)


def work(what: What, first: int = 0, count: int = 16) -> None:
    """Make some pairs."""
    pairs = dataset(what)
    for index in range(first, first + count):
        _ = pairs[index]


def noise_by_numpy(electrons: NDArray[np.float32], rng: np.random.Generator) -> Frames:
    """Return the clean and the noisy frame of a patch's electrons by NumPy, at a random place of the chip."""
    sensor = load_sensor("vendor-2.2um")
    response, offset_e, dark_e = _plain_chip()
    top, left = (2 * rng.integers(0, (size - SIZE) // 2 + 1) for size in (sensor.array.rows, sensor.array.cols))
    place = slice(top, top + SIZE), slice(left, left + SIZE)
    gain, black = np.float32(sensor.system_gain_dn_per_e), np.float32(sensor.readout.black_level_dn.value)
    well, white = np.float32(sensor.pixel.well_capacity_e.value), np.float32(sensor.white_level_dn)
    drawn = rng.poisson(electrons * response[place] + dark_e).astype(np.float32)
    np.minimum(drawn, well, out=drawn)
    drawn += offset_e[place]
    read_noise_e = sensor.electrons(sensor.noise.pixel_noise_mv)
    drawn += rng.standard_normal(electrons.shape, np.float32) * np.float32(read_noise_e)
    noisy = np.clip(np.rint(drawn * gain + black), 0, white).astype(np.uint16)
    return np.minimum(np.minimum(electrons, well) * gain + black, white), noisy


@lru_cache(maxsize=1)
def _plain_chip() -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
    chip = draw_chip(load_sensor("vendor-2.2um"))
    return 1 + chip.prnu.map(), chip.offset_e.map(), float(chip.dark_rate_e_per_s.mean()) * EXPOSURE_S


def noise_pair_by_numpy(image: NDArray[np.float32], rng: np.random.Generator) -> Frames:
    """Return a pair as those of the case "noise" by NumPy."""
    row, col = rng.integers(0, image.shape[0] - SIZE, 2)
    return noise_by_numpy(image[row : row + SIZE, col : col + SIZE] * np.float32(rng.uniform(0.1, 1.0)), rng)


def lens_pair_by_numpy(picture: NDArray[np.uint8], rng: np.random.Generator) -> Frames:
    """Return a pair as those of the case "lens" by NumPy and SciPy: one transform pair per wavelength."""
    row, col = rng.integers(MARGIN, picture.shape[0] - SIZE - MARGIN, 2)
    return noise_by_numpy(lens_electrons_by_numpy(picture, (int(row), int(col))), rng)


def lens_electrons_by_numpy(
    picture: NDArray[np.uint8], corner: tuple[int, int], size: int = SIZE
) -> NDArray[np.float32]:
    """Return (size, size) mean electrons of the patch of a picture that begins at a row and a column."""
    sensor, grid, wide = load_sensor("vendor-2.2um"), PICTURE_WAVELENGTH_NM, size + 2 * MARGIN
    row, col = (place - MARGIN for place in corner)
    weights = plain_srgb(picture[row : row + wide, col : col + wide] / 255.0).astype(np.float32)
    photons = photons_from_energy(illuminant("D65", grid), grid)
    photons = photons * (WHITE_CD_M2 / float(luminance_cd_m2(photons, grid)))
    irradiance = srgb_reflectance() * photons * LENS.irradiance_per_radiance(grid, 1.2)
    cfa, step = sensor.array.cfa, integration_weights(grid)
    area_m2 = sensor.pixel_area_m2 * sensor.pixel.fill_factor.value
    rate = np.zeros((size, size), np.float32)
    responses = {name: sensor.response_at(name, grid) for name in sensor.channel_names}
    padded, transfers = _plain_transfers(wide)
    for number in range(len(grid)):
        radiance = weights @ irradiance[:, number].astype(np.float32)
        spectrum = scipy.fft.rfft2(radiance, s=(padded, padded), workers=-1)
        spectrum *= transfers[number]
        blurred = scipy.fft.irfft2(spectrum, s=(padded, padded), workers=-1, overwrite_x=True)
        inside = blurred[MARGIN : MARGIN + size, MARGIN : MARGIN + size]
        for name, response in responses.items():
            gain = np.float32(response[number] * step[number] * area_m2)
            for r, c in channel_sites(cfa, name):
                rate[r :: len(cfa), c :: len(cfa[0])] += gain * inside[r :: len(cfa), c :: len(cfa[0])]
    return np.maximum(rate, 0) * np.float32(EXPOSURE_S)


@lru_cache(maxsize=1)
def _plain_transfers(wide: int) -> tuple[int, list[NDArray[np.float32]]]:
    """Return the size of the transforms, and the transfer function of lens, pixel and picture at each wavelength.

    The samples of a picture are squares as large as pixels. Their edges have spatial frequencies above half of the
    sampling frequency, which pixels alias to lower ones: the transfer function is a sum over the aliases.
    """
    sensor, padded = load_sensor("vendor-2.2um"), scipy.fft.next_fast_len(wide, real=True)
    pitch_m = sensor.pixel.width_um.value * 1e-6
    side_m = (sensor.pixel_area_m2 * sensor.pixel.fill_factor.value) ** 0.5
    transfers = [np.zeros((padded, padded // 2 + 1), np.float32) for _ in PICTURE_WAVELENGTH_NM]
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            fy = np.fft.fftfreq(padded, pitch_m)[:, None] + down / pitch_m
            fx = np.fft.rfftfreq(padded, pitch_m)[None, :] + across / pitch_m
            squares = np.sinc(fy * side_m) * np.sinc(fx * side_m) * np.sinc(fy * pitch_m) * np.sinc(fx * pitch_m)
            for transfer, wavelength_nm in zip(transfers, PICTURE_WAVELENGTH_NM, strict=True):
                transfer += squares * LENS.otf(np.hypot(fy, fx), wavelength_nm, 1.2)
    return padded, transfers


def pairs_noise(quick: bool = False) -> Case:
    """64 pairs from given electrons, against NumPy's draws of the same physics."""
    rng, image = np.random.default_rng(2), np.asarray(dataset("noise").source.images[0])  # type: ignore[attr-defined]
    return _case("noise", 64, lambda: [noise_pair_by_numpy(image, rng) for _ in range(64)], 3 if quick else 7)


def pairs_lens(quick: bool = False) -> Case:
    """16 pairs from a picture through a lens, against one transform pair per wavelength and NumPy's draws."""
    rng, picture = np.random.default_rng(2), np.asarray(dataset("lens").source.scenes[0])  # type: ignore[attr-defined]
    lens_pair_by_numpy(picture, rng)  # computes the transfer functions
    # One pair of the plain way takes long, and its time is that of each.
    case = _case("lens", 16, lambda: lens_pair_by_numpy(picture, rng), 1 if quick else 3)
    return Case(case.seconds, 16 * case.baseline_seconds, case.peak_mb, case.megapixels)


def _case(what: What, count: int, baseline: Callable[[], object], repeats: int) -> Case:
    work(what, 0, 2)  # compiles the kernels
    first = iter(range(0, 1 << 20, count))
    ours, theirs = in_turn(lambda: work(what, next(first), count), baseline, repeats)
    return Case(ours, theirs, peak_mb(work, what=what, count=count), count * SIZE**2 / 1e6)
