"""Pairs from electrons and raw frames: reproducible, of the sensor's noise, where the input has some too."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.engine.random_numbers import seed_of_added_noise
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.chip import MeasuredChip, no_blinking, no_defects
from photosite.sensor.model import Sensor
from photosite.training import Electrons, InputNoise, PairDataset, RawFrames

RAMP = np.linspace(0, 3000, 64 * 96, dtype=np.float32).reshape(64, 96)
FRAME = RawFrame(np.zeros((2, 2), np.uint16), bits=12)


def quiet(**changes: Any) -> Sensor:
    """A small chip without fixed pattern, of 4 e- read noise, black level 100."""
    given = {"bits": 15, "black_level_dn": 100, "dsnu_mv": 0, "prnu_percent": 0, "read_noise_e": 4.0}
    return ps.load_sensor("nikon-d200").with_(rows=64, cols=96, **given | changes)


def pairs(**settings: Any) -> PairDataset:
    given = {"crop": (32, 48), "crops": 3, "draws": 2, "light": (0.1, 1.0), "exposure_s": (0.001, 1.0), "flips": True}
    return PairDataset(Electrons([RAMP, RAMP[::-1]]), quiet(), **given | settings)


def test_an_item_depends_on_seed_and_index_alone() -> None:
    one, other = pairs(seed=3), pickle.loads(pickle.dumps(pairs(seed=3)))
    assert len(one) == 2 * 3 * 2
    backward = [other[k] for k in reversed(range(len(other)))][::-1]
    for a, b in zip(one, backward, strict=True):
        assert (a.noisy == b.noisy).all()
        assert (a.clean == b.clean).all()
        assert a.metadata == b.metadata
    assert (one[4].clean == one[5].clean).all()
    assert (one[4].noisy != one[5].noisy).any()
    assert (one[-1].noisy == one[11].noisy).all()
    assert one[0].metadata["light"] != pairs(seed=4)[0].metadata["light"]
    lights = [pair.metadata["light"] for pair in one]
    assert len(set(lights)) == 6
    assert 0.1 <= min(lights) < max(lights) <= 1
    with pytest.raises(IndexError):
        one[12]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_gives_the_same_items(tmp_path: Path) -> None:
    dataset = pairs(crop=(64, 96))
    here = dataset[0].noisy  # starts the threads that a forked process does not have
    if (child := os.fork()) == 0:
        np.save(tmp_path / "there.npy", dataset[0].noisy)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert (np.load(tmp_path / "there.npy") == here).all()


def test_importing_a_dataset_does_not_import_torch() -> None:
    code = "import photosite.training, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def variance_and_mean(frames: np.ndarray, truth: float) -> tuple[float, float]:
    return float(np.mean((frames - truth) ** 2)), float(frames.mean())


@pytest.mark.parametrize("level_e", [0.0, 5.0, 900.0])
def test_noise_of_exact_light_is_the_sensors(level_e: float) -> None:
    dataset = PairDataset(Electrons([np.full((64, 96), level_e)]), quiet(), draws=20)
    clean, _, facts = dataset[0]
    variance, mean = variance_and_mean(np.stack([pair.noisy for pair in dataset]), float(clean[0, 0]))
    expected = facts["noise_slope_dn"] * (clean[0, 0] - facts["black_level_dn"]) + facts["noise_offset_dn2"]
    assert variance == pytest.approx(expected, rel=0.02)
    tolerance = 4 * (variance / (20 * 64 * 96)) ** 0.5
    assert mean == pytest.approx(facts["black_level_dn"] + facts["system_gain_dn_per_e"] * level_e, abs=tolerance)


@pytest.mark.parametrize(
    ("level_e", "light", "frames"), [(0.0, 0.5, 1), (3.0, 0.7, 1), (2000.0, 0.25, 1), (1000.0, 1.0, 8)]
)
def test_noise_of_noisy_light_is_completed_to_the_sensors(level_e: float, light: float, frames: int) -> None:
    source = quiet(read_noise_e=3.0)
    rng, own = np.random.default_rng(5), InputNoise.of_sensor(source, frames)
    size = (20, 64, 96)
    seen = rng.normal(rng.poisson(level_e * frames, size) / frames, own.floor_e2**0.5).astype(np.float32)
    target = quiet(bits=14)
    dataset = PairDataset(Electrons(list(seen), InputNoise(1 / frames, own.floor_e2)), target, light=light)
    # With the random numbers of the added noise, so that the means differ little by chance.
    same = {"seed": seed_of_added_noise(0), "draws": 20}
    exact = PairDataset(Electrons([np.full((64, 96), level_e)]), target, light=light, **same)
    truth = float(exact[0].clean[0, 0])
    found, wanted = (variance_and_mean(np.stack([p.noisy for p in data]), truth) for data in (dataset, exact))
    assert found[0] == pytest.approx(wanted[0], rel=0.03)
    assert found[1] == pytest.approx(wanted[1], abs=0.05)
    residual = np.stack([pair.clean for pair in dataset]) - truth
    facts, gain = dataset[0].metadata, target.system_gain_dn_per_e
    expected = gain**2 * (facts["own_shot"] * level_e * light + facts["own_floor_e2"])
    assert residual.var() == pytest.approx(expected, rel=0.03)


def test_added_noise_is_not_that_of_a_virtual_frame_of_the_same_seed() -> None:
    """The correlation of independent noise of 6144 pixels has a standard deviation of 0.013; 0.06 is 4.7 of them."""
    sensor = quiet()
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    raw = camera.expose(np.full((64, 96), 8000.0, np.float32), 0.01)
    pair = PairDataset(RawFrames([raw], sensor), sensor, light=0.5)[0]
    added = pair.noisy - pair.clean
    assert abs(np.corrcoef(pair.clean.ravel(), added.ravel())[0, 1]) < 0.06


def test_light_that_is_noisier_than_the_sensor_is_refused() -> None:
    noisy = Electrons([RAMP], InputNoise(1.0, 64.0))
    with raises(InputError, "light") as caught:
        PairDataset(noisy, quiet(), light=(0.1, 0.6))
    assert caught.value.expected.startswith("at most 0.5")
    PairDataset(noisy, quiet(), light=(0.1, 0.49))
    with raises(InputError, "input_noise"):
        PairDataset(noisy, quiet(em_gain={"gain": 10}), light=0.1)


def test_raw_frames_by_their_noise_profile_or_their_sensor(tmp_path: Path) -> None:
    bayer = ps.load_sensor("nikon-d200").with_(rows=64, cols=96, black_level_dn=64)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), bayer)
    raw = camera.expose(np.full((64, 96), 9000.0, np.float32), 0.01, seed=2)
    raw.save(tmp_path / "a.dng")
    darker = bayer.with_(read_noise_e=20)
    for source in (RawFrames([tmp_path / "a.dng"]), RawFrames([raw]), RawFrames([raw], bayer)):
        (pair,) = PairDataset(source, darker, light=0.1)
        electrons = (pair.clean - 64) / pair.metadata["system_gain_dn_per_e"]
        assert electrons.mean() == pytest.approx(900, rel=0.01)
        assert pair.metadata["own_shot"] == pytest.approx(0.1)
        assert pair.metadata["input_saturated"] == 0
    mono = RawFrame(raw.dn, bits=12, black_level_dn=64, noise_profile=raw.noise_profile[:1])
    with raises(InputError, "cfa"):
        PairDataset(RawFrames([mono]), darker, light=0.1)


def test_flips_keep_the_color_filter_array() -> None:
    sensor = quiet()
    tile = np.array(sensor.array.cfa)
    values = {"R": 100.0, "G": 200.0, "B": 300.0}
    mosaic = np.array([[values[tile[r % 2, c % 2]] for c in range(96)] for r in range(64)], np.float32)
    mosaic += np.arange(96) / 1000  # increases along a row
    dataset = PairDataset(Electrons([mosaic]), sensor, crop=(16, 20), crops=12, flips=True, unit="electrons")
    turned = set()
    for pair in dataset:
        assert pair.clean[:16, :20].round() == pytest.approx(mosaic[:16, :20].round())
        reversed_cols = pair.metadata["flipped_cols"]
        assert (pair.clean[0, 0] > pair.clean[0, 2]) == reversed_cols
        turned.add((pair.metadata["flipped_rows"], reversed_cols))
    assert len(turned) == 4


def test_a_patch_has_the_fixed_pattern_of_its_place(tmp_path: Path) -> None:
    offset = np.arange(64 * 96, dtype=np.float32).reshape(64, 96) / 8
    still = np.zeros((64, 96), np.float32)
    chip = MeasuredChip(
        offset_dn=offset,
        offset_uncertainty_dn=still,
        read_noise_dn=still,
        read_noise_freedom=9,
        black_level_dn=100.0,
        system_gain_dn_per_e=None,
        reference_exposure_s=0.01,
        defects=no_defects(),
        blinking=no_blinking(),
    )
    sensor = quiet()
    sensor.save(tmp_path / "a.sensor.yaml")
    sensor.with_(maps=chip.save(tmp_path / "a.maps.h5")).save(tmp_path / "a.sensor.yaml")
    measured = ps.load_sensor(tmp_path / "a.sensor.yaml")
    for pair in PairDataset(Electrons([np.zeros((32, 32))]), measured, draws=1, crops=4):
        row, col = pair.metadata["chip_row"], pair.metadata["chip_col"]
        assert pair.noisy == pytest.approx(100 + offset[row : row + 32, col : col + 32], abs=0.51)


def test_sensors_with_effects_and_captures() -> None:
    light = Electrons([np.full((16, 16), 2000.0)])
    register = quiet(em_gain={"gain": 10}, well_capacity_e=100_000)
    (pair,) = PairDataset(light, register, light=0.01)
    assert pair.noisy.mean() == pytest.approx(pair.clean.mean(), rel=0.02)
    assert pair.metadata["chip_row"] + 16 <= 64


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: pairs(crop=(33, 48)), "crop"),
        (lambda: pairs(crop=(640, 48)), "crop"),
        *((lambda crop=crop: pairs(crop=crop), "crop") for crop in (32, "32x48", (32.5, 48), (-2, 48), (32, 48, 3))),
        (lambda: pairs(light=(1.0, 0.1)), "light"),
        (lambda: pairs(light="1"), "light"),
        (lambda: pairs(light=(0.1, 0.5, 1.0)), "light"),
        (lambda: pairs(exposure_s="1/100"), "exposure_s"),
        (lambda: pairs(exposure_s=(0.1, 0.01)), "exposure_s"),
        (lambda: pairs(draws=0), "draws"),
        (lambda: pairs(seed=-1), "seed"),
        (lambda: pairs(unit="volts"), "unit"),
        (lambda: pairs(crops=2**31), "images x crops x draws"),
        (lambda: Electrons([-RAMP]), "images[0]"),
        (lambda: Electrons(RAMP), "images"),
        (lambda: pairs(crop=(64, 98))[0], "crop"),
        (lambda: PairDataset(Electrons([RAMP]), "nikon-d200"), "sensors"),
        (lambda: PairDataset([RAMP], quiet()), "source"),
        (lambda: RawFrames([FRAME], "nikon-d200"), "sensor"),
        (lambda: RawFrames([FRAME], averaged=1.5), "averaged"),
        (lambda: RawFrames([3]), "frames[0]"),
        (lambda: RawFrames([]), "frames"),
        (lambda: RawFrames([FRAME]), "a raw frame has no noise profile"),
    ],
)
def test_invalid_arguments(make: Callable[[], Any], what: str) -> None:
    with raises(InputError, what):
        make()


@pytest.mark.parametrize("index", [1.0, "1", slice(0, 2)])
def test_items_are_asked_for_by_whole_numbers(index: Any) -> None:
    with pytest.raises(TypeError):
        pairs()[index]
    assert (pairs()[np.int64(1)].noisy == pairs()[1].noisy).all()


@pytest.mark.parametrize("name", ["nikon-d200", "vendor-1.4um", "dual-gain-phone"])
def test_the_white_level_is_that_of_simulated_frames(name: str) -> None:
    """Where wells fill before the converter saturates, it is below the range of the converter."""
    sensor = ps.load_sensor(name).with_(rows=8, cols=8)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    frame = camera.expose(np.zeros((8, 8), np.float32), 0.01, seed=0)
    facts = PairDataset(Electrons([np.zeros((8, 8))]), sensor)[0].metadata
    assert facts["white_level_dn"] == frame.white_level_dn
