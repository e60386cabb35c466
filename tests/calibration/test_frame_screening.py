"""Half-read, black, white and lit frames are left out or refused; drifting lamps and saturation are accepted."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction import checkpoint, frame_reader
from photosite.calibration.reduction.frame_screening import (
    BLOCKS,
    SIDE,
    find_near_copies,
    find_outlier_frames,
    sample_grid,
)
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource

ROWS, COLS = 64, 80
STACK = ("light", 0.006)
PAIR = ("light", 0.004)
DARKS = ("dark", 0.006)
DARK_PAIR = ("dark", 0.012)

Frames = dict[tuple[str, float], list[NDArray[np.uint16]]]


@dataclass
class Chip:
    """12 bits, black level 60 DN, 0.5 DN/e-, light that falls off by 10 %."""

    seed: int
    lamp: float = 0.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, 77])
        y, x = np.mgrid[-1 : 1 : ROWS * 1j, -1 : 1 : COLS * 1j]
        self.light = (1.0 - 0.05 * (x * x + y * y)) * self.rng.normal(1.0, 0.01, (ROWS, COLS))
        self.offset = self.rng.normal(60.0, 2.0, (ROWS, COLS))

    def frame(self, electrons: float) -> NDArray[np.uint16]:
        drift = 1.0 + self.lamp * self.rng.normal()
        light = self.rng.poisson(np.maximum(electrons * drift * self.light, 0.0))
        dn = self.offset + 0.5 * light + self.rng.normal(0.0, 2.5, light.shape)
        return np.clip(np.rint(dn), 0, 4095).astype(np.uint16)

    def frames(self) -> Frames:
        result = {DARKS: [self.frame(20.0) for _ in range(16)], DARK_PAIR: [self.frame(25.0) for _ in range(2)]}
        for t in np.array([1, 2, 3, 4, 6, 8, 10, 12]) / 1000:
            count = 16 if ("light", t) == STACK else 2
            result["light", float(t)] = [self.frame(20.0 + 0.72e6 * t) for _ in range(count)]
        return result


def frame_set(frames: Frames) -> FrameSet:
    groups = [
        FrameGroup(kind, t, tuple(FrameSource(f"{kind}-{t:g}-{i}", lambda dn=dn: dn) for i, dn in enumerate(stack)))
        for (kind, t), stack in frames.items()
    ]
    return FrameSet(tuple(groups), ROWS, COLS, 12)


def half_black(dn: NDArray[np.uint16]) -> NDArray[np.uint16]:
    dn = dn.copy()
    dn[50:] = 0
    return dn


def last_rows_black(dn: NDArray[np.uint16]) -> NDArray[np.uint16]:
    dn = dn.copy()
    dn[-ROWS // BLOCKS :] = 0
    return dn


BREAK = {
    "half black": half_black,
    "last rows black": last_rows_black,
    "black": np.zeros_like,
    "white": lambda dn: np.full_like(dn, 4095),
    "lit": lambda dn: dn + np.uint16(60 if dn.mean() < 200 else 1500),
}


@pytest.mark.parametrize(
    ("group", "kind"),
    [
        (STACK, "half black"),
        (STACK, "last rows black"),
        (STACK, "white"),
        (STACK, "lit"),
        (DARKS, "lit"),
        (DARKS, "black"),
    ],
)
def test_one_broken_frame_of_many_is_left_out(kind: str, group: tuple[str, float]) -> None:
    frames, others = Chip(1).frames(), Chip(1).frames()
    frames[group][5] = BREAK[kind](frames[group][5])
    del others[group][5]
    calibration = calibrate(frame_set(frames))
    assert len(calibration.rejected) == 1
    assert calibration.rejected[0].startswith(
        f"{group[0]}-0.006-5 differs from the other {group[0]} frames at 0.006 s:"
    )
    assert limits(calibration)["frames-left-out"] == 1
    assert len(calibration.frames_used) == sum(map(len, others.values()))
    clean = calibrate(frame_set(others))
    assert clean.rejected == ()
    for name in ("read_noise_dn", "system_gain_dn_per_e", "dsnu_dn", "prnu_percent", "saturation_dn"):
        found, right = getattr(calibration, name), getattr(clean, name)
        assert found.value == pytest.approx(right.value, rel=0.01), name


@pytest.mark.parametrize("kind", BREAK)
@pytest.mark.parametrize("group", [PAIR, DARK_PAIR])
def test_a_pair_that_differs_is_refused(kind: str, group: tuple[str, float]) -> None:
    frames = Chip(2).frames()
    frames[group][1] = BREAK[kind](frames[group][1])
    name = f"{group[0]}-{group[1]:g}"
    with pytest.raises(CalibrationError) as caught:
        calibrate(frame_set(frames))
    assert caught.value.what.startswith(f"{name}-0, {name}-1 differ from each other far beyond noise")
    assert "\n" not in str(caught.value)


def test_two_of_four_are_not_a_majority() -> None:
    frames = Chip(3).frames()
    frames[STACK] = [*frames[STACK][:2], *map(half_black, frames[STACK][2:4])]
    with pytest.raises(CalibrationError) as caught:
        calibrate(frame_set(frames))
    assert "of 4 differ from each other far beyond noise" in caught.value.what


@pytest.mark.parametrize("seed", range(2))
def test_a_lamp_that_scatters_by_5_percent_is_accepted(seed: int) -> None:
    """The set contains saturated groups, and groups at the knee."""
    assert calibrate(frame_set(Chip(seed, lamp=0.05).frames())).rejected == ()


def samples(rng: np.random.Generator, electrons: float, frames: int, lamp: float) -> list[NDArray[np.uint16]]:
    y, x = np.mgrid[-1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j]
    light = electrons * (1.0 - 0.1 * (x * x + y * y)) * rng.normal(1.0, 0.01, x.shape)
    drift = 1.0 + rng.normal(0.0, lamp, (frames, 1, 1))
    mean = light * drift
    dn = 60.0 + 0.5 * (mean + np.sqrt(mean) * rng.normal(size=mean.shape)) + rng.normal(0.0, 2.0, mean.shape)
    return list(np.clip(np.rint(dn), 0, 4095).astype(np.uint16))


@pytest.mark.parametrize("lamp", [0.0, 0.05])
@pytest.mark.parametrize("n", [2, 3, 16])
def test_no_false_alarm_from_dark_to_saturation(n: int, lamp: float) -> None:
    rng = np.random.default_rng([n, int(100 * lamp)])
    for electrons in (0.0, 3.0, 100.0, 2000.0, 7600.0, 8200.0, 20000.0):
        for _ in range(4):
            assert find_outlier_frames(samples(rng, electrons, n, lamp), 60.0) == {}, electrons


def test_no_false_alarm_on_small_frames_and_with_row_noise() -> None:
    rng = np.random.default_rng(5)
    for shape in ((8, 8), (1, 40), (5, 7), (64, 64)):
        for _ in range(40):
            rows = rng.normal(0.0, 5.0, (6, shape[0], 1)) if shape[0] == SIDE else 0.0
            stack = np.rint(rng.normal(500.0, 5.0, (6, *shape)) + rows).astype(np.uint16)
            assert find_outlier_frames(list(stack), 60.0) == {}
            assert find_outlier_frames(list(stack), None) == {}


def test_the_grid_samples_all_phases_of_a_mosaic_and_all_pixels_of_small_frames() -> None:
    rows, cols = (index.ravel() for index in sample_grid((3000, 4000), 10))
    assert len(rows) == len(cols) == SIDE
    assert np.all(np.diff(rows) > 0)
    assert np.all(rows % 2 == np.arange(SIDE) % 2)
    rows, cols = sample_grid((65, 7), 10)
    assert rows.max() < 65
    assert cols.ravel().tolist() == list(range(7))
    assert len(sample_grid((3000, 4000), 30_000)[0]) < SIDE


@pytest.mark.parametrize("cfa", [(("mono",),), (("R", "G"), ("G", "B"))])
def test_frames_clipped_at_a_constant_below_full_scale_are_no_copies(cfa: tuple[tuple[str, ...], ...]) -> None:
    """Fully clipped frames are equal in every pixel; the gain then needs the saturation that they show."""
    rng = np.random.default_rng(31)
    clip = rng.integers(2800, 3300, (len(cfa), len(cfa[0])))
    clip[0, -1] = clip[-1, 0]  # both green pixels
    top = np.tile(clip, (ROWS // len(cfa), COLS // len(cfa[0])))
    chip = Chip(31)
    frames = {key: [np.minimum(dn, top).astype(np.uint16) for dn in stack] for key, stack in chip.frames().items()}
    brightest = frames["light", 0.012]
    assert np.array_equal(brightest[0], brightest[1])
    calibration = calibrate(replace(frame_set(frames), cfa=cfa))
    assert calibration.rejected == ()
    low, high = calibration.system_gain_dn_per_e.interval_95
    assert low <= 0.5 <= high
    assert calibration.saturation_dn.value == pytest.approx(top.mean(), abs=0.1)
    low, high = calibration.prnu_percent.interval_95
    assert low <= 100.0 * chip.light.std() / chip.light.mean() <= high


def test_copies_of_flat_fields_are_left_out() -> None:
    frames = Chip(32).frames()
    frames[STACK][5] = frames[STACK][3]
    calibration = calibrate(frame_set(frames))
    assert calibration.rejected == ("light-0.006-5 repeats light-0.006-3 pixel for pixel (light frames at 0.006 s)",)


@pytest.mark.parametrize("fails_at", [12, 34])
def test_an_interrupted_run_rejects_the_same_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails_at: int
) -> None:
    monkeypatch.setattr(checkpoint, "SAVE_EVERY_S", -1.0)
    monkeypatch.setattr(frame_reader, "_BATCH_FRAMES", 4)
    frames = Chip(4).frames()
    frames[DARKS][3] = np.zeros_like(frames[DARKS][3])
    frames[STACK][7] = half_black(frames[STACK][7])
    whole = calibrate(frame_set(frames))
    assert len(whole.rejected) == 2

    def failing(done: int, total: int) -> None:
        if done == fails_at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        calibrate(frame_set(frames), progress=failing, checkpoint=tmp_path / "sums")
    again = calibrate(frame_set(frames), checkpoint=tmp_path / "sums")
    assert again.estimates() == whole.estimates()
    assert again.rejected == whole.rejected
    assert again.frames_sha256 == whole.frames_sha256


def nearly(dn: NDArray[np.uint16], pixels: int = 1) -> NDArray[np.uint16]:
    """A copy in which some pixels differ by 2."""
    changed = dn.copy()
    changed.reshape(-1)[:: dn.size // pixels][:pixels] += 2
    return changed


@pytest.mark.parametrize("group", [STACK, DARKS])
def test_a_copy_that_differs_in_some_pixels_is_left_out(group: tuple[str, float]) -> None:
    frames, others = Chip(41).frames(), Chip(41).frames()
    frames[group][7] = nearly(frames[group][4], 5)
    del others[group][7]
    calibration, clean = calibrate(frame_set(frames)), calibrate(frame_set(others))
    (reason,) = calibration.rejected
    assert reason.startswith(f"{group[0]}-0.006-7 repeats {group[0]}-0.006-4: ")
    assert calibration.system_gain_dn_per_e == clean.system_gain_dn_per_e
    assert calibration.read_noise_dn == clean.read_noise_dn


def test_pairs_of_copies_that_differ_in_one_pixel() -> None:
    """The sums of such pairs are even, but the numbers are not shifted bits."""
    frames = Chip(42).frames()
    for group in (DARKS, DARK_PAIR):
        frames[group] = [frames[group][0], nearly(frames[group][0])]
    calibration = calibrate(frame_set(frames))
    assert calibration.read_noise_dn.value is None
    assert calibration.read_noise_dn.reason_id == "unknown-dark-noise"
    assert calibration.rejected[0].startswith("dark-0.006-1 repeats dark-0.006-0: ")

    frames = Chip(42).frames()
    frames[PAIR][1] = nearly(frames[PAIR][0])
    with pytest.raises(CalibrationError) as caught:
        calibrate(frame_set(frames))
    assert (caught.value.id, caught.value.where) == ("identical-frames", "memory: light frames at 0.004 s")


def test_no_near_copies_among_quiet_frames() -> None:
    """A noise of 0.05 DN, far below that of a converter; 250 stacks of 4 frames, and clipped flats that are alike."""
    rng = np.random.default_rng(43)
    for _ in range(250):
        pattern = rng.normal(64.0, 1.0, (32, 40))
        stack = [np.rint(pattern + rng.normal(0.0, 0.05, pattern.shape)).astype(np.uint16) for _ in range(4)]
        assert find_near_copies(stack) == {}
    stack[3] = nearly(stack[1], 2)
    assert find_near_copies(stack) == {3: (1, 2)}
    assert find_near_copies([np.full((64, 64), 4000, np.uint16) for _ in range(3)]) == {}


def test_clipped_flats_with_a_pattern_are_no_copies() -> None:
    """A camera that subtracts an offset of each column after the converter: saturated frames are alike."""
    columns = np.random.default_rng(44).integers(0, 9, COLS)
    frames = {
        key: [(np.minimum(dn, 3000) + columns).astype(np.uint16) for dn in stack]
        for key, stack in Chip(44).frames().items()
    }
    for key, stack in frames.items():
        if stack[0].mean() > 2900:
            frames[key] = [nearly(dn, 1 + i) for i, dn in enumerate(stack)]
    calibration = calibrate(frame_set(frames))
    assert calibration.rejected == ()
    low, high = calibration.system_gain_dn_per_e.interval_95
    assert low <= 0.5 <= high


def test_pixels_that_blink_make_no_other_frames() -> None:
    """Five in a thousand pixels that jump by up to 2000 DN; a frame without two of its lines is another one."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        stack = rng.normal(60.0, 2.0, (12, SIDE, SIDE))
        for frame in stack:
            frame += (np.arange(frame.size) % 211 == 0).reshape(frame.shape) * 2000.0 * rng.integers(0, 2, frame.shape)
        frames = list(np.rint(stack.clip(0)).astype(np.uint16))
        assert find_outlier_frames(frames, None) == {}
        frames[4][8:10] = 4095
        assert list(find_outlier_frames(frames, None)) == [4]
