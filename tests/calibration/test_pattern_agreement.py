"""Dark frames and flat fields of different states, from frames of plain NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import FrameSet
from photosite.values.cfa import MONOCHROME, Cfa

BAYER: Cfa = (("R", "G"), ("G", "B"))
GAIN, BLACK, READ_E, DSNU_E, LIGHT_E_PER_S, DARK_E_PER_S = 0.4, 64.0, 4.0, 4.0, 10_000.0, 100.0
LIGHT_S = tuple(0.1 * k for k in range(1, 10))
DARK_S = (0.01, 0.3, 1.0)

Change = Callable[[str, np.ndarray], np.ndarray]


def stack(
    seed: int,
    *,
    warmer: float = 1.0,
    leak: float = 0.0,
    stray_e: float = 0.0,
    dark_e_per_s: float = DARK_E_PER_S,
    light_e_per_s: float = LIGHT_E_PER_S,
    exposure_s: float | None = None,
    covered: int = 0,
    inner: slice = slice(0),
    well_dn: float | None = None,
    change: Change = lambda kind, numbers: numbers,
    cfa: Cfa = MONOCHROME,
    shape: tuple[int, int] = (96, 128),
    light_s: tuple[float, ...] = LIGHT_S,
    dark_s: tuple[float, ...] = DARK_S,
    of: Callable[[list[np.ndarray]], np.ndarray] | None = None,
) -> FrameSet:
    """Ten dark frames of each time and six flat fields; `warmer` is the dark current of the flat fields over theirs.

    `inner` are columns without light, `well_dn` is the mean number of full wells, which differ by 1 %.

    `leak` is the light in the dark frames, e-/s; `stray_e` what flat fields have at no light; `exposure_s` that of all
    flat fields, whose light then changes. `of` makes one flat field of three.
    """
    rng = np.random.default_rng([seed, 77])
    response = 1.0 + rng.normal(0.0, 0.01, shape)
    offset = rng.normal(0.0, DSNU_E, shape)
    rate = dark_e_per_s * rng.lognormal(-0.125, 0.5, shape)
    response[:, shape[1] - covered :] = 0.0
    response[:, inner] = 0.0
    well_e = np.inf if well_dn is None else (well_dn - BLACK) / GAIN * (1.0 + rng.normal(0.0, 0.01, shape))

    colors = np.ones(shape) if cfa == MONOCHROME else np.tile([[0.6, 1.0], [1.0, 0.4]], (shape[0] // 2, shape[1] // 2))

    def frame(kind: str, seconds: float) -> np.ndarray:
        mean = rate * seconds if kind == "dark" else rate * (exposure_s or seconds) * warmer
        light_e = light_e_per_s * seconds + stray_e if kind == "light" else leak * seconds
        mean = mean + light_e * response * colors
        electrons = np.minimum(rng.poisson(mean), well_e) + offset + rng.normal(0.0, READ_E, shape)
        return np.clip(np.rint(change(kind, GAIN * electrons + BLACK)), 0, 4095).astype(np.uint16)

    taken: list[tuple[Any, ...]] = [("dark", t, frame("dark", t)) for t in dark_s for _ in range(10)]
    for t in (t for t in light_s for _ in range(6)):
        dn = frame("light", t) if of is None else of([frame("light", t) for _ in range(3)])
        taken.append(("light", t, dn) if exposure_s is None else ("light", exposure_s, dn, light_e_per_s * t))
    return FrameSet.from_arrays(taken, bits=12, cfa=cfa)


def sizes(frames: FrameSet) -> dict[str, float | None]:
    return {entry.id: entry.size for entry in calibrate(frames).diagnostics if entry.severity == "warning"}


@pytest.mark.parametrize("cfa", [MONOCHROME, BAYER], ids=["mono", "bayer"])
@pytest.mark.parametrize("warmer", [2.0, 0.0])
def test_flat_fields_at_another_temperature_are_named(warmer: float, cfa: Cfa) -> None:
    """The size is the dark current of the flat fields over that of the dark frames, to four standard errors."""
    found = sizes(stack(1, warmer=warmer, cfa=cfa))
    assert found["other-dark-current"] == pytest.approx(warmer, abs=0.12)
    assert "other-offsets" not in found


@pytest.mark.parametrize("exposure_s", [None, 0.5], ids=["times", "one time"])
def test_light_in_dark_frames_is_named_by_the_response_of_the_pixels(exposure_s: float | None) -> None:
    """The size is the fraction of the dark signal that is light, to four standard errors; nothing else is blamed."""
    light = {"light_e_per_s": 1e5, "light_s": tuple(0.1 * t for t in LIGHT_S), "exposure_s": exposure_s}
    found = sizes(stack(1, leak=300.0, dark_e_per_s=100.0, **light))
    assert found["light-in-darks"] == pytest.approx(0.75, abs=0.4)
    assert "other-dark-current" not in found
    assert "light-in-darks" not in sizes(stack(1, dark_e_per_s=100.0, **light))


def test_light_in_dark_frames_is_named_by_its_colors() -> None:
    found = calibrate(stack(1, leak=100.0, cfa=BAYER))
    (entry,) = (entry for entry in found.diagnostics if entry.id == "light-in-darks")
    assert entry.size == pytest.approx((1.0 - 0.4) / 2.0, abs=0.02)
    assert "dark_current_e_per_s" in entry.parameters


@pytest.mark.parametrize("exposure_s", [None, 0.5], ids=["times", "one time"])
@pytest.mark.parametrize("stray_e", [200.0, 800.0, -100.0])
def test_light_that_does_not_grow_is_named_and_leaves_the_gain(stray_e: float, exposure_s: float | None) -> None:
    """The size is that at no light over the brightest level in the linear range, to four standard errors."""
    frames = stack(2, stray_e=stray_e, exposure_s=exposure_s, light_s=tuple(0.1 * k for k in range(2, 9)))
    found = calibrate(frames)
    (entry,) = (entry for entry in found.diagnostics if entry.id == "constant-light")
    (used,) = found.linear_range.values()
    brightest_e = used.highest * (LIGHT_E_PER_S if exposure_s is None else 1.0)
    assert entry.size == pytest.approx(stray_e / (brightest_e + stray_e), rel=0.1)
    assert not {"unclear-bend", "nonlinear-light", "bent-response"} & set(sizes(frames))
    gain = found.system_gain_dn_per_e
    assert abs((gain.value or 0.0) - GAIN) < 4.0 * (gain.standard_uncertainty or 0.0) < 0.03 * GAIN


def mirrored(kind: str, numbers: np.ndarray) -> np.ndarray:
    return numbers[:, ::-1] if kind == "dark" else numbers


def without_pattern(kind: str, numbers: np.ndarray) -> np.ndarray:
    """Remove the fixed pattern of dark frames by that of a master bias of 8 frames, drawn with the same seed."""
    if kind == "light":
        return numbers
    rng = np.random.default_rng([1, 77])
    rng.normal(0.0, 0.01, numbers.shape)
    offset = rng.normal(0.0, DSNU_E, numbers.shape)
    return numbers - GAIN * (offset + np.random.default_rng(5).normal(0.0, READ_E / np.sqrt(8), numbers.shape))


@pytest.mark.parametrize("change", [mirrored, without_pattern])
def test_dark_frames_with_another_pattern_are_named(change: Change) -> None:
    found = sizes(stack(1, change=change))
    assert abs(found["other-offsets"] or 0.0) < 0.5


@pytest.mark.parametrize("cfa", [MONOCHROME, BAYER], ids=["mono", "bayer"])
@pytest.mark.parametrize(
    ("turn", "words"),
    [
        (np.fliplr, "mirrored left to right"),
        (np.flipud, "mirrored top to bottom"),
        (lambda dn: dn[::-1, ::-1], "rotated by 180 degrees"),
        (np.rot90, "rotated by"),
    ],
)
def test_turned_dark_frames_are_named(turn: Callable[[np.ndarray], np.ndarray], words: str, cfa: Cfa) -> None:
    shape = (112, 112) if turn is np.rot90 else (96, 128)
    frames = stack(1, change=lambda kind, dn: turn(dn) if kind == "dark" else dn, cfa=cfa, shape=shape)
    (entry,) = (entry for entry in calibrate(frames).diagnostics if entry.id == "other-offsets")
    assert words in entry.text
    assert abs(entry.size or 0.0) < 0.5


def test_columns_without_light_are_counted() -> None:
    found = sizes(stack(2, covered=6))
    assert found["unlit-lines"] == pytest.approx(6 / 128)


@pytest.mark.parametrize("cfa", [MONOCHROME, BAYER], ids=["mono", "bayer"])
def test_overscan_between_amplifiers_is_counted(cfa: Cfa) -> None:
    """Two amplifiers whose overscan meets in the middle, in files without keywords."""
    result = calibrate(stack(2, inner=slice(60, 70), cfa=cfa))
    entry = next(entry for entry in result.diagnostics if entry.id == "unlit-lines" and entry.severity == "warning")
    assert entry.size == pytest.approx(10 / 128)
    assert "60 to 69" in entry.text
    assert result.prnu_percent.reason_id == "unlit-lines"


def test_dead_columns_are_no_overscan() -> None:
    assert "unlit-lines" not in sizes(stack(2, inner=slice(60, 62)))


def test_full_wells_that_differ_have_the_noise_of_the_dark_frames() -> None:
    found = sizes(stack(3, well_dn=3900.0, light_s=(*LIGHT_S, 1.2)))
    assert "corrected-flats" not in found


@pytest.mark.parametrize("cfa", [MONOCHROME, BAYER], ids=["mono", "bayer"])
def test_frames_of_one_state_agree(cfa: Cfa) -> None:
    """Eight stacks: by chance, one of 300 runs of this test raises one of the diagnostics."""
    for seed in range(8):
        found = limits(calibrate(stack(10 + seed, cfa=cfa, shape=(64, 80))))
        assert not {"other-offsets", "other-dark-current", "unlit-lines", "light-in-darks", "constant-light"} & set(
            found
        ), seed


def test_flat_fields_that_were_divided_are_named_by_their_saturated_pixels() -> None:
    """The master has the true response, to 0.1 %."""
    rng = np.random.default_rng([3, 77])
    master = 1.0 + rng.normal(0.0, 0.01, (96, 128)) + np.random.default_rng(4).normal(0.0, 0.001, (96, 128))

    def divided(kind: str, numbers: np.ndarray) -> np.ndarray:
        numbers = np.minimum(np.rint(numbers), 4095.0)
        return BLACK + (numbers - BLACK) / master if kind == "light" else numbers

    found = sizes(stack(3, change=divided, light_s=(*LIGHT_S, 1.2)))
    # Normal numbers around the full scale, clipped there: their variance is 1/2 - 1 / 2 pi.
    assert found["corrected-flats"] == pytest.approx(0.01 * 4031 * np.sqrt(0.5 - 0.5 / np.pi), rel=0.1)


def test_medians_of_flat_fields_concern_the_gain() -> None:
    found = calibrate(stack(4, of=lambda taken: np.median(taken, axis=0).astype(np.uint16)))
    assert found.system_gain_dn_per_e.value == pytest.approx(GAIN * 0.45, rel=0.05)
    assert any(entry.id == "implausible" and "system_gain_dn_per_e" in entry.parameters for entry in found.diagnostics)


def test_darks_at_the_times_of_the_flat_fields_are_extrapolated_to_no_light() -> None:
    """The shortest dark frames have 5 e- of spread in their dark current, and a DSNU of 4 e-."""
    assert "other-offsets" not in sizes(stack(4, dark_s=LIGHT_S))
