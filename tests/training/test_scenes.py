"""Pairs from pictures, charts and scenes through a lens."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.scene.scene import Scene
from photosite.studies.bench.pairs import WHITE_CD_M2, lens_electrons_by_numpy
from photosite.training import PairDataset, Scenes

LENS = ps.DiffractionLimited(f_number=2.8, focal_length_mm=4)
PICTURE = np.random.default_rng(3).integers(0, 256, (120, 150, 3)).astype(np.uint8)
SENSOR = ps.load_sensor("vendor-2.2um").with_(rows=64, cols=80)


def dataset(*scenes: Any, crop: tuple[int, int] = (32, 48), **settings: Any) -> PairDataset:
    of_pairs = {name: settings.pop(name) for name in ("crops", "light", "flips", "seed") if name in settings}
    given = {"exposure_s": 1 / 30, "unit": "electrons", **of_pairs}
    return PairDataset(Scenes(scenes, LENS, **settings), SENSOR, crop=crop, **given)


def test_the_clean_frame_of_a_whole_picture_is_the_cameras() -> None:
    white = 80.0
    sensor = SENSOR.with_(rows=32, cols=40)
    codes = PICTURE[:32, :40]
    scene = ps.pictures.from_rgb(codes, "D65")
    scene = scene.scaled(white / float(luminance_of_white(scene)))
    expected = ps.Camera(LENS, sensor).mean_electrons(scene, 1 / 30)
    pair = PairDataset(Scenes([codes], LENS, white_luminance_cd_m2=white), sensor, exposure_s=1 / 30, crop=(32, 40))[0]
    clean_e = (pair.clean - pair.metadata["black_level_dn"]) / pair.metadata["system_gain_dn_per_e"]
    assert clean_e == pytest.approx(expected, rel=2e-4, abs=0.02)


def test_the_lens_agrees_with_one_transform_pair_per_wavelength() -> None:
    """The plain way samples squares as large as pixels, with the aliases of their edges; its light is on the axis."""
    sensor = ps.load_sensor("vendor-2.2um")
    source = Scenes([PICTURE], LENS, white_luminance_cd_m2=WHITE_CD_M2)
    pair = PairDataset(source, sensor, crop=(64, 64), exposure_s=1 / 50, unit="electrons", seed=3)[0]
    corner = pair.metadata["image_row"], pair.metadata["image_col"]
    assert all(16 <= first <= side - 80 for first, side in zip(corner, PICTURE.shape, strict=False))
    expected = lens_electrons_by_numpy(PICTURE, corner, 64)
    assert np.abs(pair.clean - expected).max() < 1e-3 * expected.mean()


def luminance_of_white(scene: Scene) -> float:
    return Scene.uniform(scene.basis.sum(axis=0), scene.wavelength_nm).mean_luminance_cd_m2()


@pytest.mark.parametrize(("lens_blur", "tolerance"), [(True, 5e-3), (False, 1e-5)])
def test_a_patch_is_that_part_of_the_frame(lens_blur: bool, tolerance: float) -> None:
    """Light from around the patch reaches it through the lens, here over several pixels."""
    blurry, whole = ps.DiffractionLimited(f_number=11, focal_length_mm=4), SENSOR.with_(rows=120, cols=150)
    source = Scenes([PICTURE], blurry, lens_blur=lens_blur)
    settings = {"exposure_s": 1 / 3, "unit": "electrons"}
    frame = PairDataset(source, whole, crop=(120, 150), **settings)[0].clean
    checked = 0
    for pair in PairDataset(source, whole, crop=(32, 48), crops=24, seed=5, **settings):
        row, col = pair.metadata["image_row"], pair.metadata["image_col"]
        if row % 2 == col % 2 == 0:
            part = frame[row : row + 32, col : col + 48]
            assert np.abs(pair.clean - part).max() < tolerance * part.max()
            checked += 1
    assert checked > 3


def test_lights_and_scale_are_chosen_by_chance() -> None:
    lights = ("A", "D65", 5000.0)
    found = dataset(PICTURE, "macbeth", crops=12, illuminants=lights, samples_per_pixel=(0.5, 2.0), light=(0.5, 2.0))
    facts = [pair.metadata for pair in found]
    assert {fact["illuminant"] for fact in facts[:12]} == {fact["illuminant"] for fact in facts[12:]}
    assert len({fact["illuminant"] for fact in facts}) == 3
    assert len({fact["samples_per_pixel"] for fact in facts[:12]}) == 12
    assert {fact["scene"] for fact in facts} == {"picture 0", facts[-1]["scene"]}
    tungsten = [pair for pair in found if pair.metadata["illuminant"] == "A" and pair.metadata["image"] == 0]
    daylight = [pair for pair in found if pair.metadata["illuminant"] == "D65" and pair.metadata["image"] == 0]

    def blue_over_red(pairs: list[ps.training.Pair]) -> float:  # the tile is GB/RG
        return float(np.mean([pair.clean[::2, 1::2].mean() / pair.clean[1::2, ::2].mean() for pair in pairs]))

    assert blue_over_red(tungsten) < 0.6 * blue_over_red(daylight)


def test_files_are_read_when_they_are_used(tmp_path: Path) -> None:
    Image.fromarray(PICTURE).save(tmp_path / "a.png")
    ps.charts.slanted_edge(rows=80, cols=100).save(tmp_path / "edge.h5")
    from_files = dataset(tmp_path / "a.png", str(tmp_path / "edge.h5"), crops=2, seed=9)
    again = pickle.loads(pickle.dumps(from_files))
    in_memory = dataset(PICTURE, ps.read_scene(tmp_path / "edge.h5"), crops=2, seed=9)
    for one, other, third in zip(from_files, in_memory, again, strict=True):
        assert (one.noisy == other.noisy).all()
        assert (one.noisy == third.noisy).all()
    with ThreadPoolExecutor(4) as threads:
        for pair, index in zip(threads.map(again.__getitem__, range(4)), range(4), strict=True):
            assert (pair.noisy == in_memory[index].noisy).all()
    assert from_files.describe()["source"]["images"][0]["file"].endswith("a.png")
    assert from_files.describe() == again.describe()


@pytest.mark.slow
def test_memory_stays_flat_over_ten_thousand_items(tmp_path: Path) -> None:
    for number in range(20):
        Image.fromarray(PICTURE).save(tmp_path / f"{number}.png")
    files = sorted(tmp_path.iterdir())
    items = dataset(*files, crop=(16, 16), crops=500, illuminants=("A", "D65"), flips=True, lens_blur=False)
    order = np.random.default_rng(1).permutation(len(items))
    assert len(order) == 10_000
    used_mb = []
    for number, index in enumerate(order):
        _ = items[index]
        if number % 1000 == 999:
            used_mb.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6)
    assert max(used_mb) - used_mb[0] < 3.0


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: dataset(), "scenes"),
        (lambda: dataset("slantededge"), "no scene 'slantededge': it is neither a built-in scene nor a file"),
        (lambda: dataset(PICTURE[:, :, 0]), "picture"),
        (lambda: dataset(PICTURE, 3), "scenes[1]"),
        (lambda: dataset(PICTURE, illuminants="D65"), "illuminants"),
        (lambda: dataset(PICTURE, options={"contrast": 4}), "options"),
        (lambda: dataset(PICTURE, samples_per_pixel=(2, 1)), "samples_per_pixel"),
        (lambda: dataset(PICTURE, white_luminance_cd_m2=0), "white_luminance_cd_m2"),
        (lambda: PairDataset(Scenes([PICTURE], LENS), SENSOR), "the size of the patches is not given"),
        (lambda: PairDataset(Scenes([PICTURE], "lens"), SENSOR, crop=(8, 8)), "optics"),
    ],
)
def test_invalid_arguments(make: Callable[[], Any], what: str) -> None:
    with raises(InputError, what):
        make()
