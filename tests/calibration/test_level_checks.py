"""Levels that contradict what is stated of the frames are found, with the likely cause; valid ones pass."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile
from scipy.stats import norm

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, Level, clipping_bias
from photosite.engine.frame_sums import FrameSums
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameSet
from photosite.frames.open import open_frames

GAIN, BLACK, READ_DN, EFFICIENCY = 0.5, 64.0, 2.0, 0.6
LEVELS = (200.0, 400.0, 800.0, 1600.0, 2400.0, 3200.0, 5000.0, 7000.0, 9000.0)
RATE = 1e5
"""Electrons per second of the flats."""


def shot(rng, electrons, *, bits=12, black=BLACK, shape=(24, 32)):
    dn = np.rint(black + GAIN * rng.poisson(electrons, shape) + rng.normal(0.0, READ_DN, shape))
    return np.clip(dn, 0, 2**bits - 1).astype(np.uint16)


def measurement(
    *, dark_e=lambda t: 20.0 * t, stated_s=lambda t: t, stated_photons=None, bits=12, black=BLACK, levels=LEVELS, seed=0
):
    """(kind, exposure, dn, photons) of a virtual camera; the stated exposure times and photons may be wrong."""
    rng = np.random.default_rng([seed, 41])
    times = [electrons / RATE for electrons in levels]
    frames = [("dark", t, shot(rng, dark_e(t), bits=bits, black=black)) for t in (*times, 1.0, 4.0) for _ in range(6)]
    for t, electrons in zip(times, levels, strict=True):
        for _ in range(4):
            frames.append(("light", stated_s(t), shot(rng, electrons + dark_e(t), bits=bits, black=black)))
    if stated_photons is None:
        return frames
    return [(*frame, stated_photons(frame[1]) if frame[0] == "light" else 0.0) for frame in frames]


def calibrated(frames, bits=12):
    return calibrate(FrameSet.from_arrays(frames, bits=bits))


def error_of(frames, bits=12):
    with pytest.raises(CalibrationError) as caught:
        calibrated(frames, bits)
    assert "\n" not in str(caught.value)
    return caught.value


def raised(frames, name):
    """The diagnostics with an id."""
    return [entry for entry in calibrate(frames).diagnostics if entry.id == name]


def photons(t):
    return RATE * t / EFFICIENCY


def test_the_bias_of_clipping_is_that_of_a_clipped_normal():
    """At the middles of 100 000 equal fractions of a normal; the read noise is at most 0.5 % low."""
    x = norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    for fraction in (CLIPPED_DARK_FRACTION, 0.05, 0.3):
        clipped = np.maximum(x, norm.ppf(fraction))
        assert clipping_bias(fraction) == pytest.approx(clipped.var() / x.var() - 1, abs=1e-4)
    assert 1 - np.sqrt(1 + clipping_bias(CLIPPED_DARK_FRACTION)) == pytest.approx(0.0045, abs=1e-4)


def test_flats_that_end_at_the_full_scale_of_a_smaller_converter():
    levels = (50.0, 100.0, 150.0, 200.0, 300.0, 3000.0)
    frames = measurement(bits=8, black=20.0, levels=levels)
    assert error_of(frames).id == "wrong-bit-depth"
    assert calibrated(frames, bits=8).saturation_dn.value == 255.0


@pytest.mark.parametrize("low", [1, 7])
def test_some_pixels_that_respond_less_do_not_hide_the_full_scale(low):
    frames = measurement(bits=10, levels=(*LEVELS[:4], 6000.0))
    frames = [
        (kind, t, np.where(np.arange(dn.size).reshape(dn.shape) < low, dn // 2 + 32, dn)) for kind, t, dn in frames
    ]
    assert error_of(frames, bits=16).id == "wrong-bit-depth"
    assert calibrated(frames, bits=10).saturation_dn.value == pytest.approx(1023.0, abs=6.0)


def test_numbers_shifted_to_sixteen_bits():
    error = error_of([(kind, t, dn << 4) for kind, t, dn in measurement()], bits=16)
    assert error.id == "shifted-numbers"
    assert error.hint == "Divide them by 16 and state 12 bits"


def test_the_bits_that_divide_shifted_numbers_of_files(tmp_path):
    for number, (kind, t, dn) in enumerate(measurement()):
        tifffile.imwrite(tmp_path / f"{kind}_{t:.6f}s_{number}.tif", dn << 4, photometric="minisblack")
    with pytest.raises(CalibrationError) as caught:
        calibrate(open_frames(tmp_path))
    assert (caught.value.id, caught.value.arguments) == ("shifted-numbers", {"bits": 12})
    assert "{bits}" in caught.value.hint
    assert calibrate(open_frames(tmp_path, **caught.value.arguments)).saturation_dn.value > 3000


def test_hot_pixels_name_the_dark_frames_whose_nonuniformity_they_make():
    """30 hot pixels of 400 DN/s, too many to be left out as defects, in frames of 0.5 s, which are the most."""
    rng = np.random.default_rng(5)
    frames = [*measurement(), *(("dark", 0.5, shot(rng, 10.0)) for _ in range(8))]
    hot = rng.permutation(24 * 32)[:30]
    for _, t, dn in frames:
        dn.flat[hot] = np.minimum(dn.flat[hot] + np.uint16(400 * t), 4095)
    (found,) = raised(FrameSet.from_arrays(frames, bits=12), "far-pixels")
    assert "DSNU1288 at 0.5 s" in found.text
    assert {"dsnu_e", "dsnu1288_e"} <= set(found.parameters)
    assert not any(name.startswith("prnu") for name in found.parameters)


def mixed_units():
    return measurement(stated_s=lambda t: 1e3 * t if 0.007 < t < 0.02 else t)  # two levels in ms


def swapped_levels():
    wrong = {0.004: 0.016, 0.016: 0.004}
    return measurement(stated_s=lambda t: wrong.get(round(t, 6), t))


def dimmed_lamp():
    rng = np.random.default_rng(5)
    darks = [frame for frame in measurement() if frame[0] == "dark"]
    return darks + [("light", t, shot(rng, 1500.0)) for t in (0.001, 0.002, 0.004, 0.008) for _ in range(4)]


def wrong_photons():
    return measurement(stated_photons=lambda t: round(photons(t) * [0.2, 1.0, 5.0][int(1e6 * t) // 2000 % 3]))


@pytest.mark.parametrize(
    ("frames", "cause"),
    [
        (mixed_units(), "a factor of a thousand: units are mixed"),
        (swapped_levels(), "levels were swapped"),
        (dimmed_lamp(), "automatic exposure"),
        (wrong_photons(), "proportional to the exposure times instead"),
    ],
)
def test_signals_that_are_not_proportional_to_the_stated_light(frames, cause):
    error = error_of(frames)
    assert error.id == "wrong-light"
    assert cause in error.what
    assert error.hint


def test_a_lit_dark_group_is_named():
    """With three or more dark exposures beside it, it is left out."""
    rng = np.random.default_rng(7)
    frames = [
        (kind, t, shot(rng, 2000.0) if kind == "dark" and round(t, 6) == 0.032 else dn) for kind, t, dn in measurement()
    ]
    calibration = calibrated(frames)
    left_out = [entry.id for entry in calibration.diagnostics if entry.severity == "left out"]
    assert left_out == ["wrong-dark-exposure"] * 6

    error = error_of([frame for frame in frames if frame[0] == "light" or round(frame[1], 6) in (0.032, 1.0, 4.0)])
    assert error.id == "lit-darks"


def test_flats_with_the_lens_covered():
    frames = [(kind, t, dn) for kind, t, dn in measurement() if kind == "dark"]
    frames += [("light", 0.01 * k, dn - np.uint16(1)) for k in (1, 2) for _, _, dn in frames[:4]]
    assert error_of(frames).id == "dark-flats"


def test_darks_that_grow_like_flats_give_a_warning():
    dark = FrameSet.from_arrays(measurement(dark_e=lambda t: 0.02 * RATE * min(t, 1.0)), bits=12)
    assert not raised(dark, "light-leak")
    lit = measurement(dark_e=lambda t: 0.6 * RATE * min(t, 0.1), levels=LEVELS[:5])
    (found,) = raised(FrameSet.from_arrays([frame for frame in lit if frame[1] < 0.1], bits=12), "light-leak")
    assert found.size == pytest.approx(0.6 * RATE * GAIN, rel=0.02)
    assert {"dark_current_e_per_s", "dcnu_percent"} < set(found.parameters)


def test_exposure_times_too_short_for_a_shutter_give_a_warning():
    frames = [(kind, 1e-6 * t if kind == "light" else 1e-3 * t, dn) for kind, t, dn in measurement()]
    assert raised(FrameSet.from_arrays(frames, bits=12), "exposure-unit")


def test_an_unsteady_lamp_gives_a_warning_and_does_not_count_as_noise():
    def frames(flicker):
        rng = np.random.default_rng(3)
        listed = [("dark", t, rng.normal(64, 2, (24, 32))) for t in (0.01, 0.02) for _ in range(4)]
        for t, level in ((0.01, 500), (0.02, 1000)):
            listed += [("light", t, np.rint(rng.normal(level, 15, (24, 32))) + flicker * (i % 2)) for i in range(4)]
        return FrameSet.from_arrays([(kind, t, np.rint(dn).astype(np.uint16)) for kind, t, dn in listed], bits=12)

    steady, unsteady = calibrate(frames(0)), calibrate(frames(40))
    assert "unsteady-light" in [entry.id for entry in unsteady.diagnostics]
    assert not [entry for entry in steady.diagnostics if entry.id.startswith("unsteady")]
    curves = [calibration.curves["M"]["photon_transfer"] for calibration in (steady, unsteady)]
    np.testing.assert_allclose(curves[1].y, curves[0].y, rtol=1e-9)


def test_a_drifting_black_level_is_not_taken_for_an_unsteady_lamp():
    rng = np.random.default_rng(5)
    listed = []
    for kind, t, level in (("dark", 0.01, 0), ("dark", 0.02, 0), ("light", 0.01, 30), ("light", 0.02, 60)):
        for _ in range(6):
            listed.append((kind, t, 64 + level + rng.normal(0, 3) + rng.normal(0, 2, (24, 32))))
    frames = FrameSet.from_arrays([(kind, t, np.rint(dn).astype(np.uint16)) for kind, t, dn in listed], bits=12)
    unsteady = [entry.id for entry in calibrate(frames).diagnostics if entry.id.startswith("unsteady")]
    assert unsteady == ["unsteady-black-level"]


def small_chip(seed, ripple=0.0):
    """64 pixels of noise 15 DN: the mean of a frame scatters by 1.9 DN, a fifteenth of the weakest signal of 28 DN."""
    rng = np.random.default_rng([seed, 7])
    frames = [("dark", t, rng.normal(64, 2, (8, 8))) for t in (0.01, 0.02) for _ in range(4)]
    for index in range(32):
        signal = 28 * 2 ** (index // 4) * (1 + ripple * (-1) ** index)
        frames.append(("light", 0.01 * 2 ** (index // 4), rng.normal(64 + signal, 15, (8, 8))))
    return FrameSet.from_arrays([(kind, t, np.rint(dn).astype(np.uint16)) for kind, t, dn in frames], bits=12)


def reported_unsteady(frames):
    return bool(raised(frames, "unsteady-light"))


def test_a_steady_lamp_on_a_small_chip_gives_no_warning():
    """At most 1 of 1000 calibrations may warn: 2 or more of 40 occur by chance once in 1300. In three of four, some
    level's frame means scatter by more than the 1 % that deserves a warning."""
    assert sum(reported_unsteady(small_chip(seed)) for seed in range(40)) <= 1


def test_an_unsteady_lamp_on_a_small_chip_gives_a_warning():
    """3 % from frame to frame: at the brightest level, of 3584 DN, more than 50 times chance."""
    assert all(reported_unsteady(small_chip(seed, ripple=0.03)) for seed in range(8))


def test_the_false_alarm_rate_of_shifts_is_the_stated_one():
    """Steady frames at a rate of 0.05: 30 +- 5.3 of 600 groups; four standard errors either way, at any size.

    The variance under the frame means is itself estimated from few pixels (Fisher's F)."""
    rng = np.random.default_rng(5)
    for frames, shape in ((2, (4, 4)), (6, (4, 8))):
        alarms = 0
        for _ in range(600):
            sums = FrameSums(shape, np.zeros((1, 1), dtype=np.int64), white=4095)
            sums.add(list(np.rint(rng.normal(500, 15, (frames, *shape))).astype(np.uint16)))
            alarms += Level.of(sums.label_totals()[0]).shifts_beyond_chance(0.05)
        assert abs(alarms - 30) < 22, (frames, shape, alarms)


@pytest.fixture(scope="module")
def stated():
    rng = np.random.default_rng(3)
    frames = [
        (kind, t, np.round(rng.normal(level, noise, (24, 32))).astype(np.uint16))
        for kind, t, level, noise in (
            ("dark", 0.01, 64, 2),
            ("dark", 0.02, 64, 2),
            ("light", 0.01, 500, 15),
            ("light", 0.02, 936, 21),
        )
        for _ in range(4)
    ]
    return FrameSet.from_arrays(frames, bits=12)


@pytest.mark.parametrize(("dn", "count"), [(None, 0), (64.0, 0), (61.0, 0), (58.0, 1), (70.0, 1), (0.0, 1)])
def test_a_stated_black_level_far_from_the_darks(stated, dn, count):
    """Far is a thousandth of the range, 4 DN of 12 bits."""
    found = raised(replace(stated, black_level_dn=dn), "stated-black-level")
    assert [entry.size for entry in found] == pytest.approx([64.0] * count, abs=0.2)


@pytest.mark.parametrize(("times", "dn", "count"), [
    ((0.1, 0.2), 40.0, 0),
    ((0.1, 0.2), 64.0, 1),
    ((0.1, 0.1), 40.0, 0),
    ((0.1, 0.1), 80.0, 1),
    ((0.001, 0.001), 40.0, 1),
])  # fmt: skip
def test_a_stated_black_level_is_that_without_dark_current(times, dn, count):
    """24 DN of dark current in the shortest dark frames; in those of one time of 1 ms, other charge."""
    rng = np.random.default_rng(4)

    def frame(electrons):
        return np.round(40 + 0.5 * rng.poisson(electrons, (48, 64)) + rng.normal(0, 2, (48, 64))).astype(np.uint16)

    charge = [480 * max(t, 0.1) for t in times]
    frames = [("dark", t, frame(e)) for t, e in zip(times, charge, strict=True) for _ in range(4)]
    frames += [("light", t, frame(10_000 * t + e)) for t, e in zip(times, charge, strict=True) for _ in range(4)]
    found = raised(replace(FrameSet.from_arrays(frames, bits=12), black_level_dn=dn), "stated-black-level")
    assert len(found) == count


@pytest.mark.parametrize(("dn", "count"), [(None, 0), (4095.0, 0), (936.0, 0), (900.0, 1)])
def test_a_stated_white_level_below_the_flats(stated, dn, count):
    found = raised(replace(stated, white_level_dn=dn), "stated-white-level")
    assert [entry.size for entry in found] == pytest.approx([936.0] * count, abs=2.0)
