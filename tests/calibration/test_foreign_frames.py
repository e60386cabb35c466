"""Frames and groups of another chip, gain or binning are left out by name; weak patterns give no warning."""

import re

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.foreign_frames import find_foreign_frames
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameSet
from photosite.studies.conditions import CONDITIONS
from photosite.values.cfa import MONOCHROME

MONO, RGGB = np.zeros((64, 64), np.int64), np.tile([[0, 1], [1, 2]], (32, 32))
NOISE = 8.0


def frames(rng, count, pattern, *, foreign=(), gain=1.0, row=0.0, labels=MONO, hot=0.0):
    """Frames of one chip, and some `foreign` ones of another."""
    shape = labels.shape
    chips = 1000.0 + pattern * rng.normal(size=(2, *shape)) + 300.0 * labels
    chips += hot * (rng.random(chips.shape) < 0.003)
    noise = [NOISE * (gain if i in foreign else 1.0) * rng.normal(size=shape) for i in range(count)]
    lines = row * (rng.normal(size=(count, shape[0], 1)) + rng.normal(size=(count, 1, shape[1])))
    chip = [int(i in foreign and gain == 1.0) for i in range(count)]
    return [np.rint(chips[chip[i]] + noise[i] + lines[i]).astype(np.uint16) for i in range(count)]


@pytest.mark.parametrize("labels", [MONO, RGGB], ids=["mono", "mosaic"])
def test_a_frame_of_another_chip_is_found(labels):
    rng = np.random.default_rng(1)
    for count in (5, 8, 16):
        place = int(rng.integers(count))
        assert list(find_foreign_frames(frames(rng, count, 4.0, foreign=[place], labels=labels), labels)) == [place]


@pytest.mark.parametrize("gain", [0.5, 1.3])
def test_a_frame_of_another_gain_is_found(gain):
    rng = np.random.default_rng(2)
    assert list(find_foreign_frames(frames(rng, 8, 0.0, foreign=[5], gain=gain), MONO)) == [5]


def test_clipped_frames_are_not_compared_for_their_noise():
    """Light that varies by 0.3 % moves the few pixels below saturation, and with them the noise that is left."""
    rng = np.random.default_rng(11)
    for _ in range(20):
        light = 4100.0 * (1.0 + 0.003 * rng.normal(size=(4, 1, 1)))
        clipped = np.minimum(np.rint(rng.normal(light, NOISE, (4, 64, 64))), 4095.0).astype(np.uint16)
        assert not find_foreign_frames(list(clipped), MONO)


@pytest.mark.parametrize(("condition", "number"), [("bright-mono-12", 81), ("bright-cfa-12", 105)])
def test_frames_that_wells_saturate_are_not_compared_for_their_noise(condition, number):
    """Most pixels are at their well and have read noise only, a few are below and have shot noise: heavy tails."""
    assert not calibrate(CONDITIONS[condition].lab(number).frame_set()).rejected


@pytest.mark.parametrize("noise", [(0.15, 0.15, 6.0), (0.15, 1.0, 2.0)], ids=["two saturated", "one saturated"])
def test_channels_of_different_noise_count_alike(noise):
    """A saturated channel has read noise only, another has shot noise; a frame of another gain shows in all."""
    rng = np.random.default_rng(12)
    scale = np.array(noise)[RGGB]
    for foreign in [(), (3,)] * 3:
        stack = frames(rng, 8, 0.0, foreign=foreign, gain=1.3)
        stack = [np.rint(1000.0 + scale * (frame - 1000.0)).astype(np.uint16) for frame in stack]
        assert tuple(find_foreign_frames(stack, RGGB)) == foreign


def test_two_of_nine_are_found():
    rng = np.random.default_rng(3)
    assert list(find_foreign_frames(frames(rng, 9, 6.0, foreign=[2, 7]), MONO)) == [2, 7]


@pytest.mark.parametrize("pattern", [0.0, 1.0, 2.0, 3.0, 6.0])
def test_frames_of_one_chip_are_kept(pattern):
    rng = np.random.default_rng(4)
    for count in (2, 3, 4, 8, 16):
        for changes in ({}, {"row": 8.0}, {"hot": 300.0}, {"labels": RGGB}):
            labels = changes.get("labels", MONO)
            assert not find_foreign_frames(frames(rng, count, pattern, **changes), labels)


def test_frames_of_smoothed_noise_are_kept():
    rng = np.random.default_rng(10)
    for _ in range(15):
        noise = gaussian_filter(rng.normal(0.0, 60.0, (8, 64, 64)), (0.0, 2.0, 2.0))
        assert not find_foreign_frames([np.rint(1000.0 + one).astype(np.uint16) for one in noise], MONO)


@pytest.mark.parametrize("fraction", [0.1, 0.3])
def test_frames_that_share_noise_with_the_next_are_kept(fraction):
    rng = np.random.default_rng(5)
    for count in (3, 4, 8):
        chip, last, stack = 1000.0 + 3.0 * rng.normal(size=(64, 64)), NOISE * rng.normal(size=(64, 64)), []
        for _ in range(count):
            last = np.sqrt(1.0 - fraction**2) * NOISE * rng.normal(size=(64, 64)) + fraction * last
            stack.append(np.rint(chip + last).astype(np.uint16))
        assert not find_foreign_frames(stack, MONO)


DARK_S, LIGHT_S = (0.01, 0.1, 0.2), (0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1)


def stack(foreign=lambda kind, exposure_s, frame: False, seed=6, dark_s=DARK_S):
    """Darks and flats of a chip; `foreign` says which are those of another."""
    rng = np.random.default_rng(seed)
    shape = (64, 64)
    response, offset = 1.0 + 0.01 * rng.normal(size=(2, *shape)), 64.0 + 1.0 * rng.normal(size=(2, *shape))

    def take(kind, exposure_s, electrons):
        shots = []
        for i in range(6):
            chip = int(foreign(kind, exposure_s, i))
            dn = offset[chip] + 0.3 * rng.poisson(electrons * response[chip]) + rng.normal(0.0, 2.0, shape)
            frame = np.clip(np.rint(dn), 0, 4095).astype(np.uint16)
            shots.append((kind, exposure_s, frame))
        return shots

    darks = [take("dark", t, 0.0) for t in dark_s]
    lights = [take("light", t, 1e5 * t) for t in LIGHT_S]
    return FrameSet.from_arrays([shot for group in (*darks, *lights) for shot in group], bits=12)


def numbers(kind, exposure_s):
    """Return the numbers of the frames of a group, by which they are named."""
    first = 6 * (DARK_S.index(exposure_s) if kind == "dark" else len(DARK_S) + LIGHT_S.index(exposure_s))
    return range(first, first + 6)


def named(texts):
    return [int(re.match(r"frame (\d+) ", text)[1]) for text in texts]


def test_a_clean_stack_is_used_as_a_whole():
    calibration = calibrate(stack())
    assert not calibration.rejected
    assert calibration.frame_count == 60


@pytest.mark.parametrize(("kind", "exposure_s"), [("dark", 0.01), ("light", 0.045)])
def test_a_frame_of_another_chip_is_rejected(kind, exposure_s):
    calibration = calibrate(stack(lambda *frame: frame == (kind, exposure_s, 3)))
    (rejected,) = calibration.rejected
    assert named([rejected]) == [numbers(kind, exposure_s)[3]]
    low, high = calibration.prnu_percent.interval_95
    assert low < 1.0 < high


@pytest.mark.parametrize(("kind", "exposure_s"), [("dark", 0.01), ("dark", 0.2), ("light", 0.03)])
def test_a_group_of_another_chip_is_rejected(kind, exposure_s):
    clean = calibrate(stack())
    calibration = calibrate(stack(lambda *frame: frame[:2] == (kind, exposure_s)))
    assert len(calibration.rejected) == 6
    assert named(calibration.rejected) == list(numbers(kind, exposure_s))
    assert calibration.frame_count == 54
    assert set(named([frame.name for frame in calibration.frames_used])) == set(range(60)) - set(
        numbers(kind, exposure_s)
    )
    for name in ("prnu_percent", "dsnu_dn", "system_gain_dn_per_e"):
        one, other = getattr(clean, name), getattr(calibration, name)
        assert other.value == pytest.approx(one.value, abs=3.0 * other.standard_uncertainty)


def test_half_of_the_groups_of_another_chip_are_refused():
    with pytest.raises(CalibrationError) as caught:
        calibrate(stack(lambda kind, exposure_s, frame: kind == "dark" and exposure_s > 0.05, dark_s=(0.01, 0.1)))
    assert "several chips" in caught.value.what
    assert caught.value.hint


def test_groups_are_left_out_of_a_checkpoint_s_run_too(tmp_path):
    wanted = stack(lambda *frame: frame[:2] == ("light", 0.03))
    assert calibrate(wanted, checkpoint=tmp_path / "sums").rejected == calibrate(wanted).rejected


def turned_set(turn, shape, cfa, which):
    """Darks and flats of a chip with DSNU and PRNU; `which` tells the frames that are turned."""
    rng = np.random.default_rng(7)
    response, offset = 1.0 + 0.01 * rng.normal(size=shape), 64.0 + 2.0 * rng.normal(size=shape)
    if len(cfa) > 1:
        response *= np.tile([[0.6, 1.0], [1.0, 0.4]], (shape[0] // 2, shape[1] // 2))
    taken = []
    for kind, exposures in (("dark", DARK_S), ("light", LIGHT_S)):
        for t in exposures:
            for i in range(6):
                electrons = rng.poisson(8e4 * t * response) if kind == "light" else 0.0
                dn = np.rint(offset + 0.3 * electrons + rng.normal(0.0, 2.0, shape))
                dn = np.clip(dn, 0, 4095).astype(np.uint16)
                taken.append((kind, t, np.ascontiguousarray(turn(dn)) if which(kind, t, i) else dn))
    return FrameSet.from_arrays(taken, bits=12, cfa=cfa)


@pytest.mark.parametrize("cfa", [MONOCHROME, (("R", "G"), ("G", "B"))], ids=["mono", "bayer"])
@pytest.mark.parametrize(
    ("turn", "shape", "words"),
    [
        (np.fliplr, (72, 100), "mirrored left to right"),
        (np.flipud, (72, 100), "mirrored top to bottom"),
        (lambda dn: dn[::-1, ::-1], (72, 100), "rotated by 180 degrees"),
        (lambda dn: np.rot90(dn, -1), (80, 80), "rotated by 90 degrees"),
    ],
)
def test_turned_frames_are_named(turn, shape, words, cfa):
    """A flat field, a dark frame, and a group of flat fields."""
    for which, count in (
        (lambda kind, t, i: kind == "light" and t == 0.06 and i == 2, 1),
        (lambda kind, t, i: kind == "dark" and t == 0.1 and i == 4, 1),
        (lambda kind, t, i: kind == "light" and t == 0.06, 6),
    ):
        diagnostics = calibrate(turned_set(turn, shape, cfa, which)).diagnostics
        found = [entry for entry in diagnostics if entry.severity == "left out"]
        assert [entry.id for entry in found] == ["turned-frame"] * count, found
        assert all(words in entry.text for entry in found)
