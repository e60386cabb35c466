"""What a calibration answers to stacks of frames that are not clean, made by a plain NumPy generator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from photosite.calibration.setting import calibrate_setting
from photosite.errors import PhotositeError
from photosite.frames.frame_set import FrameSet
from photosite.studies.plain_camera import Change, Effect, Frame, PlainCamera, bands, bent, convolved, darker_corners
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.values.cfa import MONOCHROME, Cfa

# The virtual camera: pixels, frames of each level, exposure times, light, and its true figures.
SHAPE = (192, 240)
FRAMES = 8
LIGHT_S = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1)
PROTOCOL = ShootingProtocol(
    "eight levels",
    (*(Step("dark", t, FRAMES) for t in (0.01, 0.1, 1.0)), *(Step("light", t, FRAMES) for t in LIGHT_S)),
)
ELECTRONS_PER_S = 1.5e5
GAIN = 0.3
PRNU = 0.008
BLACK_DN = 64.0
WHITE_DN = 4095
SATURATION_E = (WHITE_DN - BLACK_DN) / GAIN
CAMERA = PlainCamera(
    shape=SHAPE,
    gain=GAIN,
    black_dn=BLACK_DN,
    read_noise_e=6.0,
    dsnu_dn=0.6,
    prnu=PRNU,
    electrons_per_s=ELECTRONS_PER_S,
)


@dataclass(frozen=True)
class StackKind(Effect):
    """A kind of imperfect stack.

    Parameters
    ----------
    name, size
        Name, and size of the effect in words.
    cfa
        Color filter array that is stated for the frames.
    prnu
        PRNU of the frames: crosstalk lowers it, readout channels raise it.
    gain
        System gain of the frames, which a digital gain changes.
    """

    name: str
    size: str
    cfa: Cfa = MONOCHROME
    prnu: float = PRNU
    gain: float = GAIN

    def frames(self, seed: int) -> FrameSet:
        """Return a stack: dark frames at three exposure times, flat fields at eight levels up to saturation."""
        return replace(CAMERA, cfa=self.cfa).frame_set(PROTOCOL, self, seed)


def _mosaic(values: Frame, rng: np.random.Generator) -> Frame:
    rows, cols = (length // 2 for length in values.shape)
    filtered: Frame = values * np.tile([[0.55, 1.0], [1.0, 0.7]], (rows, cols))
    return filtered


def _digital_gain(gain: float | Frame) -> Change:
    return lambda values, rng: np.floor(np.clip(np.rint(values), 0, WHITE_DN) * gain + 0.5)


def _tone_curve(curve: Callable[[Frame], Frame]) -> Change:
    return lambda values, rng: WHITE_DN * curve(np.clip(np.rint(values), 0, WHITE_DN) / WHITE_DN)


def _even_columns(values: Frame, rng: np.random.Generator) -> Frame:
    brighter: Frame = values * (1.0 + 0.01 * (np.arange(values.shape[1]) % 2 == 0))
    return brighter


def _knee(values: Frame, rng: np.random.Generator) -> Frame:
    return np.asarray(values - 0.06 * np.maximum(values - 0.4 * SATURATION_E, 0.0))


def _soft(values: Frame, rng: np.random.Generator) -> Frame:
    return np.asarray(values / (1.0 + 0.1 * values / SATURATION_E))


def _another_chip(values: Frame, rng: np.random.Generator) -> Frame:
    foreign: Frame = values.mean() * (1.0 + PRNU * rng.normal(size=values.shape))
    return foreign if rng.random() < 0.03 else values


CORNERS = darker_corners(SHAPE, 0.05)
_RGGB = (("R", "G"), ("G", "B"))
_CROSSTALK = ((0.0, 0.02, 0.0), (0.02, 0.92, 0.02), (0.0, 0.02, 0.0))

KINDS = (
    StackKind("clean", "monochrome"),
    StackKind("clean mosaic", "RGGB", light=_mosaic, cfa=_RGGB),
    StackKind(
        "crosstalk", "2 % of the charge to each next pixel",
        charge=convolved(_CROSSTALK), prnu=PRNU * float(np.linalg.norm(_CROSSTALK)),
    ),
    StackKind(
        "smoothing in the camera", "5 % of each next pixel",
        numbers=convolved([[0, 0.05, 0], [0.05, 0.8, 0.05], [0, 0.05, 0]]),
    ),
    StackKind(
        "sharpening in the camera", "-10 % of each next pixel",
        numbers=convolved([[0, -0.1, 0], [-0.1, 1.4, -0.1], [0, -0.1, 0]]),
    ),
    StackKind("image lag", "3 % of the charge to the next frame", lag=0.03),
    StackKind("noise reduction over time", "20 % of the last frame", blend=0.2),
    StackKind("row noise", "1 DN", numbers=lambda v, rng: v + rng.normal(0.0, 1.0, (len(v), 1))),
    StackKind("flicker of the light", "bands of 1 %, 37 rows", light=bands(0.01, 37.0)),
    StackKind("drift of the light", "2 % from frame to frame", light=lambda v, rng: v * (1 + 0.02 * rng.normal())),
    StackKind("bent response", "-2 % at saturation", charge=bent(-0.02, 2, SATURATION_E)),
    StackKind("bent response, 4th power", "+5 % at saturation", charge=bent(0.05, 4, SATURATION_E)),
    StackKind("knee of the response", "6 % less slope above 40 %", charge=_knee),
    StackKind("soft saturation", "-9 % at saturation", charge=_soft),
    StackKind(
        "non-linear light", "-2 % at saturation",
        light=lambda v, rng: v * (1.0 - 0.02 * v.mean() / SATURATION_E),
    ),
    StackKind("mosaic not stated", "RGGB stated as monochrome", light=_mosaic),
    StackKind("wrong phase", "RGGB stated as GRBG", light=_mosaic, cfa=(("G", "R"), ("B", "G"))),
    StackKind("digital gain", "1.37", numbers=_digital_gain(1.37), gain=1.37 * GAIN),
    StackKind("digital gain below 1", "0.8", numbers=_digital_gain(0.8), gain=0.8 * GAIN),
    StackKind(
        "prescaled colors", "R 2.1, B 1.5", light=_mosaic, cfa=_RGGB,
        numbers=_digital_gain(np.tile([[2.1, 1.0], [1.0, 1.5]], (SHAPE[0] // 2, SHAPE[1] // 2))),
    ),
    StackKind("gamma", "1 / 2.2", numbers=_tone_curve(lambda x: x ** (1 / 2.2))),
    StackKind("square-root companding", "12 bits", numbers=_tone_curve(np.sqrt)),
    StackKind("clipping below full scale", "at 2800 DN", numbers=lambda v, rng: np.minimum(np.rint(v), 2800.0)),
    StackKind("readout channels", "even columns 1 % brighter", light=_even_columns, prnu=math.hypot(PRNU, 0.005)),
    StackKind(
        "taps", "right half 1 % brighter",
        light=lambda v, rng: v * np.where(np.arange(SHAPE[1]) < SHAPE[1] // 2, 1.0, 1.01),
        prnu=math.hypot(PRNU, 0.005),
    ),
    StackKind(
        "uneven light", "10 % darker corners",
        light=lambda v, rng: v * CORNERS, prnu=math.hypot(PRNU, float(CORNERS.std())),
    ),
    StackKind("wrong level", "light of one level 4 % off", wrong_level=(5, 1.04)),
    StackKind("frames of another chip", "3 % of the frames", light=_another_chip),
)  # fmt: skip
"""The kinds of stacks."""


@dataclass(frozen=True)
class Answer:
    """What a calibration of a stack answers.

    Parameters
    ----------
    kind
        The kind of stack.
    gain, prnu
        Interval of 95 % of the system gain (DN/e-) and of PRNU (%), or the reason why it is withheld.
    warnings
        Warnings of the calibration, or the error that refused the stack.
    """

    kind: StackKind
    gain: tuple[float, float] | str
    prnu: tuple[float, float] | str
    warnings: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether every interval that is given contains the truth."""
        pairs = ((self.gain, self.kind.gain), (self.prnu, 100.0 * self.kind.prnu))
        return all(isinstance(given, str) or given[0] <= truth <= given[1] for given, truth in pairs)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "kind": self.kind.name,
            "size": self.kind.size,
            "right": self.right,
            "system_gain_dn_per_e": self.gain,
            "prnu_percent": self.prnu,
            "warnings": self.warnings,
        }


def imperfect_stacks(seeds: Iterable[int] = (0,), kinds: Sequence[StackKind] = KINDS) -> Iterator[Answer]:
    """Calibrate a stack of each kind with each seed, in this order.

    Examples
    --------
    >>> (answer,) = imperfect_stacks([2], KINDS[:1])
    >>> answer.right, answer.warnings
    (True, ())
    """
    for kind, seed in product(kinds, tuple(seeds)):
        try:
            calibration = calibrate_setting(kind.frames(seed))
        except PhotositeError as error:
            yield Answer(kind, str(error), str(error), (str(error),))
            continue
        gain, prnu = (
            estimate.interval_95 or str(estimate.reason)
            for estimate in (calibration.system_gain_dn_per_e, calibration.prnu_percent)
        )
        yield Answer(kind, gain, prnu, tuple(calibration.warnings))
