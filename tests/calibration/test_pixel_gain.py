"""The gain of each pixel: a chip of known gains, the closed form of the uncertainty, and slow versions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.chip_maps.pixel_gain import PixelGains, pixel_gain_uncertainty
from photosite.calibration.spatial.pixel_slopes import slope_coefficients
from photosite.engine import lazy_maps
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
from photosite.values.uncertain import Missing

SHAPE, GAIN, SPREAD, READ_E = (48, 64), 2.2, 0.05, 1.6
ELECTRONS = (100.0, 250.0, 500.0, 800.0)
DARKS, FLATS = 400, 200


class Chip:
    """An sCMOS chip in plain NumPy: gain, response, offset and read noise of each pixel."""

    def __init__(self, seed: int, spread: float = SPREAD) -> None:
        self.rng = np.random.default_rng(seed)
        self.gain = GAIN * (1.0 + self.rng.normal(0.0, spread, SHAPE))
        self.response = 1.0 + self.rng.normal(0.0, 0.02, SHAPE)
        self.offset = 100.0 + self.rng.normal(0.0, 2.0, SHAPE)
        self.read_e = READ_E * self.rng.lognormal(0.0, 0.3, SHAPE)

    def frames(self, electrons: float, count: int, lamp: float = 0.0) -> np.ndarray:
        """Return (frames, rows, cols) numbers; `lamp` is the relative scatter of the light from frame to frame."""
        light = electrons * (1.0 + lamp * self.rng.normal(size=(count, 1, 1))) * self.response
        signal = self.rng.poisson(light) + self.read_e * self.rng.normal(size=(count, *SHAPE))
        return np.rint(self.offset + self.gain * signal).astype(np.uint16)


def taken(chip: Chip, flats: int = FLATS, darks: int = DARKS, lamp: float = 0.0) -> dict[float, np.ndarray]:
    """Return the stack of each level."""
    return {e: chip.frames(e, flats if e else darks, lamp) for e in (0.0, *ELECTRONS)}


def frame_set(stacks: dict[float, np.ndarray]) -> FrameSet:
    """Return the frames as levels of light that nobody measured."""
    groups = [
        FrameGroup(
            "light" if electrons else "dark",
            0.01,
            tuple(FrameSource(f"{electrons:g}-{i}", lambda dn=dn: dn) for i, dn in enumerate(stack)),
            level=f"{electrons:g}" if electrons else None,
        )
        for electrons, stack in stacks.items()
    ]
    return FrameSet(tuple(groups), rows=SHAPE[0], cols=SHAPE[1], bits=12)


@cache
def measured() -> tuple[Chip, dict[float, np.ndarray], ps.Calibration]:
    chip = Chip(1)
    stacks = taken(chip)
    return chip, stacks, ps.calibrate(frame_set(stacks), maps="gain")


def by_huang(stacks: dict[float, np.ndarray]) -> np.ndarray:
    """Return the gains by equation 4 of the supplement of Huang et al., pixel by pixel."""
    dark = stacks[0.0].astype(float)
    offset, noise = dark.mean(axis=0), dark.var(axis=0, ddof=1)
    gains = np.empty(SHAPE)
    for place in np.ndindex(SHAPE):
        a = np.array([stacks[e][(slice(None), *place)].var(ddof=1) - noise[place] for e in ELECTRONS])
        b = np.array([stacks[e][(slice(None), *place)].mean() - offset[place] for e in ELECTRONS])
        gains[place] = (b @ a) / (b @ b)
    return gains


def by_weights(chip: Chip, stacks: dict[float, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return gains by the sums of the documented formula, and the standard uncertainties of the true variances."""
    stacked = [stack.astype(float) for stack in stacks.values()]
    mean, variance = (np.array([f(stack) for stack in stacked]) for f in (lambda s: s.mean(axis=0), _variance))
    n = np.array([len(stack) for stack in stacked])
    x, v = mean.mean(axis=(1, 2)), variance.mean(axis=(1, 2))
    c = slope_coefficients(x - x[0], (n - 1) / v**2)
    electrons = np.array([*stacks])[:, None, None] * chip.response + chip.read_e**2
    true = chip.gain**2 * electrons + 1 / 12
    slope = np.tensordot(c, mean, 1)
    return np.tensordot(c, variance, 1) / slope, np.sqrt(np.tensordot(c**2 * 2 / (n - 1), true**2, 1)) / slope


def _variance(stack: np.ndarray) -> np.ndarray:
    """Return the temporal variance without the shifts of whole frames, in proportion to the signal."""
    means = stack.mean(axis=(1, 2))
    own = stack.var(axis=0, ddof=1)
    residual = stack - stack.mean(axis=0) - (means - means.mean())[:, None, None]
    pixels = stack[0].size
    noise = (residual**2).sum() / ((len(stack) - 1) * (pixels - 1))
    shift = means.var(ddof=1) - noise / pixels
    signal = stack.mean(axis=0) - 100.0
    return own - shift * (signal / signal.mean()) ** 2 if signal.mean() > 50.0 else own - shift


def test_gains_have_the_bias_and_scatter_of_the_closed_form() -> None:
    """3072 pixels: the mean within 3.9 standard errors of 0, the mean square of the deviations within 3.9 of 1."""
    chip, _, found = measured()
    deviation = found.chip.pixel_gain_dn_per_e - chip.gain * (found.system_gain_dn_per_e.value / GAIN)
    z = deviation / found.chip.pixel_gain_uncertainty_dn_per_e
    assert abs(z.mean()) < 3.9 / np.sqrt(z.size)
    assert abs((z**2).mean() - 1.0) < 3.9 * np.sqrt(2.0 / z.size)
    gain = found.system_gain_dn_per_e
    assert abs(gain.value - GAIN) < 3.9 * np.hypot(gain.standard_uncertainty, GAIN * SPREAD / np.sqrt(z.size))


def test_precision_is_that_of_the_plan() -> None:
    """The median uncertainty is that of a pixel of mean noise, to the spread of the read noise: 2 %."""
    _, _, found = measured()
    signal = GAIN * np.array([0.0, *ELECTRONS])
    variance = GAIN * signal + (GAIN * READ_E) ** 2 * np.exp(2 * 0.3**2) + 1 / 12
    frames = np.array([DARKS, *(FLATS,) * len(ELECTRONS)], float)
    planned = 100 * pixel_gain_uncertainty(signal, variance, frames) / GAIN
    assert found.pixel_gains.uncertainty_percent == pytest.approx(planned, rel=0.02)


def test_gains_are_those_of_the_slow_version() -> None:
    """In single precision, and with the scale of the system gain; u from likely gains, 2 % each."""
    chip, stacks, found = measured()
    gains, uncertainty = by_weights(chip, stacks)
    ratio = found.chip.pixel_gain_dn_per_e / gains
    assert np.ptp(ratio) < 5e-4 * ratio.mean()
    deviation = found.chip.pixel_gain_uncertainty_dn_per_e / (ratio * uncertainty) - 1.0
    assert abs(deviation.mean()) < 0.01
    assert deviation.std() < 0.05


def test_least_squares_of_huang_scatters_more_and_is_lower() -> None:
    """The unweighted formula agrees within its own larger scatter; its bias is that of the noise in its means."""
    chip, stacks, found = measured()
    own, other = found.chip.pixel_gain_dn_per_e / chip.gain - 1.0, by_huang(stacks) / chip.gain - 1.0
    assert own.std() < 0.97 * other.std()
    assert abs(other.mean() - own.mean()) < 3.9 * (other - own).std() / np.sqrt(own.size) + 1e-3


def test_spread_of_the_gains_is_found() -> None:
    """The spread within 3.9 standard uncertainties; a chip of equal gains has an interval from 0, and a warning."""
    chip, _, found = measured()
    entry = found.pixel_gains.spread_percent
    assert abs(entry.value - 100 * chip.gain.std() / GAIN) < 3.9 * entry.standard_uncertainty
    assert entry.value > 10 * entry.standard_uncertainty
    equal = ps.calibrate(frame_set(taken(Chip(2, spread=0.0), flats=60, darks=100)), maps="gain")
    assert equal.pixel_gains.spread_percent.interval_95[0] == 0.0
    assert equal.pixel_gains.spread_percent.interval_95[1] < 0.2 * equal.pixel_gains.uncertainty_percent
    assert "pixel-gain-noise" in limits(equal)


def test_an_unsteady_lamp_does_not_raise_the_gains() -> None:
    """Light that scatters by 3 % from frame to frame adds 70 % to the variance at 800 electrons."""
    chip = Chip(3)
    found = ps.calibrate(frame_set(taken(chip, lamp=0.03)), maps="gain")
    z = found.chip.pixel_gain_dn_per_e / found.system_gain_dn_per_e.value - chip.gain / GAIN
    z /= found.chip.pixel_gain_uncertainty_dn_per_e / GAIN
    assert abs((z**2).mean() - 1.0) < 3.9 * np.sqrt(2.0 / z.size)


def test_strips_give_the_same_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in frames that are calibrated a few rows at a time."""
    _, stacks, held = measured()
    monkeypatch.setattr(lazy_maps, "HELD_PIXELS", 0)
    monkeypatch.setattr(lazy_maps, "STRIP_VALUES", 500)
    strips = ps.calibrate(frame_set(stacks), maps="gain")
    for name in ("pixel_gain_dn_per_e", "pixel_gain_uncertainty_dn_per_e"):
        assert (getattr(strips.chip, name) == getattr(held.chip, name)).all(), name


def test_mosaics_have_the_gains_of_their_pixels() -> None:
    """Colors that receive 30 to 100 % of the light: bias and scatter of each are those of the closed form."""
    chip = Chip(7)
    share = np.tile([[0.5, 1.0], [1.0, 0.3]], (SHAPE[0] // 2, SHAPE[1] // 2))
    chip.response *= share
    frames = frame_set(taken(chip))
    found = ps.calibrate(replace(frames, cfa=(("R", "G"), ("G", "B"))), maps="gain")
    own, u = found.chip.pixel_gain_dn_per_e, found.chip.pixel_gain_uncertainty_dn_per_e
    for part in (0.3, 0.5, 1.0):
        z = (own / found.system_gain_dn_per_e.value - chip.gain / GAIN)[share == part] / (u[share == part] / GAIN)
        assert abs(z.mean()) < 3.9 / np.sqrt(z.size) + 0.1  # the gain of a color is known to a tenth of a pixel's
        assert abs((z**2).mean() - 1.0) < 3.9 * np.sqrt(2.0 / z.size) + 0.01


def test_few_frames_give_no_map() -> None:
    """With five flat fields of a level, a gain would be uncertain by 38 %."""
    stacks = taken(Chip(4), flats=5, darks=20)
    found = ps.calibrate(frame_set(stacks), maps="gain")
    assert isinstance(found.pixel_gains, Missing)
    assert found.chip.pixel_gain_dn_per_e is None
    assert "pixel-gains-missing" in limits(found)
    assert "pixel-gains-missing" not in limits(ps.calibrate(frame_set(stacks), maps=True))


def test_dark_frames_alone_give_no_map() -> None:
    found = ps.calibrate(frame_set({0.0: Chip(5).frames(0.0, 20)}), maps="gain")
    assert isinstance(found.pixel_gains, Missing)


def test_dead_pixels_have_the_system_gain() -> None:
    chip = Chip(6)
    chip.response[3, 5] = 0.0
    found = ps.calibrate(frame_set(taken(chip)), maps="gain")
    assert isinstance(found.pixel_gains, PixelGains)
    assert found.pixel_gains.undetermined == 1
    gain, uncertainty = found.chip.pixel_gain_dn_per_e[3, 5], found.chip.pixel_gain_uncertainty_dn_per_e[3, 5]
    assert gain == uncertainty == np.float32(found.system_gain_dn_per_e.value)
